"""The units in which a drive file gave its numbers, kept for tables."""

from collections.abc import Iterator, Mapping


class UnitsOfFile(Mapping[str, str]):
    """Units by the keys of numbers; those that are not here are SI.

    All are equal, so that they never tell one compiled program, or the structure of one drive, from
    another: in which unit a number is shown is no part of what it is. A program that returns a
    drive gives it the units of the one that it was compiled for.
    """

    def __init__(self, units: Mapping[str, str] | None = None):
        self._units = dict(units or {})

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
        return f"UnitsOfFile({self._units})"
