"""The search for optima: from every starting point to where it ends."""

import functools
import time
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from beltjax.compiling.quick import quickly_compiled

from ..checkpoint import Checkpoint
from ..optimality import SETTLED, Local, Look, optimality
from ..problem import Scales, Starts, evaluation, slopes
from ..study import Study
from .augmented_lagrangian import Iterate, first_iterate, outer_step, to_unit
from .outside import in_time, solve

Advance = Callable[[str, int, int | None], None]

OUTER_STEPS = 30
FEW = 256  # starts up to which compiling quickly beats running quickly
FEASIBLE = 1e-6  # violation, in a constraint's scale, that counts as none


class History(NamedTuple):
    """Every iteration of every start; nan after a start's last."""

    objective: np.ndarray  # [iterations, starts], as the optimizer sees it
    violation: np.ndarray  # [iterations, starts], scaled


class End(NamedTuple):
    """Where one start ended, in the unit box; objective and violation scaled."""

    x: np.ndarray
    objective: float
    violation: float
    valid: bool
    converged: bool

    @property
    def feasible(self) -> bool:
        """Whether the design runs and meets every limit."""
        return self.valid and self.violation <= FEASIBLE

    @property
    def ending(self) -> str:
        """How the start ended, in words."""
        if np.isnan(self.objective):
            return "out of time"
        if not self.valid:
            return "no drive that runs"
        if not self.feasible:
            return "infeasible"
        return "optimal" if self.converged else "not converged"


class Search(NamedTuple):
    """Where all starts ended, and how they got there."""

    ends: list[End]
    history: History
    in_time: bool


class Means(NamedTuple):
    """What a search works with."""

    look: Look
    advance: Advance
    deadline: float | None  # of time.monotonic()
    checkpoint: Checkpoint | None

    @property
    def in_time(self) -> bool:
        """Whether there is time left."""
        return in_time(self.deadline)

    def saved(self, study: Study, begin: Starts) -> dict[str, np.ndarray] | None:
        """The state that an earlier run of this search left."""
        return None if self.checkpoint is None else self.checkpoint.load(study, begin.points)


def deadline_of(study: Study) -> float | None:
    """When a study's time, which begins now, is over."""
    return None if study.time_limit is None else time.monotonic() + study.time_limit


def looking(study: Study, scales: Scales, rows: np.ndarray) -> Look:
    """The problem's values and exact derivatives at a design, for optimizers on the host."""

    @functools.lru_cache(maxsize=64)
    def at(key: bytes) -> Local | None:
        x = np.frombuffer(key)
        found = jax.device_get(slopes(study, scales, jnp.asarray(rows), jnp.asarray(x)))
        numbers = (found.objective, *found[1:4])
        if not found.valid or not all(np.isfinite(part).all() for part in numbers):
            return None
        eye = np.eye(len(x))
        return Local(
            x=x,
            f=float(found.objective),
            c=np.concatenate([found.constraints, -x, x - 1]),
            df=found.of_objective,
            dc=np.concatenate([found.of_constraints, -eye, eye]),
        )

    return lambda x: at(np.asarray(x, float).tobytes())


def search(study: Study, begin: Starts, means: Means) -> Search:
    """Search by the study's method."""
    batched = study.method == "augmented-lagrangian"
    return (_by_lagrangian if batched else _by_solver)(study, begin, means)


def _by_lagrangian(study: Study, begin: Starts, means: Means) -> Search:
    """All starts as one batch; every outer iteration can be the last or the first of a run."""
    states = first_states(begin)
    objective, violation, first = [], [], 1
    saved = means.saved(study, begin)
    if saved is not None:
        states = Iterate(*(jnp.asarray(saved[field]) for field in Iterate._fields))
        objective, violation = list(saved["path_objective"]), list(saved["path_violation"])
        first = len(objective) + 1
    step = quickly_compiled(batch_step) if study.starts <= FEW else eqx.filter_jit(batch_step)

    def stepped(states: Iterate) -> Iterate:
        states = step(study.asked, begin.scales, states)
        objective.append(np.asarray(states.objective))
        violation.append(np.asarray(states.violation))
        if means.checkpoint is not None:
            path = {"path_objective": objective, "path_violation": violation}
            means.checkpoint.save(**states._asdict(), **path)
        return states

    states, timely = iterated(stepped, states, means.advance, means.deadline, first)
    return ends_of(states)._replace(history=_history(objective, violation), in_time=timely)


