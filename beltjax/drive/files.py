"""Drive files: TOML in and out."""

import os
from typing import Annotated, Any, Literal

import jax
import numpy as np
import tomli_w
from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

from beltjax.drive.checks import require_possible_layout
from beltjax.drive.components import (
    SENSES,
    SIDES,
    TRAVELS,
    Belt,
    BeltGiven,
    Drive,
    ExcitationGiven,
    OperatingPoint,
    Pulley,
    Tensioner,
    TensionGiven,
    as_real,
    repeated_span,
)
from beltjax.files.errors import FileError
from beltjax.files.reading import read_toml
from beltjax.files.tables import (
    Meter,
    Newton,
    NewtonMeter,
    NotNegative,
    Number,
    Positive,
    Radian,
    Table,
    in_unit,
    validated,
)
from beltjax.files.writing import write_whole

Point = Annotated[list[Meter], Field(min_length=2, max_length=2)]
_MOST_PULLEYS = 200  # compiling grows with their number: 100 take some 12 s, 300 some 40 s
LARGEST_BARE_RADIUS = 5.0  # [m]; above it most bare numbers are millimeters


def _with_its_unit(value: Any) -> Any:
    """A radius, refused where it can hardly be meant in meters and does not say so."""
    if type(value) in (int, float) and value > LARGEST_BARE_RADIUS:
        lead = f'millimeters are written "{value:g} mm", and such large pulleys "{value:g} m"'
        text = f"found {value:g}; a bare number is in meters, {lead}"
        raise PydanticCustomError("unit", "{text}", {"text": text})
    return value


Radius = Annotated[float, in_unit("m"), BeforeValidator(_with_its_unit)]
Inertia = Annotated[float, in_unit("kg m^2"), NotNegative]


class BeltTable(Table):
    """[belt]."""

    axial_stiffness: Annotated[Newton, Positive]
    bending_stiffness: Annotated[float, in_unit("N m^2"), NotNegative]
    mass_per_length: Annotated[float, in_unit("kg/m"), Positive]
    thickness: Annotated[Meter, NotNegative] | None = None


class PulleyTable(Table):
    """[[pulley]]."""

    name: str
    center: Point
    radius: Annotated[Radius, Positive]
    inertia: Inertia | None = None
    face: Literal["grooved", "back"]
    friction: Annotated[Number, NotNegative] | None = None
    rim_radius: Annotated[Radius, Positive] | None = None
    driver: bool = False


class TensionerTable(Table):
    """[tensioner]."""

    pulley: str
    pivot: Point
    stiffness: Annotated[float, in_unit("N m/rad"), Positive]
    inertia: Inertia | None = None
    damping: Annotated[float, in_unit("N m s/rad"), NotNegative] | None = None
    stops: Annotated[list[Radian], Field(min_length=2, max_length=2)] | None = None


class InstallationTable(Table):
    """[installation]."""

    tension: Annotated[Newton, Positive] | None = None
    span_tensions: list[Newton] | None = None
    tension_of: Literal["belt", "string"] = "belt"
    belt_length: Annotated[Meter, Positive] | None = None
    free_angle: Radian | None = None


class OperationTable(Table):
    """[operation]."""

    belt_speed: Annotated[float, in_unit("m/s"), NotNegative] | None = None
    driver_speed: Annotated[float, in_unit("rad/s"), NotNegative] | None = None
    mass_flow: Annotated[float, in_unit("kg/s"), NotNegative] | None = None
    travel: Literal["listed", "opposite"] = "listed"
    torque: Annotated[dict[str, NewtonMeter], Field(default_factory=dict)]


class ExcitationTable(Table):
    """[excitation]."""

    crank: Annotated[Radian, NotNegative] | None = None
    order: Annotated[Number, Positive] | None = None
    torque: Annotated[dict[str, Annotated[NewtonMeter, NotNegative]], Field(default_factory=dict)]


class DriveTable(Table):
    """A drive file."""

    schema_: Annotated[Literal[1], Field(alias="schema")] = 1
    name: str = "drive"
    listed: Literal["counterclockwise", "clockwise"] | None = None
    belt: BeltTable
    pulley: list[PulleyTable]
    tensioner: TensionerTable | None = None
    installation: InstallationTable
    operation: OperationTable
    excitation: ExcitationTable | None = None


