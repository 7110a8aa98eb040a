"""Reference state: the belts at rest as strings, with steady torques applied.

docs/theory/reference_state.md, (R1) to (R5), and docs/theory/bodies.md, (M5) and (M6).
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from beltjax.analysis.installed import (
    LARGEST_MOVE,
    Held,
    belt_pull,
    free_positions,
    held,
    held_by_tensions,
    installed_by_tension,
    search_units,
)
from beltjax.compiling.batched_loops import in_lanes_of
from beltjax.compiling.quick import boundary_jit
from beltjax.drive.assembly import Assembly, assembled
from beltjax.drive.canonical import canonical
from beltjax.drive.groups import ways
from beltjax.drive.installation import (
    AdjustedToMark,
    AdjustedToTension,
    Preloaded,
    TensionGiven,
)
from beltjax.drive.layout import Layout, Outline, Path, belt_path, unstretched_lengths
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.placeholders import harmless, numbers_are_usable
from beltjax.drive.readable import Readable
from beltjax.drive.system import Drive
from beltjax.numerics.definite import definite_solve
from beltjax.numerics.loops import Loops
from beltjax.numerics.rigid_bodies import OutsideForces, holding_stop
from beltjax.numerics.roots import implicit_root, system_root
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
    succeeded,
)

# Scales of the forces on bodies beside their distances to stops: with one of them Newton's method
# may turn in circles, holding and releasing a stop, and not with another.
_SCALES = (1.0, 10.0, 0.1, 0.01)
LARGEST_STRAIN = 0.1  # a belt breaks before it is stretched so far


class ReferenceState(Readable):
    """String tensions and coordinates at rest, with the torques of the operating point.

    Coordinates are counted from the drawn positions [rad] or [m].
    """

    layout: Layout  # with the bodies where the torques hold them
    tensions: Float[Array, " spans"]  # P_i [N]
    base_tensions: Float[Array, " belts"]  # P0 of each belt, the tension without torques [N]
    coordinates: Float[Array, " coordinates"]
    installed: Float[Array, " coordinates"]  # without torques
    free: Float[Array, " springs"]  # where each spring is relaxed
    at_stop: Float[Array, " coordinates"]  # -1 at the least, 1 at the greatest coordinate, else 0
    stop_reactions: Float[Array, " coordinates"]  # forces of those stops [N m] or [N]
    arm_angle: Float[Array, ""] | None  # direction of a single arm [rad], counted on from the drawn
    free_angle: Float[Array, ""] | None  # with its spring relaxed [rad], whole turns included
    unstretched_lengths: Float[Array, " belts"]  # L0 of each belt [m]
    torques: Float[Array, " pulleys"]  # taken from the belt [N m]
    error: Float[Array, ""]  # residual, relative, before the last Newton step: an upper bound
    result: RESULTS
    stats: dict[str, Array]

    @property
    def base_tension(self) -> Float[Array, ""]:
        """P0 of the first belt [N], the unit of tensions."""
        return self.base_tensions[0]

    @property
    def unstretched_length(self) -> Float[Array, ""]:
        """L0 of the belt, or the sum over all belts [m]."""
        return jnp.sum(self.unstretched_lengths)


class _Problem(NamedTuple):
    """Equations (M6) and (R3), whose unknowns are coordinates and belt tensions over `scale`."""

    outline: Outline
    held: Held
    offsets: Float[Array, " spans"]  # of the span tensions above the unknown ones [N]
    moments: Float[Array, " coordinates"]  # of accessories bolted to the bodies [N m]
    outside: OutsideForces
    scale: Float[Array, ""]  # [N]
    length: Float[Array, ""]  # [m]
    EA: Float[Array, " belts"]
    fixed: Float[Array, " coordinates"]  # 1 where `at` is given instead of a balance
    at: Float[Array, " coordinates"]
    # The row of a locked coordinate that is moved until another stands at `at` has a 1 in the
    # other's column and -1 in its own.
    marks: Float[Array, "coordinates coordinates"]
    flux: Float[Array, " spans"] | None = None  # m c^2 of a running belt [N]; None: at rest

    @property
    def units(self) -> Float[Array, " coordinates"]:
        """Units of the coordinates in the search."""
        return search_units(self.outline.bodies, self.length)


class _Standing(NamedTuple):
    """The drive at the solution of a problem."""

    layout: Layout
    tensions: Float[Array, " spans"]  # [N]
    momentum: Float[Array, " spans"] | float  # momentum flux of a running belt [N]
    at_stop: Float[Array, " coordinates"]
    stop_reactions: Float[Array, " coordinates"]


class RunningString(NamedTuple):
    """The belts running as strings, by exact statics."""

    layout: Layout
    tensions: Float[Array, " spans"]  # [N]
    flux: Float[Array, " spans"]  # momentum flux G V of the stretched belt [N]
    stop_reactions: Float[Array, " coordinates"]
    result: RESULTS


class _Rest(NamedTuple):
    """The end of a search for the bodies' rest."""

    root: Float[Array, " unknowns"]
    found: Bool[Array, ""]
    residual: Float[Array, ""]
    steps: Int[Array, ""]


