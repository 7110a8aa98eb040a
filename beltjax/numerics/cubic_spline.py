"""Cubic spline through data: twice continuously differentiable.

Slopes at the ends are those of the cubic through the four data there, so that the error is of
fourth order up to the ends (C. de Boor, A Practical Guide to Splines, 2001, chapter IV).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Scalar = Float[Array, ""]
Points = Float[Array, " points"]

FEWEST = 4  # data


class CubicSpline(NamedTuple):
    """A spline, by its values and slopes at the data."""

    x: Points
    y: Points
    slopes: Points
    integrals: Points  # from the first of the data

    def at(self, x: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
        """Integral from the first of the data, value, slope and second derivative."""
        k = jnp.clip(jnp.searchsorted(self.x, x, side="right") - 1, 0, len(self.x) - 2)
        h = self.x[k + 1] - self.x[k]
        a, b = self.y[k], self.slopes[k]
        c, d = _cubic(self.y[k + 1] - a, b, self.slopes[k + 1], h)
        t = x - self.x[k]
        integral = self.integrals[k] + t * (a + t * (b / 2 + t * (c / 3 + t * d / 4)))
        value = a + t * (b + t * (c + t * d))
        return integral, value, b + t * (2 * c + 3 * t * d), 2 * c + 6 * t * d


def _cubic(rise: Array, start: Array, end: Array, h: Array) -> tuple[Array, Array]:
    """Coefficients of t^2 and t^3 of a cubic by its rise and its slopes at both ends."""
    return (3 * rise / h - 2 * start - end) / h, (start + end - 2 * rise / h) / h**2


def cubic_spline(x: Points, y: Points) -> CubicSpline:
    """The spline through at least four data of increasing x; differentiable by both."""
    h = jnp.diff(x)
    rise = jnp.diff(y) / h
    first = _end_slope(x[:4], y[:4])
    last = _end_slope(x[:-5:-1], y[:-5:-1])
    zero, one = jnp.zeros(1), jnp.ones(1)
    right = 3 * (h[1:] * rise[:-1] + h[:-1] * rise[1:])
    slopes = jax.lax.linalg.tridiagonal_solve(
        jnp.concatenate([zero, h[1:], zero]),
        jnp.concatenate([one, 2 * (h[1:] + h[:-1]), one]),
        jnp.concatenate([zero, h[:-1], zero]),
        jnp.concatenate([first[None], right, last[None]])[:, None],
    )[:, 0]
    c, d = _cubic(jnp.diff(y), slopes[:-1], slopes[1:], h)
    pieces = h * (y[:-1] + h * (slopes[:-1] / 2 + h * (c / 3 + h * d / 4)))
    return CubicSpline(x, y, slopes, jnp.concatenate([zero, jnp.cumsum(pieces)]))


def _end_slope(x: Float[Array, "4"], y: Float[Array, "4"]) -> Scalar:
    """Slope at the first of four data of the cubic through them, by Newton's differences."""
    first = jnp.diff(y) / jnp.diff(x)
    second = jnp.diff(first) / (x[2:] - x[:-2])
    third = (second[1] - second[0]) / (x[3] - x[0])
    near = x[0] - x[1]
    return first[0] + second[0] * near + third * near * (x[0] - x[2])
