"""Vibration of a whole drive about its steady state, dimensionless (chapter 4), for any bodies.

    w      deflection of a span over its length, positive inwards; * marks the steady state
    theta  rotation of each rotor in the direction of belt travel;  q  the bodies' coordinates
    e      strain a span gains: [u(l) - u(0)]/l + 1/2 int w_x^2
    lam, gam, s, eps   as in chapter 3;  mu  mass per length over that of the first belt
    phi    lift of a span by the bodies: (W0 + a x).q
    tau    +1 where the belt runs along x, -1 where against it (the source)

Energies are over P0 l, times over l sqrt(m/P0). A span's functions are y = w - phi, zero at both
ends, in a basis; its end moments are natural. docs/theory/vibration.md, and docs/theory/bodies.md,
(M12) to (M14).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int

from beltjax.numerics.bases import AbstractBasis, Products
from beltjax.numerics.gyroscopic import Forms

Scalar = Float[Array, ""]
Spans = Float[Array, " spans"]
Rotors = Float[Array, " rotors"]
Coordinates = Float[Array, " coordinates"]

# Stiffness of a coordinate that does not move, beside unit mass: far above every mode looked for.
BOLTED = 1e8


class VibrationModel(NamedTuple):
    """The numbers of one drive in one steady state."""

    eps: Spans  # of the spans' bending operator
    s: Spans
    tau: Spans
    gam: Spans
    mu: Spans
    lam: Spans
    Q: Spans  # effective tension P - m c^2 + T
    kap_s: Spans  # w*'' at the spans' ends
    kap_e: Spans
    u: Spans  # thickness of the end layers of w*, and its square's inverse (`span.layer_width`)
    z: Spans
    drop: Spans  # w*(1) - w*(0)
    a: Float[Array, "spans coordinates"]  # lift at x = 1 less that at 0, by the coordinates
    W0: Float[Array, "spans coordinates"]  # lift at x = 0
    pull: Float[Array, "spans coordinates"]  # strain by the coordinates, at the steady state
    H: Float[Array, "spans coordinates coordinates"]
    K: Float[Array, "coordinates coordinates"]  # springs of the bodies
    M: Float[Array, "coordinates coordinates"]  # their inertia
    movable: Coordinates  # 0 where locked or held by a stop
    turns: Float[Array, "spans rotors"]  # strain of each span per radian of each rotor
    K_r: Float[Array, "rotors rotors"]  # torsion springs
    M_r: Float[Array, "rotors rotors"]  # inertia, that of the belt's own motion included


class Motion(NamedTuple):
    """A motion of the drive, away from its steady state: fields at quadrature points, rotations."""

    w: Float[Array, "spans points"]
    w_x: Float[Array, "spans points"]
    w_xx: Float[Array, "spans points"]
    theta: Rotors
    q: Coordinates


class Matrices(NamedTuple):
    """M z'' + G z' + K z = 0 for z = (y of span 1, .., y of span n, theta .., q ..)."""

    mass: Float[Array, "size size"]
    gyroscopic: Float[Array, "size size"]
    stiffness: Float[Array, "size size"]


def geometric_stiffness(m: VibrationModel) -> Float[Array, "coordinates coordinates"]:
    """Stiffness by which the belt's tension holds the bodies, without the springs."""
    turned = m.lam[:, None, None] * m.a[:, :, None] * m.a[:, None, :]
    return jnp.sum(m.Q[:, None, None] * (turned + m.H), axis=0)


def of_moving(
    m: VibrationModel, matrix: Float[Array, "coordinates coordinates"], own: float
) -> Float[Array, "coordinates coordinates"]:
    """A matrix of the bodies that move; of one that does not it has `own` on its diagonal."""
    return m.movable[:, None] * m.movable * matrix + own * jnp.diag(1.0 - m.movable)


