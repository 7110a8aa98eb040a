"""What a motion does to the parts of a drive: amplitudes, extremes of tension, slip."""

import abc
from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from beltjax.analysis.linearization import Linearization
from beltjax.analysis.orbit_motion import AbstractMotion, MotionGrid
from beltjax.compiling.quick import usual_promotion
from beltjax.drive.readable import Readable
from beltjax.drive.system import Drive
from beltjax.numerics.loops import Loops
from beltjax.numerics.roots import solve_dense
from beltjax.physics.motion import MotionModel, strains

Given = TypeVar("Given")
_PLACES = 33  # points of a span
_REFINEMENTS = 3  # of Newton's method
_MOST = 1e6  # slip exponent of a pulley beside a span without tension


class Measures(Readable):
    """Extremes of a motion, all in SI units; deviations from the steady state.

    A periodic motion is measured over its period, a transient one over all of its time.

    Their derivatives are exact: an extreme's own place in time changes nothing to first order.
    """

    rotation_amplitudes: Float[Array, " pulleys"]  # of the rims, half peak to peak [rad]
    hub_rotation_amplitudes: Float[Array, " pulleys"]  # [rad]
    travels: Float[Array, " tensioners"]  # peak to peak [rad] or [m]
    mean_motions: Float[Array, " tensioners"]  # [rad] or [m]
    greatest_motions: Float[Array, "tensioners 2"]  # least and greatest [rad] or [m]
    friction_work: Float[Array, " tensioners"]  # of their dry friction [J]
    stuck_fractions: Float[Array, " tensioners"]  # part of the time in which it holds them
    open_fractions: Float[Array, " isolators"]  # part of the time in which a clutch is open
    overrun_per_period: Float[Array, " isolators"]  # of the hub beyond the rim [rad]
    overrun_speeds: Float[Array, " isolators"]  # by which the hub turns faster on average [rad/s]
    tension_min: Float[Array, " spans"]  # [N]
    tension_max: Float[Array, " spans"]  # [N]
    slack_fractions: Float[Array, " spans"]  # part of the time with a tension below 0
    span_peaks: Float[Array, " spans"]  # largest deflection over each span [m]
    slope_max: Float[Array, " spans"]  # largest slope of the deflection
    hub_load_max: Float[Array, " pulleys"]  # [N], of the vector sum of the effective tensions
    # |ln(Q_out/Q_in)|: above friction times wrap a pulley slips.
    slip_exponent_max: Float[Array, " pulleys"]


class Signals(eqx.Module):
    """A motion as functions of its variable, in SI units."""

    linearization: Linearization
    model: MotionModel
    motion: AbstractMotion

    def state(self, phase: Float[Array, ""]) -> tuple[Float[Array, " size"], Float[Array, ""]]:
        """Coordinates and the driver's rotation."""
        return self.motion.at(phase), self.motion.turned(phase)

    def effective(self, phase: Float[Array, ""]) -> Float[Array, " spans"]:
        """Tension of each span less what turns the belt round, dimensionless."""
        lin, speed = self.linearization, self.model.speed
        Q = lin.steady.effective_tensions + self.gains(phase) / lin.scales.tension
        if speed is None:
            return Q
        return Q - speed.relief(speed.omega0 + self.motion.faster(phase)) / lin.model.lam

    def rotors(self, phase: Float[Array, ""]) -> Float[Array, " rotors"]:
        """Rotations of all rotors [rad]."""
        z, theta = self.state(phase)
        _, rotations, _ = self.linearization.split(z)
        return rotations.at[self.linearization.driver].add(theta)

    def motions(self, phase: Float[Array, ""]) -> Float[Array, " tensioners"]:
        """Motions of the tensioners [rad] or [m]."""
        z, _ = self.state(phase)
        return self.linearization.split(z)[2] * self.linearization.units

    def gains(self, phase: Float[Array, ""]) -> Float[Array, " spans"]:
        """Tension that each span gains [N]."""
        lin = self.linearization
        return lin.scales.tension * lin.model.gam * strains(self.model, *self.state(phase))

    def hub_loads(self, phase: Float[Array, ""]) -> Float[Array, " pulleys"]:
        """Load on each hub [N], without the part of the tensions that turns the belt round."""
        lin, loops = self.linearization, self.linearization.steady.groups.loops
        pulls = lin.scales.tension * self.effective(phase)
        pulls = pulls[:, None] * lin.steady.reference.layout.directions
        square = jnp.sum((pulls - loops.preceding(pulls)) ** 2, axis=1)
        return jnp.sqrt(jnp.where(square > 0, square, 1e-300))

    def slip_exponents(self, phase: Float[Array, ""]) -> Float[Array, " pulleys"]:
        """|ln(Q_out/Q_in)| of each pulley."""
        return slip_exponents(self.effective(phase), self.linearization.steady.groups.loops)