def load_drive(path: str | os.PathLike[str]) -> tuple[Drive, OperatingPoint]:
    """The drive and the operating point that a TOML file describes.

    Raises `FileError`, one line that names the file, the key, what was found and what to do,
    for anything that is wrong with the file or impossible about its layout; and
    `RuntimeError` when JAX is in single precision.
    """
    as_real(0.0)  # say what is wrong with the precision before anything about the file
    content = read_toml(path)
    if "drive" in content and "belt" not in content:
        raise FileError(
            path, "drive", "is the key of a study; give its drive file, or `optimize` it"
        )
    file = validated(DriveTable, content, path)
    _require_names(file, path)
    _require_installation(file, path)
    _require_operation(file, path)
    point = _operating_point(file)
    drives = {sense: _drive(file, sense) for sense in SENSES}
    return require_possible_layout(drives, file.listed, path), point


def save_drive(path: str | os.PathLike[str], drive: Drive, point: OperatingPoint) -> None:
    """Write a drive file from which `load_drive` restores every number exactly.

    All numbers are SI. The file is written in one move: it is complete or absent.
    """
    write_whole(path, drive_bytes(drive, point))


def drive_bytes(drive: Drive, point: OperatingPoint) -> bytes:
    """What `save_drive` writes."""
    return tomli_w.dumps(drive_content(drive, point)).encode()


def drive_content(drive: Drive, point: OperatingPoint) -> dict[str, Any]:
    """A drive file as nested dictionaries of plain numbers, absent keys left out."""
    rule, arm, shaken = drive.installation, drive.tensioner, point.excitation
    carried = [pulley.name for pulley in drive.pulleys if float(pulley.on_arm)]
    content = {
        "schema": 1,
        "name": drive.name,
        "listed": _word(SENSES, drive.sense),
        "belt": _numbers(drive.belt),
        "pulley": [_pulley_content(pulley) for pulley in drive.pulleys],
        "tensioner": None if arm is None else {"pulley": carried[0]} | _numbers(arm),
        "installation": _installation_content(rule),
        "operation": _numbers(point, skip=("torque", "travel", "excitation"))
        | {
            "travel": _word(TRAVELS, point.travel),
            "torque": _by_name(point.torque),
        },
        "excitation": None
        if shaken is None
        else _numbers(shaken, skip=("torque",)) | {"torque": _by_name(shaken.torque)},
    }
    return {key: value for key, value in content.items() if value is not None}


def _pulley_content(pulley: Pulley) -> dict[str, Any]:
    content: dict[str, Any] = {"name": pulley.name}
    content |= _numbers(pulley, skip=("name", "face", "driver", "on_arm"))
    for key in ("radius", "rim_radius"):
        if content.get(key, 0.0) > LARGEST_BARE_RADIUS:
            content[key] = f"{content[key]!r} m"
    content["face"] = _word(SIDES, pulley.face)
    return content | ({"driver": True} if float(pulley.driver) else {})


def _installation_content(rule: TensionGiven | BeltGiven) -> dict[str, Any]:
    content = _numbers(rule, skip=("tension_of",))
    if isinstance(rule, TensionGiven) and rule.tension_of != "belt":
        content["tension_of"] = rule.tension_of
    return content


def _numbers(part: Any, skip: tuple[str, ...] = ()) -> dict[str, Any]:
    """Fields of a pytree as plain numbers or lists of them; absent ones are left out."""
    fields = {key: value for key, value in vars(part).items() if key not in skip}
    return {key: np.asarray(value).tolist() for key, value in fields.items() if value is not None}


def _by_name(numbers: dict[str, jax.Array]) -> dict[str, float]:
    return {name: float(value) for name, value in numbers.items()}


def _word(words: dict[str, float], sign: jax.Array) -> str:
    return next(word for word, value in words.items() if value == float(sign))


def _drive(file: DriveTable, sense: str) -> Drive:
    carried = file.tensioner.pulley if file.tensioner else None
    pulleys = [
        Pulley(**pulley.model_dump(), on_arm=pulley.name == carried) for pulley in file.pulley
    ]
    arm = file.tensioner and Tensioner(**file.tensioner.model_dump(exclude={"pulley"}))
    rule = file.installation
    if rule.tension is not None:
        installation = TensionGiven(rule.tension, rule.span_tensions, rule.tension_of)
    else:
        installation = BeltGiven(rule.belt_length, rule.free_angle)
    return Drive(
        belt=Belt(**file.belt.model_dump()),
        pulleys=tuple(pulleys),
        installation=installation,
        tensioner=arm,
        sense=sense,
        name=file.name,
    )


def _operating_point(file: DriveTable) -> OperatingPoint:
    shaken = file.excitation and ExcitationGiven(**file.excitation.model_dump())
    return OperatingPoint(**file.operation.model_dump(), excitation=shaken)


