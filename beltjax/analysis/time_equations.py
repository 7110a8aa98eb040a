"""The equations of a drive over time, and the state from which they start."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from beltjax.analysis.driver_motion import CrankSignal, DriverMotion, driver_motion
from beltjax.analysis.motion import (
    narrowed,
    rigid_rotation,
    torque_loads,
    transmitted,
)
from beltjax.analysis.moving import (
    ModelAsked,
    Moving,
    moving,
)
from beltjax.analysis.orders import Forcing
from beltjax.compiling.quick import boundary_jit
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.shafts import transmission
from beltjax.drive.system import Drive
from beltjax.numerics.hybrid import HybridSystem, Mode
from beltjax.physics.joints import DECOUPLER, SPRING
from beltjax.physics.motion import Driving, MotionModel, beside_linear
from beltjax.physics.set_valued import has_modes, hybrid_drive
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    succeeded,
)

Scalar = Float[Array, ""]
State = Float[Array, " size"]

_NEWTON = 8  # steps to the state at which the drive begins
_NEAR = 1e-9  # the last of them, over the size of that state


class TransientAsked(ModelAsked):
    """What a transient is asked for, beside the drive."""

    times: Float[Array, " knots"]  # of the mean speed [s]
    speeds: Float[Array, " knots"]  # [rad/s]
    forcing: Forcing
    base: Scalar
    signal: CrankSignal | None
    initial: tuple[State, State] | None
    saves: Float[Array, " times"]  # [s]
    stepping: bool = eqx.field(static=True)  # from event to event


class Equations(eqx.Module):
    """M z'' + force = 0 of a drive whose driver's motion is given, dimensionless."""

    model: MotionModel
    inverse: Float[Array, "size size"]  # of M
    by_driver: Float[Array, "3 size"]  # force by the driver's angle, rate and acceleration
    by_torque: Float[Array, "pulleys size"]  # load by torques on hubs
    carried: State  # inertia of the drive that turns with the driver
    driver: DriverMotion
    start: Scalar  # [s]
    unit: Scalar  # of time [s]

    def acceleration(self, z: State, rate: State, t: Scalar) -> State:
        """Acceleration at a time of the equations, docs/theory/motion.md, (O17)."""
        m, now = self.model, self.driving(t)
        force = m.damping @ rate + m.stiffness @ z + beside_linear(m, z, rate, now)
        return -self.inverse @ (force - self.load(t, now))

    def load(self, t: Scalar, now: Driving) -> State:
        """What acts on the coordinates beside the drive itself."""
        torques = self.driver.at(self.start + self.unit * t).torques
        passed = jnp.stack([now.theta, now.rate, now.acceleration]) @ self.by_driver
        return torques @ self.by_torque - passed - now.rise * self.carried

    def system(self) -> HybridSystem:
        """The same with the laws that have modes."""

        def load(z: State, rate: State, t: Scalar) -> State:
            return self.load(t, self.driving(t))

        return hybrid_drive(self.model, self.driving, load)

    def driving(self, t: Scalar) -> Driving:
        """What the driver does, dimensionless."""
        driven, speed = self.driver.at(self.start + self.unit * t), self.model.speed
        assert speed is not None  # as `_begun` asks for
        return Driving(
            theta=driven.theta,
            rate=driven.rate * self.unit,
            acceleration=driven.acceleration * self.unit**2,
            faster=driven.Omega * self.unit - speed.omega0,
            rise=driven.gained * self.unit**2,
        )

    def at_rest(self, z: State) -> State:
        """The force on a drive that turns steadily as it does at the start, without excitation."""
        m, zero = self.model, jnp.zeros(())
        assert m.speed is not None
        if m.joints is not None:  # what lets its hub overrun is wound up, as in the steady state
            wound = jnp.where(m.joints.one_way, SPRING, m.joints.law)
            m = eqx.tree_at(lambda m: m.joints.law, m, wound)
            assert m.speed is not None
        now = Driving(zero, zero, zero, self.driver.speeds[0] * self.unit - m.speed.omega0)
        return m.stiffness @ z + beside_linear(m, z, jnp.zeros_like(z), now)


class Begun(NamedTuple):
    """A drive that is about to move."""

    made: Moving
    equations: Equations
    state: State  # coordinates and rates, and wind-ups
    mode: Mode
    saves: Float[Array, " times"]  # dimensionless, from 0
    kinks: Float[Array, " kinks"]  # likewise
    reference: Scalar  # speed of the driver [rad/s]
    result: RESULTS


