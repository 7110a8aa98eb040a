"""The free span between two pulleys as an elastica, contact points unknown (chapter 5).

Written along the belt's travel, in any consistent units, for pulleys that turn the belt the same
way or opposite ways. The span leaves a pulley of signed radius rho_i (positive where it turns the
belt left) at the origin, and arrives at one of rho_j at (d, 0). With

    C = P + EI kappa^2/2 (constant),  F and phi size and direction of the internal force,
    psi = theta - phi,  psi_0 = -2 t_i u_i,  psi_L = 2 t_j u_j,   q = 2(C - F)/EI

    kappa^2 = q + (4F/EI) sin^2(psi/2),   P = F cos psi,   EI kappa' = F sin psi

q > 0 where both ends turn the same way: |kappa| has its least value sqrt(q) inside. q < 0 where
they turn opposite ways: kappa passes through zero. In a long span q vanishes like e^{-L/ell} with
ell = sqrt(EI/C), and below rounding the span is explicit: `separatrix`.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from beltjax.numerics.derivative_rules import with_own_slopes
from beltjax.numerics.elliptic import carlson, jacobi_dn_sd
from beltjax.numerics.roots import implicit_solution, system_root

Scalar = Float[Array, ""]
Pair = Float[Array, "2"]

LONG = 35.0  # lengths ell beyond which e^{-L/ell} is below rounding


class SpanData(NamedTuple):
    """The given numbers of a span."""

    C: Scalar
    EI: Scalar
    EA: Scalar
    d: Scalar  # distance of the centers
    rho_i: Scalar  # signed radii
    rho_j: Scalar
    kap_i: Scalar  # signed curvatures at contact: 1/rho, or less where a point alone touches
    kap_j: Scalar


class Span(NamedTuple):
    """A span's solution. Angles are from the line of centers, positive to the left."""

    F: Scalar
    phi: Scalar
    q: Scalar
    u_i: Scalar  # half the angles between the ends' tangents and the force
    u_j: Scalar
    L: Scalar
    J: Scalar  # integral of ds/(EA + P)
    P_mid: Scalar  # at half the arc
    long: Bool[Array, ""]  # solved by `separatrix`
    converged: Bool[Array, ""]
    residual: Scalar


class Ends(NamedTuple):
    """Where the force and the ends' tangents point."""

    F: Scalar
    q: Scalar
    u_i: Scalar
    u_j: Scalar


class Arcs(NamedTuple):
    """Integrals from the point of least |kappa| to two others."""

    I0: Pair  # ds
    I2: Pair  # kappa^2 ds
    J: Pair  # ds/(EA + P)


def span_at(unknown: Pair, span: SpanData) -> tuple[Span, Pair]:
    """The span for any (z, phi), and the residuals of its two equations.

    z says how much farther from the separatrix the span is than a long span would be, and phi is
    the force's direction. A long span needs neither: its equations only fix their values.
    """
    *shape, long, first, second = _span_numbers(*unknown, *span)
    found = Span(*shape, long=long > 0, converged=jnp.array(True), residual=jnp.zeros_like(span.C))
    return found, jnp.stack([first, second])


@with_own_slopes
def _span_numbers(z: Scalar, phi: Scalar, *data: Scalar) -> Float[Array, "11"]:
    """The results of `span_at` in one array: the shape, whether it is long, both residuals."""
    span, unknown = SpanData(*data), jnp.stack([z, phi])
    limit, long, safe, safe_limit = _limit_and_safe_data(span)
    bent, unmet = _shape(jnp.where(long, jnp.zeros(2), unknown), safe, safe_limit)
    shape = [jnp.where(long, getattr(limit, key), x) for key, x in bent._asdict().items()]
    unmet = jnp.where(long, unknown - jnp.stack([0.0, limit.phi]), unmet)
    return jnp.stack([*shape, long.astype(float), *unmet])


def span_start(span: SpanData) -> Pair:
    """(z, phi) from which to search; they are nearly right where the span is a few ell long."""
    limit, long, safe, safe_limit = _limit_and_safe_data(span)
    return jnp.where(long, jnp.stack([0.0, limit.phi]), _start(safe, safe_limit))


