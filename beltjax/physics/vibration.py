"""Vibration of a whole drive about its steady state, dimensionless (chapter 4).

    w      deflection of a span over its length, positive inwards; * marks the steady state
    theta  rotation of each pulley in the direction of belt travel;  thetat  of the arm
    e      strain a span gains: [u(l) - u(0)]/l + 1/2 int w_x^2
    ka     l_i/r_t, weight of a span's energy      lam, rho, gam, k_s, s, eps   as in chapter 3
    phi    lift of a span by the arm: (w_start + a x) thetat
    tau    +1 where the belt runs along x, -1 where against it (the source)

Energies are over P0 r_t, times over l sqrt(m/P0). A span's functions are y = w - phi thetat,
zero at both ends, in a basis; its end moments are natural.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.numerics.bases import AbstractBasis, Products

Scalar = Float[Array, ""]
Spans = Float[Array, " spans"]
Pulleys = Float[Array, " pulleys"]


class VibrationModel(NamedTuple):
    """The numbers of one drive in one steady state."""

    eps: Scalar  # of the spans' bending operator
    s: Scalar
    tau: Scalar
    gam: Scalar
    k_s: Scalar
    lam: Spans
    rho: Scalar  # r_t/l
    Q: Spans  # effective tension P - s^2 + T
    kap_s: Spans  # w*'' at the spans' ends
    kap_e: Spans
    u: Spans  # thickness of the end layers of w*, and its square's inverse (`span.layer_width`)
    z: Spans
    drop: Spans  # w*(1) - w*(0)
    a: Spans  # lift at x = 1 less that at 0, per radian of the arm
    w_start: Spans  # lift at x = 0
    pull: Spans  # strain of each span per radian of the arm: d(l_i)/d(thetat)/l_i
    r: Pulleys  # r_i/l
    J: Pulleys  # mhat_i r_i/r_t
    J_t: Scalar  # mhat_t

    @property
    def ka(self) -> Spans:
        """l_i/r_t."""
        return self.lam / self.rho


class Motion(NamedTuple):
    """A motion of the drive, away from its steady state: fields at quadrature points, rotations."""

    w: Float[Array, "spans points"]
    w_x: Float[Array, "spans points"]
    w_xx: Float[Array, "spans points"]
    theta: Pulleys
    thetat: Scalar


class Matrices(NamedTuple):
    """M z'' + G z' + K z = 0 for z = (y of span 1, .., y of span n, theta, thetat)."""

    mass: Float[Array, "size size"]
    gyroscopic: Float[Array, "size size"]
    stiffness: Float[Array, "size size"]


def energy(
    moved: Motion, rate: Motion, slopes: Float[Array, "spans points"], weights, model
) -> Scalar:
    """Lagrangian T0 + T1 - (V - T2) of the drive, up to terms of first order (MODEL.md, section 3).

    `slopes` is w*_x at the points of the quadrature rule with these `weights` [spans points].
    Its second derivatives with respect to a motion and its rate are K, G and M. What is linear
    in the motion vanishes at a steady state and is left out: the end moments and the torques.
    """
    m = model

    def over_span(f):
        return jnp.sum(weights * f, axis=-1)

    ends = (jnp.roll(m.r * moved.theta, -1) - m.r * moved.theta) / m.lam
    strain = m.tau * ends + m.pull * moved.thetat
    strain = strain + over_span(slopes * moved.w_x + moved.w_x**2 / 2)
    # gamma e* + P - s^2 = Q: the tension that works on what is of second order in the strain.
    stretch = m.gam * strain**2 / 2 + m.Q * over_span(moved.w_x**2) / 2
    bend = (m.eps / m.lam) ** 2 * over_span(moved.w_xx**2) / 2
    potential = jnp.sum(m.ka * (stretch + bend)) + m.k_s * moved.thetat**2 / 2
    coriolis = m.tau * m.s * jnp.sum(m.lam * m.ka * over_span(rate.w * moved.w_x))
    kinetic = jnp.sum(m.lam**2 * m.ka * over_span(rate.w**2)) + jnp.sum(m.J * rate.theta**2)
    return (kinetic + m.J_t * rate.thetat**2) / 2 + coriolis - potential


