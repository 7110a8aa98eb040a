"""Belts that wedge in the grooves of V- or ribbed pulleys: forces, slip, losses and zones."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from beltjax.analysis.contact import scaled_torques
from beltjax.analysis.groove_methods import (
    AdhesionLimit,
    Groove,
    SlipLimit,
    ThinGroove,
    groove_method,
    groove_question,
    unmet_groove,
)
from beltjax.analysis.groove_search import (
    groove_model,
    groove_solutions,
    groove_start,
    slip_velocity,
)
from beltjax.analysis.reference import LARGEST_STRAIN
from beltjax.compiling.quick import long_boundary_jit
from beltjax.drive.assembly import Assembly, usable_assembly
from beltjax.drive.canonical import canonical
from beltjax.drive.contact_groups import ContactGroups, TravelOrder, contact_groups
from beltjax.drive.groups import Scales
from beltjax.drive.layout import layout
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.readable import Readable
from beltjax.drive.system import Drive
from beltjax.numerics.bvp.collocation import interpolate
from beltjax.numerics.derivative_rules import differentiated_once
from beltjax.numerics.rigid_bodies import holding_stop
from beltjax.physics import groove_drive as physics
from beltjax.physics.groove_arc import DEEP, states
from beltjax.physics.groove_measures import GrooveMeasures, measures
from beltjax.physics.groove_thin_drive import SolvedThinGrooves, thin_measures
from beltjax.physics.inclined_arcs import unit_interval
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
    succeeded,
)

BALANCED = 1e-7  # of the mean tension: what the balance of moments may lack
BLURRED = 0.01  # of the driver's moment: a larger error by the friction's viscous part is told


class GrooveErrors(eqx.Module):
    """How far the viscous part of friction, below `slip_velocity`, moves each number.

    Estimated from the state at a larger one; in the units of the numbers.
    """

    tensions: Float[Array, " spans"]
    speeds: Float[Array, " pulleys"]
    moments: Float[Array, " pulleys"]
    slip: Float[Array, " pulleys"]
    loss: Float[Array, " pulleys"]
    contact_angles: Float[Array, "pulleys 2"]
    wraps: Float[Array, " pulleys"]
    penetrations: Float[Array, " pulleys"]
    efficiency: Float[Array, ""]


class GrooveState(Readable):
    """A belt that wedges in grooves, in listed order; a span starts at its first listed pulley."""

    tensions: Float[Array, " spans"]  # [N]
    speeds: Float[Array, " pulleys"]  # [rad/s], magnitudes
    moments: Float[Array, " pulleys"]  # taken from the belt, the driver's negative [N m]
    slip: Float[Array, " pulleys"]  # 1 - (omega R)/(omega R of the driver)
    loss: Float[Array, " pulleys"]  # power of sliding [W]
    wraps: Float[Array, " pulleys"]  # angles over which the belt touches [rad]
    contact_angles: Float[Array, "pulleys 2"]  # chi where it comes in and where it leaves [rad]
    zones: Float[Array, "pulleys 4"]  # seating, adhesion, sliding, unseating [rad]
    penetrations: Float[Array, " pulleys"]  # the deepest of each [m]
    efficiency: Float[Array, ""]  # power delivered over power taken up
    power_in: Float[Array, ""]  # of the driver [W]
    power_out: Float[Array, ""]  # that the accessories take [W]
    driver_moment: Float[Array, ""]  # magnitude [N m]
    torque_factor: Float[Array, ""]  # on the operating point's torques; 1 unless they were scaled
    span_lengths: Float[Array, " spans"]  # [m]
    span_speeds: Float[Array, " spans"]  # of the belt [m/s]
    unstretched_length: Float[Array, ""]  # L0 [m]
    unstretched_speed: Float[Array, ""]  # V_ref [m/s]
    mass_flow: Float[Array, ""]  # G [kg/s]
    coordinates: Float[Array, " coordinates"]  # from the drawn positions [rad] or [m]
    at_stop: Float[Array, " coordinates"]  # -1 at the least, 1 at the greatest coordinate, else 0
    energy_balance: Float[Array, ""]  # power that is missing [W]
    moment_balance: Float[Array, " pulleys"]  # moment that is missing [N m]
    regularization: GrooveErrors
    slip_velocity: Float[Array, ""]  # over the unstretched belt's speed
    order: TravelOrder  # of what is listed, as the belt meets it
    model: physics.GrooveModel  # in the units of `scales`, along the belt's travel
    solved: physics.SolvedGrooves | SolvedThinGrooves
    scales: Scales
    error: Float[Array, ""]  # residual of the equations before the last Newton step: an upper bound
    result: RESULTS
    warning: RESULTS
    stats: dict[str, Array]

    @property
    def feasible(self) -> Bool[Array, ""]:
        """Whether the state was found and is physical."""
        return succeeded(self.result)

    def penetration(self, i: int, s: Array) -> Array:
        """Depth [m] of the belt in the groove of pulley i; 0 on a smooth one.

        `s` are fractions of the angle over which the belt touches, from where it comes in.
        """
        if isinstance(self.solved, SolvedThinGrooves):
            return self._of_thin(i, s)[0]
        place, y, _ = self._along(i, s)
        radius = jnp.abs(self.model.frame.rho)[place] * self.scales.length
        return jnp.where(self.model.flat[place] > 0, 0.0, DEEP * y[0] * radius)

    def sliding_angle(self, i: int, s: Array) -> Array:
        """Direction in which the belt slides over the flanks of pulley i [rad]; `s` as above.

        From 0, inwards, over +-90 degrees, along the groove (positive where the belt is faster), to
        +-180 degrees, outwards. 0 on a smooth pulley.
        """
        if isinstance(self.solved, SolvedThinGrooves):
            return self._of_thin(i, s)[1]
        place, y, p = self._along(i, s)
        of = jax.tree.map(lambda x: x[place], self.solved.grooves)
        at = states(y, p, of)
        angle = jnp.arctan2(at.v_t, -at.v_g)
        return jnp.where(self.model.flat[place] > 0, 0.0, angle)

    def _place(self, i: int) -> Array:
        if not 0 <= i < len(self.slip):
            raise IndexError(f"pulley {i} of {len(self.slip)}: pulleys count from 0.")
        return self.order.pulleys[i]

    def _of_thin(self, i: int, s: Array) -> tuple[Array, Array]:
        """Depth [m] and direction: the belt adheres up to where its arc of sliding begins."""
        place = self._place(i)
        arc = jax.tree.map(lambda x: x[place], self.solved.arcs)
        theta = jnp.asarray(s) * self.wraps[i] - (self.wraps[i] - arc.sliding)
        radius = jnp.abs(self.model.frame.rho)[place] * self.scales.length
        grooved = self.model.flat[place] == 0
        depth = radius * jnp.interp(theta, arc.theta, arc.xi)
        gamma = jnp.interp(theta, arc.theta, arc.gamma)
        return jnp.where(grooved, depth, 0.0), jnp.where(grooved, gamma, 0.0)

    def _along(self, i: int, s: Array) -> tuple[Any, Array, Array]:
        place = self._place(i)
        arc = jax.tree.map(lambda x: x[place], self.solved.arcs)
        unit = unit_interval()
        s = jnp.asarray(s)
        y, _ = interpolate(unit, arc.mesh, arc.z, jnp.ravel(s))
        return place, y.reshape(3, *s.shape), arc.z.p


def groove_state(
    drive: Drive,
    point: OperatingPoint,
    method: Groove | ThinGroove | None = None,
    *,
    throw: bool = True,
) -> GrooveState:
    """The running belt in the grooves of its pulleys: penetration, sliding, slip and losses.

    The belt is a string that is pressed into a wedge against friction in every direction of the
    flanks; pulleys on its back, or with `wedged=0`, are smooth, as in `contact_state`.
    docs/theory/grooves.md, (W1) to (W13). `installation.tension` is the mean tension of the spans
    of the belt that is turned slowly without torque.

    A drive whose torques friction does not pass on is `groove_not_found`; a smooth pulley that
    slips over its whole arc is `gross_slip`. With `throw=False` read `.result`: a failed lane of a
    batch holds finite placeholders with zero derivatives. Derivatives are those of the converged
    equations on the mesh that was found; second ones are NaN.

    Args:
        drive: a drive of one belt with `wedge_angle` and `wedge_stiffness`.
        point: speeds and torques.
        method: `Groove()` with the drive's own `contact` unless given.
        throw: raise where the result is a failure.

    Returns:
        Tensions, speeds, slip, losses and zones, in SI units and listed order, each with the part
        that the viscous friction below `slip_velocity` has in it.

    Raises:
        KeyError: a torque is given for a pulley that is not there.
        ValueError: the drive is not one that the model describes; the text says why.
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/two_pulley_groove.toml")
        >>> state = bj.groove_state(drive, point)
        >>> state.slip, state.loss, state.efficiency  # 1, [W], 1
    """
    return solved_groove(drive, point, method, None, throw)


def solved_groove(
    drive: Drive,
    point: OperatingPoint,
    method: Groove | ThinGroove | None,
    limit: SlipLimit | AdhesionLimit | None,
    throw: bool,
) -> GrooveState:
    """`groove_state`, or the state under the largest torques that a limit allows."""
    unmet = unmet_groove(drive, point, limit is not None)
    if unmet is not None:
        raise ValueError(f"{unmet.key} {unmet.message}.")
    question = groove_question(groove_method(drive) if method is None else method, limit)
    found = groove_solution(*canonical(drive, point), *question)
    return raise_unless_successful(found, found.result, throw)


@long_boundary_jit
def groove_solution(
    drive: Drive,
    point: OperatingPoint,
    method: Groove | ThinGroove,
    limit: Float[Array, ""],
    slip: Float[Array, ""],
    rounds: int,
) -> GrooveState:
    """`groove_state` or `maximum_moment`, whose failures are in its result alone."""
    made, point, good, drawable = usable_assembly(drive, point)
    drive = made.drive
    start = groove_start(made)
    base = start.tension
    taken, scalable = scaled_torques(made, base, (limit > 0).astype(float))
    groups, scales = contact_groups(made, point, taken, base)
    fit = good & succeeded(drawable)
    model = groove_model(made, groups, scales, method, fit)
    asked = limit, slip, rounds
    rested, solved = groove_solutions(made, groups, scales, model, method, start, asked)
    if isinstance(solved, SolvedThinGrooves):
        found = thin_measures(solved, model)
        coarse, ratio = found, jnp.array(2.0)
        ends = jnp.any((model.flat == 0) & (solved.unknown.turn < solved.arcs.sliding - 1e-6))
    else:
        found = measures(solved.unknown, solved.loop, solved.arcs, solved.grooves, model)
        coarse = jax.lax.stop_gradient(measures(*solved.coarser, model))
        ratio = solved.coarser.grooves.eps[0] / solved.grooves.eps[0]
        ends = jnp.array(False)
    strain = jnp.max(solved.loop.stretch) - 1
    moved = layout(drive, solved.unknown.q * groups.units, throw=False)
    level = jnp.abs(model.frame.rho) * jnp.mean(found.P)
    lacking = jnp.max(jnp.abs(found.moment) / level) > BALANCED
    flat = (model.flat > 0) & (model.loaded > 0)
    missing = first_failure(
        (~good, RESULTS.numbers_unusable),
        (~succeeded(drawable), drawable),
        (~scalable, RESULTS.no_torque_to_scale),
        (~rested, RESULTS.groove_not_found),
        (~solved.converged, RESULTS.groove_not_found),
        (lacking, RESULTS.groove_unresolved),
    )
    result = first_failure(
        (~succeeded(missing), missing),
        (~succeeded(moved.result), moved.result),
        (strain > LARGEST_STRAIN, RESULTS.belt_overstretched),
        (ends, RESULTS.thin_groove_slides),
        (jnp.any(flat & (found.zones[:, 1] < -1e-9)), RESULTS.gross_slip),
    )
    pair = found, coarse, ratio
    state = _state(made, groups, scales, model, solved, pair, method, result)
    return frozen_where_failed(differentiated_once(state), missing)


def _state(
    made: Assembly,
    groups: ContactGroups,
    scales: Scales,
    model: physics.GrooveModel,
    solved: physics.SolvedGrooves | SolvedThinGrooves,
    told_and_coarse: tuple[GrooveMeasures, GrooveMeasures, Array],
    method: Groove | ThinGroove,
    result: RESULTS,
) -> GrooveState:
    """The solution in SI and listed order."""
    found, coarse, ratio = told_and_coarse
    travel = jax.lax.stop_gradient(made.driven.travel)
    order, force, length = TravelOrder.of(made.loops, travel), scales.tension, scales.length
    speed = length / scales.time
    power, moment = force * speed * solved.loop.V_ref, force * length
    P, S = order.pulleys, order.spans
    radius = jnp.abs(model.frame.rho) * length

    def numbers(of: GrooveMeasures) -> dict[str, Array]:
        return {
            "tensions": (of.T * force)[S],
            "speeds": (of.omega / scales.time)[P],
            "moments": (of.M * moment)[P],
            "slip": of.slip[P],
            "loss": (of.loss * power)[P],
            "contact_angles": of.chi[P],
            "wraps": of.wraps[P],
            "penetrations": (of.deepest * radius)[P],
            "efficiency": of.efficiency,
        }

    told, before = numbers(found), numbers(coarse)
    share = 1 / jnp.where(ratio > 1, ratio - 1, 1.0)
    errors = {
        key: jax.lax.stop_gradient(jnp.abs(before[key] - value) * share)
        for key, value in told.items()
    }
    scale = jnp.max(jnp.abs(told["moments"]))
    vague = jnp.max(errors["moments"]) > BLURRED * scale
    q, frame = solved.unknown.q, model.frame
    balance = solved.loop.push + solved.held.relaxed - frame.K @ q
    m0, _, _, G = model.motion
    flow = m0[0] * solved.loop.V_ref if G is None else G
    return GrooveState(
        **told,
        zones=found.zones[P],
        power_in=found.given * power,
        power_out=found.taken * power,
        driver_moment=jnp.abs(model.driving @ found.M) * moment,
        torque_factor=jnp.exp(solved.unknown.scale),
        span_lengths=(solved.loop.spans.lengths * length)[S],
        span_speeds=(found.speed * speed)[S],
        unstretched_length=solved.held.L0 * length,
        unstretched_speed=solved.loop.V_ref * speed,
        mass_flow=flow * force / speed,
        coordinates=q * groups.units,
        at_stop=holding_stop(frame.bodies, q, balance),
        energy_balance=found.energy * power,
        moment_balance=(found.moment * moment)[P],
        regularization=GrooveErrors(**errors),
        slip_velocity=slip_velocity(method),
        order=order,
        model=model,
        solved=solved,
        scales=scales,
        error=solved.residual,
        result=result,
        warning=first_failure((vague & succeeded(result), RESULTS.friction_blurred)),
        stats={"steps": solved.steps, "level": solved.eps},
    )
