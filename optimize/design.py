"""From a study to a design: scaling, many starts, the best feasible optimum and its multipliers."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats import qmc

from beltjax.analysis.steady import SteadyState, steady_state
from beltjax.drive.components import Drive
from beltjax.drive.variables import value_of, with_values
from beltjax.numerics.compilation import quickly_compiled
from beltjax.results import RESULTS, succeeded

from .lagrangian import Evaluation, Iterate, first_iterate, outer_step, to_unit
from .quantities import Answers, quantity
from .study import Limits, Study

Advance = Callable[[str, int, int | None], None]

OUTER_STEPS = 30
FEW = 256  # starts up to which compiling quickly beats running quickly
CANDIDATES = 8  # random designs drawn for each start; the first ones that run are used
FEASIBLE = 1e-6  # violation, in a constraint's scale, that counts as none
ACTIVE = 1e-5  # distance from a limit, in the same scale, that counts as on it
# What every drive that can be built must meet, whether the study asks for it or not, a little
# inside the edges beyond which there is no drive to evaluate: quantity, least, greatest.
IMPLIED = {
    "clearance": (0.0, np.inf),
    "wraps": (np.radians(1.0), np.radians(268.0)),
    "tightness": (0.01, np.inf),
}


class Scales(NamedTuple):
    """What the optimizer measures the objective and the constrained quantities in."""

    objective: Float[Array, ""]
    constraints: Float[Array, " constraints"]


class ConstraintReport(NamedTuple):
    """One constraint at the final design, SI."""

    quantity: str
    value: float  # where the quantity has many parts, the one closest to its limit
    lower: float | None
    upper: float | None
    multiplier: float | None  # d(objective)/d(limit), at an optimum
    active: bool
    violation: float  # by how much the limit is missed, or 0
    implied: bool  # not asked for by the study, but by every drive that can be built


class StartReport(NamedTuple):
    """How one start ended."""

    final: float | None  # objective
    result: str


class Design(eqx.Module):
    """The outcome of a study: the best design found and the evidence for it."""

    drive: Drive
    steady: SteadyState
    before: SteadyState  # of the study's own drive
    values: dict[str, float]  # of the design variables, SI
    initial: float | None  # objective of the study's own drive; None where that cannot run
    final: float | None  # None where no design runs
    constraints: tuple[ConstraintReport, ...]
    starts: tuple[StartReport, ...]
    result: RESULTS

    @property
    def success(self) -> bool:
        """Whether an optimum was reached that meets all constraints."""
        return bool(succeeded(self.result))


def minimize(study: Study, advance: Advance | None = None) -> Design:
    """The design that minimizes a study's objective within its bounds and constraints.

    Runs an augmented Lagrangian from the study's own drive and from quasi-random designs, all
    as one batch. `advance(stage, done, total)` is called as the work proceeds. Never raises
    for a study without a solution: read `.result` and `.constraints`.
    """
    tell = advance or (lambda stage, done, total: None)
    asked = len(study.constraints.names)
    study = _with_implied_constraints(study)
    tell("compiling", 0, None)
    points, scales, parts = _starting_points(study)
    states = jax.vmap(lambda x: first_iterate(x, parts))(points)
    step = quickly_compiled(_step) if study.starts <= FEW else eqx.filter_jit(_step)
    for done in range(1, OUTER_STEPS + 1):
        states = step(study, scales, states)
        tell(f"{int(jnp.sum(states.done))} of {len(points)} starts converged", done, OUTER_STEPS)
        if bool(jnp.all(states.stopped)):
            break
    return _report(study, asked, scales, jax.device_get(states))


def _evaluation(study: Study, scales: Scales, x: Float[Array, " variables"]) -> Evaluation:
    """Scaled objective and constraints of the design at `x` in the unit box."""
    drive = _drive_at(study, x)
    steady = steady_state(drive, study.point, throw=False)
    answers = Answers(drive, study.point, steady)
    objective, measured = _measured(study, answers)
    limits, parts = study.constraints, []
    for value, low, high, scale in zip(
        measured, limits.lower, limits.upper, scales.constraints, strict=True
    ):
        parts += [(low - value) / scale, (value - high) / scale]
    return Evaluation(
        objective=objective / scales.objective,
        constraints=jnp.concatenate(parts),
        valid=answers.found(),
    )


def _measured(study: Study, of: Answers) -> tuple[Array, list[Array]]:
    """Objective, and the parts of each constrained quantity."""
    terms = [quantity(name, of.drive).measure(of)[0] for name in study.objective]
    parts = [quantity(name, of.drive).measure(of) for name in study.constraints.names]
    return study.weights @ jnp.stack(terms), parts


def _drive_at(study: Study, x: Float[Array, " variables"]) -> Drive:
    bounds = study.variables
    values = bounds.lower + x * (bounds.upper - bounds.lower)
    return with_values(study.drive, dict(zip(bounds.names, values, strict=True)))


def _with_implied_constraints(study: Study) -> Study:
    """`study`, with what every drive that can be built must meet added to its constraints."""
    given = study.constraints
    names = tuple(name for name in IMPLIED if name not in given.names)
    lower = jnp.concatenate([given.lower, jnp.array([IMPLIED[name][0] for name in names])])
    upper = jnp.concatenate([given.upper, jnp.array([IMPLIED[name][1] for name in names])])
    return eqx.tree_at(lambda s: s.constraints, study, Limits(given.names + names, lower, upper))


def _starting_points(study: Study) -> tuple[Array, Scales, int]:
    """Points of the unit box to start from, scales, and the number of scaled constraints.

    Designs that run come first, before all the study's own drive if it does. Scales are the
    ranges over the box, as the quasi-random designs show them.
    """
    bounds = study.variables
    own = np.array([float(value_of(study.drive, name)) for name in bounds.names])
    lower, upper = np.asarray(bounds.lower), np.asarray(bounds.upper)
    own = np.clip((own - lower) / (upper - lower), 0.0, 1.0)
    sampler = qmc.Sobol(len(own), rng=study.seed)
    count = CANDIDATES * study.starts
    drawn = sampler.random_base2(int(np.ceil(np.log2(count))))[:count]
    points = np.concatenate([own[None], drawn])
    valid, objective, measured = jax.device_get(
        quickly_compiled(_survey)(study, jnp.asarray(points))
    )
    # Stable: the study's own drive stays first if it runs, and shapes stay the same if few do.
    order = np.argsort(~valid, kind="stable")[: study.starts]
    scales = Scales(_spread(objective[valid]), jnp.stack([_spread(m[valid]) for m in measured]))
    return jnp.asarray(points[order]), scales, 2 * sum(m.shape[1] for m in measured)


def _spread(values: np.ndarray) -> Float[Array, ""]:
    """How far a quantity (or the part of it that moves most) ranges over most of the designs."""
    if not len(values):
        return jnp.ones(())
    low, high = np.quantile(values, [0.1, 0.9], axis=0)
    return jnp.asarray(max(np.max(high - low), 1e-3 * np.max(np.abs(values)), 1e-12))


def _survey(study: Study, points):
    """Which designs run, their objectives and their constrained quantities."""

    def look(x):
        drive = _drive_at(study, x)
        answers = Answers(drive, study.point, steady_state(drive, study.point, throw=False))
        measured = _measured(study, answers)
        return answers.found(), *measured

    return jax.vmap(look)(points)


def _step(study: Study, scales: Scales, states: Iterate) -> Iterate:
    return jax.vmap(lambda s: outer_step(lambda x: _evaluation(study, scales, x), s))(states)


def _report(study: Study, asked: int, scales: Scales, states: Iterate) -> Design:
    feasible = states.valid & (states.violation <= FEASIBLE)
    optimal = feasible & states.done
    if optimal.any():
        result, rank = RESULTS.successful, np.where(optimal, states.objective, np.inf)
    elif feasible.any():
        result, rank = RESULTS.optimum_not_reached, np.where(feasible, states.objective, np.inf)
    elif states.valid.any():
        result, rank = (
            RESULTS.constraints_infeasible,
            np.where(states.valid, states.violation, np.inf),
        )
    else:
        result, rank = RESULTS.no_starting_design, states.violation
    best = int(np.argmin(rank))
    size = float(scales.objective)
    starts = tuple(
        StartReport(float(f) * size if v else None, _ending(v, ok, d))
        for f, v, ok, d in zip(states.objective, states.valid, feasible, states.done, strict=True)
    )
    x = to_unit(jnp.asarray(states.z[best]))
    drive = _drive_at(study, x)
    steady, final, measured = _run(study, drive)
    own, initial, _ = _run(study, study.drive)
    # Away from an optimum a multiplier is only what the search has come to.
    prices = np.asarray(states.multipliers[best]) * size if optimal.any() else None
    return Design(
        drive=drive,
        steady=steady,
        before=own,
        values=_values(study, x),
        initial=initial if succeeded(own.result) else None,
        final=final if succeeded(steady.result) else None,
        constraints=_constraint_reports(study, asked, scales, measured, prices),
        starts=starts,
        result=result,
    )


def _run(study: Study, drive: Drive) -> tuple[SteadyState, float, list[np.ndarray]]:
    """One drive's steady state, objective and constrained quantities."""
    steady, objective, measured = quickly_compiled(_run_one)(study, drive)
    return steady, float(objective), [np.asarray(values) for values in measured]