def slip_exponents(Q: Float[Array, " spans"], loops: Loops) -> Float[Array, " pulleys"]:
    """|ln(Q_out/Q_in)| of each pulley, for effective tensions; very large beside a slack span."""
    pulled = Q > 0
    logarithm = jnp.log(jnp.where(pulled, Q, 1.0))
    both = pulled & loops.preceding(pulled)
    return jnp.where(both, jnp.abs(logarithm - loops.preceding(logarithm)), _MOST)


class OverTime(eqx.Module):
    """A motion that is asked for at times."""

    linearization: eqx.AbstractVar[Linearization]
    signals: eqx.AbstractVar[Signals]

    @abc.abstractmethod
    def _variable(self, times: Float[Array, " times"]) -> Float[Array, " times"]:
        """The motion's own variable at times [s]."""

    @usual_promotion
    def at(self, t: Array | np.ndarray | float) -> Float[Array, "*times size"]:
        """Deviation from the steady state at times [s], in the linearization's coordinates."""
        return self._over(lambda at: self.signals.state(at)[0], t)

    @usual_promotion
    def rotations(self, t: Array | np.ndarray | float) -> Float[Array, "*times pulleys"]:
        """Rotations of the hubs beyond their mean speed at times [s], in [rad]."""
        return self._over(lambda at: self.linearization.of_pulleys(self.signals.rotors(at)), t)

    @usual_promotion
    def tensioner_motions(self, t: Array | np.ndarray | float) -> Float[Array, "*times tensioners"]:
        """Motions of the tensioners from the steady state at times [s], in [rad] or [m]."""
        return self._over(self.signals.motions, t)

    @usual_promotion
    def tensions(self, t: Array | np.ndarray | float) -> Float[Array, "*times spans"]:
        """Tensions of the spans at times [s], in [N]."""
        running = self.linearization.steady.running_tensions
        return running + self._over(self.signals.gains, t)

    @usual_promotion
    def hub_loads(self, t: Array | np.ndarray | float) -> Float[Array, "*times pulleys"]:
        """Load on each hub at times [s], of the vector sum of the effective tensions, in [N]."""
        return self._over(self.signals.hub_loads, t)

    def _over(
        self, function: Callable[[Float[Array, ""]], Array], t: Array | np.ndarray | float
    ) -> Float[Array, "*times items"]:
        times = jnp.asarray(t, float)
        found = jax.vmap(function)(self._variable(times.ravel()))
        return found.reshape(*times.shape, *found.shape[1:])


def measures(signals: Signals, samples: int) -> Measures:
    """Extremes of the motion; a periodic one was found with that many samples."""
    lin = signals.linearization
    groups, steady = lin.steady.groups, lin.steady
    motion, model = signals.motion, signals.model
    grid = motion.grid(samples)

    def all_of(signals: Signals, phase: Float[Array, ""]) -> Float[Array, " items"]:
        rotors = signals.rotors(phase)
        rotations = groups.turning @ rotors, lin.of_pulleys(rotors)
        pulls = signals.gains(phase), signals.hub_loads(phase), signals.slip_exponents(phase)
        return jnp.concatenate([*rotations, signals.motions(phase), *pulls])

    sizes = [lin.spans, lin.spans, lin.bodies, lin.spans, lin.spans]
    ends = jnp.split(extremes(all_of, signals, grid), np.cumsum(sizes), axis=1)
    rims, hubs, motions, gains, loads, use = ends
    slack = jax.vmap(signals.gains)(grid.at) + steady.running_tensions < 0
    peaks, slopes = _deflections(signals, grid)
    overrun = motion.overrun(model)
    return Measures(
        rotation_amplitudes=(rims[1] - rims[0]) / 2,
        hub_rotation_amplitudes=(hubs[1] - hubs[0]) / 2,
        travels=motions[1] - motions[0],
        mean_motions=lin.split(motion.mean())[2] * lin.units,
        greatest_motions=motions.T,
        friction_work=motion.friction_work(model, grid) * lin.scales.energy,
        stuck_fractions=motion.stuck(model),
        open_fractions=motion.open(model, _wind_ups(signals, grid), grid.weights),
        overrun_per_period=overrun,
        overrun_speeds=overrun / (motion.duration * lin.scales.time),
        tension_min=steady.running_tensions + gains[0],
        tension_max=steady.running_tensions + gains[1],
        slack_fractions=grid.weights @ slack.astype(float),
        span_peaks=peaks * lin.model.lam * lin.scales.length,
        slope_max=slopes,
        hub_load_max=loads[1],
        slip_exponent_max=use[1],
    )


def _wind_ups(signals: Signals, grid: MotionGrid) -> Float[Array, "times joints"]:
    """Wind-up of each joint over the motion."""
    joints = signals.model.joints
    if joints is None:
        return jnp.zeros((len(grid.at), 0))
    return jax.vmap(lambda phase: joints.wind_ups(*signals.state(phase)))(grid.at)


