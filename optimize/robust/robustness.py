"""Quantities under tolerances: their scatter, and objectives that count it."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from beltjax.compiling.quick import quickly_compiled, usual_promotion
from beltjax.drive.numbers import number_value
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive

from ..exploration.batches import FEW, Question, in_batches
from ..quantities import find_quantity
from .distributions import (
    Indices,
    LinearMoments,
    Tolerance,
    linear_moments,
    sample_points,
    scattered,
    sobol_indices,
)
from .scatter import MeanPlus, Measure, WorstQuantile

_BATCH = 4096
_NONE = np.float64(np.nan)
Tolerances = Mapping[str, Tolerance]


class Spread(NamedTuple):
    """The scatter of one quantity, SI; a quantity of many parts counts as its least part."""

    unit: str
    nominal: float
    mean: float
    deviation: float  # standard
    low: float  # below this lies the share 1 - quantile
    high: float  # and above this, too
    linear_deviation: float  # by exact slopes at the nominal drive, for comparison
    shares: dict[str, float]  # of that variance, by tolerance


class Robustness(NamedTuple):
    """The scatter of a drive's quantities under tolerances."""

    spreads: dict[str, Spread]
    quantile: float
    samples: int
    failed: int  # samples in which no such drive runs; they are left out


class RobustValue(NamedTuple):
    """A robust objective and its parts; `value` is what to minimize."""

    value: Float[Array, ""]
    mean: Float[Array, ""]
    deviation: Float[Array, ""]
    quantile: Float[Array | np.floating, ""]  # the sample's own, not smoothed; nan for `MeanPlus`
    failed: Float[Array, ""]  # share of the sample that does not run and is left out


@usual_promotion
def robustness(
    drive: Drive,
    point: OperatingPoint,
    quantities: Sequence[str],
    tolerances: Tolerances,
    *,
    samples: int = 4096,
    seed: int = 0,
    quantile: float = 0.99,
) -> Robustness:
    """Mean, standard deviation and quantiles of quantities under independent tolerances.

    They come from quasi-Monte Carlo (scrambled Sobol points), and the standard deviation beside it
    from exact slopes. docs/robust.md.

    Args:
        drive: the nominal drive.
        point: its speeds and torques.
        quantities: names of quantities, as studies use them.
        tolerances: `Normal` or `Uniform` by the numbers' keys in the drive file.
        samples: number of drives, at least 2, which should be a power of two.
        seed: of the sample, 0 or more.
        quantile: upper quantile, between 0.5 and 1; the lower one is 1 less that.

    Returns:
        The scatter of each quantity [SI], and the number of drives that do not run.

    Raises:
        ValueError: there is no such quantity or number, the drive lacks what a quantity needs, an
            argument is out of range, the nominal drive does not run, or fewer than two drives of
            the sample run.
    """
    if not 0.5 < quantile < 1:
        raise ValueError(f"quantile: found {quantile:g}; give more than 0.5 and less than 1.")
    if samples < 2:
        raise ValueError(f"samples: found {samples}; give at least 2, better a power of two.")
    question = _question(drive, point, quantities, tolerances)
    points = sample_points(len(tolerances), samples, seed)
    linear = quickly_compiled(_linear)(question, tuple(tolerances.values()))
    if not linear.mean[-1]:
        raise ValueError("the nominal drive does not run; `analyze` says why.")
    scatter = scattered(list(tolerances.values()), points)
    values = _evaluated(question, np.asarray(_nominal(question) + scatter))
    found = values[np.isfinite(values).all(axis=1)]
    if len(found) < 2:
        raise ValueError("hardly any drive within the tolerances runs; narrow them.")
    spreads = {
        name: _spread(
            question, name, found[:, i], jax.tree.map(lambda x, i=i: x[i], linear), quantile
        )
        for i, name in enumerate(quantities)
    }
    return Robustness(spreads, quantile, samples, samples - len(found))


@usual_promotion
def sensitivity_indices(
    drive: Drive,
    point: OperatingPoint,
    quantities: Sequence[str],
    tolerances: Tolerances,
    *,
    count: int = 1024,
    seed: int = 0,
) -> dict[str, Indices]:
    """Sobol's indices of each quantity: which tolerance causes how much of its variance.

    It evaluates `count` (tolerances + 2) drives. docs/robust.md.

    Args:
        drive: the nominal drive.
        point: its speeds and torques.
        quantities: names of quantities, as studies use them.
        tolerances: `Normal` or `Uniform` by the numbers' keys in the drive file.
        count: size of the sample's parts, which should be a power of two.
        seed: of the sample, 0 or more.

    Returns:
        The indices of each quantity, of shape [tolerances], with their confidence.

    Raises:
        ValueError: SALib is missing, there is no such quantity or number, the drive lacks what a
            quantity needs, an argument is out of range, or a drive within the tolerances does not
            run.
    """
    question = _question(drive, point, quantities, tolerances)
    nominal = np.asarray(_nominal(question))
    found = sobol_indices(
        lambda values: _evaluated(question, values), nominal, tolerances, count=count, seed=seed
    )
    return dict(zip(quantities, found, strict=True))


