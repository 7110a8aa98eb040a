"""Steady state of a whole drive, dimensionless, in the letters of chapter 3, for any bodies.

    eps    bending stiffness, sqrt(EI/P0)/l     T    tension that a belt's spans gain, over P0
    c2     belt speed, m c^2/P0                 q    coordinates, from the reference state
    lam    span lengths over their mean l       P    span tensions at rest, over P0
    kap_s, kap_e  curvature sigma l_i/r of the pulleys at each span's ends
    flux   c2, or the part of it that is not yet in the reference state
    give   stretch of each belt per tension, Lambda/EA in P0 and l
    S      the span's part of the path's derivative by q;  a   slope it gains, by q
    H      second derivative of the distance along the span;  W0  lift at its start, over l_i
    K      stiffness of the springs;  lo, hi  how far q may move;  rho  what stops carry at rest

The source has one arm and no H: a = (w_i(1) - w_i(0))/theta_t, sum of S = -r_t D/l and
K = k_r/(P0 l). docs/theory/bodies.md, (M7) to (M10).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from beltjax.compiling.batched_loops import in_lanes_of
from beltjax.numerics.definite import Definite, definite_solve
from beltjax.numerics.roots import implicit_root, increasing_root, system_root
from beltjax.physics import span

Scalar = Float[Array, ""]
Spans = Float[Array, " spans"]
Belts = Float[Array, " belts"]
Coordinates = Float[Array, " coordinates"]
Index = int | Int[Array, ""]
# Tensions, residual, whether a span is slack, whether the search converged, and its steps.
FoundTensions = tuple[Belts, Scalar, Bool[Array, ""], Bool[Array, ""], Int[Array, ""]]


class SteadyModel(NamedTuple):
    """The numbers of one drive at one speed."""

    eps: Spans
    c2: Spans
    flux: Spans  # the part of c2 that the reference state does not balance yet
    give: Belts
    belts: Float[Array, "belts spans"]  # 1 where the span is one of the belt's
    P: Spans
    lam: Spans
    kap_s: Spans
    kap_e: Spans
    S: Float[Array, "spans coordinates"]
    a: Float[Array, "spans coordinates"]
    W0: Float[Array, "spans coordinates"]
    H: Float[Array, "spans coordinates coordinates"]
    K: Float[Array, "coordinates coordinates"]
    movable: Coordinates  # 0 where locked
    lo: Coordinates
    hi: Coordinates
    rho: Coordinates


class SteadySolution(NamedTuple):
    """Tension of each belt and coordinates, with what the spans' shapes and the verdict need."""

    T: Belts
    q: Coordinates
    Q: Spans  # effective tensions that the spans' shapes belong to
    held: Coordinates  # -1 where a stop holds q from below, 1 from above, 0 where none does
    reaction: Coordinates  # force of those stops
    slack: Bool[Array, ""]
    unstable: Bool[Array, ""]  # the springs do not hold the bodies at rest
    converged: Bool[Array, ""]
    residual: Scalar  # of (M8)
    steps: Int[Array, ""]
    unresolved: Bool[Array, ""] | bool = False  # by a mesh, where there is one
    coupling: Spans | None = None  # Gamma_i, where they come with the solution


class Settled(NamedTuple):
    """Positions of the bodies for given tensions."""

    q: Coordinates
    held: Coordinates
    reaction: Coordinates
    definite: Bool[Array, ""]


def spread(T: Belts, model: SteadyModel) -> Spans:
    """The tension of each span's belt."""
    return jnp.sum(T[:, None] * model.belts, axis=0)


def sums(values: Float[Array, " spans"], model: SteadyModel) -> Belts:
    """Sums over the spans of each belt."""
    return jnp.sum(model.belts * values, axis=1)


def geometric(model: SteadyModel) -> Float[Array, "spans coordinates coordinates"]:
    """Stiffness by which each span's unit of tension holds the bodies."""
    a = model.a
    return model.lam[:, None, None] * a[:, :, None] * a[:, None, :] + model.H


def stiffness(Q: Spans, model: SteadyModel) -> Float[Array, "coordinates coordinates"]:
    """A, the stiffness of the springs and of the belt under effective tensions Q."""
    return model.K + jnp.sum(Q[:, None, None] * geometric(model), axis=0)


