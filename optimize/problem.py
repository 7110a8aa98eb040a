"""A study as a scaled problem in the unit box: minimize f(x) subject to g(x) <= 0, 0 <= x <= 1."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.stats import qmc

from beltjax.analysis.steady import steady_state
from beltjax.compiling.quick import quickly_compiled
from beltjax.drive.numbers import number_value, value_of, with_numbers, with_values
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive

from .drive_analyses import DriveAnalyses
from .quantities import find_quantity
from .search.augmented_lagrangian import Evaluation
from .study import Limits, Study, Ties, split_name

CANDIDATES = 8  # random designs drawn for each start; the first ones that run are used
# What every drive that can be built must meet, whether the study limits it or not, a little
# inside the edges beyond which there is no drive to evaluate: quantity, least, greatest.
IMPLIED = {
    "clearance": (0.0, np.inf),
    "span_lengths": (1e-3, np.inf),
    "wraps": (np.radians(1.0), np.radians(268.0)),
    "tightness": (0.01, np.inf),
}

Unit = Float[Array, " variables"]


class ProblemScales(NamedTuple):
    """The units in which the optimizer measures objective and constrained quantities."""

    objective: Float[Array, ""]
    constraints: Float[Array, " constraints"]


class Values(NamedTuple):
    """A drive's objective and the parts of each constrained quantity, SI."""

    objective: Float[Array, ""]  # smooth
    worst: Float[Array, ""]  # the same with the true maximum over the operating points
    parts: list[Array]


class Measured(NamedTuple):
    """A design's objective and the parts of each constrained quantity, SI, tolerances counted."""

    objective: Float[Array, ""]  # smooth
    worst: Float[Array, ""]  # the same with the true maximum over the operating points
    least: list[Array]  # parts as lower limits see them
    greatest: list[Array]  # as upper limits see them
    found: Bool[Array, ""]  # whether all analyses have answers


class ProblemDerivatives(NamedTuple):
    """An `Evaluation` and its derivatives, of the constraints that have a limit."""

    objective: Float[Array, ""]
    constraints: Float[Array, " rows"]
    of_objective: Unit
    of_constraints: Float[Array, "rows variables"]
    valid: Bool[Array, ""]


def drive_at(study: Study, x: Unit) -> Drive:
    """The design at `x` in the unit box."""
    values = dict(zip(study.variables.names, _out_of_box(study, x), strict=True))
    return with_values(study.drive, with_tied(study.ties, values))


def with_tied(ties: Ties | None, values: Mapping[str, Any]) -> dict[str, Any]:
    """Values of variables [SI], and of the numbers that follow from them."""
    found = dict(values)
    if ties is not None:
        for name, to, factor, offset in zip(
            ties.names, ties.to, ties.factors, ties.offsets, strict=True
        ):
            found[name] = factor * values[to] + offset
    return found


def place_of(study: Study, values: dict[str, float]) -> np.ndarray:
    """Place of named values (SI) by the unit box, be they inside of it or not."""
    lower, upper = np.asarray(study.variables.lower), np.asarray(study.variables.upper)
    own = np.array([values[name] for name in study.variables.names])
    return (own - lower) / (upper - lower)


def in_box(study: Study, values: dict[str, float]) -> np.ndarray:
    """Place in the unit box of named values (SI), moved inside where they are not.

    Raises `ValueError` for a variable without a value, or with one that is not finite.
    """
    for name in study.variables.names:
        if name not in values or not math.isfinite(values[name]):
            found = f"found {values[name]}" if name in values else "is missing"
            raise ValueError(f"warm: {name}: {found}; give each variable a finite value")
    return np.clip(place_of(study, values), 0.0, 1.0)


def own_values(study: Study) -> dict[str, float]:
    """The design variables of the study's own drive (SI)."""
    return {name: float(value_of(study.drive, name)) for name in study.variables.names}


def values_at(study: Study, x: Array | np.ndarray) -> dict[str, float]:
    """The design variables, and what is tied to them, at `x` in the unit box (SI)."""
    own = dict(zip(study.variables.names, np.asarray(_out_of_box(study, x)), strict=True))
    return {name: float(value) for name, value in with_tied(study.ties, own).items()}


