"""Motion of finite amplitude of a linearized drive, as an oscillator with a periodic force."""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from beltjax.analysis.damping import Damping, damping_matrix
from beltjax.analysis.linearization import Linearization
from beltjax.analysis.orders import Forcing
from beltjax.analysis.response import driver_moments
from beltjax.analysis.steady import SteadyState
from beltjax.compiling.batched_loops import ready_after
from beltjax.drive.bodies import bodies
from beltjax.drive.groups import Scales
from beltjax.drive.layout import belt_path, outline
from beltjax.drive.loads import Load
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.shafts import rotors, transmission
from beltjax.drive.system import Drive
from beltjax.numerics.harmonic_balance import Neutral, Oscillator, derived, series
from beltjax.physics.accessories import Accessories
from beltjax.physics.friction import Friction, Loaded
from beltjax.physics.joints import Joints
from beltjax.physics.motion import (
    BeltSpeed,
    Driving,
    MotionModel,
    SpanPaths,
    beside_linear,
    quadratic_strains,
)
from beltjax.physics.vibration import acceleration, convection

LAYERED = 8  # functions of a span from which four of them are its ends' layers
_LAYERS = 4
_FAR = 1e6  # wind-up that no joint has [rad]


class _Taken(eqx.Module):
    """The torque of a load over the speed of its pulley, dimensionless."""

    load: Load
    scales: Scales

    def __call__(self, speed: Float[Array, ""]) -> Float[Array, ""]:
        return self.load.at(speed / self.scales.time).torque / self.scales.energy


class Excited(NamedTuple):
    """A drive in motion, and what excites it, by harmonics of its period; dimensionless."""

    model: MotionModel
    frequency: Float[Array, ""]
    driver: Float[Array, " terms"]  # rotation, as coefficients of `numerics.periodic`
    load: Float[Array, "terms size"]


def motion_model(
    linearization: Linearization,
    damping: Damping,
    paths: SpanPaths | None = None,
    joints: Joints | None = None,
    speed: BeltSpeed | None = None,
    accessories: Accessories | None = None,
    loaded: Loaded | None = None,
) -> MotionModel:
    """The drive of `linearization` in motion."""
    lin = linearization
    damped = lin.gyroscopic + damping_matrix(lin, damping)
    rigid = None
    if lin.free:
        turns = ready_after(lin.model.turns, damped)
        rigid = rigid_rotation(eqx.tree_at(lambda lin: lin.model.turns, lin, turns))
    return MotionModel(
        mass=lin.mass,
        damping=damped,
        stiffness=lin.stiffness,
        elongations=lin.elongations,
        driving=lin.driving,
        work=lin.model.lam * lin.model.gam,
        pull=lin.model.lam * lin.model.Q,
        bodies=quadratic_strains(lin.model),
        paths=paths,
        gains=lin.model.gam,
        friction=Friction(
            constant=lin.steady.groups.frictions * lin.model.movable,
            speed=lin.steady.groups.friction_speeds,
            loaded=loaded,
        ),
        joints=joints,
        speed=speed,
        accessories=accessories,
        rigid=rigid,
        functions=lin.basis.size,
    )


def belt_speeds(drive: Drive, point: OperatingPoint, lin: Linearization) -> BeltSpeed:
    """Belts that follow the driver's speed, dimensionless.

    They are uniform along themselves, and a belt that a shaft or an isolator drives follows the
    driver's rotation, not that of what turns it.
    """
    m, length, time = lin.model, lin.scales.length, lin.scales.time
    rates = belt_travels(drive, point) / length  # of the belts' speed by the driver's
    gained = acceleration(m, lin.basis, lin.elongations, lin.rotors, rates)
    carried = convection(m, lin.basis, lin.rotors, rates)
    return BeltSpeed(
        gyroscopic=carried - carried.T,
        centrifugal=m.lam * m.mu * rates**2,
        accelerated=gained.matrix,
        bent=gained.steady,
        omega0=driver_speed(drive, point) * time,
    )


