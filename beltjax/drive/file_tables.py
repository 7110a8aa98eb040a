"""The tables of a drive file: their keys, whose numbers are those of the drive's parts.

What each key means stands beside it; `file_reference` makes the documentation from that.
"""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag
from pydantic_core import PydanticCustomError

from beltjax.drive.components import ArmSpring, Belt, Damper, Isolator, Pulley, Tensioner
from beltjax.drive.installation import BeltGiven, TensionGiven
from beltjax.drive.loads import Load
from beltjax.drive.operation import KNOT, ExcitationGiven, OperatingPoint, OrderGiven
from beltjax.drive.system import Drive
from beltjax.files.tables import (
    Table,
    checked,
    meaning,
    meaning_of,
    numbers_of,
    valid,
    valid_one_or_more,
)
from beltjax.files.units import shown, to_si

Two = Field(min_length=2, max_length=2)


@numbers_of(Belt)
class BeltTable(Table):
    """[belt] or [[belt]]."""

    translated = ("pitch_offset", "back_offset", "cushion", "groove")
    name: Annotated[str, meaning("of its own, where there are several")] = "belt"
    pitch: Annotated[
        Annotated[float, Field(gt=0)] | None,
        meaning(
            "optional: from tooth to tooth of a toothed belt. It does not slip, so that its "
            "pulleys have no friction",
            "m",
        ),
    ] = None
    crossed: Annotated[
        bool,
        meaning(
            "`true` where it crosses between its two pulleys, which then turn opposite ways; both "
            'are given as `"grooved"`'
        ),
    ] = False
    standard_lengths: Annotated[
        Annotated[list[Annotated[float, Field(gt=0)]], Field(min_length=1)] | None,
        meaning(
            "optional: a list of the lengths along the neutral axis in which the belt is sold, for "
            "`beltjax layout`; of a toothed belt without one every whole number of teeth",
            "m",
        ),
    ] = None


@numbers_of(Pulley)
class PulleyTable(Table):
    """[[pulley]]."""

    translated = (
        *("diameter", "effective_diameter", "smooth_diameter", "teeth", "groove_angle", "groove"),
    )
    name: Annotated[str, meaning("of its own")]
    face: Annotated[
        Literal["grooved", "back"],
        meaning('`"grooved"`: inside the loop; `"back"`: on the back of the belt'),
    ]
    driver: Annotated[
        bool, meaning("`true` for exactly one; its motion is given, and it balances the torques")
    ] = False
    housing: Annotated[
        Literal["ground", "arm"],
        meaning(
            'what the accessory is bolted to: `"ground"` (default), or `"arm"`, the tensioner that '
            "carries its pulley, which then feels its torque"
        ),
    ] = "ground"
    wedged: Annotated[
        bool,
        meaning("`false`, also written `groove = false`, where a belt with groove lies flat"),
    ] = True
    cushion: Annotated[
        bool,
        meaning("`false` where the cords lie on the pulley itself, though the belt has a cushion"),
    ] = True
    friction_law: Annotated[
        Literal["stribeck", "cubic"] | None,
        meaning(
            'beside `friction_static`: `"stribeck"` (default), which falls for good, or `"cubic"`, '
            "which rises again"
        ),
    ] = None
    belt: Annotated[str | None, meaning("name of its belt, where there are several")] = None
    shaft: Annotated[
        str | None,
        meaning(
            "name of another pulley on the same shaft (default: a shaft of its own). Both then "
            "have one center"
        ),
    ] = None