@boundary_jit
def begun(drive: Drive, point: OperatingPoint, asked: TransientAsked) -> Begun:
    """The equations of a transient, and the state in which the drive begins."""
    lowest, highest = jnp.min(asked.speeds), jnp.max(asked.speeds)
    reference = (lowest + highest) / 2 if asked.initial is None else asked.speeds[0]
    about = point.at_driver_speed(reference)
    made = moving(drive, about, asked)
    lin, small, shapes = made.linearization, made.model, made.shapes
    by_driver = narrowed(shapes, transmitted(lin, asked.damping))
    rigid = narrowed(shapes, rigid_rotation(lin))
    driver = driver_motion(asked.times, asked.speeds, asked.forcing, asked.base, asked.signal)
    equations = Equations(
        model=small,
        inverse=jnp.linalg.inv(small.mass),
        by_driver=by_driver,
        by_torque=narrowed(shapes, torque_loads(lin)),
        carried=small.mass @ rigid + by_driver[2],
        driver=driver,
        start=asked.times[0],
        unit=lin.scales.time,
    )
    if asked.initial is None:
        z, near = _rest(equations)
        now = driver.at(asked.times[0])
        parts = z + now.theta * rigid, now.rate * equations.unit * rigid
    else:
        near = jnp.array(True)
        z, rates = (narrowed(shapes, part) for part in asked.initial)
        parts = z, rates * equations.unit
    state, mode = jnp.concatenate(parts), jnp.zeros(0, int)
    if asked.stepping:
        state = jnp.concatenate([state, _wind_ups(equations, parts[0])])
        mode = equations.system().started(state, jnp.zeros(()))
    stuck = jnp.any(
        jax.vmap(lambda speed: _stands_still(drive, about, speed))(asked.speeds)
    ) if point.load else jnp.array(False)  # fmt: skip
    finite = jnp.all(jnp.isfinite(state))
    result = first_failure(
        (~succeeded(lin.result), lin.result),
        (stuck | ~finite | (asked.saves[0] != asked.times[0]), RESULTS.numbers_unusable),
        (~near, RESULTS.steady_state_not_found),
        (has_modes(small) & ~jnp.asarray(asked.stepping), RESULTS.motion_has_modes),
    )
    begun = Begun(
        made=made,
        equations=equations,
        state=state,
        mode=mode,
        saves=(asked.saves - asked.times[0]) / equations.unit,
        kinks=(asked.times[1:-1] - asked.times[0]) / equations.unit,
        reference=reference,
        result=result,
    )
    return frozen_where_failed(begun, result)


def _wind_ups(equations: Equations, z: State) -> Float[Array, " joints"]:
    """Wind-ups of the springs of decouplers; 0 of other joints."""
    joints = equations.model.joints
    if joints is None:
        return jnp.zeros(0)
    theta = equations.driving(jnp.zeros(())).theta
    return jnp.where(joints.law == DECOUPLER, jnp.maximum(joints.wind_ups(z, theta), 0.0), 0.0)


def _stands_still(drive: Drive, point: OperatingPoint, speed: Scalar) -> Bool[Array, ""]:
    """Whether a load takes power at a speed of the driver at which its pulley stands still."""
    at = eqx.tree_at(lambda p: p.driver_speed, point, speed)
    return jnp.any(transmission(drive, at).at_standstill)


def _rest(equations: Equations) -> tuple[State, Bool[Array, ""]]:
    """The coordinates of the steady state at the first speed, and whether they were found."""
    fixed = jax.lax.stop_gradient(equations)
    none = jnp.zeros(len(equations.inverse))

    def step(_: int, state: tuple[State, State]) -> tuple[State, State]:
        z = state[0]
        moved = jnp.linalg.solve(jax.jacfwd(fixed.at_rest)(z), fixed.at_rest(z))
        return z - moved, moved

    z, last = jax.lax.fori_loop(0, _NEWTON, step, (none, none))
    near = jnp.linalg.norm(last) <= _NEAR * (jnp.linalg.norm(z) + 1.0)
    z = jnp.where(near, z, 0.0)
    slope = jax.jacfwd(fixed.at_rest)(z)
    # The derivative is that of the equations.
    left = equations.at_rest(z)
    z = z - jnp.linalg.solve(slope, left - jax.lax.stop_gradient(left))
    return z, near


def accelerations(
    begun: Begun, states: Float[Array, "times states"], modes: Int[Array, "times elements"]
) -> Float[Array, "times size"]:
    """Accelerations at the times that were kept."""
    of, size = begun.equations, len(begun.equations.inverse)
    if not modes.shape[1]:
        rates = states[:, size:]
        return jax.vmap(of.acceleration)(states[:, :size], rates, begun.saves)
    return jax.vmap(of.system().rate)(states, begun.saves, modes)[:, size : 2 * size]


def overruns(
    equations: Equations, times: Float[Array, " times"], states: Float[Array, "times states"]
) -> Float[Array, " joints"]:
    """Angle by which the hub of each one-way joint gains on its rim over the motion [rad]."""
    joints, size = equations.model.joints, len(equations.inverse)
    if joints is None:
        return jnp.zeros(0)
    if states.shape[1] == 2 * size:
        return jnp.zeros(len(joints.rows))

    def unwound(k: int) -> Float[Array, " joints"]:
        """Wind-up of the spring less that of the joint."""
        theta = equations.driving(times[k]).theta
        return states[k, 2 * size :] - joints.wind_ups(states[k, :size], theta)

    return jnp.where(joints.one_way, unwound(-1) - unwound(0), 0.0)
