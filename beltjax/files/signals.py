"""Signals over time from files of comma-separated values, whose heads name units."""

import csv
import io
import math
import os
import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from beltjax.files.errors import FileError
from beltjax.files.reading import read_file
from beltjax.files.units import shown, si_of_text

_LARGEST = 16 * 1024 * 1024  # bytes
_HEAD = re.compile(r"\s*(\w+)\s*(?:[\[(]\s*([^\])]*?)\s*[\])])?\s*")
_REMEDY = 'give a table of two columns, headed such as "time (s),speed (rpm)"'


class Signal(NamedTuple):
    """A quantity over time, in SI."""

    times: Float[np.ndarray, " points"]
    name: str
    values: Float[np.ndarray, " points"]


def read_signal(path: str | os.PathLike[str], units: Mapping[str, str], fewest: int) -> Signal:
    """The signal of a CSV file: times that increase, and one of the quantities in `units` [SI].

    The first line heads both columns, with a unit in brackets where they are not SI. Raises
    `FileError`, which names the line.
    """
    try:
        text = read_file(path, _LARGEST, _REMEDY).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(path, "", "is not UTF-8 text; save it as UTF-8") from error
    try:
        rows = [row for row in csv.reader(io.StringIO(text)) if any(map(str.strip, row))]
    except csv.Error as error:
        raise FileError(path, "", f"is no CSV file: {error}; {_REMEDY}") from error
    heads = [_head(path, cell) for cell in rows[0]] if rows else []
    names = [name for name, _ in heads]
    known = " or ".join(units)
    if len(heads) != 2 or names[0] != "time" or names[1] not in units:
        found = shown(",".join(rows[0])) if rows else "nothing"
        raise FileError(path, "", f"line 1: found {found}; head two columns time and {known}")
    factors = []
    for (name, unit), si in zip(heads, ("s", units[names[1]]), strict=True):
        try:
            factors.append(si_of_text(f"1 {unit}", si) if unit else 1.0)
        except ValueError as error:
            raise FileError(path, "", f"line 1: {name}: {error}") from error
    table = np.array([_numbers(path, k, row) for k, row in enumerate(rows[1:], start=2)])
    if len(table) < fewest:
        raise FileError(path, "", f"found {len(table)} rows; give at least {fewest}")
    times, values = (table * factors).T
    back = np.flatnonzero(np.diff(times) <= 0)
    if len(back):
        message = (
            f"row {back[0] + 3}: the time {times[back[0] + 1]:g} s is not after the one before"
        )
        raise FileError(path, "", f"{message}; sort the rows")
    return Signal(times, names[1], values)


def _head(path: str | os.PathLike[str], cell: str) -> tuple[str, str]:
    """Name and unit of a column."""
    found = _HEAD.fullmatch(cell)
    if not found:
        raise FileError(path, "", f"line 1: found {shown(cell)}; {_REMEDY}")
    return found[1].lower(), found[2] or ""


def _numbers(path: str | os.PathLike[str], line: int, row: list[str]) -> list[float]:
    """The two numbers of a row."""
    try:
        numbers = [float(cell) for cell in row]
    except ValueError:
        numbers = []
    if len(numbers) != 2 or not all(map(math.isfinite, numbers)):
        raise FileError(
            path, "", f"row {line}: found {shown(','.join(row))}; give a time and a number"
        )
    return numbers
