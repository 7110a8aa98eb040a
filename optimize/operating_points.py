"""The operating points of a study file, and ranges of speeds that stand for many."""

import dataclasses
from collections.abc import Iterable
from typing import Annotated

import jax
import jax.numpy as jnp
import numpy as np
from pydantic import Field

from beltjax.drive.duties import stacked
from beltjax.drive.loads import without_load
from beltjax.drive.numbers import require_numbers, shift_of, unit_of
from beltjax.drive.operation import ExcitationGiven, OperatingPoint
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.files.tables import Table
from beltjax.files.units import to_si

from .study import Cases

SiOrText = float | int | str


class RangeTable(Table):
    """A range of speeds: so many operating points, equally spaced."""

    lower: Annotated[SiOrText, Field(alias="from")]
    upper: Annotated[SiOrText, Field(alias="to")]
    points: Annotated[int, Field(ge=2, le=1000)]


class PointTable(Table):
    """[[point]]; what it leaves out is the drive file's."""

    name: str
    belt_speed: SiOrText | RangeTable | None = None
    driver_speed: SiOrText | RangeTable | None = None
    torque: dict[str, SiOrText] | None = None
    crank: SiOrText | None = None  # amplitude of [excitation] there


def number_of(value: SiOrText, unit: str, path: object, key: str) -> float:
    """A number in SI; raises `FileError` for what is none, or has another unit."""
    try:
        return to_si(value, unit)
    except ValueError as error:
        raise FileError(path, key, str(error)) from error


def number_of_drive(drive: Drive, name: str, value: SiOrText, path: object, key: str) -> float:
    """A value of a number of the drive [SI], of one that is counted as the drive's file does."""
    return number_of(value, unit_of(drive, name), path, key) - shift_of(drive, name)


def require_of_drive(
    drive: Drive, name: str, path: object, key: str, others: Iterable[str] = ()
) -> None:
    """Raise `FileError` unless a study may set this number of the drive, beside `others`."""
    try:
        require_numbers(drive, [*others, name])
    except ValueError as error:
        raise FileError(path, key, str(error)) from error
    if name.startswith("operation."):
        raise FileError(path, key, f"{name!r} is no part of the drive; use [[point]]")


def read_cases(
    tables: list[PointTable], drive: Drive, point: OperatingPoint, path: object
) -> Cases:
    """The operating points of a study; what a table leaves out is `point`'s.

    Raises `FileError` for points that cannot be measured together: twice the same name, some
    with a belt speed and some with a driver speed, a torque on a pulley that takes none.
    """
    names, points, shaken = [], [], []
    for table in tables:
        key = f"point.{table.name}"
        if table.name in names or not table.name or "@" in table.name:
            raise FileError(path, key, "needs a name of its own without '@'; rename it")
        torque = _torques(table, drive, point, path)
        # Its own torque is all that a pulley takes; the structure of all points is one.
        load = {
            name: without_load(one) if name in (table.torque or {}) else one
            for name, one in point.load.items()
        }
        for speed in _speeds(table, point, path):
            names.append(table.name)
            given = speed | {"torque": torque, "load": load}
            points.append(dataclasses.replace(point, excitation=None, **given))
            shaken.append(_excitation(table, point, path))
    rules = {point.belt_speed is None for point in points}
    if len(rules) > 1:
        raise FileError(
            path, "point", "some give belt_speed and some driver_speed; give the same for all"
        )
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *points)
    if point.excitation is not None:
        excited = jax.tree.map(lambda *x: jnp.stack(x), *shaken)
        stacked = dataclasses.replace(stacked, excitation=excited)
    return Cases(stacked, tuple(names))


def cases_of_duties(duties: dict[str, OperatingPoint], path: object) -> Cases | None:
    """The duties of a drive file as operating points of a study; None where there are none.

    Raises `FileError` for duties that cannot be measured together.
    """
    if not duties:
        return None
    try:
        return Cases(stacked(duties), tuple(duties), are_duties=True)
    except ValueError as error:
        raise FileError(path, "duty", str(error)) from error


def _excitation(table: PointTable, point: OperatingPoint, path: object) -> ExcitationGiven | None:
    """The excitation at one point: the drive file's, with the crank's amplitude of the point."""
    file, key = point.excitation, f"point.{table.name}.crank"
    if table.crank is None:
        return file
    if file is None or file.crank is None:
        message = "goes with a table [excitation] of the drive file that has a crank; give that"
        raise FileError(path, key, message)
    crank = number_of(table.crank, "rad", path, key)
    if crank < 0:
        raise FileError(path, key, f"found {table.crank}; must not be negative")
    return dataclasses.replace(file, crank=crank)


def _torques(
    table: PointTable, drive: Drive, point: OperatingPoint, path: object
) -> dict[str, float]:
    torque = {name: float(point.torque.get(name, 0.0)) for name in drive.pulley_names}
    key = f"point.{table.name}.torque"
    if table.torque is not None:
        unknown = [name for name in table.torque if name not in drive.pulley_names]
        if unknown:
            known = ", ".join(drive.pulley_names)
            raise FileError(path, key, f"there is no pulley {unknown[0]!r}; give one of {known}")
        given = {k: number_of(v, "N m", path, f"{key}.{k}") for k, v in table.torque.items()}
        torque = {name: given.get(name, 0.0) for name in torque}
    driver = next(p.name for p in drive.pulleys if float(p.driver))
    if torque.pop(driver):
        raise FileError(path, key, f"the driver {driver!r} balances the others; remove its torque")
    return torque


def _speeds(
    table: PointTable, point: OperatingPoint, path: object
) -> list[dict[str, float | None]]:
    """Speeds of the cases that one table stands for, each as fields of an operating point."""
    given = {key: getattr(table, key) for key in ("belt_speed", "driver_speed")}
    given = {key: value for key, value in given.items() if value is not None}
    if not given:
        return [{}]
    key = f"point.{table.name}"
    if len(given) > 1:
        raise FileError(path, key, "has belt_speed and driver_speed; remove one")
    [(field, value)] = given.items()
    unit, other = ("m/s", "driver_speed") if field == "belt_speed" else ("rad/s", "belt_speed")
    ends = [value.lower, value.upper] if isinstance(value, RangeTable) else [value]
    numbers = [number_of(end, unit, path, f"{key}.{field}") for end in ends]
    if min(numbers) < 0 or (len(numbers) == 2 and numbers[0] >= numbers[1]):
        raise FileError(path, f"{key}.{field}", f"found {ends}; give speeds from low to high")
    if isinstance(value, RangeTable):
        numbers = [float(x) for x in np.linspace(numbers[0], numbers[1], value.points)]
    return [{field: number, other: None} for number in numbers]
