"""Belts that wedge in the grooves of V- or ribbed pulleys: forces, slip, losses and zones."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from beltjax.analysis.contact import scaled_torques, without_friction
from beltjax.analysis.installed import free_positions, held
from beltjax.analysis.reference import LARGEST_STRAIN, resting
from beltjax.compiling.batched_loops import in_lanes_of
from beltjax.compiling.quick import long_boundary_jit
from beltjax.drive.assembly import Assembly, assembled
from beltjax.drive.canonical import canonical
from beltjax.drive.components import Pulley, as_real, concrete
from beltjax.drive.contact_groups import ContactGroups, TravelOrder, contact_groups
from beltjax.drive.groups import Scales
from beltjax.drive.installation import BeltGiven, TensionGiven
from beltjax.drive.layout import layout
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.placeholders import harmless, numbers_are_usable
from beltjax.drive.readable import Readable
from beltjax.drive.system import Drive, all_held
from beltjax.numerics.bvp.collocation import Interval, interpolate
from beltjax.numerics.derivative_rules import differentiated_once
from beltjax.numerics.rigid_bodies import holding_stop
from beltjax.physics import groove_drive as physics
from beltjax.physics.contact import BeltMotion
from beltjax.physics.groove import Flanks
from beltjax.physics.groove_arc import DEEP, states
from beltjax.physics.groove_measures import GrooveMeasures, measures
from beltjax.physics.groove_thin_drive import SolvedThinGrooves, solve_thin, thin_measures
from beltjax.physics.inclined_spans import Frame, inclined_spans
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
    succeeded,
)

BALANCED = 1e-7  # of the mean tension: what the balance of moments may lack
HALVINGS, ROUNDS = 8, 18  # of the search for the limit of adhesion
BLURRED = 0.01  # of the driver's moment: a larger error by the friction's viscous part is told


class Groove(eqx.Module):
    """The full model, by collocation on each arc."""

    slip_velocity: Float[Array, ""] = eqx.field(converter=as_real, default=1e-5)
    elements: int = eqx.field(static=True, default=400)


class ThinGroove(eqx.Module):
    """Formulas for a belt that sinks in little, with Coulomb's friction; up to `AdhesionLimit`."""


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
        unit = Interval(jnp.zeros(()), jnp.ones(()))
        s = jnp.asarray(s)
        y, _ = interpolate(unit, arc.mesh, arc.z, jnp.ravel(s))
        return place, y.reshape(3, *s.shape), arc.z.p


class SlipLimit(eqx.Module):
    """Torques up to which no loaded pulley slips more than this: 1 - (omega R)/(omega R)_driver."""

    slip: Float[Array, ""] = eqx.field(converter=as_real, default=0.05)


class AdhesionLimit(eqx.Module):
    """Torques up to which some of the belt adheres on every loaded pulley."""


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


def groove_method(drive: Drive) -> Groove | ThinGroove:
    """The method that the drive itself gives, by [contact] of its file."""
    if drive.contact.model == "thin":
        return ThinGroove()
    return Groove(slip_velocity=drive.contact.slip_velocity)


def _is_thin(method: Groove | ThinGroove) -> bool:
    return isinstance(method, ThinGroove)


def groove_question(
    method: Groove | ThinGroove, limit: SlipLimit | AdhesionLimit | None
) -> tuple[Groove | ThinGroove, Float[Array, ""], Float[Array, ""], int]:
    """Method and limit as `groove_solution` takes them."""
    if isinstance(limit, AdhesionLimit):
        return method, as_real(2.0), as_real(0.0), 0 if _is_thin(method) else ROUNDS
    if limit is None:
        return method, as_real(0.0), as_real(0.0), 0
    return method, as_real(1.0), limit.slip, 0


class UnmetGroove(NamedTuple):
    """What keeps a drive from being asked, by its key in a drive file."""

    key: str
    message: str


