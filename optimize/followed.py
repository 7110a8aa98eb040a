"""A search from where the design stands, followed iteration by iteration."""

import dataclasses
import threading
from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from beltjax.drive.numbers import full_key
from beltjax.drive.system import Drive

from .design import Design, report
from .minimization import minimize
from .optimality import SETTLED, LocalModel, ModelAt, optimality
from .problem import Starts, drive_at, in_box, limited_rows, own_values, starting_points
from .search.one_by_one import AbstractLocalOptimizer, UnitBoxProblem, Vector
from .search.registry import find_optimizer
from .search.results import SearchResult, StartOutcome, history_of, local_models
from .study import Study

# One start needs no batch; this one reports every iteration and takes exact derivatives.
_METHOD = "slsqp"

Follow = Callable[[Drive, list[float]], None]  # a design on the way, and the objective so far


class Stopped(Exception):  # noqa: N818 - it is no error
    """A search was told to stop before it had a design."""


class Searching:
    """A search of one start or of all that the study asks for, which may be stopped.

    `run` blocks until it ends. `follow` is called at each iteration of a single start, `advance`
    with stage, done and total.
    """

    def __init__(
        self,
        study: Study,
        own_constraints: int,
        follow: Follow,
        advance: Callable[[str, int, int | None], None],
    ):
        self._study, self._own = study, own_constraints
        self._follow, self._advance = follow, advance
        self._stop = threading.Event()

    def stop(self) -> None:
        """Have it end at the next iteration."""
        self._stop.set()

    @property
    def stopped(self) -> bool:
        """Whether it was told to end."""
        return self._stop.is_set()

    def run(self, everywhere: bool = False) -> Design:
        """The design found from here, or from all starts of the study `everywhere`.

        Where it was stopped, that of the last iteration, which is no optimum.

        Raises:
            Stopped: it was told to stop before there was a design.
        """
        if everywhere:
            return minimize(self._study, self._may_go_on)
        study = dataclasses.replace(self._study, starts=1, choices=(), snaps=(), pareto=())
        self._may_go_on("compiling", 0, None)
        begin = starting_points(study)
        here = begin._replace(points=_place(study))
        rows = limited_rows(study, begin.parts)
        model_at = local_models(study, begin.scales, rows)
        self._may_go_on("searching", 0, None)
        start = model_at(np.asarray(here.points[0]))
        found = SearchResult([_nowhere(here)], history_of([np.full((1, 2), np.nan)]), True)
        if start is not None:
            problem = _Followed(self, study, begin, model_at, start)
            method = find_optimizer(_METHOD)
            assert isinstance(method, AbstractLocalOptimizer)
            ending = method.run(problem)
            found = _outcome(ending.x, ending.converged, problem, model_at)
        return report(study, self._own, here, rows, model_at, found)

    def _may_go_on(self, stage: str, done: int, total: int | None) -> None:
        if self.stopped:
            raise Stopped
        self._advance(stage, done, total)

    def heard(self, drive: Drive, path: list[float]) -> None:
        """Tell of an iteration; raises `StopIteration`, which ends the search, when stopped."""
        self._follow(drive, path)
        if self.stopped:
            raise StopIteration


class _Followed(UnitBoxProblem):
    """A problem whose every iteration is told."""

    def __init__(
        self,
        of: Searching,
        study: Study,
        begin: Starts,
        model_at: ModelAt,
        start: LocalModel,
    ):
        super().__init__(model_at, start)
        self._of, self._study, self._size = of, study, float(begin.scales.objective)

    def record_or_stop(self, x: Vector, *_: Any) -> None:
        """Keep an iteration and tell of it."""
        super().record_or_stop(x)
        path = [f * self._size for f, _ in self.path]
        self._of.heard(drive_at(self._study, jnp.asarray(np.clip(x, 0.0, 1.0))), path)


def _place(study: Study) -> Any:
    """The study's own drive in the unit box, at which a search from here begins."""
    return jnp.asarray(in_box(study, own_values(study)))[None]


def _nowhere(begin: Starts) -> StartOutcome:
    return StartOutcome(np.asarray(begin.points[0]), np.inf, np.inf, False, False)


def _outcome(
    x: Vector,
    converged: bool,
    problem: UnitBoxProblem,
    model_at: ModelAt,
) -> SearchResult:
    """The end of the search, judged where it ended."""
    paths = history_of([np.array(problem.path).reshape(-1, 2)])
    at = model_at(np.clip(x, 0.0, 1.0))
    if at is None:
        return SearchResult([StartOutcome(x, np.inf, np.inf, False, False)], paths, True)
    shown = optimality(at, model_at, second=False)
    settled = converged or shown.residual <= SETTLED
    return SearchResult(
        [StartOutcome(at.x, at.f, shown.violation, True, settled)],
        paths,
        True,
    )


def from_here(study: Study, turned: Mapping[str, float]) -> Study:
    """`study` of its present drive, whose arms are `turned` [rad] from where its file has them.

    An angle counts from the drive that a study is of: bounds and ties are moved along.
    """
    limits = study.variables
    shift = jnp.array([turned.get(full_key(study.drive, name), 0.0) for name in limits.names])
    moved = eqx.tree_at(
        lambda s: (s.variables.lower, s.variables.upper),
        study,
        (limits.lower - shift, limits.upper - shift),
    )
    ties = study.ties
    if ties is None:
        return moved
    of = [turned.get(full_key(study.drive, name), 0.0) for name in ties.to]
    own = [turned.get(full_key(study.drive, name), 0.0) for name in ties.names]
    offsets = ties.offsets + ties.factors * jnp.array(of) - jnp.array(own)
    return eqx.tree_at(lambda s: s.ties.offsets, moved, offsets)
