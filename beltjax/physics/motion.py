"""Motion of a drive at finite amplitude about its steady state, dimensionless.

    z      coordinates: the functions of span 1, .., of span n, rotations, the bodies' coordinates
    theta  rotation of the driver, which is given
    eta    strain that a span gains: d.z + driving theta + N(z)
    N      its part beyond first order in z
    omega  speed of the driver, its rotation included; *0 marks that of the steady state

Spans stretch quasi-statically, so that all that is nonlinear in a drive is one number a span: the
functions have unit slopes, and N is half the sum of their squares and a quadratic form of the
bodies' coordinates. M, G and K are those of `vibration`; docs/theory/motion.md, (O1) to (O5), and
(O16) for belts whose speed varies.
"""

from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.numerics.loops import Loops
from beltjax.numerics.rigid_bodies import Bodies, moved
from beltjax.physics.accessories import Accessories
from beltjax.physics.friction import Friction
from beltjax.physics.joints import Joints
from beltjax.physics.vibration import VibrationModel

Scalar = Float[Array, ""]
Spans = Float[Array, " spans"]
State = Float[Array, " size"]
Part = TypeVar("Part", Joints, Accessories)


class SpanPaths(eqx.Module):
    """Geometry of the spans, for motions of the bodies that are not small."""

    x: Float[Array, " pulleys"]  # centers, as drawn
    y: Float[Array, " pulleys"]
    rise: Spans  # of the center line along the span's normal: of faces times radii
    senses: Spans
    bodies: Bodies
    steady: Float[Array, " coordinates"]  # their coordinates in the steady state
    lengths: Spans  # there
    along_x: Spans  # directions there
    along_y: Spans
    first: Float[Array, "spans coordinates"]  # derivatives of the elongations there
    second: Float[Array, "spans coordinates coordinates"]
    units: Spans  # lengths over which elongations are strains
    counted: Scalar  # 1, or 0 where the model leaves the curvature of the bodies' paths out
    loops: Loops

    def beyond(self, q: Float[Array, " coordinates"]) -> Spans:
        """Strain of third order and higher by the bodies at `q` from the steady state."""
        near = self.first @ q + jnp.einsum("a,iab,b->i", q, self.second, q) / 2
        return self.counted * (self.elongations(q) - near) / self.units

    def elongations(self, q: Float[Array, " coordinates"]) -> Spans:
        """What each span gains by the bodies at `q` from the steady state, the belt not turned.

        Its line gains length, and so do the arcs up to marks on its two pulleys (O4).
        """
        there = moved(self.bodies, self.x, self.y, self.bodies.carried, self.steady + q)
        following, rise = self.loops.following, self.senses * self.rise
        across, up = following(there.x) - there.x, following(there.y) - there.y
        square = across**2 + up**2 - rise**2
        # Where there is no tangent the motion is not one of this drive, but must stay finite.
        length = jnp.sqrt(jnp.where(square > 0, square, self.lengths**2))
        # The direction is that of (length, -rise) turned by the center line; both times a length.
        x, y = length * across + rise * up, length * up - rise * across
        turn = jnp.arctan2(self.along_x * y - self.along_y * x, self.along_x * x + self.along_y * y)
        return length - self.lengths - rise * turn


class BeltSpeed(eqx.Module):
    """What the drive's belts do beside (O2) where the speed of the driver varies (O16)."""

    gyroscopic: Float[Array, "size size"]  # G per unit of the driver's speed
    centrifugal: Spans  # lam mu s^2 at unit speed of the driver
    accelerated: Float[Array, "size size"]  # force per unit acceleration of the driver, by z ..
    bent: State  # .. and in the steady state
    omega0: Scalar

    def relief(self, omega: Scalar) -> Spans:
        """Tension that the turning of the belts takes beyond that of the steady state."""
        return self.centrifugal * (omega**2 - self.omega0**2)

    def force(self, z: State, rate: State, omega: Scalar, gained: Scalar) -> State:
        """The force beside that of `relief`, for a driver that gains speed at the rate `gained`."""
        carried = (omega - self.omega0) * (self.gyroscopic @ rate)
        return carried + gained * (self.accelerated @ z + self.bent)