def unmet_groove(drive: Drive, point: OperatingPoint | None, maximum: bool) -> UnmetGroove | None:
    """What the model of grooves cannot do without; None where nothing is missing.

    Without a point, what is missing whatever the torques.
    """
    if len(drive.belts) > 1:
        return UnmetGroove("belt", "are several; grooves are found for a drive of one belt")
    if drive.belt.wedge_angle is None:
        message = "is missing; grooves need groove = { angle, wedge_stiffness } of the belt"
        return UnmetGroove("belt.groove", message)
    if drive.belt.pitch is not None:
        return UnmetGroove("belt.pitch", "is of a toothed belt, which does not wedge")
    if not isinstance(drive.installation, TensionGiven | BeltGiven):
        message = "gives the belt by other means than tension or belt_length; give one of these"
        return UnmetGroove("installation", message)
    if getattr(drive.installation, "tension_of", "belt") == "string":
        message = "is that of a string, which does not sink in; leave tension_of out"
        return UnmetGroove("installation.tension_of", message)
    floating = drive.tensioners and all_held(drive.tensioners) is False
    if floating:
        message = "has no spring and is not locked; in grooves each tensioner has one"
        return UnmetGroove("tensioner", message)
    return _unmet_pulley(drive, point, maximum)


def _unmet_pulley(drive: Drive, point: OperatingPoint | None, maximum: bool) -> UnmetGroove | None:
    bare = None if point is None else without_friction(drive, point, maximum)
    wedged = [p.name for p in drive.pulleys if p.friction is None and _may_wedge(p)]
    if wedged or bare is not None:
        message = "is missing; give the coefficient of the groove's flanks, or of the smooth rim"
        return UnmetGroove(f"pulley.{wedged[0] if wedged else bare}.friction", message)
    for pulley in drive.pulleys:
        own = pulley.wedge_angle
        angle = concrete(drive.belt.wedge_angle if own is None else own)
        friction = concrete(pulley.friction)
        if angle is None or friction is None or not _may_wedge(pulley):
            continue
        if np.any(angle / 2 + np.arctan(friction) >= np.pi / 2):
            key = "belt.groove" if own is None else f"pulley.{pulley.name}.groove"
            message = "and friction leave no wedge: half the angle + atan(friction) is below 90 deg"
            return UnmetGroove(f"{key}.angle", message)
    return None


def _may_wedge(pulley: Pulley) -> bool:
    """Whether a pulley has a groove, or may have one where JAX traces its flags."""
    face, wedged = concrete(pulley.face), concrete(pulley.wedged)
    if face is None or wedged is None:
        return True
    return bool(np.any((face > 0) & (wedged > 0)))


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
    good = numbers_are_usable(drive, point)
    drive, point = harmless(drive, point, good)
    drawn = layout(drive, throw=False)
    drawable = drawn.result
    drive, point = harmless(drive, point, succeeded(drawable))
    made = assembled(drive, point)._replace(drawn=drawn)
    start = _start(made)
    base = start.tension
    taken, scalable = scaled_torques(made, base, (limit > 0).astype(float))
    groups, scales = contact_groups(made, point, taken, base)
    fit = good & succeeded(drawable)
    model = groove_model(made, groups, scales, method, fit)
    rested, solved = _solutions(made, groups, scales, model, method, start, limit, slip, rounds)
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


class _GrooveStart(NamedTuple):
    tension: Float[Array, ""]  # [N]
    coordinates: Float[Array, " coordinates"]  # from the drawn positions [rad] or [m]
    length: Float[Array, ""]  # of the unstretched belt [m]; 1 where the tension gives it
    relaxed: Float[Array, " coordinates"]  # force of the springs at the drawn positions


def _start(made: Assembly) -> _GrooveStart:
    """What the installation gives, and where a search begins."""
    rule, still = made.rule, made.still
    if isinstance(rule, TensionGiven):
        return _GrooveStart(rule.tension, still, jnp.ones(()), still)
    assert isinstance(rule, BeltGiven)  # as `unmet_groove` holds
    string, fixed = resting(made), jax.lax.stop_gradient
    rested = succeeded(string.result)
    nominal = 0.01 * made.EA[0]
    tension = fixed(jnp.where(rested, string.base_tensions[0], nominal))
    at = fixed(jnp.where(rested, string.coordinates, 0.0))
    lengths = jnp.broadcast_to(rule.belt_length, (1,))
    springs_of = held(made, lengths, free_positions(made, rule))
    return _GrooveStart(tension, at, lengths[0], springs_of.relaxed)


