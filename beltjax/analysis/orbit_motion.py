"""A motion as a function of its own variable: of its phase where it is periodic, or of time.

A periodic motion is a Fourier series, or the steps of shooting.
"""

import abc
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from beltjax.analysis.motion import widened
from beltjax.numerics.harmonic_balance import Coefficients, derived, series
from beltjax.numerics.hybrid import BELOW, ENGAGED
from beltjax.numerics.shooting import Trajectory
from beltjax.physics.motion import MotionModel, dry_friction
from beltjax.physics.set_valued import friction_power

_TIMES = 4  # points of time per sample, or per step, from which extremes are refined

Scalar = Float[Array, ""]
State = Float[Array, " size"]
Bodies = Float[Array, " tensioners"]


class MotionGrid(NamedTuple):
    """Points of a motion's variable."""

    at: Float[Array, " times"]
    weights: Float[Array, " times"]  # in a mean over the motion
    reach: Scalar  # largest distance between neighbors
    limits: tuple[Scalar | float, Scalar | float]  # of the variable


_ENDLESS = (-np.inf, np.inf)  # limits of a phase


class AbstractMotion(eqx.Module):
    """Coordinates of the linearization over a variable; of a periodic motion about its drift."""

    frequency: eqx.AbstractVar[Scalar]  # rate of the variable, dimensionless

    @abc.abstractmethod
    def at(self, phase: Scalar) -> State:
        """The coordinates."""

    def rate(self, phase: Scalar) -> State:
        """Their rates by dimensionless time."""
        return self.frequency * jax.jvp(self.at, (phase,), (jnp.ones_like(phase),))[1]

    @abc.abstractmethod
    def turned(self, phase: Scalar) -> Scalar:
        """The rotation of the driver beyond that at its mean speed."""

    @abc.abstractmethod
    def faster(self, phase: Scalar) -> Scalar:
        """By how much the driver turns faster than in the steady state."""

    @property
    @abc.abstractmethod
    def duration(self) -> Scalar:
        """Dimensionless time of the whole motion."""

    @abc.abstractmethod
    def mean(self) -> State:
        """Mean of the coordinates over the motion."""

    @abc.abstractmethod
    def grid(self, samples: int) -> MotionGrid:
        """Points from which extremes are refined."""

    @abc.abstractmethod
    def friction_work(self, model: MotionModel, grid: MotionGrid) -> Bodies:
        """Work of dry friction over the motion, of each body."""

    @abc.abstractmethod
    def stuck(self, model: MotionModel) -> Bodies:
        """Part of the time in which friction holds each body."""

    @abc.abstractmethod
    def overrun(self, model: MotionModel) -> Float[Array, " joints"]:
        """Angle by which the hub of each joint gains on its rim over the motion [rad]."""

    @abc.abstractmethod
    def open(
        self, model: MotionModel, wound: Float[Array, "times joints"], weights: Array
    ) -> Float[Array, " joints"]:
        """Part of the time in which each joint is open, from the wind-ups over the grid."""


