"""Springs by their preload in a drive file: as the positions in which they are relaxed.

Makers print the moment or the force of a spring in the drawn position, or at an angle of the arm.
What has no rate, a weight on a rope or a cylinder, is a constant force.
"""

import math
from typing import Any

from beltjax.drive.components import FORCE, STIFFNESS
from beltjax.drive.file_bodies import SINGLE, arm_direction
from beltjax.files.errors import FileError
from beltjax.files.units import to_si

_KEYS = ("preload", "at_angle")


def springs_as_positions(content: dict[str, Any], path: object) -> dict[str, Any]:
    """`content` with `free` of the installation, or a force, in place of preloads.

    Raises `FileError` for a preload beside what says the same or gives the tension. What is no
    table is left for the file's own rules to refuse.
    """
    tables = content.get("tensioner")
    one = isinstance(tables, dict)
    listed = [tables] if one else tables if isinstance(tables, list) else []
    rule = content.get("installation", {})
    known = rule.get("free", {}) if isinstance(rule, dict) else None
    if not isinstance(known, dict):
        return content
    free: dict[str, float] = {}
    plain = [_table(table, one, content, free, path) for table in listed]
    if plain == listed:
        return content
    changed = content | {"tensioner": plain[0] if one else plain}
    return changed | {"installation": rule | {"free": known | free}} if free else changed


def _table(
    table: Any, one: bool, content: dict[str, Any], free: dict[str, float], path: object
) -> Any:
    """The table of a tensioner without its preload, which goes to `free`."""
    name = table.get("name", SINGLE) if isinstance(table, dict) else None
    if not isinstance(name, str) or not any(key in table for key in _KEYS):
        return table
    key = f"tensioner.{name}" if "name" in table else "tensioner"
    if "preload" not in table:
        raise FileError(path, f"{key}.at_angle", "goes with preload; add it, or remove this")
    _require_alone(table, name, key, content, path)
    kind = "linear" if table.get("kind") == "linear" else "rotary"
    preload = _number(table["preload"], FORCE[kind], f"{key}.preload", path)
    rate = _number(table.get("stiffness", 0.0), STIFFNESS[kind], f"{key}.stiffness", path)
    plain = {word: value for word, value in table.items() if word not in _KEYS}
    if not rate > 0:
        if "at_angle" in table:
            message = "belongs to a spring; give its stiffness, or remove this"
            raise FileError(path, f"{key}.at_angle", message)
        # [tensioner] and twin arms have a spring, whose missing stiffness their rules refuse.
        return plain if one or table.get("kind") == "twin-arm" else plain | {"force": preload}
    free[name] = preload / rate
    if "at_angle" in table:
        free[name] += _turn_to(table, key, content, path)
    return plain


def _require_alone(
    table: dict[str, Any], name: str, key: str, content: dict[str, Any], path: object
) -> None:
    """Raise `FileError` where something else says the same as a preload."""
    rule = content.get("installation", {})
    if "free_angle" in rule or name in rule.get("free", {}):
        other = "free_angle" if "free_angle" in rule else f"free.{name}"
        message = f"installation.{other} says where this spring is relaxed; give one of them"
        raise FileError(path, f"{key}.preload", message)
    if "force" in table:
        raise FileError(path, f"{key}.preload", "force is given, too; give one of them")
    if "tension" in rule:
        message = "gives the tension, as installation.tension does; give one of them"
        raise FileError(path, f"{key}.preload", message)


def _turn_to(table: dict[str, Any], key: str, content: dict[str, Any], path: object) -> float:
    """The coordinate of an arm, from where it is drawn, at the angle of its preload."""
    label = f"{key}.at_angle"
    if table.get("kind", "rotary") != "rotary":
        message = "is the direction of one arm, from pivot to pulley; remove it"
        raise FileError(path, label, message)
    angle = _number(table["at_angle"], "rad", label, path)
    carried = [table.get("pulley"), *_items(table.get("pulleys"))]
    centers = [
        _point(pulley.get("center"), f"pulley.{pulley.get('name')}.center", path)
        for pulley in _items(content.get("pulley"))
        if isinstance(pulley, dict) and pulley.get("name") in carried
    ]
    if not centers:
        raise FileError(path, label, "needs the name of the arm's pulley; add it")
    drawn = arm_direction(centers, _point(table.get("pivot"), f"{key}.pivot", path))
    # The arm never turns by half a turn between the two.
    return (angle - drawn + math.pi) % (2 * math.pi) - math.pi


def _items(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _point(value: Any, key: str, path: object) -> list[float]:
    if not isinstance(value, list) or len(value) != 2:
        raise FileError(path, key, "is no point; give [x, y]")
    return [_number(part, "m", key, path) for part in value]


def _number(value: Any, unit: str, key: str, path: object) -> float:
    try:
        return to_si(value, unit)
    except ValueError as error:
        raise FileError(path, key, str(error)) from error
