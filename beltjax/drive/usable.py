"""Numbers that no drive can have, kept from spoiling a batch."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool

from beltjax.drive.components import BeltGiven, Drive, OperatingPoint

Numbers = tuple[Drive, OperatingPoint]


def usable(drive: Drive, point: OperatingPoint) -> Bool[Array, ""]:
    """Whether all numbers are finite, and those positive that must be."""
    rule, belt = drive.installation, drive.belt
    positive = [drive.radii, belt.axial_stiffness, belt.mass_per_length]
    positive += [rule.belt_length if isinstance(rule, BeltGiven) else rule.tension]
    if drive.tensioner is not None:
        positive += [drive.tensioner.stiffness, jnp.sum(drive.arm**2)]
    numbers, _ = ravel_pytree((drive, point))
    least = jnp.min(jnp.concatenate([jnp.ravel(number) for number in positive]))
    return jnp.all(jnp.isfinite(numbers)) & (least > 0) & (belt.bending_stiffness >= 0)


def harmless(drive: Drive, point: OperatingPoint, good: Bool[Array, ""]) -> Numbers:
    """The drive and point where `good`; elsewhere a ring of like pulleys, without derivatives.

    Computing goes on with it, so that every number stays finite; the result tells.
    """
    count = len(drive.pulleys)
    turns = 2 * jnp.pi * jnp.arange(count) / count
    ring = 10.0 * jnp.stack([jnp.cos(turns), jnp.sin(turns)], axis=-1)
    ones = jax.tree.map(jnp.ones_like, (drive, point))
    nominal = eqx.tree_at(
        lambda n: (
            [pulley.center for pulley in n[0].pulleys]
            + [n[0].belt.axial_stiffness, n[0].belt.bending_stiffness]
            + [speed for speed in (n[1].belt_speed, n[1].driver_speed) if speed is not None]
        ),
        ones,
        [*ring, jnp.array(1e3), jnp.array(1e-3), jnp.array(0.0)],
    )
    return jax.tree.map(lambda a, b: jnp.where(good, a, b), (drive, point), nominal)