def _run_one(study: Study, drive: Drive):
    steady = steady_state(drive, study.point, throw=False)
    return steady, *_measured(study, Answers(drive, study.point, steady))


def _ending(valid: bool, feasible: bool, done: bool) -> str:
    if not valid:
        return "no drive that runs"
    if not feasible:
        return "infeasible"
    return "optimal" if done else "not converged"


def _values(study: Study, x) -> dict[str, float]:
    bounds = study.variables
    values = np.asarray(bounds.lower + x * (bounds.upper - bounds.lower))
    return dict(zip(bounds.names, map(float, values), strict=True))


def _constraint_reports(
    study: Study,
    asked: int,
    scales: Scales,
    measured: list[np.ndarray],
    multipliers: np.ndarray | None,
) -> tuple[ConstraintReport, ...]:
    reports, place = [], 0
    for i, name in enumerate(study.constraints.names):
        values = measured[i]
        low, high = float(study.constraints.lower[i]), float(study.constraints.upper[i])
        scale, parts = float(scales.constraints[i]), len(values)
        price = None
        if multipliers is not None:
            of_lower, of_upper = np.split(multipliers[place : place + 2 * parts], 2)
            price = float(of_lower.sum() - of_upper.sum()) / scale
        place += 2 * parts
        gap_low, gap_high = float(values.min()) - low, high - float(values.max())
        reports.append(
            ConstraintReport(
                quantity=name,
                value=float(values.min() if gap_low <= gap_high else values.max()),
                lower=low if np.isfinite(low) else None,
                upper=high if np.isfinite(high) else None,
                multiplier=price,
                active=bool(min(gap_low, gap_high) <= ACTIVE * scale),
                violation=max(0.0, -min(gap_low, gap_high) - FEASIBLE * scale),
                implied=i >= asked,
            )
        )
    return tuple(reports)