def reference_state(drive: Drive, point: OperatingPoint, *, throw: bool = True) -> ReferenceState:
    """Tensions, coordinates and belt lengths of the drive at rest under its torques.

    Under `TensionGiven` the drawn layout is the torque-free state; under `BeltGiven` the
    unstretched belts and the springs' free positions are held; under `AdjustedToTension` and
    `AdjustedToMark` a locked tensioner is moved before. Bodies may come to rest at their stops.
    The equations are (R2) and (R3) of docs/theory/reference_state.md, with (M6) of
    docs/theory/bodies.md for the bodies.

    The result is a failure with `numbers_unusable`, the layout's results, `belt_does_not_fit`,
    `belt_too_long`, `belt_too_short` (strain above a tenth), `tensioner_unstable`, `span_slack` or,
    where every tension is given, `arm_at_stop`. With `throw=False` read `.result`: failed lanes of
    a batch hold finite numbers with zero derivatives, the state's own where it was found
    (`span_slack`) and placeholders elsewhere.

    Args:
        drive: the drive.
        point: the torques; its speeds do not matter at rest.
        throw: raise where the result is a failure.

    Returns:
        The state at rest, in SI units.

    Raises:
        KeyError: a torque is given for a pulley that is not there.
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> rest = bj.reference_state(drive, point)
        >>> rest.tensions, rest.unstretched_length  # [N], [m]
    """
    state = _reference_state(*canonical(drive, point))
    return raise_unless_successful(state, state.result, throw)


@boundary_jit
def _reference_state(drive: Drive, point: OperatingPoint) -> ReferenceState:
    good = numbers_are_usable(drive, point)
    state = resting(assembled(*harmless(drive, point, good)))
    result = first_failure((~good, RESULTS.numbers_unusable), (good, state.result))
    return frozen_where_failed(eqx.tree_at(lambda s: s.result, state, result), result)


def resting(made: Assembly) -> ReferenceState:
    """`reference_state` of usable numbers; failed lanes still carry derivatives."""
    rule = made.rule
    if isinstance(rule, TensionGiven) and rule.span_tensions is not None:
        return _printed_state(made, rule.tension, rule.span_tensions)
    return _solved_state(made)


def _printed_state(
    made: Assembly, tension: Float[Array, "*belts"], tensions: Float[Array, " spans"]
) -> ReferenceState:
    """The drawn layout with every tension given; torques are not used."""
    drawn, still, stops = made.drawn, made.still, made.bodies.stops
    holding = held_by_tensions(made, drawn, tensions, still)
    result = first_failure(
        (~succeeded(drawn.result), drawn.result),
        (jnp.any(tensions <= 0), RESULTS.span_slack),
        (jnp.any((stops[:, 0] > 0) | (stops[:, 1] < 0)), RESULTS.arm_at_stop),
    )
    base = jnp.broadcast_to(tension, made.EA.shape)
    rest = _Rest(still, jnp.array(True), jnp.zeros(()), jnp.array(0))
    stands = _Standing(drawn, tensions, 0.0, still, still)
    return _state(made, stands, base, still, holding, rest, result)


