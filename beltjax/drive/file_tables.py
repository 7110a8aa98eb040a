"""The tables of a drive file: their keys, whose numbers are those of the drive's parts."""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag
from pydantic_core import PydanticCustomError

from beltjax.drive.components import Belt, Damper, Isolator, Pulley, Tensioner
from beltjax.drive.installation import BeltGiven, TensionGiven
from beltjax.drive.operation import ExcitationGiven, OperatingPoint
from beltjax.files.tables import Table, numbers_of, valid
from beltjax.files.units import shown, to_si

Kind = Literal["rotary", "linear", "twin-arm"]
Two = Field(min_length=2, max_length=2)


@numbers_of(Belt)
class BeltTable(Table):
    """[belt] or [[belt]]."""

    name: str = "belt"


@numbers_of(Pulley)
class PulleyTable(Table):
    """[[pulley]]."""

    name: str
    face: Literal["grooved", "back"]
    driver: bool = False
    housing: Literal["ground", "arm"] = "ground"
    belt: str | None = None
    shaft: str | None = None


@numbers_of(
    Tensioner,
    "rotary",
    only=("pivot", "stiffness", "inertia", "damping", "stops"),
    required=("pivot",),
)
class ArmTable(Table):
    """[tensioner]: one rotary arm, whose stops are directions."""

    pulley: str


class CarrierTable(Table):
    """What every [[tensioner]] has."""

    name: str | None = None
    kind: Kind = "rotary"
    pulley: str | None = None
    pulleys: list[str] | None = None


class BodyTable(CarrierTable):
    """A [[tensioner]] of one coordinate."""

    on: str | None = None
    locked: bool = False


@numbers_of(
    Tensioner, "rotary", without=("direction",), required=("pivot",), optional=("stiffness",)
)
class RotaryTable(BodyTable):
    """[[tensioner]] that turns about a pivot."""


def _of_both_arms(value: Any) -> Any:
    """Stops for each of two arms, where one pair is given for both."""
    pair = isinstance(value, list) and not any(isinstance(part, list) for part in value)
    return [value, value] if pair and len(value) == 2 else value


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


@numbers_of(Tensioner, "linear", without=("pivot", "direction"), optional=("stiffness",))
class LinearTable(BodyTable):
    """[[tensioner]] that slides along a line."""

    direction: Annotated[list[float], BeforeValidator(_direction)]


@numbers_of(Tensioner, "rotary", only=("pivot", "stiffness", "damping"), required=("pivot",))
class TwinArmTable(CarrierTable):
    """[[tensioner]] of two arms about one pivot with a spring between them."""

    ground_stiffness: (
        Annotated[list[Annotated[float, valid(Tensioner, "stiffness", "rotary")]], Two] | None
    ) = None
    ground_damping: (
        Annotated[list[Annotated[float, valid(Tensioner, "damping", "rotary")]], Two] | None
    ) = None
    inertia: (
        Annotated[list[Annotated[float, valid(Tensioner, "inertia", "rotary")]], Two] | None
    ) = None
    stops: (
        Annotated[
            list[Annotated[list[Annotated[float, valid(Tensioner, "stops", "rotary")]], Two]],
            Two,
            BeforeValidator(_of_both_arms),
        ]
        | None
    ) = None


_TABLE_OF_KIND = {"rotary": "RotaryTable", "linear": "LinearTable", "twin-arm": "TwinArmTable"}


def _table_of(value: Any) -> str | None:
    """The table by which a [[tensioner]] is read; None for an unknown kind."""
    kind = value.get("kind", "rotary") if isinstance(value, dict) else "rotary"
    return _TABLE_OF_KIND.get(kind) if isinstance(kind, str) else None


def _one_or_several(value: Any) -> str:
    return "SeveralTable" if isinstance(value, list) else "OneTable"


class ArmSpringTable(Table):
    """[[arm_spring]]; the unit of its numbers is known when its tensioners are."""

    name: str
    between: Annotated[list[str], Two]
    stiffness: Any
    damping: Any = 0.0


@numbers_of(Isolator)
class IsolatorTable(Table):
    """[[isolator]]."""

    pulley: str | None = None
    pulleys: Annotated[list[str], Field(min_length=1)] | None = None
    law: str = "spring"
    one_way: bool = False
    stops: Any = None


@numbers_of(Damper)
class DamperTable(Table):
    """[[damper]]."""

    pulley: str
    at: Literal["hub", "rim"] = "hub"


@numbers_of(BeltGiven, only=("free_angle",))
class RuleTable(Table):
    """[installation]; what goes by the names of belts or springs is read when they are known."""

    tension: Any = None
    tension_of: Literal["belt", "string"] = "belt"
    belt_length: Any = None
    span_tensions: list[Annotated[float, valid(TensionGiven, "span_tensions")]] | None = None
    free: dict[str, Any] | None = None
    adjust: str | None = None
    until: dict[str, Any] | None = None


@numbers_of(OperatingPoint, without=("torque",))
class OperationTable(Table):
    """[operation]."""

    travel: Literal["listed", "opposite"] = "listed"
    torque: Annotated[
        dict[str, Annotated[float, valid(OperatingPoint, "torque")]], Field(default_factory=dict)
    ]


@numbers_of(ExcitationGiven, without=("torque",))
class ExcitationTable(Table):
    """[excitation]."""

    torque: Annotated[
        dict[str, Annotated[float, valid(ExcitationGiven, "torque")]], Field(default_factory=dict)
    ]


class ModelTable(Table):
    """[model]; what is left out is off in files of schema 1 and on in those of schema 2."""

    arm_curvature: bool | None = None
    stretching_arcs: bool | None = None
    belt_inertia: bool | None = None


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


class DriveTable(Table):
    """A drive file."""

    schema_: Annotated[Literal[1, 2], Field(alias="schema")] = 1
    name: str = "drive"
    listed: Any = None
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
    installation: RuleTable
    operation: OperationTable
    excitation: ExcitationTable | None = None
    model: Annotated[ModelTable, Field(default_factory=ModelTable)]

    @property
    def belts(self) -> list[BeltTable]:
        """The belts, of which most drives have one."""
        return self.belt if isinstance(self.belt, list) else [self.belt]
