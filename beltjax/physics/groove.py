"""A belt in a wedge-shaped groove: wedge law, friction on the flanks, and the arc of contact.

In any consistent units, for one pulley; the arc is described over the angle phi about its axis,
from where the belt comes in:

    R      radius at which the belt's flanks just touch the groove's;   xi  penetration over R
    chi    angle of the belt to the circle, positive outward along the travel
    beta   half the angle of the groove;   mu   friction of the flanks
    K      side force per penetration and unstretched length
    P      T - G V;   g   G V_ref;   stretch   V/V_ref = 1 + T/EA = (EA + P)/(EA - g)
    om     speed of the pulley's circle R over V_ref
    eps    sliding speed over V_ref below which friction is viscous
    v_t, v_g   sliding of the belt over the flank along the circle and along the flank, over V_ref
    w      its size;   h, along = v_t/w, v_g/w
    span   angle over which the belt touches, turn + chi_out - chi_in

docs/theory/grooves.md, (W1) to (W9).
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

Scalar = Float[Array, ""]


class Flanks(NamedTuple):
    """A belt in the groove of one pulley."""

    R: Scalar
    beta: Scalar
    mu: Scalar
    K: Scalar
    EA: Scalar
    eps: Scalar


class Sliding(NamedTuple):
    """Forces and sliding of the belt at a point; forces are per current length."""

    stretch: Scalar
    v_t: Scalar
    v_g: Scalar
    w: Scalar  # at least eps
    N: Scalar  # radial force on the belt, outward
    f: Scalar  # force on the belt along the circle, in the direction of travel
    loss: Scalar  # power per length, over V_ref


def sliding(xi: Scalar, chi: Scalar, P: Scalar, om: Scalar, g: Scalar, of: Flanks) -> Sliding:
    """Wedge law and friction (W2) to (W5)."""
    stretch = (of.EA + P) / (of.EA - g)
    v_t = stretch * jnp.cos(chi) - om * (1 - xi)
    v_g = stretch * jnp.sin(chi) / jnp.cos(of.beta)
    w = jnp.sqrt(v_t**2 + v_g**2 + of.eps**2)
    along, h = v_g / w, v_t / w
    sin, cos = jnp.sin(of.beta), jnp.cos(of.beta)
    p = of.K * of.R * xi / stretch / (cos + of.mu * along * sin)
    rubbing = 2 * of.mu * p
    return Sliding(
        stretch=stretch,
        v_t=v_t,
        v_g=v_g,
        w=w,
        N=2 * p * sin - rubbing * along * cos,
        f=-rubbing * h,
        loss=rubbing * (v_t * h + v_g * along),
    )


def slopes(
    xi: Scalar, chi: Scalar, P: Scalar, om: Scalar, g: Scalar, of: Flanks
) -> tuple[Scalar, Scalar, Scalar]:
    """Derivatives of xi, chi and P by phi (W6)."""
    at = sliding(xi, chi, P, om, g, of)
    cos, sin = jnp.cos(chi), jnp.sin(chi)
    length = of.R * (1 - xi) / cos  # per angle
    curvature = (at.N * cos - at.f * sin) / P
    return (
        -(1 - xi) * sin / cos,
        1 - curvature * length,
        -(at.N * sin + at.f * cos) * length,
    )
