"""Positions of points on chains of rigid bodies, and their derivatives by the coordinates.

Each body turns about a pivot or slides along a line, and may sit on another that comes before it.
What kind they are and what they carry are arrays, so that only their number compiles.
docs/theory/bodies.md, (M1) and (M2).
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

Coordinates = Float[Array, " coordinates"]


class Bodies(NamedTuple):
    """Movable bodies, stacked once; flags are 0 or 1."""

    carried: Float[Array, "points coordinates"]  # the body carries the point, or what does
    carries: Float[Array, "points coordinates"]  # the body carries the point itself
    above: Float[Array, "coordinates coordinates"]  # [b, a]: a is b or b sits on a
    rotary: Coordinates
    pivots: Float[Array, "coordinates 2"]
    directions: Float[Array, "coordinates 2"]  # unit
    locked: Coordinates
    stops: Float[Array, "coordinates 2"]


class Placed(NamedTuple):
    """Points moved by the coordinates, with their derivatives by them."""

    x: Float[Array, " points"]
    y: Float[Array, " points"]
    by_x: Float[Array, "points coordinates"]
    by_y: Float[Array, "points coordinates"]
    twice_x: Float[Array, "points coordinates coordinates"]
    twice_y: Float[Array, "points coordinates coordinates"]


def placed(
    of: Bodies,
    x: Float[Array, " points"],
    y: Float[Array, " points"],
    carried: Float[Array, "points coordinates"],
    at: Coordinates,
) -> Placed:
    """Points drawn at (x, y), of which `carried` says which bodies move them, with `at` set."""
    count = len(of.rotary)
    # Pivots ride on the bodies below their own, directions turn with them.
    apart = of.above - jnp.eye(count)
    pivot_x, pivot_y = of.pivots[:, 0], of.pivots[:, 1]
    along_x, along_y = of.directions[:, 0], of.directions[:, 1]
    for a in reversed(range(count)):
        turn = of.rotary[a] * at[a]
        cos, sin = jnp.cos(turn) - 1.0, jnp.sin(turn)
        slide = (1.0 - of.rotary[a]) * at[a]
        center_x, center_y = of.pivots[a, 0], of.pivots[a, 1]
        shift_x, shift_y = slide * of.directions[a, 0], slide * of.directions[a, 1]

        dx, dy = _turned(x - center_x, y - center_y, cos, sin, carried[:, a])
        x, y = x + dx + carried[:, a] * shift_x, y + dy + carried[:, a] * shift_y
        if count > 1:
            dx, dy = _turned(pivot_x - center_x, pivot_y - center_y, cos, sin, apart[:, a])
            pivot_x = pivot_x + dx + apart[:, a] * shift_x
            pivot_y = pivot_y + dy + apart[:, a] * shift_y
            dx, dy = _turned(along_x, along_y, cos, sin, apart[:, a])
            along_x, along_y = along_x + dx, along_y + dy
    slides = 1.0 - of.rotary
    by_x = carried * (of.rotary * (pivot_y - y[:, None]) + slides * along_x)
    by_y = carried * (of.rotary * (x[:, None] - pivot_x) + slides * along_y)
    # The lower of two bodies turns what the upper one does; above[b, a] says a is the lower.
    lower, upper = of.above.T * of.rotary[:, None], apart * of.rotary[None, :]
    twice_x = -(lower * by_y[:, None, :] + upper * by_y[:, :, None])
    twice_y = lower * by_x[:, None, :] + upper * by_x[:, :, None]
    return Placed(x, y, by_x, by_y, twice_x, twice_y)


def _turned(
    x: Array, y: Array, cos: Array, sin: Array, flags: Float[Array, " points"]
) -> tuple[Array, Array]:
    """How far a turn takes the flagged points (x, y); `cos` is that of the angle less 1."""
    return flags * (cos * x - sin * y), flags * (sin * x + cos * y)