def belt_travels(drive: Drive, point: OperatingPoint) -> Float[Array, " pulleys"]:
    """By how much the belt of each pulley moves per radian of the driver [m]."""
    unit = dataclasses.replace(point, belt_speed=None, driver_speed=jnp.ones(()), load={})
    return transmission(drive, unit).speeds


def driver_speed(drive: Drive, point: OperatingPoint) -> Float[Array, ""]:
    """Speed of the driver [rad/s]."""
    return point.speed(drive) / (drive.drives @ drive.radii)


def rigid_rotation(lin: Linearization) -> Float[Array, " size"]:
    """The rotation of the drive that strains nothing, per rotation of the driver."""
    m, n = lin.model, lin.spans * lin.basis.size
    others = lin.rotors[1:] if lin.free else lin.rotors  # the driver comes first
    of_others = m.turns[:, others]
    weighted = of_others.T * (m.lam * m.gam)
    springs = m.K_r[others]
    matrix = weighted @ of_others + springs[:, others]
    load = weighted @ m.turns[:, lin.driver] + springs[:, lin.driver]
    turned = -jnp.linalg.solve(matrix, load)
    if lin.free:
        turned = jnp.concatenate([jnp.ones(1), turned])
    return jnp.zeros(len(lin.mass)).at[n : n + len(lin.rotors)].set(turned)


def accessories_of(drive: Drive, point: OperatingPoint, lin: Linearization) -> Accessories:
    """The loads of the operating point; those on the driver's shaft are not counted."""
    driven = transmission(drive, point)
    ratios = belt_travels(drive, point) / drive.radii
    places = np.array([drive.pulley(name) for name in point.load])
    counted = (1 - driven.driving[places])[:, None]
    n = lin.spans * lin.basis.size
    rows = jnp.zeros((len(places), len(lin.mass)))
    rows = rows.at[:, n : n + len(lin.rotors)].set(
        counted * lin.steady.groups.hubs[places][:, lin.rotors]
    )
    return Accessories(
        torques=tuple(_Taken(load, lin.scales) for load in point.load.values()),
        rows=rows,
        speeds=(driven.speeds / drive.radii)[places] * lin.scales.time,
        ratios=ratios[places],
    )


def span_paths(drive: Drive, steady: SteadyState) -> SpanPaths:
    """Geometry of the drive's spans about the steady state, dimensionless."""
    of, loops, length = outline(drive), drive.loops, steady.scales.length
    foot = of.faces * of.radii
    running = steady.reference.coordinates + steady.coordinate_change
    at, units = belt_path(of, loops, running), steady.groups.units
    turned = at.span_turns[:, :, None] * at.span_turns[:, None, :]
    second = turned / at.span_lengths[:, None, None] + at.curvatures
    return SpanPaths(
        x=of.x / length,
        y=of.y / length,
        rise=(loops.following(foot) - foot) / length,
        senses=of.senses,
        bodies=of.bodies._replace(pivots=of.bodies.pivots / length),
        steady=running / units,
        lengths=at.span_lengths / length,
        along_x=at.along_x,
        along_y=at.along_y,
        first=at.span_pulls * units / length,
        second=second * units[:, None] * units / length,
        units=steady.groups.span_ratios,
        counted=jax.lax.stop_gradient(drive.model.arm_curvature),
        loops=loops,
    )


def loaded_friction(drive: Drive, lin: Linearization) -> Loaded:
    """What the dry friction of the tensioners depends on, dimensionless."""
    steady, scales, movable = lin.steady, lin.scales, lin.model.movable
    parts, reference = drive.tensioners, steady.reference

    def numbers(field: str) -> Float[Array, " coordinates"]:
        return jnp.stack([getattr(part, field) for part in parts])

    running = reference.coordinates + steady.coordinate_change
    pull = numbers("stiffness") * (running - reference.free[: len(parts)]) - numbers("force")
    directions, loops = reference.layout.directions, drive.loops
    on_pulley = jnp.eye(lin.spans) - loops.preceding(jnp.eye(lin.spans))
    carried = bodies(drive).carried  # also by what it sits on
    bearings = jnp.einsum("pc,ps,sx->cxs", carried, on_pulley, directions)
    unit = lin.units / scales.energy
    return Loaded(
        hub=numbers("friction_hub") * movable * lin.units / scales.length,
        spring=numbers("friction_spring") * movable,
        unwinding=numbers("friction_unwinding"),
        winding=jax.lax.stop_gradient(jnp.where(pull < 0, -1.0, 1.0)),
        pull=pull * unit,
        stiffness=numbers("stiffness") * lin.units * unit,
        bearings=bearings,
        tensions=steady.effective_tensions,
    )


