"""Optimizers that take one start after the other, with exact derivatives, on the host."""

import abc
from typing import Any, NamedTuple

import numpy as np

from ..optimality import SETTLED, LocalModel, ModelAt, optimality
from ..problem import Starts
from ..study import Study
from .registry import AbstractOptimizer
from .results import SearchResult, SearchTools, StartOutcome, history_of, is_before, padded

Vector = np.ndarray
_LOST = 1e3  # objective and violation of a design that cannot be evaluated


class Ending(NamedTuple):
    """The design at which an optimizer stopped, and why it did."""

    x: Vector
    converged: bool
    message: str


class UnitBoxProblem:
    """A study's problem from one start: minimize f(x), c(x) <= 0, 0 <= x <= 1, all scaled."""

    def __init__(self, model_at: ModelAt, start: LocalModel, deadline: float | None = None):
        self._model_at, self._deadline = model_at, deadline
        self.last = start  # the last design that could be evaluated
        self.path: list[tuple[float, float]] = []  # objective and violation of every iteration

    def model(self, x: Vector) -> LocalModel:
        """Values and derivatives at x; where no drive runs, values to turn away from."""
        inside = np.clip(x, 0.0, 1.0)
        found = self._model_at(inside)
        if found is None:
            return self.last._replace(x=inside, f=_LOST, c=np.full_like(self.last.c, _LOST))
        self.last = found
        return found

    def objective(self, x: Vector) -> float:
        """The objective f [-]."""
        return self.model(x).f

    def objective_gradient(self, x: Vector) -> Vector:
        """The exact derivatives of f [n]."""
        return self.model(x).df

    def constraints(self, x: Vector) -> Vector:
        """The constraints c [m], which hold where they are 0 or less; without the box's bounds."""
        return self.model(x).c[: -2 * len(x)]

    def constraint_gradients(self, x: Vector) -> np.ndarray:
        """The exact derivatives of c [m, n]."""
        return self.model(x).dc[: -2 * len(x)]

    def record(self, objective: float, violation: float) -> bool:
        """Keep an iteration for the history; returns whether there is time for the next."""
        self.path.append((float(objective), float(violation)))
        return is_before(self._deadline)

    def record_or_stop(self, x: Vector, *_: Any) -> None:
        """Keep an iteration; raises `StopIteration`, which ends the search, when time is over."""
        at = self.model(x)
        if not self.record(at.f, np.max(np.maximum(at.c, 0.0), initial=0.0)):
            raise StopIteration


class AbstractLocalOptimizer(AbstractOptimizer):
    """An optimizer that goes from one start to one design: override `minimize`."""

    @abc.abstractmethod
    def minimize(self, problem: UnitBoxProblem, x: Vector) -> Ending:
        """Go from x [n] to a minimum of `problem`.

        Call `problem.record` or `problem.record_or_stop` at each iteration, for the history and
        the time limit. The best ends are moved onto the exact conditions of an optimum afterwards.
        """

    def run(self, problem: UnitBoxProblem) -> Ending:
        """`minimize` from the problem's start, until its end or the deadline."""
        try:
            return self.minimize(problem, problem.last.x.copy())
        except StopIteration:
            return Ending(problem.last.x, False, "out of time")

    def search(self, study: Study, begin: Starts, tools: SearchTools) -> SearchResult:
        """Search from one start after the other; a checkpoint goes on at the next start."""
        outcomes: list[StartOutcome] = []
        paths: list[np.ndarray] = []
        saved = tools.saved(study, begin)
        if saved is not None:
            columns = (saved[field] for field in StartOutcome._fields)
            outcomes = [StartOutcome(*one) for one in zip(*columns, strict=True)]
            paths = [path[np.isfinite(path[:, 0])] for path in saved["paths"]]
        timely = True
        for x in np.asarray(begin.points)[len(outcomes) :]:
            timely = tools.in_time
            if not timely:
                outcomes.append(StartOutcome(x, np.nan, np.inf, False, False))
                continue
            outcome, path = self._outcome(tools, x)
            outcomes.append(outcome)
            paths.append(path)
            if tools.checkpoint is not None:
                columns = dict(zip(StartOutcome._fields, zip(*outcomes, strict=True), strict=True))
                tools.checkpoint.save(**columns, paths=padded(paths))
            converged = sum(one.converged for one in outcomes)
            tools.advance(f"{converged} converged", len(outcomes), len(begin.points))
        return SearchResult(outcomes, history_of(paths), timely)

    def _outcome(self, tools: SearchTools, x: Vector) -> tuple[StartOutcome, np.ndarray]:
        """One start's outcome, judged where it ended, and its path [iterations, 2]."""
        start = tools.model_at(x)
        if start is None:
            return StartOutcome(x, np.inf, np.inf, False, False), np.full((1, 2), np.nan)
        problem = UnitBoxProblem(tools.model_at, start, tools.deadline)
        ending = self.run(problem)
        at = tools.model_at(ending.x)
        path = np.array(problem.path).reshape(-1, 2)
        if at is None:
            return StartOutcome(ending.x, np.inf, np.inf, False, False), path
        # SLSQP may stop on an optimum because rounding leaves it no way down, and call that a
        # failure.
        shown = optimality(at, tools.model_at, second=False)
        converged = ending.converged or shown.residual <= SETTLED
        return StartOutcome(ending.x, at.f, shown.violation, True, converged), path
