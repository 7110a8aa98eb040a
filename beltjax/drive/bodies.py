"""Where tensioners carry pulleys: positions and their derivatives, for any chain of bodies.

Bodies come parents first. What kind they are and what they carry are arrays, so that only their
number compiles. docs/theory/bodies.md.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.drive.system import Drive

Coordinates = Float[Array, " coordinates"]


class Bodies(NamedTuple):
    """The tensioners of a drive, stacked once; flags are 0 or 1."""

    carried: Float[Array, "pulleys coordinates"]  # the body carries the pulley, or what does
    carries: Float[Array, "pulleys coordinates"]  # the body carries the pulley itself
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


def bodies(drive: Drive) -> Bodies:
    """The tensioners of `drive` as arrays."""
    parts, count = drive.tensioners, len(drive.pulleys)
    if not parts:
        none = jnp.zeros((0,))
        empty, pairs = jnp.zeros((count, 0)), jnp.zeros((0, 2))
        return Bodies(empty, empty, jnp.zeros((0, 0)), none, pairs, pairs, none, pairs)
    fixed = jax.lax.stop_gradient
    carries = fixed(jnp.stack([pulley.on for pulley in drive.pulleys]))
    mounted = fixed(jnp.stack([body.on for body in parts]))
    above = jnp.eye(len(parts))
    for _ in parts[1:]:
        above = jnp.eye(len(parts)) + mounted @ above
    directions = jnp.stack([body.direction for body in parts])
    return Bodies(
        carried=carries @ above,
        carries=carries,
        above=above,
        rotary=fixed(jnp.stack([body.kind for body in parts])),
        pivots=jnp.stack([body.pivot for body in parts]),
        directions=directions / jnp.sqrt(jnp.sum(directions**2, axis=1, keepdims=True)),
        locked=fixed(jnp.stack([body.locked for body in parts])),
        stops=jnp.stack([body.stops for body in parts]),
    )


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

        def moved(px, py, flags, cos=cos, sin=sin, center=(center_x, center_y)):
            from_x, from_y = px - center[0], py - center[1]
            return flags * (cos * from_x - sin * from_y), flags * (sin * from_x + cos * from_y)

        dx, dy = moved(x, y, carried[:, a])
        x, y = x + dx + carried[:, a] * shift_x, y + dy + carried[:, a] * shift_y
        if count > 1:
            dx, dy = moved(pivot_x, pivot_y, apart[:, a])
            pivot_x = pivot_x + dx + apart[:, a] * shift_x
            pivot_y = pivot_y + dy + apart[:, a] * shift_y
            dx, dy = moved(along_x, along_y, apart[:, a], center=(0.0, 0.0))
            along_x, along_y = along_x + dx, along_y + dy
    slides = 1.0 - of.rotary
    by_x = carried * (of.rotary * (pivot_y - y[:, None]) + slides * along_x)
    by_y = carried * (of.rotary * (x[:, None] - pivot_x) + slides * along_y)
    # The lower of two bodies turns what the upper one does; above[b, a] says a is the lower.
    lower, upper = of.above.T * of.rotary[:, None], apart * of.rotary[None, :]
    twice_x = -(lower * by_y[:, None, :] + upper * by_y[:, :, None])
    twice_y = lower * by_x[:, None, :] + upper * by_x[:, :, None]
    return Placed(x, y, by_x, by_y, twice_x, twice_y)


def mass_matrix(drive: Drive, at: Coordinates) -> Float[Array, "coordinates coordinates"]:
    """Inertia of the bodies by their coordinates [kg m^2], [kg m] or [kg].

    Raises `ValueError` where a tensioner has no inertia.
    """
    of, parts = bodies(drive), drive.tensioners
    for body in parts:
        if body.inertia is None:
            raise ValueError(
                f"Tensioner {body.name!r}: inertia is missing; vibration needs it of every one."
            )
    if not parts:
        return jnp.zeros((0, 0))
    centers = jnp.stack([body.mass_center for body in parts])
    mass = jnp.stack([body.mass for body in parts])
    there = placed(of, centers[:, 0], centers[:, 1], of.above, at)
    moved = jnp.einsum("b,ba,bc->ac", mass, there.by_x, there.by_x)
    moved = moved + jnp.einsum("b,ba,bc->ac", mass, there.by_y, there.by_y)
    turns = of.above * of.rotary
    spin = jnp.stack([body.inertia_center for body in parts])
    own = jnp.stack([body.inertia for body in parts if body.inertia is not None])
    return moved + jnp.einsum("b,ba,bc->ac", spin, turns, turns) + jnp.diag(own)


class Springs(NamedTuple):
    """The springs of the tensioners, a row each: first their own, then those between two."""

    rows: Float[Array, "springs coordinates"]  # what each spring feels of the coordinates
    stiffness: Float[Array, " springs"]
    damping: Float[Array, " springs"]
    # Bodies that springs join, but hold to nothing: 1 for those that move with each body.
    together: Float[Array, "coordinates coordinates"]
    floating: Coordinates  # 1 where nothing but the belt holds the body
    first: Coordinates  # 1 for the first body of those that float together

    @property
    def matrix(self) -> Float[Array, "coordinates coordinates"]:
        """Stiffness by the coordinates."""
        return jnp.einsum("s,sa,sb->ab", self.stiffness, self.rows, self.rows)


def springs(drive: Drive) -> Springs:
    """The springs of `drive` as arrays."""
    count = len(drive.tensioners)
    if not count:
        none, square = jnp.zeros((0,)), jnp.zeros((0, 0))
        return Springs(square, none, none, square, none, none)
    parts = (*drive.tensioners, *drive.arm_springs)
    fixed = jax.lax.stop_gradient
    between = [fixed(spring.between) for spring in drive.arm_springs]
    rows = jnp.concatenate([jnp.eye(count), jnp.stack(between)]) if between else jnp.eye(count)
    stiffness = jnp.stack([part.stiffness for part in parts])
    pulls = fixed((stiffness > 0).astype(float))
    free = 1.0 - bodies(drive).locked
    # Which bodies springs join, however many stand between; a locked one is the ground.
    joined = jnp.eye(count)
    for row, pulling in zip(rows[count:], pulls[count:], strict=True):
        ends = jnp.abs(row) * free
        whole = jnp.prod(jnp.where(row != 0, free, 1.0))
        joined = joined + pulling * whole * jnp.outer(ends, ends)
    for _ in range(count - 1):
        joined = joined @ joined
    together = (joined > 0).astype(float)
    grounded = pulls[:count]
    for row, pulling in zip(rows[count:], pulls[count:], strict=True):
        to_locked = pulling * jnp.sum(jnp.abs(row) * (1 - free))
        grounded = jnp.maximum(grounded, jnp.minimum(to_locked * jnp.abs(row), 1.0))
    held = jnp.minimum(together @ (grounded * free), 1.0)
    floating = free * (1.0 - held)
    earlier = jnp.tril(together, -1) @ floating
    return Springs(
        rows=rows,
        stiffness=stiffness,
        damping=jnp.stack([part.damping for part in parts]),
        together=together * floating[:, None] * floating,
        floating=floating,
        first=floating * (earlier == 0),
    )