def _out_of_box(study: Study, x: Array | np.ndarray) -> Array:
    bounds = study.variables
    return bounds.lower + x * (bounds.upper - bounds.lower)


def with_implied_constraints(study: Study) -> Study:
    """`study`, with what every drive that can be built must meet added to its constraints."""
    given = study.constraints
    names = tuple(name for name in IMPLIED if name not in given.names)
    lower = jnp.concatenate([given.lower, jnp.array([IMPLIED[name][0] for name in names])])
    upper = jnp.concatenate([given.upper, jnp.array([IMPLIED[name][1] for name in names])])
    return eqx.tree_at(lambda s: s.constraints, study, Limits(given.names + names, lower, upper))


def measured(study: Study, drive: Drive) -> Measured:
    """The objective and constrained quantities of a drive, at all points and for all tolerances."""
    scatter = study.scatter
    if scatter is None:
        values, found = _values(study, drive)
        return Measured(values.objective, values.worst, values.parts, values.parts, found)

    def at(numbers: Array) -> tuple[Values, Bool[Array, ""]]:
        changed = dict(zip(scatter.names, numbers, strict=True))
        return _values(study, with_numbers(drive, study.point, changed)[0])

    nominal = jnp.stack([number_value(drive, study.point, name) for name in scatter.names])
    least, greatest, found = scatter.extremes(at, nominal)
    return Measured(greatest.objective, greatest.worst, least.parts, greatest.parts, found)


def _values(study: Study, drive: Drive) -> tuple[Values, Bool[Array, ""]]:
    cases = study.operating
    names = sorted({split_name(name)[0] for name in (*study.objective, *study.constraints.names)})

    def at(point: OperatingPoint) -> tuple[dict[str, Array], Bool[Array, ""]]:
        analyses = DriveAnalyses(drive, point, steady_state(drive, point, throw=False))
        values = {name: find_quantity(name, drive).measure(analyses) for name in names}
        return values, analyses.all_found()

    values, found = jax.vmap(at)(cases.points)

    def of(name: str) -> Array:
        base, where = split_name(name)
        return values[base][np.array(cases.places(where))].ravel()

    terms = [w * of(name) for w, name in zip(study.weights, study.objective, strict=True)]
    smooth = sum((soft_maximum(term, study.sharpness) for term in terms), jnp.zeros(()))
    worst = sum((jnp.max(term) for term in terms), jnp.zeros(()))
    return Values(smooth, worst, [of(name) for name in study.constraints.names]), jnp.all(found)


def soft_maximum(
    values: Float[Array, " k"], sharpness: float | Float[Array, ""]
) -> Float[Array, ""]:
    """A smooth largest value, too high by at most ln(k)/sharpness of the values' mean size."""
    if len(values) == 1:
        return values[0]
    square = jnp.mean(values**2)
    size = jnp.sqrt(jnp.where(square > 0, square, 1.0))
    return size / sharpness * jax.nn.logsumexp(sharpness * values / size)


def evaluation(study: Study, scales: ProblemScales, x: Unit) -> Evaluation:
    """Scaled objective and constraints of the design at `x`; a missing limit gives -inf."""
    at = measured(study, drive_at(study, x))
    limits, parts = study.constraints, []
    for least, greatest, low, high, scale in zip(
        at.least, at.greatest, limits.lower, limits.upper, scales.constraints, strict=True
    ):
        parts += [(low - least) / scale, (greatest - high) / scale]
    return Evaluation(at.objective / scales.objective, jnp.concatenate(parts), at.found)


def part_counts(study: Study) -> list[int]:
    """Count the parts of each constrained quantity."""
    shapes = eqx.filter_eval_shape(measured, study, study.drive)
    return [part.shape[0] for part in shapes.greatest]


