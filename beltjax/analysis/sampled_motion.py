"""A motion over time, by its states at the times that were kept."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from beltjax.analysis.driver_motion import DriverMotion
from beltjax.analysis.motion import widened
from beltjax.analysis.orbit_motion import AbstractMotion, MotionGrid, open_clutches
from beltjax.numerics.hybrid import BELOW, ENGAGED
from beltjax.physics.motion import MotionModel
from beltjax.physics.set_valued import friction_power

Scalar = Float[Array, ""]
State = Float[Array, " size"]


class SampledMotion(AbstractMotion):
    """A motion by its coordinates, rates and accelerations at times, joined by quintic curves.

    The variable is the dimensionless time from the start on.
    """

    times: Float[Array, " times"]
    values: Float[Array, "times size"]  # of fewer functions than the linearization's
    rates: Float[Array, "times size"]
    accelerations: Float[Array, "times size"]
    modes: Int[Array, "times elements"]  # of a drive whose laws have none: no elements
    overruns: Float[Array, " joints"]  # [rad]
    shapes: Float[Array, "spans n functions"]
    driver: DriverMotion
    start: Scalar  # [s]
    unit: Scalar  # of time [s]
    omega0: Scalar  # speed of the driver in the steady state
    frequency: Scalar  # 1: the variable is the time

    def at(self, phase: Scalar) -> State:
        """Hermite's interpolation in time."""
        return widened(self.shapes, self._joined(phase, 0))

    def rate(self, phase: Scalar) -> State:
        """Its derivative."""
        return widened(self.shapes, self._joined(phase, 1))

    def turned(self, phase: Scalar) -> Scalar:
        """The driver's rotation beyond that at its mean speed."""
        return self.driver.at(self._time(phase)).theta

    def faster(self, phase: Scalar) -> Scalar:
        """The driver's speed, its rotation included, beyond that of the steady state."""
        now = self.driver.at(self._time(phase))
        return (now.Omega + now.rate) * self.unit - self.omega0

    @property
    def duration(self) -> Scalar:
        """All of the time."""
        return self.times[-1]

    def mean(self) -> State:
        """By the trapezoidal rule."""
        return widened(self.shapes, trapezoid(self.times) @ self.values / self.duration)

    def grid(self, samples: int = 0) -> MotionGrid:
        """The times that were kept."""
        weights = trapezoid(self.times) / self.duration
        ends = self.times[0], self.times[-1]
        return MotionGrid(self.times, weights, jnp.max(jnp.diff(self.times)), ends)

    def friction_work(self, model: MotionModel, grid: MotionGrid) -> Float[Array, " tensioners"]:
        """Work of dry friction over the motion, of each body."""
        count = len(model.friction.constant)
        modes = self.modes[:, :count] if self.modes.shape[1] else jnp.zeros((len(grid.at), count))

        def power(at: Scalar, mode: Array) -> Float[Array, " tensioners"]:
            rate, z, theta = self.rate(at), self.at(at), self.turned(at)
            bodies = rate[len(rate) - count :]
            return friction_power(model, z, bodies, theta, mode)

        return self.duration * (grid.weights @ jax.vmap(power)(grid.at, modes))

    def stuck(self, model: MotionModel) -> Float[Array, " tensioners"]:
        """Part of the time in which friction holds each body; smooth friction holds none."""
        count = len(model.friction.constant)
        if not self.modes.shape[1]:
            return jnp.zeros(count)
        return self._fractions((self.modes[:, :count] == ENGAGED) & model.friction.holds())

    def _fractions(self, flags: Bool[Array, "times items"]) -> Float[Array, " items"]:
        return trapezoid(self.times) @ flags.astype(float) / self.duration

    def overrun(self, model: MotionModel) -> Float[Array, " joints"]:
        """Angle by which the hub of each joint gains on its rim over the motion [rad]."""
        return self.overruns

    def open(
        self, model: MotionModel, wound: Float[Array, "times joints"], weights: Array
    ) -> Float[Array, " joints"]:
        """Part of the time in which each joint is open, without a derivative."""
        found = open_clutches(model, wound, weights)
        if model.joints is None or not self.modes.shape[1]:
            return found
        joints = self.modes[:, len(model.friction.constant) :]
        return found + self._fractions((joints == BELOW) & model.joints.one_way)

    def _time(self, at: Scalar) -> Scalar:
        return self.start + self.unit * at

    def _joined(self, at: Scalar, order: int) -> State:
        """The quintic between two times, or its derivative."""
        k = jnp.clip(jnp.searchsorted(self.times, at, side="right") - 1, 0, len(self.times) - 2)
        h = self.times[k + 1] - self.times[k]
        x = (at - self.times[k]) / h
        first, last = (
            jnp.stack([self.values[j], h * self.rates[j], h**2 * self.accelerations[j]])
            for j in (k, k + 1)
        )
        # By products: JAX has no derivative of 0 ** 0.
        powers = jnp.concatenate([jnp.ones(1), jnp.cumprod(jnp.full(5, x))])
        if order:
            powers = jnp.concatenate([jnp.zeros(1), np.arange(1, 6) * powers[:-1]]) / h
        return (powers @ _QUINTIC) @ jnp.concatenate([first, last])


# Coefficients of 1, x, .., x^5 by value, slope and second derivative at 0 and at 1.
_QUINTIC = np.linalg.inv(
    [
        [np.prod(np.arange(k, k - order, -1)) * (x ** max(k - order, 0)) * (k >= order)
         for k in range(6)]
        for x in (0.0, 1.0)
        for order in range(3)
    ]
)  # fmt: skip


def trapezoid(times: Float[Array, " times"]) -> Float[Array, " times"]:
    """Weights of the trapezoidal rule."""
    steps = jnp.diff(times) / 2
    none = jnp.zeros(1)
    return jnp.concatenate([steps, none]) + jnp.concatenate([none, steps])