def assembled(
    model: VibrationModel, basis: AbstractBasis, d: Float[Array, "spans size"]
) -> Matrices:
    """M, G and K from each span's own matrices, its lift by the arm, and its stretch.

    All that couples the belt to the pulleys is one rank-one term a span: ka gamma d d^T, with
    d the gradient of the span's elongation (`elongations`).
    """
    m, of = model, basis.products()
    spans, n = len(m.lam), basis.size
    each = jnp.arange(spans)
    weight = m.lam**2 * m.ka
    drag = m.tau * m.s * m.lam * m.ka
    size = spans * n + spans + 1
    arm = size - 1

    def blocks(local: Float[Array, "spans n n"]) -> Array:
        whole = jnp.zeros((spans, n, spans, n)).at[each, :, each, :].set(local)
        whole = whole.reshape(spans * n, spans * n)
        return jnp.zeros((size, size)).at[: spans * n, : spans * n].set(whole)

    def lifted(column: Float[Array, "spans n"], sign: float) -> Array:
        column = column.reshape(-1)
        whole = jnp.zeros((size, size)).at[: spans * n, arm].set(column)
        return whole.at[arm, : spans * n].set(sign * column)

    lift, lift2 = lift_products(m, of)
    mass = blocks(weight[:, None, None] * of.value) + lifted(weight[:, None] * lift, 1.0)
    gyroscopic = blocks(2 * drag[:, None, None] * of.skew)
    gyroscopic = gyroscopic + lifted(2 * (drag * m.a)[:, None] * of.mean, -1.0)
    bend = (m.eps / m.lam) ** 2
    own = m.Q[:, None, None] * jnp.eye(n) + bend[:, None, None] * of.curvature
    stiffness = blocks(m.ka[:, None, None] * own) + d.T @ ((m.ka * m.gam)[:, None] * d)

    turning = jnp.concatenate([jnp.zeros(spans * n), m.J, (m.J_t + jnp.sum(weight * lift2))[None]])
    spring = m.k_s + jnp.sum(m.ka * m.Q * m.a**2)
    return Matrices(mass + jnp.diag(turning), gyroscopic, stiffness.at[arm, arm].add(spring))


def lift_products(model: VibrationModel, of: Products) -> tuple[Float[Array, "spans n"], Spans]:
    """<phi, psi> and <phi, phi> of each span, per radian of the arm."""
    m = model
    with_functions = m.w_start[:, None] * of.mean + m.a[:, None] * of.first
    return with_functions, m.w_start**2 + m.w_start * m.a + m.a**2 / 3


def elongations(model: VibrationModel, basis: AbstractBasis) -> Float[Array, "spans size"]:
    """Gradient d_i of each span's elongation with respect to all coordinates."""
    m = model
    spans, n = len(m.lam), basis.size
    each = jnp.arange(spans)
    starts, ends = jax.vmap(basis.layer_moments)(m.u, m.z)
    wavy = -(m.kap_s[:, None] * starts + m.kap_e[:, None] * ends)  # - int w*'' y
    fields = jnp.zeros((spans, spans, n)).at[each, each].set(wavy).reshape(spans, spans * n)
    arm = m.pull + m.a * m.drop
    return jnp.concatenate([fields, turning_strains(m), arm[:, None]], axis=1)


def turning_strains(model: VibrationModel) -> Float[Array, "spans pulleys"]:
    """Strain of each span per radian of each pulley: its two ends move with their rims."""
    m = model
    ends = jnp.roll(jnp.eye(len(m.r)), -1, axis=0) - jnp.eye(len(m.r))
    return m.tau * ends * m.r / m.lam[:, None]
