"""What ties numbers to variables, and what variables may be in the end, in a study file."""

import math
from typing import Any

import jax.numpy as jnp

from beltjax.drive.numbers import (
    full_key,
    is_relative,
    shift_of,
    unit_of,
    value_of,
    variable_names,
)
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.files.tables import Table

from .operating_points import SiOrText, number_of, number_of_drive
from .study import Limits, Snap, Ties

_LOOSE = 1e-6  # of a variable's range: a tie that the drive does not keep better is refused


class TieTable(Table):
    """[[tie]]."""

    name: str
    to: str
    factor: float | int = 1.0
    offset: SiOrText | None = None
    mirror: SiOrText | None = None


def read_ties(tables: list[TieTable], variables: Limits, drive: Drive, path: object) -> Ties | None:
    """The numbers that follow from variables; raises `FileError`."""
    if not tables:
        return None
    taken = {full_key(drive, name): "is a variable" for name in variables.names}
    factors, offsets = [], []
    for table in tables:
        key = f"tie.{table.name}"
        full = full_key(drive, table.name)
        if table.name not in variable_names(drive):
            message = "is not a number of this drive that a study may change; give one by its key"
            raise FileError(path, key, message)
        if full in taken:
            raise FileError(path, key, f"{taken[full]}; a tied number follows one variable")
        if table.to not in variables.names:
            known = ", ".join(variables.names)
            message = f"found {table.to!r}, which is no [[variable]]; give one of {known}"
            raise FileError(path, f"{key}.to", message)
        factor, offset = _factors(table, drive, key, path)
        # The line holds for the numbers as the file counts them.
        offset += factor * shift_of(drive, table.to) - shift_of(drive, table.name)
        _require_kept(table, (factor, offset), variables, drive, path)
        taken[full] = "is tied twice"
        factors.append(factor)
        offsets.append(offset)
    names = tuple(table.name for table in tables)
    to = tuple(table.to for table in tables)
    return Ties(names, to, jnp.array(factors), jnp.array(offsets))


def _factors(table: TieTable, drive: Drive, key: str, path: object) -> tuple[float, float]:
    """Factor and offset [SI] of a tie; a mirror turns the number over."""
    unit, of_variable = unit_of(drive, table.name), unit_of(drive, table.to)
    if unit != of_variable:
        message = f"is in {of_variable or 'no unit'}, and the tied number in {unit or 'no unit'}"
        raise FileError(path, f"{key}.to", f"{message}; tie numbers of one kind")
    if table.mirror is not None:
        if table.offset is not None or table.factor != 1.0:
            message = "takes the place of factor and offset; remove it or these"
            raise FileError(path, f"{key}.mirror", message)
        return -1.0, 2 * number_of(table.mirror, unit, path, f"{key}.mirror")
    if not (math.isfinite(table.factor) and table.factor):
        raise FileError(path, f"{key}.factor", f"found {table.factor}; give a number other than 0")
    offset = 0.0 if table.offset is None else number_of(table.offset, unit, path, f"{key}.offset")
    return float(table.factor), offset


def _require_kept(
    table: TieTable, line: tuple[float, float], variables: Limits, drive: Drive, path: object
) -> None:
    """Raise `FileError` where the study's own drive does not keep a tie."""
    (factor, offset), place = line, variables.names.index(table.to)
    size = abs(factor) * float(variables.upper[place] - variables.lower[place])
    wanted = factor * float(value_of(drive, table.to)) + offset
    own = float(value_of(drive, table.name))
    if abs(own - wanted) > _LOOSE * size:
        shift = shift_of(drive, table.name)
        message = f"the drive has {own + shift:.9g}, and by this tie it would have "
        message += f"{wanted + shift:.9g}"
        raise FileError(path, f"tie.{table.name}", f"{message}; change the drive or the tie")


def read_snap(name: str, given: Any, variables: Limits, drive: Drive, path: object) -> Snap:
    """The values that one variable may have in the end; raises `FileError`."""
    key = f"variable.{name}.snap"
    if is_relative(name):
        raise FileError(path, key, "is of a number that counts from the drawn one; remove it")
    place = variables.names.index(name)
    lower, upper = float(variables.lower[place]), float(variables.upper[place])
    if isinstance(given, str):
        values = _on_sale(given, name, (lower, upper), drive, key, path)
    else:
        values = [number_of_drive(drive, name, v, path, f"{key}[{i}]") for i, v in enumerate(given)]
    inside = sorted({value for value in values if lower <= value <= upper})
    if not inside:
        raise FileError(path, key, "has no value within the variable's bounds; widen them")
    return Snap(name, tuple(inside))


def _on_sale(
    word: str, name: str, bounds: tuple[float, float], drive: Drive, key: str, path: object
) -> list[float]:
    """Radii of whole numbers of teeth, or standard lengths of a belt [m]."""
    words = full_key(drive, name).split(".")
    if word == "teeth" and words[0] == "pulley" and words[-1] == "radius":
        belt = drive.belts[int(drive.belt_of_span[drive.pulley(words[1])])]
        if belt.pitch is None:
            raise FileError(path, key, f"belt {belt.name!r} has no teeth; give it a pitch")
        return _multiples(belt.pitch / (2 * math.pi), bounds)
    if word == "standard" and words[:2] == ["installation", "belt_length"]:
        belt = next((belt for belt in drive.belts if belt.name == words[-1]), drive.belts[0])
        if belt.standard_lengths or belt.pitch is None:
            if belt.standard_lengths:
                return list(belt.standard_lengths)
            message = f"belt {belt.name!r} has no standard_lengths; list them in the drive file"
            raise FileError(path, key, message)
        return _multiples(belt.pitch, bounds)
    message = (
        f'found {word!r}; give "teeth" for the radius of a pulley, "standard" for '
        "installation.belt_length, or a list of values"
    )
    raise FileError(path, key, message)


def _multiples(step: float, bounds: tuple[float, float]) -> list[float]:
    first, last = math.ceil(bounds[0] / step - 1e-9), math.floor(bounds[1] / step + 1e-9)
    return [count * step for count in range(max(first, 1), min(last, first + 10_000) + 1)]