@usual_promotion
def robust_value(
    drive: Drive,
    point: OperatingPoint,
    name: str,
    tolerances: Tolerances,
    measure: Measure | None = None,
    *,
    samples: int = 0,
    seed: int = 0,
) -> RobustValue:
    """A quantity that counts its own scatter, differentiable by every number of the drive.

    It works under `jit`, `grad` and `vmap`. Where `failed` is not 0, some drives within the
    tolerances do not run (without a sample: the drive itself). docs/robust.md.

    Args:
        drive: the nominal drive.
        point: its speeds and torques.
        name: name of the quantity, as studies use it.
        tolerances: `Normal` or `Uniform` by the numbers' keys in the drive file.
        measure: `MeanPlus(3)` unless given, or `WorstQuantile`.
        samples: number of drives of a fixed quasi-random sample, from which the measure is taken;
            with 0, `MeanPlus` uses exact slopes.
        seed: of the sample, 0 or more.

    Returns:
        The value to minimize and its parts, in the quantity's SI unit.

    Raises:
        ValueError: there is no such quantity or number, the drive lacks what the quantity needs,
            tolerances are missing, or a quantile is given without samples.
    """
    measure = MeanPlus() if measure is None else measure
    question = _question(drive, point, (name,), tolerances)
    kinds = tuple(tolerances.values())
    if samples:
        return _sampled_value(question, kinds, measure, sample_points(len(kinds), samples, seed))
    if not isinstance(measure, MeanPlus):
        raise ValueError("samples: a quantile needs a sample; give a power of two, such as 256.")
    linear = _linear(question, kinds)
    (mean, runs), deviation = linear.mean, linear.deviation[0]
    value = mean + measure.factor * deviation
    return RobustValue(value, mean, deviation, _NONE, 1 - runs)


def _sampled_value(
    question: Question, kinds: tuple[Tolerance, ...], measure: Measure, points: np.ndarray
) -> RobustValue:
    numbers = _nominal(question) + scattered(kinds, jnp.asarray(points))
    values, runs = jax.vmap(lambda one: _measured(question, one))(numbers).T
    # A drive that does not run counts as the mean of the others.
    count = jnp.maximum(jnp.sum(runs), 1.0)
    mean = jnp.sum(jnp.where(runs > 0, values, 0.0)) / count
    values = jnp.where(runs > 0, values, mean)
    deviation = jnp.sqrt(jnp.sum((values - mean) ** 2) / jnp.maximum(count - 1, 1.0) + 1e-300)
    if isinstance(measure, WorstQuantile):
        value = measure.of_sample(values)
        own = jax.lax.stop_gradient(jnp.quantile(values, measure.quantile))
    else:
        value, own = mean + measure.factor * deviation, _NONE
    return RobustValue(value, mean, deviation, own, 1 - jnp.mean(runs))


def _question(
    drive: Drive, point: OperatingPoint, quantities: Sequence[str], tolerances: Tolerances
) -> Question:
    if not tolerances:
        raise ValueError("tolerances: give at least one number its tolerance.")
    return Question(drive, point, tuple(tolerances), tuple(quantities))


def _nominal(question: Question) -> Float[Array, " numbers"]:
    drive, point = question.drive, question.point
    return jnp.stack([number_value(drive, point, name) for name in question.names])


def _measured(question: Question, numbers: Array) -> Float[Array, " quantities+1"]:
    """The quantities of one drive, the least of their parts; and 1 where it runs, else 0."""
    of = question.analyses(numbers)
    found = [jnp.min(find_quantity(name, of.drive).measure(of)) for name in question.quantities]
    return jnp.stack([*found, of.all_found().astype(float)])


def _linear(question: Question, kinds: tuple[Tolerance, ...]) -> LinearMoments:
    """Moments of what `_measured` measures, by slopes."""
    return linear_moments(lambda x: _measured(question, x), _nominal(question), kinds)


def _evaluated(question: Question, values: np.ndarray) -> Float[np.ndarray, "points quantities"]:
    """The quantities of many drives, the least of their parts; nan where one does not run."""
    size = min(_BATCH, len(values))
    batches = ((i, values[i : i + size]) for i in range(0, len(values), size))
    rows = []
    for _, columns in in_batches(question, batches, size, quick=len(values) <= FEW):
        parts = [columns[name] for name in question.quantities]
        rows.append(np.stack([part.reshape(len(part), -1).min(axis=1) for part in parts], axis=1))
    return np.concatenate(rows)


def _spread(
    question: Question, name: str, values: np.ndarray, linear: LinearMoments, quantile: float
) -> Spread:
    low, high = np.quantile(values, [1 - quantile, quantile])
    squares = np.asarray(linear.parts) ** 2
    whole = squares.sum() or 1.0
    return Spread(
        unit=find_quantity(name, question.drive).unit,
        nominal=float(linear.mean),
        mean=float(values.mean()),
        deviation=float(values.std(ddof=1)),
        low=float(low),
        high=float(high),
        linear_deviation=float(linear.deviation),
        shares=dict(zip(question.names, (squares / whole).tolist(), strict=True)),
    )
