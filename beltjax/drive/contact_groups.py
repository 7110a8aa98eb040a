"""Conversion between SI and the dimensionless groups of contact mechanics."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from beltjax.drive.assembly import Assembly
from beltjax.drive.bodies import Springs
from beltjax.drive.groups import Scales, ways
from beltjax.drive.operation import OperatingPoint
from beltjax.numerics.loops import Loops
from beltjax.numerics.rigid_bodies import Bodies, OutsideForces, Weights


class ContactGroups(eqx.Module):
    """A drive in pure numbers for contact mechanics, in the order in which its belts travel.

    Lengths are in `Scales.length`, forces in the P0 and speeds in the sqrt(P0/m) of the first belt.
    """

    bendings: Float[Array, " belts"]  # EI/(P0 l^2)
    stretches: Float[Array, " belts"]  # EA/P0
    masses: Float[Array, " belts"]  # per length, over that of the first belt
    centers: Float[Array, "pulleys 2"]  # as drawn
    radii: Float[Array, " pulleys"]  # positive where the pulley turns the belt left
    friction: Float[Array, " pulleys"]  # 1 where it is not given
    pulls: Float[Array, " pulleys"]  # M_i/R_i taken from the belt; each belt's are in balance
    driving: Float[Array, " pulleys"]  # 1 on the driver's shaft
    gives: Float[Array, " pulleys"]  # 1 for the pulley that turns its belt
    gearing: Float[Array, "belts pulleys"]  # speed of a belt there, per speeds at other pulleys
    loops: Loops
    bodies: Bodies
    units: Float[Array, " coordinates"]  # l where a coordinate is a length, else 1
    housed: Float[Array, " pulleys"]
    springs: Springs
    stiffness: Float[Array, "coordinates coordinates"]  # of the springs
    outside: OutsideForces
    belt_speed: Float[Array, ""] | None
    driver_speed: Float[Array, ""] | None  # of its surface
    mass_flow: Float[Array, ""] | None


class TravelOrder(eqx.Module):
    """Order in which the belt meets listed pulleys and spans; both are their own inverses."""

    pulleys: Int[Array, " pulleys"]
    spans: Int[Array, " spans"]

    @classmethod
    def of(cls, loops: Loops, travel: Float[Array, " pulleys"]) -> "TravelOrder":
        """The order for belts that run as listed (+1) or against it (-1) at each pulley."""
        listed, sizes = np.arange(sum(loops.sizes)), np.array(loops.sizes)[loops.loop_of]
        first = loops.starts[loops.loop_of]
        place, forward = listed - first, travel > 0
        return cls(
            jnp.where(forward, listed, first + -place % sizes),
            jnp.where(forward, listed, first + (-place - 1) % sizes),
        )


def contact_groups(
    made: Assembly, point: OperatingPoint, torques: Float[Array, " pulleys"], base: Float[Array, ""]
) -> tuple[ContactGroups, Scales]:
    """Groups of a drive whose pulleys take these torques.

    Forces are measured in `base`, the tension of the first belt at rest.
    """
    drive, of, driven = made.drive, made.bodies, made.driven
    order = TravelOrder.of(made.loops, driven.travel).pulleys
    steps = made.loops.following(drive.centers) - drive.centers
    length = jax.lax.stop_gradient(jnp.mean(jnp.sqrt(jnp.sum(steps**2, axis=1))))
    mass = jnp.stack([belt.mass_per_length for belt in drive.belts])
    bending = jnp.stack([belt.bending_stiffness for belt in drive.belts])
    speed = jnp.sqrt(base / mass[0])
    frictions = [1.0 if p.friction is None else p.friction for p in drive.pulleys]
    side = drive.senses * driven.travel * drive.faces
    units = jnp.where(of.rotary > 0, 1.0, length)
    surface = point.driver_speed
    if surface is not None:
        surface = surface * (drive.drives @ drive.radii) / speed
    groups = ContactGroups(
        bendings=bending / (base * length**2),
        stretches=made.EA / base,
        masses=mass / mass[0],
        centers=drive.centers[order] / length,
        radii=(side * drive.radii)[order] / length,
        friction=jnp.stack([jnp.asarray(value) for value in frictions])[order],
        pulls=(torques / drive.radii)[order] / base,
        driving=driven.driving[order],
        gives=jax.lax.stop_gradient(driven.gives)[order],
        gearing=jnp.abs(driven.gearing[:, order]),
        loops=made.loops,
        bodies=of._replace(
            carried=of.carried[order],
            carries=of.carries[order],
            pivots=of.pivots / length,
            stops=ways(of.stops, jnp.zeros_like(units), units),
        ),
        units=units,
        housed=jax.lax.stop_gradient(jnp.stack([p.housed for p in drive.pulleys]))[order],
        springs=made.springs,
        stiffness=made.springs.matrix * units[:, None] * units / (base * length),
        outside=_scaled(made.outside, units, base, length),
        belt_speed=None if point.belt_speed is None else point.belt_speed / speed,
        driver_speed=surface,
        mass_flow=None if point.mass_flow is None else point.mass_flow / (mass[0] * speed),
    )
    return groups, Scales(length=length, tension=base, time=length / speed)


def _scaled(
    of: OutsideForces,
    units: Float[Array, " coordinates"],
    tension: Float[Array, ""],
    length: Float[Array, ""],
) -> OutsideForces:
    """OutsideForces in pure numbers."""
    constant = of.constant * units / (tension * length)
    if of.weights is None:
        return OutsideForces(constant, None)
    x, y, force_x, force_y = of.weights
    return OutsideForces(
        constant, Weights(x / length, y / length, force_x / tension, force_y / tension)
    )
