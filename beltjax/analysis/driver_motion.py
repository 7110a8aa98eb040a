"""What the driver does over time: run-up, coast-down, start and stop, and how its rotation shakes.

psi    angle of the frame that turns with the mean speed Omega of the driver
theta  rotation of the driver beyond it
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from beltjax.analysis.motion import real_series
from beltjax.analysis.orders import Forcing
from beltjax.drive.components import as_optional, as_real, concrete
from beltjax.numerics.cubic_spline import FEWEST, CubicSpline, cubic_spline
from beltjax.numerics.harmonic_balance import derived, series

Scalar = Float[Array, ""]


class CrankSignal(eqx.Module):
    """A measured or computed rotation of the driver over time: its angles, or its speeds.

    Give `angles` beyond the rotation at the mean speed, or `speeds`, which contain that. A cubic
    spline joins them, so that belts which follow the driver have an acceleration. Raises
    `ValueError` for fewer than four times, times that do not increase, both or neither of angles
    and speeds, and as many as there are not times.
    """

    times: Float[Array, " points"] = eqx.field(converter=as_real)  # [s]
    angles: Float[Array, " points"] | None = eqx.field(converter=as_optional, default=None)  # [rad]
    speeds: Float[Array, " points"] | None = eqx.field(
        converter=as_optional, default=None
    )  # [rad/s]

    def __check_init__(self):
        if (self.angles is None) == (self.speeds is None):
            raise ValueError("CrankSignal: give either angles or speeds.")
        values = self.angles if self.speeds is None else self.speeds
        if self.times.ndim != 1 or len(self.times) < FEWEST or values is None:
            raise ValueError(f"CrankSignal.times: give a list of at least {FEWEST} [s].")
        if values.shape != self.times.shape:
            name = "angles" if self.speeds is None else "speeds"
            raise ValueError(
                f"CrankSignal.{name}: found shape {values.shape}; give one for each of "
                f"{len(self.times)} times."
            )
        times = concrete(self.times)
        if times is not None and not (np.diff(times) > 0).all():
            raise ValueError("CrankSignal.times: must increase from each to the next.")


class Driven(NamedTuple):
    """The driver at one time, in SI units."""

    psi: Scalar  # [rad]
    Omega: Scalar  # [rad/s]
    gained: Scalar  # by Omega [rad/s^2]
    theta: Scalar  # [rad]
    rate: Scalar  # [rad/s]
    acceleration: Scalar  # [rad/s^2]
    torques: Float[Array, " pulleys"]  # that excite, on the pulleys [N m]


class DriverMotion(eqx.Module):
    """The driver's mean speed over time, linear between its knots and held beyond, and the rest."""

    times: Float[Array, " knots"]  # [s]
    speeds: Float[Array, " knots"]  # [rad/s]
    angles: Float[Array, " knots"]  # psi there, from the first [rad]
    base: Scalar  # order of the excitation's period
    crank: Float[Array, " terms"]  # coefficients over base psi [rad]
    torques: Float[Array, "terms pulleys"]  # [N m]
    signal: CubicSpline | None
    of_speeds: bool = eqx.field(static=True)  # what the signal is of

    def at(self, t: Scalar) -> Driven:
        """The driver at a time [s]."""
        psi, Omega, gained = self._mean(t)
        of = series(self.base * psi, len(self.crank) // 2)
        by_angle = self.base * derived(self.crank[:, None])
        bent = self.base * derived(by_angle)
        theta, slope, curve = of @ self.crank, of @ by_angle[:, 0], of @ bent[:, 0]
        rate, acceleration = Omega * slope, Omega**2 * curve + gained * slope
        if self.signal is not None:
            found = self.signal.at(t)
            shaken = found[1:]
            if self.of_speeds:
                shaken = found[0] - psi, found[1] - Omega, found[2] - gained
            theta, rate, acceleration = (
                one + other for one, other in zip((theta, rate, acceleration), shaken, strict=True)
            )
        return Driven(psi, Omega, gained, theta, rate, acceleration, of @ self.torques)

    def _mean(self, t: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """Angle, speed and acceleration of the frame."""
        times, speeds = self.times, self.speeds
        k = jnp.clip(jnp.searchsorted(times, t, side="right") - 1, 0, max(len(times) - 2, 0))
        past = t - times[k]
        if len(times) == 1:
            return speeds[0] * past, speeds[0], jnp.zeros(())
        span = times[k + 1] - times[k]
        within = jnp.clip(past, 0.0, span)
        rise = (speeds[k + 1] - speeds[k]) / span
        speed = speeds[k] + rise * within
        angle = self.angles[k] + within * (speeds[k] + rise * within / 2)
        inside = (t >= times[0]) & (t < times[-1])
        # Before the first knot and after the last one the speed is held.
        return angle + speed * (past - within), speed, jnp.where(inside, rise, 0.0)


def driver_motion(
    times: Float[Array, " knots"],
    speeds: Float[Array, " knots"],
    forcing: Forcing,
    base: Scalar,
    signal: CrankSignal | None,
) -> DriverMotion:
    """The driver's motion by the knots of its mean speed, its orders, and its signal."""
    pieces = jnp.diff(times) * (speeds[1:] + speeds[:-1]) / 2
    joined, of_speeds = None, False
    if signal is not None:
        of_speeds = signal.speeds is not None
        values = signal.angles if signal.speeds is None else signal.speeds
        assert values is not None  # as CrankSignal holds
        joined = cubic_spline(signal.times, values)
        if of_speeds:
            # Its rotation begins with the frame's.
            start = joined.at(times[0])[0]
            joined = joined._replace(integrals=joined.integrals - start)
    return DriverMotion(
        times=times,
        speeds=speeds,
        angles=jnp.concatenate([jnp.zeros(1), jnp.cumsum(pieces)]),
        base=base,
        crank=real_series(forcing.crank),
        torques=real_series(forcing.torques),
        signal=joined,
        of_speeds=of_speeds,
    )
