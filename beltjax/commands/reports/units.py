"""The units of tables: those in which a drive's file gives its numbers, or SI."""

import math
from collections import Counter

from beltjax.drive.numbers import full_key, unit_of
from beltjax.drive.system import Drive
from beltjax.files.units import in_unit

# What people read where a file is silent.
_USUAL = {"m": "mm", "rad": "deg", "rad/s": "rpm"}


class TableUnits:
    """In which unit a table shows numbers that are SI in the JSON document.

    A result has the unit in which the file gives most numbers of its kind, and a number of the file
    the unit that it has there.
    """

    def __init__(self, drive: Drive, si: bool = False):
        self._drive, self._si = drive, si
        counts: dict[str, Counter[str]] = {}
        for key, unit in drive.units.items():
            counts.setdefault(unit_of(drive, key), Counter())[unit] += 1
        given = {kind: found.most_common(1)[0][0] for kind, found in counts.items()}
        self._names = {} if si else _USUAL | given

    def name(self, si: str) -> str:
        """The unit shown for numbers in the unit `si`; empty for pure numbers."""
        return self._names.get(si, si)

    def head(self, label: str, si: str) -> str:
        """Head of a column: what it holds and in which unit."""
        return f"{label} ({self.name(si)})"

    def value(self, value: float, si: str) -> float:
        """A value in the unit `si`, in the unit shown."""
        return in_unit(value, si, self.name(si))

    def text(self, value: float | None, si: str, decimals: int) -> str:
        """A value in the unit shown, or a dash; `decimals` are those of the usual unit."""
        if value is None:
            return "-"
        usual, shown = (in_unit(1.0, si, unit) for unit in (_USUAL.get(si, si), self.name(si)))
        digits = max(decimals - round(math.log10(shown / usual)), 0)
        return f"{self.value(value, si):.{digits}f}"

    def of_number(self, name: str, value: float) -> tuple[float, str]:
        """A value [SI] of a number of the drive, and the unit in which it is shown."""
        si = unit_of(self._drive, name)
        unit = si if self._si else self._drive.units.get(full_key(self._drive, name), self.name(si))
        return in_unit(value, si, unit), unit

    def of_quantity(self, value: float, si: str) -> tuple[float, str]:
        """A value of a study's quantity with this SI unit, and the unit in which it is shown."""
        # What quantities measure in rad/s are frequencies of vibration.
        if si == "rad/s" and not self._si:
            return value / (2 * math.pi), "Hz"
        return self.value(value, si), self.name(si)
