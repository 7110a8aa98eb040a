"""The design that a study leads to: optima, the best design, and the evidence for it."""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from beltjax.analysis.steady import SteadyState, steady_state
from beltjax.drive.numbers import unit_of
from beltjax.drive.readable import Readable
from beltjax.drive.system import Drive
from beltjax.results import RESULTS, succeeded

from .conflicts import conflicting, least_violated
from .optimality import LocalModel, ModelAt, Optimality, optimality, polished
from .problem import (
    Measured,
    ProblemScales,
    Starts,
    drive_at,
    measured_at,
    own_values,
    place_of,
    values_at,
)
from .quantities import find_quantity
from .search.results import FEASIBLE, History, SearchResult, StartOutcome
from .study import Study, split_name

ACTIVE = 1e-5  # distance from a limit, in its scale, that counts as on it
SAME = 1e-3  # distance in the unit box below which two starts ended in one optimum
POLISHED = 4  # of the best optima, moved onto the exact conditions


class ConstraintReport(NamedTuple):
    """One constraint at the final design, SI."""

    quantity: str
    unit: str  # SI; empty for a pure number
    value: float  # where the quantity has many parts, the one closest to its limit
    lower: float | None
    upper: float | None
    multiplier: float | None  # d(objective)/d(limit), at an optimum
    active: bool
    violation: float  # by how much the limit is missed, or 0
    implied: bool  # a limit of every drive that can be built, not one of the study
    as_drawn: float | None  # the value without the study's tolerances, where it has some


class StartReport(NamedTuple):
    """The end of one start."""

    final: float | None  # objective, with the true maximum over the operating points
    result: str


class Optimum(NamedTuple):
    """A design in which starts ended, with every limit met."""

    values: dict[str, float]  # SI
    objective: float
    starts: int  # that ended there
    residual: float  # of the optimality conditions, scaled


class Snapped(NamedTuple):
    """What it costs to take variables as they are sold."""

    values: dict[str, float]  # of the variables that were snapped, SI
    before: dict[str, float]  # all design variables before, SI
    objective: float | None  # before
    loss: float | None  # objective now less that before; None where no snapped design is an optimum


class Design(Readable):
    """The outcome of a study: the best design found and the evidence for it."""

    drive: Drive
    steady: SteadyState  # at the study's first operating point
    before: SteadyState  # of the study's own drive
    values: dict[str, float]  # of the design variables and what is tied to them, SI
    initial: float | None  # objective of the study's own drive; None where that cannot run
    final: float | None  # None where no design runs
    as_drawn: float | None  # the same without the study's tolerances, where it has some
    constraints: tuple[ConstraintReport, ...]
    starts: tuple[StartReport, ...]
    optima: tuple[Optimum, ...]  # best first
    optimality: Optimality | None  # of the design; None where it is no optimum
    bounds: dict[str, float]  # active bounds of variables: d(objective)/d(bound)
    conflicts: tuple[str, ...]  # limits that cannot be met together
    scales: dict[str, float]  # what objective and constrained quantities were measured in
    history: History
    result: RESULTS
    snapped: Snapped | None = None  # of a study that snaps variables

    @property
    def success(self) -> bool:
        """Return whether an optimum was reached that meets all constraints."""
        return bool(succeeded(self.result))

    def unit_of_row(self, field: str, key: str | None = None) -> str:
        """SI unit of a row when this prints: values of design variables have each their own."""
        if field == "values" and key is not None:
            return unit_of(self.drive, key)
        return super().unit_of_row(field, key)


class _Basin(NamedTuple):
    """An optimum in the unit box, and how many starts ended there."""

    at: LocalModel
    starts: int


def _basins(ends: list[StartOutcome], model_at: ModelAt) -> list[_Basin]:
    """The distinct optima, best first; the best few moved onto the exact conditions."""
    groups: list[list[StartOutcome]] = []
    for end in sorted((e for e in ends if e.feasible and e.converged), key=lambda e: e.objective):
        near = (g for g in groups if np.max(np.abs(g[0].x - end.x)) < SAME)
        group = next(near, None)
        if group is None:
            groups.append([end])
        else:
            group.append(end)
    found = []
    for i, group in enumerate(groups):
        at = model_at(group[0].x)
        if at is not None:
            found.append(_Basin(polished(at, model_at) if i < POLISHED else at, len(group)))
    return sorted(found, key=lambda basin: basin.at.f)