def _slip_velocity(method: Groove | ThinGroove) -> Float[Array, ""]:
    return method.slip_velocity if isinstance(method, Groove) else jnp.zeros(())


def groove_model(
    made: Assembly,
    groups: ContactGroups,
    scales: Scales,
    method: Groove | ThinGroove,
    fit: Bool[Array, ""],
) -> physics.GrooveModel:
    """The groups in the letters of the theory."""
    drive, belt = made.drive, made.drive.belt
    order = TravelOrder.of(made.loops, made.driven.travel).pulleys
    smooth = [1 - jnp.where(p.face > 0, p.wedged, 0.0) for p in drive.pulleys]
    flat = jax.lax.stop_gradient(jnp.stack(smooth))[order]
    angles = [belt.wedge_angle if p.wedge_angle is None else p.wedge_angle for p in drive.pulleys]
    beta = jnp.stack([jnp.asarray(angle) for angle in angles])[order] / 2
    R, one, EA = jnp.abs(groups.radii), jnp.ones(()), groups.stretches[0]
    eps = _slip_velocity(method)
    K = jnp.where(fit, belt.wedge_stiffness * scales.length**2 / scales.tension, 50 / R**2)
    whole = Flanks(R, beta, groups.friction, K, *(jnp.broadcast_to(x, R.shape) for x in (EA, eps)))
    nominal, _ = physics.flat_groove(jax.lax.stop_gradient(R), one, jax.lax.stop_gradient(EA), eps)
    nominal = jax.lax.stop_gradient(nominal)
    grooves = jax.tree.map(lambda a, b: jnp.where(flat > 0, a, b), nominal, whole)
    frame = Frame(
        x=groups.centers[:, 0],
        y=groups.centers[:, 1],
        rho=groups.radii,
        loops=groups.loops,
        bodies=groups.bodies,
        housed=groups.housed,
        K=groups.stiffness,
        outside=groups.outside,
    )
    motion = BeltMotion(groups.masses, groups.belt_speed, groups.driver_speed, groups.mass_flow)
    return physics.GrooveModel(
        frame=frame,
        grooves=grooves,
        flat=flat,
        mu=groups.friction,
        EA=EA,
        pull=groups.pulls,
        driving=groups.driving,
        loaded=jax.lax.stop_gradient((groups.pulls != 0).astype(float)),
        motion=motion,
    )