def energy(
    moved: Motion,
    rate: Motion,
    slopes: Float[Array, "spans points"],
    weights: Float[Array, "spans points"],
    model: VibrationModel,
) -> Scalar:
    """Lagrangian T0 + T1 - (V - T2) of the drive, without terms of first order.

    docs/theory/vibration.md, (V3). `slopes` is w*_x at the points of the quadrature rule with
    these `weights`. Its second derivatives with respect to a motion and its rate are K, G and M.
    Terms that are linear in the motion vanish at a steady state and are left out: the end moments
    and the torques.
    """
    m = model

    def over_span(f: Float[Array, "spans points"]) -> Spans:
        return jnp.sum(weights * f, axis=-1)

    strain = m.turns @ moved.theta + m.pull @ moved.q
    curved = jnp.einsum("a,iab,b->i", moved.q, m.H, moved.q) / m.lam
    second = (over_span(moved.w_x**2) + curved) / 2
    strain = strain + over_span(slopes * moved.w_x) + second
    # gamma e* + P - m c^2 = Q: the tension that works on what is of second order in the strain.
    stretch = m.gam * strain**2 / 2 + m.Q * second
    bend = (m.eps / m.lam) ** 2 * over_span(moved.w_xx**2) / 2
    springs = moved.q @ m.K @ moved.q + moved.theta @ m.K_r @ moved.theta
    potential = jnp.sum(m.lam * (stretch + bend)) + springs / 2
    coriolis = jnp.sum(m.tau * m.s * m.mu * m.lam**2 * over_span(rate.w * moved.w_x))
    kinetic = jnp.sum(m.mu * m.lam**3 * over_span(rate.w**2))
    kinetic = kinetic + rate.q @ m.M @ rate.q + rate.theta @ m.M_r @ rate.theta
    return kinetic / 2 + coriolis - potential


def assembled(
    model: VibrationModel,
    basis: AbstractBasis,
    d: Float[Array, "spans size"],
    kept: Int[Array, " kept"],
) -> Matrices:
    """M, G and K from each span's own matrices, its lift by the bodies, and its stretch.

    Rotations are those of the rotors `kept`, then come the coordinates. All that couples the
    belt to the rotors is one rank-one term per span: lam gamma d d^T, with d the gradient of the
    span's elongation (`elongations`).
    """
    m, of = model, basis.products()
    weight = m.mu * m.lam**3
    lift, lift2 = lift_products(m, of)
    lift = lift * m.movable
    none = jnp.zeros_like(lift)
    inertia = of_moving(m, m.M + jnp.sum(weight[:, None, None] * lift2, axis=0), 1.0)
    mass = _joined(
        weight[:, None, None] * of.value,
        weight[:, None, None] * lift,
        inertia,
        m.M_r[kept][:, kept],
    )
    drag = convection(m, basis, kept, m.s)
    own = m.Q[:, None, None] * jnp.eye(basis.size)
    own = own + ((m.eps / m.lam) ** 2)[:, None, None] * of.curvature
    spring = of_moving(m, m.K + geometric_stiffness(m), BOLTED)
    stiffness = _joined(m.lam[:, None, None] * own, none, spring, m.K_r[kept][:, kept])
    return Matrices(mass, drag - drag.T, stiffness + d.T @ ((m.lam * m.gam)[:, None] * d))


def _joined(
    local: Float[Array, "spans n n"],
    lifting: Float[Array, "spans n coordinates"],
    of_bodies: Float[Array, "coordinates coordinates"],
    of_rotors: Float[Array, "kept kept"],
    below: Float[Array, "spans n coordinates"] | None = None,
) -> Float[Array, "size size"]:
    """Matrix with the spans, rotors and bodies on its diagonal and `lifting` beside the spans.

    Below the diagonal stands the transposed of `lifting`, or of what is given for that.
    """
    # The blocks are masked and joined, not scattered into place: the reverse derivative of a
    # frequency would gather every entry one by one.
    spans, n, _ = local.shape
    count, kept_of = len(of_bodies), len(of_rotors)
    belt = (jnp.eye(spans)[:, None, :, None] * local[:, :, None, :]).reshape(spans * n, -1)

    def beside(part: Float[Array, "spans n coordinates"]) -> Float[Array, "fields rest"]:
        part = part.reshape(spans * n, count)
        return jnp.concatenate([jnp.zeros((spans * n, kept_of)), part], axis=1)

    apart = jnp.zeros((kept_of, count))
    rigid = jnp.block([[of_rotors, apart], [apart.T, of_bodies]])
    above = beside(lifting)
    under = above if below is None else beside(below)
    return jnp.block([[belt, above], [under.T, rigid]])


