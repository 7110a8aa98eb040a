"""Grooves of a drive file, which are given as tables: as plain numbers."""

from collections.abc import Mapping
from typing import Any

from beltjax.files.errors import FileError
from beltjax.files.units import shown

KEY = "groove"
# The numbers of a belt and of a pulley by the keys of their tables.
OF_BELT = {"angle": "wedge_angle", "wedge_stiffness": "wedge_stiffness"}
OF_PULLEY = {"angle": "wedge_angle"}
WEDGED = "wedged"  # the key of a pulley that groove = false stands for


def grooves_as_numbers(content: dict[str, Any], path: object) -> dict[str, Any]:
    """`content` with plain numbers in place of tables of grooves; raises `FileError`.

    What is no table is left for the file's own rules to refuse.
    """
    belts, pulleys = content.get("belt"), content.get("pulley")
    made = dict(content)
    grooved = False
    if isinstance(belts, dict):
        grooved = KEY in belts or "wedge_angle" in belts
        made["belt"] = _belt(belts, "belt", path)
    elif isinstance(belts, list):
        keys = [f"belt.{_name(table, place)}" for place, table in enumerate(belts)]
        grooved = any(isinstance(t, dict) and (KEY in t or "wedge_angle" in t) for t in belts)
        made["belt"] = [_belt(table, key, path) for table, key in zip(belts, keys, strict=True)]
    if isinstance(pulleys, list):
        keys = [f"pulley.{_name(table, place)}" for place, table in enumerate(pulleys)]
        pairs = zip(pulleys, keys, strict=True)
        made["pulley"] = [_pulley(table, key, grooved, path) for table, key in pairs]
    return made


def _name(table: Any, place: int) -> str:
    return str(table.get("name", place)) if isinstance(table, dict) else str(place)


def _belt(table: Any, key: str, path: object) -> Any:
    if not isinstance(table, dict) or KEY not in table:
        return table
    given = table[KEY]
    if not isinstance(given, dict):
        message = f"found {shown(given)}; give {{ angle = .., wedge_stiffness = .. }}"
        raise FileError(path, f"{key}.{KEY}", message)
    for part in OF_BELT:
        if part not in given:
            message = "is missing; a groove has an angle between its flanks and a wedge_stiffness"
            raise FileError(path, f"{key}.{KEY}.{part}", message)
    return _plain(table, given, OF_BELT, key, path)


def _pulley(table: Any, key: str, grooved: bool, path: object) -> Any:
    if not isinstance(table, dict):
        return table
    if grooved and "groove_angle" in table:
        message = (
            "turns friction into that of a wedge, which the belt's groove does already; remove it, "
            "and give an angle of its own as groove = { angle = .. }"
        )
        raise FileError(path, f"{key}.groove_angle", message)
    if KEY not in table:
        return table
    given = table[KEY]
    if not grooved and given is not False:
        message = "belongs to a belt with groove = { angle, wedge_stiffness }; add that, or remove"
        raise FileError(path, f"{key}.{KEY}", f"{message} this")
    if given is False:
        return {word: value for word, value in table.items() if word != KEY} | {WEDGED: False}
    if not isinstance(given, dict) or "angle" not in given:
        message = f"found {shown(given)}; give {{ angle = .. }}, or false for a smooth rim"
        raise FileError(path, f"{key}.{KEY}", message)
    if table.get("face") == "back":
        message = "is of a pulley on the back of the belt, which is smooth; remove it"
        raise FileError(path, f"{key}.{KEY}", message)
    return _plain(table, given, OF_PULLEY, key, path)


def _plain(
    table: dict[str, Any], given: dict[str, Any], parts: Mapping[str, str], key: str, path: object
) -> dict[str, Any]:
    """A table without a table of a groove in it."""
    for part, value in given.items():
        if part not in parts:
            message = f"found {shown(value)}; the keys here are {', '.join(parts)}"
            raise FileError(path, f"{key}.{KEY}.{part}", message)
        if parts[part] in table:
            message = f"is given as {parts[part]}, too; give one of them"
            raise FileError(path, f"{key}.{KEY}.{part}", message)
    rest = {word: value for word, value in table.items() if word != KEY}
    return rest | {parts[part]: value for part, value in given.items()}