def _limit_and_safe_data(span: SpanData) -> tuple[Span, Bool[Array, ""], SpanData, Span]:
    """The separatrix, whether the span is long, and data with which `_bent` is safe to evaluate.

    Those data are the span's own where it is not long, and harmless ones where it is. The last
    entry is the separatrix for them.
    """
    limit, plain = separatrix(span), _harmless(span)
    long = jax.lax.stop_gradient(LONG * layer(span) < limit.L)
    # The formulas that are not used must not spoil the derivatives of those that are.
    safe = jax.tree.map(lambda a, b: jnp.where(long, a, b), plain, span)
    safe_limit = jax.tree.map(lambda a, b: jnp.where(long, a, b), separatrix(plain), limit)
    return limit, long, safe, safe_limit


def elastica(span: SpanData) -> Span:
    """The span whose ends are tangent to both pulleys.

    It needs P > 0 at both ends, that is C > EI kappa^2/2, and pulleys that do not overlap. The
    equations are those of Kong (2003), (5.9) and (5.16)-(5.21), with contact as a vector
    condition; docs/theory/contact.md, (C4) to (C11).
    """
    limit, long, safe, safe_limit = _limit_and_safe_data(span)
    return jax.tree.map(lambda a, b: jnp.where(long, a, b), limit, _bent(safe, safe_limit))


def _harmless(span: SpanData) -> SpanData:
    """A span that `_bent` solves at once."""
    return SpanData(*(jnp.full_like(span.C, x) for x in (1.0, 1.0, 1e3, 10.0, 1.0, 1.0, 1.0, 1.0)))


def layer(span: SpanData) -> Scalar:
    """Ell = sqrt(EI/C), the length of the bent ends; its slope at EI = 0 is taken as 0, not inf."""
    ratio = span.EI / span.C
    bent = ratio > 0
    return jnp.where(bent, jnp.sqrt(jnp.where(bent, ratio, 1.0)), 0.0)


def _thrust(span: SpanData, F: Scalar) -> Scalar:
    """sin(phi), by the force's distances from both centers (its moments about them)."""

    def distance(rho: Scalar, kap: Scalar) -> Scalar:
        return (rho * (span.C - span.EI * kap**2 / 2) + span.EI * kap) / F

    return (distance(span.rho_i, span.kap_i) - distance(span.rho_j, span.kap_j)) / span.d


def _sines(span: SpanData, u_i: Scalar, u_j: Scalar) -> Scalar:
    """Distance by which the contact points lie outside the centers, along the force."""
    return jnp.abs(span.rho_i) * jnp.sin(2 * u_i) + jnp.abs(span.rho_j) * jnp.sin(2 * u_j)


def separatrix(span: SpanData) -> Span:
    """The explicit limit q = 0 of a long span; at EI = 0 it is the straight span of a string."""
    ell, C = layer(span), span.C
    u_i, u_j = (jnp.arcsin(ell * jnp.abs(kap) / 2) for kap in (span.kap_i, span.kap_j))
    sine = _thrust(span, C)
    # A span whose thrust line would have to point backwards is not long: `_bent` finds it.
    phi = jnp.arcsin(jnp.clip(sine, -1.0 + 1e-9, 1.0 - 1e-9))
    bent = (1 - jnp.cos(u_i)) + (1 - jnp.cos(u_j))
    L = span.d * jnp.cos(phi) + _sines(span, u_i, u_j) + 2 * ell * bent
    # The bent ends carry less tension than C, and strain less; the integral is elementary in cos u.
    w = jnp.sqrt(2 * C / (span.EA - C))

    def less(u: Scalar) -> Scalar:
        c = jnp.cos(u)
        return jnp.arctan(w * (1 - c) / (1 + w**2 * c))

    shortfall = 2 * C * ell * (less(u_i) + less(u_j)) / jnp.sqrt(2 * C * (span.EA - C))
    return Span(
        F=C,
        phi=phi,
        q=jnp.zeros_like(C),
        u_i=u_i,
        u_j=u_j,
        L=L,
        J=(L + shortfall) / (span.EA + C),
        P_mid=C,
        long=jnp.array(True),
        converged=jnp.array(True),
        residual=jnp.zeros_like(C),
    )


