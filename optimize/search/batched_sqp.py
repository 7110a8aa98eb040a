"""Sequential quadratic programming over all starts of a study, in batches of one width.

Starts that have ended make room for others, so that no lane of the batch waits for the slowest.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from beltjax.compiling.quick import quickly_compiled, thoroughly_compiled

from ..problem import ProblemScales, Starts, evaluation, limited_rows, measured_at
from ..study import Study
from .registry import AbstractOptimizer, optimizer
from .results import FEASIBLE, SearchResult, SearchTools, StartOutcome, history_of, padded
from .sl1qp import (
    RESTARTS,
    Bounds,
    Method,
    SequentialIterate,
    first_iterate,
    next_iterate,
    slopes_of,
)

FEW = 4096  # starts up to which compiling quickly beats running quickly
WIDTH = 64  # starts in a batch
ITERATIONS = 8  # of a batch, before the state is saved and the time looked at
BUSY = 0.75  # of a batch's lanes; with fewer, starts that wait take the room of those that ended
MOST_ITERATIONS = 160  # of one start
TOLERANCE = 1e-9
_RADIUS = 0.25  # of the first step, in the unit box


@optimizer("sqp")
class SequentialQuadraticProgramming(AbstractOptimizer):
    """Sequential quadratic programming with exact first derivatives, over all starts in batches.

    Every few iterations of a batch can be the last ones of a run, or the first. A start that ends
    where no small change lowers its violation begins once more from the opposite point of the box.
    """

    def search(self, study: Study, begin: Starts, tools: SearchTools) -> SearchResult:
        """Search from all starts."""
        rows = jnp.asarray(limited_rows(study, begin.parts))
        problem = study.canonical, begin.scales, rows
        states, paths = _begun(study, begin, len(rows), tools)
        # Compiling quickly pays while the batch is run few times.
        few = study.starts <= FEW
        iterate = quickly_compiled(_iterated) if few else thoroughly_compiled(_iterated)
        width = min(WIDTH, study.starts)
        timely = True
        while True:
            waiting = np.flatnonzero(~_ended(states))
            converged = f"{int(np.sum(states.done))} of {states.done.size} converged"
            tools.advance(converged, states.done.size - len(waiting), states.done.size)
            timely = tools.in_time
            if not len(waiting) or not timely:
                break
            # A batch that starts no longer fill has some of them twice.
            lanes = np.resize(waiting, width)
            one = jax.tree.map(lambda x, lanes=lanes: x[lanes], states)
            # While others wait, a batch stops early enough for most of its lanes to be at work.
            enough = BUSY * width if len(waiting) > width else 0
            batch = jax.tree.map(jnp.asarray, one)
            moved, path = jax.device_get(iterate(*problem, batch, jnp.asarray(enough, float)))
            states = jax.tree.map(
                lambda whole, rows, lanes=lanes: _with_rows(whole, lanes, rows), states, moved
            )
            known = moved.steps - one.steps
            for lane in range(min(width, len(waiting))):
                paths[lanes[lane]].extend(path[: known[lane], lane])
            states = _elsewhere(study, begin, states)
            if tools.checkpoint is not None:
                tools.checkpoint.save(paths=padded(paths), **_as_arrays(states))
        return SearchResult(_outcomes(states), history_of(paths), timely)


def _begun(
    study: Study, begin: Starts, rows: int, tools: SearchTools
) -> tuple[SequentialIterate, list[list[np.ndarray]]]:
    """The states of all starts, of an earlier run if there was one, and their paths."""
    states = jax.device_get(quickly_compiled(_first_iterates)(begin.points, rows))
    saved = tools.saved(study, begin)
    if saved is None:
        return states, [[] for _ in states.done]
    leaves, form = jax.tree.flatten(states)
    states = form.unflatten([saved[f"state_{place}"] for place in range(len(leaves))])
    return states, [list(path[np.isfinite(path[:, 0])]) for path in saved["paths"]]


def _elsewhere(study: Study, begin: Starts, states: SequentialIterate) -> SequentialIterate:
    """The states, but once from the opposite point of the box where no limits can be met nearby."""
    stuck = states.stopped & ~states.done & (states.violation > FEASIBLE)
    stuck = np.flatnonzero(stuck & np.isfinite(states.violation) & (states.anew <= RESTARTS))
    if not len(stuck):
        return states
    points = 1.0 - begin.points
    runs = [bool(at.found) for at in measured_at(study, begin, np.asarray(points)[stuck])]
    anew = _with_rows(np.asarray(states.anew), stuck, np.full(len(stuck), RESTARTS + 1))
    states, lanes = states._replace(anew=anew), stuck[np.array(runs)]
    rows = states.multipliers.shape[1]
    fresh = jax.device_get(quickly_compiled(_first_iterates)(points, rows))
    fresh = fresh._replace(anew=anew)
    return jax.tree.map(lambda old, new: _with_rows(old, lanes, new[lanes]), states, fresh)


def _as_arrays(states: SequentialIterate) -> dict[str, np.ndarray]:
    return {f"state_{place}": leaf for place, leaf in enumerate(jax.tree.leaves(states))}


def _ended(states: SequentialIterate) -> np.ndarray:
    return np.asarray(states.stopped | (states.steps >= MOST_ITERATIONS))


def _with_rows(whole: np.ndarray, lanes: np.ndarray, rows: np.ndarray) -> np.ndarray:
    out = np.array(whole)
    out[lanes] = rows
    return out


def _method(study: Study, scales: ProblemScales, rows: Array, size: int) -> Method:
    def evaluate(x: Array) -> tuple[Array, Array, Array]:
        at = evaluation(study, scales, x)
        return at.objective, at.constraints[rows], at.valid

    box = Bounds(jnp.zeros(size), jnp.ones(size))
    return Method(slopes_of(evaluate), box, _RADIUS, TOLERANCE)


def _first_iterates(points: Float[Array, "starts variables"], rows: int) -> SequentialIterate:
    """The states before the first iterations."""
    return jax.vmap(lambda x: first_iterate(x, rows, _RADIUS))(points)


def _iterated(
    study: Study,
    scales: ProblemScales,
    rows: Array,
    states: SequentialIterate,
    enough: Float[Array, ""],
) -> tuple[SequentialIterate, Float[Array, "iterations starts 2"]]:
    """The batch after some iterations, with objective and violation after each.

    It ends when no more than `enough` of its lanes have work left.
    """
    by = _method(study, scales, rows, states.x.shape[-1])
    path = jnp.full((ITERATIONS, len(states.done), 2), jnp.nan)

    def busy(now: tuple[Array, SequentialIterate, Array]) -> Array:
        number, states, _ = now
        return (number < ITERATIONS) & (jnp.sum(~states.stopped) > enough)

    def step(
        now: tuple[Array, SequentialIterate, Array],
    ) -> tuple[Array, SequentialIterate, Array]:
        number, states, path = now
        moved = jax.vmap(lambda s: next_iterate(by, s))(states)
        return number + 1, moved, path.at[number].set(jnp.stack([moved.at.f, moved.violation], -1))

    return jax.lax.while_loop(busy, step, (jnp.array(0), states, path))[1:]


def _outcomes(states: SequentialIterate) -> list[StartOutcome]:
    # A start that was never begun has no objective.
    f = np.where(states.steps > 0, states.at.f, np.where(states.at.valid, np.nan, np.inf))
    columns = states.x, f, states.violation, states.at.valid, states.done
    return [StartOutcome(*one) for one in zip(*columns, strict=True)]