def convection(
    model: VibrationModel, basis: AbstractBasis, kept: Int[Array, " kept"], speeds: Spans
) -> Float[Array, "size size"]:
    """A with entries s tau mu lam^2 <phi_a, phi_b'>: what belts of these speeds carry along.

    The gyroscopic matrix is A less its transposed.
    """
    m, of = model, basis.products()
    drag = m.tau * speeds * m.mu * m.lam**2
    by_lift = drag[:, None, None] * of.mean[:, None] * (m.a * m.movable)[:, None, :]
    mixed = m.W0[:, :, None] * m.a[:, None, :] + m.a[:, :, None] * m.a[:, None, :] / 2
    lifts = m.movable[:, None] * m.movable * jnp.sum(drag[:, None, None] * mixed, axis=0)
    still = jnp.zeros((len(kept), len(kept)))
    return _joined(drag[:, None, None] * of.skew, by_lift, lifts, still, below=-by_lift)


class Acceleration(NamedTuple):
    """Force of accelerating belts on their coordinates, matrix z + steady, for s' = 1."""

    matrix: Float[Array, "size size"]
    steady: Float[Array, " size"]


def acceleration(
    model: VibrationModel,
    basis: AbstractBasis,
    d: Float[Array, "spans size"],
    kept: Int[Array, " kept"],
    rates: Spans,
) -> Acceleration:
    """What spans do whose belts gain speed at these rates; docs/theory/motion.md, (O16).

    The tension grows along an accelerating span, by which its slope is turned as much as by
    the transport of momentum; of both the functions feel what is left.
    """
    m, of = model, basis.products()
    spans, n = len(m.lam), basis.size
    drag = m.tau * rates * m.mu * m.lam**2
    local = drag[:, None, None] * (of.skew + of.graded)
    # <phi, phi'> and <(x - 1/2) phi', phi'> cancel where a function meets the lift, and add up
    # where the lift meets a function.
    by_lift = (m.a * m.movable)[:, None, :] * of.mean[:, None]
    by_lift = -2 * drag[:, None, None] * by_lift
    starts = drag[:, None] * (m.W0 + m.a / 2) * m.movable  # by the slope of the chord
    turned = m.a * m.movable
    matrix = _joined(
        local, jnp.zeros_like(by_lift), starts.T @ turned, jnp.zeros((len(kept),) * 2), by_lift
    )
    # The functions' part of w* is that of its elongations: -int w*'' psi is int w*' psi'.
    own = d[:, : spans * n].reshape(spans, spans, n)
    curved = jnp.einsum("iin->in", own)
    fields = jnp.einsum("iab,ib->ia", local, curved)
    bodies = starts.T @ m.drop + jnp.einsum("ina,in->a", by_lift, curved)
    steady = jnp.concatenate([fields.ravel(), jnp.zeros(len(kept)), bodies])
    return Acceleration(matrix, steady)


