"""Disturbances of a periodic motion of a drive, dimensionless, in the letters of `motion`.

    p      tension that the motion adds to a span, over P0
    N      form of a span's slopes: the strain beyond first order in z is z.N z/2
    q      N z of the motion: by how much the gradient d of the span's elongation has turned

docs/theory/parametric.md, (P1) to (P4).
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from beltjax.numerics.harmonic_balance import series
from beltjax.numerics.parametric import ModalBasis, modal_transfer
from beltjax.physics.motion import MotionModel

Scalar = Float[Array, ""]
Amplitudes = Complex[Array, " size"]
Whole = Complex[Array, "size size"]


def slope_forms(model: MotionModel, weights: Array) -> Array:
    """Sum of the forms N of the spans, with these weights: [size, size]."""
    spans, fewer = len(model.work), model.functions
    bodies = jnp.einsum("i,iab->ab", weights, model.bodies)
    size = len(model.mass)
    rest = jnp.zeros((size - spans * fewer,) * 2, bodies.dtype)
    count = len(bodies)
    if count:
        rest = rest.at[len(rest) - count :, len(rest) - count :].set(bodies)
    own = jnp.repeat(weights, fewer)
    return jnp.block(
        [
            [jnp.diag(own), jnp.zeros((spans * fewer, len(rest)))],
            [jnp.zeros((len(rest), spans * fewer)), rest],
        ]
    )


def turned_gradients(model: MotionModel, z: Array) -> Array:
    """The turning q of each span's gradient for a motion z: [spans, size]."""
    fields, q = model.parts(z)
    spans, fewer = fields.shape
    own = (jnp.eye(spans)[:, :, None] * fields[:, None, :]).reshape(spans, -1)
    bodies = model.bodies @ q
    between = jnp.zeros((spans, len(z) - spans * fewer - bodies.shape[1]), z.dtype)
    return jnp.concatenate([own.astype(z.dtype), between, bodies], axis=1)


class PrimaryAmplitudes(NamedTuple):
    """The linear response of a drive at one frequency."""

    z: Amplitudes
    tensions: Complex[Array, " spans"]  # p


def modulated_stiffness(
    model: MotionModel, primary: PrimaryAmplitudes, tension: bool, shape: bool
) -> Whole:
    """K^ of (P4): by the tension that the motion adds, and by the turning of spans."""
    m = model
    found = jnp.zeros(m.mass.shape, complex)
    if tension:
        found = found + slope_forms(m, m.work / m.gains * primary.tensions)
    if shape:
        turned = m.elongations.T @ (m.work[:, None] * turned_gradients(m, primary.z))
        found = found + turned + turned.T
    return found


class ModalDisturbance(NamedTuple):
    """A disturbance in the amplitudes of modes, xi = (Re a, Im a): xi' = A(t) xi."""

    still: Float[Array, "states states"]  # A without a motion
    onto: Float[Array, "states size"]  # of forces
    of: Float[Array, "size states"]  # coordinates
    rates: Float[Array, "size states"]
    slopes: Float[Array, "spans states states"]  # of N, by each span's tension
    gradients: Float[Array, "spans states"]  # d, as an elongation ..
    pulls: Float[Array, "states spans"]  # .. and as a force


def modal_disturbance(
    model: MotionModel, basis: ModalBasis, C: Float[Array, "size size"]
) -> ModalDisturbance:
    """The disturbance's equations by the lowest modes (P13); C is dissipative alone."""
    turn, onto, of, rates = modal_transfer(basis)
    still = turn + onto @ C @ rates
    m, spans = model, len(model.work)
    fields, fewer = spans * m.functions, m.functions
    count = m.bodies.shape[1]
    left, right = onto[:, :fields], of[:fields]
    slopes = jnp.einsum(
        "anf,nfb->nab", left.reshape(-1, spans, fewer), right.reshape(spans, fewer, -1)
    )
    last = onto[:, onto.shape[1] - count :], of[len(of) - count :]
    slopes = slopes + jnp.einsum("ac,ncd,db->nab", last[0], m.bodies, last[1])
    return ModalDisturbance(
        still=still,
        onto=onto,
        of=of,
        rates=rates,
        slopes=slopes * (m.work / m.gains)[:, None, None],
        gradients=m.elongations @ of,
        pulls=onto @ m.elongations.T,
    )


def disturbance_of_response(
    model: MotionModel,
    modal: ModalDisturbance,
    motion: Float[Array, "terms size"],
    driver: Float[Array, " terms"],
    phase: Scalar,
) -> Float[Array, "states states"]:
    """A at a phase of a linear response, by its Fourier coefficients (P2).

    The stretch term stays of rank one. Without its last part, of second order in the motion, it is
    an indefinite stiffness that alone makes a drive unstable.
    """
    m, of = model, series(phase, len(motion) // 2)
    z = of @ motion
    strains = m.elongations @ z + m.driving * (of @ driver)
    turned = turned_gradients(m, z)
    elongating, pulling = turned @ modal.of, modal.onto @ turned.T
    stretched = (modal.pulls + pulling) * m.work @ (modal.gradients + elongating)
    stretched = stretched - (modal.pulls * m.work) @ modal.gradients
    added = jnp.einsum("i,iab->ab", m.gains * strains, modal.slopes)
    return modal.still + added + stretched