@numbers_of(
    Tensioner,
    "rotary",
    only=(
        "pivot",
        "stiffness",
        "inertia",
        "damping",
        "stops",
        "friction_torque",
        "friction_hub",
        "friction_spring",
        "friction_unwinding",
        "friction_speed",
    ),
    required=("pivot", "stiffness"),
    docs={
        "pivot": "`[x, y]`; with the pulley's center it gives the arm",
        "stiffness": "of the spring",
        "inertia": "of the arm about its pivot, with the mass of its pulley but not that pulley's "
        "spin",
        "stops": "`[least, greatest]` direction of the arm, from pivot to pulley",
    },
)
class ArmTable(Table):
    """[tensioner]: one rotary arm, whose stops are directions."""

    translated = ("preload", "at_angle")
    pulley: Annotated[str, meaning("the name of the pulley it carries")]


class CarrierTable(Table):
    """What every [[tensioner]] has."""

    translated = ("preload", "at_angle")
    name: Annotated[str | None, meaning("of its own, where there are several")] = None
    kind: Annotated[
        Literal["rotary", "linear", "twin-arm"],
        meaning('`"rotary"` (default), `"linear"` or `"twin-arm"`'),
    ] = "rotary"
    pulley: Annotated[str | None, meaning("the name of the pulley it carries, or")] = None
    pulleys: Annotated[
        list[str] | None,
        meaning("the names of several, of none (`[]`), or of one on each twin arm"),
    ] = None


class BodyTable(CarrierTable):
    """A [[tensioner]] of one coordinate."""

    on: Annotated[
        str | None, meaning("optional: the name of the tensioner that it sits on, as drawn")
    ] = None
    locked: Annotated[bool, meaning("`true` where it is bolted, as a slide or an eccentric")] = (
        False
    )


@numbers_of(Tensioner, "rotary", without=("direction",), required=("pivot",))
class RotaryTable(BodyTable):
    """[[tensioner]] that turns about a pivot."""


def _of_both_arms(value: Any) -> Any:
    """Stops for each of two arms, where one pair is given for both."""
    pair = isinstance(value, list) and not any(isinstance(part, list) for part in value)
    return [value, value] if pair and len(value) == 2 else value


def _length(value: Any) -> float:
    try:
        return to_si(value, "m")
    except ValueError as error:
        raise PydanticCustomError("unit", "{text}", {"text": str(error)}) from error


def _direction(value: Any) -> list[float]:
    """A unit vector from an angle, or a vector as it is given."""
    try:
        if not isinstance(value, list):
            angle = to_si(value, "rad")
            return [float(np.cos(angle)), float(np.sin(angle))]
        vector = [to_si(part, "") for part in value]
    except ValueError as error:
        raise PydanticCustomError("unit", "{text}", {"text": str(error)}) from error
    if len(vector) != 2 or not any(vector):
        text = f"found {shown(value)}; give an angle, or [dx, dy] that are not both 0"
        raise PydanticCustomError("unit", "{text}", {"text": text})
    return vector


@numbers_of(Tensioner, "linear", without=("pivot", "direction"))
class LinearTable(BodyTable):
    """[[tensioner]] that slides along a line."""

    direction: Annotated[
        list[float], BeforeValidator(_direction), meaning_of(Tensioner, "direction")
    ]


@numbers_of(
    Tensioner,
    "rotary",
    only=("pivot", "stiffness", "damping"),
    required=("pivot", "stiffness"),
    docs={"stiffness": "of the spring between the arms", "damping": "between the arms"},
)
class TwinArmTable(CarrierTable):
    """[[tensioner]] of two arms about one pivot with a spring between them."""

    ground_stiffness: Annotated[
        Annotated[list[Annotated[float, valid(Tensioner, "stiffness", "rotary")]], Two] | None,
        meaning("optional: of the springs from each arm to the ground", "N m/rad"),
    ] = None
    ground_damping: Annotated[
        Annotated[list[Annotated[float, valid(Tensioner, "damping", "rotary")]], Two] | None,
        meaning("optional: likewise", "N m s/rad"),
    ] = None
    inertia: Annotated[
        Annotated[list[Annotated[float, valid(Tensioner, "inertia", "rotary")]], Two] | None,
        meaning("optional: `[J, J]` of the two arms", "kg m^2"),
    ] = None
    stops: Annotated[
        Annotated[
            list[Annotated[list[Annotated[float, valid(Tensioner, "stops", "rotary")]], Two]],
            Two,
            BeforeValidator(_of_both_arms),
        ]
        | None,
        meaning(
            "optional: `[least, greatest]`, from the drawn position, of both or of each", "rad"
        ),
    ] = None


