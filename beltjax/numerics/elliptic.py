"""Elliptic integrals in Carlson's symmetric form, and two of Jacobi's functions.

B. C. Carlson, "Numerical computation of real or complex elliptic integrals", Numer. Algorithms 10
(1995), 13-26; DLMF 19.36. Each integral repeats a duplication that brings its arguments together
by a factor of four, and ends with their Taylor series about the common mean. The number of
repetitions is fixed, so that derivatives of any kind and order pass through: enough for arguments
that differ by sixteen orders of magnitude. R. Bulirsch, "Numerical calculation of elliptic
integrals and elliptic functions", Numer. Math. 7 (1965), 78-90, for Jacobi's functions.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.compiling.batched_loops import in_lanes_of

_DUPLICATIONS = 11  # five bring 1 and 1e-16 to one order, six more the series to rounding
_MEANS = 8  # arithmetic-geometric, from a complementary parameter of 1e-16

Real = Float[Array, "*lanes"]


class Carlson(NamedTuple):
    """The integrals of first, second and third kind of the same arguments."""

    rf: Real  # R_F(x, y, z)
    rd: Real  # R_D(x, y, z) = R_J(x, y, z, z)
    rj: Real  # R_J(x, y, z, p); zero where it is not wanted


class _Duplicated(NamedTuple):
    """Arguments on their way to their mean, and the sums of the terms left behind."""

    x: Real
    y: Real
    z: Real
    p: Real
    rd: Real
    rj: Real


def carlson(x: Real, y: Real, z: Real, p: Real | None = None) -> Carlson:
    """R_F, R_D and, with p, R_J: positive arguments, of which x or y may be zero.

    For p no larger than the largest of the others; a larger one would need more duplications. R_J
    loses digits where p is far below all of them: at 1e-16 of them it is good to 1e-9.
    """
    third, given = p is not None, z if p is None else p
    x, y, z, p = jnp.broadcast_arrays(x, y, z, given)
    delta = (p - x) * (p - y) * (p - z)

    def duplicate(m: Array, now: _Duplicated) -> _Duplicated:
        x, y, z, p, rd, rj = now
        a, b, c = jnp.sqrt(x), jnp.sqrt(y), jnp.sqrt(z)
        lam = a * b + a * c + b * c
        weight = 0.25**m
        rd = rd + weight / (c * (z + lam))
        if third:
            r = jnp.sqrt(p)
            d = (r + a) * (r + b) * (r + c)
            rj = rj + weight / d * _rc_near_one(weight**3 * delta / d**2)
            p = (p + lam) / 4
        return _Duplicated((x + lam) / 4, (y + lam) / 4, (z + lam) / 4, p, rd, rj)

    nothing = in_lanes_of(x, jnp.zeros_like(x))
    start = _Duplicated(x, y, z, p, nothing, nothing)
    last = jax.lax.fori_loop(0, _DUPLICATIONS, duplicate, start)
    x, y, z = last.x, last.y, last.z
    weight = 0.25**_DUPLICATIONS
    if not third:
        rest = _third_kind_series(x, y, z, z)
        return Carlson(_first_kind_series(x, y, z), weight * rest + 3 * last.rd, nothing)
    second_and_third = _third_kind_series(x, y, z, jnp.stack([z, last.p]))
    rd, rj = weight * second_and_third + jnp.stack([3 * last.rd, 6 * last.rj])
    return Carlson(_first_kind_series(x, y, z), rd, rj)


def _first_kind_series(x: Real, y: Real, z: Real) -> Real:
    """R_F of arguments that lie close together (DLMF 19.36.1)."""
    mean = (x + y + z) / 3
    X, Y = 1 - x / mean, 1 - y / mean
    Z = -X - Y
    E2, E3 = X * Y - Z**2, X * Y * Z
    series = (
        1
        - E2 / 10
        + E3 / 14
        + E2**2 / 24
        - 3 * E2 * E3 / 44
        - 5 * E2**3 / 208
        + 3 * E3**2 / 104
        + E2**2 * E3 / 16
    )
    return series / jnp.sqrt(mean)


def _third_kind_series(x: Real, y: Real, z: Real, p: Real) -> Real:
    """R_J of arguments that lie close together (DLMF 19.36.2)."""
    mean = (x + y + z + 2 * p) / 5
    X, Y, Z = 1 - x / mean, 1 - y / mean, 1 - z / mean
    P = -(X + Y + Z) / 2
    E2 = X * Y + X * Z + Y * Z - 3 * P**2
    E3 = X * Y * Z + 2 * E2 * P + 4 * P**3
    E4 = (2 * X * Y * Z + E2 * P + 3 * P**3) * P
    E5 = X * Y * Z * P**2
    series = (
        1
        - 3 * E2 / 14
        + E3 / 6
        + 9 * E2**2 / 88
        - 3 * E4 / 22
        - 9 * E2 * E3 / 52
        + 3 * E5 / 26
        - E2**3 / 16
        + 3 * E3**2 / 40
        + 3 * E2 * E4 / 20
    )
    return series / (mean * jnp.sqrt(mean))


def _rc_near_one(e: Real) -> Real:
    """R_C(1, 1 + e) for e > -1: arctan(sqrt(e))/sqrt(e), or artanh for negative e."""
    small = jnp.abs(e) < 0.02
    series = sum((-e) ** k / (2 * k + 1) for k in range(10))
    root = jnp.sqrt(jnp.where(small, 1.0, jnp.abs(e)))
    circular = jnp.arctan(root) / root
    hyperbolic = jnp.arctanh(jnp.where(small | (e > 0), 0.5, root)) / root
    return jnp.where(small, series, jnp.where(e > 0, circular, hyperbolic))


def jacobi_dn_sd(u: Real, complement: Real) -> tuple[Real, Real]:
    """dn(u | m) and sd(u | m) = sn/dn, for `complement` = 1 - m in (0, 1].

    Accurate relative to their own size also where dn is as small as sqrt(1 - m). For |u| below
    the quarter period, where sn is monotone.
    """
    a, b = jnp.ones_like(complement), jnp.sqrt(complement)
    means = []
    for _ in range(_MEANS):
        means.append((a, b))
        a, b = (a + b) / 2, jnp.sqrt(a * b)
    phase = u * a
    # At u = 0 the cotangents below have no value; there dn = 1 and sd = u.
    at_zero = jnp.abs(phase) < 1e-9
    phase = jnp.where(at_zero, 0.5, phase)
    dn = jnp.ones_like(phase)
    ratio = jnp.cos(phase) / jnp.sin(phase)
    c = a * ratio
    for a, b in reversed(means):
        ratio = ratio * c
        c = c * dn
        dn = (b + ratio) / (a + ratio)
        ratio = c / a
    sn = jnp.sign(jnp.sin(phase)) / jnp.sqrt(c**2 + 1)
    return jnp.where(at_zero, 1.0, dn), jnp.where(at_zero, u, sn / dn)
