"""Diameters and lengths as makers of belts and pulleys print them, in a drive file.

A drive has the radius to the belt's neutral axis. Makers print diameters: to the neutral axis of
the belt (pitch diameter), to the effective line of a grooved pulley, or of the smooth face under
the back of the belt. They print belt lengths along the effective line or along the neutral axis,
and of toothed belts and their pulleys the numbers of teeth.
"""

import json
import math
from collections.abc import Iterator
from typing import Any

from beltjax.drive.components import LARGEST_BARE_RADIUS
from beltjax.files.errors import FileError
from beltjax.files.tables import require_moderate
from beltjax.files.units import shown, to_si

# Keys of a pulley that stand for its radius, and the key of its belt that says how far the belt's
# neutral axis lies outside of that diameter.
DIAMETERS = {
    "diameter": None,
    "effective_diameter": "pitch_offset",
    "smooth_diameter": "back_offset",
}
OFFSETS = ("pitch_offset", "back_offset")
_FACES = {"effective_diameter": "grooved", "smooth_diameter": "back"}
LENGTHS = ("effective", "pitch", "teeth")


def in_terms_of_the_drive(content: dict[str, Any], path: object) -> dict[str, Any]:
    """`content` with radii and belt lengths in place of what makers print.

    Raises `FileError` for a radius that is given twice, and for an offset that is missing. What is
    no table or no list is left for the file's own rules to refuse.
    """
    named = [(table.get("name", "belt"), table) for table in _tables(content.get("belt"))]
    belts = {name: table for name, table in named if isinstance(name, str)}
    plain = dict(content)
    if isinstance(content.get("pulley"), list):
        plain["pulley"] = [_pulley(table, belts, path) for table in content["pulley"]]
    rule = content.get("installation")
    if isinstance(rule, dict) and "belt_length" in rule:
        plain["installation"] = rule | {"belt_length": _lengths(rule["belt_length"], belts, path)}
    if isinstance(content.get("belt"), list):
        plain["belt"] = [_belt(table, path) for table in content["belt"]]
    elif "belt" in content:
        plain["belt"] = _belt(content["belt"], path)
    return plain


def pitch_offsets(content: dict[str, Any], path: object) -> dict[str, float]:
    """How far [m] the neutral axis lies outside of the effective line of the belts that say it."""
    return {
        table.get("name", "belt"): _of_belt(table, OFFSETS[0], path)
        for table in _tables(content.get("belt"))
        if OFFSETS[0] in table
    }


def effective_excess(content: dict[str, Any], path: object) -> dict[str, float]:
    """How much longer [m] along the neutral axis belts are than the file says, by the keys.

    They are those whose lengths it gives along the effective line: `belt_length_key` and
    `standard_lengths_key`.
    """
    tables = {table.get("name", "belt"): table for table in _tables(content.get("belt"))}
    rule, single = content.get("installation", {}), len(tables) == 1
    lengths = rule.get("belt_length") if isinstance(rule, dict) else None
    found: dict[str, float] = {}
    for name, offset in pitch_offsets(content, path).items():
        named = lengths if isinstance(lengths, dict) else {}
        given = {
            belt_length_key(name, single): named.get(name, named),
            standard_lengths_key(name, single): tables[name].get("standard_lengths"),
        }
        effective = [k for k, v in given.items() if isinstance(v, dict) and "effective" in v]
        found |= dict.fromkeys(effective, 2 * math.pi * offset)
    return found


def belt_length_key(belt: str, single: bool) -> str:
    """The key of the length of a belt, or of the only one."""
    return "installation.belt_length" + ("" if single else f".{belt}")


def standard_lengths_key(belt: str, single: bool) -> str:
    """The key of the lengths on sale of a belt, or of the only one."""
    return "belt.standard_lengths" if single else f"belt.{belt}.standard_lengths"