_TABLE_OF_KIND = {"rotary": "RotaryTable", "linear": "LinearTable", "twin-arm": "TwinArmTable"}


def _table_of(value: Any) -> str | None:
    """The table by which a [[tensioner]] is read; None for an unknown kind."""
    kind = value.get("kind", "rotary") if isinstance(value, dict) else "rotary"
    return _TABLE_OF_KIND.get(kind) if isinstance(kind, str) else None


def _one_or_several(value: Any) -> str:
    return "SeveralTable" if isinstance(value, list) else "OneTable"


class ArmSpringTable(Table):
    """[[arm_spring]]; the unit of its numbers is known when its tensioners are."""

    name: Annotated[str, meaning("of its own, beside those of the tensioners")]
    between: Annotated[list[str], Two, meaning("names of two tensioners of one kind")]
    stiffness: Annotated[Any, meaning_of(ArmSpring, "stiffness")]
    damping: Annotated[Any, meaning_of(ArmSpring, "damping")] = 0.0


@numbers_of(Isolator)
class IsolatorTable(Table):
    """[[isolator]]."""

    name: Annotated[str | None, meaning("optional: of its own; else that of its first pulley")] = (
        None
    )
    pulley: Annotated[str | None, meaning("the name of the pulley whose rim it carries, or")] = None
    pulleys: Annotated[
        Annotated[list[str], Field(min_length=1)] | None,
        meaning("the names of several of one shaft that share a rim"),
    ] = None
    law: Annotated[
        str,
        meaning(
            '`"spring"` (default), or what lets the hub overrun the rim (in `beltjax periodic`): '
            '`"spring-clutch"`, which remembers the angle, `"decoupler"`, a spring with a one-way '
            'clutch, or `"rigid-clutch"`, that clutch alone'
        ),
    ] = "spring"
    one_way: Annotated[bool, meaning("`false`")] = False


@numbers_of(Damper)
class DamperTable(Table):
    """[[damper]]."""

    name: Annotated[str | None, meaning("optional: of its own; else that of its pulley")] = None
    pulley: Annotated[str, meaning("the name of its pulley")]
    at: Annotated[Literal["hub", "rim"], meaning('`"hub"` (default) or `"rim"`')] = "hub"


@numbers_of(BeltGiven, only=("free_angle",))
class RuleTable(Table):
    """[installation]; what goes by the names of belts or springs is read when they are known."""

    tension: Annotated[Any, meaning_of(TensionGiven, "tension")] = None
    tension_of: Annotated[
        Literal["belt", "string"],
        meaning(
            'beside `tension`: `"belt"` (default), the tension in the middle of the real, stiff '
            'belt\'s spans at rest; `"string"`, the tension that the same belt would have if it '
            "did not resist bending. Only [contact mechanics](contact.md) knows the difference"
        ),
    ] = "belt"
    span_tensions: Annotated[
        list[Annotated[float, valid(TensionGiven, "span_tensions")]] | None,
        meaning_of(TensionGiven, "span_tensions"),
    ] = None
    belt_length: Annotated[Any, meaning_of(BeltGiven, "belt_length")] = None
    free: Annotated[dict[str, Any] | None, meaning_of(BeltGiven, "free")] = None
    adjust: Annotated[
        str | None,
        meaning(
            "the name of a locked tensioner that is moved until the belt of this `belt_length` has "
            "this `tension`, or `until` another stands at its mark; then it is bolted"
        ),
    ] = None
    until: Annotated[
        dict[str, Any] | None,
        meaning("beside `adjust`: `{NAME = x}`, where that tensioner stands then", "rad or m"),
    ] = None


