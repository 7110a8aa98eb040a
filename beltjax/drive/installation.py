"""Installation rules: a tension is given, or the belt, the springs' relaxed positions, or both."""

import equinox as eqx
from jaxtyping import Array, Float

from beltjax.drive.components import COORDINATE, TENSIONS_OF, as_flags, as_optional, as_real
from beltjax.drive.readable import Readable
from beltjax.files.fields import number

BELT_LENGTH = "length of a belt"  # a quantity of its own, which files give in another unit
_TENSION = number(
    "N",
    "the drawn layout is the torque-free state, and this its tension. Belt length and free "
    "positions of the springs follow; torques then move the tensioners",
    above=0,
    design=True,
)
_BELT_LENGTH = number(
    "m",
    "of the unstretched belt along its neutral axis. A maker's effective length is longer there: "
    "write it as `{ effective = x }`",
    above=0,
    design=True,
    quantity=BELT_LENGTH,
)
_FREE = number(COORDINATE, "where each spring is relaxed, by its name, from the drawn position")


class TensionGiven(Readable):
    """The drawn layout is the torque-free state and `tension` its tension at rest.

    It is the tension in the middle of the free spans. `steady_state` treats the belt at rest as a
    string, which is inaccurate for a belt that is stiff for its pulleys. `contact_state` finds the
    belt whose real tension this is, or with `tension_of="string"` the belt that would have this
    tension if it were a string, which is the belt of `steady_state`.

    Layout and tension fix the unstretched length of the belt and the free angle of the arm; torques
    then move the arm and change the tensions. `span_tensions`, for comparison with print, gives the
    tension of every span instead: the drawn layout is kept and torques are not used.
    """

    # P0; of several belts each
    tension: Float[Array, "*belts"] = eqx.field(converter=as_real, metadata=_TENSION)
    span_tensions: Float[Array, " spans"] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number(
            "N",
            "beside `tension`: a list, one tension for each span in listed order; the drawn layout "
            "is kept and torques are not used. For comparison with the literature",
        ),
    )
    tension_of: str = eqx.field(static=True, default="belt")
    # Relaxed position of each spring that the tension does not determine, NaN for the others: the
    # springs of the tensioners, then the arm springs. Only more springs than coordinates need it.
    free: Float[Array, " springs"] | None = eqx.field(
        converter=as_optional, default=None, metadata=_FREE
    )
    # True promises that springs or bolts hold every tensioner where it is drawn, so that no
    # position has to be found, and less is compiled. It is set where the numbers are known.
    as_drawn: bool = eqx.field(static=True, default=False)

    def __check_init__(self):
        if self.tension_of not in TENSIONS_OF:
            known = ", ".join(map(repr, TENSIONS_OF))
            raise ValueError(f"TensionGiven: tension_of {self.tension_of!r} is not one of {known}.")


class BeltGiven(Readable):
    """The belt and the springs' free positions are held; coordinates and tensions follow.

    For one arm give `free_angle`, else `free`: the coordinate at which each spring is relaxed,
    the tensioners' own first, then the difference of coordinates of each arm spring.
    """

    belt_length: Float[Array, "*belts"] = eqx.field(converter=as_real, metadata=_BELT_LENGTH)
    # As many turns from the drawn direction, which is in (-pi, pi], as the spring is wound.
    free_angle: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number(
            "rad",
            "direction of the arm, from pivot to pulley, with its spring relaxed; only with a "
            "single rotary tensioner. It is read as it stands, whole turns included",
            design=True,
        ),
    )
    free: Float[Array, " springs"] | None = eqx.field(
        converter=as_optional, default=None, metadata=_FREE
    )


class Preloaded(Readable):
    """The drawn layout is the torque-free state, and springs, weights and forces give its tension.

    `free` is the coordinate at which each spring is relaxed, NaN for one that follows: on each belt
    the bodies that no such spring holds balance it. Belt lengths follow.
    """

    free: Float[Array, " springs"] | None = eqx.field(
        converter=as_optional, default=None, metadata=_FREE
    )


class AdjustedToTension(Readable):
    """A locked tensioner is moved until the given belt has the given tension, and bolted.

    `adjusted` is 1 at the place of that tensioner. Sprung tensioners stand as drawn; the free
    positions of their springs follow as under `TensionGiven`.
    """

    belt_length: Float[Array, "*belts"] = eqx.field(converter=as_real, metadata=_BELT_LENGTH)
    tension: Float[Array, "*belts"] = eqx.field(converter=as_real, metadata=_TENSION)
    adjusted: Float[Array, " coordinates"] = eqx.field(converter=as_flags)
    free: Float[Array, " springs"] | None = eqx.field(
        converter=as_optional, default=None, metadata=_FREE
    )


class AdjustedToMark(Readable):
    """A locked tensioner is moved until a sprung one stands at its mark, and bolted.

    `adjusted` is 1 at the place of the first, `marked` at that of the second, whose coordinate
    `mark` is [rad] or [m]. The belt and the springs' free positions are given as in `BeltGiven`.
    """

    belt_length: Float[Array, "*belts"] = eqx.field(converter=as_real, metadata=_BELT_LENGTH)
    free: Float[Array, " springs"] = eqx.field(converter=as_flags, metadata=_FREE)
    adjusted: Float[Array, " coordinates"] = eqx.field(converter=as_flags)
    marked: Float[Array, " coordinates"] = eqx.field(converter=as_flags)
    mark: Float[Array, ""] = eqx.field(
        converter=as_real,
        default=0.0,
        metadata=number(COORDINATE, "where the marked tensioner stands, from the drawn position"),
    )


Installation = TensionGiven | BeltGiven | Preloaded | AdjustedToTension | AdjustedToMark
