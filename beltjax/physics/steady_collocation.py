"""The steady state by Gauss collocation of the spans' equations, in the letters of chapter 3.

The standard form (3.48)-(3.55) for n pulleys. Each span, on its own unit interval, has

    w' = v,   v' = m,   e m' = mu,   e mu' = Q m,   I' = v^2/2,     e = eps/lam, Q = P - c2 + T
    m(0) = kap_s,   m(1) = kap_e,   w(1) - w(0) = a.q

(mu is w''' scaled by e, so that no state grows in the ends' layers), and the spans meet only in
T and q, by the belts' lengths (3.41) and the bodies' balance (3.43). For given T all of it is
linear but I, and triangular: (m, mu) is a two-point problem, and v, w and I follow by the same
Gauss formula as quadratures. The collocation equations are those of the whole system; this is
their elimination, span by span, so that the cost is linear in the number of spans.

The closed form only gives where the search begins and whether there is a state. No number of the
result depends on it, so that this is an independent check of `physics.steady`.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.numerics.bvp.chain import ChainLinks as Links
from beltjax.numerics.bvp.chain import carry_back, carry_forward, merge_links
from beltjax.numerics.bvp.gauss import Gauss
from beltjax.numerics.roots import implicit_root, system_root
from beltjax.numerics.small_matrices import identity, inverse, matvec, mix
from beltjax.physics.steady import (
    Belts,
    Coordinates,
    Index,
    Settled,
    SteadyModel,
    SteadySolution,
    bent,
    box_minimum,
    exact,
    line,
    spread,
    stiffness,
    sums,
    without_load,
)

Spans = Float[Array, " spans"]
Mesh = Float[Array, "spans N+1"]

FLOOR = 0.25  # nodes outside the ends' layers, over those in them
_MESH_STEPS = 8  # of Newton's method for the nodes, which need not be exact


class Shapes(NamedTuple):
    """Shapes of the spans at the nodes and at the stages, for bodies that have not moved.

    Moved bodies add a.q to v.
    """

    m: Float[Array, "spans N+1"]
    mu: Float[Array, "spans N+1"]
    v: Float[Array, "spans N+1"]
    w: Float[Array, "spans N+1"]  # from the line between the ends of the moved span
    m_stages: Float[Array, "s spans N"]
    v_stages: Float[Array, "s spans N"]
    h: Float[Array, "spans N"]


def layer_mesh(u: Spans, intervals: int, stages: int) -> Mesh:
    """Nodes for layers e^{-x/u} at both ends, as dense as |layer^(s+1)|^(1/(s+1)) over a floor.

    In the layer's variable t = x/((s+1) u) a node's share is a t + 1 - e^{-t}. This function is
    concave, so that Newton's method climbs to its inverse from below.
    """
    half = (intervals + 1) // 2
    middle = 0.5 / ((stages + 1) * u)[:, None]
    a = FLOOR / middle
    share = (FLOOR + 1.0 - jnp.exp(-middle)) * jnp.arange(half + 1) * (2.0 / intervals)
    t = jnp.maximum(share / (a + 1.0), (share - 1.0) / a)
    for _ in range(_MESH_STEPS):
        decay = jnp.exp(-t)
        t = t + (share - a * t - (1.0 - decay)) / (a + decay)
    left = jnp.clip(0.5 * t / middle, 0.0, 0.5)
    left = left[:, : intervals // 2 + 1]
    if intervals % 2 == 0:
        left = left.at[:, -1].set(0.5)
        return jnp.concatenate([left, 1.0 - left[:, -2::-1]], axis=1)
    return jnp.concatenate([left, 1.0 - left[:, ::-1]], axis=1)


def mesh_for(model: SteadyModel, Q: Spans, intervals: int, stages: int) -> Mesh:
    """A mesh, without derivatives, for spans under about these effective tensions."""
    e, Q = model.eps / model.lam, jnp.maximum(Q, 1e-3)
    u = jnp.clip(e / jnp.sqrt(Q), 1e-7, 10.0)
    return jax.lax.stop_gradient(layer_mesh(u, intervals, stages))


def shapes(model: SteadyModel, Q: Spans, mesh: Mesh, scheme: Gauss) -> Shapes:
    """Every span's collocation solution for given effective tensions."""
    e = (model.eps / model.lam)[:, None]
    q = Q[:, None]
    h = jnp.diff(mesh, axis=1)
    r = h / e
    # Stage moments from the values at the interval's start: (I - r^2 Q A^2) M = m + r mu c.
    A = jnp.asarray(scheme.inner)
    c = jnp.asarray(scheme.points)[:, None, None]
    unit = identity(scheme.stages, A[..., None, None] * r)
    solve = inverse(unit - (A @ A)[..., None, None] * (r**2 * q))
    M_m = jnp.sum(solve, axis=1)
    M_mu = matvec(solve, c * r)
    b = scheme.weights
    # (m, mu) at the interval's end, by the weights b; b A = b (1 - c) for Gauss formulas.
    bA = b @ scheme.inner
    transfer = jnp.stack(
        [
            jnp.stack([1.0 + r**2 * q * mix(bA, M_m), r + r**2 * q * mix(bA, M_mu)]),
            jnp.stack([r * q * mix(b, M_m), 1.0 + r * q * mix(b, M_mu)]),
        ]
    )
    m, mu = _chained(transfer, model.kap_s, model.kap_e)
    M = M_m * m[:, :-1] + M_mu * mu[:, :-1]
    v = _accumulate(h * mix(b, M))
    V = v[:, :-1] + h * mix(scheme.inner, M)
    w = _accumulate(h * mix(b, V))
    # Each span is turned about its start until both ends lie on the line that the bodies set.
    turn = w[:, -1:]
    return Shapes(m, mu, v - turn, w - turn * mesh, M, V - turn, h)