class Driving(NamedTuple):
    """What the driver does at one time; dimensionless."""

    theta: Scalar  # its rotation beyond that at its mean speed
    rate: Scalar  # of that
    acceleration: Scalar
    faster: Scalar | float = 0.0  # its mean speed beyond that of the steady state
    rise: Scalar | float = 0.0  # acceleration of the mean speed


class MotionModel(eqx.Module):
    """The numbers of a drive in one steady state: M z'' + C z' + force = 0 without excitation."""

    mass: Float[Array, "size size"]
    damping: Float[Array, "size size"]  # C: gyroscopic and dissipative
    stiffness: Float[Array, "size size"]  # K, the stretch of the spans included
    elongations: Float[Array, "spans size"]  # d
    driving: Spans
    work: Spans  # lam gamma
    pull: Spans  # lam Q
    bodies: Float[Array, "spans coordinates coordinates"]  # N of the bodies is q.bodies q/2 ..
    paths: SpanPaths | None  # .. and what these add to it; None: nothing
    gains: Spans  # gamma: tension that a span gains by its strain
    friction: Friction  # dry, of the bodies
    joints: Joints | None  # those of pulleys that are not springs alone
    speed: BeltSpeed | None  # None: that of the steady state all the time
    accessories: Accessories | None  # those whose torques depend on speed
    rigid: State | None  # rotation that strains nothing; None where the driver's is given
    functions: int = eqx.field(static=True)  # of each span

    def parts(self, z: State) -> tuple[Float[Array, "spans n"], Float[Array, " coordinates"]]:
        """The spans' functions and the bodies' coordinates."""
        spans, count = self.bodies.shape[:2]
        fields = z[: spans * self.functions].reshape(spans, self.functions)
        return fields, z[len(z) - count :]


def quadratic_strains(model: VibrationModel) -> Float[Array, "spans coordinates coordinates"]:
    """Second derivatives of each span's strain by the bodies' coordinates, by lift and geometry."""
    moving = model.movable[:, None] * model.movable
    turned = model.a[:, :, None] * model.a[:, None, :]
    return moving * (turned + model.H / model.lam[:, None, None])


def projected(model: MotionModel, shapes: Float[Array, "spans n fewer"]) -> MotionModel:
    """The model with fewer functions on each span, combinations of its own.

    Columns of `shapes` are orthonormal, so that the slopes of the new functions are, too.
    """
    m, (spans, n, fewer) = model, shapes.shape

    def rows(matrix: Float[Array, "size *columns"]) -> Float[Array, "less *columns"]:
        belt = matrix[: spans * n].reshape(spans, n, -1)
        belt = jnp.einsum("inf,inc->ifc", shapes, belt)
        belt = belt.reshape(spans * fewer, matrix.shape[1])  # there may be no functions
        return jnp.concatenate([belt, matrix[spans * n :]])

    def square(matrix: Float[Array, "size size"]) -> Float[Array, "less less"]:
        return rows(rows(matrix).T).T

    speed = m.speed
    if speed is not None:
        less = square(speed.gyroscopic), square(speed.accelerated), rows(speed.bent[:, None])[:, 0]
        speed = eqx.tree_at(lambda s: (s.gyroscopic, s.accelerated, s.bent), speed, less)

    def fewer_columns(part: Part | None) -> Part | None:
        return part if part is None else eqx.tree_at(lambda p: p.rows, part, rows(part.rows.T).T)

    return MotionModel(
        mass=square(m.mass),
        damping=square(m.damping),
        stiffness=square(m.stiffness),
        elongations=rows(m.elongations.T).T,
        driving=m.driving,
        work=m.work,
        pull=m.pull,
        bodies=m.bodies,
        paths=m.paths,
        gains=m.gains,
        friction=m.friction,
        speed=speed,
        joints=fewer_columns(m.joints),
        accessories=fewer_columns(m.accessories),
        rigid=None if m.rigid is None else rows(m.rigid[:, None])[:, 0],
        functions=fewer,
    )


