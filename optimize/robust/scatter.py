"""Measures of a scattered quantity: its mean and some deviations, or a quantile.

Knows no drives. Limits and objectives see the unfavorable side of what tolerances make of a value.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, PyTree

from .distributions import Tolerance, linear_moments, norm, sample_points, scattered

_HALVINGS = 60


class MeanPlus(eqx.Module):
    """The mean and `factor` standard deviations, by slopes or from a sample."""

    factor: float = 3.0

    def __str__(self):
        return f"mean and {self.factor:g} standard deviations"

    @property
    def opposite(self) -> "MeanPlus":
        """The measure on the other side of the mean."""
        return MeanPlus(-self.factor)

    def of_sample(self, values: Float[Array, " points"]) -> Float[Array, ""]:
        """The mean and the deviations of a sample, with derivatives."""
        mean = jnp.mean(values)
        deviation = norm(values - mean) / np.sqrt(max(len(values) - 1, 1))
        return mean + self.factor * deviation


class WorstQuantile(eqx.Module):
    """A quantile of a sample, smoothed as `smooth_quantile` says so that it has derivatives."""

    quantile: float = 0.99
    sharpness: float = 20.0

    def __check_init__(self):
        if not (0 < self.quantile < 1 and self.sharpness > 0):
            found = f"{self.quantile:g} and {self.sharpness:g}"
            raise ValueError(f"WorstQuantile: found {found}; give 0 < quantile < 1, sharpness > 0.")

    def __str__(self):
        return f"quantile {self.quantile:g}"

    @property
    def opposite(self) -> "WorstQuantile":
        """The quantile that lies as far from the other end."""
        return WorstQuantile(1 - self.quantile, self.sharpness)

    def of_sample(self, values: Float[Array, " points"]) -> Float[Array, ""]:
        """The smoothed quantile of a sample, with derivatives."""
        return smooth_quantile(values, self.quantile, self.sharpness)


Measure = MeanPlus | WorstQuantile


class Extremes(NamedTuple):
    """A function's values as limits see them that its scatter must not cross."""

    least: PyTree  # what counts against a lower limit
    greatest: PyTree  # against an upper limit, and of what is minimized
    runs: Bool[Array, ""]  # whether the function is valid at all points


class Scatter(eqx.Module):
    """Independent tolerances of numbers, and what counts of what they do.

    By exact slopes, or with `samples` of a quasi-random sample that stays the same from call to
    call. Raises `ValueError` for a quantile without samples and for no tolerances.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    tolerances: tuple[Tolerance, ...]
    measure: Measure = MeanPlus()
    samples: int = eqx.field(static=True, default=0)

    def __check_init__(self):
        if not self.names:
            raise ValueError("tolerances: give at least one number its tolerance.")
        if isinstance(self.measure, WorstQuantile) and not self.samples:
            raise ValueError(
                "samples: a quantile needs a sample; give a power of two, such as 256."
            )

    def __str__(self):
        return f"{self.measure}, " + (f"of {self.samples} drives" if self.samples else "by slopes")

    def extremes(
        self,
        function: Callable[[Array], tuple[PyTree, Bool[Array, ""]]],
        nominal: Float[Array, " numbers"],
    ) -> Extremes:
        """The extremes of a function that returns values and whether they are valid."""
        shapes, _ = eqx.filter_eval_shape(function, nominal)
        _, unravel = ravel_pytree(jax.tree.map(lambda s: jnp.zeros(s.shape), shapes))

        def flat(numbers: Array) -> Array:
            values, runs = function(numbers)
            return jnp.append(ravel_pytree(values)[0], runs.astype(float))

        if self.samples:
            points = sample_points(len(self.names), self.samples, 0)
            found = jax.vmap(flat)(nominal + scattered(self.tolerances, points))
            sides = self.measure.opposite, self.measure
            columns, runs = found[:, :-1], jnp.all(found[:, -1] > 0)
            low, high = (jax.vmap(side.of_sample, in_axes=1)(columns) for side in sides)
        else:
            assert isinstance(self.measure, MeanPlus)  # as __check_init__ holds
            linear = linear_moments(flat, nominal, self.tolerances)
            mean, away = linear.mean[:-1], self.measure.factor * linear.deviation[:-1]
            low, high, runs = mean - away, mean + away, linear.mean[-1] > 0
        return Extremes(unravel(low), unravel(high), runs)


def smooth_quantile(
    values: Float[Array, " points"], quantile: float, sharpness: float = 20.0
) -> Float[Array, ""]:
    """A differentiable quantile of a sample: where a smoothed distribution function is `quantile`.

    Each step of the sample's distribution is smoothed to a logistic function whose width is the
    sample's standard deviation over `sharpness`: as that grows, the quantile itself is approached
    and its slope rests on fewer points. The smoothing moves the quantile outwards, for a normal
    distribution by about 1.6 z / sharpness^2 standard deviations, where z is its distance from the
    mean in standard deviations.

    Args:
        values: the sample, of shape [points].
        quantile: between 0 and 1.
        sharpness: standard deviation of the sample over the width of a smoothed step.

    Returns:
        The quantile, a number.
    """
    deviation = norm(values - jnp.mean(values)) / jnp.sqrt(len(values))
    size = jnp.maximum(deviation, 1e-12 * jnp.max(jnp.abs(values)))
    width = jnp.where(size > 0, size, 1.0) / sharpness

    def excess(at: Array, values: Array, width: Array) -> Array:
        return jnp.mean(jax.nn.sigmoid((at - values) / width)) - quantile

    fixed, fixed_width = jax.lax.stop_gradient((values, width))
    reach = 50 * fixed_width  # where the logistic function has long ended

    def halve(_: Any, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = (low + high) / 2
        above = excess(middle, fixed, fixed_width) > 0
        return jnp.where(above, low, middle), jnp.where(above, middle, high)

    ends = jnp.min(fixed) - reach, jnp.max(fixed) + reach
    low, high = jax.lax.fori_loop(0, _HALVINGS, halve, ends)
    root = (low + high) / 2
    slope = jax.grad(excess)(root, fixed, fixed_width)
    # One step of Newton's method changes no value and carries the implicit derivative.
    return root - excess(root, values, width) / slope
