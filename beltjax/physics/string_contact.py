"""The string limit of contact, EI = 0: straight spans, wraps by geometry, one unknown.

It gives the same numbers as `physics.contact_search` and shares no span and no search with it, for
centers that do not move. The sources are G. Gerbert (1999) and L. Kong (2003), section 5.6.1; the
letters are those of `physics.contact`, with C = P.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from beltjax.numerics.roots import increasing_root
from beltjax.physics.contact import ContactModel

Scalar = Float[Array, ""]
Pulleys = Float[Array, " n"]


class StringDrive(NamedTuple):
    """Spans and pulleys of a string on locked centers, along the travel."""

    P: Pulleys  # of each span
    L: Pulleys  # lengths of the spans
    wrap: Pulleys
    slip: Pulleys
    pull: Pulleys  # M/R taken by each pulley
    L0: Scalar
    converged: Bool[Array, ""]


def critical_speed(tension: Scalar, EA: Scalar, m0: Scalar) -> Scalar:
    """Speed of the unstretched belt at which m0 c^2 (1 + T/EA) takes up all of T."""
    return jnp.sqrt(tension / (m0 * (1 + tension / EA)))


def string_drive(model: ContactModel, tension: Scalar, g: Pulleys, maximum: bool) -> StringDrive:
    """The running string whose tension at rest is `tension`; g = G V_ref.

    With `maximum`, which holds for two pulleys only, it is under the largest torque: the tensions
    are in the ratio e^{mu wrap} of the pulley that slips first, whatever their level.
    """
    L, wrap = _geometry(model)
    R, EA, g = jnp.abs(model.rho), model.EA[0], g[0]
    L0 = jnp.sum(L + wrap * R) / (1 + tension / EA)
    ratio = jnp.exp(jnp.min(model.mu * wrap))
    offsets = jnp.cumsum(model.pull)
    offsets = offsets - jnp.min(offsets)

    def spans(level: Scalar) -> Pulleys:
        return level * jnp.where(offsets > 0, ratio, 1.0) if maximum else level + offsets

    def excess(level: Scalar) -> Scalar:
        # The unstretched length decreases as the level of tension rises.
        P = spans(level)
        high, low = jnp.maximum(P, jnp.roll(P, 1)), jnp.minimum(P, jnp.roll(P, 1))
        slipping = jnp.log(high / low * (EA + low) / (EA + high)) / (model.mu * EA)
        adhering = (wrap - jnp.log(high / low) / model.mu) / (EA + jnp.roll(P, 1))
        length = (EA - g) * (jnp.sum(L / (EA + P)) + R @ (adhering + slipping))
        return 1 - length / L0

    least = 1e-9 * tension
    found = increasing_root(excess, least, tension, tol=1e-12)
    P = spans(found.root)
    slip = jnp.abs(jnp.log(P / jnp.roll(P, 1))) / model.mu
    return StringDrive(P, L, wrap, slip, P - jnp.roll(P, 1), L0, found.converged)


def _geometry(model: ContactModel) -> tuple[Pulleys, Pulleys]:
    """Lengths of the straight spans and wraps of the pulleys."""
    across, up = jnp.roll(model.x, -1) - model.x, jnp.roll(model.y, -1) - model.y
    d = jnp.hypot(across, up)
    rise = (model.rho - jnp.roll(model.rho, -1)) / d
    direction = jnp.arctan2(up, across) + jnp.arcsin(rise)
    wrap = jnp.mod(jnp.sign(model.rho) * (direction - jnp.roll(direction, 1)), 2 * jnp.pi)
    return d * jnp.sqrt(1 - rise**2), wrap