def _solved_state(made: Assembly) -> ReferenceState:
    """The state for which (M6) and (R3) are solved, first without torques and then with them."""
    loops, rule, drawn, still = made.loops, made.rule, made.drawn, made.still
    fits = succeeded(drawn.result)
    if isinstance(rule, TensionGiven | AdjustedToTension | Preloaded):
        place = installed_by_tension(made)
        base, at, holding = place.tensions, place.coordinates, place.held
        bare = first_failure((~fits, drawn.result), (~place.converged, RESULTS.belt_does_not_fit))
    else:
        lengths = jnp.broadcast_to(rule.belt_length, made.EA.shape)
        holding = held(made, lengths, free_positions(made, rule))
        base, at, holding, bare = _bare_state(made, holding)
    fits = succeeded(bare)
    scale = base[0]
    problem = _problem(made, holding, scale, at, jnp.where(fits, 1.0, 0.0))
    start = jnp.concatenate([at / problem.units, base / scale])
    rest = _search(problem, loops, start)
    good = fits & rest.found
    spare = held_by_tensions(made, drawn, loops.spread(base), still)
    problem = _harmless(problem, good, spare, still)
    unknown = _root(problem, loops, rest, good, jnp.concatenate([still, base / scale]))
    stands = _standing(made, problem, unknown, good)
    result = first_failure(
        (~fits, bare),
        (~rest.found, RESULTS.belt_does_not_fit),
        (~succeeded(stands.layout.result), stands.layout.result),
        (jnp.any(stands.tensions <= 0), RESULTS.span_slack),
        (~_is_stable(made, stands), RESULTS.tensioner_unstable),
    )
    return _state(made, stands, base, at, problem.held, rest, result)


def running_string(
    made: Assembly, rest: ReferenceState, flux: Float[Array, " spans"]
) -> RunningString:
    """The belts of a reference state running as strings, where m c^2 is `flux` [N]."""
    loops, rested, scale = made.loops, succeeded(rest.result), rest.base_tensions[0]
    holding = held(made, rest.unstretched_lengths, rest.free)
    # A pulley's torque changes what is left of the tension when the momentum flux is taken off,
    # of which the flux of a belt that stretches takes a part: docs/theory/bodies.md, (M11).
    offsets = made.offsets / (1 - flux / loops.spread(made.EA))
    # Bolted bodies stand where they were installed.
    problem = _problem(made, holding, scale, rest.installed)
    problem = problem._replace(offsets=offsets, flux=jnp.where(rested, flux, 0.0))
    levels = (rest.tensions - offsets)[loops.starts] / scale
    start = jnp.concatenate([rest.coordinates / problem.units, levels])
    found = _search(problem, loops, start)
    good = rested & found.found
    level = loops.spread(rest.base_tensions)
    spare = held_by_tensions(made, rest.layout, level, rest.coordinates)
    problem = _harmless(problem, good, spare, rest.coordinates)
    runs = _standing(made, problem, _root(problem, loops, found, good, start), good)
    result = first_failure(
        (~found.found, RESULTS.steady_state_not_found),
        (~succeeded(runs.layout.result), runs.layout.result),
        (jnp.any(runs.tensions <= runs.momentum), RESULTS.span_slack),
    )
    momentum = jnp.asarray(runs.momentum)
    return RunningString(runs.layout, runs.tensions, momentum, runs.stop_reactions, result)


def _standing(
    made: Assembly, problem: _Problem, unknown: Float[Array, " unknowns"], good: Bool[Array, ""]
) -> _Standing:
    """The drive at the root of a problem; stops hold nothing where that is not `good`."""
    count, loops = len(problem.fixed), made.loops
    place = unknown[:count] * problem.units
    at = made.layout(place)
    tensions = loops.spread(unknown[count:]) * problem.scale + problem.offsets
    momentum = _momentum(tensions, problem, loops)
    push = _push(at, place, tensions - momentum, problem)
    at_stop = jnp.where(good, holding_stop(made.bodies, place, -push), 0.0)
    return _Standing(at, tensions, momentum, at_stop, jnp.where(at_stop != 0, push, 0.0))


def _harmless(
    problem: _Problem, good: Bool[Array, ""], spare: Held, at: Float[Array, " coordinates"]
) -> _Problem:
    """`problem` where it is good; elsewhere one without loads, which `spare` and `at` solve."""
    loads = problem.offsets, problem.moments, problem.flux
    offsets, moments, flux = jax.tree.map(lambda load: jnp.where(good, load, 0.0), loads)
    held, at = _replaced(good, problem.held, spare), jnp.where(good, problem.at, at)
    return problem._replace(held=held, offsets=offsets, moments=moments, flux=flux, at=at)


def _problem(
    made: Assembly,
    held: Held,
    scale: Float[Array, ""],
    at: Float[Array, " coordinates"],
    load: Float[Array, ""] | float = 1.0,
) -> _Problem:
    """The problem of a drive under this part of its torques, locked bodies standing at `at`."""
    count = len(made.still)
    return _Problem(
        outline=made.outline,
        held=held,
        offsets=made.offsets * load,
        moments=made.moments * load,
        outside=made.outside,
        scale=scale,
        length=made.mean_length,
        EA=made.EA,
        fixed=made.bodies.locked,
        at=at,
        marks=jnp.zeros((count, count)),
    )


