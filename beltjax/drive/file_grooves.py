"""Grooves of a drive file: what belongs together, and smooth rims."""

from typing import Any

from beltjax.drive.file_inner_tables import INNER
from beltjax.files.errors import FileError
from beltjax.files.units import shown

KEY = "groove"
WEDGED = "wedged"  # the key of a pulley that groove = false stands for


def grooves_checked(content: dict[str, Any], path: object) -> dict[str, Any]:
    """`content` whose tables of grooves are whole; raises `FileError`.

    `groove = false` of a pulley becomes `wedged = false`.
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
    for part in INNER["belt"][KEY]:
        if part not in given:
            message = "is missing; a groove has an angle between its flanks and a wedge_stiffness"
            raise FileError(path, f"{key}.{KEY}.{part}", message)
    return table


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
    return table
