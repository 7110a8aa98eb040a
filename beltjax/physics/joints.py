"""Joints between the rims and the hubs of pulleys that are not linear springs, dimensionless.

    x      wind-up of a joint beyond its steady one, rim less hub
    x0     steady wind-up
    k, c   its stiffness and damping while it is engaged

The linear drive has every joint engaged: what a joint does otherwise is a force beside it.
docs/theory/motion.md, (O7).
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

Scalar = Float[Array, ""]
State = Float[Array, " size"]


class Joints(eqx.Module):
    """The joints of a drive."""

    rows: Float[Array, "joints size"]  # wind-up of each by the coordinates
    driving: Float[Array, " joints"]  # and by the driver's rotation
    steady: Float[Array, " joints"]  # x0
    stiffness: Float[Array, " joints"]
    damping: Float[Array, " joints"]
    clutch: Float[Array, " joints"]  # 1: it lets the hub overrun; 0: a spring

    def wind_ups(self, z: State, theta: Scalar | float = 0.0) -> Float[Array, " joints"]:
        """Wind-up of each joint; a clutch is open where it is negative."""
        return self.steady + self.rows @ z + self.driving * theta

    def force(self, z: State, rate: State, theta: Scalar, turning: Scalar) -> State:
        """Force on the coordinates beside that of engaged joints (O7).

        `theta` is the driver's rotation, and `turning` its rate.
        """
        engaged = self.stiffness * self.wind_ups(z, theta)
        damped = self.damping * (self.rows @ rate + self.driving * turning)
        # The torque of a clutch is max(engaged + damped, 0) where it is wound up, else 0.
        pulls = (engaged > 0) & (engaged + damped > 0)
        lost = jnp.where(pulls, 0.0, engaged + damped) * self.clutch
        return -lost @ self.rows
