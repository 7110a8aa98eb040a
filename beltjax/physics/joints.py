"""Joints between the rims and the hubs of pulleys that are not linear springs, dimensionless.

    x      wind-up of a joint beyond its steady one, rim less hub
    x0     steady wind-up
    k, c   its stiffness and damping while it is engaged

The linear drive has every joint engaged: what a joint does otherwise is a force beside it.
docs/theory/motion.md, (O8); decouplers and rigid clutches are those of `set_valued`.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

Scalar = Float[Array, ""]
State = Float[Array, " size"]

SPRING, SPRING_CLUTCH, DECOUPLER, RIGID_CLUTCH = 0.0, 1.0, 2.0, 3.0


class Joints(eqx.Module):
    """The joints of a drive."""

    rows: Float[Array, "joints size"]  # wind-up of each by the coordinates
    driving: Float[Array, " joints"]  # and by the driver's rotation
    steady: Float[Array, " joints"]  # x0
    stiffness: Float[Array, " joints"]
    damping: Float[Array, " joints"]
    law: Float[Array, " joints"]  # one of those above
    stops: Float[Array, "joints 2"]  # wind-ups beyond which it meets stiffer springs
    stop_stiffness: Float[Array, " joints"]  # of those

    @property
    def clutch(self) -> Bool[Array, " joints"]:
        """Whether it lets the hub overrun and remembers the angle."""
        return self.law == SPRING_CLUTCH

    @property
    def one_way(self) -> Bool[Array, " joints"]:
        """Whether its torque is that of an element of `set_valued`."""
        return self.law >= DECOUPLER

    def wind_ups(self, z: State, theta: Scalar | float = 0.0) -> Float[Array, " joints"]:
        """Wind-up of each joint; a spring clutch is open where it is negative."""
        return self.steady + self.rows @ z + self.driving * theta

    def stopped(self, wind_ups: Float[Array, " joints"]) -> Float[Array, " joints"]:
        """Torque of the stops on each hub, at these wind-ups."""
        least, greatest = self.stops.T
        past = jnp.where(wind_ups > greatest, wind_ups - greatest, 0.0)
        short = jnp.where(wind_ups < least, wind_ups - least, 0.0)
        return self.stop_stiffness * (past + short)

    def force(self, z: State, rate: State, theta: Scalar, turning: Scalar) -> State:
        """Force on the coordinates beside that of engaged joints (O8), (O12).

        That is without the torques of the joints that are `one_way`. `theta` is the driver's
        rotation, and `turning` its rate.
        """
        wind_ups = self.wind_ups(z, theta)
        engaged = self.stiffness * wind_ups
        damped = self.damping * (self.rows @ rate + self.driving * turning)
        # The torque of a clutch is max(engaged + damped, 0) where it is wound up, else 0.
        pulls = (engaged > 0) & (engaged + damped > 0)
        kept = ~self.one_way & (pulls | ~self.clutch)
        stopped = jnp.where(self.one_way, 0.0, self.stopped(wind_ups))
        return (stopped - jnp.where(kept, 0.0, engaged + damped)) @ self.rows