def _bare_state(
    made: Assembly, holding: Held
) -> tuple[Float[Array, " belts"], Float[Array, " coordinates"], Held, RESULTS]:
    """Tensions and coordinates of given belts without torques, and whether they fit.

    Where they do not fit, the tensions are harmless positive numbers without derivative.
    """
    rule, loops, drawn, still = made.rule, made.loops, made.drawn, made.still
    problem = _problem(made, holding, _likely_tension(made), still, 0.0)
    if isinstance(rule, AdjustedToMark):
        adjusted, marked = map(jax.lax.stop_gradient, (rule.adjusted, rule.marked))
        problem = problem._replace(
            marks=adjusted[:, None] * (marked - adjusted), at=problem.at + adjusted * rule.mark
        )
    count = len(still)
    start = jnp.concatenate([still, jnp.ones(len(loops.sizes))])
    rest = _search(problem, loops, start)
    tensions = rest.root[count:] * problem.scale
    result = first_failure(
        (~succeeded(drawn.result), drawn.result),
        (~rest.found, RESULTS.belt_does_not_fit),
        (jnp.any(tensions <= 0), RESULTS.belt_too_long),
        (jnp.any(tensions / problem.EA > LARGEST_STRAIN), RESULTS.belt_too_short),
    )
    fits = jax.lax.stop_gradient(succeeded(result))
    level = jnp.full(len(loops.sizes), problem.scale)
    spare = held_by_tensions(made, drawn, loops.spread(level), still)
    holding = _replaced(fits, problem.held, spare)
    safe = problem._replace(
        held=holding,
        at=jnp.where(fits, problem.at, 0.0),
        marks=jnp.where(fits, problem.marks, 0.0),
    )
    unknown = _root(safe, loops, rest, fits, jnp.concatenate([still, level / problem.scale]))
    at = unknown[:count] * problem.units
    return unknown[count:] * problem.scale, at, holding, result


def _replaced(good: Bool[Array, ""], held: Held, spare: Held) -> Held:
    """`held` where it is good; elsewhere `spare`, without derivatives."""
    return jax.tree.map(lambda a, b: jnp.where(good, a, jax.lax.stop_gradient(b)), held, spare)


def _state(
    made: Assembly,
    stands: _Standing,
    base: Float[Array, " belts"],
    installed: Float[Array, " coordinates"],
    holding: Held,
    rest: _Rest,
    result: RESULTS,
) -> ReferenceState:
    """The result object of a state, from its parts."""
    drawn, coordinates = made.drawn, stands.layout.coordinates
    single = len(coordinates) == 1
    return ReferenceState(
        layout=stands.layout,
        tensions=stands.tensions,
        base_tensions=base,
        coordinates=coordinates,
        installed=installed,
        free=holding.free,
        at_stop=stands.at_stop,
        stop_reactions=stands.stop_reactions,
        arm_angle=drawn.arm_angle + coordinates[0] if single else None,
        free_angle=drawn.arm_angle + holding.free[0] if single else None,
        unstretched_lengths=holding.lengths,
        torques=made.driven.torques,
        error=rest.residual,
        result=result,
        stats={"steps": rest.steps},
    )


def _likely_tension(made: Assembly) -> Float[Array, ""]:
    """Tension of a belt with a strain of a few thousandths, as a first guess."""
    return 2.5e-3 * jax.lax.stop_gradient(made.EA[0])


def _push(
    at: Layout | Path,
    coordinates: Float[Array, " coordinates"],
    tensions: Float[Array, " spans"],
    problem: _Problem,
) -> Float[Array, " coordinates"]:
    """Residual of (M6) on each body [N m] or [N], which is the force of a stop or a lock."""
    holding = problem.held
    springs_push = holding.stiffness @ coordinates - holding.relaxed
    given = problem.moments + problem.outside.push(problem.outline.bodies, coordinates)
    return belt_pull(at, tensions) + springs_push - given


