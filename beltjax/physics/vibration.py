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
from jaxtyping import Array, Complex, Float, Int

from beltjax.numerics.bases import AbstractBasis, Products
from beltjax.numerics.gyroscopic import Forms

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
    pull: Spans  # strain of each span per radian of the arm, on the path of the contact points
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
    """M z'' + G z' + K z = 0 for z = (y of span 1, .., y of span n, theta .., thetat)."""

    mass: Float[Array, "size size"]
    gyroscopic: Float[Array, "size size"]
    stiffness: Float[Array, "size size"]


def energy(
    moved: Motion, rate: Motion, slopes: Float[Array, "spans points"], weights, model
) -> Scalar:
    """Lagrangian T0 + T1 - (V - T2) of the drive, up to terms of first order.

    docs/theory/vibration.md, (V3). `slopes` is w*_x at the points of the quadrature rule with
    these `weights` [spans points]. Its second derivatives with respect to a motion and its rate
    are K, G and M. What is linear in the motion vanishes at a steady state and is left out: the
    end moments and the torques.
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
    model: VibrationModel,
    basis: AbstractBasis,
    d: Float[Array, "spans size"],
    kept: Int[Array, " kept"],
    arm: bool,
) -> Matrices:
    """M, G and K from each span's own matrices, its lift by the arm, and its stretch.

    Rotations are those of the pulleys `kept`, then that of the arm if there is one. All that
    couples the belt to the pulleys is one rank-one term a span: ka gamma d d^T, with d the
    gradient of the span's elongation (`elongations`).
    """
    m, of = model, basis.products()
    weight = m.lam**2 * m.ka
    drag = m.tau * m.s * m.lam * m.ka

    def whole(local, lifting, of_arm, of_pulleys, sign=1.0) -> Float[Array, "size size"]:
        """Spans' matrices and rotations on the diagonal, the arm's column beside the spans."""
        # Masked and joined, not scattered into place: in reverse, a frequency's slopes would
        # gather every entry one by one.
        spans, n, _ = local.shape
        belt = (jnp.eye(spans)[:, None, :, None] * local[:, :, None, :]).reshape(spans * n, -1)
        rigid = jnp.append(of_pulleys, of_arm) if arm else of_pulleys
        beside = jnp.zeros((spans * n, len(kept)))
        if arm:
            beside = jnp.concatenate([beside, lifting.reshape(-1, 1)], axis=1)
        return jnp.block([[belt, beside], [sign * beside.T, jnp.diag(rigid)]])

    lift, lift2 = lift_products(m, of)
    still = jnp.zeros(len(kept))
    inertia = m.J_t + jnp.sum(weight * lift2)
    mass = whole(weight[:, None, None] * of.value, weight[:, None] * lift, inertia, m.J[kept])
    dragged = 2 * (drag * m.a)[:, None] * of.mean
    gyroscopic = whole(2 * drag[:, None, None] * of.skew, dragged, 0.0, still, sign=-1.0)
    own = m.Q[:, None, None] * jnp.eye(basis.size)
    own = own + ((m.eps / m.lam) ** 2)[:, None, None] * of.curvature
    spring = m.k_s + jnp.sum(m.ka * m.Q * m.a**2)
    stiffness = whole(m.ka[:, None, None] * own, jnp.zeros_like(lift), spring, still)
    return Matrices(mass, gyroscopic, stiffness + d.T @ ((m.ka * m.gam)[:, None] * d))


def forms_of_spans(
    model: VibrationModel,
    basis: AbstractBasis,
    d: Float[Array, "spans size"],
    kept: Int[Array, " kept"],
    left: Complex[Array, "count size"],
    right: Complex[Array, "count size"],
) -> Forms:
    """Forms of M, G and K as `assembled`, span by span: no matrix is made, in reverse neither.

    What slopes of frequencies need: they depend on a few numbers of each span.
    """
    m, of = model, basis.products()
    spans, n = len(m.lam), basis.size

    def parts(z):
        field, turning = z[:, : spans * n].reshape(-1, spans, n), z[:, spans * n :]
        return field, turning[:, : len(kept)], jnp.sum(turning[:, len(kept) :], axis=1)

    (y, y_turn, y_arm), (v, v_turn, v_arm) = parts(jnp.conj(left)), parts(right)
    of_arm = y_arm * v_arm

    def within(products) -> Complex[Array, "count spans"]:
        """Of two fields in the same span."""
        return jnp.sum(y * (v @ products.T), axis=-1)

    lift, lift2 = lift_products(m, of)
    weight, drag = m.lam**2 * m.ka, 2 * m.tau * m.s * m.lam * m.ka
    lifted = (
        jnp.sum(lift * y, axis=-1) * v_arm[:, None] + jnp.sum(lift * v, axis=-1) * y_arm[:, None]
    )
    mass = (within(of.value) + lifted + lift2 * of_arm[:, None]) @ weight
    mass = mass + (y_turn * v_turn) @ m.J[kept] + m.J_t * of_arm
    dragged = (y @ of.mean) * v_arm[:, None] - (v @ of.mean) * y_arm[:, None]
    bent = (m.eps / m.lam) ** 2 * within(of.curvature)
    held = m.Q * (jnp.sum(y * v, axis=-1) + m.a**2 * of_arm[:, None])
    stretched = m.gam * (jnp.conj(left) @ d.T) * (right @ d.T)
    return Forms(
        mass=mass,
        damping=(within(of.skew) + m.a * dragged) @ drag,
        stiffness=(held + bent + stretched) @ m.ka + m.k_s * of_arm,
    )


def lift_products(model: VibrationModel, of: Products) -> tuple[Float[Array, "spans n"], Spans]:
    """<phi, psi> and <phi, phi> of each span, per radian of the arm."""
    m = model
    with_functions = m.w_start[:, None] * of.mean + m.a[:, None] * of.first
    return with_functions, m.w_start**2 + m.w_start * m.a + m.a**2 / 3


def elongations(
    model: VibrationModel, basis: AbstractBasis, kept: Int[Array, " kept"], arm: bool
) -> Float[Array, "spans size"]:
    """Gradient d_i of each span's elongation, in the coordinates of `assembled`."""
    m = model
    spans, n = len(m.lam), basis.size
    starts, ends = jax.vmap(basis.layer_moments)(m.u, m.z)
    wavy = -(m.kap_s[:, None] * starts + m.kap_e[:, None] * ends)  # - int w*'' y
    fields = (jnp.eye(spans)[:, :, None] * wavy).reshape(spans, spans * n)
    parts = [fields, turning_strains(m)[:, kept]]
    if arm:
        parts.append((m.pull + m.a * m.drop)[:, None])
    return jnp.concatenate(parts, axis=1)


def turning_strains(model: VibrationModel) -> Float[Array, "spans pulleys"]:
    """Strain of each span per radian of each pulley: its two ends move with their rims."""
    m = model
    ends = jnp.roll(jnp.eye(len(m.r)), -1, axis=0) - jnp.eye(len(m.r))
    return m.tau * ends * m.r / m.lam[:, None]