def _require_names(file: DriveTable, path: object) -> None:
    names = [pulley.name for pulley in file.pulley]
    if len(names) < 2:
        raise FileError(path, "pulley", f"found {len(names)}; a drive has at least two pulleys")
    if len(names) > _MOST_PULLEYS:
        message = f"found {len(names)}; a drive file has {_MOST_PULLEYS} at most, to be analyzed"
        raise FileError(path, "pulley", f"{message} in half a minute: leave out or merge some")
    for i, name in enumerate(names):
        if not name.strip() or any(mark in name for mark in ".:=") or not name.isprintable():
            message = f"found {name!r}; a name prints, is not empty, and is without . : ="
            raise FileError(path, f"pulley[{i}].name", message)
        if name in names[:i]:
            raise FileError(path, f"pulley.{name}", "this name is used twice; rename one of them")
    repeated = repeated_span(names)
    if repeated is not None:
        raise FileError(path, "pulley", f"two spans would be called {repeated!r}; rename a pulley")
    drivers = [pulley.name for pulley in file.pulley if pulley.driver]
    if len(drivers) != 1:
        found = ", ".join(drivers) or "none"
        raise FileError(
            path, "pulley.driver", f"found {found}; mark exactly one pulley with driver = true"
        )
    if file.tensioner:
        key = "tensioner.pulley"
        _require_known(file.tensioner.pulley, names, path, key)
        if file.tensioner.pulley == drivers[0]:
            raise FileError(path, key, f"found the driver {drivers[0]!r}; name an idler")
    _require_torques(file, names, drivers[0], path)


def _require_torques(file: DriveTable, names: list[str], driver: str, path: object) -> None:
    carried = file.tensioner.pulley if file.tensioner else None
    for name, value in file.operation.torque.items():
        key = f"operation.torque.{name}"
        _require_known(name, names, path, key)
        if value and name == driver:
            raise FileError(path, key, "the driver balances the other torques; remove this one")
        if value and name == carried:
            raise FileError(path, key, "the tensioner's pulley is an idler; remove this torque")
    for name in file.excitation.torque if file.excitation else ():
        key = f"excitation.torque.{name}"
        _require_known(name, names, path, key)
        if name == driver:
            raise FileError(path, key, "the driver's motion is given; use excitation.crank")


def _require_known(name: str, names: list[str], path: object, key: str) -> None:
    if name not in names:
        raise FileError(path, key, f"there is no pulley {name!r}; give one of {', '.join(names)}")


def _require_installation(file: DriveTable, path: object) -> None:
    rule, key = file.installation, "installation"
    if (rule.tension is None) == (rule.belt_length is None):
        found = "neither tension nor" if rule.tension is None else "both tension and"
        raise FileError(path, key, f"found {found} belt_length; give exactly one of them")
    if rule.tension is not None and rule.free_angle is not None:
        raise FileError(path, f"{key}.free_angle", "goes with belt_length; remove it")
    if rule.belt_length is not None:
        if rule.tension_of != "belt":
            raise FileError(path, f"{key}.tension_of", "goes with tension; remove it")
        if rule.span_tensions is not None:
            raise FileError(path, f"{key}.span_tensions", "goes with tension; remove it")
        if file.tensioner and rule.free_angle is None:
            raise FileError(path, f"{key}.free_angle", "is missing; belt_length needs it too")
        if not file.tensioner and rule.free_angle is not None:
            raise FileError(path, f"{key}.free_angle", "there is no tensioner; remove it")
    if rule.span_tensions is not None and len(rule.span_tensions) != len(file.pulley):
        found = f"found {len(rule.span_tensions)} tensions for {len(file.pulley)} spans"
        raise FileError(path, f"{key}.span_tensions", f"{found}; give one for each span")
    stops = file.tensioner.stops if file.tensioner else None
    if stops and stops[0] >= stops[1]:
        raise FileError(path, "tensioner.stops", f"found {stops}; give [least, greatest]")


def _require_operation(file: DriveTable, path: object) -> None:
    operation, key = file.operation, "operation"
    if (operation.belt_speed is None) == (operation.driver_speed is None):
        found = "neither" if operation.belt_speed is None else "both"
        raise FileError(path, key, f"found {found} of belt_speed and driver_speed; give one")
    if operation.mass_flow is not None and operation.driver_speed is None:
        raise FileError(path, f"{key}.mass_flow", "goes with driver_speed; give that instead")