def _belt(table: Any, path: object) -> Any:
    """The table of a belt with its pitch and its standard lengths in meters."""
    if not isinstance(table, dict):
        return table
    plain = _without(table, OFFSETS)
    if "pitch" in table:
        plain["pitch"] = _of_belt(table, "pitch", path)
    if "standard_lengths" in table:
        key = f"{_label(table)}.standard_lengths"
        plain["standard_lengths"] = _standard_lengths(table["standard_lengths"], table, key, path)
    return plain


def _standard_lengths(given: Any, belt: dict[str, Any], key: str, path: object) -> list[float]:
    """Lengths along the neutral axis, of a list or of one under `effective`, `pitch` or `teeth`."""
    kind, values = "pitch", given
    if isinstance(given, list):
        _require_one_meaning(given, belt, key, path)
    if isinstance(given, dict) and len(given) == 1 and next(iter(given)) in LENGTHS:
        kind, values = next(iter(given.items()))
        key = f"{key}.{kind}"
    if not isinstance(values, list):
        message = f"found {shown(given)}; give a list, or {{ effective = [..] }}, pitch or teeth"
        raise FileError(path, key, message)
    return [
        _along_neutral_axis(kind, value, belt, f"{key}[{place}]", path)
        for place, value in enumerate(values)
    ]


def _tables(value: Any) -> Iterator[dict[str, Any]]:
    for table in value if isinstance(value, list) else [value]:
        if isinstance(table, dict):
            yield table


def _without(table: Any, keys: tuple[str, ...]) -> Any:
    if not isinstance(table, dict):
        return table
    return {key: value for key, value in table.items() if key not in keys}


def _pulley(table: Any, belts: dict[Any, dict[str, Any]], path: object) -> Any:
    """The table of a pulley with its radius."""
    if not isinstance(table, dict):
        return table
    name = f"pulley.{table.get('name', '')}"
    if "groove_angle" in table:
        table = _in_groove(table, name, path)
    own, first = table.get("belt"), next(iter(belts.values()), {})
    belt = belts.get(own, first) if isinstance(own, str) else first
    if "pitch" in belt and "friction" in table:
        message = f"the toothed belt ({_label(belt)}.pitch) does not slip; remove this"
        raise FileError(path, f"{name}.friction", message)
    given = [key for key in ("radius", *DIAMETERS, "teeth") if key in table]
    if given in ([], ["radius"]):
        return table
    key = given[-1]
    if len(given) > 1:
        raise FileError(path, f"{name}.{key}", f"{given[0]} is given, too; give one of them")
    if key == "teeth":
        around = _along_neutral_axis(key, table[key], belt, f"{name}.{key}", path)
        return _without(table, (key,)) | {"radius": around / (2 * math.pi)}
    face = _FACES.get(key)
    if face and table.get("face") in ("grooved", "back") and table["face"] != face:
        other = next(other for other in _FACES if other != key)
        message = f"belongs to a pulley with face = {face!r}; give {other} or diameter"
        raise FileError(path, f"{name}.{key}", message)
    offset = DIAMETERS[key]
    try:
        require_moderate(table[key], 2 * LARGEST_BARE_RADIUS)
    except ValueError as error:
        raise FileError(path, f"{name}.{key}", str(error)) from error
    radius = _length(table[key], f"{name}.{key}", path) / 2
    if offset:
        radius += _of_belt(belt, offset, path)
    return _without(table, (key,)) | {"radius": radius}


def _in_groove(table: dict[str, Any], name: str, path: object) -> dict[str, Any]:
    """The table of a pulley whose friction is that of a wedge between flanks, mu/sin(angle/2)."""
    key = f"{name}.groove_angle"
    angle = _number(table["groove_angle"], "rad", key, path)
    if table.get("face") == "back" or "friction" not in table:
        message = "belongs to a pulley with face = 'grooved' and friction; remove it or add them"
        raise FileError(path, key, message)
    if not 0 < angle < math.pi:
        message = f"found {shown(table['groove_angle'])}; give the angle between the flanks"
        raise FileError(path, key, f"{message}, above 0 and below 180 deg")
    flanks = {
        word: _number(table[word], "", f"{name}.{word}", path) / math.sin(angle / 2)
        for word in ("friction", "friction_static")
        if word in table
    }
    return _without(table, ("groove_angle",)) | flanks