def ends_of(zeta: Scalar, span: SpanData) -> Ends:
    """Force and ends for the distance zeta from the separatrix.

    u_B = u* (1 -+ e^-zeta) at the end B of smaller |kappa|, where sin u* belongs to q = 0; then q
    follows without cancellation, however small.
    """
    C, EI = span.C, span.EI
    same = span.kap_i * span.kap_j > 0
    k_i, k_j = jnp.abs(span.kap_i), jnp.abs(span.kap_j)
    k_B, k_A = jnp.minimum(k_i, k_j), jnp.maximum(k_i, k_j)
    u_star = jnp.arcsin(jnp.sqrt(EI / C) * k_B / 2)
    h = jnp.where(same, -jnp.exp(-zeta), jnp.exp(-zeta))
    u_B = u_star * (1 + h)
    q = -(4 * C / EI) * jnp.sin(u_star * h) * jnp.sin(u_star * (2 + h)) / jnp.cos(2 * u_B)
    F = C - EI * q / 2
    sine = jnp.sqrt(jnp.clip(EI * (k_A**2 - q) / (4 * F), 1e-30, 1.0))
    u_A = jnp.where(k_A > k_B, jnp.arcsin(jnp.minimum(sine, 1.0 - 1e-12)), u_B)
    first = k_i <= k_j
    return Ends(F, q, jnp.where(first, u_B, u_A), jnp.where(first, u_A, u_B))


def arcs(ends: Ends, kap: Pair, u: Pair, span: SpanData, third: bool = True) -> Arcs:
    """Integrals from the point of least |kappa| to the points of curvature kap and half angle u.

    Their sign is that of the part of the span they measure: they are odd in u where q > 0, and in
    kap where q < 0.
    """
    same = span.kap_i * span.kap_j > 0
    C, F, EI, EA = span.C, ends.F, span.EI, span.EA
    q, b = ends.q, 4 * F / EI
    s, c = jnp.sin(u), jnp.cos(u)
    # In either case the integrals are 2 g R_F, and h (2/3) g^3 times R_D or R_J.
    g = jnp.where(same, s, kap)
    h = jnp.where(same, b * q, -q * (b + q))
    x = jnp.where(same, q * c**2, (b + q) * b * s**2)
    y = jnp.where(same, q + b * s**2, -q * b * c**2)
    z = jnp.where(same, q, -q * (b + q))
    n = jnp.where(same, 2 * F / (EA + F), EI / (2 * (EA + C)))
    found = carlson(x, y, z, z * (1 - n * g**2) if third else None)
    I0, cubed = 2 * g * found.rf, (2 / 3) * h * g**3
    I2 = cubed * found.rd + jnp.where(same, q, 0.0) * I0
    strained = jnp.where(same, (2 * F / (EA + F)) * q, n * h)
    J = (I0 + (2 / 3) * strained * g**3 * found.rj) / jnp.where(same, EA + F, EA + C)
    return Arcs(I0, I2, J)


def to_ends(ends: Ends, span: SpanData, third: bool = True) -> Arcs:
    """`arcs` to the start and to the end of the span, both positive."""
    kap = jnp.abs(jnp.stack([span.kap_i, span.kap_j]))
    return arcs(ends, kap, jnp.stack([ends.u_i, ends.u_j]), span, third)


def _residuals(unknown: Pair, span: SpanData, limit: Span) -> Pair:
    """Residuals of the force's direction and of the span's closure along it, for (z, phi)."""
    ends = ends_of(unknown[0] + _separation(span, limit), span)
    return _unmet(unknown[1], ends, to_ends(ends, span, third=False), span)


def _unmet(phi: Scalar, ends: Ends, parts: Arcs, span: SpanData) -> Pair:
    L, I2 = jnp.sum(parts.I0), jnp.sum(parts.I2)
    along = (span.C * L - span.EI * I2 / 2) / ends.F - _sines(span, ends.u_i, ends.u_j)
    return jnp.stack(
        [
            jnp.sin(phi) - _thrust(span, ends.F),
            # In units of ell the closure changes by about as much as z does.
            (along - span.d * jnp.cos(phi)) / layer(span),
        ]
    )


def _separation(span: SpanData, limit: Span) -> Scalar:
    """The distance zeta from the separatrix that a long span has, whose `separatrix` is `limit`."""
    ell = layer(span)
    kap = jnp.minimum(jnp.abs(span.kap_i), jnp.abs(span.kap_j))
    u_star = jnp.arcsin(ell * kap / 2)
    small = 16 * jnp.tan(limit.u_i / 2) * jnp.tan(limit.u_j / 2) / jnp.tan(2 * u_star) / u_star
    return limit.L / ell - jnp.log(small)


