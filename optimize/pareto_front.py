"""Pareto fronts: the best of one objective for every limit on the others (epsilon-constraint)."""

import dataclasses
import itertools
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from beltjax.compiling.quick import usual_promotion
from beltjax.drive.components import as_real

from .design import Design
from .minimization import minimize
from .optimality import SETTLED, optimality, polished
from .problem import (
    ProblemScales,
    drive_at,
    in_box,
    limited_rows,
    part_counts,
    run_measured,
    values_at,
    with_implied_constraints,
)
from .quantities import find_quantity
from .search.one_by_one import UnitBoxProblem
from .search.other_libraries import Slsqp
from .search.results import Advance, local_models
from .study import Limits, Study, split_name

_SAME = 1e-6  # of the front's extent


class FrontPoint(NamedTuple):
    """One design of the front."""

    objectives: tuple[float, ...]  # SI, in the order of `Front.names`
    values: dict[str, float]  # of the design variables, SI
    residual: float  # of the conditions of an optimum, scaled


class Front(NamedTuple):
    """Designs of which none is better than another in all objectives."""

    names: tuple[str, ...]  # quantities; "-NAME" is maximized
    units: tuple[str, ...]  # SI; empty for pure numbers
    points: tuple[FrontPoint, ...]  # by the first objective
    anchors: tuple[Design, ...]  # the best design by each objective alone
    tried: int  # problems posed beside the anchors

    @property
    def success(self) -> bool:
        """Whether every objective alone has an optimum."""
        return all(anchor.success for anchor in self.anchors)


@usual_promotion
def pareto(
    study: Study,
    names: tuple[str, ...] | None = None,
    points: int | None = None,
    advance: Advance | None = None,
) -> Front:
    """The Pareto front of two or three objectives.

    The first objective is minimized under limits on the others (Haimes, Lasdon and Wismer, 1971).
    The limits of each lie between its best and its worst at the objectives' own optima, and every
    problem starts at the nearest design solved so far. Objectives are measured at all operating
    points, of which the worst counts. docs/optimizing.md.

    Args:
        study: the study, whose own objective does not matter.
        names: quantities, where "-NAME" is maximized; `study.pareto` unless given.
        points: number of equal steps between the best and the worst value of each objective that
            is limited, at least 2; `study.pareto_points` unless given.
        advance: function that is called as `advance(stage, done, total)` as the work proceeds.

    Returns:
        The designs of the front; without any where an objective alone has no optimum.

    Raises:
        ValueError: there are not two or three objectives, or fewer than two points.
    """
    names = study.pareto if names is None else names
    points = study.pareto_points if points is None else points
    if len(names) not in (2, 3) or points < 2:
        raise ValueError("pareto: give two or three objectives and at least two points.")
    progress = advance or (lambda stage, done, total: None)
    bare = [split_name(name.removeprefix("-"))[0] for name in names]
    units = tuple(find_quantity(name, study.drive).unit for name in bare)
    posed = _posed(study, names)
    anchors = tuple(
        minimize(_alone(posed, names, k), _prefixed(progress, name)) for k, name in enumerate(names)
    )
    if not all(anchor.success for anchor in anchors):
        return Front(names, units, (), anchors, 0)
    trade = _Trade(with_implied_constraints(_alone(posed, names, 0)), names, anchors)
    ends = np.array([trade.signed(point) for point in trade.solved])
    size = np.maximum(np.ptp(ends, axis=0), 1e-30)
    steps = [np.linspace(low, low + span, points + 1)[1:-1]
             for low, span in zip(ends.min(axis=0)[1:], size[1:], strict=True)]  # fmt: skip
    limits = [np.array(limit) for limit in itertools.product(*steps)]
    for done, limit in enumerate(limits):
        progress("following the front", done, len(limits))
        trade.follow(limit, size[1:])
    return Front(names, units, tuple(trade.undominated()), anchors, len(limits))