def iterated(
    step: Callable[[Iterate], Iterate],
    states: Iterate,
    tell: Advance,
    deadline: float | None,
    first: int = 1,
) -> tuple[Iterate, bool]:
    """The states of all starts after the last outer iteration, and whether time sufficed."""
    for done in range(first, OUTER_STEPS + 1):
        if np.all(states.stopped):
            break
        if not in_time(deadline):
            return states, False
        states = step(states)
        tell(f"{int(np.sum(states.done))} of {states.done.size} converged", done, OUTER_STEPS)
    return states, True


def first_states(begin: Starts) -> Iterate:
    """The augmented Lagrangian's state at every start."""
    return _first_iterates(begin.points, 2 * sum(begin.parts))


@functools.partial(jax.jit, static_argnums=1)
def _first_iterates(points: Float[Array, "starts variables"], rows: int) -> Iterate:
    return jax.vmap(lambda x: first_iterate(x, rows))(points)


def batch_step(study: Study, scales: Scales, states: Iterate) -> Iterate:
    """One outer iteration of every start."""
    return jax.vmap(lambda s: outer_step(lambda x: evaluation(study, scales, x), s))(states)


def ends_of(states: Iterate) -> Search:
    """Where the starts ended, without the way there."""
    host = jax.device_get(states)
    points = np.asarray(to_unit(host.z))
    objective = np.where(host.inner_steps > 0, host.objective, np.nan)  # nan: never begun
    columns = points, objective, host.violation, host.valid, host.done
    ends = [End(*end) for end in zip(*columns, strict=True)]
    return Search(ends, _history([host.objective], [host.violation]), True)


def _history(objective: list[np.ndarray], violation: list[np.ndarray]) -> History:
    return History(np.array(objective), np.array(violation))


def _by_solver(study: Study, begin: Starts, means: Means) -> Search:
    """One start after the other, by an optimizer of another library."""
    ends: list[End] = []
    paths: list[np.ndarray] = []
    saved = means.saved(study, begin)
    if saved is not None:
        columns = (saved[field] for field in End._fields)
        ends = [End(*end) for end in zip(*columns, strict=True)]
        paths = [path[np.isfinite(path[:, 0])] for path in saved["paths"]]
    timely = True
    for x in np.asarray(begin.points)[len(ends) :]:
        timely = means.in_time
        if not timely:
            ends.append(End(x, np.nan, np.inf, False, False))
            continue
        end, path = _solved(study.method, means, x)
        ends.append(end)
        paths.append(path)
        if means.checkpoint is not None:
            columns = zip(*ends, strict=True)
            means.checkpoint.save(
                **dict(zip(End._fields, columns, strict=True)), paths=_padded(paths)
            )
        means.advance(f"{sum(e.converged for e in ends)} converged", len(ends), len(begin.points))
    stacked = _padded(paths)
    return Search(ends, History(stacked[..., 0].T, stacked[..., 1].T), timely)


def _solved(method: str, means: Means, x: np.ndarray) -> tuple[End, np.ndarray]:
    """One start's end, judged at that design, and its path [iterations, 2]."""
    start = means.look(x)
    if start is None:
        return End(x, np.inf, np.inf, False, False), np.full((1, 2), np.nan)
    ended = solve(method, means.look, start, means.deadline)
    at = means.look(ended.x)
    path = np.array(ended.path).reshape(-1, 2)
    if at is None:
        return End(ended.x, np.inf, np.inf, False, False), path
    # SLSQP may stop on an optimum because rounding leaves it no way down, and call that a failure.
    shown = optimality(at, means.look, second=False)
    converged = ended.converged or shown.residual <= SETTLED
    return End(ended.x, at.f, shown.violation, True, converged), path


def _padded(paths: list[np.ndarray]) -> np.ndarray:
    """Paths of unequal length as one array [starts, iterations, 2], nan after each one's end."""
    out = np.full((len(paths), max(map(len, paths), default=0), 2), np.nan)
    for row, path in zip(out, paths, strict=True):
        row[: len(path)] = path
    return out
