"""Friction that depends on the sliding speed, in any consistent units.

    mu     coefficient of friction while sliding; mu_s at rest
    v      sliding speed, >= 0
    w      wrap of a belt on a pulley; 0 for a block on a belt
    g      grip: friction force over the contact's load

docs/theory/friction_vibration.md, (F1) to (F3) and (F13).
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

Scalar = Float[Array, ""]

# Sliding speed against the belt over which a law is continued, before it stays: a path that only
# touches rest may pass it by rounding, and a search for one by a little.
_BEYOND_REST = 1e-2


class FrictionCurve(NamedTuple):
    """mu = level + drop e^{-v/speed} + linear v + cubic v^3, and `static` at rest.

    All laws are of this form, so that one program serves them all.
    """

    static: Scalar
    level: Scalar
    drop: Scalar
    speed: Scalar
    linear: Scalar
    cubic: Scalar

    def coefficient(self, v: Array) -> Array:
        """Mu at a sliding speed; continued a little beyond rest, and then constant."""
        slid = jnp.maximum(v, 0.0)
        mu = self.level + self.drop * jnp.exp(-slid / self.speed)
        mu = mu + (self.linear + self.cubic * slid**2) * slid
        return mu + self.steepness * _BEYOND_REST * jnp.tanh(jnp.minimum(v, 0.0) / _BEYOND_REST)

    @property
    def steepness(self) -> Scalar:
        """Slope of mu where sliding begins."""
        return self.linear - self.drop / self.speed

    @property
    def jump(self) -> Scalar:
        """By how much friction at rest exceeds that where sliding begins."""
        return self.static - self.level - self.drop

    def per(self, unit: Scalar) -> "FrictionCurve":
        """The same law over speeds that are counted in `unit`."""
        return self._replace(
            speed=self.speed / unit, linear=self.linear * unit, cubic=self.cubic * unit**3
        )


def grip(mu: Array, wrap: Scalar) -> Array:
    """g(mu): mu itself for a block, (2/w) tanh(mu w/2) for a belt on an arc."""
    on_arc = wrap > 0
    w = jnp.where(on_arc, wrap, 1.0)
    return jnp.where(on_arc, 2 / w * jnp.tanh(mu * w / 2), mu)
