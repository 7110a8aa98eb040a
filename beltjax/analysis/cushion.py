"""Belts whose cords ride on an elastic cushion around the pulleys: the steady state."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from beltjax.analysis.installed import free_positions, held
from beltjax.analysis.reference import LARGEST_STRAIN
from beltjax.analysis.string_belts import belts_of_the_string, frame_of
from beltjax.compiling.batched_loops import in_lanes_of
from beltjax.compiling.quick import boundary_jit
from beltjax.drive.assembly import Assembly, usable_assembly
from beltjax.drive.canonical import canonical
from beltjax.drive.contact_groups import ContactGroups, TravelOrder, contact_groups
from beltjax.drive.groups import Scales
from beltjax.drive.installation import BeltGiven, Preloaded, TensionGiven
from beltjax.drive.layout import layout
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.readable import Readable
from beltjax.drive.system import Drive
from beltjax.numerics.derivative_rules import differentiated_once
from beltjax.numerics.rigid_bodies import holding_stop
from beltjax.physics import cushion, cushion_arc, cushion_drive, span
from beltjax.physics.cushion import Layer
from beltjax.physics.cushion_drive import CushionModel, Found, Given, Running
from beltjax.physics.string_contact import critical_speed
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
    succeeded,
)


class ThinCushion(eqx.Module):
    """Layers that are thin beside the radius, in closed form: docs/theory/cushion.md, (U3) to (U7).

    Its error is of order P/(k_r R^2), and in the shear of order sqrt(P k_s/(EA k_r)).
    """


class Cushion(eqx.Module):
    """The exact geometry by collocation: docs/theory/cushion.md, (U1) and (U2)."""

    elements: int = eqx.field(static=True, default=48)

    def __check_init__(self):
        if self.elements < 8:
            raise ValueError(f"Cushion: elements must be at least 8, not {self.elements}.")


class CushionState(Readable):
    """Belt and pulleys in listed order, as in `ContactState`; angles chi are along the travel."""

    wraps: Float[Array, " pulleys"]  # angle over which the cords touch [rad]
    slips: Float[Array, " pulleys"]  # angle over which they slide [rad]
    moments: Float[Array, " pulleys"]  # taken from the belt, the driver's negative [N m]
    pulley_speeds: Float[Array, " pulleys"]  # [rad/s]
    losses: Float[Array, " pulleys"]  # [W]
    contact_angles: Float[Array, "pulleys 2"]  # chi where the belt comes (< 0) and leaves [rad]
    contact_lengths: Float[Array, " pulleys"]  # of the cords [m]
    penetrations: Float[Array, " pulleys"]  # largest give of the cords towards the axis [m]
    shears: Float[Array, " pulleys"]  # carried out where the belt leaves [m]
    hub_loads: Float[Array, "pulleys 2"]  # force of the running belt on the pulleys [N]
    effective_tensions: Float[Array, " spans"]  # P = T - G V [N]
    tensions: Float[Array, " spans"]  # T [N]
    span_lengths: Float[Array, " spans"]  # of the free belt [m]
    span_angles: Float[Array, " spans"]  # direction of travel [rad]
    coupling: Float[Array, " spans"]  # Gamma_i, with the belt's bending stiffness
    turns: Float[Array, " pulleys"]  # by which each pulley turns the belt [rad]
    unstretched_length: Float[Array, ""]  # [m]
    unstretched_speed: Float[Array, ""]  # V_ref [m/s]
    efficiency: Float[Array, ""]  # power delivered over power taken up; 0 without torques
    coordinates: Float[Array, " coordinates"]  # from the drawn positions [rad] or [m]
    model: CushionModel  # in the units of `scales`, along the belt's travel
    found: Found
    order: TravelOrder
    scales: Scales
    at_stop: Float[Array, " coordinates"]  # -1 at the least, 1 at the greatest coordinate, else 0
    torque_free: Bool[Array, ""]  # whether no accessory takes torque
    drive: Drive
    point: OperatingPoint
    error: Float[Array, ""]  # relative, of the arcs: collocation, or what thin layers leave out
    result: RESULTS
    method: Cushion | ThinCushion
    stats: dict[str, Array]

    def penetration(self, i: int, s: Array) -> Array:
        """Give of the cords towards the axis of pulley i [m], at shares s of the contact length."""
        return self._profile(i, s)[0]

    def shear(self, i: int, s: Array) -> Array:
        """Shear of the cushion on pulley i [m], at shares s of the contact length."""
        return self._profile(i, s)[1]

    def _profile(self, i: int, s: Array) -> tuple[Array, Array]:
        count = len(self.wraps)
        if not -count <= i < count:
            raise IndexError(f"pulley {i} of {count}: pulleys count from 0.")
        x, zeta = _profile(self.model, self.found, self.order.pulleys[i], jnp.asarray(s))
        return x * self.scales.length, zeta * self.scales.length


@boundary_jit
def _profile(model: CushionModel, found: Found, place: Array, s: Array) -> tuple[Array, Array]:
    pulls = cushion_drive.ends_of(found.root, model)
    arcs = found.arcs
    pull, of, arc = (jax.tree.map(lambda x: x[place], part) for part in (pulls, model.layers, arcs))
    lent = cushion.lent(pull, of)
    if arc is None:
        x, _, _, zeta = cushion.profile(pull, lent, s)
    else:
        flat = cushion_arc.profile(arc, lent, jnp.ravel(s))
        x, zeta = (jnp.reshape(part, s.shape) for part in flat)
    return of.soft * x, of.soft * zeta


def cushion_state(
    drive: Drive,
    point: OperatingPoint,
    method: Cushion | ThinCushion | None = None,
    *,
    throw: bool = True,
) -> CushionState:
    """The running belt whose cords ride on a cushion, as a string: Kong (2003), chapter 6, item 1.

    The cords give way radially and in shear, so that the belt meets a pulley at an angle, wraps
    more of it, and creeps by shear; docs/theory/cushion.md. `installation.tension` is the mean
    tension of the spans while the belt is turned slowly without torque, in the drawn layout.

    Args:
        drive: a drive of one belt, whose `cushion_radial` and `cushion_shear` are given.
        point: speeds and torques.
        method: `Cushion()`, the exact geometry by collocation, unless given; or `ThinCushion()`.
        throw: raise where the result is a failure.

    Returns:
        Angles, tensions, speeds, losses and hub loads, in SI units and listed order.

    Raises:
        KeyError: a torque is given for a pulley that is not there.
        ValueError: there are several belts, the belt has no cushion, or its installation is by a
            mark or an adjusted tensioner.
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley_cushion.toml")
        >>> state = bj.cushion_state(drive, point, bj.ThinCushion())
        >>> state.contact_angles, state.hub_loads  # [rad], [N]
    """
    method = Cushion() if method is None else method
    if not isinstance(method, Cushion | ThinCushion):
        raise ValueError(f"method: found {method!r}; give Cushion(elements) or ThinCushion().")
    _require_cushion(drive)
    found = _cushion_state(*canonical(drive, point), method)
    return raise_unless_successful(found, found.result, throw)


def _require_cushion(drive: Drive) -> None:
    if len(drive.belts) > 1:
        raise ValueError(
            f"belt: found {len(drive.belts)}; a cushion is modeled for a drive of one belt. "
            "Describe it without the others, with their torques on the pulleys that they share."
        )
    if drive.belt.cushion_radial is None:
        raise ValueError(
            "belt.cushion is missing; give cushion = { radial = .., shear = .. } in N/m^2."
        )
    if not isinstance(drive.installation, TensionGiven | BeltGiven | Preloaded):
        raise ValueError(
            f"installation: found {type(drive.installation).__name__}; on a cushion give the "
            "tension, or the belt_length with the springs' free positions."
        )
    if getattr(drive.installation, "span_tensions", None) is not None:
        raise ValueError(
            "installation.span_tensions: on a cushion the tensions follow from the torques; "
            "remove it, and keep tension."
        )


@boundary_jit
def _cushion_state(
    drive: Drive, point: OperatingPoint, method: Cushion | ThinCushion
) -> CushionState:
    asked = drive, point
    made, point, good, drawable = usable_assembly(drive, point)
    drive = made.drive
    if isinstance(drive.installation, Preloaded):
        made = belts_of_the_string(made)
    given, base = _given(made)
    groups, scales = contact_groups(made, point, made.driven.torques, base)
    model = _model(made, groups, scales)
    pure = given._replace(
        tension=given.tension / base,
        L0=given.L0 / scales.length,
        relaxed=given.relaxed * groups.units / scales.energy,
    )
    found, rested = _found(model, pure, method, isinstance(made.rule, TensionGiven))
    running = found.running
    critical = critical_speed(pure.tension, model.layers.EA[0], model.m0)
    slow = _given_speed(model) < critical
    moved = layout(drive, running.q * groups.units, throw=False)
    strain = jnp.max(cushion.strained(running.P, model.layers.EA[0], running.g)) - 1
    gross = jnp.any(found.gross)
    missing = first_failure(
        (~good, RESULTS.numbers_unusable),
        (~succeeded(drawable), drawable),
        (~jnp.all(cushion.bears(pure.tension, model.layers)), RESULTS.cushion_too_soft),
        (~found.converged & ~slow, RESULTS.beyond_critical_speed),
        (~found.converged & gross, RESULTS.gross_slip),
        (~(found.converged & rested), RESULTS.cushion_state_not_found),
    )
    result = first_failure(
        (~succeeded(missing), missing),
        (~succeeded(moved.result), moved.result),
        (strain > LARGEST_STRAIN, RESULTS.belt_overstretched),
        (jnp.any(running.met.length <= 0), RESULTS.wrap_vanished),
        (gross, RESULTS.gross_slip),
    )
    state = _state(asked, made, groups, scales, model, found, method, result)
    if not isinstance(made.rule, BeltGiven):
        state = differentiated_once(state)
    return frozen_where_failed(state, missing)


def _given(made: Assembly) -> tuple[Given, Float[Array, ""]]:
    """What belt and springs are given by while the drive runs [SI], and the unit of forces."""
    rule, still = made.rule, made.still
    one, zero = jnp.ones(()), jnp.zeros(())
    if isinstance(rule, TensionGiven):
        tension = jnp.reshape(rule.tension, ())
        return Given(zero, one, tension, one, still), tension
    assert isinstance(rule, BeltGiven)
    length = jnp.reshape(rule.belt_length, ())
    springs = held(made, length[None], free_positions(made, rule))
    # The tension by which the belt would fill the drawn path is a scale, and where to begin.
    strain = made.drawn.path_length / length - 1
    tension = jax.lax.stop_gradient(made.EA[0] * jnp.clip(strain, 1e-4, LARGEST_STRAIN))
    return Given(zero, one, tension, length, springs.relaxed), tension


def _model(made: Assembly, groups: ContactGroups, scales: Scales) -> CushionModel:
    """The drive in pure numbers, along the travel."""
    drive = made.drive
    order = TravelOrder.of(made.loops, made.driven.travel).pulleys
    belt, count = drive.belt, len(drive.pulleys)
    unit = scales.length**2 / scales.tension
    assert belt.cushion_radial is not None  # as `_require_cushion` holds
    assert belt.cushion_shear is not None
    soft = jax.lax.stop_gradient(jnp.stack([p.cushion for p in drive.pulleys]))[order]
    sticks = np.array([float(pulley.friction is None) for pulley in drive.pulleys])
    layers = Layer(
        R=jnp.abs(groups.radii),
        k_r=jnp.broadcast_to(belt.cushion_radial * unit, (count,)),
        k_s=jnp.broadcast_to(belt.cushion_shear * unit, (count,)),
        mu=groups.friction,
        soft=soft,
        sticks=jnp.asarray(sticks)[order],
        EA=jnp.broadcast_to(groups.stretches[0], (count,)),
        blur=jnp.full(count, cushion_drive.SHARP),
    )
    return CushionModel(
        frame=frame_of(groups),
        layers=layers,
        driving=jax.lax.stop_gradient(groups.driving),
        pull=groups.pulls,
        m0=groups.masses[0],
        c=groups.belt_speed,
        v=groups.driver_speed,
        G=groups.mass_flow,
    )


def _given_speed(model: CushionModel) -> Float[Array, ""]:
    """Speed of the belt, but for the little by which it creeps."""
    speed = model.v if model.c is None else model.c
    assert speed is not None
    if model.G is None:
        return jnp.abs(speed)
    return jnp.sqrt(jnp.abs(model.G * speed) / model.m0)  # of a belt with this momentum


def _found(
    model: CushionModel, run: Given, method: Cushion | ThinCushion, at_rest: bool
) -> tuple[Found, Bool[Array, ""]]:
    """The running drive, and whether the drive at rest that gives its belt was found."""
    guess = cushion_drive.start(model, run.tension)

    def one(task: Given, begin: Array) -> Found:
        thin = cushion_drive.solve_thin(model, task, begin)
        if isinstance(method, ThinCushion):
            return thin
        exact = cushion_drive.solve_exact(model, task, thin.root, method.elements)
        gross = jnp.where(exact.converged, exact.gross, thin.gross)
        return exact._replace(converged=exact.converged & thin.converged, gross=gross)

    def stage(before: tuple[Array, Array, Array], task: Given) -> tuple[Any, Found]:
        length, relaxed, begin = before
        first = task.by_tension > 0
        task = task._replace(
            L0=jnp.where(first, task.L0, length),
            relaxed=jnp.where(first, task.relaxed, relaxed),
        )
        found = one(task, begin)
        return (found.running.L0, found.running.relaxed, jax.lax.stop_gradient(found.root)), found

    if not at_rest:
        return one(run, guess), jnp.array(True)
    # Both tasks use one compiled search in turn: the first finds the belt for the second.
    rest = run._replace(by_tension=jnp.ones(()), load=jnp.zeros(()))
    tasks = jax.tree.map(lambda a, b: jnp.stack([a, b]), rest, run)
    begin = in_lanes_of(run.tension, (run.L0, run.relaxed, guess))
    _, both = jax.lax.scan(stage, begin, tasks)
    rested, running = (jax.tree.map(lambda x, k=k: x[k], both) for k in (0, 1))
    return running, rested.converged


def _coupling(
    running: Running, model: CushionModel, EI: Float[Array, ""]
) -> Float[Array, " spans"]:
    """Gamma_i of the spans, whose ends are bent as far as the cushion lets them."""
    P, length, layers = running.P, running.spans.lengths, model.layers
    following = model.frame.loops.following

    def bent(soft: Array, k_r: Array, R: Array) -> Array:
        ratio = jnp.where(soft > 0, cushion.end_curvature(P, EI, k_r), 1.0)
        return length * ratio / R

    side = jnp.sign(model.frame.rho)
    start = side * bent(layers.soft, layers.k_r, layers.R)
    end = following(side) * bent(*(following(x) for x in (layers.soft, layers.k_r, layers.R)))
    positive = EI > 0
    eps = jnp.where(positive, jnp.sqrt(jnp.where(positive, EI, 1.0)), 0.0)
    return span.bending(start, end, span.layers(*span.layer_width(eps, length, P)))


def _state(
    asked: tuple[Drive, OperatingPoint],
    made: Assembly,
    groups: ContactGroups,
    scales: Scales,
    model: CushionModel,
    found: Found,
    method: Cushion | ThinCushion,
    result: RESULTS,
) -> CushionState:
    """The solution in SI and listed order."""
    running = found.running
    met, spans = running.met, running.spans
    order = TravelOrder.of(made.loops, jax.lax.stop_gradient(made.driven.travel))
    force, length = scales.tension, scales.length
    speed = length / scales.time
    preceding = model.frame.loops.preceding
    P, P_in, EA, g = running.P, preceding(running.P), model.layers.EA[0], running.g
    tension = EA * (cushion.strained(P, EA, g) - 1)
    omega = met.om * running.V_ref / model.layers.R
    # Work of the tension, int V dP, less the power that the pulley takes.
    work = running.V_ref * ((EA + P) ** 2 - (EA + P_in) ** 2) / (2 * (EA - g))
    losses = work - omega * running.M
    pulled = jnp.stack([spans.along_x, spans.along_y], axis=1) * P[:, None]
    driven = jnp.where(model.driving > 0, 0.0, omega * running.M)
    drawn_in = jnp.abs(jnp.sum(model.driving * omega * running.M))
    taken, free = jnp.sum(driven), jnp.all(made.driven.torques == 0)
    pulleys = order.pulleys
    return CushionState(
        wraps=cushion_drive.wraps(running)[pulleys],
        slips=met.sliding[pulleys],
        moments=running.M[pulleys] * force * length,
        pulley_speeds=omega[pulleys] / scales.time,
        losses=losses[pulleys] * force * speed,
        contact_angles=jnp.stack([met.chi_in, met.chi_out], axis=1)[pulleys],
        contact_lengths=met.length[pulleys] * length,
        penetrations=met.deepest[pulleys] * length,
        shears=met.zeta_out[pulleys] * length,
        hub_loads=(pulled - preceding(pulled))[pulleys] * force,
        effective_tensions=P[order.spans] * force,
        tensions=tension[order.spans] * force,
        span_lengths=spans.lengths[order.spans] * length,
        span_angles=jnp.arctan2(spans.along_y, spans.along_x)[order.spans],
        coupling=_coupling(running, model, groups.bendings[0])[order.spans],
        turns=spans.turns[pulleys],
        unstretched_length=running.L0 * length,
        unstretched_speed=running.V_ref * speed,
        efficiency=jnp.where(free, 0.0, taken / jnp.where(free, 1.0, drawn_in)),
        coordinates=running.q * groups.units,
        model=model,
        found=found,
        order=order,
        scales=scales,
        at_stop=holding_stop(model.frame.bodies, running.q, running.force),
        torque_free=free,
        drive=asked[0],
        point=asked[1],
        error=found.error,
        result=result,
        method=method,
        stats={"steps": found.steps},
    )