def _lengths(given: Any, belts: dict[Any, dict[str, Any]], path: object) -> Any:
    """Belt lengths along the neutral axis: of the only belt, or by the names of several."""
    key, only = "installation.belt_length", next(iter(belts.values()), {})
    if not isinstance(given, dict) or (len(given) == 1 and next(iter(given)) in LENGTHS):
        return _neutral_length(given, only, key, path)
    return {
        name: _neutral_length(length, belts.get(name, {}), f"{key}.{name}", path)
        for name, length in given.items()
    }


def _neutral_length(given: Any, belt: dict[str, Any], key: str, path: object) -> Any:
    """A belt's length along the neutral axis; what is no table must be that already."""
    if not isinstance(given, dict):
        _require_one_meaning(given, belt, key, path)
        return given
    if len(given) != 1 or next(iter(given)) not in LENGTHS:
        message = f"found {shown(given)}; give {{ effective = .. }}, {{ pitch = .. }}"
        raise FileError(path, key, f"{message} or {{ teeth = .. }}")
    kind, value = next(iter(given.items()))
    return _along_neutral_axis(kind, value, belt, f"{key}.{kind}", path)


def _require_one_meaning(given: Any, belt: dict[str, Any], key: str, path: object) -> None:
    """Raise `FileError` for lengths that may be along the neutral axis or the effective line.

    Makers print effective lengths of the belts that have an effective line.
    """
    if OFFSETS[0] not in belt or not _of_belt(belt, OFFSETS[0], path):
        return
    value = "[..]" if isinstance(given, list) else json.dumps(given, default=str)
    message = (
        f"found {shown(given)}, along the effective line or along the neutral axis "
        f"({_label(belt)}.{OFFSETS[0]} is between them)? Give {{ effective = {value} }}, as makers "
        f"print it, or {{ pitch = {value} }}"
    )
    raise FileError(path, key, message)


def _along_neutral_axis(
    kind: str, value: Any, belt: dict[str, Any], key: str, path: object
) -> float:
    """A length once round, of a belt or of a pulley's pitch circle, as it is given by its kind."""
    if kind == "teeth":
        if type(value) is not int or value < 1:
            message = f"found {shown(value)}; give the number of teeth, a whole one above 0"
            raise FileError(path, key, message)
        return value * _of_belt(belt, "pitch", path)
    length = _length(value, key, path)
    if kind == "pitch":
        return length
    if belt.get("crossed") is True:
        message = f"found {shown(value)}; a crossed belt has no effective length of its own"
        raise FileError(path, key, f"{message}; give {{ pitch = .. }}, along its neutral axis")
    # The belt turns once round, so that the neutral axis is longer by one turn of the offset.
    return length + 2 * math.pi * _of_belt(belt, OFFSETS[0], path)


def _label(belt: dict[str, Any]) -> str:
    return f"belt.{belt['name']}" if "name" in belt else "belt"


# What a belt has for the sake of other keys, in the words of the message where it is missing.
_OF_BELTS = {
    "pitch_offset": "the distance from the belt's effective line to its neutral axis",
    "back_offset": "the distance from the belt's back face to its neutral axis",
    "pitch": "the distance from tooth to tooth",
}


def _of_belt(belt: dict[str, Any], key: str, path: object) -> float:
    label = f"{_label(belt)}.{key}"
    if key not in belt:
        raise FileError(path, label, f"is missing; add {_OF_BELTS[key]}")
    found = _length(belt[key], label, path)
    if key == "pitch" and not found > 0:
        raise FileError(path, label, f"found {shown(belt[key])}; must be greater than 0")
    return found


def _length(value: Any, key: str, path: object) -> float:
    return _number(value, "m", key, path)


def _number(value: Any, unit: str, key: str, path: object) -> float:
    try:
        return to_si(value, unit)
    except ValueError as error:
        raise FileError(path, key, str(error)) from error
