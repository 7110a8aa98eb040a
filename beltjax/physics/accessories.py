"""Torques of accessories that follow the fluctuation of their speeds, dimensionless.

The linear drive has the steady torques and, among its dampers, their slopes by speed: what is here
is the rest. docs/theory/motion.md, (O13).
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Scalar = Float[Array, ""]
State = Float[Array, " size"]


class Accessories(eqx.Module):
    """The accessories of a drive whose torques depend on their speeds."""

    torques: tuple[Callable[[Scalar], Scalar], ...]  # of the speed, which is not negative
    rows: Float[Array, "accessories size"]  # rotation of each by the coordinates
    speeds: Float[Array, " accessories"]  # in the steady state
    ratios: Float[Array, " accessories"]  # of speeds, to that of the driver

    def force(self, rate: State, gained: Scalar | float = 0.0) -> State:
        """Force on the coordinates beside that of steady torques and slopes (O13).

        `gained` is by how much the driver's mean speed is above that of the steady state.
        """
        carried = self.ratios * gained
        changes = self.rows @ rate
        beyond = []
        each = zip(self.torques, self.speeds, changes, carried, strict=True)
        for torque, speed, change, more in each:
            steady, slope = jax.jvp(torque, (speed,), (jnp.ones_like(speed),))
            # A pulley that stops takes the torque at standstill; it does not run backwards here.
            beyond.append(torque(jnp.maximum(speed + more + change, 0.0)) - steady - slope * change)
        return jnp.stack(beyond) @ self.rows
