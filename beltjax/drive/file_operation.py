"""The [operation], the [[duty]] tables and the [excitation] of a drive file, read and written."""

import itertools
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from beltjax.drive.components import TRAVELS, as_optional
from beltjax.drive.file_pulleys import Wheels, numbers_content, word
from beltjax.drive.file_tables import (
    DriveTable,
    DutyTable,
    ExcitationTable,
    LoadTable,
    OperationTable,
)
from beltjax.drive.loads import Load, load_fault
from beltjax.drive.numbers import SPEEDS
from beltjax.drive.operation import ExcitationGiven, OperatingPoint, OrderGiven
from beltjax.files.errors import FileError
from beltjax.files.fields import numbers

OPERATION, DUTY = "operation", "duty"
_SPEED_FIELDS = tuple(key.rpartition(".")[2] for key in SPEEDS)
_APART = ".:=@"  # what separates the words of keys and of quantities


class Runs(NamedTuple):
    """How the drive of a file runs."""

    point: OperatingPoint  # of [operation], or where that has no speed of the first duty
    duties: dict[str, OperatingPoint]  # by their names; empty where the file has none


def read_operation(file: DriveTable, wheels: Wheels, path: object) -> Runs:
    """The operating points of a file; raises `FileError`."""
    if file.operation is None and not file.duty:
        raise FileError(path, OPERATION, "is missing; add it")
    common = file.operation or OperationTable.model_validate({})
    shaken = file.excitation and _excitation(file.excitation)
    _require_takers(common, OPERATION, wheels, path)
    _require_excited(file, wheels, path)
    duties: dict[str, OperatingPoint] = {}
    for duty in file.duty:
        key = f"{DUTY}.{duty.name}"
        if duty.name in duties or not duty.name or set(duty.name) & set(_APART):
            message = "needs a name of its own, without '.', ':', '=' or '@'; rename it"
            raise FileError(path, key, message)
        _require_takers(duty, key, wheels, path)
        duties[duty.name] = _point(_filled(duty, common), key, shaken, path)
    if duties and not any(common.number(field) is not None for field in _SPEED_FIELDS):
        return Runs(next(iter(duties.values())), duties)
    return Runs(_point(common, OPERATION, shaken, path), duties)


def _filled(duty: DutyTable, common: OperationTable) -> OperationTable:
    """A duty with what it does not state from [operation].

    Of both speeds either replaces the other, and what a duty says of a pulley, be it torque or
    load, replaces all that [operation] says of that pulley.
    """
    stated = {field: getattr(duty, field) for field in duty.model_fields_set - {"name"}}
    kept = {field: getattr(common, field) for field in OperationTable.model_fields}
    if stated.keys() & set(_SPEED_FIELDS):
        kept |= dict.fromkeys(_SPEED_FIELDS)
    for field in ("torque", "load"):
        others = {
            name: value
            for name, value in kept[field].items()
            if name not in duty.torque and name not in duty.load
        }
        stated[field] = others | getattr(duty, field)
    return OperationTable.model_construct(**kept | stated)


def _point(
    table: OperationTable, key: str, shaken: ExcitationGiven | None, path: object
) -> OperatingPoint:
    """The operating point of a table that is complete."""
    speeds = {field: table.number(field) for field in _SPEED_FIELDS}
    given = [field for field, value in speeds.items() if value is not None]
    if len(given) != 1:
        found = "both" if given else "neither"
        raise FileError(path, key, f"found {found} of belt_speed and driver_speed; give one")
    if table.number("mass_flow") is not None and given != ["driver_speed"]:
        message = "goes with driver_speed; give that instead"
        raise FileError(path, f"{key}.mass_flow", message)
    loads = {name: _load(load) for name, load in table.load.items()}
    for name, load in loads.items():
        if load.speed is None and load.power is not None and not speeds[given[0]]:
            message = f"nothing turns, since {given[0]} is 0; give operation.torque.{name} instead"
            raise FileError(path, f"{key}.load.{name}.power", message)
    return OperatingPoint(
        **speeds,
        mass_flow=table.number("mass_flow"),
        torque=table.torque,
        load=loads,
        travel=table.travel,
        excitation=shaken,
    )


def _excitation(table: ExcitationTable) -> ExcitationGiven:
    return ExcitationGiven(
        profile=table.profile,
        crank=table.number("crank"),
        order=table.number("order"),
        torque=table.torque,
        orders=tuple(
            OrderGiven(
                order=one.number("order"),
                crank=one.number("crank") or 0.0,
                phase=one.number("phase") or 0.0,
                torque=one.torque,
            )
            for one in table.orders
        ),
        driver=table.driver,
    )


def _load(table: LoadTable) -> Load:
    return Load(**{field: table.number(field) for field in numbers(Load)})