class _Trade:
    """The problem of the first objective under limits on the others, and what is solved of it."""

    def __init__(self, study: Study, names: tuple[str, ...], anchors: tuple[Design, ...]):
        self._study, self._names = study, names
        self._signs = _signs(names)
        # Where several limits are on one quantity the last is the front's.
        last = {name: i for i, name in enumerate(study.constraints.names)}
        self._places = [last[name.removeprefix("-")] for name in names]
        sizes = [anchors[0].scales[name] for name in study.constraints.names]
        self._scales = ProblemScales(as_real(anchors[0].scales["objective"]), as_real(sizes))
        self.solved = [self._measured(in_box(study, a.values), _residual(a)) for a in anchors]

    def signed(self, point: FrontPoint) -> np.ndarray:
        """Objectives, all to be minimized."""
        return np.array(point.objectives) * self._signs

    def _measured(self, x: np.ndarray, residual: float) -> FrontPoint:
        at = run_measured(self._study, drive_at(self._study, jnp.asarray(x)))
        worst = [
            np.max(at.greatest[i]) if sign > 0 else np.min(at.least[i])
            for sign, i in zip(self._signs, self._places, strict=True)
        ]
        return FrontPoint(tuple(map(float, worst)), values_at(self._study, x), residual)

    def follow(self, limit: np.ndarray, size: np.ndarray) -> None:
        """Solve for one set of limits, if it has a solution."""
        study = self._limited(limit)
        model_at = local_models(study, self._scales, limited_rows(study, part_counts(study)))
        near = min(
            self.solved, key=lambda p: float(np.sum(((self.signed(p)[1:] - limit) / size) ** 2))
        )
        start = model_at(in_box(study, near.values))
        end = None if start is None else model_at(Slsqp().run(UnitBoxProblem(model_at, start)).x)
        if end is None:
            return
        end = polished(end, model_at)
        shown = optimality(end, model_at, second=False)
        if shown.residual <= SETTLED:
            self.solved.append(self._measured(end.x, shown.residual))

    def _limited(self, limit: np.ndarray) -> Study:
        lower, upper = self._study.constraints.lower, self._study.constraints.upper
        for i, sign, value in zip(self._places[1:], self._signs[1:], limit, strict=True):
            if sign < 0:
                lower = lower.at[i].set(-value)
            else:
                upper = upper.at[i].set(value)
        both = lower, upper
        return eqx.tree_at(lambda s: (s.constraints.lower, s.constraints.upper), self._study, both)

    def undominated(self) -> list[FrontPoint]:
        """The designs that no other one beats, each once, by the first objective."""
        rows = np.array([self.signed(point) for point in self.solved])
        rows = rows / np.maximum(np.ptp(rows, axis=0), 1e-30)
        kept: list[int] = []
        for i, row in enumerate(rows):
            gaps = rows - row
            beaten = np.all(gaps <= _SAME, axis=1) & np.any(gaps < -_SAME, axis=1)
            if not beaten.any() and all(np.max(np.abs(gaps[k])) >= _SAME for k in kept):
                kept.append(i)
        return [self.solved[i] for i in sorted(kept, key=lambda i: rows[i][0])]


def _residual(design: Design) -> float:
    return np.nan if design.optimality is None else design.optimality.residual


def _posed(study: Study, names: tuple[str, ...]) -> Study:
    """A study with all objectives, each also limited by numbers that are still to be given."""
    bare, given = tuple(name.removeprefix("-") for name in names), study.constraints
    limits = Limits(
        given.names + bare,
        jnp.append(given.lower, jnp.full(len(bare), -jnp.inf)),
        jnp.append(given.upper, jnp.full(len(bare), jnp.inf)),
    )
    weights = jnp.zeros(len(bare))
    return dataclasses.replace(study, objective=bare, weights=weights, constraints=limits)


def _alone(study: Study, names: tuple[str, ...], k: int) -> Study:
    """The k-th objective alone."""
    weights = jnp.zeros(len(names)).at[k].set(_signs(names)[k])
    return eqx.tree_at(lambda s: s.weights, study, weights)


def _signs(names: tuple[str, ...]) -> np.ndarray:
    return np.array([-1.0 if name.startswith("-") else 1.0 for name in names])


def _prefixed(progress: Advance, name: str) -> Advance:
    return lambda stage, done, total: progress(f"{name}: {stage}", done, total)