def _residuals(
    unknown: Float[Array, " unknowns"],
    problem: _Problem,
    loops: Loops,
    scale: Float[Array, ""] | float = 1.0,
) -> Array:
    """Residuals of (M6) over a tension and a length, and of (R3) over the mean span.

    The forces of (M6) count by `scale`, which changes the way to the root, not the root.
    """
    count = len(problem.fixed)
    units = problem.units
    coordinates = unknown[:count] * units
    at = belt_path(problem.outline, loops, coordinates)
    tensions = loops.spread(unknown[count:]) * problem.scale + problem.offsets
    pulling = tensions - _momentum(tensions, problem, loops)
    length = unstretched_lengths(problem.EA, at, tensions, loops) - problem.held.lengths
    push = _push(at, coordinates, pulling, problem) * units / (problem.scale * problem.length)
    push = scale * push
    place = (coordinates + problem.marks @ coordinates - problem.at) / units
    # A body that the push would move beyond a stop stands at the stop. The residual is zero exactly
    # where the stop's force, which only pushes, balances the other forces.
    ends = ways(problem.outline.bodies.stops, jnp.zeros(count), units)
    wanted = jnp.clip(unknown[:count] - push, ends[:, 0], ends[:, 1])
    free = unknown[:count] - wanted
    balance = jnp.where(problem.fixed > 0, place, free)
    return jnp.concatenate([balance, length / problem.length])


def _momentum(
    tensions: Float[Array, " spans"], problem: _Problem, loops: Loops
) -> Float[Array, " spans"] | float:
    """Momentum flux G V of the belt [N], whose mass flow is that of the unstretched belt."""
    if problem.flux is None:
        return 0.0
    return problem.flux * (1 + tensions / loops.spread(problem.EA))


def _search(problem: _Problem, loops: Loops, start: Float[Array, " unknowns"]) -> _Rest:
    """Coordinates and tension levels by Newton's method, with stops counted."""
    problem, start = jax.lax.stop_gradient((problem, start))
    count = len(problem.fixed)
    # The search may pass through slack and tenfold tensions, but a body must not jump.
    largest = jnp.concatenate([jnp.full(count, LARGEST_MOVE), jnp.full(len(loops.sizes), 20.0)])
    stops, movable = problem.outline.bodies.stops, problem.fixed == 0
    stopped = jnp.any(movable[:, None] & jnp.isfinite(stops))

    def attempt(state: tuple[Array, _Rest]) -> tuple[Array, _Rest]:
        number, last = state
        scale = jnp.asarray(_SCALES)[number]
        found = system_root(lambda x: _residuals(x, problem, loops, scale), start, largest)
        good = found.converged & jnp.all(jnp.isfinite(found.root))
        steps = last.steps + found.steps
        return number + 1, _Rest(found.root, good, jnp.max(jnp.abs(found.residual)), steps)

    def unfinished(state: tuple[Array, _Rest]) -> Bool[Array, ""]:
        number, last = state
        # Without stops there is but one way.
        again = ~last.found & stopped & (number < len(_SCALES))
        return (number == 0) | again

    none = _Rest(start, jnp.array(False), jnp.array(jnp.inf), jnp.array(0))
    return jax.lax.while_loop(unfinished, attempt, in_lanes_of(start, (jnp.array(0), none)))[1]


def _root(
    problem: _Problem,
    loops: Loops,
    rest: _Rest,
    good: Bool[Array, ""],
    spare: Float[Array, " unknowns"],
) -> Float[Array, " unknowns"]:
    """Coordinates and tensions with their derivatives, or `spare` where not good.

    `problem` must be harmless where it is not good.
    """
    root = jnp.where(good, rest.root, jax.lax.stop_gradient(spare))
    return implicit_root(lambda x, p: _residuals(x, p, loops), problem, root)


def _is_stable(made: Assembly, stands: _Standing) -> Bool[Array, ""]:
    """Whether springs and belt hold the bodies, that is, the exact stiffness is positive definite.

    It is the stiffness at rest, where a belt of given length stretches as the bodies move.
    """
    at, tensions, locked = stands.layout, stands.tensions, made.bodies.locked
    if not len(locked):
        return jnp.array(True)
    turns = at.span_turns
    geometric = turns[:, :, None] * turns[:, None, :] / at.span_lengths[:, None, None]
    A = made.springs.matrix + made.outside.stiffness(made.bodies, at.coordinates)
    A = A + jnp.sum(tensions[:, None, None] * (geometric + at.curvatures), axis=0)
    take_up = made.loops.sums(at.span_pulls)
    rates = made.EA / at.path_lengths
    A = A + jnp.sum(rates[:, None, None] * take_up[:, :, None] * take_up[:, None, :], axis=0)
    moves = (1 - locked) * (stands.at_stop == 0)
    fixed = jax.lax.stop_gradient
    return definite_solve(fixed(A), jnp.zeros_like(locked), moves).definite
