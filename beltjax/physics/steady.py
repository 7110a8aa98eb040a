"""Steady state of a whole drive, dimensionless, in the letters of chapter 3.

    eps    bending stiffness, sqrt(EI/P0)/l     T    tension all spans gain, over P0
    s      belt speed, c sqrt(m/P0)             th   rotation of the arm from the reference state
    gam    EA/P0                                lam  span lengths over their mean l
    k_s    k_r/(P0 r_t)                         P    span tensions at rest, over P0
    kap_s, kap_e  curvature sigma l_i/r of the pulleys at each span's ends
    a      (w_i(1) - w_i(0))/th: the span's change of slope per radian of the arm
    D      sin(beta_in) - sin(beta_out);  rho = r_t/l

The arm reaches the equations through `a`, `D`, `k_s` and `rho` alone; a drive with locked centers
has a = D = 0.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from beltjax.numerics.roots import implicit_root, increasing_root
from beltjax.physics import span

Scalar = Float[Array, ""]
Spans = Float[Array, " spans"]


class SteadyModel(NamedTuple):
    """The numbers of one drive at one speed."""

    eps: Scalar
    s: Scalar
    gam: Scalar
    k_s: Scalar
    P: Spans
    lam: Spans
    kap_s: Spans
    kap_e: Spans
    a: Spans
    w_start: Spans  # w_i(0)/th
    D: Scalar
    rho: Scalar


class SteadySolution(NamedTuple):
    """Common tension and arm rotation, with what each span needs to draw itself."""

    T: Scalar
    th: Scalar
    Q: Spans  # effective tensions that the spans' shapes belong to
    slack: Bool[Array, ""]
    converged: Bool[Array, ""]
    residual: Scalar  # of (3.41)
    steps: Int[Array, ""]
    unresolved: Bool[Array, ""] | bool = False  # by a mesh, where there is one
    coupling: Spans | None = None  # Gamma_i, where they come with the solution


def arm_rotation(T: Scalar, model: SteadyModel) -> Scalar:
    """th(T) from the arm's moment balance (3.43), which is linear in th."""
    m = model
    Q = m.P - m.s**2 + T
    ends = (m.kap_e - m.kap_s) * (m.eps / m.lam) ** 2
    weight = m.lam / m.rho  # l_i/r_t
    load = (T - m.s**2) * m.D + jnp.sum(weight * m.a * ends)
    return load / (m.k_s + jnp.sum(weight * m.a**2 * Q))


def belt_length_residual(T: Scalar, model: SteadyModel) -> Scalar:
    """(3.41): the spans' stretch by tension, less what their slopes and the arm take up."""
    m = model
    th = arm_rotation(T, m)
    layers = span.layers(*span.layer_width(m.eps, m.lam, m.P - m.s**2 + T))
    taken = span.stretch(m.kap_s, m.kap_e, m.a * th, layers)
    return jnp.sum(m.lam * (T / m.gam - taken)) + m.rho * m.D * th


def exact(model: SteadyModel) -> SteadySolution:
    """The steady state from its one scalar equation, with the spans in closed form.

    The equation increases from the tension at which the slackest span has Q = 0. If it is
    positive there already, no state has all its spans tight: `slack`.
    """
    fixed = jax.lax.stop_gradient(model)
    lowest = jnp.max(fixed.s**2 - fixed.P)
    # Not at Q = 0 itself, where a string (eps = 0) has no shape.
    floor = lowest + 1e-12 * (1.0 + jnp.abs(lowest))
    # The string at rest moves its tension by eta s^2; start there if that is above the floor.
    guess = jnp.maximum(effectiveness(fixed) * fixed.s**2, floor + 0.05)
    search = increasing_root(lambda T: belt_length_residual(T, fixed), floor, guess)
    slack = search.converged & (search.residual > 1e-6) & (search.root <= floor + 1e-6)
    good = search.converged & ~slack
    safe = without_load(model, ~good)
    T = implicit_root(belt_length_residual, safe, jnp.where(good, search.root, 0.0))
    return SteadySolution(
        T=T,
        th=arm_rotation(T, safe),
        Q=safe.P - safe.s**2 + T,
        slack=slack,
        converged=search.converged,
        residual=search.residual,
        steps=search.steps,
    )