def report(
    study: Study,
    own_constraints: int,
    begin: Starts,
    rows: np.ndarray,
    model_at: ModelAt,
    found: SearchResult,
) -> Design:
    """The design that a search found; its first `own_constraints` constraints are the study's."""
    size = float(begin.scales.objective)
    basins = _basins(found.outcomes, model_at)
    result, x = _outcome(found, basins)
    evidence, conflicts = None, ()
    at = model_at(x)
    names = _row_names(study, begin.parts, rows)
    if result == RESULTS.successful and at is not None:
        evidence = optimality(at, model_at)
    elif result == RESULTS.constraints_infeasible and at is not None:
        at = least_violated(at, model_at)
        x, conflicts = at.x, conflicting(at, names)
    full = np.zeros(2 * sum(begin.parts))
    if evidence is not None:
        full[rows] = evidence.multipliers[: len(rows)]
    drive = drive_at(study, jnp.asarray(x))
    own = study.drive
    reached = [end.x for end in found.outcomes] + [basin.at.x for basin in basins]
    places = np.array([x, place_of(study, own_values(study)), *reached])
    shown, initial, *ended = measured_at(study, begin, places)
    drawn = None
    if study.scatter is not None:
        drawn = measured_at(dataclasses.replace(study, scatter=None), begin, places[:1])[0]
    objectives = [float(one.worst) for one in ended]
    states = [jax.device_get(steady_state(d, study.point, throw=False)) for d in (drive, own)]
    prices = full * size if evidence is not None else None
    return Design(
        drive=drive,
        steady=states[0],
        before=states[1],
        values=values_at(study, x),
        initial=float(initial.worst) if initial.found else None,
        final=float(shown.worst) if shown.found else None,
        as_drawn=None if drawn is None else float(drawn.worst),
        constraints=constraint_reports(
            study, own_constraints, begin.scales, (shown, drawn), prices
        ),
        starts=tuple(
            StartReport(true if end.valid else None, end.ending)
            for end, true in zip(found.outcomes, objectives, strict=False)
        ),
        optima=_optima(study, objectives[len(found.outcomes) :], basins, model_at),
        optimality=evidence,
        bounds=_bound_prices(study, evidence, size),
        conflicts=conflicts,
        scales=_named_scales(study, begin.scales),
        history=found.history._replace(objective=found.history.objective * size),
        result=result,
    )


def _outcome(found: SearchResult, basins: list[_Basin]) -> tuple[RESULTS, np.ndarray]:
    """Judge how the search ended, and pick its best design."""
    if basins:
        return RESULTS.successful, basins[0].at.x
    late = RESULTS.optimum_not_reached if found.in_time else RESULTS.time_limit_reached
    feasible = [end for end in found.outcomes if end.feasible]
    if feasible:
        return late, min(feasible, key=lambda end: end.objective).x
    valid = [end for end in found.outcomes if end.valid]
    if valid:
        missed = RESULTS.constraints_infeasible if found.in_time else RESULTS.time_limit_reached
        return missed, min(valid, key=lambda end: end.violation).x
    none = RESULTS.no_starting_design if found.in_time else RESULTS.time_limit_reached
    return none, found.outcomes[0].x


def _optima(
    study: Study, objectives: list[float], basins: list[_Basin], model_at: ModelAt
) -> tuple[Optimum, ...]:
    return tuple(
        Optimum(
            values_at(study, basin.at.x),
            objective,
            basin.starts,
            optimality(basin.at, model_at, second=False).residual,
        )
        for objective, basin in zip(objectives, basins, strict=True)
    )


def _row_names(study: Study, parts: list[int], rows: np.ndarray) -> list[str]:
    """The names of the limits in the problem's rows, bounds of variables last."""
    every = [
        f"{name} {side}"
        for name, n in zip(study.constraints.names, parts, strict=True)
        for side in ("lower", "upper")
        for _ in range(n)
    ]
    return [every[row] for row in rows] + _bound_names(study)


def _bound_names(study: Study) -> list[str]:
    return [f"{name} {side}" for side in ("lower", "upper") for name in study.variables.names]


def _bound_prices(study: Study, evidence: Optimality | None, size: float) -> dict[str, float]:
    """d(objective)/d(bound) of the bounds that hold the optimum back."""
    if evidence is None:
        return {}
    n = len(study.variables.names)
    span = np.asarray(study.variables.upper - study.variables.lower)
    low, high = np.split(evidence.multipliers[-2 * n :] * size, 2)
    prices = zip(_bound_names(study), [*(low / span), *(-high / span)], strict=True)
    return {name: float(price) for name, price in prices if price}


def _named_scales(study: Study, scales: ProblemScales) -> dict[str, float]:
    named = dict(zip(study.constraints.names, np.asarray(scales.constraints), strict=True))
    return {"objective": float(scales.objective)} | {k: float(v) for k, v in named.items()}


def constraint_reports(
    study: Study,
    own_constraints: int,
    scales: ProblemScales,
    found: tuple[Measured, Measured | None],
    prices: np.ndarray | None,
) -> tuple[ConstraintReport, ...]:
    """Each constraint where quantities are as `found`, with tolerances and as drawn."""
    (shown, drawn), reports, place = found, [], 0
    for i, name in enumerate(study.constraints.names):
        least, greatest = shown.least[i], shown.greatest[i]
        low, high = float(study.constraints.lower[i]), float(study.constraints.upper[i])
        scale, parts = float(scales.constraints[i]), len(least)
        price = None
        if prices is not None:
            of_lower, of_upper = np.split(prices[place : place + 2 * parts], 2)
            price = float(of_lower.sum() - of_upper.sum()) / scale
        place += 2 * parts
        gap_low, gap_high = float(least.min()) - low, high - float(greatest.max())
        closest, values = least.argmin(), least
        if gap_low > gap_high:
            closest, values = greatest.argmax(), greatest
        reports.append(
            ConstraintReport(
                quantity=name,
                unit=find_quantity(split_name(name)[0], study.drive).unit,
                value=float(values[closest]),
                lower=low if np.isfinite(low) else None,
                upper=high if np.isfinite(high) else None,
                multiplier=price,
                active=bool(min(gap_low, gap_high) <= ACTIVE * scale),
                violation=max(0.0, -min(gap_low, gap_high) - FEASIBLE * scale),
                implied=i >= own_constraints,
                as_drawn=None if drawn is None else float(drawn.greatest[i][closest]),
            )
        )
    return tuple(reports)
