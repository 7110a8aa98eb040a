"""The tensioners of a drive as arrays: what they carry, inertia, springs and outside forces."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from beltjax.drive.system import Drive
from beltjax.numerics.rigid_bodies import Bodies, OutsideForces, Placed, Weights, placed

Coordinates = Float[Array, " coordinates"]


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


def moved_pulleys(drive: Drive, coordinates: Coordinates) -> Placed:
    """The centers of the pulleys and the pivots [m] with the tensioners at these coordinates."""
    of = bodies(drive)
    return placed(of, drive.centers[:, 0], drive.centers[:, 1], of.carried, coordinates)


def single_arm(drive: Drive) -> bool:
    """Whether the only tensioner is an arm that turns and carries one pulley, as in the source."""
    if len(drive.tensioners) != 1:
        return False
    carried = sum(float(np.sum(np.asarray(pulley.on))) for pulley in drive.pulleys)
    return carried == 1 and float(drive.tensioners[0].kind) == 1


def mass_matrix(
    drive: Drive, of: Bodies, at: Coordinates
) -> Float[Array, "coordinates coordinates"] | None:
    """Inertia of the bodies [kg m^2], [kg m] or [kg]; None if a body has no inertia given."""
    parts = drive.tensioners
    inertias = [body.inertia for body in parts if body.inertia is not None]
    if len(inertias) < len(parts):
        return None
    if not parts:
        return jnp.zeros((0, 0))
    centers = jnp.stack([body.mass_center for body in parts])
    mass = jnp.stack([body.mass for body in parts])
    there = placed(of, centers[:, 0], centers[:, 1], of.above, at)
    moved = jnp.einsum("b,ba,bc->ac", mass, there.by_x, there.by_x)
    moved = moved + jnp.einsum("b,ba,bc->ac", mass, there.by_y, there.by_y)
    turns = of.above * of.rotary
    spin = jnp.stack([body.inertia_center for body in parts])
    own = jnp.stack(inertias)
    return moved + jnp.einsum("b,ba,bc->ac", spin, turns, turns) + jnp.diag(own)


def outside_forces(drive: Drive) -> OutsideForces:
    """The constant forces on the tensioners of `drive` [N m] or [N], and their weights [N]."""
    parts = drive.tensioners
    if not parts:
        return OutsideForces(jnp.zeros(0), None)
    constant = jnp.stack([body.force for body in parts])
    if drive.gravity is None:
        return OutsideForces(constant, None)
    mass = jnp.stack([body.mass for body in parts])
    x, y = jnp.stack([body.mass_center for body in parts]).T
    return OutsideForces(constant, Weights(x, y, mass * drive.gravity[0], mass * drive.gravity[1]))


class Springs(NamedTuple):
    """The springs of the tensioners, one per row: first their own, then those between two."""

    rows: Float[Array, "springs coordinates"]  # elongation of each spring by the coordinates
    stiffness: Float[Array, " springs"]
    damping: Float[Array, " springs"]
    friction: Coordinates  # dry friction of each body [N m] or [N]
    friction_speed: Coordinates  # [rad/s] or [m/s]
    # Bodies that springs join to each other but not to the ground: 1 where two move together.
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
        return Springs(square, none, none, none, none, square, none, none)
    parts = (*drive.tensioners, *drive.arm_springs)
    fixed = jax.lax.stop_gradient
    between = [fixed(spring.between) for spring in drive.arm_springs]
    rows = jnp.concatenate([jnp.eye(count), jnp.stack(between)]) if between else jnp.eye(count)
    stiffness = jnp.stack([part.stiffness for part in parts])
    pulls = fixed((stiffness > 0).astype(float))
    free = 1.0 - fixed(jnp.stack([body.locked for body in drive.tensioners]))
    # Bodies that springs join, directly or through others; a locked body is the ground.
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
        friction=jnp.stack([body.friction_torque for body in drive.tensioners]),
        friction_speed=jnp.stack([body.friction_speed for body in drive.tensioners]),
        together=together * floating[:, None] * floating,
        floating=floating,
        first=floating * (earlier == 0),
    )