def string(model: SteadyModel) -> SteadySolution:
    """T0 and th0 of the perturbation (3.60)-(3.92): the belt as a string. T1 = th1 = 0."""
    return exact(model._replace(eps=jnp.zeros_like(model.eps)))


def linear(model: SteadyModel) -> SteadySolution:
    """The linear model (3.57)-(3.59): Q = P - s^2 and no stretch by slopes.

    Printed in the source to show that it is not good enough, and here for the same purpose.
    """
    slack = jnp.min(model.P) <= model.s**2
    m = without_load(model, slack)
    Q = m.P - m.s**2
    ends = (m.kap_e - m.kap_s) * (m.eps / m.lam) ** 2
    weight = m.lam / m.rho
    taken_up = jnp.sum(m.lam) / m.gam  # T taken_up + rho D th = 0
    load = -(m.s**2) * m.D + jnp.sum(weight * m.a * ends)
    th = load / (m.k_s + jnp.sum(weight * m.a**2 * Q) + m.rho * m.D**2 / taken_up)
    T = -m.rho * m.D * th / taken_up
    none = jnp.zeros((), dtype=int)
    return SteadySolution(T, th, Q, slack, jnp.array(True), jnp.zeros(()), none)


def coupling(model: SteadyModel, Q: Spans) -> Spans:
    """Gamma_i, the integral of w_i''^2 over each span."""
    layers = span.layers(*span.layer_width(model.eps, model.lam, Q))
    return span.bending(model.kap_s, model.kap_e, layers)


def leading_coupling(model: SteadyModel, Q: Spans) -> Spans:
    """Gamma_i to leading order in eps: (eps l/(2 l_i)) (kap_s^2 + kap_e^2)/sqrt(Q)."""
    return model.eps / (2 * model.lam) * (model.kap_s**2 + model.kap_e**2) / jnp.sqrt(Q)


def effectiveness(model: SteadyModel) -> Scalar:
    """Tensioner effectiveness eta = dT/d(s^2) of the string at rest (3.95), k_s/r_t corrected."""
    m = model
    arm = jnp.sum(m.P * m.a**2 * m.lam) / m.rho**2 + m.k_s / m.rho
    return m.gam * m.D**2 / (m.gam * m.D**2 + jnp.sum(m.lam) * arm)


def deflection(model: SteadyModel, th: Scalar, Q: Spans, i, x: Array) -> Array:
    """w_i at x in [0, 1], both over the span's own length."""
    u, z = span.layer_width(model.eps, model.lam[i], Q[i])
    bent = model.kap_s[i] * span.bump(1 - x, u, z) + model.kap_e[i] * span.bump(x, u, z)
    return (model.w_start[i] + model.a[i] * x) * th + bent


def leading_deflection(model: SteadyModel, th: Scalar, Q: Spans, i, x: Array) -> Array:
    """The composite expansion of the perturbation: line, plus layers of one-sided exponentials."""
    u = model.eps / (model.lam[i] * jnp.sqrt(Q[i]))
    kap_s, kap_e = model.kap_s[i], model.kap_e[i]
    k = 1.0 / jnp.maximum(u, 1e-300)
    layer = -kap_s + (kap_s - kap_e) * x
    layer = layer + kap_s * jnp.exp(-k * x) + kap_e * jnp.exp(-k * (1 - x))
    return (model.w_start[i] + model.a[i] * x) * th + u**2 * layer


def without_load(model: SteadyModel, where: Bool[Array, ""]) -> SteadyModel:
    """`model`, with nothing bending or moving the belt `where` that flag is set.

    Its steady state is T = th = 0, whose values and derivatives are finite: a placeholder
    that cannot disturb the other lanes of a batch.
    """
    nothing = model._replace(
        s=jnp.zeros_like(model.s),
        P=jnp.ones_like(model.P),
        kap_s=jnp.zeros_like(model.kap_s),
        kap_e=jnp.zeros_like(model.kap_e),
    )
    return jax.tree.map(lambda bare, full: jnp.where(where, bare, full), nothing, model)
