"""The units in which a drive file gives its numbers, and from where it counts them."""

from collections.abc import Iterator
from typing import Any

from beltjax.drive.file_bodies import SINGLE
from beltjax.drive.file_inner_tables import plain_key
from beltjax.drive.file_makers_data import DIAMETERS, LENGTHS, effective_excess
from beltjax.drive.file_origin import OF_TENSIONERS, Origin
from beltjax.drive.file_plausibility import as_number, doubts
from beltjax.drive.numbers import full_key, known_keys, tensioner_key, value_of
from beltjax.drive.system import Drive
from beltjax.drive.units_of_file import UnitsOfFile
from beltjax.files.units import to_si, unit_written

# Tables of a list that go by the names of the drive's parts, which are in the same order.
_LISTED = {"belt": "belts", "isolator": "isolators", "damper": "dampers"}
_AXES = ".x", ".y"


def units_used(content: dict[str, Any], drive: Drive, origin: Origin, path: object) -> UnitsOfFile:
    """The units that are written in a file, by the keys of the drive's numbers.

    `origin` is the point of the file's coordinates from which those of the drive are counted.
    """
    known, found = known_keys(drive), {}
    bare: list[tuple[tuple[str, ...], str | None, float]] = []
    for words, value in _leaves(content, (), drive):
        full = [full_key(drive, key) for key in _keys(words, content)]
        keys, number = [key for key in full if key in known], as_number(value)
        if number is not None:
            bare.append((words, next(iter(keys), None), number))
        elif unit_written(value):
            found |= dict.fromkeys(keys, unit_written(value))
    moved = zip(_AXES, origin, strict=True)
    shifts = {
        key: shift for end, shift in moved if shift for key in known if _is_coordinate(key, end)
    }
    shifts |= {key: -excess for key, excess in effective_excess(content, path).items()}
    shifts |= _preloads_at_angles(content, drive, known)
    return UnitsOfFile(found, shifts, doubts(bare, drive))


def _preloads_at_angles(content: dict[str, Any], drive: Drive, known: set[str]) -> dict[str, float]:
    """What preloads `at_angle` are more than in the drawn position [N m], by their `known` keys."""
    tables = content.get("tensioner", [])
    found = {}
    for table in tables if isinstance(tables, list) else [tables]:
        if "at_angle" in table:
            place = drive.body(table.get("name", SINGLE))
            key = f"{tensioner_key(drive, place)}.preload"
            if key in known:
                found[key] = to_si(table["preload"], "N m") - float(value_of(drive, key))
    return found


def _is_coordinate(key: str, end: str) -> bool:
    """Whether a key is that of one coordinate of a point of the drawing."""
    point = key.removesuffix(end).rpartition(".")[2]
    table = key.partition(".")[0]
    points = {"pulley": ("center",), "tensioner": OF_TENSIONERS}
    return key.endswith(end) and point in points.get(table, ())


def _leaves(
    value: Any, words: tuple[str, ...], drive: Drive
) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Words of the key of each single value, and the value; listed tables go by names."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _leaves(item, (*words, key), drive)
    elif isinstance(value, list):
        for place, item in enumerate(value):
            label = str(place)
            if isinstance(item, dict):
                parts = getattr(drive, _LISTED.get(words[0], ""), ())
                label = parts[place].name if parts else item.get("name", "tensioner")
            yield from _leaves(item, (*words, label), drive)
    else:
        yield words, value


def _keys(words: tuple[str, ...], content: dict[str, Any]) -> list[str]:
    """Keys of the numbers that are given at one place of a file."""
    if words[0] == "tensioner" and words[1] in _twins(content):
        return _keys_of_twin(words)
    if words[:2] == ("installation", "until"):
        return ["installation.until"]
    if words[0] == "duty":  # a number of the operation
        words = ("operation", *words[2:])
    if words[:2] == ("operation", "load"):
        return [".".join(words[:4])]  # a list has the unit of its items
    if words[0] == "pulley" and words[-1] in DIAMETERS:
        words = (*words[:-1], "radius")
    words = plain_key(words)
    if words[0] == "tensioner" and words[-1] == "preload":
        return [".".join(words), ".".join((*words[:-1], "force"))]
    if words[:2] == ("installation", "belt_length") and words[-1] in LENGTHS:
        words = words[:-1]
    if words[-1] in ("0", "1"):
        words = (*words[:-1], "xy"[int(words[-1])])
    return [".".join(words)]


def _twins(content: dict[str, Any]) -> list[str]:
    tables = content["tensioner"] if isinstance(content["tensioner"], list) else []
    return [table.get("name", "tensioner") for table in tables if table.get("kind") == "twin-arm"]


def _keys_of_twin(words: tuple[str, ...]) -> list[str]:
    """Keys of numbers of two tensioners and a spring, from a key of the table of a twin arm."""
    _, name, field, *rest = words
    if not rest:
        return [f"arm_spring.{name}.{field}"]
    if field == "pivot":
        return [f"tensioner.{name}.{arm}.pivot.{'xy'[int(rest[0])]}" for arm in (0, 1)]
    return [f"tensioner.{name}.{rest[0]}.{field.removeprefix('ground_')}"]