def _solutions(
    made: Assembly,
    groups: ContactGroups,
    scales: Scales,
    model: physics.GrooveModel,
    method: Groove | ThinGroove,
    start: _GrooveStart,
    limit: Float[Array, ""],
    slip: Float[Array, ""],
    rounds: int,
) -> tuple[Bool[Array, ""], physics.SolvedGrooves | SolvedThinGrooves]:
    """Whether the belt rests, and the running belt."""
    one, zero, units = jnp.ones(()), jnp.zeros(()), groups.units
    at = start.coordinates / units
    relaxed = start.relaxed * units / scales.energy
    holding = physics.GrooveBelt(start.length / scales.length, relaxed)
    greatest = _greatest(model)
    scale = jnp.where(limit == 2, greatest - 0.7, 0.0)
    running = physics.GrooveTask(zero, one, limit, slip, scale, holding)
    level = one
    if isinstance(made.rule, BeltGiven) and not len(units):
        likely = physics.likely_tension(holding.L0, model)
        level = jnp.where(likely > 0, likely, one)
    still = physics.at_rest(model)
    rest = running._replace(resting=one, limit=zero, scale=zero)
    both = (still, rest, jnp.array(False)), (model, running, jnp.array(True))
    stages = both if isinstance(made.rule, TensionGiven) else both[1:]
    stages = (*stages, *stages[-1:] * rounds)
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *stages)

    # All tasks use one compiled search in turn: the first finds the belt for the others.
    def stage(carry: Any, now: Any) -> tuple[Any, physics.SolvedGrooves | SolvedThinGrooves]:
        kept, bracket = carry
        model, task, runs = now
        kept = jax.tree.map(lambda a, b: jnp.where(runs & rests, a, b), kept, task.held)
        task = task._replace(held=kept, scale=jnp.where(runs, bracket.place, 0.0))
        begin = physics.likely(level, at, task.scale, model)
        if isinstance(method, ThinGroove):
            solved = solve_thin(model, task, begin)
            return (solved.held, bracket), solved
        solved = physics.solve(model, task, begin, method.elements)
        slides = jnp.where(solved.converged, physics.adhering(solved.arcs, model), 1.0)
        after = _narrowed(bracket, jax.lax.stop_gradient(slides))
        searched = runs & (limit == 2)
        bracket = jax.tree.map(lambda a, b: jnp.where(searched, a, b), after, bracket)
        return (solved.held, bracket), solved

    rests = isinstance(made.rule, TensionGiven)
    bracket = _AdhesionBracket(scale, greatest - 4, jnp.array(-0.1), greatest, jnp.array(1.0), zero)
    first = in_lanes_of(model.EA, (holding, jax.lax.stop_gradient(bracket)))
    _, found = jax.lax.scan(stage, first, stacked)
    run = jax.tree.map(lambda x: x[-1], found)
    return found.converged[0], run


class _AdhesionBracket(NamedTuple):
    """Factors on the torques, as logs, between which adhesion ends on a first pulley."""

    place: Float[Array, ""]  # to be tried
    low: Float[Array, ""]
    bottom: Float[Array, ""]  # what is left of adhesion, as `adhering` counts it
    high: Float[Array, ""]
    top: Float[Array, ""]
    tried: Float[Array, ""]


def _narrowed(at: _AdhesionBracket, found: Float[Array, ""]) -> _AdhesionBracket:
    """The bracket after a trial: halved at first, then by secants that weigh an old end less."""
    up, secant = found > 0, at.tried >= HALVINGS
    low, bottom = jnp.where(up, at.low, at.place), jnp.where(up, at.bottom, found)
    high, top = jnp.where(up, at.place, at.high), jnp.where(up, found, at.top)
    bottom = jnp.where(up & secant, bottom / 2, bottom)
    top = jnp.where(up | ~secant, top, top / 2)
    straight = (low * top - high * bottom) / (top - bottom)
    place = jnp.where(secant, straight, (low + high) / 2)
    return _AdhesionBracket(place, low, bottom, high, top, at.tried + 1)


def _greatest(model: physics.GrooveModel) -> Float[Array, ""]:
    """Log of the factor on the torques at which a first pulley slips as a rope would."""
    none = jnp.zeros_like(model.pull)
    turns = inclined_spans(none, none, jnp.zeros(len(model.frame.K)), model.frame).turns
    held = model.mu * turns / jnp.where(model.flat > 0, 1.0, jnp.sin(model.grooves.beta))
    least = jnp.min(jnp.where(model.loaded > 0, held, jnp.inf))
    least = jnp.where(jnp.isfinite(least), least, 1.0)
    offsets = jnp.cumsum(model.pull)
    widest = jnp.max(offsets) - jnp.min(offsets)
    drop = 2 * jnp.tanh(least / 2)  # of the tension, over its mean
    return jax.lax.stop_gradient(jnp.log(drop / jnp.where(widest > 0, widest, 1.0)))


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
        slip_velocity=_slip_velocity(method),
        order=order,
        model=model,
        solved=solved,
        scales=scales,
        error=solved.residual,
        result=result,
        warning=first_failure((vague & succeeded(result), RESULTS.friction_blurred)),
        stats={"steps": solved.steps, "level": solved.eps},
    )