class _OverPhase(AbstractMotion):
    """A periodic motion, whose phase goes from 0 to 2 pi."""

    driver: eqx.AbstractVar[Float[Array, " terms"]]

    def turned(self, phase: Scalar) -> Scalar:
        """The rotation of the driver."""
        return series(phase, len(self.driver) // 2) @ self.driver

    def faster(self, phase: Scalar) -> Scalar:
        """Its rate."""
        by_phase = derived(self.driver[:, None])[:, 0]
        return self.frequency * (series(phase, len(self.driver) // 2) @ by_phase)

    @property
    def duration(self) -> Scalar:
        """The period."""
        return 2 * jnp.pi / self.frequency


class HarmonicMotion(_OverPhase):
    """A motion by its Fourier coefficients: the mean, then cosine and sine of each harmonic."""

    coefficients: Coefficients
    driver: Float[Array, " terms"]
    frequency: Scalar

    def at(self, phase: Scalar) -> State:
        """The coordinates."""
        return series(phase, len(self.coefficients) // 2) @ self.coefficients

    def mean(self) -> State:
        """Their mean over the period."""
        return self.coefficients[0]

    def grid(self, samples: int) -> MotionGrid:
        """Equal phases, some for each sample."""
        count = _TIMES * samples
        step = 2 * jnp.pi / count
        phases, weights = jnp.arange(count) * step, jnp.full(count, 1 / count)
        return MotionGrid(phases, weights, jnp.asarray(step), _ENDLESS)

    def friction_work(self, model: MotionModel, grid: MotionGrid) -> Bodies:
        """Work of dry friction over a period, of each body."""
        X, count = self.coefficients, len(model.friction.constant)

        # Speeds are derivatives by the phase here, and so is the work: w drops out but in tanh.
        def power(phase: Scalar) -> Bodies:
            of = series(phase, len(X) // 2)
            rate = of @ derived(X)
            force = dry_friction(model, of @ X, self.frequency * rate, self.turned(phase))
            return (force * rate)[len(rate) - count :]

        return 2 * jnp.pi * jnp.mean(jax.vmap(power)(grid.at), axis=0)

    def stuck(self, model: MotionModel) -> Bodies:
        """Smooth friction holds no body."""
        return jnp.zeros_like(model.friction.constant)

    def overrun(self, model: MotionModel) -> Float[Array, " joints"]:
        """A Fourier series has no steady drift."""
        return jnp.zeros(0 if model.joints is None else len(model.joints.rows))

    def open(
        self, model: MotionModel, wound: Float[Array, "times joints"], weights: Array
    ) -> Float[Array, " joints"]:
        """Part of the period in which each clutch is open, without a derivative."""
        return open_clutches(model, wound, weights)


class SteppedMotion(_OverPhase):
    """A motion by the steps of a period, which end at its events."""

    trajectory: Trajectory
    shapes: Float[Array, "spans n functions"]  # of the functions of the steps
    driver: Float[Array, " terms"]
    frequency: Scalar

    def at(self, phase: Scalar) -> State:
        """The coordinates."""
        x = self.trajectory.at(phase / (2 * jnp.pi))
        return widened(self.shapes, x[: self.trajectory.positions])

    def mean(self) -> State:
        """Their mean over the period."""
        states, weights = self.trajectory.stages
        return widened(self.shapes, weights @ states[:, : self.trajectory.positions])

    def coefficients(self, harmonics: int) -> Coefficients:
        """Fourier coefficients; of a motion with kinks the higher ones are poor."""
        states, weights = self.trajectory.stages
        waves = series(2 * jnp.pi * self.trajectory.parts, harmonics)
        twice = jnp.where(jnp.arange(2 * harmonics + 1) > 0, 2.0, 1.0)
        found = (waves * weights[:, None] * twice).T @ states[:, : self.trajectory.positions]
        return widened(self.shapes, found)

    def grid(self, samples: int) -> MotionGrid:
        """Equal parts of each step."""
        steps = self.trajectory.steps
        long = jax.lax.stop_gradient(steps.end - steps.start)
        starts = jax.lax.stop_gradient(steps.start)
        parts = starts[:, None] + long[:, None] * (np.arange(_TIMES) / _TIMES)
        weights = jnp.repeat(long / _TIMES, _TIMES)
        reach = 2 * jnp.pi * jnp.max(long) / _TIMES
        return MotionGrid(2 * jnp.pi * parts.ravel(), weights, reach, _ENDLESS)

    def friction_work(self, model: MotionModel, grid: MotionGrid) -> Bodies:
        """Work of dry friction over a period, of each body."""
        path, count = self.trajectory, len(model.friction.constant)
        states, weights = path.stages
        modes = jnp.repeat(path.steps.modes[:, :count], 3, axis=0)
        turned = jax.vmap(lambda part: self.turned(2 * jnp.pi * part))

        def power(x: Array, mode: Array, theta: Scalar) -> Bodies:
            z, rate = widened(self.shapes, x[: path.positions]), x[path.positions :]
            bodies = rate[path.positions - count : path.positions]
            return friction_power(model, z, bodies, theta, mode)

        return path.period * (weights @ jax.vmap(power)(states, modes, turned(path.parts)))

    def _fractions(self, flags: Bool[Array, "steps items"]) -> Float[Array, " items"]:
        steps = self.trajectory.steps
        return (steps.end - steps.start) @ flags.astype(float)

    def stuck(self, model: MotionModel) -> Bodies:
        """Part of the period in which friction holds each body."""
        modes = self.trajectory.steps.modes[:, : len(model.friction.constant)]
        return self._fractions((modes == ENGAGED) & model.friction.holds())

    def overrun(self, model: MotionModel) -> Float[Array, " joints"]:
        """Angle by which the hub of each joint gains on its rim in a period [rad]."""
        return self.trajectory.drift if model.joints is not None else jnp.zeros(0)

    def open(
        self, model: MotionModel, wound: Float[Array, "times joints"], weights: Array
    ) -> Float[Array, " joints"]:
        """Part of the period in which each joint is open."""
        if model.joints is None:
            return jnp.zeros(0)
        modes = self.trajectory.steps.modes[:, len(model.friction.constant) :]
        one_way = self._fractions((modes == BELOW) & model.joints.one_way)
        return one_way + open_clutches(model, wound, weights)


def open_clutches(
    model: MotionModel, wound: Float[Array, "times joints"], weights: Array
) -> Float[Array, " joints"]:
    """Part of the time in which each spring clutch is open; springs never are."""
    if model.joints is None:
        return jnp.zeros(0)
    return model.joints.clutch * (weights @ (wound < 0).astype(float))
