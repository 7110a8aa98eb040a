"""Positions of points on chains of rigid bodies, and their derivatives by the coordinates.

Each body turns about a pivot or slides along a line, and may sit on another that comes before it.
What kind they are and what they carry are arrays, so that only their number compiles.
docs/theory/bodies.md, (M1) and (M2).
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
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


def holding_stop(of: Bodies, at: Coordinates, force: Coordinates) -> Coordinates:
    """-1 where a stop holds a body at its least, 1 at its greatest coordinate, else 0.

    A body at a stop stands there to rounding, and the `force` on it pushes it against the stop.
    """
    near = 1e-9 * (1.0 + jnp.abs(at))
    below = (at <= of.stops[:, 0] + near) & (force < 0)
    above = (at >= of.stops[:, 1] - near) & (force > 0)
    held = jnp.where(below, -1.0, jnp.where(above, 1.0, 0.0))
    return jnp.where(of.locked > 0, 0.0, held)


class Weights(NamedTuple):
    """Forces at the bodies' centers of mass, which move with them."""

    x: Coordinates  # centers, as drawn
    y: Coordinates
    force_x: Coordinates
    force_y: Coordinates


class OutsideForces(NamedTuple):
    """Forces on the bodies from outside: constant ones by their coordinates, and weights."""

    constant: Coordinates
    weights: Weights | None  # None: without gravity

    def push(self, of: Bodies, at: Coordinates) -> Coordinates:
        """Force on each coordinate, in the sense in which it is counted."""
        if self.weights is None:
            return self.constant
        x, y, force_x, force_y = self.weights
        there = placed(of, x, y, of.above, at)
        return self.constant + force_x @ there.by_x + force_y @ there.by_y

    def stiffness(
        self, of: Bodies, at: Coordinates
    ) -> Float[Array, "coordinates coordinates"] | float:
        """Derivatives of the force against each coordinate by the coordinates."""
        if self.weights is None:
            return 0.0
        x, y, force_x, force_y = self.weights
        there = placed(of, x, y, of.above, at)
        return -jnp.tensordot(force_x, there.twice_x, 1) - jnp.tensordot(force_y, there.twice_y, 1)


class Placed(NamedTuple):
    """Points and pivots moved by the coordinates, with the points' derivatives by them."""

    x: Float[Array, " points"]
    y: Float[Array, " points"]
    by_x: Float[Array, "points coordinates"]
    by_y: Float[Array, "points coordinates"]
    twice_x: Float[Array, "points coordinates coordinates"]
    twice_y: Float[Array, "points coordinates coordinates"]
    pivots: Float[Array, "coordinates 2"]


class Moved(NamedTuple):
    """Points, pivots and directions, moved by the coordinates."""

    x: Float[Array, " points"]
    y: Float[Array, " points"]
    pivots: tuple[Coordinates, Coordinates]
    directions: tuple[Coordinates, Coordinates]


def moved(
    of: Bodies,
    x: Float[Array, " points"],
    y: Float[Array, " points"],
    carried: Float[Array, "points coordinates"],
    at: Coordinates,
) -> Moved:
    """Points drawn at (x, y), of which `carried` says which bodies move them, with `at` set."""
    count, size = len(of.rotary), len(x)
    turn = of.rotary * at
    cos, sin = jnp.cos(turn) - 1.0, jnp.sin(turn)
    slide = ((1.0 - of.rotary) * at)[:, None] * of.directions
    flags, fixed = carried, np.ones(size)
    if count > 1:
        # Pivots ride on the bodies below their own, directions turn with them.
        apart = of.above - np.eye(count)
        x = jnp.concatenate([x, of.pivots[:, 0], of.directions[:, 0]])
        y = jnp.concatenate([y, of.pivots[:, 1], of.directions[:, 1]])
        flags = jnp.concatenate([flags, apart, apart])
        fixed = np.concatenate([np.ones(size + count), np.zeros(count)])
    for a in reversed(range(count)):
        dx, dy = x - of.pivots[a, 0] * fixed, y - of.pivots[a, 1] * fixed
        x = x + flags[:, a] * (cos[a] * dx - sin[a] * dy + slide[a, 0] * fixed)
        y = y + flags[:, a] * (sin[a] * dx + cos[a] * dy + slide[a, 1] * fixed)
    if count < 2:
        still = of.pivots, of.directions
        return Moved(x, y, *((vectors[:, 0], vectors[:, 1]) for vectors in still))
    parts = (size, size + count)
    (x, *riders_x), (y, *riders_y) = jnp.split(x, parts), jnp.split(y, parts)
    return Moved(x, y, *zip(riders_x, riders_y, strict=True))


def placed(
    of: Bodies,
    x: Float[Array, " points"],
    y: Float[Array, " points"],
    carried: Float[Array, "points coordinates"],
    at: Coordinates,
) -> Placed:
    """The points of `moved`, with their derivatives by the coordinates."""
    there = moved(of, x, y, carried, at)
    x, y = there.x, there.y
    (pivot_x, pivot_y), (along_x, along_y) = there.pivots, there.directions
    slides = 1.0 - of.rotary
    by_x = carried * (of.rotary * (pivot_y - y[:, None]) + slides * along_x)
    by_y = carried * (of.rotary * (x[:, None] - pivot_x) + slides * along_y)
    # The lower of two bodies turns what the upper one does; above[b, a] says a is the lower.
    apart = of.above - np.eye(len(of.rotary))
    lower, upper = of.above.T * of.rotary[:, None], apart * of.rotary[None, :]
    twice_x = -(lower * by_y[:, None, :] + upper * by_y[:, :, None])
    twice_y = lower * by_x[:, None, :] + upper * by_x[:, :, None]
    pivots = jnp.stack([pivot_x, pivot_y], axis=-1)
    return Placed(x, y, by_x, by_y, twice_x, twice_y, pivots)