def _require_takers(table: OperationTable, key: str, wheels: Wheels, path: object) -> None:
    """Raise `FileError` for a torque or a load that no pulley can take."""
    for name, value in table.torque.items():
        _require_taker(name, f"{key}.torque.{name}", bool(value), wheels, path)
    for name, load in table.load.items():
        place = f"{key}.load.{name}"
        _require_taker(name, place, True, wheels, path)
        fault = load_fault(
            *(as_optional(load.number(field)) for field in ("power", "speed", "torque", "drag"))
        )
        if fault is not None:
            raise FileError(path, f"{place}.{fault[0]}", fault[1])
        if table.torque.get(name):
            message = f"stands beside torque.{name}; remove one of them, or give that as drag here"
            raise FileError(path, place, message)


def _require_taker(name: str, key: str, takes: bool, wheels: Wheels, path: object) -> None:
    wheels.require_known(name, key, path)
    if takes and name == wheels.driver:
        raise FileError(path, key, "the driver balances the other torques; remove this one")
    if takes and name in wheels.shaft(wheels.driver):
        message = "is on the driver's shaft, which balances the other torques; remove this one"
        raise FileError(path, key, message)


def _require_profile(profile: list[list[float]], path: object) -> None:
    """Raise `FileError` for a profile whose times do not increase."""
    key = "excitation.profile"
    if len(profile) < 2:
        raise FileError(path, key, f"found {len(profile)} times; give at least two, with speeds")
    for (before, _), (after, _) in itertools.pairwise(profile):
        if not after > before:
            raise FileError(path, key, f"found {after:g} s after {before:g} s; sort the times")


def _require_excited(file: DriveTable, wheels: Wheels, path: object) -> None:
    if file.excitation is None:
        return
    if file.excitation.profile is not None:
        _require_profile(file.excitation.profile, path)
    single = [key for key in ("crank", "order") if file.excitation.number(key) is not None]
    single += ["torque"] if file.excitation.torque else []
    if file.excitation.orders and single:
        message = "stands beside orders; remove it, or make it one of them"
        raise FileError(path, f"excitation.{single[0]}", message)
    tables = {"excitation": file.excitation.torque}
    tables |= {
        f"excitation.orders.{k}": one.torque for k, one in enumerate(file.excitation.orders, 1)
    }
    free = file.excitation.driver == "free"
    for table, torque in tables.items():
        for name in torque:
            key = f"{table}.torque.{name}"
            wheels.require_known(name, key, path)
            if name in wheels.shaft(wheels.driver) and not free:
                message = 'the driver\'s motion is given; use crank, or excitation.driver = "free"'
                raise FileError(path, key, message)
    cranks = {"excitation": file.excitation.number("crank")}
    cranks |= {
        f"excitation.orders.{k}": one.number("crank")
        for k, one in enumerate(file.excitation.orders, 1)
    }
    for table, crank in cranks.items():
        if free and crank:
            message = f"a free driver's motion is not given; use torque.{wheels.driver}"
            raise FileError(path, f"{table}.crank", message)


def operation_content(point: OperatingPoint) -> dict[str, Any]:
    """The table [operation] of an operating point."""
    torque = _by_name(point.torque)
    loads = {name: numbers_content(load) for name, load in point.load.items()}
    for name, load in loads.items():
        # In a file a torque beside a load is its drag.
        beside = torque.pop(name, 0.0)
        if beside:
            load["drag"] = load.get("drag", 0.0) + beside
    content = numbers_content(point) | {"travel": word(TRAVELS, point.travel), "torque": torque}
    return content | {"load": loads} if loads else content


def duties_content(
    point: OperatingPoint, duties: Mapping[str, OperatingPoint]
) -> list[dict[str, Any]]:
    """The tables [[duty]] beside the [operation] of `point`, from which they take nothing."""
    return [{"name": name} | _stated(duty, point) for name, duty in duties.items()]


def _stated(duty: OperatingPoint, point: OperatingPoint) -> dict[str, Any]:
    """A duty that says of every pulley what it takes, be it nothing."""
    content = operation_content(duty)
    nothing = {name: 0.0 for name in point.names_of_takers if name not in duty.load}
    return content | {"torque": nothing | content["torque"]}


def excitation_content(point: OperatingPoint) -> dict[str, Any] | None:
    """The table [excitation] of an operating point."""
    shaken = point.excitation
    if shaken is None:
        return None
    content = numbers_content(shaken) | {"torque": _by_name(shaken.torque)}
    orders = [numbers_content(one) | {"torque": _by_name(one.torque)} for one in shaken.orders]
    content = content if shaken.driver == "prescribed" else content | {"driver": shaken.driver}
    if shaken.profile is not None:
        content["profile"] = np.asarray(shaken.profile).tolist()
    return content | {"orders": orders} if orders else content


def _by_name(numbers: dict[str, Any]) -> dict[str, float]:
    return {name: float(np.asarray(value)) for name, value in numbers.items()}
