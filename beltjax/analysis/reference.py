"""Reference state: the belt at rest as a string, steady torques applied.

docs/theory/reference_state.md, (R1) to (R5).
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from beltjax.compiling.quick import boundary_jit
from beltjax.drive.canonical import canonical
from beltjax.drive.components import BeltGiven, Drive, OperatingPoint, TensionGiven
from beltjax.drive.layout import Layout, Outline, Path, belt_path, layout, outline
from beltjax.drive.readable import Readable
from beltjax.drive.usable import harmless, usable
from beltjax.numerics.roots import Search, implicit_root, system_root
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
    succeeded,
)

LARGEST_STRAIN = 0.1  # beyond this a belt is not stretched but broken
LARGEST_TURN = 0.2  # of the arm, in one Newton step [rad]


class ReferenceState(Readable):
    """String tensions and arm angle at rest, with the torques of the operating point."""

    layout: Layout  # with the arm where the torques hold it
    tensions: Float[Array, " spans"]  # P_i [N]
    base_tension: Float[Array, ""]  # P0, the tension without torques [N]
    arm_angle: Float[Array, ""] | None  # direction of the arm [rad], counted on from the drawn one
    free_angle: Float[Array, ""] | None  # with the spring relaxed [rad], whole turns included
    unstretched_length: Float[Array, ""]  # L0 [m]
    error: Float[Array, ""]  # residual, relative, before the last Newton step: an upper bound
    result: RESULTS
    stats: dict[str, Array]


class Held(NamedTuple):
    """What an installation holds: the belt, and where the arm's spring is relaxed."""

    length: Float[Array, ""]  # L0 [m]
    wind_up: Float[Array, ""]  # drawn arm angle less free angle [rad]


class _Problem(NamedTuple):
    """Equations (R1) and (R3), whose unknowns are the arm's turn and a tension over `scale`."""

    outline: Outline
    held: Held
    offsets: Float[Array, " spans"]  # of the span tensions above the unknown one [N]
    scale: Float[Array, ""]  # [N]
    EA: Float[Array, ""]
    stiffness: Float[Array, ""]  # of the arm's spring [N m/rad]; 1 where there is no arm


def reference_state(drive: Drive, point: OperatingPoint, *, throw: bool = True) -> ReferenceState:
    """Tensions, arm angle and belt length of the drive at rest under its torques.

    Under `TensionGiven` the drawn layout is the torque-free state; under `BeltGiven` the
    unstretched belt and the arm's free angle are held. Solves docs/theory/reference_state.md,
    (R1) to (R3).

    Fails with `numbers_unusable`, the layout's results, `belt_does_not_fit`, `belt_too_long`,
    `belt_too_short` (strain above a tenth), `arm_at_stop` or `span_slack`. Failed lanes of a
    batch hold finite numbers, the state's own where it was found (`span_slack`, `arm_at_stop`)
    and placeholders elsewhere, with zero derivatives.
    """
    state = _reference_state(*canonical(drive, point))
    return raise_unless_successful(state, state.result, throw)


@boundary_jit
def _reference_state(drive: Drive, point: OperatingPoint) -> ReferenceState:
    good = usable(drive, point)
    state = resting(*harmless(drive, point, good))
    result = first_failure((~good, RESULTS.numbers_unusable), (good, state.result))
    return frozen_where_failed(eqx.tree_at(lambda s: s.result, state, result), result)


def resting(drive: Drive, point: OperatingPoint) -> ReferenceState:
    """`reference_state` of numbers that are usable, derivatives of failed lanes not yet barred."""
    drawn = layout(drive, throw=False)
    rule = drive.installation
    if isinstance(rule, TensionGiven) and rule.span_tensions is not None:
        return _printed_state(drive, drawn, rule.tension, rule.span_tensions)
    return _solved_state(drive, point, drawn)


def _printed_state(drive, drawn, tension, tensions) -> ReferenceState:
    """The drawn layout with every tension named; torques are not used."""
    held = _held_by_tensions(drive, drawn, tensions)
    result = first_failure(
        (~succeeded(drawn.result), drawn.result),
        (jnp.any(tensions <= 0), RESULTS.span_slack),
        (beyond_stops(drive, drawn.arm_angle), RESULTS.arm_at_stop),
    )
    exact = jnp.zeros(())
    return _state(
        drive, drawn, exact, tensions, tension, held, exact, result, {"steps": jnp.array(0)}
    )


