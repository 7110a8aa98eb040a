"""An augmented Lagrangian over all starts of a study as one batch."""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from beltjax.compiling.quick import quickly_compiled, thoroughly_compiled

from ..problem import ProblemScales, Starts, evaluation
from ..study import Study
from .augmented_lagrangian import Iterate, first_iterate, outer_step, to_unit
from .registry import AbstractOptimizer, optimizer
from .results import Advance, History, SearchResult, SearchTools, StartOutcome, is_before

OUTER_STEPS = 30
FEW = 256  # starts up to which compiling quickly beats running quickly


@optimizer("augmented-lagrangian")
class AugmentedLagrangian(AbstractOptimizer):
    """An augmented Lagrangian over all starts as one batch.

    Every outer iteration can be the last one of a run, or the first.
    """

    def search(self, study: Study, begin: Starts, tools: SearchTools) -> SearchResult:
        """Search from all starts at once."""
        states = first_states(begin)
        objective, violation, first = [], [], 1
        saved = tools.saved(study, begin)
        if saved is not None:
            states = Iterate(*(jnp.asarray(saved[field]) for field in Iterate._fields))
            objective, violation = list(saved["path_objective"]), list(saved["path_violation"])
            first = len(objective) + 1
        step = (
            quickly_compiled(batch_step) if study.starts <= FEW else thoroughly_compiled(batch_step)
        )

        def stepped(states: Iterate) -> Iterate:
            states = step(study.canonical, begin.scales, states)
            objective.append(np.asarray(states.objective))
            violation.append(np.asarray(states.violation))
            if tools.checkpoint is not None:
                path = {"path_objective": objective, "path_violation": violation}
                tools.checkpoint.save(**states._asdict(), **path)
            return states

        states, timely = iterated(stepped, states, tools.advance, tools.deadline, first)
        history = _history(objective, violation)
        return result_of(states)._replace(history=history, in_time=timely)


def iterated(
    step: Callable[[Iterate], Iterate],
    states: Iterate,
    advance: Advance,
    deadline: float | None,
    first: int = 1,
) -> tuple[Iterate, bool]:
    """The states of all starts after the last outer iteration, and whether time sufficed."""
    for done in range(first, OUTER_STEPS + 1):
        if np.all(states.stopped):
            break
        if not is_before(deadline):
            return states, False
        states = step(states)
        advance(f"{int(np.sum(states.done))} of {states.done.size} converged", done, OUTER_STEPS)
    return states, True


def first_states(begin: Starts) -> Iterate:
    """The augmented Lagrangian's state at every start."""
    return _first_iterates(begin.points, 2 * sum(begin.parts))


@functools.partial(jax.jit, static_argnums=1)
def _first_iterates(points: Float[Array, "starts variables"], rows: int) -> Iterate:
    return jax.vmap(lambda x: first_iterate(x, rows))(points)


def batch_step(study: Study, scales: ProblemScales, states: Iterate) -> Iterate:
    """One outer iteration of every start."""
    return jax.vmap(lambda s: outer_step(lambda x: evaluation(study, scales, x), s))(states)


def result_of(states: Iterate) -> SearchResult:
    """Read off where the starts ended, without the way there."""
    host = jax.device_get(states)
    points = np.asarray(to_unit(host.z))
    objective = np.where(host.inner_steps > 0, host.objective, np.nan)  # nan: never begun
    columns = points, objective, host.violation, host.valid, host.done
    outcomes = [StartOutcome(*one) for one in zip(*columns, strict=True)]
    return SearchResult(outcomes, _history([host.objective], [host.violation]), True)


def _history(objective: list[np.ndarray], violation: list[np.ndarray]) -> History:
    return History(np.array(objective), np.array(violation))