@numbers_of(Load, only=("drag",))
class LoadTable(Table):
    """[operation.load.NAME]."""

    power: Annotated[
        float | list[float] | None, valid_one_or_more(Load, "power"), meaning_of(Load, "power")
    ] = None
    speed: Annotated[
        float | list[float] | None, valid_one_or_more(Load, "speed"), meaning_of(Load, "speed")
    ] = None
    torque: Annotated[
        float | list[float] | None, valid_one_or_more(Load, "torque"), meaning_of(Load, "torque")
    ] = None


def _by_pulley(value: Any) -> Any:
    """Tables of loads; raises for what lacks the pulleys' names."""
    bare = isinstance(value, list) or (
        isinstance(value, dict) and not all(isinstance(item, dict) for item in value.values())
    )
    if bare:
        text = f"found {shown(value)} without a pulley's name; write [operation.load.NAME]"
        raise PydanticCustomError("unit", "{text}", {"text": text})
    return value


@numbers_of(OperatingPoint, without=("torque",))
class OperationTable(Table):
    """[operation]."""

    travel: Annotated[
        Literal["listed", "opposite"],
        meaning(
            '`"listed"` (default) or `"opposite"`: the sense in which the belt runs. Let it reach '
            "the tensioner from the driver: that side is slack"
        ),
    ] = "listed"
    torque: Annotated[
        dict[str, Annotated[float, valid(OperatingPoint, "torque")]],
        Field(default_factory=dict),
        meaning_of(OperatingPoint, "torque"),
    ]
    load: Annotated[
        dict[str, LoadTable],
        BeforeValidator(_by_pulley),
        Field(default_factory=dict),
        meaning("tables by pulley's name: what it takes as power, or over its speed"),
    ]


class DutyTable(OperationTable):
    """[[duty]]; what it leaves out is that of [operation]."""

    name: Annotated[str, meaning("of its own")]


@numbers_of(OrderGiven, without=("torque",))
class OrderTable(Table):
    """One of the orders of [excitation]."""

    torque: Annotated[
        dict[str, Annotated[float, valid(OrderGiven, "torque")]],
        Field(default_factory=dict),
        meaning_of(OrderGiven, "torque"),
    ]


def _knot(value: Any) -> list[float]:
    """A time and a speed of a profile, in SI."""
    if not isinstance(value, list) or len(value) != len(KNOT):
        text = f'found {shown(value)}; give a time and a speed, such as [1.5, "3000 rpm"]'
        raise PydanticCustomError("unit", "{text}", {"text": text})
    try:
        return [checked(one, number) for one, number in zip(value, KNOT, strict=True)]
    except ValueError as error:
        raise PydanticCustomError("unit", "{text}", {"text": str(error)}) from error


@numbers_of(ExcitationGiven, without=("torque",))
class ExcitationTable(Table):
    """[excitation]."""

    torque: Annotated[
        dict[str, Annotated[float, valid(ExcitationGiven, "torque")]],
        Field(default_factory=dict),
        meaning_of(ExcitationGiven, "torque"),
    ]
    orders: Annotated[
        list[OrderTable],
        Field(default_factory=list),
        meaning("tables of several orders, for `periodic` and `transient`, in place of the others"),
    ]
    profile: Annotated[
        list[Annotated[list[float], BeforeValidator(_knot)]] | None,
        meaning(
            "optional: times and driver's speeds of a `beltjax transient`, such as "
            '`[[0, "600 rpm"], [1.5, "3000 rpm"]]`; lines join them',
            "s and rad/s",
        ),
    ] = None
    driver: Annotated[
        Literal["prescribed", "free"],
        meaning(
            '`"prescribed"`: its rotation is given by crank, or steady; `"free"`: it turns by its '
            "torque, which may fluctuate, at a mean speed that is given"
        ),
    ] = "prescribed"


