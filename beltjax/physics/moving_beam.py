"""One moving beam between two supports (chapter 2), exactly, in the letters of the source.

    w_tt + 2 v w_xt - (1 - v^2) w_xx + eps^2 w_xxxx = 0,    w = 0 at both ends, and there
    w_xx = 0 ("simple") or w_x = 0 ("fixed")

    eps  sqrt(EI/P)/L     v  c sqrt(m/P)     x over L, omega in sqrt(P/m)/L
    r1..r4  waves, as in `waves`;  d = (r1 - r2)/2;  k = Im r3
    a = d/k, e = drift/k: the quantities of order eps on which a support's reflection depends
    phi  phase that a support adds to pi at reflection

The determinant of the four boundary conditions, divided by what the waves' own coincidences put
into it, is real. With g = 1 + 4 e^2 - a^2, h = (1 + a^2)^2 + 4 e^2 (1 - a^2) and E = e^{-k} it is

    simple, simple   h sin d (1 - E^2) + 8 a e^2 [cos d (1 + E^2) - 2 E cos(2 drift)]
    fixed, fixed     g sin d (1 - E^2) - 2 a [cos d (1 + E^2) - 2 E cos(2 drift)]
    one of each      (g + 2 a^2) sin d (1 + E^2) + a (g - 2) cos d (1 - E^2) - 8 a e E sin(2 drift)

up to a factor. Without E these are amplitude times sin(phase), and phase = n pi is the phase
closure (2.17). With E, (determinant/amplitude) = sin(phase) + c, and the n-th frequency is where
phase + (-1)^n asin(c) = n pi: the phase counts, so that no root is missed or met twice.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from beltjax.numerics.roots import implicit_root, increasing_root
from beltjax.physics.waves import Waves, waves

Real = Float[Array, "..."]
Scalar = Float[Array, ""]
Ends = tuple[str, str]

SUPPORTS = ("simple", "fixed")
# (v^2 - 1)/eps^2 at which the first frequency vanishes: the squared wavenumber of buckling, by
# the number of fixed ends; between one of each it is the first root of tan b = b.
_BUCKLING = (jnp.pi**2, 4.493409457909064**2, 4 * jnp.pi**2)
_THICK = 4.0  # k^2 below which the layers fill the span
_TERMS = 18  # of the series of cosh k and sinh(k)/k for -25 < k^2 < 4
_NO_LAYER = 1.0 / 700.0  # e^{-1/u} underflows below this u


def require_support(support: str) -> None:
    """Raise `ValueError` for a support that is not one of `SUPPORTS`."""
    if support not in SUPPORTS:
        allowed = " or ".join(map(repr, SUPPORTS))
        raise ValueError(f"ends: unknown support {support!r}; give {allowed} for each end.")


def critical_speed(eps: Real, ends: Ends) -> Real:
    """The transport speed at which the first frequency vanishes and the beam buckles."""
    return jnp.sqrt(1.0 + _BUCKLING[ends.count("fixed")] * eps**2)


def beam_waves(eps: Real, v: Real, omega: Real) -> Waves:
    """The waves of (2.4)."""
    return waves(eps**2, (1.0 - v) * (1.0 + v), v, jnp.ones_like(v), omega)


class Seen(NamedTuple):
    """The quantities of the waves on which reflection at the supports depends."""

    d: Real
    a: Real
    e: Real
    drift: Real
    u: Real  # 1/k, thickness of the layers


def seen(eps: Real, of: Waves) -> Seen:
    """The quantities `Seen` of given waves, for k^2 > 0."""
    d = (of.r1 - of.r2) / 2.0
    u = eps / jnp.sqrt(of.steepness)
    return Seen(d, d * u, of.drift * u, of.drift, u)


def reflection_phase(support: str, eps: Real, of: Waves) -> Real:
    """phi, where a support reflects with the phase pi + phi, at either end. No digits cancel.

    simple: atan2(8 a e^2, h) = 8 eps^3 v^2 omega^3/(1-v^2)^(9/2) + ...; fixed: -atan2(2 a, g).
    """
    require_support(support)
    _, a, e, _, _ = seen(eps, of)
    return jnp.arctan2(*_reflected(support, a, e))


def _reflected(support: str, a: Real, e: Real) -> tuple[Real, Real]:
    """Sine and cosine of phi, times a common factor."""
    if support == "simple":
        return 8.0 * a * e**2, (1.0 + a**2) ** 2 + 4.0 * e**2 * (1.0 - a**2)
    return -2.0 * a, 1.0 + 4.0 * e**2 - a**2


def closure_phase(ends: Ends, eps: Real, of: Waves) -> Real:
    """(r1 - r2 + phi_A + phi_B)/2, which is n pi at a frequency, but for e^{-k} (2.17)."""
    phases = (reflection_phase(end, eps, of) for end in ends)
    return (of.r1 - of.r2 + sum(phases)) / 2.0


def _beyond_closure(ends: Ends, at: Seen) -> Real:
    """c, which e^{-k} adds to sin(phase) in the determinant over its amplitude."""
    d, a, e, drift, u = at
    E = jnp.where(u > _NO_LAYER, jnp.exp(-1.0 / jnp.maximum(u, _NO_LAYER)), 0.0)
    sine, cosine = jnp.sin(d), jnp.cos(d)
    if ends[0] == ends[1]:
        p, q = _reflected(ends[0], a, e)
        added = p * (E**2 * cosine - 2.0 * E * jnp.cos(2.0 * drift)) - q * E**2 * sine
    else:
        p, q = a * (4.0 * e**2 - a**2 - 1.0), 1.0 + 4.0 * e**2 + a**2
        added = E**2 * (q * sine - p * cosine) - 8.0 * a * e * E * jnp.sin(2.0 * drift)
    return added / jnp.sqrt(p**2 + q**2)


def _thick_determinant(ends: Ends, k2: Real, d: Real, drift: Real) -> Real:
    """The determinant for small k^2 of either sign, positive below the first frequency."""
    ch, sh = jnp.zeros_like(k2), jnp.zeros_like(k2)  # cosh k and sinh(k)/k
    for n in range(_TERMS, 0, -1):
        ch = (1.0 + ch) * k2 / ((2 * n - 1) * (2 * n))
        sh = (1.0 + sh) * k2 / ((2 * n) * (2 * n + 1))
    ch, sh = 1.0 + ch, 1.0 + sh
    sine, cosine = jnp.sin(d), jnp.cos(d)
    G = 4.0 * drift**2 - d**2 + k2
    if ends == ("simple", "simple"):
        H = (k2 + d**2) ** 2 + 4.0 * drift**2 * (k2 - d**2)
        value = H * sine * sh + 8.0 * d * drift**2 * (cosine * ch - jnp.cos(2.0 * drift))
    elif ends == ("fixed", "fixed"):
        value = G * sine * sh - 2.0 * d * (cosine * ch - jnp.cos(2.0 * drift))
    else:
        value = (G + 2.0 * d**2) * sine * ch + d * (G - 2.0 * k2) * cosine * sh
        value = value - 4.0 * d * drift * jnp.sin(2.0 * drift)
    # r1 - r2 and the distances of r1 and r2 from r3 and r4: where waves coincide, not roots.
    coincidences = d * ((2.0 * drift - d) ** 2 + k2) * ((2.0 * drift + d) ** 2 + k2)
    return value / jnp.where(coincidences == 0, 1.0, coincidences)


def closure(omega: Scalar, eps: Scalar, v: Scalar, n: Int[Array, ""], ends: Ends) -> Scalar:
    """A function of omega that goes from minus to plus at the n-th frequency alone."""
    of = beam_waves(eps, v, omega)
    # Layers that fill the span occur below the first frequency, and at it only close to
    # buckling. There the sign of the determinant itself shows on which side omega lies.
    thick = of.steepness <= _THICK * eps**2
    thin = of._replace(steepness=jnp.where(thick, 1.0, of.steepness))
    # The slope of arcsin stays finite on the way; at a frequency |c| is far below one.
    beyond = jnp.clip(_beyond_closure(ends, seen(eps, thin)), -0.999, 0.999)
    odd = n % 2 == 1
    counted = closure_phase(ends, eps, thin) + jnp.where(odd, -1.0, 1.0) * jnp.arcsin(beyond)
    k2 = jnp.where(thick, of.steepness / jnp.where(eps > 0, eps, 1.0) ** 2, 0.0)
    low = -_thick_determinant(ends, jnp.maximum(k2, -25.0), (of.r1 - of.r2) / 2.0, of.drift)
    return jnp.where(thick, jnp.where(n == 1, low, -1.0), counted - n * jnp.pi)


def first_guess(eps: Scalar, v: Scalar, n: Int[Array, ""], ends: Ends) -> Scalar:
    """A frequency near the n-th: exact waves for an estimate of the phase at the supports."""
    speed, Q = jnp.abs(v), (1.0 - v) * (1.0 + v)
    d = n * jnp.pi
    thin = eps * d / jnp.sqrt(jnp.maximum(Q, 0.0) + (eps * d) ** 2 + 1e-30)
    d = d + ends.count("fixed") * jnp.arctan(thin)

    # With f(r) = sqrt(1 + (eps r)^2): omega = r1 (f(r1) + v) = s (f(s) - v), r1 + s = 2 d. One step
    # of Newton's method from about the string's s; what is left is the error of d.
    s = d * (1.0 + speed / jnp.sqrt(1.0 + 4.0 * (eps * d) ** 2))
    r1 = 2.0 * d - s
    f_s, f_r = jnp.sqrt(1.0 + (eps * s) ** 2), jnp.sqrt(1.0 + (eps * r1) ** 2)
    slope = f_s + (eps * s) ** 2 / f_s + f_r + (eps * r1) ** 2 / f_r
    s = jnp.clip(s - (s * (f_s - speed) - r1 * (f_r + speed)) / slope, d, 2.0 * d)
    # f(s) - v by its square, which keeps its digits near the critical speed.
    square = jnp.maximum(Q + (eps * s) ** 2, 1e-3 * eps**2)
    return s * square / (jnp.sqrt(1.0 + (eps * s) ** 2) + speed)


class FoundFrequency(NamedTuple):
    """A frequency, its estimated error, and whether the search converged."""

    omega: Scalar
    error: Scalar  # the last step of Newton's method, relative
    converged: Bool[Array, ""]
    steps: Int[Array, ""]


def frequency(eps: Scalar, v: Scalar, n: Int[Array, ""], ends: Ends) -> FoundFrequency:
    """The n-th frequency for eps >= 0 and |v| below `critical_speed`; differentiable in both."""
    fixed = jax.lax.stop_gradient((eps, v))
    # In units of the guess: close to the critical speed frequencies are small.
    unit = first_guess(*fixed, n, ends)

    def residual(y: Scalar, numbers: tuple[Scalar, Scalar]) -> Scalar:
        eps, v = numbers
        return closure(y * unit, eps, v, n, ends)

    one = jnp.ones_like(unit)
    search = increasing_root(lambda y: residual(y, fixed), 0.0 * one, one, tol=1e-7)
    left, slope = jax.jvp(lambda y: residual(y, fixed), (search.root,), (one,))
    step = -left / jnp.where(slope == 0, 1.0, slope)
    y = implicit_root(residual, (eps, v), search.root + step)
    return FoundFrequency(y * unit, jnp.abs(step / search.root), search.converged, search.steps)