def extremes(
    function: Callable[[Given, Float[Array, ""]], Float[Array, " items"]],
    signals: Given,
    grid: MotionGrid,
) -> Float[Array, "2 items"]:
    """Least and greatest value over the motion of each item of a function of its variable.

    The best of the points given is refined by Newton's method.
    """
    phases, _, reach, limits = grid
    fixed = jax.lax.stop_gradient(signals)
    values = jax.vmap(lambda phase: function(fixed, phase))(phases)
    starts = phases[jnp.stack([jnp.argmin(values, axis=0), jnp.argmax(values, axis=0)])]
    one = jnp.ones(())
    sign = jnp.array([[1.0], [-1.0]])

    def slope(phase: Float[Array, ""]) -> Float[Array, " items"]:
        return jax.jvp(lambda phase: function(fixed, phase), (phase,), (one,))[1]

    def slopes(phase: Float[Array, ""], item: Int[Array, ""]) -> tuple[Array, Array]:
        first, second = jax.jvp(slope, (phase,), (one,))
        return first[item], second[item]

    def newton(_: Array, at: Float[Array, "2 items"]) -> Float[Array, "2 items"]:
        first, second = jax.vmap(jax.vmap(slopes), (0, None))(at, jnp.arange(at.shape[1]))
        curved = sign * second > 0
        step = jnp.where(curved, -first / jnp.where(curved, second, 1.0), 0.0)
        near = jnp.clip(at + step, starts - reach, starts + reach)
        return jnp.clip(near, *limits)

    at = jax.lax.fori_loop(0, _REFINEMENTS, newton, starts)
    # At a kink, and on a plateau, the best of the given ones is the extreme itself.
    given = jnp.stack([jnp.min(values, axis=0), jnp.max(values, axis=0)])
    refined = jax.vmap(jax.vmap(lambda phase: function(fixed, phase)))(at)
    refined = jnp.stack([jnp.diag(row) for row in refined])
    at = jnp.where(sign * refined < sign * given, at, starts)
    every = jax.vmap(jax.vmap(lambda phase: function(signals, phase)))(at)
    return jnp.stack([jnp.diag(row) for row in every])


def _deflections(
    signals: Signals, times: MotionGrid
) -> tuple[Float[Array, " spans"], Float[Array, " spans"]]:
    """Largest deflection of each span over its length, and largest slope, in space and time."""
    lin, phases = signals.linearization, times.at
    fixed = jax.lax.stop_gradient(signals)
    grid = jnp.linspace(0.0, 1.0, _PLACES)
    states = jax.vmap(lambda phase: fixed.state(phase)[0])(phases)

    def of_span(i: Int[Array, ""]) -> tuple[Array, Array]:
        def at(signals: Signals, point: Float[Array, "2"], order: int = 0) -> Array:
            return signals.linearization.deflection(signals.state(point[1])[0], i, point[0], order)

        table = jax.vmap(lambda z: lin.deflection(z, i, grid))(states)
        time, place = jnp.unravel_index(jnp.argmax(jnp.abs(table)), table.shape)
        start = jnp.stack([grid[place], phases[time]])
        sign = jnp.sign(table[time, place])
        reach = jnp.stack([grid[1], times.reach])

        def newton(_: Array, point: Float[Array, "2"]) -> Float[Array, "2"]:
            slope = jax.grad(lambda point: -sign * at(fixed, point))
            first, (second, mixed) = slope(point), jax.jacfwd(slope)(point)
            determinant = second[0] * mixed[1] - second[1] * mixed[0]
            curved = (determinant > 0) & (second[0] > 0)
            step = -solve_dense(jnp.stack([second, mixed]), first)
            step = jnp.where(curved, step, 0.0)
            point = jnp.clip(point + step, start - reach, start + reach)
            return jnp.stack([jnp.clip(point[0], 0.0, 1.0), jnp.clip(point[1], *times.limits)])

        point = jax.lax.fori_loop(0, _REFINEMENTS, newton, start)
        steepest = jnp.max(jnp.abs(jax.vmap(lambda z: lin.deflection(z, i, grid, 1))(states)))
        return sign * at(signals, point), steepest

    return jax.vmap(of_span)(jnp.arange(lin.spans))


def held_exponents(drive: Drive, wraps: Float[Array, " pulleys"]) -> Float[Array, " pulleys"]:
    """Friction times wrap: |ln(Q_out/Q_in)| above which a pulley slips; 0 without friction."""
    friction = [pulley.holding for pulley in drive.pulleys]
    return jnp.stack([jnp.zeros(()) if one is None else one for one in friction]) * wraps


def friction_use(drive: Drive, lin: Linearization, found: Measures) -> Float[Array, " pulleys"]:
    """Largest |ln(Q_out/Q_in)| over friction times wrap; 0 where there is no friction."""
    hold = held_exponents(drive, lin.steady.reference.layout.wraps)
    return jnp.where(hold > 0, found.slip_exponent_max / jnp.where(hold > 0, hold, 1.0), 0.0)
