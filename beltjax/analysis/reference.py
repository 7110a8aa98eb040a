"""Reference state: the belt at rest as a string, steady torques applied (MODEL.md, section 0)."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from beltjax.drive.components import BeltGiven, Drive, OperatingPoint, TensionGiven
from beltjax.drive.layout import Layout, layout
from beltjax.numerics.roots import pair_root
from beltjax.results import RESULTS, first_failure, raise_unless_successful, succeeded

LARGEST_STRAIN = 0.1  # beyond this a belt is not stretched but broken
LARGEST_TURN = 0.2  # of the arm, in one Newton step [rad]


class ReferenceState(eqx.Module):
    """String tensions and arm angle at rest, with the torques of the operating point."""

    layout: Layout  # with the arm where the torques hold it
    tensions: Float[Array, " spans"]  # P_i [N]
    base_tension: Float[Array, ""]  # P0, the tension without torques [N]
    arm_angle: Float[Array, ""] | None  # direction of the arm [rad]
    free_angle: Float[Array, ""] | None  # its direction with the spring relaxed [rad]
    unstretched_length: Float[Array, ""]  # L0 [m]
    error: Float[Array, ""]  # residual of the arm's and the belt's equations, relative
    result: RESULTS
    stats: dict[str, Array]


class _Held(NamedTuple):
    """What an installation holds: the belt, and where the arm's spring is relaxed."""

    length: Float[Array, ""]  # L0 [m]
    wind_up: Float[Array, ""]  # drawn arm angle less free angle [rad]


class _Level(NamedTuple):
    """A solved level of the belt: the arm's turn from the drawing and a reference tension."""

    turn: Float[Array, ""]
    tension: Float[Array, ""]
    converged: Bool[Array, ""]
    steps: Array


@eqx.filter_jit
def reference_state(drive: Drive, point: OperatingPoint, *, throw: bool = True) -> ReferenceState:
    """Tensions, arm angle and belt length of the drive at rest under its torques.

    Under `TensionGiven` the drawn layout is the torque-free state; under `BeltGiven` the
    unstretched belt and the arm's free angle are held. Solves MODEL.md, section 0, (a)-(c).

    Fails with the layout's results, `belt_does_not_fit`, `belt_too_long`, `belt_too_short`
    (strain above a tenth), `arm_at_stop` or `span_slack`; failed lanes of a batch hold
    finite placeholders with zero derivatives.
    """
    drawn = layout(drive)
    rule = drive.installation
    if isinstance(rule, TensionGiven) and rule.span_tensions is not None:
        state = _printed_state(drive, drawn, rule.tension, rule.span_tensions)
    else:
        state = _solved_state(drive, point, drawn)
    return raise_unless_successful(state, state.result, throw)


def _printed_state(drive, drawn, tension, tensions) -> ReferenceState:
    """The drawn layout with every tension named; torques are not used."""
    held = _held_by_tensions(drive, drawn, tensions)
    result = first_failure(
        (~succeeded(drawn.result), drawn.result),
        (jnp.any(tensions <= 0), RESULTS.span_slack),
    )
    tensions = jnp.where(succeeded(result), tensions, tension)
    exact = jnp.zeros(())
    return _state(drive, drawn, tensions, tension, held, exact, result, {"steps": jnp.array(0)})


def _solved_state(drive, point, drawn) -> ReferenceState:
    rule = drive.installation
    offsets = _tension_offsets(drive, point)
    if isinstance(rule, TensionGiven):
        base = rule.tension
        held = _held_by_tensions(drive, drawn, jnp.full_like(offsets, base))
        unloaded = _Level(jnp.zeros(()), base, jnp.array(True), jnp.array(0))
    else:
        held = _held_by_belt(drive, drawn, rule)
        unloaded = _level(drive, held, jnp.zeros_like(offsets), _guess(drive, drawn, held), drawn)
        base = unloaded.tension
    # A lane whose belt does not fit is carried on with one that does, for finite numbers.
    fits = succeeded(drawn.result) & unloaded.converged
    fits = fits & (base > 0) & (base <= LARGEST_STRAIN * drive.belt.axial_stiffness)
    base = jnp.where(fits, base, 1e-3 * drive.belt.axial_stiffness)
    spare = _held_by_tensions(drive, drawn, jnp.full_like(offsets, base))
    held = jax.tree.map(lambda a, b: jnp.where(fits, a, jax.lax.stop_gradient(b)), held, spare)
    offsets = jnp.where(fits, offsets, 0.0)
    start = (jnp.where(fits, unloaded.turn, 0.0), base)
    loaded = _level(drive, held, offsets, start, drawn)

    moved = layout(drive, loaded.turn)
    tensions = loaded.tension + offsets
    result = first_failure(
        (~succeeded(drawn.result), drawn.result),
        (~unloaded.converged, RESULTS.belt_does_not_fit),
        (unloaded.tension <= 0, RESULTS.belt_too_long),
        (~fits, RESULTS.belt_too_short),
        (~loaded.converged, RESULTS.belt_does_not_fit),
        (~succeeded(moved.result), moved.result),
        (jnp.any(tensions <= 0), RESULTS.span_slack),
        (_beyond_stops(drive, drawn, loaded.turn), RESULTS.arm_at_stop),
    )
    good = succeeded(result)
    tensions = jnp.where(good, tensions, base)
    error = jnp.max(jnp.abs(_residuals(drive, held, offsets, base, loaded.turn, loaded.tension)))
    stats = {"steps": loaded.steps}
    return _state(drive, moved, tensions, base, held, jax.lax.stop_gradient(error), result, stats)


