"""Dry friction of the bodies that carry pulleys, dimensionless.

    T      least friction that does not depend on the load
    q, q'  coordinates beyond the steady state, and their rates
    F      load on a body's bearing, of the tensions of the spans on its pulleys
    S      pull of a body's own spring, with what else is constant

docs/theory/motion.md, (O5) and (O7).
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

Bodies = Float[Array, " coordinates"]


class Loaded(eqx.Module):
    """How friction grows with what a body carries, and how it differs in the two directions."""

    hub: Bodies  # part of F
    spring: Bodies  # part of S
    unwinding: Bodies  # factor while the spring unwinds
    winding: Bodies  # direction in which it winds, +1 or -1
    pull: Bodies  # S in the steady state
    stiffness: Bodies  # of the body's own spring
    bearings: Float[Array, "coordinates 2 spans"]  # load by the spans' tensions
    tensions: Float[Array, " spans"]  # in the steady state, less what turns the belt round

    def size(self, q: Bodies, gains: Float[Array, " spans"]) -> Bodies:
        """What friction has beyond T, with the tensions that the spans gain."""
        load = self.bearings @ (self.tensions + gains)
        square = jnp.sum(load**2, axis=1)
        held = jnp.sqrt(jnp.where(square > 0, square, 1e-300))
        return self.hub * held + self.spring * jnp.abs(self.pull + self.stiffness * q)

    def sides(self) -> tuple[Bodies, Bodies]:
        """Factors of friction against motion that lowers and that raises a coordinate."""
        winds = self.winding > 0
        return jnp.where(winds, self.unwinding, 1.0), jnp.where(winds, 1.0, self.unwinding)


class Friction(eqx.Module):
    """The dry friction of all bodies."""

    constant: Bodies  # T
    speed: Bodies  # at which it turns round; 0: it holds a body that stands still
    loaded: Loaded | None  # None: T alone, both ways

    def present(self) -> Bool[Array, " coordinates"]:
        """Whether a body has friction."""
        found = self.constant > 0
        return found if self.loaded is None else found | (self.loaded.hub + self.loaded.spring > 0)

    def holds(self) -> Bool[Array, " coordinates"]:
        """Whether a body stands still under its friction."""
        return self.present() & (self.speed == 0)

    def bounds(self, q: Bodies, gains: Float[Array, " spans"]) -> tuple[Bodies, Bodies]:
        """Least and greatest force of friction."""
        if self.loaded is None:
            return -self.constant, self.constant
        size = self.constant + self.loaded.size(q, gains)
        down, up = self.loaded.sides()
        return -down * size, up * size

    def smooth(self, rate: Bodies, low: Bodies, high: Bodies) -> Bodies:
        """The force at these rates, between its bounds; 0 of a body that it holds (O5)."""
        smooth = self.speed > 0
        turned = jnp.tanh(rate / jnp.where(smooth, self.speed, 1.0))
        return jnp.where(smooth, jnp.where(rate > 0, high, -low) * turned, 0.0)