def beyond_linear(model: MotionModel, z: State) -> Spans:
    """N of each span (O1)."""
    fields, q = model.parts(z)
    second = (jnp.sum(fields**2, axis=1) + jnp.einsum("a,iab,b->i", q, model.bodies, q)) / 2
    return second + beyond_second(model, z)


def beyond_second(model: MotionModel, z: State) -> Spans:
    """The part of N that is of third order and higher, of the bodies' paths (O4)."""
    if model.paths is None:
        return jnp.zeros_like(model.work)
    return model.paths.beyond(model.parts(z)[1])


def strains(model: MotionModel, z: State, theta: Scalar | float = 0.0) -> Spans:
    """Strain that each span gains (O1)."""
    return model.elongations @ z + model.driving * theta + beyond_linear(model, z)


def stretching(
    model: MotionModel,
    z: State,
    theta: Scalar | float = 0.0,
    relief: Spans | float = 0.0,
) -> State:
    """The force of the spans' stretch without its part K z, which is linear in z (O2).

    Of the tension that pulls on slopes and bodies `relief` is taken off (O16).
    """
    m = model
    N, back = jax.vjp(lambda z: beyond_linear(m, z), z)
    beyond = m.work * (m.driving * theta + N) - relief
    (force,) = back(m.work * (m.elongations @ z) + beyond)
    if m.paths is not None:
        # K holds what the steady tension does to the second order of N.
        (held,) = jax.vjp(lambda z: beyond_second(m, z), z)[1](m.pull)
        force = force + held
    return beyond @ m.elongations + force


def friction_bounds(
    model: MotionModel, z: State, theta: Scalar | float
) -> tuple[Float[Array, " coordinates"], Float[Array, " coordinates"]]:
    """Least and greatest force of dry friction on each body."""
    none = model.friction.loaded is None
    gains = jnp.zeros_like(model.gains) if none else model.gains * strains(model, z, theta)
    return model.friction.bounds(model.parts(z)[1], gains)


def dry_friction(model: MotionModel, z: State, rate: State, theta: Scalar | float) -> State:
    """The force of smooth dry friction against the bodies' motion (O5)."""
    moved = len(rate) - len(model.friction.constant)
    on_bodies = model.friction.smooth(rate[moved:], *friction_bounds(model, z, theta))
    return jnp.concatenate([jnp.zeros(moved), on_bodies])


def beside_linear(model: MotionModel, z: State, rate: State, now: Driving) -> State:
    """All forces of the drive itself beside M z'' + C z' + K z, on the same side."""
    m, relief = model, 0.0
    found = dry_friction(m, z, rate, now.theta)
    if m.joints is not None:
        found = found + m.joints.force(z, rate, now.theta, now.rate)
    if m.accessories is not None:
        found = found + m.accessories.force(rate, now.faster)
    if m.speed is not None:
        omega = m.speed.omega0 + now.faster + now.rate
        relief = m.speed.relief(omega)
        found = found + m.speed.force(z, rate, omega, now.rise + now.acceleration)
    return found + stretching(m, z, now.theta, relief)


def energy(model: MotionModel, z: State, rate: State) -> Scalar:
    """Energy of a motion about the steady state, with the driver at rest (O3).

    Without damping it stays what it is; gyroscopic forces do no work.
    """
    m, N = model, beyond_linear(model, z)
    stretch = jnp.sum(m.work * N * (m.elongations @ z + N / 2) + m.pull * beyond_second(m, z))
    return (rate @ m.mass @ rate + z @ m.stiffness @ z) / 2 + stretch
