"""Every scalar number of a drive and its operating point by its key in the drive file."""

import dataclasses
import difflib
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.drive.components import concrete
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.drive.variables import unit_of, value_of, variable_names, with_values, wound_alike

TORQUE = "operation.torque."
SPEEDS = ("operation.belt_speed", "operation.driver_speed")
_FEW = ("operation.belt_speed", "belt.bending_stiffness", "installation.tension")


def number_names(drive: Drive) -> list[str]:
    """Keys of the numbers that `with_number` sets.

    Beside the design variables: inertias, friction, rims, damping, the pivot's parts, the speed of
    belt or driver (whichever the file gives, either may be set) and the accessories' torques.
    """
    names = variable_names(drive)
    names += _given("belt", drive.belt, ("thickness",))
    for pulley in drive.pulleys:
        names += _given(f"pulley.{pulley.name}", pulley, ("inertia", "friction", "rim_radius"))
    if drive.tensioner is not None:
        names += ["tensioner.pivot.x", "tensioner.pivot.y"]
        names += _given("tensioner", drive.tensioner, ("inertia", "damping"))
    torques = [TORQUE + pulley.name for pulley in drive.pulleys if _takes_torque(pulley)]
    return [*names, *SPEEDS, *torques]


def require_number(drive: Drive, name: str) -> None:
    """Raise `ValueError`, with some of the keys there are, unless `name` is one of them."""
    names = number_names(drive)
    if name in names:
        return
    close = difflib.get_close_matches(name, names, n=3)
    known = close or [key for key in _FEW if key in names] + [
        f"pulley.{drive.pulleys[0].name}.radius"
    ]
    raise ValueError(f"there is no number {name!r} to vary; give for instance {', '.join(known)}")


def unit_of_number(name: str) -> str:
    """SI unit of a number of a drive file; empty for a pure number."""
    return "N m" if name.startswith(TORQUE) else unit_of(name)


def with_number(
    drive: Drive, point: OperatingPoint, name: str, value: Float[Array, ""]
) -> tuple[Drive, OperatingPoint]:
    """The drive and its operating point with one number set [SI].

    A design variable moves what goes with it, as in `with_values`: `tensioner.angle` turns the
    tensioner about the center of its pulley, starting from 0 as drawn. A speed replaces the
    other one.
    """
    if name.startswith(TORQUE):
        torque = point.torque | {name.removeprefix(TORQUE): value}
        return drive, dataclasses.replace(point, torque=torque)
    if name in SPEEDS:
        chosen = {"belt_speed": None, "driver_speed": None, name.split(".")[1]: value}
        return drive, dataclasses.replace(point, **chosen)
    if name in variable_names(drive):
        return with_values(drive, {name: value}), point
    return _with_field(drive, name.split("."), value), point


def _given(table: str, part: Any, fields: tuple[str, ...]) -> list[str]:
    return [f"{table}.{field}" for field in fields if getattr(part, field) is not None]


def _takes_torque(pulley: Any) -> bool:
    """Whether a pulley is neither the driver, which balances torques, nor an idler on the arm.

    While JAX traces which of them it is, any pulley may take one.
    """
    flags = [concrete(flag) for flag in (pulley.driver, pulley.on_arm)]
    return all(flag is None or not flag for flag in flags)


def _with_field(drive: Drive, words: list[str], value: Float[Array, ""]) -> Drive:
    """A field that nothing else moves with; the pivot's x or y keeps the other."""
    if words[:2] == ["tensioner", "pivot"]:
        assert drive.tensioner is not None  # or the name would not be known
        pivot = drive.tensioner.pivot.at["xy".index(words[2])].set(value)
        moved = eqx.tree_at(lambda d: d.tensioner.pivot, drive, pivot)
        return wound_alike(moved, drive, jnp.zeros(()))
    if words[0] == "pulley":
        i = drive.pulley(words[1])
        return eqx.tree_at(lambda d: getattr(d.pulleys[i], words[2]), drive, value)
    return eqx.tree_at(lambda d: getattr(getattr(d, words[0]), words[1]), drive, value)


def require_numbers(drive: Drive, names: Sequence[str]) -> None:
    """Raise `ValueError` unless all `names` are numbers of this drive that may be set together."""
    for name in names:
        require_number(drive, name)
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise ValueError(f"{repeated[0]!r} is given twice; remove one of them")
    if set(SPEEDS) <= set(names):
        raise ValueError(f"{SPEEDS[0]} and {SPEEDS[1]} are one speed; give one of them")


def with_numbers(
    drive: Drive, point: OperatingPoint, values: Mapping[str, Float[Array, ""]]
) -> tuple[Drive, OperatingPoint]:
    """`with_number` for several numbers, whose order does not matter.

    The tensioner's pivot goes first, then the design variables as in `with_values`, so that the
    tensioner is turned with the pivot it was given; then the rest, rims among them.
    """
    drawn = variable_names(drive)
    pivot = [name for name in values if name.startswith("tensioner.pivot.")]
    for name in pivot:
        drive, point = with_number(drive, point, name, values[name])
    drive = with_values(drive, {name: x for name, x in values.items() if name in drawn})
    for name in sorted(set(values) - set(drawn) - set(pivot)):
        drive, point = with_number(drive, point, name, values[name])
    return drive, point


def number_value(drive: Drive, point: OperatingPoint, name: str) -> Float[Array, ""]:
    """What `with_number` would have to be given to change nothing [SI]; 0 for "tensioner.angle"."""
    words = name.split(".")
    if name.startswith(TORQUE):
        return point.torque.get(name.removeprefix(TORQUE), jnp.zeros(()))
    if name in SPEEDS:
        speed = point.speed(drive)
        return speed if name == SPEEDS[0] else speed / (drive.drives @ drive.radii)
    if name in variable_names(drive):
        return value_of(drive, name)
    if words[:2] == ["tensioner", "pivot"]:
        assert drive.tensioner is not None  # or the name would not be known
        return drive.tensioner.pivot["xy".index(words[2])]
    part = drive.pulleys[drive.pulley(words[1])] if words[0] == "pulley" else None
    return getattr(part or getattr(drive, words[0]), words[-1])