def _solved_state(drive, point, drawn) -> ReferenceState:
    rule = drive.installation
    offsets = _tension_offsets(drive, point)
    if isinstance(rule, TensionGiven):
        held = held_by_tension(drive, drawn, rule.tension)
        base, turn, fits = rule.tension, jnp.zeros(()), succeeded(drawn.result)
        bare = RESULTS.where(fits, RESULTS.successful, drawn.result)
    else:
        held = held_by_belt(drawn, rule)
        unloaded = _problem(drive, held, jnp.zeros_like(offsets), _likely_tension(drive))
        base, turn, bare = _bare_state(drive, unloaded, drawn)
        fits = succeeded(bare)
        held = _replaced(fits, held, held_by_tension(drive, drawn, base))

    problem = _problem(drive, held, jnp.where(fits, offsets, 0.0), base)
    found = _search(problem, turn)
    good = fits & found.converged
    spare = held_by_tension(drive, drawn, base)
    problem = problem._replace(
        held=_replaced(good, held, spare), offsets=jnp.where(good, offsets, 0.0)
    )
    turn, level = _root(problem, good, found)
    moved = layout(drive, turn, throw=False)
    tensions = level + problem.offsets
    result = first_failure(
        (~fits, bare),
        (~found.converged, RESULTS.belt_does_not_fit),
        (~succeeded(moved.result), moved.result),
        (jnp.any(tensions <= 0), RESULTS.span_slack),
        (beyond_stops(drive, drawn.arm_angle + turn), RESULTS.arm_at_stop),
    )
    error = jnp.max(jnp.abs(found.residual))
    stats = {"steps": found.steps}
    return _state(drive, moved, turn, tensions, base, problem.held, error, result, stats)


def _problem(drive: Drive, held: Held, offsets, scale) -> _Problem:
    stiffness = jnp.ones(()) if drive.tensioner is None else drive.tensioner.stiffness
    return _Problem(outline(drive), held, offsets, scale, drive.belt.axial_stiffness, stiffness)


def _bare_state(drive: Drive, problem: _Problem, drawn: Layout):
    """Tension and arm's turn of a given belt without torques, and whether it fits.

    Where it does not, the tension is a harmless positive number without derivative.
    """
    found = _search(problem, jnp.zeros(()))
    turn, level = found.root
    tension = level * problem.scale
    strain = tension / problem.EA
    result = first_failure(
        (~succeeded(drawn.result), drawn.result),
        (~found.converged, RESULTS.belt_does_not_fit),
        (tension <= 0, RESULTS.belt_too_long),
        (strain > LARGEST_STRAIN, RESULTS.belt_too_short),
    )
    fits = jax.lax.stop_gradient(succeeded(result))
    spare = _held_by_tensions(drive, drawn, problem.offsets + problem.scale)
    turn, tension = _root(problem._replace(held=_replaced(fits, problem.held, spare)), fits, found)
    return tension, turn, result


def _replaced(good, held: Held, spare: Held) -> Held:
    """`held` where it is good; elsewhere `spare`, without derivatives."""
    return jax.tree.map(lambda a, b: jnp.where(good, a, jax.lax.stop_gradient(b)), held, spare)


def _state(drive, at, turn, tensions, base, held, error, result, stats) -> ReferenceState:
    arm = drive.arm
    drawn_angle = jnp.arctan2(arm[1], arm[0])
    locked = drive.tensioner is None
    return ReferenceState(
        layout=at,
        tensions=tensions,
        base_tension=base,
        arm_angle=None if locked else drawn_angle + turn,
        free_angle=None if locked else drawn_angle - held.wind_up,
        unstretched_length=held.length,
        error=error,
        result=result,
        stats=stats,
    )


def _tension_offsets(drive: Drive, point: OperatingPoint) -> Float[Array, " spans"]:
    """Tension of each span above that at the tensioner's pulley, which is an idler (R2).

    In the direction of travel the span that leaves an accessory carries M/r more. Without a
    tensioner the first span is the reference.
    """
    travel = jax.lax.stop_gradient(point.travel)
    steps = travel * point.torques(drive) / drive.radii  # P_i - P_{i-1} at pulley i
    offsets = jnp.cumsum(steps)
    return offsets - drive.carried @ offsets


