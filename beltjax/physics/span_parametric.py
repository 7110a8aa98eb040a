"""Parametric resonance of one moving span, pinned at both ends, dimensionless.

    w_tt + 2 v w_xt + v_t w_x - [P(t) - v^2] w_xx + eps^2 w_xxxx = 0

with P = 1 + p cos(Om t), v(t) = v + dv cos(Om t); lengths over the span, tensions over the mean
one, times over the length by the speed of waves at rest. docs/theory/parametric.md, (P17), (P18).
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from beltjax.numerics.bases import AbstractBasis

Scalar = Float[Array, ""]
Square = Float[Array, "n n"]


class SpanMatrices(NamedTuple):
    """M w'' + G w' + K w = 0 of a span without fluctuation, in a basis of unit slopes."""

    mass: Square
    gyroscopic: Square
    stiffness: Square


def span_matrices(basis: AbstractBasis, v: Scalar, eps: Scalar) -> SpanMatrices:
    """The matrices of a span that moves at speed v."""
    of = basis.products()
    stiffness = (1 - v**2) * jnp.eye(basis.size) + eps**2 * of.curvature
    return SpanMatrices(jnp.asarray(of.value), v * (of.skew - of.skew.T), stiffness)


class SpanModulation(NamedTuple):
    """Amplitudes of K(t) and G(t) at the frequency of the fluctuation."""

    stiffness: Complex[Array, "n n"]
    gyroscopic: Complex[Array, "n n"]


def span_modulation(
    basis: AbstractBasis,
    v: Scalar,
    p: Scalar,
    dv: Scalar,
    frequency: Scalar,
    uniform: bool,
) -> SpanModulation:
    """K^ and G^ of (P18).

    A belt that gains speed has a tension which grows along it. With `uniform` that is left out, as
    in the printed models of fluctuating speed.
    """
    of = basis.products()
    carried = of.skew if uniform else of.skew + of.graded
    stiffness = (p - 2 * v * dv) * jnp.eye(basis.size) + 1j * frequency * dv * carried
    return SpanModulation(stiffness, dv * (of.skew - of.skew.T) + 0j)