def settled(T: Belts, model: SteadyModel) -> Settled:
    """Coordinates at which springs, belt and stops balance (M7); they are linear but for stops."""
    m = model
    of_span = spread(T, m)
    ends = (m.kap_e - m.kap_s) * m.eps**2 / m.lam
    load = jnp.sum((m.flux - of_span)[:, None] * m.S + ends[:, None] * m.a, axis=0) - m.rho
    return box_minimum(stiffness(m.P - m.c2 + of_span, m), load, m.movable, m.lo, m.hi)


_Bounds = tuple[Bool[Array, " coordinates"], Bool[Array, " coordinates"]]


class _Box(NamedTuple):
    """A quadratic q.A.q/2 - load.q between bounds."""

    A: Float[Array, "coordinates coordinates"]
    load: Coordinates
    lo: Coordinates
    hi: Coordinates


def box_minimum(
    A: Float[Array, "coordinates coordinates"],
    load: Coordinates,
    movable: Coordinates,
    lo: Coordinates,
    hi: Coordinates,
) -> Settled:
    """Minimizer of q.A.q/2 - load.q with lo <= q <= hi, where `movable`; elsewhere q = 0.

    Which bounds hold is found by the primal-dual active set method, whose rounds are those of
    Newton's method on the complementarity conditions; the last solve alone is differentiated.
    """
    count = len(load)
    bounds = jnp.zeros(count, bool), jnp.zeros(count, bool)  # that hold: below, above

    def solved(problem: _Box, bounds: _Bounds) -> tuple[Coordinates, Definite]:
        below, above = bounds
        at = jnp.where(below, problem.lo, jnp.where(above, problem.hi, 0.0))
        moves = movable * (1.0 - below) * (1.0 - above)
        found = definite_solve(problem.A, problem.load - problem.A @ at, moves)
        return at + found.solution, found

    problem = _Box(A, load, lo, hi)
    fixed, free = jax.lax.stop_gradient(problem), movable > 0

    def exchanged(k: int, bounds: _Bounds) -> _Bounds:
        """Bounds after one round: they release what they would pull, and stop what is beyond."""
        q = solved(fixed, bounds)[0]
        push, (below, above) = fixed.A @ q - fixed.load, bounds
        return (
            free & jnp.where(below, push > 0, q < fixed.lo),
            free & jnp.where(above, push < 0, q > fixed.hi),
        )

    if count == 1:  # a single body is at a stop if and only if it would pass that stop when free
        bounds = exchanged(0, bounds)
    elif count:
        bounds = jax.lax.fori_loop(0, 2 * count, exchanged, in_lanes_of(load, bounds))
    q, found = solved(problem, bounds)
    below, above = bounds
    held = jnp.where(below, -1.0, jnp.where(above, 1.0, 0.0))
    reaction = jnp.where(held != 0, A @ q - load, 0.0)
    return Settled(q, held, reaction, found.definite)


def belt_length_residual(T: Belts, model: SteadyModel) -> Belts:
    """Residual of (M8): the belts' stretch by tension, less what slopes and bodies take up."""
    return _residual_and_settled(T, model)[0]


def _residual_and_settled(T: Belts, model: SteadyModel) -> tuple[Belts, Settled]:
    m = model
    found = settled(T, m)
    q, Q = found.q, m.P - m.c2 + spread(T, m)
    layers = span.layers(*span.layer_width(m.eps, m.lam, Q))
    wavy = m.lam * span.stretch(m.kap_s, m.kap_e, m.a @ q, layers)
    return m.give * T - sums(m.S @ q + bent(m.H, q) + wavy, m), found


def bent(H: Float[Array, "spans coordinates coordinates"], q: Coordinates) -> Spans:
    """q.H.q/2 of each span."""
    return jnp.sum(H * q[:, None] * q, axis=(1, 2)) / 2


