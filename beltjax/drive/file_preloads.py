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
    free: dict[str, float] = {}
    plain = [_table(table, one, content, free, path) for table in listed]
    if plain == listed:
        return content
    changed = content | {"tensioner": plain[0] if one else plain}
    rule = content.get("installation", {})
    if not free or not isinstance(rule, dict):
        return changed
    return changed | {"installation": rule | {"free": rule.get("free", {}) | free}}


def _table(
    table: Any, one: bool, content: dict[str, Any], free: dict[str, float], path: object
) -> Any:
    """The table of a tensioner without its preload, which goes to `free`."""
    if not isinstance(table, dict) or not any(key in table for key in _KEYS):
        return table
    name = table.get("name", SINGLE)
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
    rule = rule if isinstance(rule, dict) else {}
    free = rule.get("free")
    if "free_angle" in rule or (isinstance(free, dict) and name in free):
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
    carried = [table["pulley"]] if "pulley" in table else table.get("pulleys", [])
    pulleys = content.get("pulley")
    centers = [
        [_number(part, "m", f"pulley.{pulley['name']}.center", path) for part in pulley["center"]]
        for pulley in (pulleys if isinstance(pulleys, list) else [])
        if isinstance(pulley, dict) and pulley.get("name") in carried and "center" in pulley
    ]
    pivot = table.get("pivot")
    if not centers or not isinstance(pivot, list):
        raise FileError(path, label, "needs the pivot and the pulley of the arm; add them")
    drawn = arm_direction(centers, [_number(part, "m", f"{key}.pivot", path) for part in pivot])
    # The arm never turns by half a turn between the two.
    return (angle - drawn + math.pi) % (2 * math.pi) - math.pi


def _number(value: Any, unit: str, key: str, path: object) -> float:
    try:
        return to_si(value, unit)
    except ValueError as error:
        raise FileError(path, key, str(error)) from error
