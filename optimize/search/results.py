"""The tools of a search, and its results."""

import functools
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..checkpoint import Checkpoint
from ..optimality import LocalModel, ModelAt
from ..problem import ProblemScales, Starts, derivatives
from ..study import Study

Advance = Callable[[str, int, int | None], None]

FEASIBLE = 1e-6  # violation, in a constraint's scale, that counts as none


class History(NamedTuple):
    """Every iteration of every start; nan after a start's last."""

    objective: np.ndarray  # [iterations, starts], as the optimizer sees it
    violation: np.ndarray  # [iterations, starts], scaled


def padded(paths: Sequence[np.ndarray | Sequence[np.ndarray]]) -> np.ndarray:
    """Paths of unequal length as one array [starts, iterations, 2], nan after each one's end."""
    out = np.full((len(paths), max(map(len, paths), default=0), 2), np.nan)
    for row, path in zip(out, paths, strict=True):
        row[: len(path)] = np.reshape(path, (-1, 2))
    return out


def history_of(paths: Sequence[np.ndarray | Sequence[np.ndarray]]) -> History:
    """The history of starts whose iterations each gave objective and violation."""
    stacked = padded(paths)
    return History(stacked[..., 0].T, stacked[..., 1].T)


class StartOutcome(NamedTuple):
    """The end of one start, in the unit box; objective and violation are scaled."""

    x: np.ndarray
    objective: float
    violation: float
    valid: bool  # whether the drive runs there
    converged: bool

    @property
    def feasible(self) -> bool:
        """Return whether the design runs and meets every limit."""
        return self.valid and self.violation <= FEASIBLE

    @property
    def ending(self) -> str:
        """Say how the start ended."""
        if np.isnan(self.objective):
            return "out of time"
        if not self.valid:
            return "no drive that runs"
        if not self.feasible:
            return "infeasible"
        return "optimal" if self.converged else "not converged"


class SearchResult(NamedTuple):
    """The ends of all starts, and the way there."""

    outcomes: list[StartOutcome]
    history: History
    in_time: bool


class SearchTools(NamedTuple):
    """The tools that an optimizer is given beside the study and its starts."""

    model_at: ModelAt  # the problem's values and exact derivatives at a design
    advance: Advance  # to be called as the work proceeds
    deadline: float | None  # a time of time.monotonic()
    checkpoint: Checkpoint | None

    @property
    def in_time(self) -> bool:
        """Return whether there is time left."""
        return is_before(self.deadline)

    def saved(self, study: Study, begin: Starts) -> dict[str, np.ndarray] | None:
        """The state that an earlier run of this search left."""
        return None if self.checkpoint is None else self.checkpoint.load(study, begin.points)


def is_before(deadline: float | None) -> bool:
    """Return whether a `deadline` of time.monotonic() is still to come; None never comes."""
    return deadline is None or time.monotonic() < deadline


def deadline_of(study: Study) -> float | None:
    """Return when a study's time, which begins now, is over."""
    return None if study.time_limit is None else time.monotonic() + study.time_limit


def local_models(study: Study, scales: ProblemScales, rows: np.ndarray) -> ModelAt:
    """The problem's values and exact derivatives at a design, for optimizers on the host."""

    @functools.lru_cache(maxsize=64)
    def at(key: bytes) -> LocalModel | None:
        x = np.frombuffer(key)
        found = jax.device_get(derivatives(study, scales, jnp.asarray(rows), jnp.asarray(x)))
        numbers = (found.objective, *found[1:4])
        if not found.valid or not all(np.isfinite(part).all() for part in numbers):
            return None
        eye = np.eye(len(x))
        return LocalModel(
            x=x,
            f=float(found.objective),
            c=np.concatenate([found.constraints, -x, x - 1]),
            df=found.of_objective,
            dc=np.concatenate([found.of_constraints, -eye, eye]),
        )

    return lambda x: at(np.asarray(x, float).tobytes())
