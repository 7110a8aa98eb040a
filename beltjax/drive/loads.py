"""Loads: what an accessory takes from the belt at the speed at which its pulley turns."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from beltjax.drive.components import as_optional, concrete
from beltjax.drive.readable import Readable
from beltjax.files.fields import number
from beltjax.numerics.monotone_cubic import interpolated


def load_fault(
    power: Array | None, speed: Array | None, torque: Array | None, drag: Array | None
) -> tuple[str, str] | None:
    """The number of a load that does not go with the others, and why; None where all do."""
    if power is not None and torque is not None:
        return "power", "is given beside torque; give one of them"
    if speed is None:
        return _fault_without_table(power, torque, drag)
    field, values = ("torque", torque) if power is None else ("power", power)
    if values is None:
        return "speed", "is given without power or torque; give one of them for each speed"
    if not speed.ndim or speed.shape[-1] < 2:
        any_speed = "power alone, or operation.torque.NAME"
        return (
            "speed",
            f"a table has at least two speeds; give more, or, for any speed, {any_speed}",
        )
    if values.shape[-1:] != speed.shape[-1:]:
        found = values.shape[-1] if values.ndim else 1
        return field, f"found {found} for {speed.shape[-1]} speeds; give one for each"
    speeds, numbers = concrete(speed), concrete(values)
    if speeds is None:
        return None
    if not np.all(np.diff(speeds) > 0):
        return "speed", "must increase from each to the next; sort the table"
    still = np.asarray(speeds[..., 0] == 0)
    if field == "power" and numbers is not None and np.any(still & (numbers[..., 0] != 0)):
        return "power", "is not 0 at speed 0, where nothing turns; begin above, or with power 0"
    return None


def _fault_without_table(
    power: Array | None, torque: Array | None, drag: Array | None
) -> tuple[str, str] | None:
    """`load_fault` of a load without speeds."""
    if torque is not None:
        return "torque", "goes with a list speed; a torque for any speed is operation.torque.NAME"
    if power is not None and power.ndim:
        return "power", "is a list without speed; give a speed for each, or one power"
    if power is None and drag is None:
        return "power", "is missing; give it, a table over speed, or drag"
    return None


class Taken(NamedTuple):
    """What a load takes at one speed."""

    torque: Float[Array, ""]  # [N m]
    outside: Bool[Array, ""]  # the speed lies outside of the table, whose end's torque is held
    at_standstill: Bool[Array, ""]  # power is asked of a pulley that stands still


class Load(Readable):
    """What an accessory takes from the belt, as its power, or over the speed of its own pulley.

    Give `power` alone, or `speed` with as many `power` or `torque`; `drag` comes on top of either.
    Between the speeds of a table a monotone cubic (PCHIP) joins its numbers; outside of them the
    torque at the end of the table is held, and results carry the warning `load_outside_table`.
    Speeds are magnitudes: they count in whichever sense the pulley turns. A load that gives, such
    as a starter that cranks, is negative.

    Raises `ValueError` for numbers that do not go together: both power and torque, a torque
    without speeds, speeds that do not increase, as many as they are, or power at speed 0.
    """

    power: Float[Array, "*points"] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number(
            "W",
            "one number: the power that the accessory takes at whatever speed; or a list beside "
            "`speed`",
        ),
    )
    speed: Float[Array, " points"] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number(
            "rad/s",
            "a list of increasing speeds of this pulley (not of the driver), for a table of "
            "`power` or `torque`",
            at_least=0,
        ),
    )
    torque: Float[Array, " points"] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number("N m", "a list beside `speed`: the torque that the accessory takes there"),
    )
    drag: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number(
            "N m", "torque on top, at any speed: of bearings and seals, of an idler's, too"
        ),
    )

    def __check_init__(self):
        fault = load_fault(self.power, self.speed, self.torque, self.drag)
        if fault is not None:
            field, text = fault
            raise ValueError(f"Load.{field}: {text}.")

    def at(self, speed: Float[Array, ""]) -> Taken:
        """What the load takes at a speed of its pulley [rad/s], which is not negative."""
        torque, no = jnp.zeros(()), jnp.array(False)
        outside, at_standstill = no, no
        if self.speed is not None:
            least, greatest = self.speed[0], self.speed[-1]
            outside = (speed < least) | (speed > greatest)
            torque = self._of_table(self.speed, jnp.clip(speed, least, greatest))
        elif self.power is not None:
            turns = speed > 0
            torque = jnp.where(turns, self.power / jnp.where(turns, speed, 1.0), 0.0)
            at_standstill = ~turns & (self.power != 0)
        if self.drag is not None:
            torque = torque + self.drag
        return Taken(torque, outside, at_standstill)

    def slope(self, speed: Float[Array, ""]) -> Float[Array, ""]:
        """Derivative of the torque by the speed of the pulley [N m s/rad].

        Above 0 the load damps the rotation of its pulley; that of a constant power excites it.
        """
        return jax.jvp(lambda speed: self.at(speed).torque, (speed,), (jnp.ones(()),))[1]

    def _of_table(
        self, speeds: Float[Array, " points"], speed: Float[Array, ""]
    ) -> Float[Array, ""]:
        """Torque at a speed within the table."""
        if self.torque is not None:
            return interpolated(speed, speeds, self.torque)[0]
        assert self.power is not None  # as __check_init__ holds
        power, slope = interpolated(speed, speeds, self.power)
        turns = speed > 0
        # Power over speed tends to the slope of the power where both begin at 0.
        return jnp.where(turns, power / jnp.where(turns, speed, 1.0), slope)


def without_load(load: Load) -> Load:
    """A load of the same structure that takes nothing."""
    none = jax.tree.map(jnp.zeros_like, load)
    return none if load.speed is None else eqx.tree_at(lambda one: one.speed, none, load.speed)