def _accumulate(steps: Float[Array, "spans N"]) -> Float[Array, "spans N+1"]:
    """Sums of the steps up to each node, from zero."""
    return jnp.pad(jnp.cumsum(steps, axis=1), ((0, 0), (1, 0)))


def _chained(
    transfer: Float[Array, "2 2 spans N"], kap_s: Spans, kap_e: Spans
) -> Float[Array, "2 spans N+1"]:
    """Node values (m, mu) that the transfer matrices link, with m given at both ends.

    One pass along the intervals serves all spans at once.
    """
    spans, N = transfer.shape[2:]
    size = 2 * spans * N

    def left(flat: Float[Array, " unknowns"]) -> Float[Array, " unknowns"]:
        y = flat.reshape(2, spans, N + 1)
        links = y[:, :, 1:] - matvec(transfer, y[:, :, :-1])
        return jnp.concatenate([links.reshape(-1), y[0, :, 0], y[0, :, -1]])

    A = jnp.moveaxis(-transfer, -1, 0)
    links = Links(A, jnp.broadcast_to(identity(2, A[0]), A.shape), jnp.zeros((N, 2, 0, spans)))
    outer, merges = jax.lax.stop_gradient(merge_links(links))
    # The elimination leaves two equations per span in (m_0, mu_0, m_N, mu_N).
    unknown = jnp.stack([outer.A[:, 1], outer.B[:, 1]], axis=1)
    cofactors = jnp.stack(
        [jnp.stack([unknown[1, 1], -unknown[0, 1]]), jnp.stack([-unknown[1, 0], unknown[0, 0]])]
    )
    ends = cofactors / (unknown[0, 0] * unknown[1, 1] - unknown[0, 1] * unknown[1, 0])

    def solved(right: Float[Array, " unknowns"]) -> Float[Array, " unknowns"]:
        g = jnp.moveaxis(right[:size].reshape(2, spans, N), -1, 0)
        m_first, m_last = right[size:].reshape(2, spans)
        g, tops = carry_forward(merges, g)
        mu_first, mu_last = matvec(ends, g - outer.A[:, 0] * m_first - outer.B[:, 0] * m_last)
        first, last = jnp.stack([m_first, mu_first]), jnp.stack([m_last, mu_last])
        middle = carry_back(merges, tops, first, last, jnp.zeros((0, spans)))
        y = jnp.concatenate([first[None], middle, last[None]])
        return jnp.moveaxis(y, 0, -1).reshape(-1)

    right = jnp.concatenate([jnp.zeros(size), kap_s, kap_e])
    y = jax.lax.custom_linear_solve(
        left,
        right,
        lambda _, b: solved(b),
        lambda _, c: jax.linear_transpose(solved, right)(c)[0],
    )
    return y.reshape(2, spans, N + 1)


class Joined(NamedTuple):
    """All spans under given tensions, and the residuals of the equations that join them."""

    residual: Belts  # (3.41) of each belt
    settled: Settled
    coupling: Spans  # Gamma_i


