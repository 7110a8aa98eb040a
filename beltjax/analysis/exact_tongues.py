"""Tips of tongues by Floquet's theory: the least amplitude that is unstable near a speed."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from beltjax.analysis.damping import Damping
from beltjax.analysis.floquet import Disturbed, disturbed, response_monodromy
from beltjax.analysis.linearization import linearize
from beltjax.analysis.orders import Forcing
from beltjax.analysis.response import Shaken
from beltjax.analysis.steady import steady_state
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.numerics.bases import AbstractBasis
from beltjax.numerics.floquet import growth
from beltjax.numerics.roots import first_upcrossing

Scalar = Float[Array, ""]

_MODES, _STEPS = 24, 64
_WIDTHS = np.array([0.03, 0.01, 0.003])  # of the speeds that are tried, one round after the other
_ABREAST = np.linspace(-1.0, 1.0, 7)
_TRIED = np.exp2(np.linspace(-1.5, 1.5, 7))  # of the critical factor before


class Shaking(NamedTuple):
    """A drive and what excites it."""

    drive: Drive
    point: OperatingPoint
    shaken: Shaken
    order: Scalar
    damping: Damping


class Tips(NamedTuple):
    """The tips of some tongues."""

    speed: Float[Array, " tongues"]  # [rad/s]
    factor: Float[Array, " tongues"]  # of the excitation; inf: none was found
    slack: Float[Array, " tongues"]  # factor at which a span goes slack there


def exact_factors(
    of: Shaking,
    speeds: Float[Array, " tongues"],
    factors: Float[Array, " tongues"],
    ends: tuple[Scalar, Scalar],
    basis: AbstractBasis,
) -> Tips:
    """The least factors near some speeds, from those by pairs of modes; one after the other.

    Where the disturbance grows most at the factor so far the next factor is sought, three times.
    """

    def tip(started: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar, Scalar]:
        place, near = started
        near = jnp.where(jnp.isfinite(near) & (near > 0), near, 1.0)
        lowest = jnp.maximum(ends[0], place * (1 - _WIDTHS[0]))
        highest = jnp.minimum(ends[1], place * (1 + _WIDTHS[0]))

        def narrow(k: Array, state: tuple[Array, ...]) -> tuple[Array, ...]:
            speed, factor, *_ = state
            tried = speed * (1 + jnp.asarray(_WIDTHS)[k] * _ABREAST)
            tried = jnp.clip(tried, lowest, highest)
            rates = jax.vmap(lambda w: _rate(_disturbed(of, w, basis), factor))(tried)
            best = jnp.argmax(rates)
            inner = jnp.clip(best, 1, len(_ABREAST) - 2)
            left, middle, right = rates[inner - 1], rates[inner], rates[inner + 1]
            bend = left - 2 * middle + right
            shift = (left - right) / jnp.where(bend < 0, 2 * bend, -1.0)
            step = tried[inner + 1] - tried[inner]
            smooth = (bend < 0) & (best == inner) & (jnp.abs(shift) <= 1)
            speed = tried[best] + jnp.where(smooth, shift * step, 0.0)
            at = _disturbed(of, speed, basis)
            root, found = first_upcrossing(lambda a: _rate(at, a), factor * _TRIED)
            return speed, jnp.where(found, root, factor), at.slack, found

        start = place, near, near, jnp.array(False)
        speed, factor, slack, found = jax.lax.fori_loop(0, len(_WIDTHS), narrow, start)
        return speed, jnp.where(found, factor, jnp.inf), slack

    return Tips(*jax.lax.map(tip, (speeds, factors)))


def growth_in_tip(of: Shaking, speed: Scalar, factor: Scalar, basis: AbstractBasis) -> Scalar:
    """Growth at a factor of the excitation, which vanishes in the tip of a tongue."""
    return _rate(_disturbed(of, speed, basis), factor)


def _disturbed(of: Shaking, speed: Scalar, basis: AbstractBasis) -> Disturbed:
    steady = steady_state(of.drive, of.point.at_driver_speed(speed), throw=False)
    lin = linearize(steady, basis, throw=False)
    crank, torques = of.shaken
    forcing = Forcing(
        jnp.zeros(2, complex).at[1].set(crank),
        jnp.zeros((2, len(torques)), complex).at[1].set(torques),
    )
    count = min(_MODES, len(lin.mass))
    return disturbed(lin, of.order * speed, forcing, of.damping, count, (1,))[0]


def _rate(of: Disturbed, factor: Scalar) -> Scalar:
    matrix = response_monodromy(of, len(of.basis.frequencies), factor, _STEPS)
    return growth(matrix, of.period)
