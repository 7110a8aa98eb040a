"""Scattered numbers and the functions that they scatter: samples, moments, indices.

Knows no drives. A function takes the numbers [numbers] and returns a number or an array of them.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtri
from jaxtyping import Array, Float

from beltjax.drive.components import as_real, concrete

from ..exploration.samples import require_seed, sobol

# Points of a Sobol sequence are multiples of 2^-30 from 0 on: half a step keeps them inside.
_HALF_STEP = 2.0**-31
MOST_POINTS = 2**24  # all of a sample is held in memory, several times over


class Normal(eqx.Module):
    """A number scattered normally about its nominal value."""

    deviation: Float[Array, ""] = eqx.field(converter=as_real)  # standard, in the number's SI unit

    def __check_init__(self):
        _require_not_negative("Normal.deviation", self.deviation)

    @property
    def standard(self) -> Float[Array, ""]:
        """Standard deviation."""
        return self.deviation

    def at(self, points: Array) -> Array:
        """Deviations from the nominal value at probabilities in (0, 1)."""
        return self.deviation * ndtri(points)


class Uniform(eqx.Module):
    """A number anywhere within a tolerance of its nominal value, equally likely."""

    half_width: Float[Array, ""] = eqx.field(converter=as_real)  # in the number's SI unit

    def __check_init__(self):
        _require_not_negative("Uniform.half_width", self.half_width)

    @property
    def standard(self) -> Float[Array, ""]:
        """Standard deviation."""
        return self.half_width / jnp.sqrt(3.0)

    def at(self, points: Array) -> Array:
        """Deviations from the nominal value at probabilities in (0, 1)."""
        return self.half_width * (2 * points - 1)


def _require_not_negative(what: str, size: Array) -> None:
    known = concrete(size)
    if known is not None and not (np.isfinite(known) and known >= 0):
        raise ValueError(f"{what}: found {known}; give a size, 0 or more.")


Tolerance = Normal | Uniform


class LinearMoments(NamedTuple):
    """First-order second moments: mean and standard deviation of a linearized function."""

    mean: Float[Array, "*parts"]  # the function at the nominal numbers
    deviation: Float[Array, "*parts"]
    parts: Float[Array, "*parts numbers"]  # slope times standard deviation, for each number


class Indices(NamedTuple):
    """Sobol's indices of one function, for each number, with half-widths of 95 % confidence."""

    first: Float[np.ndarray, " numbers"]  # share of the variance that a number has alone
    total: Float[np.ndarray, " numbers"]  # with all of its interactions
    first_error: Float[np.ndarray, " numbers"]
    total_error: Float[np.ndarray, " numbers"]


def standard_deviations(tolerances: Sequence[Tolerance]) -> Float[Array, " numbers"]:
    """Standard deviation of each number."""
    return jnp.stack([tolerance.standard for tolerance in tolerances])


def scattered(
    tolerances: Sequence[Tolerance], points: Float[Array | np.ndarray, "points numbers"]
) -> Float[Array, "points numbers"]:
    """Deviations of all numbers at points of the unit cube."""
    columns = zip(tolerances, jnp.asarray(points).T, strict=True)
    return jnp.stack([tolerance.at(column) for tolerance, column in columns], axis=1)


def sample_points(numbers: int, count: int, seed: int) -> Float[np.ndarray, "count numbers"]:
    """Scrambled Sobol points inside the unit cube; balanced where `count` is a power of two.

    Raises `ValueError` for more than 2^24 of them and for a seed below 0.
    """
    require_sample("samples", count, numbers, seed)
    (points,) = sobol(numbers, seed, [(0, count)])
    return points + _HALF_STEP


def require_sample(name: str, count: int, numbers: int, seed: int) -> None:
    """Raise `ValueError` for a sample that memory does not hold, and for a seed below 0."""
    if count > MOST_POINTS:
        size = f"{8e-9 * count * numbers:.4g} GB for each copy of its numbers"
        raise ValueError(f"{name}: found {count}, {size}; give at most 2^24 = {MOST_POINTS}.")
    require_seed(seed)


def linear_moments(
    function: Callable[[Array], Array],
    nominal: Float[Array, " numbers"],
    tolerances: Sequence[Tolerance],
) -> LinearMoments:
    """Mean and standard deviation of `function` by its exact slopes at the nominal numbers.

    They are exact for functions that are linear over the tolerances; a sample shows the effect of
    curvature. Numbers scatter independently. The result can be differentiated.

    Args:
        function: function of the numbers, of shape [numbers], which returns an array.
        nominal: the nominal numbers.
        tolerances: `Normal` or `Uniform` of each number, in the same order.

    Returns:
        Mean and deviation, of the shape of the function's value, and the part of each number.
    """
    steps = jnp.diag(standard_deviations(tolerances))
    mean, push = jax.linearize(function, nominal)
    parts = jnp.moveaxis(jax.vmap(push)(steps), 0, -1)
    return LinearMoments(mean, norm(parts), parts)


def norm(parts: Array) -> Array:
    """Root of the sum of squares, whose slope at zero is zero rather than nan."""
    square = jnp.sum(parts**2, axis=-1)
    safe = jnp.where(square > 0, square, 1.0)
    return jnp.where(square > 0, jnp.sqrt(safe), 0.0)


def sobol_indices(
    evaluate: Callable[[np.ndarray], np.ndarray],
    nominal: Float[np.ndarray, " numbers"],
    tolerances: Mapping[str, Tolerance],
    *,
    count: int = 1024,
    seed: int = 0,
) -> list[Indices]:
    """First-order and total Sobol indices (Saltelli's estimators, by SALib) of every output.

    Args:
        evaluate: function that takes [points, numbers] and returns [points, outputs]. It is called
            with `count` (numbers + 2) points.
        nominal: the nominal numbers.
        tolerances: `Normal` or `Uniform` by the numbers' names, in the order of `nominal`.
        count: size of the sample's parts, which should be a power of two.
        seed: of the sample, 0 or more.

    Returns:
        The indices of each output, of shape [numbers], with their confidence.

    Raises:
        ValueError: SALib is missing, an output is not finite, there are more than 2^24 points, or
            the seed is below 0.
    """
    require_sample("count", count * (len(tolerances) + 2), len(tolerances), seed)
    try:
        import SALib.analyze.sobol as analyzer
        import SALib.sample.sobol as sampler
    except ImportError as error:
        message = "SALib is not installed: pip install 'beltjax[robust]'"
        raise ValueError(message) from error
    names = list(tolerances)
    problem = {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)}
    with warnings.catch_warnings():  # about pandas and powers of two
        warnings.simplefilter("ignore")
        points = sampler.sample(problem, count, calc_second_order=False, seed=seed)
        inside = np.clip(points, _HALF_STEP, 1 - _HALF_STEP)
        outputs = evaluate(nominal + np.asarray(scattered(list(tolerances.values()), inside)))
        if not np.isfinite(outputs).all():
            bad = int((~np.isfinite(outputs).all(axis=1)).sum())
            raise ValueError(f"{bad} of {len(outputs)} points failed; narrow the tolerances.")
        return [_indices(analyzer, problem, column, seed) for column in outputs.T]


def _indices(analyzer: Any, problem: dict[str, Any], values: np.ndarray, seed: int) -> Indices:
    if np.ptp(values) == 0:  # of nothing there are no shares
        return Indices(*np.zeros((4, problem["num_vars"])))
    found = analyzer.analyze(problem, values, calc_second_order=False, seed=seed)
    return Indices(*(np.asarray(found[key]) for key in ("S1", "ST", "S1_conf", "ST_conf")))