def exact(model: SteadyModel) -> SteadySolution:
    """The steady state from one scalar equation per belt, with the spans in closed form.

    R(T) has a slope of at least `give` where the spans are tight and A is positive definite; the
    interval of such T contains T = c^2 (M9). So one value of R brackets the root. If R is positive
    already where the slackest span has Q = 0, no state has all its spans tight: `slack` is set.
    """
    fixed = jax.lax.stop_gradient(model)
    unstable = ~_rests(fixed)
    if len(model.give) == 1:
        root, residual, slack, converged, steps = _one_belt(fixed)
    else:
        root, residual, slack, converged, steps = _several_belts(fixed)
    good = converged & ~slack & ~unstable
    safe = without_load(model, ~good)
    T = jnp.where(good, root, 0.0)
    if len(model.give) == 1:
        # One equation is solved as a scalar, which needs no small system.
        T = implicit_root(lambda t, m: belt_length_residual(t[None], m)[0], safe, T[0])[None]
    else:
        T = implicit_root(belt_length_residual, safe, T)
    at = settled(T, safe)
    return SteadySolution(
        T=T,
        q=at.q,
        Q=safe.P - safe.c2 + spread(T, safe),
        held=at.held,
        reaction=at.reaction,
        slack=slack,
        unstable=unstable,
        converged=converged,
        residual=residual,
        steps=steps,
    )


def _rests(model: SteadyModel) -> Bool[Array, ""]:
    """Whether A at rest is positive definite: the springs and the belt hold the bodies."""
    none = jnp.zeros_like(model.movable)
    return definite_solve(stiffness(model.P, model), none, model.movable).definite


def _one_belt(fixed: SteadyModel) -> FoundTensions:
    """Search for the tension of a single belt."""
    lowest = jnp.max(fixed.c2 - fixed.P)
    # Not at Q = 0 itself, where a string (eps = 0) has no shape.
    floor = lowest + 1e-12 * (1.0 + jnp.abs(lowest))
    at_rest = jnp.max(fixed.c2)  # there Q = P

    def residual(T: Scalar) -> Scalar:
        value, at = _residual_and_settled(T[None], fixed)
        # Where A is not definite the root lies towards the tension at which it is.
        beyond = jnp.where(at_rest > T, -jnp.inf, jnp.inf)
        return jnp.where(at.definite, value[0], beyond)

    # The string at rest moves its tension by eta c^2; start there if that is above the floor.
    guess = jnp.maximum(effectiveness(fixed)[0, 0] * jnp.max(fixed.flux), floor + 0.05)
    search = increasing_root(residual, floor, guess, least_slope=fixed.give[0])
    slack = search.converged & (search.residual > 1e-6) & (search.root <= floor + 1e-6)
    return search.root[None], search.residual, slack, search.converged, search.steps


def _several_belts(fixed: SteadyModel) -> FoundTensions:
    """Search for the tensions of several belts, which the bodies couple."""
    speed2 = jnp.max(fixed.belts * fixed.flux, axis=1)
    guess = effectiveness(fixed) @ speed2
    largest = 0.5 + jnp.abs(speed2)
    scale = fixed.give
    search = system_root(lambda T: belt_length_residual(T, fixed) / scale, guess, largest)
    Q = fixed.P - fixed.c2 + spread(search.root, fixed)
    finite = jnp.all(jnp.isfinite(search.root))
    slack = ~finite | (jnp.min(Q) <= 0)
    root = jnp.where(finite, search.root, 0.0)
    return root, jnp.max(jnp.abs(search.residual)), slack, search.converged | slack, search.steps


def string(model: SteadyModel) -> SteadySolution:
    """T0 and q0 of the perturbation (3.60)-(3.92), in which the belt is a string; T1 = q1 = 0."""
    return exact(model._replace(eps=jnp.zeros_like(model.eps)))


def linear(model: SteadyModel) -> SteadySolution:
    """The linear model (3.57)-(3.59): Q = P - c^2 and no stretch by slopes.

    The source prints it to show that it is not accurate enough, and it serves the same purpose
    here. It ignores stops.
    """
    slack = jnp.min(model.P - model.c2) <= 0
    m = without_load(model, slack)
    Q = m.P - m.c2
    ends = (m.kap_e - m.kap_s) * m.eps**2 / m.lam
    load = jnp.sum(m.flux[:, None] * m.S + ends[:, None] * m.a, axis=0)
    A = stiffness(Q, m)
    take_up = -m.belts @ m.S  # D of each belt
    # give T + D.q = 0 and A q = load + D^T T
    free = definite_solve(A, load, m.movable)
    by_tension = jax.vmap(lambda right: definite_solve(A, right, m.movable).solution)(take_up)
    everywhere = jnp.ones_like(m.give)
    whole = jnp.diag(m.give) + take_up @ by_tension.T
    T = definite_solve(whole, -(take_up @ free.solution), everywhere).solution
    none = jnp.zeros_like(load)
    return SteadySolution(
        T=T,
        q=free.solution + T @ by_tension,
        Q=Q,
        held=none,
        reaction=none,
        slack=slack,
        unstable=~free.definite,
        converged=jnp.array(True),
        residual=jnp.zeros(()),
        steps=jnp.zeros((), dtype=int),
    )


