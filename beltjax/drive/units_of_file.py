"""The units in which a drive file gave its numbers, and from where it counted them."""

from collections.abc import Iterator, Mapping


class UnitsOfFile(Mapping[str, str]):
    """Units by the keys of numbers; a number without a unit here is in SI.

    A file may count a number from elsewhere than the drive does: coordinates from the origin of a
    site, the length of a belt along its effective line, a preload at another angle. `shifts` are
    the file's numbers less the drive's [SI], by keys. `doubts` ask in words whether bare numbers
    are meant in SI.

    All instances are equal, so that units never distinguish compiled programs or the structures of
    drives: the unit in which a number is shown is not part of its value. A program that returns a
    drive gives it the units of the drive for which it was compiled.
    """

    def __init__(
        self,
        units: Mapping[str, str] | None = None,
        shifts: Mapping[str, float] | None = None,
        doubts: tuple[str, ...] = (),
    ):
        self._units, self.shifts, self.doubts = dict(units or {}), dict(shifts or {}), doubts

    def __getitem__(self, key: str) -> str:
        return self._units[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._units)

    def __len__(self) -> int:
        return len(self._units)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, UnitsOfFile)

    def __hash__(self) -> int:
        return hash(UnitsOfFile)

    def __repr__(self) -> str:
        return f"UnitsOfFile({self._units}, {self.shifts})"