def _arc_tensions(tensions: Float[Array, " spans"]) -> Float[Array, " pulleys"]:
    """Mean of the adjacent spans' tensions on each pulley's arc, an assumption of (R3)."""
    return (tensions + jnp.roll(tensions, 1)) / 2


def _unstretched(EA, at: Layout | Path, tensions) -> Float[Array, ""]:
    """Unstretched length of the belt on this path at these tensions (R3)."""
    spans = at.span_lengths / (1 + tensions / EA)
    return jnp.sum(spans) + jnp.sum(at.arc_lengths / (1 + _arc_tensions(tensions) / EA))


def _belt_moment(at: Layout | Path, tensions) -> Float[Array, ""]:
    """Moment by which the belt resists the arm: sum of P_i dl_i/d(alpha) [N m]."""
    return at.arm_length * jnp.sum(tensions * at.arm_tangent)


def _held_by_tensions(drive: Drive, drawn: Layout, tensions) -> Held:
    """Belt and spring for which the drawn layout is at rest with these tensions."""
    wind_up = jnp.zeros(())
    if drive.tensioner is not None:
        wind_up = -_belt_moment(drawn, tensions) / drive.tensioner.stiffness
    return Held(_unstretched(drive.belt.axial_stiffness, drawn, tensions), wind_up)


def held_by_tension(drive: Drive, drawn: Layout, tension: Float[Array, ""]) -> Held:
    """Belt and spring for which the drawn layout is at rest with this tension in every span."""
    return _held_by_tensions(drive, drawn, jnp.full_like(drawn.span_lengths, tension))


def held_by_belt(drawn: Layout, rule: BeltGiven) -> Held:
    """The belt of the rule, and how far the drawn arm winds its spring up."""
    wind_up = jnp.zeros(())
    if rule.free_angle is not None:
        # As it stands, whole turns included: a soft spring is wound by more than half a turn.
        wind_up = drawn.arm_angle - rule.free_angle
    return Held(rule.belt_length, wind_up)


def _likely_tension(drive: Drive) -> Float[Array, ""]:
    """Tension of a belt strained by a few thousandths, a first guess."""
    return 2.5e-3 * jax.lax.stop_gradient(drive.belt.axial_stiffness)


def _residuals(unknown: Float[Array, "2"], problem: _Problem) -> Float[Array, "2"]:
    """(R1) over a tension and the arm, and (R3) over the mean span."""
    turn, level = unknown
    at = belt_path(problem.outline, turn)
    tensions = level * problem.scale + problem.offsets
    length = _unstretched(problem.EA, at, tensions) - problem.held.length
    # Without an arm the belt has no moment on it, and a spring alone holds it where it is.
    moment = _belt_moment(at, tensions) + problem.stiffness * (problem.held.wind_up + turn)
    return jnp.stack([moment / (problem.scale * at.arm_length), length / jnp.mean(at.span_lengths)])


def _search(problem: _Problem, turn: Float[Array, ""]) -> Search:
    """Arm's turn and tension level by Newton's method from `turn` and the problem's scale."""
    fixed, turn = jax.lax.stop_gradient((problem, turn))
    # A slack or a tenfold tension may be passed on the way; the arm must not jump.
    largest = jnp.array([LARGEST_TURN, 20.0])
    guess = jnp.stack([turn, jnp.ones(())])
    found = system_root(lambda unknown: _residuals(unknown, fixed), guess, largest)
    return found._replace(converged=found.converged & jnp.all(jnp.isfinite(found.root)))


def _root(problem: _Problem, good: Bool[Array, ""], found: Search):
    """Turn and tension [N] with their derivatives; the drawn, torque-free state where not good."""
    root = jnp.where(good, found.root, jnp.array([0.0, 1.0]))
    turn, level = implicit_root(_residuals, problem, root)
    return turn, level * problem.scale


def beyond_stops(drive: Drive, angle: Float[Array, ""]) -> Bool[Array, ""]:
    """Whether the tensioner has stops and the arm, in this direction, would be past one."""
    if drive.tensioner is None or drive.tensioner.stops is None:
        return jnp.array(False)
    least, greatest = drive.tensioner.stops
    # Compare on the branch on which the stops are given.
    middle = (least + greatest) / 2
    angle = angle - 2 * jnp.pi * jnp.round((angle - middle) / (2 * jnp.pi))
    return (angle < least) | (angle > greatest)