class ModelTable(Table):
    """[model]; what is left out is off in files of schema 1 and on in those of schema 2."""

    arm_curvature: Annotated[
        bool | None,
        meaning("the curvature of the tensioners' paths adds to the stiffness of their motion"),
    ] = None
    stretching_arcs: Annotated[
        bool | None, meaning("the belt stretches on the pulleys, too, and not on the spans alone")
    ] = None
    belt_inertia: Annotated[
        bool | None,
        meaning("the belt's inertia along its path, which moves with the pulleys' rotation"),
    ] = None


class ContactTable(Table):
    """[contact]: how contact in grooves is computed; of a belt without grooves unused."""

    model: Annotated[
        Literal["full", "thin"],
        meaning('`"full"` (default), or `"thin"`: formulas for a belt that sinks in little'),
    ] = "full"
    slip_velocity: Annotated[
        Annotated[float, Field(gt=0, lt=0.1)],
        meaning("sliding speed over the belt's below which friction is viscous; default 1e-5"),
    ] = 1e-5
    slip_limit: Annotated[
        Annotated[float, Field(gt=0, lt=1)],
        meaning("slip at which `--maximum` ends; default 0.05"),
    ] = 0.05


OneBody = Annotated[
    Annotated[RotaryTable, Tag("RotaryTable")]
    | Annotated[LinearTable, Tag("LinearTable")]
    | Annotated[TwinArmTable, Tag("TwinArmTable")],
    Discriminator(
        _table_of,
        custom_error_type="unit",
        custom_error_message="kind is not one that is known; give "
        + " or ".join(f'kind = "{kind}"' for kind in _TABLE_OF_KIND),
    ),
]


@numbers_of(Drive, only=("gravity",))
class DriveTable(Table):
    """A drive file."""

    schema_: Annotated[
        Literal[1, 2],
        Field(alias="schema"),
        meaning("version of the format: 1 or 2. They differ in what `[model]` leaves out"),
    ] = 1
    name: Annotated[str, meaning("of the drive, for tables and pictures")] = "drive"
    listed: Annotated[
        Any,
        meaning(
            '`"counterclockwise"` or `"clockwise"`: the sense in which the pulleys are listed; of '
            "several belts a table by their names. May be left out where only one sense gives a "
            "simple path"
        ),
    ] = None
    origin: Annotated[
        Annotated[list[Annotated[float, BeforeValidator(_length)]], Two] | None,
        meaning(
            "optional: `[x, y]`, the point of the site from which the file's coordinates are "
            "counted. Coordinates far from their origin are read with all their digits, and "
            "counted from a point near the drive: a saved file has that one",
            "m",
        ),
    ] = None
    belt: Annotated[
        Annotated[BeltTable, Tag("OneTable")] | Annotated[list[BeltTable], Tag("SeveralTable")],
        Discriminator(_one_or_several),
    ]
    pulley: list[PulleyTable]
    tensioner: (
        Annotated[
            Annotated[ArmTable, Tag("OneTable")] | Annotated[list[OneBody], Tag("SeveralTable")],
            Discriminator(_one_or_several),
        ]
        | None
    ) = None
    arm_spring: Annotated[list[ArmSpringTable], Field(default_factory=list)]
    isolator: Annotated[list[IsolatorTable], Field(default_factory=list)]
    damper: Annotated[list[DamperTable], Field(default_factory=list)]
    installation: Annotated[RuleTable, Field(default_factory=RuleTable)]
    operation: OperationTable | None = None
    duty: Annotated[list[DutyTable], Field(default_factory=list)]
    excitation: ExcitationTable | None = None
    model: Annotated[ModelTable, Field(default_factory=ModelTable)]
    contact: Annotated[ContactTable, Field(default_factory=ContactTable)]

    @property
    def belts(self) -> list[BeltTable]:
        """The belts, of which most drives have one."""
        return self.belt if isinstance(self.belt, list) else [self.belt]
