"""Waves of a tensioned, moving beam, in the letters of chapter 2, for any coefficients.

A wave w = e^{i(r x - omega t)} obeys the dispersion relation

    B r^4 + Q r^2 + 2 c omega r - m omega^2 = 0

    B  bending stiffness     Q  effective tension, > 0     c  transport     m  inertia, > 0

The single beam of (2.4) has B = eps^2, Q = 1 - v^2, c = v, m = 1; a span of a drive, on its own
unit length, B = eps^2/lam^2, Q = P - s^2 + T, c = +-s lam, m = lam^2.

For omega > 0 two waves travel, r1 > 0 > r2, and two stay at the ends: r3, which decays away from
x = 0, and r4 = conj(r3), which decays away from x = 1. As the four add to zero,

    r3,4 = drift +- i steep/sqrt(B),     drift = -(r1 + r2)/2,

and r1, r2, drift and steep^2 are smooth functions of B through B = 0, where r3 and r4 are not.
All functions work on arrays, element by element.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

Real = Float[Array, "..."]
FourReals = tuple[Real, Real, Real, Real]

# Newton's method starts at most 1.7 times above the root of a convex function (two million random
# coefficients); six steps bring it to 4e-14, the seventh to rounding.
_STEPS = 7
_LEAST_STIFFNESS = 1e-40  # for r3 and r4 alone


class Waves(NamedTuple):
    """The four wavenumbers, in parts that stay finite and smooth as the stiffness vanishes."""

    r1: Real  # > 0
    r2: Real  # < 0
    drift: Real  # Re r3 = Re r4
    steepness: Real  # steep^2 = B (Im r3)^2; Q of the string


class WaveNumbers(NamedTuple):
    """The four roots of the dispersion relation; they unpack as r1, r2, r3, r4."""

    r1: Real
    r2: Real
    r3: Complex[Array, "..."]
    r4: Complex[Array, "..."]


def wave_numbers(
    stiffness: Real, tension: Real, transport: Real, inertia: Real, omega: Real
) -> WaveNumbers:
    """Roots of stiffness r^4 + tension r^2 + 2 transport omega r - inertia omega^2 = 0.

    They hold for real omega > 0, tension > 0, inertia > 0 and stiffness >= 0, and are accurate to
    rounding. As the stiffness vanishes Im r3 grows without bound: below a stiffness of 1e-40 it is
    held, without derivative there, at the value for 1e-40, so that e^{i r3 x} is 1 at x = 0 and 0
    elsewhere. `waves` has the parts that stay smooth. Kong (2003), eq. (2.4).
    """
    r1, r2, drift, steepness = waves(stiffness, tension, transport, inertia, omega)
    held = jnp.where(stiffness > _LEAST_STIFFNESS, stiffness, _LEAST_STIFFNESS)
    decay = _root_or_zero(steepness / held)
    # Under compression r3 and r4 may be real: the larger as a sum, the other by their product.
    apart = _root_or_zero(-steepness / held)
    far = drift + jnp.where(drift < 0, -apart, apart)
    product = inertia * omega**2 / (-held * r1 * r2)
    near = jnp.where(apart > 0, product / jnp.where(apart > 0, far, 1.0), far)
    return WaveNumbers(r1, r2, jax.lax.complex(near, decay), jax.lax.complex(far, -decay))


def _root_or_zero(square: Real) -> Real:
    positive = square > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)


def waves(stiffness: Real, tension: Real, transport: Real, inertia: Real, omega: Real) -> Waves:
    """The roots as `Waves`, each part to rounding and differentiable, also at stiffness 0.

    The tension may also be zero or negative (a beam in compression) while the waves are those of
    c^2 + Q m > 0. There r1 (for c < 0, r2) is the smallest root of its sign, and a negative
    `steepness` says that r3 and r4 are real.
    """
    B, Q, c, m, omega = jnp.broadcast_arrays(
        *(jnp.asarray(x, dtype=float) for x in (stiffness, tension, transport, inertia, omega))
    )
    # Both roots come from one call, which halves the code to compile.
    push = jnp.stack([c * omega, -c * omega])
    r1, opposite = _travelling(B, Q, push, m * omega**2)
    r2 = -opposite
    # The quadratic factor r^2 - 2 drift r + (Q/B - r1 r2 + 4 drift^2) holds r3 and r4. Nothing
    # cancels in it but r1 + r2 for slow transport; comparing the terms in r gives that sum to
    # its own rounding.
    product = -r1 * r2
    drift = c * omega / (Q + B * (2.0 * product + (r1 + r2) ** 2))
    return Waves(r1, r2, drift, Q + B * (product + 3.0 * drift**2))


@jax.custom_jvp
def _travelling(B: Real, Q: Real, b: Real, M: Real) -> Real:
    """The positive root of B s^4 + Q s^2 + 2 b s - M."""
    # For Q >= 0 the function is convex and negative at 0: from any bound above the root Newton's
    # method decreases to it. Bounds are the string's root, and the root without tension. For
    # Q < 0 it is convex from the string's root on where b > 0, and from `beam` on where b < 0.
    reach = jnp.abs(b) + jnp.sqrt(jnp.maximum(b**2 + Q * M, 0.0))
    ahead = M / jnp.where(reach > 0, reach, 1.0)
    behind = jnp.where(Q > 0, reach / jnp.where(Q > 0, Q, 1.0), jnp.inf)
    # Each of at most `terms` terms opposes B s^4, so that the largest is at least its share.
    stiff = jnp.where(B > 0, B, 1.0)
    terms = jnp.where(Q < 0, 3.0, jnp.where(b < 0, 2.0, 1.0)) / stiff
    beam = jnp.maximum((terms * M) ** 0.25, jnp.cbrt(2.0 * terms * jnp.maximum(-b, 0.0)))
    beam = jnp.maximum(beam, jnp.sqrt(terms * jnp.maximum(-Q, 0.0)))
    string = jnp.where(b < 0, behind, ahead)
    s = jnp.where(B > 0, jnp.minimum(string, beam), string)
    for _ in range(_STEPS):
        # The next point as a quotient of sums, to keep the digits of a small root.
        value = M + Q * s**2 + 3.0 * B * s**4
        slope = 2.0 * (b + Q * s + 2.0 * B * s**3)
        s = value / jnp.where(slope > 0, slope, 1.0)
    return s


@_travelling.defjvp
def _travelling_jvp(primals: FourReals, tangents: FourReals) -> tuple[Real, Real]:
    B, Q, b, M = primals
    dB, dQ, db, dM = tangents
    s = _travelling(B, Q, b, M)
    # s times the slope of the function, by the equation itself: a sum of positive terms.
    slope = 3.0 * B * s**4 + Q * s**2 + M
    change = s * (dM - s * (2.0 * db + s * (dQ + s**2 * dB)))
    return s, change / jnp.where(slope > 0, slope, 1.0)
