"""Arguments of commands: drive files, and text for ranges of numbers, amplitudes, orders."""

import os
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np
from jaxtyping import Float

from beltjax.drive.files import load_runs
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.files.units import si_of_text

Value = TypeVar("Value")
_MOST_POINTS = 100_000


class Asked(NamedTuple):
    """The drive of a file, and the operating point at which a command answers."""

    drive: Drive
    point: OperatingPoint
    at: str  # its name; empty where the file has no duties


def titled(document: dict[str, Any]) -> str:
    """The name of a document's drive, and where the file has several the operating point."""
    return document["drive"] + (f" at {document['at']}" if document["at"] else "")


def read_drive(path: str | os.PathLike[str], duty: str | None = None) -> Asked:
    """The drive of a file, and the operating point of its [operation] or of the duty named.

    Raises `FileError` as `load_drive` does, and for a duty that the file does not have.
    """
    drive, runs = load_runs(path)
    if duty is None:
        own = next((name for name, point in runs.duties.items() if point is runs.point), None)
        at = f"duty {own}" if own else "[operation]" if runs.duties else ""
        return Asked(drive, runs.point, at)
    if duty not in runs.duties:
        known = f"give one of {', '.join(runs.duties)}" if runs.duties else "it has no [[duty]]"
        raise FileError("--duty", "", f"there is no duty {duty!r} in {path}; {known}")
    return Asked(drive, runs.duties[duty], f"duty {duty}")


def read_option(option: str, read: Callable[[], Value]) -> Value:
    """The value that `read` makes of an option; raises `FileError`, which names the option."""
    try:
        return read()
    except ValueError as error:
        raise FileError(option, "", str(error).rstrip(".")) from error


def read_range(text: str, unit: str, fewest: int = 2) -> Float[np.ndarray, " points"]:
    """Values [SI] of "0:60:121" or "600 rpm:6000 rpm:200": from, to, and how many.

    Raises `ValueError` that says what was found and what to give.
    """
    parts = text.split(":")
    if len(parts) != 3:
        raise ValueError(f"found {text!r}; give FROM:TO:POINTS, such as 0:60:121")
    lower, upper = _ends(text, parts[:2], unit)
    count = parts[2].strip()
    if not (count.isascii() and count.isdecimal() and len(count) < 20):
        raise ValueError(f"found {parts[2]!r} points in {text!r}; give a whole number")
    points = int(count)
    if not fewest <= points <= _MOST_POINTS:
        raise ValueError(f"found {points} points in {text!r}; give {fewest} to {_MOST_POINTS}")
    return np.linspace(lower, upper, points)


def read_interval(text: str, unit: str) -> tuple[float, float]:
    """Ends [SI] of "0:60" or "600 rpm:6000 rpm"."""
    parts = text.split(":")
    if len(parts) != 2:
        raise ValueError(f"found {text!r}; give FROM:TO, such as 0:60")
    return _ends(text, parts, unit)


def _ends(text: str, parts: list[str], unit: str) -> tuple[float, float]:
    lower, upper = (si_of_text(part, unit) for part in parts)
    if not lower < upper:
        raise ValueError(f"found {text!r}; give a range that ends above where it begins")
    return lower, upper


def read_named(text: str, example: str) -> tuple[str, str]:
    """The two sides of "NAME=REST"."""
    name, equals, rest = text.partition("=")
    if not equals or not name.strip() or not rest.strip():
        raise ValueError(f"found {text!r}; give {example}")
    return name.strip(), rest.strip()


def read_amplitude(text: str, unit: str) -> float:
    """An amplitude [SI], zero to peak; its sign would be a phase."""
    amplitude = si_of_text(text, unit)
    if amplitude < 0:
        raise ValueError(f"found {text!r}; an amplitude is not negative")
    return amplitude


def read_size(text: str, unit: str) -> float:
    """The size of a tolerance [SI]."""
    size = si_of_text(text, unit)
    if not size > 0:
        raise ValueError(f"found {text!r}; a tolerance is positive")
    return size


def read_orders(text: str) -> tuple[float, ...]:
    """Orders of excitation, "2,4"."""
    orders = tuple(si_of_text(part, "") for part in text.split(","))
    if not all(order > 0 for order in orders):
        raise ValueError(f"found {text!r}; give positive orders, such as 2,4")
    return orders


def read_excited_orders(text: str) -> dict[float, complex]:
    """Complex amplitudes [rad] by order, of "2=0.2 deg,4=0.05 deg@1 rad"."""
    example = 'ORDER=AMPLITUDE or ORDER=AMPLITUDE@PHASE, such as "2=0.2 deg,4=0.05 deg@1 rad"'
    found: dict[float, complex] = {}
    for part in text.split(","):
        order, size = read_named(part, example)
        amplitude, at, phase = size.partition("@")
        place = si_of_text(order, "")
        if place in found:
            raise ValueError(f"found order {place:g} twice; remove one of them")
        angle = si_of_text(phase, "rad") if at else 0.0
        found[place] = read_amplitude(amplitude, "rad") * complex(np.exp(1j * angle))
    return found


def read_points(text: str, unit: str, count: int) -> Float[np.ndarray, " points"]:
    """Values [SI] of "2000 rpm", of "600 rpm:6000 rpm" (`count` of them), or of `read_range`."""
    if ":" not in text:
        return np.array([si_of_text(text, unit)])
    return read_range(text if text.count(":") > 1 else f"{text}:{count}", unit)
