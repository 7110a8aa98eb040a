"""How shafts carry torque and speed from belt to belt."""

from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from beltjax.drive.system import Drive

if TYPE_CHECKING:
    from beltjax.drive.operation import OperatingPoint


class Transmission(NamedTuple):
    """Speed, travel and torque of every pulley, by the operating point of the drive."""

    speeds: Float[Array, " pulleys"]  # of the belt that the pulley belongs to [m/s]
    travel: Float[Array, " pulleys"]  # +1 where that belt runs as listed, -1 where against
    torques: Float[Array, " pulleys"]  # taken from that belt [N m]
    turning: Float[Array, " pulleys"]  # +1 where the pulley turns counterclockwise, -1 clockwise


def transmission(drive: Drive, point: "OperatingPoint") -> Transmission:
    """Speeds and torques of all pulleys, from the driver's belt to those that it drives.

    Shafts and belts form a tree. On each belt the pulley nearest to the driver gives what the others
    take; on each shaft but the driver's the pulley nearest to the driver takes what the shaft's
    accessories and its other belts need. Raises `KeyError` for a torque on an unknown pulley.
    """
    for name in point.torque:
        drive.pulley(name)
    count, radii, drives = len(drive.pulleys), drive.radii, drive.drives
    of_belt = np.equal.outer(np.arange(len(drive.belts)), drive.belt_of_span).astype(float)
    on_shaft = np.array([np.isin(np.arange(count), shaft) for shaft in drive.shafts], float)
    # Of the drivers' shafts and belts the masks are data: which pulley drives is not structure.
    driving = on_shaft.T @ (on_shaft @ drives)
    near = driving * (of_belt.T @ (of_belt @ drives))  # gives to its belt what the others take
    reached = of_belt.T @ (of_belt @ near)
    left = jax.lax.stop_gradient(drive.senses) * drive.faces  # rims turn left with the belt
    ratio = jax.lax.stop_gradient(point.travel) * reached  # surface speeds, along the list
    for _ in range(len(drive.belts) - 1):
        rate = jnp.where(reached > 0, left * ratio / radii, 0.0)
        # Pulleys of one shaft turn alike; the reached ones of a shaft agree.
        share = on_shaft.T @ (on_shaft @ reached)
        rates = (on_shaft.T @ (on_shaft @ rate)) / jnp.maximum(share, 1.0)
        next_near = (1 - reached) * jnp.minimum(share, 1.0)
        near = near + next_near
        ratio = ratio + of_belt.T @ (of_belt @ (next_near * rates * left * radii))
        reached = jnp.minimum(reached + of_belt.T @ (of_belt @ next_near), 1.0)
    given = jnp.stack([point.torque.get(name, jnp.zeros(())) for name in drive.pulley_names])
    given = on_shaft.T @ (on_shaft @ given)
    torques = jnp.zeros(count)
    for _ in drive.belts:
        passed = on_shaft.T @ (on_shaft @ (near * torques))
        taken = (1 - near) * (given - passed)
        torques = taken - near * radii * (of_belt.T @ (of_belt @ (taken / radii)))
    travel = jax.lax.stop_gradient(jnp.sign(ratio))
    return Transmission(
        speeds=jnp.abs(ratio) * point.speed(drive),
        travel=travel,
        torques=torques,
        turning=travel * left,
    )