def joints_of(drive: Drive, lin: Linearization, damping: Damping) -> Joints:
    """The isolators of the drive, some of which are clutches, dimensionless."""
    parts, scales = drive.isolators, lin.scales
    wind_ups = rotors(drive).wind_ups
    n = lin.spans * lin.basis.size
    rows = jnp.zeros((len(parts), len(lin.mass)))
    rows = rows.at[:, n : n + len(lin.rotors)].set(wind_ups[:, lin.rotors])
    stiffness = jnp.stack([part.stiffness for part in parts])
    damped = jnp.stack([part.damping for part in parts]) * damping.arm
    damped = damped + damping.stiffness * stiffness  # it is in the matrix, too
    flags = jax.lax.stop_gradient(jnp.stack([part.pulleys for part in parts]))
    stops = jnp.stack([part.stops for part in parts])
    return Joints(
        rows=rows,
        driving=wind_ups[:, lin.driver],
        steady=flags @ lin.steady.reference.torques / stiffness,
        stiffness=stiffness / scales.energy,
        damping=damped / (scales.energy * scales.time),
        law=jax.lax.stop_gradient(jnp.stack([part.law for part in parts])),
        stops=jnp.where(jnp.isfinite(stops), stops, _FAR * jnp.array([-1.0, 1.0])),
        stop_stiffness=jnp.stack([part.stop_stiffness for part in parts]) / scales.energy,
    )


def layered_shapes(lin: Linearization, functions: int) -> Float[Array, "spans n functions"]:
    """Orthonormal combinations of each span's functions, fewer than those, that hold its layers.

    The first are e^{-kx} and x e^{-kx} at both ends, with k of the steady state: what the span's
    stretch excites directly, and what it answers. The others are the basis' first functions. With
    few functions they are these alone.
    """
    m, basis = lin.model, lin.basis
    unit = np.eye(basis.size)
    if functions < LAYERED:
        return jnp.broadcast_to(unit[:, :functions], (lin.spans, basis.size, functions))
    own = m.Q[:, None, None] * unit
    own = own + ((m.eps / m.lam) ** 2)[:, None, None] * basis.products().curvature
    moments = jnp.stack(jax.vmap(basis.layer_moments)(m.u, m.z), axis=-1)
    layers = jnp.concatenate([moments, jnp.linalg.solve(own, moments)], axis=-1)
    length = jnp.linalg.norm(jnp.where(layers == 0, 1e-300, layers), axis=1, keepdims=True)
    # A belt without bending stiffness has no layers.
    spare = unit[:, functions - _LAYERS : functions]
    layers = jnp.where(length > 1e-200, layers / length, spare)
    rest = jnp.broadcast_to(
        unit[:, : functions - _LAYERS], (lin.spans, basis.size, functions - _LAYERS)
    )
    return jnp.linalg.qr(jnp.concatenate([layers, rest], axis=-1))[0]


def widened(
    shapes: Float[Array, "spans n fewer"], z: Float[Array, "*points less"]
) -> Float[Array, "*points size"]:
    """Coordinates in the linearization's basis, from those of `physics.motion.projected`."""
    spans, _, fewer = shapes.shape
    fields = z[..., : spans * fewer].reshape(*z.shape[:-1], spans, fewer)
    fields = jnp.einsum("inf,...if->...in", shapes, fields)
    return jnp.concatenate([fields.reshape(*z.shape[:-1], -1), z[..., spans * fewer :]], axis=-1)


