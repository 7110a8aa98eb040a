"""The one crossing between SI and the dimensionless groups (3.25), (4.12), and back."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from beltjax.drive.layout import Layout
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive


class Groups(eqx.Module):
    """A drive in pure numbers; compare these with the literature.

    Lengths are in the mean span length, tensions in P0 (the tension at rest without torques),
    times in `Scales.time`. An angular frequency in rad/s is the dimensionless one over it.
    """

    bending: Float[Array, ""]  # eps = sqrt(EI/P0)/l
    speed: Float[Array, ""]  # s = c sqrt(m/P0)
    stretch: Float[Array, ""]  # gamma = EA/P0
    spring: Float[Array, ""]  # k_s = k_r/(P0 r_t); 1 where there is no tensioner
    tensions: Float[Array, " spans"]  # P_i/P0, at rest, with torques
    span_ratios: Float[Array, " spans"]  # lambda_i = l_i/l
    curvature_start: Float[Array, " spans"]  # sigma_i l_i/r_i
    curvature_end: Float[Array, " spans"]  # sigma_j l_i/r_j
    arm_ratio: Float[Array, ""]  # r_t/l
    arm_take_up: Float[Array, ""]  # D = sin(beta_in) - sin(beta_out)
    arm_slope: Float[Array, " spans"]  # (w_i(1) - w_i(0))/theta_t
    arm_lift: Float[Array, " spans"]  # w_i(0)/theta_t
    arm_strain: Float[Array, " spans"]  # d(path)/d(theta_t), the span's part, over l_i
    radius_ratios: Float[Array, " pulleys"]  # r_i/l
    drives: Float[Array, " pulleys"]  # 1 for the driver, 0 for the others
    travel: Float[Array, ""]  # +1: the belt runs in the listed order; -1: against it
    pulley_inertias: Float[Array, " pulleys"] | None  # mhat_i r_i/r_t; None if one is missing
    arm_inertia: Float[Array, ""] | None  # mhat_t = J_t/(m r_t l^2)
    arm_damping: Float[Array, ""]  # in P0 r_t times the unit of time


class Scales(eqx.Module):
    """What the groups are measured in."""

    length: Float[Array, ""]  # l, mean span length [m]
    tension: Float[Array, ""]  # P0 [N]
    time: Float[Array, ""]  # l sqrt(m/P0) [s]


def groups_and_scales(
    drive: Drive,
    at: Layout,
    tensions: Float[Array, " spans"],
    base_tension: Float[Array, ""],
    point: OperatingPoint,
) -> tuple[Groups, Scales]:
    """Dimensionless groups of a drive whose reference state has this layout and these tensions."""
    lengths, belt = at.span_lengths, drive.belt
    length = jnp.mean(lengths)
    wave_speed = jnp.sqrt(base_tension / belt.mass_per_length)
    curvatures = drive.faces / drive.radii
    if drive.tensioner is None:
        # A unit spring on an arm that touches nothing: theta_t = 0 without a special case.
        present, spring = 0.0, jnp.ones(())
    else:
        present, spring = 1.0, drive.tensioner.stiffness / (base_tension * at.arm_length)
    arm = drive.tensioner
    damping = None if arm is None else arm.damping
    time, moment = length / wave_speed, base_tension * at.arm_length
    inertia_unit = belt.mass_per_length * at.arm_length * length**2
    slope = present * at.arm_normal * at.arm_length / lengths
    groups = Groups(
        bending=_root_or_zero(belt.bending_stiffness / base_tension) / length,
        speed=point.speed(drive) / wave_speed,
        stretch=belt.axial_stiffness / base_tension,
        spring=spring,
        tensions=tensions / base_tension,
        span_ratios=lengths / length,
        curvature_start=lengths * curvatures,
        curvature_end=lengths * jnp.roll(curvatures, -1),
        arm_ratio=at.arm_length / length,
        arm_take_up=-present * jnp.sum(at.arm_tangent),
        arm_slope=slope,
        # The span that starts on the arm is the one whose first pulley is carried.
        arm_lift=-slope * drive.carried,
        arm_strain=present * at.arm_tangent * at.arm_length / lengths,
        radius_ratios=drive.radii / length,
        drives=drive.drives,
        travel=jax.lax.stop_gradient(point.travel),
        pulley_inertias=_pulley_inertias(drive, inertia_unit),
        arm_inertia=None if arm is None or arm.inertia is None else arm.inertia / inertia_unit,
        arm_damping=jnp.zeros(()) if damping is None else damping / (moment * time),
    )
    return groups, Scales(length=length, tension=base_tension, time=time)


def _pulley_inertias(drive: Drive, unit: Float[Array, ""]) -> Float[Array, " pulleys"] | None:
    inertias = [pulley.inertia for pulley in drive.pulleys]
    if any(inertia is None for inertia in inertias):
        return None
    return jnp.stack(inertias) / unit  # pyright: ignore[reportArgumentType]


def _root_or_zero(ratio: Float[Array, ""]) -> Float[Array, ""]:
    """Square root whose derivative at 0 is taken as 0, not inf.

    At EI = 0 the derivative of Gamma with respect to EI has no value; everything else has.
    """
    positive = ratio > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, ratio, 1.0)), 0.0)


class ContactGroups(eqx.Module):
    """A drive in pure numbers for contact mechanics, in the order in which its belt travels.

    Lengths are in `Scales.length`, forces in P0, speeds in sqrt(P0/m).
    """

    bending: Float[Array, ""]  # EI/(P0 l^2)
    stretch: Float[Array, ""]  # EA/P0
    centers: Float[Array, "pulleys 2"]  # with the arm as drawn
    radii: Float[Array, " pulleys"]  # positive where the pulley turns the belt left
    friction: Float[Array, " pulleys"]  # 1 where it is not given
    pulls: Float[Array, " pulleys"]  # M_i/R_i taken from the belt; the driver balances the others
    drives: Float[Array, " pulleys"]
    carried: Float[Array, " pulleys"]
    arm: Float[Array, "2"]
    spring: Float[Array, ""]  # k_r/(P0 l); 1 where there is no tensioner
    belt_speed: Float[Array, ""] | None
    driver_speed: Float[Array, ""] | None  # of its surface
    mass_flow: Float[Array, ""] | None


class TravelOrder(eqx.Module):
    """Where things listed are met by the belt. Each permutation is its own inverse."""

    pulleys: Int[Array, " pulleys"]
    spans: Int[Array, " spans"]

    @classmethod
    def of(cls, count: int, travel: Float[Array, ""]) -> "TravelOrder":
        """For `count` pulleys and a belt that runs as listed (+1) or against the list (-1)."""
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
    belt, arm, travel = drive.belt, drive.tensioner, jax.lax.stop_gradient(point.travel)
    order = TravelOrder.of(len(drive.pulleys), travel).pulleys
    steps = jnp.roll(drive.centers, -1, axis=0) - drive.centers
    length = jax.lax.stop_gradient(jnp.mean(jnp.sqrt(jnp.sum(steps**2, axis=1))))
    speed = jnp.sqrt(base_tension / belt.mass_per_length)
    frictions = [1.0 if p.friction is None else p.friction for p in drive.pulleys]
    side = jax.lax.stop_gradient(drive.sense) * travel * drive.faces
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
        carried=drive.carried[order],
        arm=drive.arm / length,
        spring=jnp.ones(()) if arm is None else arm.stiffness / (base_tension * length),
        belt_speed=None if point.belt_speed is None else point.belt_speed / speed,
        driver_speed=surface,
        mass_flow=None
        if point.mass_flow is None
        else point.mass_flow / (belt.mass_per_length * speed),
    )
    return groups, Scales(length=length, tension=base_tension, time=length / speed)