def _start(span: SpanData, limit: Span) -> Pair:
    """(z, phi) of a long span, with z raised where zeta would be below 0.5."""
    return jnp.stack([jnp.maximum(0.0, 0.5 - _separation(span, limit)), limit.phi])


def _bent(span: SpanData, limit: Span) -> Span:
    fixed = jax.lax.stop_gradient((span, limit))
    found = system_root(
        lambda x: _residuals(x, *fixed), _start(*fixed), jnp.array([1.5, 0.5]), tol=1e-9
    )

    def met(unknown: Pair, of: tuple[SpanData, Span]) -> tuple[Pair, _Shape]:
        shape, unmet = _shape(unknown, *of)
        return unmet, shape

    _, shape = implicit_solution(met, (span, limit), found.root)
    return Span(
        **shape._asdict(),
        long=jnp.array(False),
        converged=found.converged,
        residual=jnp.max(jnp.abs(found.residual)),
    )


class _Shape(NamedTuple):
    """The numbers of a `Span` that depend on its data and its unknowns."""

    F: Scalar
    phi: Scalar
    q: Scalar
    u_i: Scalar
    u_j: Scalar
    L: Scalar
    J: Scalar
    P_mid: Scalar


def _shape(unknown: Pair, span: SpanData, limit: Span) -> tuple[_Shape, Pair]:
    """The span for any (z, phi), and the residuals of its equations."""
    z, phi = unknown
    ends = ends_of(z + _separation(span, limit), span)
    parts = to_ends(ends, span)
    middle = curvature(ends, (parts.I0[1] - parts.I0[0]) / 2, span)
    shape = _Shape(
        F=ends.F,
        phi=phi,
        q=ends.q,
        u_i=ends.u_i,
        u_j=ends.u_j,
        L=jnp.sum(parts.I0),
        J=jnp.sum(parts.J),
        P_mid=span.C - span.EI * middle**2 / 2,
    )
    return shape, _unmet(phi, ends, parts, span)


def curvature(ends: Ends, s: Scalar, span: SpanData) -> Scalar:
    """Kappa at the arc length s from the point of least |kappa|, towards the span's end."""
    same = span.kap_i * span.kap_j > 0
    b, q = 4 * ends.F / span.EI, ends.q
    m = jnp.where(same, q / (q + b), -q / b)  # 1 - the parameter
    rate = jnp.sqrt(jnp.where(same, q + b, b)) / 2
    dn, sd = jacobi_dn_sd(rate * s, m)
    lowest = jnp.sqrt(jnp.where(same, q, 1.0)) / dn
    passing = jnp.sqrt(jnp.where(same, 1.0, -q * (1 + q / b))) * sd
    return jnp.sign(span.kap_j) * jnp.where(same, lowest, passing)


def curvature_along(span: Span, data: SpanData, s: Array) -> Array:
    """Signed curvature at arc lengths s [points] from the span's start."""
    bent = _bent_curvature(span, data, s)
    return jnp.where(span.long, _long_curvature(span, data, s), bent)


def _bent_curvature(span: Span, data: SpanData, s: Array) -> Array:
    safe = jax.tree.map(lambda a, b: jnp.where(span.long, a, b), _harmless(data), data)
    ends = Ends(span.F, jnp.where(span.long, 0.1, span.q), span.u_i, span.u_j)
    from_least = s - to_ends(ends, safe, third=False).I0[0]
    return curvature(ends, from_least, safe)


def _long_curvature(span: Span, data: SpanData, s: Array) -> Array:
    """Curvature of both bent ends: tan(u/2) decays from each like e^{-s/ell}."""
    ell = layer(data)
    unbent = ell == 0
    ell = jnp.where(unbent, 1.0, ell)

    def end(u: Scalar, kap: Scalar, away: Array) -> Array:
        fallen = 2 * jnp.arctan(jnp.tan(u / 2) * jnp.exp(-away / ell))
        return jnp.sign(kap) * 2 * jnp.sin(fallen) / ell

    bent = end(span.u_i, data.kap_i, s) + end(span.u_j, data.kap_j, span.L - s)
    return jnp.where(unbent, 0.0, bent)
