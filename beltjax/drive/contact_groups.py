"""Conversion between SI and the dimensionless groups of contact mechanics."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from beltjax.drive.bodies import Springs, bodies, loads, springs
from beltjax.drive.groups import Scales, ways
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.numerics.rigid_bodies import Bodies, Loads, Weights


class ContactGroups(eqx.Module):
    """A drive in pure numbers for contact mechanics, in the order in which its belt travels.

    Lengths are in `Scales.length`, forces in P0, speeds in sqrt(P0/m).
    """

    bending: Float[Array, ""]  # EI/(P0 l^2)
    stretch: Float[Array, ""]  # EA/P0
    centers: Float[Array, "pulleys 2"]  # as drawn
    radii: Float[Array, " pulleys"]  # positive where the pulley turns the belt left
    friction: Float[Array, " pulleys"]  # 1 where it is not given
    pulls: Float[Array, " pulleys"]  # M_i/R_i taken from the belt; the driver balances the others
    drives: Float[Array, " pulleys"]
    bodies: Bodies
    units: Float[Array, " coordinates"]  # l where a coordinate is a length, else 1
    housed: Float[Array, " pulleys"]
    springs: Springs
    stiffness: Float[Array, "coordinates coordinates"]  # of the springs
    loads: Loads
    belt_speed: Float[Array, ""] | None
    driver_speed: Float[Array, ""] | None  # of its surface
    mass_flow: Float[Array, ""] | None


class TravelOrder(eqx.Module):
    """Order in which the belt meets listed pulleys and spans; both are their own inverses."""

    pulleys: Int[Array, " pulleys"]
    spans: Int[Array, " spans"]

    @classmethod
    def of(cls, count: int, travel: Float[Array, ""]) -> "TravelOrder":
        """The order for `count` pulleys and a belt that runs as listed (+1) or against it (-1)."""
        listed = jnp.arange(count)
        forward = travel > 0
        return cls(
            jnp.where(forward, listed, -listed % count),
            jnp.where(forward, listed, (-listed - 1) % count),
        )


def contact_groups(
    drive: Drive,
    point: OperatingPoint,
    torques: Float[Array, " pulleys"],
    base_tension: Float[Array, ""],
) -> tuple[ContactGroups, Scales]:
    """Groups of a drive whose pulleys take these torques; forces are measured in `base_tension`."""
    belt, travel, of = drive.belt, jax.lax.stop_gradient(point.travel), bodies(drive)
    order = TravelOrder.of(len(drive.pulleys), travel).pulleys
    steps = jnp.roll(drive.centers, -1, axis=0) - drive.centers
    length = jax.lax.stop_gradient(jnp.mean(jnp.sqrt(jnp.sum(steps**2, axis=1))))
    speed = jnp.sqrt(base_tension / belt.mass_per_length)
    frictions = [1.0 if p.friction is None else p.friction for p in drive.pulleys]
    side = drive.senses * travel * drive.faces
    units = jnp.where(of.rotary > 0, 1.0, length)
    of_springs = springs(drive)
    surface = point.driver_speed
    if surface is not None:
        surface = surface * (drive.drives @ drive.radii) / speed
    groups = ContactGroups(
        bending=belt.bending_stiffness / (base_tension * length**2),
        stretch=belt.axial_stiffness / base_tension,
        centers=drive.centers[order] / length,
        radii=(side * drive.radii)[order] / length,
        friction=jnp.stack([jnp.asarray(value) for value in frictions])[order],
        pulls=(torques / drive.radii)[order] / base_tension,
        drives=drive.drives[order],
        bodies=of._replace(
            carried=of.carried[order],
            carries=of.carries[order],
            pivots=of.pivots / length,
            stops=ways(of.stops, jnp.zeros_like(units), units),
        ),
        units=units,
        housed=jax.lax.stop_gradient(jnp.stack([p.housed for p in drive.pulleys]))[order],
        springs=of_springs,
        stiffness=of_springs.matrix * units[:, None] * units / (base_tension * length),
        loads=_scaled(loads(drive), units, base_tension, length),
        belt_speed=None if point.belt_speed is None else point.belt_speed / speed,
        driver_speed=surface,
        mass_flow=None
        if point.mass_flow is None
        else point.mass_flow / (belt.mass_per_length * speed),
    )
    return groups, Scales(length=length, tension=base_tension, time=length / speed)


def _scaled(
    of: Loads,
    units: Float[Array, " coordinates"],
    tension: Float[Array, ""],
    length: Float[Array, ""],
) -> Loads:
    """Loads in pure numbers."""
    constant = of.constant * units / (tension * length)
    if of.weights is None:
        return Loads(constant, None)
    x, y, force_x, force_y = of.weights
    return Loads(constant, Weights(x / length, y / length, force_x / tension, force_y / tension))