def _state(drive, at, tensions, base, held, error, result, stats) -> ReferenceState:
    arm = drive.arm
    drawn_angle = jnp.arctan2(arm[1], arm[0])
    locked = drive.tensioner is None
    return ReferenceState(
        layout=at,
        tensions=tensions,
        base_tension=base,
        arm_angle=None if locked else at.arm_angle,
        free_angle=None if locked else drawn_angle - held.wind_up,
        unstretched_length=held.length,
        error=error,
        result=result,
        stats=stats,
    )


def _tension_offsets(drive: Drive, point: OperatingPoint) -> Float[Array, " spans"]:
    """Tension of each span above that at the tensioner's pulley, which is an idler (b).

    In the direction of travel the span that leaves an accessory carries M/r more. Without a
    tensioner the first span is the reference.
    """
    travel = jax.lax.stop_gradient(point.travel)
    steps = travel * point.torques(drive) / drive.radii  # P_i - P_{i-1} at pulley i
    offsets = jnp.cumsum(steps)
    return offsets - drive.carried @ offsets


def _arc_tensions(tensions: Float[Array, " spans"]) -> Float[Array, " pulleys"]:
    """Mean of the adjacent spans' tensions on each pulley's arc, an assumption of (c)."""
    return (tensions + jnp.roll(tensions, 1)) / 2


def _unstretched(drive: Drive, at: Layout, tensions) -> Float[Array, ""]:
    """Unstretched length of the belt on this layout at these tensions (c)."""
    EA = drive.belt.axial_stiffness
    spans = at.span_lengths / (1 + tensions / EA)
    return jnp.sum(spans) + jnp.sum(at.arc_lengths / (1 + _arc_tensions(tensions) / EA))


def _belt_moment(at: Layout, tensions) -> Float[Array, ""]:
    """Moment by which the belt resists the arm: sum of P_i dl_i/d(alpha) [N m]."""
    return at.arm_length * jnp.sum(tensions * at.arm_tangent)


def _held_by_tensions(drive: Drive, drawn: Layout, tensions) -> _Held:
    """Belt and spring for which the drawn layout is at rest with these tensions."""
    wind_up = jnp.zeros(())
    if drive.tensioner is not None:
        wind_up = -_belt_moment(drawn, tensions) / drive.tensioner.stiffness
    return _Held(_unstretched(drive, drawn, tensions), wind_up)


def _held_by_belt(drive: Drive, drawn: Layout, rule: BeltGiven) -> _Held:
    wind_up = jnp.zeros(())
    if rule.free_angle is not None:
        difference = drawn.arm_angle - rule.free_angle
        # The arm may be drawn beyond +-180 degrees of its free angle's branch.
        wind_up = difference - 2 * jnp.pi * jax.lax.stop_gradient(
            jnp.round(difference / (2 * jnp.pi))
        )
    return _Held(rule.belt_length, wind_up)


def _guess(drive: Drive, drawn: Layout, held: _Held):
    """Arm as drawn, and a belt strained by a few thousandths."""
    return jnp.zeros(()), 2.5e-3 * drive.belt.axial_stiffness


def _residuals(drive, held, offsets, base, turn, tension) -> Float[Array, "2"]:
    """(a) over P0 r_t, and (c) over the mean span, at an arm turned by `turn`."""
    at = layout(drive, turn)
    tensions = tension + offsets
    mean_span = jnp.mean(at.span_lengths)
    belt = (_unstretched(drive, at, tensions) - held.length) / mean_span
    if drive.tensioner is None:
        return jnp.stack([turn, belt])
    spring = drive.tensioner.stiffness * (held.wind_up + turn)
    moment = (_belt_moment(at, tensions) + spring) / (base * at.arm_length)
    return jnp.stack([moment, belt])


def _level(drive, held, offsets, start, drawn) -> _Level:
    """Arm angle and tension level of (a) and (c), by Newton's method from `start`."""
    scale = jax.lax.stop_gradient(start[1])

    def residual(unknown):
        turn, level = unknown
        return _residuals(drive, held, offsets, scale, turn, level * scale)

    largest = jnp.array([LARGEST_TURN, 20.0])
    root = pair_root(residual, jnp.stack([start[0], start[1] / scale]), largest)
    converged = root.converged & jnp.all(jnp.isfinite(root.value))
    turn, level = jnp.where(converged, root.value, jnp.stack([0.0 * start[0], jnp.ones(())]))
    return _Level(turn, level * scale, converged, root.steps)


def _beyond_stops(drive: Drive, drawn: Layout, turn) -> Bool[Array, ""]:
    if drive.tensioner is None or drive.tensioner.stops is None:
        return jnp.array(False)
    least, greatest = drive.tensioner.stops
    angle = drawn.arm_angle + turn
    # Compare on the branch on which the stops are given.
    middle = (least + greatest) / 2
    angle = angle - 2 * jnp.pi * jnp.round((angle - middle) / (2 * jnp.pi))
    return (angle < least) | (angle > greatest)