def joined(T: Belts, model: SteadyModel, mesh: Mesh, scheme: Gauss) -> Joined:
    """The spans and the bodies for given tensions."""
    m, of_span = model, spread(T, model)
    Q = m.P - m.c2 + of_span
    found = shapes(m, Q, mesh, scheme)
    # The transverse force is the same at both ends, also after collocation, which keeps linear
    # invariants.
    force = m.lam * (-Q * found.v[:, 0] + m.eps / m.lam * found.mu[:, 0])
    load = jnp.sum((m.flux - of_span)[:, None] * m.S + force[:, None] * m.a, axis=0) - m.rho
    at = box_minimum(stiffness(Q, m), load, m.movable, m.lo, m.hi)
    slopes = found.v_stages + (m.a @ at.q)[:, None]
    taken = 0.5 * m.lam * jnp.sum(found.h * mix(scheme.weights, slopes**2), axis=1)
    residual = m.give * T - sums(m.S @ at.q + bent(m.H, at.q) + taken, m)
    bending = jnp.sum(found.h * mix(scheme.weights, found.m_stages**2), axis=1)
    return Joined(residual, at, bending)


def collocated(
    model: SteadyModel, scheme: Gauss, finer: Gauss, intervals: int, tol: Float[Array, ""]
) -> SteadySolution:
    """The steady state of the collocation equations, with an estimate of their error.

    As in `exact`, `slack` says that no state has all its spans tight. `residual` is the residual
    of (3.41) by the same equations with the stages of `finer`; a state for which that is above
    `tol` (1 + T) is `unresolved`.
    """
    # A string has no layers and no equation of fourth order: only the closed form has that limit.
    stiff = jnp.all(model.eps > 0)
    model = without_load(_stiffened(model), ~stiff)
    fixed = jax.lax.stop_gradient(model)
    closed = exact(fixed)  # where the search for the root of these equations begins
    lowest = jnp.max(fixed.c2 - fixed.P - spread(closed.T, fixed))
    # A span still has a shape close to Q = 0, but these meshes are not made for smaller Q.
    tight = closed.converged & ~closed.slack & (lowest < -1e-9)
    safe = without_load(model, ~tight)
    fixed = jax.lax.stop_gradient(safe)
    guess = jnp.where(tight, closed.T, 0.0)
    mesh = mesh_for(fixed, fixed.P - fixed.c2 + spread(guess, fixed), intervals, scheme.stages)

    def residual(T: Belts, model: SteadyModel) -> Belts:
        return joined(T, model, mesh, scheme).residual / model.give

    largest = 0.1 + jnp.abs(guess)
    search = system_root(lambda T: residual(T, fixed), guess, largest, tol=1e-9)
    good = search.converged & tight & jnp.all(jnp.isfinite(search.root))
    safe = without_load(safe, ~good)
    T = implicit_root(residual, safe, jnp.where(good, search.root, 0.0))
    found = joined(T, safe, mesh, scheme)
    left = joined(*jax.lax.stop_gradient((T, safe)), mesh, finer).residual
    left = jnp.max(jnp.abs(left))
    return SteadySolution(
        T=T,
        q=found.settled.q,
        Q=safe.P - safe.c2 + spread(T, safe),
        held=found.settled.held,
        reaction=found.settled.reaction,
        slack=closed.slack | (closed.converged & ~tight),
        unstable=closed.unstable,
        converged=closed.converged & (search.converged | ~tight),
        residual=left,
        steps=search.steps,
        unresolved=~stiff | ~(left <= tol * (1.0 + jnp.max(jnp.abs(T)))),
        coupling=found.coupling,
    )


def _stiffened(model: SteadyModel) -> SteadyModel:
    """`model`, with eps = 1 in place of 0, for which the equations are singular."""
    return model._replace(eps=jnp.where(model.eps > 0, model.eps, 1.0))


def deflection(
    model: SteadyModel, q: Coordinates, Q: Spans, i: Index, x: Array, scheme: Gauss, intervals: int
) -> Array:
    """w_i at x in [0, 1] by the collocation polynomial of w, whose slopes are the stages' v."""
    model = _stiffened(model)
    mesh = mesh_for(model, Q, intervals, scheme.stages)
    found = shapes(model, Q, mesh, scheme)
    nodes, h = mesh[i], found.h[i]
    at = jnp.clip(jnp.searchsorted(nodes, x, side="right") - 1, 0, intervals - 1)
    t = (x - nodes[at]) / h[at]
    degree = jnp.arange(1, scheme.stages + 1)
    weights = jnp.asarray(scheme.slope / degree)  # [s, powers]
    powers = t[..., None] ** degree
    slopes = found.v_stages[:, i][:, at]  # [s, ...]
    rise = h[at] * jnp.einsum("jm,...m,j...->...", weights, powers, slopes)
    return line(model, q, i, x) + found.w[i][at] + rise
