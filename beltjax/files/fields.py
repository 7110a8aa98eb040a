"""What each number of a drive is: its unit, its bounds, and what it means.

These facts stand once, as metadata of the field that holds the number. Drive files, keys of
numbers, tables and the documentation are derived from them.
"""

import dataclasses
import functools
import typing
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

_METADATA = "number"


class Number(NamedTuple):
    """The facts about a number, or about each number of an array."""

    unit: str | Mapping[str, str]  # SI; by the owner's kind where that decides
    doc: str  # what the number means, for the documentation
    above: float | None = None  # it is greater than this
    at_least: float | None = None  # it is not less than this
    largest_bare: float | None = None  # larger ones are written with their unit
    unbounded: bool = False  # it may be infinite
    design: bool = False  # an optimizer may choose it
    rare: bool = False  # listings leave it out where it has its default, of a `design` number, too
    parts: tuple[str, ...] = ()  # what the numbers of a vector are called
    kinds: tuple[str, ...] = ()  # of owners to which it means something; of all where empty
    # What it measures, where results in its unit are something else and have units of their own.
    quantity: str = ""
    beside: str | None = None  # another number without which it means nothing
    shape: tuple[int, ...] = ()  # as far as it is fixed
    rank: int = 0
    optional: bool = False  # it may be absent
    required: bool = False  # the field has no default

    def unit_for(self, kind: str | None = None) -> str:
        """The SI unit, of an owner of this kind."""
        if isinstance(self.unit, str):
            return self.unit
        return self.unit[kind or next(iter(self.unit))]


def number(unit: str | Mapping[str, str], doc: str, **facts: Any) -> dict[str, Number]:
    """Metadata of a field that holds a number, or an array of numbers, in this unit."""
    return {_METADATA: Number(unit, doc, **facts)}


@functools.cache
def numbers(kind: type) -> Mapping[str, Number]:
    """The numbers that an object of a class holds, by the names of the fields."""
    found = {}
    for field in dataclasses.fields(kind):
        if _METADATA in field.metadata:
            optional, shape, rank = _shape(field.type)
            missing = dataclasses.MISSING
            found[field.name] = field.metadata[_METADATA]._replace(
                shape=shape,
                rank=rank,
                optional=optional,
                required=field.default is missing and field.default_factory is missing,
            )
    return MappingProxyType(found)


def _shape(annotation: Any) -> tuple[bool, tuple[int, ...], int]:
    """Whether an annotation allows None, the fixed shape that it asks of an array, and the rank."""
    kinds = typing.get_args(annotation) or (annotation,)
    sizes = getattr(kinds[0], "dim_str", "").split()
    fixed = tuple(int(size) for size in sizes if size.isdecimal())
    return type(None) in kinds, fixed, len([size for size in sizes if size[0] != "*"])
