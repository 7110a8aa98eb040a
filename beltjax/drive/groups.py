"""Conversion between SI and the dimensionless groups (3.25), (4.12), which stands here alone."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.drive.assembly import Assembly
from beltjax.drive.bodies import mass_matrix
from beltjax.drive.layout import Layout, unstretched_lengths
from beltjax.drive.shafts import rotors
from beltjax.numerics.loops import Loops

_FAR = 1e6  # radians, or mean spans


class Groups(eqx.Module):
    """A drive in pure numbers, which may be compared with the literature.

    Lengths are in the mean span length, tensions in P0 (the tension at rest without torques, of
    the first belt), masses per length in that belt's, times in `Scales.time`. Coordinates are in
    radians or in mean span lengths. An angular frequency in rad/s is the dimensionless one divided
    by the time.
    """

    bendings: Float[Array, " belts"]  # eps = sqrt(EI/P0)/l
    speeds: Float[Array, " belts"]  # s = c sqrt(m/P0), with the first belt's m
    stretches: Float[Array, " belts"]  # gamma = EA/P0
    masses: Float[Array, " belts"]
    tensions: Float[Array, " spans"]  # P_i/P0, at rest, with torques
    span_ratios: Float[Array, " spans"]  # lambda_i = l_i/l
    arc_ratios: Float[Array, " pulleys"]  # arcs over l
    curvature_start: Float[Array, " spans"]  # sigma_i l_i/r_i
    curvature_end: Float[Array, " spans"]  # sigma_j l_i/r_j
    radius_ratios: Float[Array, " pulleys"]  # r_i/l
    drives: Float[Array, " pulleys"]  # 1 for the driver, 0 for the others
    travel: Float[Array, " spans"]  # +1: the belt runs in the listed order; -1: against it
    units: Float[Array, " coordinates"]  # l where a coordinate is a length, else 1
    arm_ratios: Float[Array, " coordinates"]  # r_t/l
    pulls: Float[Array, "spans coordinates"]  # S: the span's part of d(path)
    slopes: Float[Array, "spans coordinates"]  # a: d(w_i(1) - w_i(0)), w over l_i
    lifts: Float[Array, "spans coordinates"]  # W0: d(w_i(0))
    drifts: Float[Array, "spans coordinates"]  # d(motion along the span of its middle), over l
    curvatures: Float[Array, "spans coordinates coordinates"]  # H; 0 where the model leaves it out
    springs: Float[Array, "coordinates coordinates"]  # stiffness of springs and weights
    movable: Float[Array, " coordinates"]  # 0 where locked
    ways: Float[Array, "coordinates 2"]  # to the stops, from the reference state
    stop_forces: Float[Array, " coordinates"]  # of the stops at rest
    arm_damping: Float[Array, "coordinates coordinates"]
    arm_inertia: Float[Array, "coordinates coordinates"] | None  # None where one is missing
    frictions: Float[Array, " coordinates"]  # dry, of the bodies
    friction_speeds: Float[Array, " coordinates"]  # at which they turn round
    turning: Float[Array, "pulleys rotors"]  # which rotor a pulley's rim turns with
    held_rotor: Float[Array, " rotors"]  # 1 for the hub of the driver
    hubs: Float[Array, "pulleys rotors"]  # which rotor a pulley's torque acts on
    rotor_inertias: Float[Array, " rotors"] | None  # None where one is missing
    rotor_springs: Float[Array, "rotors rotors"]
    rotor_damping: Float[Array, "rotors rotors"]
    unstretched: Float[Array, " belts"]  # length that stretches, over l
    belt_inertia: Float[Array, ""]
    loops: Loops  # which spans belong to which belt

    @property
    def bending(self) -> Float[Array, ""]:
        """Bending stiffness eps of the first belt."""
        return self.bendings[0]

    @property
    def speed(self) -> Float[Array, ""]:
        """Speed s of the first belt."""
        return self.speeds[0]

    @property
    def stretch(self) -> Float[Array, ""]:
        """Axial stiffness gamma of the first belt."""
        return self.stretches[0]

    @property
    def spring(self) -> Float[Array, ""]:
        """k_s = k_r/(P0 r_t) of the first tensioner, a rotary one; 1 where there is none."""
        if not len(self.units):
            return jnp.ones(())
        return self.springs[0, 0] / self.arm_ratios[0]


class Scales(eqx.Module):
    """Units of the groups."""

    length: Float[Array, ""]  # l, mean span length [m]
    tension: Float[Array, ""]  # P0 [N]
    time: Float[Array, ""]  # l sqrt(m/P0) [s]

    @property
    def energy(self) -> Float[Array, ""]:
        """P0 l, the unit of energies and moments [J]."""
        return self.tension * self.length


def groups_and_scales(
    made: Assembly,
    at: Layout,
    tensions: Float[Array, " spans"],
    base_tension: Float[Array, ""],
    stop_forces: Float[Array, " coordinates"],
) -> tuple[Groups, Scales]:
    """Dimensionless groups of a drive whose reference state has this layout and these tensions.

    `stop_forces` are the forces of the stops there [N m] or [N], one per coordinate.
    """
    drive, loops, of, of_springs = made.drive, made.loops, made.bodies, made.springs
    lengths = at.span_lengths
    length = jnp.mean(lengths)
    bending = jnp.stack([belt.bending_stiffness for belt in drive.belts])
    mass = jnp.stack([belt.mass_per_length for belt in drive.belts])
    wave_speed = jnp.sqrt(base_tension / mass[0])
    time = length / wave_speed
    driven, inertia = made.driven, mass_matrix(drive, of, at.coordinates)
    curvatures = drive.faces / drive.radii
    units = jnp.where(of.rotary > 0, 1.0, length)
    energy = base_tension * length
    inertia_unit = mass[0] * length**3
    by = units / length
    # A body that no spring holds is held by the curvature of the mechanism alone.
    counted = jnp.maximum(
        jax.lax.stop_gradient(drive.model.arm_curvature),
        jnp.maximum(of_springs.floating[:, None], of_springs.floating),
    )
    turning = rotors(drive)
    of_loads = turning.hubs.T @ (driven.slopes[:, None] * turning.hubs)
    groups = Groups(
        bendings=_root_or_zero(bending / base_tension) / length,
        speeds=driven.speeds[loops.starts] / wave_speed,
        stretches=made.EA / base_tension,
        masses=mass / mass[0],
        tensions=tensions / base_tension,
        span_ratios=lengths / length,
        arc_ratios=at.arc_lengths / length,
        curvature_start=lengths * curvatures,
        curvature_end=lengths * loops.following(curvatures),
        radius_ratios=drive.radii / length,
        drives=drive.drives,
        travel=driven.travel,
        units=units,
        arm_ratios=jnp.sqrt(_positive(jnp.sum(at.arms**2, axis=1))) / length,
        pulls=at.span_pulls * by,
        slopes=at.span_turns * units / lengths[:, None],
        lifts=at.lifts * units / lengths[:, None],
        drifts=at.drifts * by,
        curvatures=at.curvatures * counted * by[:, None] * units,
        springs=(of_springs.matrix + made.outside.stiffness(of, at.coordinates))
        * units[:, None]
        * units
        / energy,
        movable=1.0 - of.locked,
        ways=ways(of.stops, at.coordinates, units),
        stop_forces=stop_forces * units / energy,
        arm_damping=jnp.einsum("s,sa,sb->ab", of_springs.damping, of_springs.rows, of_springs.rows)
        * units[:, None]
        * units
        / (energy * time),
        arm_inertia=None if inertia is None else inertia * units[:, None] * units / inertia_unit,
        frictions=of_springs.friction * units / energy,
        friction_speeds=of_springs.friction_speed * time / units,
        turning=turning.rims,
        held_rotor=turning.driver,
        hubs=turning.hubs,
        rotor_inertias=None if turning.inertias is None else turning.inertias / inertia_unit,
        rotor_springs=turning.stiffness / energy,
        rotor_damping=(turning.damping + of_loads) / (energy * time),
        unstretched=_unstretched(made, at, tensions) / length,
        belt_inertia=jax.lax.stop_gradient(drive.model.belt_inertia),
        loops=loops,
    )
    return groups, Scales(length=length, tension=base_tension, time=time)


def ways(
    stops: Float[Array, "coordinates 2"],
    coordinates: Float[Array, " coordinates"],
    units: Float[Array, " coordinates"],
) -> Float[Array, "coordinates 2"]:
    """Distances to the stops over the units; a missing stop is farther than any body moves."""
    there = jnp.isfinite(stops)
    left = jnp.where(there, stops, 0.0) - coordinates[:, None]
    return jnp.where(there, left / units[:, None], _FAR * jnp.array([-1.0, 1.0]))


def _unstretched(
    made: Assembly, at: Layout, tensions: Float[Array, " spans"]
) -> Float[Array, " belts"]:
    """Length of each belt that stretches with its tension [m]: spans, with `stretching_arcs` arcs.

    The source leaves out the arcs, and uses the stretched lengths of the spans.
    """
    if not made.drive.model.stretching_arcs:
        return made.loops.sums(at.span_lengths)
    return unstretched_lengths(made.EA, at, tensions, made.loops)


def _positive(square: Float[Array, " n"]) -> Float[Array, " n"]:
    """`square`, or 1 without a derivative where it is 0, as it is for a body without pulleys."""
    return jnp.where(square > 0, square, 1.0)


def _root_or_zero(ratio: Float[Array, " n"]) -> Float[Array, " n"]:
    """Square root whose derivative at 0 is taken as 0, not inf.

    At EI = 0 the derivative of Gamma with respect to EI does not exist, but all others do.
    """
    positive = ratio > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, ratio, 1.0)), 0.0)
