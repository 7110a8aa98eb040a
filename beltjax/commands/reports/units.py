"""The units of tables: those in which a drive's file gives its numbers, or SI."""

import math
from collections import Counter

from beltjax.drive.file_makers_data import belt_length_key, standard_lengths_key
from beltjax.drive.installation import BELT_LENGTH
from beltjax.drive.numbers import fact_of, full_key, shift_of
from beltjax.drive.system import Drive
from beltjax.files.units import in_unit

# What people read where a file is silent.
_USUAL = {"m": "mm", "rad": "deg", "rad/s": "rpm"}
# What a file may give in place of one quantity: what balances tensions, what belts lie along.
_IN_PLACE = {"": "force of a spring", BELT_LENGTH: ""}
_DIGITS, _SMALL = 6, 1e-3  # of a number, which counts as this large [m] where it is shifted


class TableUnits:
    """In which unit a table shows numbers that are SI in the JSON document.

    A result has the unit in which the file gives most numbers of that quantity: tensions that of
    tensions, and not that of EA. A number of the file has the unit that it has there, and is
    counted from where the file counts it.
    """

    def __init__(self, drive: Drive, si: bool = False):
        self._drive, self._si = drive, si
        counts: dict[tuple[str, str], Counter[str]] = {}
        for key, unit in drive.units.items():
            fact, kind = fact_of(drive, key)
            counts.setdefault((fact.unit_for(kind), fact.quantity), Counter())[unit] += 1
        self._given = {what: found.most_common(1)[0][0] for what, found in counts.items()}

    def name(self, si: str, quantity: str = "") -> str:
        """The unit shown for numbers in the unit `si`; empty for pure numbers.

        `quantity` is what they measure where `Number.quantity` tells several of that unit apart.
        """
        if self._si:
            return si
        if (si, quantity) in self._given:
            return self._given[si, quantity]
        if quantity in _IN_PLACE:
            return self.name(si, _IN_PLACE[quantity])
        return _USUAL.get(si, si)

    def head(self, label: str, si: str, quantity: str = "") -> str:
        """Head of a column: what it holds and in which unit."""
        return f"{label} ({self.name(si, quantity)})"

    def value(self, value: float, si: str, quantity: str = "") -> float:
        """A value in the unit `si`, in the unit shown."""
        return in_unit(value, si, self.name(si, quantity))

    def text(self, value: float | None, si: str, decimals: int, quantity: str = "") -> str:
        """A value in the unit shown, or a dash; `decimals` are those of the usual unit."""
        if value is None:
            return "-"
        units = _USUAL.get(si, si), self.name(si, quantity)
        usual, shown = (in_unit(1.0, si, unit) for unit in units)
        digits = max(decimals - round(math.log10(shown / usual)), 0)
        return f"{self.value(value, si, quantity):.{digits}f}"

    def unit_of_number(self, name: str) -> tuple[float, str]:
        """What a difference of 1 [SI] in a number of the drive is in its unit, and that unit."""
        fact, kind = fact_of(self._drive, name)
        si, key = fact.unit_for(kind), full_key(self._drive, name)
        usual = self.name(si, fact.quantity)
        unit = si if self._si else self._drive.units.get(key, usual)
        return in_unit(1.0, si, unit), unit

    def of_number(self, name: str, value: float) -> tuple[str, str]:
        """A number of the drive [SI] as its file counts it, as text, and its unit.

        Beside a large shift it has the digits that the drive's own number has.
        """
        factor, unit = self.unit_of_number(name)
        shift = shift_of(self._drive, name)
        more = math.log10(1 + abs(shift) / max(abs(value), _SMALL))
        return f"{factor * (value + shift):.{min(_DIGITS + math.ceil(more), 15)}g}", unit

    def is_effective(self, belt: str) -> bool:
        """Whether the file gives lengths of this belt along its effective line."""
        keys = belt_length_key, standard_lengths_key
        single = len(self._drive.belts) == 1
        return any(key(belt, single) in self._drive.units.shifts for key in keys)

    def of_quantity(self, value: float, si: str) -> tuple[float, str]:
        """A value of a study's quantity with this SI unit, and the unit in which it is shown."""
        # What quantities measure in rad/s are frequencies of vibration.
        if si == "rad/s" and not self._si:
            return value / (2 * math.pi), "Hz"
        return self.value(value, si), self.name(si)
