"""One stiff span under constant tension, bent to the curvature of its pulleys (chapter 3).

Dimensionless as in (3.42): x and w are scaled by the span's own length, and

    eps  bending stiffness, sqrt(EI/P0)/l     lam  span length over mean span length l
    Q    P - s^2 + T, effective tension       k    lam sqrt(Q)/eps
    kap_s, kap_e  w'' at x = 0 and x = 1      u    1/k, thickness of the layers at the ends

The span equation eps^2 w''''/lam^2 = Q w'' has w'' = kap_s S(1-x) + kap_e S(x) with
S(x) = sinh(kx)/sinh(k). Its integrals are even functions of k, hence smooth functions of
z = k^2 through Q = 0, and of u as EI -> 0; each is computed in the variable that is accurate
there.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

Real = Float[Array, "..."]

# Below this z the continued fraction is exact to rounding at the depth used and the
# exponential form has lost less than one digit; above it the reverse.
_SMALL = 3.0
_DEPTH = 19  # last partial denominator of the continued fraction, accurate to 1e-16 for z <= 3
_NO_LAYER = 1.0 / 700.0  # e^{-1/u} underflows below this u


class Layers(NamedTuple):
    """Integrals over a unit span of products of its two end layers."""

    bend_same: Real  # int S(x)^2 dx
    bend_cross: Real  # int S(x) S(1-x) dx
    slope_same: Real  # int p'^2 dx, where p'' = S(x), p(0) = p(1) = 0
    slope_cross: Real  # int p'(x) [p(1-x)]' dx


def layer_width(eps: Real, lam: Real, Q: Real) -> tuple[Real, Real]:
    """(u, z) = (1/k, k^2) of a span: z where it is small (inf elsewhere), and u where it is not.

    u is finite for eps = 0 and for Q = 0, and so are the derivatives of both.
    """
    stiff = (eps / lam) ** 2
    thick = _SMALL * stiff >= Q
    z = jnp.where(thick, Q / jnp.where(thick, stiff, 1.0), jnp.inf)
    u = jnp.where(thick, 1.0, eps / lam / jnp.sqrt(jnp.where(thick, 1.0, Q)))
    return u, z


def layers(u: Real, z: Real) -> Layers:
    """The layer integrals from `layer_width`'s two variables."""
    small = z <= _SMALL
    near = _layers_of_thick(jnp.where(small, z, 0.0))
    far = _layers_of_thin(u)
    return Layers(*(jnp.where(small, a, b) for a, b in zip(near, far, strict=True)))


def _lambert(z: Real) -> tuple[Real, Real]:
    """Lambert's continued fraction: a = (k coth k - 1)/k^2 and r with a = 1/(3 + z r)."""
    r = jnp.full_like(z, 1.0 / _DEPTH)
    for odd in range(_DEPTH - 2, 3, -2):
        r = 1.0 / (odd + z * r)
    return 1.0 / (3.0 + z * r), r


def _layers_of_thick(z: Real) -> Layers:
    """Layer integrals for small z, written so that nothing cancels.

    With a = (k coth k - 1)/z, a2 = (1/3 - a)/z, d = (1 - k/sinh k)/z and d2 = (1/6 - d)/z.
    """
    a, r = _lambert(z)
    a2 = a * r / 3.0
    one_plus_y = 1.0 + jnp.sqrt((1.0 + z * a) ** 2 - z)  # y = k/sinh k
    d = (1.0 - 2.0 * a - z * a**2) / one_plus_y
    d2 = (a**2 - 2.0 * a2 - d / 6.0) / one_plus_y
    return Layers(
        bend_same=(1.0 - a - z * a**2) / 2.0,
        bend_cross=(one_plus_y - 1.0) * a / 2.0,
        slope_same=(a**2 - 3.0 * a2) / 2.0,
        slope_cross=a2 / 2.0 - d2 + a * d / 2.0,
    )


def _layers_of_thin(u: Real) -> Layers:
    """Layer integrals for small u = 1/k; no exponential here ever grows."""
    decay = jnp.where(u > _NO_LAYER, jnp.exp(-1.0 / jnp.maximum(u, _NO_LAYER)), 0.0)
    csch = 2.0 * decay / (1.0 - decay**2)
    coth = (1.0 + decay**2) / (1.0 - decay**2)
    return Layers(
        bend_same=(u * coth - csch**2) / 2.0,
        bend_cross=(coth - u) * csch / 2.0,
        slope_same=u**3 * coth / 2.0 - u**4 + (u * csch) ** 2 / 2.0,
        slope_cross=u**4 - u**2 * (coth + u) * csch / 2.0,
    )


def bending(kap_s: Real, kap_e: Real, of: Layers) -> Real:
    """Gamma_i, the integral of w''^2."""
    return (kap_s**2 + kap_e**2) * of.bend_same + 2.0 * kap_s * kap_e * of.bend_cross


def stretch(kap_s: Real, kap_e: Real, drop: Real, of: Layers) -> Real:
    """I_i, half the integral of w'^2, for w(1) - w(0) = `drop`."""
    wavy = (kap_s**2 + kap_e**2) * of.slope_same + 2.0 * kap_s * kap_e * of.slope_cross
    return (drop**2 + wavy) / 2.0


def bump(x: Real, u: Real, z: Real) -> Real:
    """p(x) with p'' = sinh(kx)/sinh(k), p(0) = p(1) = 0: the deflection that kap_e = 1 makes."""
    small = z <= _SMALL
    return jnp.where(small, _bump_of_thick(x, jnp.where(small, z, 0.0)), _bump_of_thin(x, u))


def _bump_of_thick(x: Real, z: Real) -> Real:
    a, _ = _lambert(z)
    d = (1.0 - 2.0 * a - z * a**2) / (1.0 + jnp.sqrt((1.0 + z * a) ** 2 - z))
    m = 1.0 / 6.0  # m(z x^2) = [sinh(kx)/(kx) - 1]/(k^2 x^2) by its power series
    term = 1.0 / 6.0
    for n in range(1, 12):
        term = term * z * x**2 / ((2 * n + 2) * (2 * n + 3))
        m = m + term
    return x * (x**2 * m - d - z * x**2 * m * d)


def _bump_of_thin(x: Real, u: Real) -> Real:
    k = 1.0 / jnp.maximum(u, _NO_LAYER)
    ratio = jnp.exp(-k * (1.0 - x)) * (1.0 - jnp.exp(-2.0 * k * x)) / (1.0 - jnp.exp(-2.0 * k))
    return u**2 * (ratio - x)
