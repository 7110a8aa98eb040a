"""The one crossing between SI and the dimensionless groups (3.25), (4.12), and back."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.drive.components import Drive, OperatingPoint
from beltjax.drive.layout import Layout


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
    arm_strain: Float[Array, " spans"]  # d(l_i)/d(theta_t)/l_i
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
