"""How a drive runs: its speed, its torques and its excitation."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from beltjax.drive.components import TRAVELS, as_optional, as_real, as_travel
from beltjax.drive.loads import Load
from beltjax.drive.readable import Readable
from beltjax.drive.shafts import transmission
from beltjax.drive.system import Drive
from beltjax.files.fields import Number, number

DRIVERS = ("prescribed", "free")
# The two numbers of a knot of a profile.
KNOT = (Number("s", "a time"), Number("rad/s", "the driver's speed", at_least=0))


def as_driver(word: str) -> str:
    """How the driver moves; raises `ValueError` for a word that is not among `DRIVERS`."""
    if word not in DRIVERS:
        raise ValueError(f"driver: found {word!r}; give {' or '.join(map(repr, DRIVERS))}.")
    return word


class OrderGiven(Readable):
    """One of several orders of an excitation, amplitude cos(order psi + phase)."""

    # Its ratio to the other orders decides which harmonics are excited: it is not differentiated.
    order: float = eqx.field(
        static=True,
        converter=float,
        metadata=number("", "per rotation of the driver, a whole number or a half", above=0),
    )
    crank: Float[Array, ""] = eqx.field(
        converter=as_real,
        default=0.0,
        metadata=number("rad", "of the driver's rotation", at_least=0),
    )
    phase: Float[Array, ""] = eqx.field(
        converter=as_real, default=0.0, metadata=number("rad", "of crank and torques")
    )
    torque: dict[str, Float[Array, ""]] = eqx.field(
        converter=lambda torque: {name: as_real(value) for name, value in torque.items()},
        default_factory=dict,
        metadata=number("N m", "by pulley's name, in the direction of belt travel", at_least=0),
    )


class ExcitationGiven(Readable):
    """Excitation that the drive file gives: the default of `response`, `periodic` and `transient`.

    Amplitudes are zero to peak, at `order` times the driver's speed. In place of them, for
    `periodic` and `transient`, there may be several `orders`; a `profile` is for `transient`.
    """

    crank: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number("rad", "of the driver's rotation", at_least=0),
    )
    order: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number("", "per rotation of the driver", above=0),
    )
    torque: dict[str, Float[Array, ""]] = eqx.field(
        converter=lambda torque: {name: as_real(value) for name, value in torque.items()},
        default_factory=dict,
        metadata=number("N m", "by pulley's name, in the direction of belt travel", at_least=0),
    )
    orders: tuple[OrderGiven, ...] = eqx.field(converter=tuple, default=())
    # Knots of the driver's mean speed in a transient, [s] and [rad/s], as `KNOT` says.
    profile: Float[Array, "knots 2"] | None = eqx.field(converter=as_optional, default=None)
    # "prescribed": its rotation is given; "free": it turns by its torque.
    driver: str = eqx.field(static=True, converter=as_driver, default="prescribed")

    @property
    def excites(self) -> bool:
        """Whether there is more than a profile."""
        return self.crank is not None or bool(self.torque) or bool(self.orders)


class OperatingPoint(Readable):
    """How the drive runs: its speed, and the torque that each accessory takes from the belt.

    Give `belt_speed`, or `driver_speed` from which it follows. What `torque` and `load` give for
    one pulley adds up. `mass_flow` replaces the belt's mass per length in contact mechanics. The
    driver balances the torques; a torque or load given for the driver is ignored, so that batches
    may mix which pulley drives (a drive file refuses it). `excitation` concerns forced vibration
    alone. Raises `ValueError` unless exactly one of the two speeds is given.
    """

    words: ClassVar = {"travel": TRAVELS}

    belt_speed: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number(
            "m/s", "of the unstretched belt, of several that of the driver's", at_least=0
        ),
    )
    driver_speed: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number("rad/s", "which gives the belt's speed", at_least=0),
    )
    mass_flow: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number("kg/s", "for contact, in place of the mass per length", at_least=0),
    )
    torque: dict[str, Float[Array, ""]] = eqx.field(
        converter=lambda torque: {name: as_real(value) for name, value in torque.items()},
        default_factory=dict,
        metadata=number("N m", "taken from the belt, by pulley's name"),
    )
    # By pulley's name, what depends on speed: it follows the speed in sweeps and derivatives.
    load: dict[str, Load] = eqx.field(converter=dict, default_factory=dict)
    travel: Float[Array, ""] = eqx.field(converter=as_travel, default="listed")
    excitation: ExcitationGiven | None = None

    def __check_init__(self):
        if (self.belt_speed is None) == (self.driver_speed is None):
            raise ValueError("OperatingPoint: give either belt_speed or driver_speed.")

    def speed(self, drive: Drive) -> Float[Array, ""]:
        """Speed of the belt [m/s]; where there are several, of the belt of the driver."""
        if self.belt_speed is not None:
            return self.belt_speed
        assert self.driver_speed is not None  # as __check_init__ holds
        return self.driver_speed * (drive.drives @ drive.radii)

    def at_driver_speed(self, speed: Float[Array, ""]) -> "OperatingPoint":
        """The same point at that speed of the driver [rad/s] in place of its own."""
        return eqx.tree_at(
            lambda p: (p.belt_speed, p.driver_speed),
            self,
            (None, speed),
            is_leaf=lambda leaf: leaf is None,
        )

    @property
    def names_of_takers(self) -> tuple[str, ...]:
        """Names of the pulleys for which a torque or a load is given."""
        return tuple(dict.fromkeys([*self.torque, *self.load]))

    def torques(self, drive: Drive) -> Float[Array, " pulleys"]:
        """Torque [N m] that each pulley takes from its belt; the driver balances the others.

        Loads are those at this speed. Raises `KeyError` for a torque or a load on a pulley that the
        drive does not have.
        """
        return transmission(drive, self).torques
