"""Monotone cubic interpolation (PCHIP): smooth, and between two data it does not leave them.

F. N. Fritsch and R. E. Carlson, SIAM J. Numer. Anal. 17 (1980) 238; slopes inside by F. N. Fritsch
and J. Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300, at the ends by three points, as in
C. Moler, Numerical Computing with MATLAB (2004), section 3.6.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float


def interpolated(
    at: Float[Array, ""], x: Float[Array, " points"], y: Float[Array, " points"]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Value and slope at `at` of the interpolant through at least two points of increasing x.

    Both are continuous, and JAX differentiates them by `at` and by the data. Data that neither
    rise nor fall over an interval are a kink of the interpolant as a function of the data. Outside
    of the data the first or last cubic goes on.
    """
    slopes = _slopes(x, y)
    k = jnp.clip(jnp.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    h = x[k + 1] - x[k]
    # Placeholders for failed lanes of a batch have points that coincide.
    h = jnp.where(h > 0, h, 1.0)
    t, rise = (at - x[k]) / h, (y[k + 1] - y[k]) / h
    start, end = slopes[k], slopes[k + 1]
    second, third = 3 * rise - 2 * start - end, start + end - 2 * rise
    value = y[k] + h * t * (start + t * (second + t * third))
    return value, start + t * (2 * second + 3 * t * third)


def _slopes(x: Float[Array, " points"], y: Float[Array, " points"]) -> Float[Array, " points"]:
    """Slopes of the interpolant at the points."""
    h = jnp.diff(x)
    h = jnp.where(h > 0, h, 1.0)
    rise = jnp.diff(y) / h
    if len(x) == 2:
        return jnp.broadcast_to(rise, (2,))
    before, after = rise[:-1], rise[1:]
    # A weighted harmonic mean where the data go on in one sense; an extremum of them is one of the
    # interpolant.
    of_before, of_after = h[:-1] + 2 * h[1:], 2 * h[:-1] + h[1:]
    goes_on = before * after > 0
    weighted = jnp.where(goes_on, of_before * after + of_after * before, 1.0)
    inside = jnp.where(goes_on, (of_before + of_after) * before * after / weighted, 0.0)
    first = _end_slope(h[0], h[1], rise[0], rise[1])
    last = _end_slope(h[-1], h[-2], rise[-1], rise[-2])
    return jnp.concatenate([first[None], inside, last[None]])


def _end_slope(
    near: Float[Array, ""], far: Float[Array, ""], rise: Float[Array, ""], after: Float[Array, ""]
) -> Float[Array, ""]:
    """Slope at an end from its interval and the next one, limited so that it stays monotone."""
    slope = ((2 * near + far) * rise - near * after) / (near + far)
    turns = (rise * after < 0) & (jnp.abs(slope) > 3 * jnp.abs(rise))
    return jnp.where(slope * rise <= 0, 0.0, jnp.where(turns, 3 * rise, slope))
