"""Bare numbers of a drive file that are hardly meant in SI units, which bare numbers have.

They are taken as they stand, with a warning: 750 for a speed is 750 rad/s, and most who write it
mean rpm. A unit, be it that of SI, says what is meant.
"""

import math
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from beltjax.drive.components import COORDINATE
from beltjax.drive.numbers import fact_of, kind_of
from beltjax.drive.system import Drive
from beltjax.files.units import in_unit


class _Ordinary(NamedTuple):
    """The sizes that bare numbers of a kind have, and the unit in which others are often given."""

    meant: str
    least: float = 0.0
    most: float = math.inf
    whole: float = math.inf  # the largest whole number: those of other units mostly are whole


class _Bare(NamedTuple):
    """A bare number of a file."""

    label: str  # its key, as the file has it
    value: float
    unit: str  # SI
    ordinary: _Ordinary


# By units. Speeds of rotation end at 20000 rpm, belt speeds above the fastest in the literature;
# moments, inertias and masses end with the largest drives whose numbers go without a unit, and
# angles after two turns.
_BY_UNIT = {
    "rad/s": _Ordinary("rpm", most=2100.0, whole=500.0),
    "rad": _Ordinary("deg", most=4 * math.pi, whole=2 * math.pi),
    "m/s": _Ordinary("m/min", most=250.0),
    "W": _Ordinary("kW", least=50.0),
    "N m": _Ordinary("N mm", most=1e4),
    "N m^2": _Ordinary("N mm^2", most=100.0),
    "kg/m": _Ordinary("g/m", most=100.0),
    "kg m^2": _Ordinary("kg mm^2", most=200.0),
    "N m/rad": _Ordinary("N m/deg", least=0.5),
    "N/m": _Ordinary("N/mm", least=20.0),
    "N": _Ordinary("kN", least=1.0),
}
# By the last word of keys, where the unit does not decide.
_BY_WORD = {
    "axial_stiffness": _Ordinary("kN", least=500.0),
    "speed": _Ordinary("rpm", most=3000.0, whole=2000.0),  # of an accessory
    "friction": _Ordinary("%", most=3.0),
    "friction_static": _Ordinary("%", most=3.0),
    "offset": _Ordinary("mm", most=0.1),
    "thickness": _Ordinary("mm", most=0.1),
    "pitch": _Ordinary("mm", most=0.2),
    "pitch_offset": _Ordinary("mm", most=0.05),
    "back_offset": _Ordinary("mm", most=0.05),
}
# Units of keys that are no numbers of the drive, by their last words.
_UNITS = dict.fromkeys(("pitch", "pitch_offset", "back_offset"), "m") | {"at_angle": "rad"}
_USUAL = {"rad/s": "rpm", "rad": "deg"}  # in which people know a speed or an angle
_LONGEST = 300.0  # of a span, in radii of the smallest pulley
_MOST = 3  # numbers in one warning


def doubts(
    bare: Iterable[tuple[tuple[str, ...], str | None, float]], drive: Drive
) -> tuple[str, ...]:
    """What to ask about bare numbers, in words.

    `bare` has the words of the place of each in its file, its key in the drive, if it is a number
    of the drive, and the number.
    """
    given = [_bare(*one, drive) for one in bare]
    odd = [one for one in given if one is not None and _is_odd(one)]
    centers = [*_far_centers(drive)] if any(_is_center(words) for words, _, _ in bare) else []
    return (*(_question(one) for one in odd[:_MOST]), *centers)


def _bare(words: tuple[str, ...], key: str | None, value: float, drive: Drive) -> _Bare | None:
    word = next((word for word in reversed(words) if not word.isdecimal()), "")
    unit = _UNITS.get(word)
    if word == "stops":  # a pair, whose parts have no keys in the drive
        bodies = [body for body in drive.tensioners if body.name in words] or drive.tensioners
        unit = COORDINATE[kind_of(bodies[0]) or "rotary"]
    if key is not None:
        fact, kind = fact_of(drive, key)
        unit = fact.unit_for(kind)
    ordinary = _BY_WORD.get(word) or _BY_UNIT.get(unit or "")
    if word == "stops" and unit == "m":
        ordinary = _Ordinary("mm", most=5.0)
    if unit is None or ordinary is None:
        return None
    return _Bare(".".join(words), value, unit, ordinary)


def _is_odd(one: _Bare) -> bool:
    size, (_, least, most, whole) = abs(one.value), one.ordinary
    return size > most or 0 < size < least or (size > whole and float(size).is_integer())


def _question(one: _Bare) -> str:
    usual = _USUAL.get(one.unit)
    also = f", which is {in_unit(one.value, one.unit, usual):.6g} {usual}" if usual else ""
    unit = one.unit or "1"
    own = f', or "{one.value:.10g} {unit}"' if one.unit else ""
    return (
        f"{one.label} = {one.value:.10g} has no unit and is read in {unit}{also}: write "
        f'"{one.value:.10g} {one.ordinary.meant}" if that is meant{own}'
    )


def _is_center(words: tuple[str, ...]) -> bool:
    return len(words) > 1 and words[-2] == "center"


def _far_centers(drive: Drive) -> Iterator[str]:
    """Asks about centers that lie apart as if millimeters were meters."""
    centers = np.array([pulley.center for pulley in drive.pulleys])
    smallest = min(float(pulley.radius) for pulley in drive.pulleys)
    farthest = float(np.max(np.hypot(*(centers[:, None] - centers).T)))
    if farthest > _LONGEST * smallest:
        yield (
            f"pulley centers without a unit are read in m and lie {farthest:.4g} m apart, beside a "
            f'radius of {smallest:.4g} m: write "... mm" if that is meant, or "... m"'
        )


def as_number(value: Any) -> float | None:
    """A bare number; None for what is none."""
    return float(value) if type(value) in (int, float) and math.isfinite(value) else None