def narrowed(
    shapes: Float[Array, "spans n fewer"], load: Float[Array, "*points size"]
) -> Float[Array, "*points less"]:
    """Loads on those coordinates, from the loads on the linearization's."""
    spans, n, _ = shapes.shape
    fields = load[..., : spans * n].reshape(*load.shape[:-1], spans, n)
    fields = jnp.einsum("inf,...in->...if", shapes, fields)
    return jnp.concatenate([fields.reshape(*load.shape[:-1], -1), load[..., spans * n :]], axis=-1)


def transmitted(lin: Linearization, damping: Damping) -> Float[Array, "3 size"]:
    """Force on each coordinate by the driver's angle, rate and acceleration.

    It stands on the left of (O2), beside what the stretch of the spans transmits.
    """
    m = lin.model
    by_angle, by_rate, by_acceleration = driver_moments(lin, damping)
    stiffness, belt = damping.stiffness / lin.scales.time, damping.belt / lin.scales.time
    of_belt = (stiffness + belt) * (lin.elongations.T @ (m.lam * m.gam * lin.driving))
    n = lin.spans * lin.basis.size
    by_angle, by_rate, by_acceleration = (
        jnp.zeros(len(lin.mass)).at[n : n + len(lin.rotors)].set(moments)
        for moments in (by_angle, by_rate + stiffness * by_angle, by_acceleration)
    )
    return jnp.stack([by_angle, by_rate + of_belt, by_acceleration])


def torque_loads(lin: Linearization) -> Float[Array, "pulleys size"]:
    """Load on each coordinate per unit torque on the hub of each pulley [1/(N m)]."""
    n = lin.spans * lin.basis.size
    on_rotors = lin.steady.groups.hubs[:, lin.rotors] / lin.scales.energy
    return jnp.zeros((lin.spans, len(lin.mass))).at[:, n : n + len(lin.rotors)].set(on_rotors)


def load_series(
    lin: Linearization, forcing: Forcing, frequency: Float[Array, ""], damping: Damping
) -> tuple[Float[Array, " terms"], Float[Array, "terms size"]]:
    """The driver's rotation, and the load on each coordinate beside what its stretch transmits."""
    driver = real_series(forcing.crank)
    rate = frequency * derived(driver[:, None])
    gained = frequency * derived(rate)
    passed = jnp.concatenate([driver[:, None], rate, gained], axis=1) @ transmitted(lin, damping)
    return driver, real_series(forcing.torques) @ torque_loads(lin) - passed


def real_series(amplitudes: Complex[Array, "harmonics *rest"]) -> Float[Array, "terms *rest"]:
    """Coefficients of the sum of Re(z_k e^{i k tau})."""
    waves = jnp.stack([amplitudes[1:].real, -amplitudes[1:].imag], axis=1)
    return jnp.concatenate([amplitudes[:1].real, waves.reshape(-1, *amplitudes.shape[1:])])


def oscillator(excited: Excited, part: Float[Array, ""]) -> Oscillator:
    """The equations of motion under that part of the excitation."""
    m, w, harmonics = excited.model, excited.frequency, len(excited.driver) // 2
    by_time = w * derived(excited.driver[:, None])
    by_time, twice_by_time = by_time[:, 0], w * derived(by_time)[:, 0]

    def force(
        z: Float[Array, " size"], rate: Float[Array, " size"], phase: Float[Array, ""]
    ) -> Float[Array, " size"]:
        of = part * series(phase, harmonics)
        now = Driving(of @ excited.driver, of @ by_time, of @ twice_by_time)
        return beside_linear(m, z, rate, now) - of @ excited.load

    neutral = None
    if m.rigid is not None:
        neutral = Neutral(m.rigid, jnp.asarray(m.functions * len(m.work)))  # the driver's rotation
    return Oscillator(m.mass, m.damping, m.stiffness, excited.frequency, force, neutral)