def forms_of_spans(
    model: VibrationModel,
    basis: AbstractBasis,
    d: Float[Array, "spans size"],
    kept: Int[Array, " kept"],
    left: Complex[Array, "count size"],
    right: Complex[Array, "count size"],
) -> Forms:
    """Forms of M, G and K of `assembled`, summed span by span without making the matrices.

    The reverse derivative makes no matrix either. The slopes of frequencies need these forms,
    which depend on a few numbers of each span.
    """
    m, of = model, basis.products()
    spans, n = len(m.lam), basis.size

    def parts(
        z: Complex[Array, "count size"],
    ) -> tuple[
        Complex[Array, "count spans n"],
        Complex[Array, "count kept"],
        Complex[Array, "count coordinates"],
    ]:
        field, rest = z[:, : spans * n].reshape(-1, spans, n), z[:, spans * n :]
        return field, rest[:, : len(kept)], rest[:, len(kept) :] * m.movable

    (y, y_turn, y_arm), (v, v_turn, v_arm) = parts(jnp.conj(left)), parts(right)
    # The bodies act on each span by the lift at its start and by a slope.
    y_start, v_start = y_arm @ m.W0.T, v_arm @ m.W0.T
    y_slope, v_slope = y_arm @ m.a.T, v_arm @ m.a.T

    def within(products: Float[np.ndarray, "n n"]) -> Complex[Array, "count spans"]:
        """Form of two fields in the same span."""
        return jnp.sum(y * (v @ products.T), axis=-1)

    def between(
        matrix: Float[Array, "m m"],
        first: Complex[Array, "count m"],
        second: Complex[Array, "count m"],
    ) -> Complex[Array, " count"]:
        """Form of rotations, or of coordinates."""
        return jnp.sum((first @ matrix) * second, axis=-1)

    y_mean, y_first, v_mean, v_first = y @ of.mean, y @ of.first, v @ of.mean, v @ of.first
    lifted = y_mean * v_start + y_first * v_slope + v_mean * y_start + v_first * y_slope
    squares = y_start * v_start + (y_start * v_slope + y_slope * v_start) / 2
    squares = squares + y_slope * v_slope / 3
    mass = (within(of.value) + lifted + squares) @ (m.mu * m.lam**3)
    mass = mass + between(m.M_r[kept][:, kept], y_turn, v_turn) + between(m.M, y_arm, v_arm)
    dragged = 2 * (within(of.skew) + y_mean * v_slope - v_mean * y_slope)
    dragged = dragged + y_start * v_slope - y_slope * v_start
    bent = (m.eps / m.lam) ** 2 * within(of.curvature)
    held = m.Q * (jnp.sum(y * v, axis=-1) + y_slope * v_slope)
    stretched = m.gam * (jnp.conj(left) @ d.T) * (right @ d.T)
    springs = m.K + jnp.sum(m.Q[:, None, None] * m.H, axis=0)
    stiffness = (held + bent + stretched) @ m.lam + between(springs, y_arm, v_arm)
    return Forms(
        mass=mass,
        damping=dragged @ (m.tau * m.s * m.mu * m.lam**2),
        stiffness=stiffness + between(m.K_r[kept][:, kept], y_turn, v_turn),
    )


def lift_products(
    model: VibrationModel, of: Products
) -> tuple[Float[Array, "spans n coordinates"], Float[Array, "spans coordinates coordinates"]]:
    """<phi, psi> and <phi, phi> of each span, by the coordinates."""
    m = model
    with_functions = m.W0[:, None, :] * of.mean[:, None] + m.a[:, None, :] * of.first[:, None]
    mixed = m.W0[:, :, None] * m.a[:, None, :]
    squares = m.W0[:, :, None] * m.W0[:, None, :] + (mixed + jnp.swapaxes(mixed, 1, 2)) / 2
    return with_functions, squares + m.a[:, :, None] * m.a[:, None, :] / 3


def elongations(
    model: VibrationModel, basis: AbstractBasis, kept: Int[Array, " kept"]
) -> Float[Array, "spans size"]:
    """Gradient d_i of each span's elongation, in the coordinates of `assembled`."""
    m = model
    spans, n = len(m.lam), basis.size
    starts, ends = jax.vmap(basis.layer_moments)(m.u, m.z)
    wavy = -(m.kap_s[:, None] * starts + m.kap_e[:, None] * ends)  # - int w*'' y
    fields = (jnp.eye(spans)[:, :, None] * wavy).reshape(spans, spans * n)
    by_bodies = (m.pull + m.a * m.drop[:, None]) * m.movable
    return jnp.concatenate([fields, m.turns[:, kept], by_bodies], axis=1)