def coupling(model: SteadyModel, Q: Spans) -> Spans:
    """Gamma_i, the integral of w_i''^2 over each span."""
    layers = span.layers(*span.layer_width(model.eps, model.lam, Q))
    return span.bending(model.kap_s, model.kap_e, layers)


def leading_coupling(model: SteadyModel, Q: Spans) -> Spans:
    """Gamma_i to leading order in eps: (eps l/(2 l_i)) (kap_s^2 + kap_e^2)/sqrt(Q)."""
    return model.eps / (2 * model.lam) * (model.kap_s**2 + model.kap_e**2) / jnp.sqrt(Q)


def effectiveness(
    model: SteadyModel, movable: Coordinates | None = None
) -> Float[Array, "belts belts"]:
    """Tensioner effectiveness eta = dT/d(m c^2) of the strings at rest (M10).

    With N_bc = D_b.A^-1.D_c it is (give + N)^-1 N, whose entry [b, c] says what the speed of belt
    c does to belt b. For one belt it is N/(give + N), the source's (3.95) with k_s/r_t corrected.
    """
    m = model
    movable = m.movable if movable is None else movable
    A = stiffness(m.P, m)
    take_up = -m.belts @ m.S
    moved = [definite_solve(A, row, movable).solution for row in take_up]
    N = take_up @ jnp.stack(moved).T
    if len(m.give) == 1:
        return N / (m.give + N)
    everywhere = jnp.ones_like(m.give)
    columns = [
        definite_solve(jnp.diag(m.give) + N, N[:, b], everywhere).solution
        for b in range(len(m.give))
    ]
    return jnp.stack(columns, axis=1)


def deflection(model: SteadyModel, q: Coordinates, Q: Spans, i: Index, x: Array) -> Array:
    """w_i at x in [0, 1], both over the span's own length."""
    u, z = span.layer_width(model.eps[i], model.lam[i], Q[i])
    bent = model.kap_s[i] * span.bump(1 - x, u, z) + model.kap_e[i] * span.bump(x, u, z)
    return line(model, q, i, x) + bent


def line(model: SteadyModel, q: Coordinates, i: Index, x: Array) -> Array:
    """The straight line between the moved ends of span i."""
    return jnp.sum(model.W0[i] * q) + jnp.sum(model.a[i] * q) * x


def leading_deflection(model: SteadyModel, q: Coordinates, Q: Spans, i: Index, x: Array) -> Array:
    """The composite expansion of the perturbation: a line and layers of one-sided exponentials."""
    u = model.eps[i] / (model.lam[i] * jnp.sqrt(Q[i]))
    kap_s, kap_e = model.kap_s[i], model.kap_e[i]
    k = 1.0 / jnp.maximum(u, 1e-300)
    layer = -kap_s + (kap_s - kap_e) * x
    layer = layer + kap_s * jnp.exp(-k * x) + kap_e * jnp.exp(-k * (1 - x))
    return line(model, q, i, x) + u**2 * layer


def without_load(model: SteadyModel, where: Bool[Array, ""]) -> SteadyModel:
    """`model`, in which nothing bends or moves the belt `where` that flag is set.

    Its steady state is T = q = 0, whose values and derivatives are finite: it is a placeholder
    that cannot disturb the other lanes of a batch.
    """
    nothing = model._replace(
        c2=jnp.zeros_like(model.c2),
        flux=jnp.zeros_like(model.flux),
        P=jnp.ones_like(model.P),
        kap_s=jnp.zeros_like(model.kap_s),
        kap_e=jnp.zeros_like(model.kap_e),
        movable=jnp.zeros_like(model.movable),
        rho=jnp.zeros_like(model.rho),
    )
    return jax.tree.map(lambda bare, full: jnp.where(where, bare, full), nothing, model)