def limited_rows(study: Study, parts: list[int]) -> np.ndarray:
    """Places of an `Evaluation`'s constraints that have a limit; `parts` of each quantity."""
    sides = [np.isfinite(np.asarray(side)) for side in (study.constraints.lower,
                                                        study.constraints.upper)]  # fmt: skip
    finite = [np.repeat(side[i], n) for i, n in enumerate(parts) for side in sides]
    return np.flatnonzero(np.concatenate(finite))


def derivatives(study: Study, scales: ProblemScales, rows: Array, x: Unit) -> ProblemDerivatives:
    """Exact first derivatives of the problem at one design, of its constraints at `rows`."""
    return quickly_compiled(_derivatives)(study.canonical, scales, rows, x)


def _derivatives(study: Study, scales: ProblemScales, rows: Array, x: Unit) -> ProblemDerivatives:
    def packed(x: Unit) -> tuple[Array, Array]:
        at = evaluation(study, scales, x)
        return jnp.append(at.constraints[rows], at.objective), at.valid

    # Forward: a design has fewer variables than limits.
    def push(direction: Unit) -> tuple[Array, Array, Array]:
        value, slope, valid = jax.jvp(packed, (x,), (direction,), has_aux=True)
        return value, slope, valid

    value, slope, valid = jax.vmap(push, out_axes=(None, -1, None))(jnp.eye(len(x)))
    return ProblemDerivatives(value[-1], value[:-1], slope[-1], slope[:-1], valid)


def run_measured(study: Study, drive: Drive) -> Measured:
    """`measured`, compiled, on the host."""
    return jax.device_get(quickly_compiled(measured)(study.canonical, drive))


class Starts(NamedTuple):
    """The designs at which searches begin, and the scales that a survey of designs gives."""

    points: Float[Array, "starts variables"]
    scales: ProblemScales
    parts: list[int]  # of each constrained quantity
    surveyed: int  # designs that were measured to find them


def starting_points(study: Study, warm: tuple[dict[str, float], ...] = ()) -> Starts:
    """Points of the unit box to start from, and scales.

    The `warm` ones come first, then the study's own drive, then quasi-random designs; of all,
    those that run before those that do not. ProblemScales are the ranges over the box, as the
    quasi-random designs show them.
    """
    own = [in_box(study, values) for values in (*warm, own_values(study))]
    sampler = qmc.Sobol(len(own[0]), rng=study.seed)
    count = CANDIDATES * study.starts
    drawn = sampler.random_base2(math.ceil(math.log2(count)))[:count]
    points = np.concatenate([own, drawn])
    found = jax.device_get(quickly_compiled(_survey)(study.canonical, jnp.asarray(points)))
    valid = found.found
    # Stable: the study's own drive stays first if it runs, and shapes stay the same if few do.
    order = np.argsort(~valid, kind="stable")[: study.starts]
    ranges = jnp.stack([_spread(part[valid]) for part in found.greatest])
    scales = ProblemScales(_spread(found.objective[valid]), ranges)
    return Starts(
        jnp.asarray(points[order]), scales, [part.shape[1] for part in found.greatest], len(points)
    )


def measured_at(study: Study, begin: Starts, points: np.ndarray) -> list[Measured]:
    """The measured quantities of some designs, by their places in the unit box.

    The program is the one that surveyed the starting points, whence as many designs are measured
    at once.
    """
    padded = np.resize(points, (max(begin.surveyed, len(points)), points.shape[1]))
    found = jax.device_get(quickly_compiled(_survey)(study.canonical, jnp.asarray(padded)))
    return [jax.tree.map(lambda x, k=k: x[k], found) for k in range(len(points))]


def _spread(values: np.ndarray) -> Float[Array, ""]:
    """Measure the range of a quantity, or of its part that moves most, over most designs."""
    if not len(values):
        return jnp.ones(())
    low, high = np.quantile(values, [0.1, 0.9], axis=0)
    return jnp.asarray(max(np.max(high - low), 1e-3 * np.max(np.abs(values)), 1e-12))


def _survey(study: Study, points: Array) -> Measured:
    return jax.vmap(lambda x: measured(study, drive_at(study, x)))(points)
