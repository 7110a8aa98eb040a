"""The search for a belt in grooves: at rest, running, and at the limit of adhesion."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from beltjax.analysis.groove_methods import Groove, ThinGroove
from beltjax.analysis.installed import free_positions, held
from beltjax.analysis.reference import resting
from beltjax.analysis.string_belts import frame_of
from beltjax.compiling.batched_loops import in_lanes_of
from beltjax.drive.assembly import Assembly
from beltjax.drive.contact_groups import ContactGroups, TravelOrder
from beltjax.drive.groups import Scales
from beltjax.drive.installation import BeltGiven, TensionGiven
from beltjax.physics import groove_drive as physics
from beltjax.physics.contact import BeltMotion
from beltjax.physics.groove import Flanks
from beltjax.physics.groove_thin_drive import SolvedThinGrooves, solve_thin
from beltjax.physics.inclined_spans import inclined_spans
from beltjax.results import succeeded

HALVINGS = 8  # of the search for the limit of adhesion, before its secants


def slip_velocity(method: Groove | ThinGroove) -> Float[Array, ""]:
    """Sliding speed, over V_ref, below which friction is viscous; 0 where it never is."""
    return method.slip_velocity if isinstance(method, Groove) else jnp.zeros(())


class GrooveStart(NamedTuple):
    """What the installation gives, and where a search begins."""

    tension: Float[Array, ""]  # [N]
    coordinates: Float[Array, " coordinates"]  # from the drawn positions [rad] or [m]
    length: Float[Array, ""]  # of the unstretched belt [m]; 1 where the tension gives it
    relaxed: Float[Array, " coordinates"]  # force of the springs at the drawn positions


def groove_start(made: Assembly) -> GrooveStart:
    """What the installation gives, and where a search begins."""
    rule, still = made.rule, made.still
    if isinstance(rule, TensionGiven):
        return GrooveStart(rule.tension, still, jnp.ones(()), still)
    assert isinstance(rule, BeltGiven)  # as `unmet_groove` holds
    string, fixed = resting(made), jax.lax.stop_gradient
    rested = succeeded(string.result)
    nominal = 0.01 * made.EA[0]
    tension = fixed(jnp.where(rested, string.base_tensions[0], nominal))
    at = fixed(jnp.where(rested, string.coordinates, 0.0))
    lengths = jnp.broadcast_to(rule.belt_length, (1,))
    springs_of = held(made, lengths, free_positions(made, rule))
    return GrooveStart(tension, at, lengths[0], springs_of.relaxed)


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
    eps = slip_velocity(method)
    assert belt.wedge_stiffness is not None  # as `unmet_groove` holds
    K = jnp.where(fit, belt.wedge_stiffness * scales.length**2 / scales.tension, 50 / R**2)
    whole = Flanks(R, beta, groups.friction, K, *(jnp.broadcast_to(x, R.shape) for x in (EA, eps)))
    nominal, _ = physics.flat_groove(jax.lax.stop_gradient(R), one, jax.lax.stop_gradient(EA), eps)
    nominal = jax.lax.stop_gradient(nominal)
    grooves = jax.tree.map(lambda a, b: jnp.where(flat > 0, a, b), nominal, whole)
    motion = BeltMotion(groups.masses, groups.belt_speed, groups.driver_speed, groups.mass_flow)
    return physics.GrooveModel(
        frame=frame_of(groups),
        grooves=grooves,
        flat=flat,
        mu=groups.friction,
        EA=EA,
        pull=groups.pulls,
        driving=groups.driving,
        loaded=jax.lax.stop_gradient((groups.pulls != 0).astype(float)),
        motion=motion,
    )


def groove_solutions(
    made: Assembly,
    groups: ContactGroups,
    scales: Scales,
    model: physics.GrooveModel,
    method: Groove | ThinGroove,
    start: GrooveStart,
    asked: tuple[Float[Array, ""], Float[Array, ""], int],
) -> tuple[Bool[Array, ""], physics.SolvedGrooves | SolvedThinGrooves]:
    """Whether the belt rests, and the running belt."""
    limit, slip, rounds = asked
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
