"""Dry friction of tensioners in a drive file that is given as a table: as plain numbers."""

from typing import Any

from beltjax.drive.file_bodies import SINGLE
from beltjax.files.errors import FileError
from beltjax.files.units import shown

KEY = "friction_torque"
# The numbers of a tensioner by the keys of the table.
PARTS = {
    "coulomb": KEY,
    "hub": "friction_hub",
    "spring": "friction_spring",
    "unwinding": "friction_unwinding",
}


def frictions_as_numbers(content: dict[str, Any], path: object) -> dict[str, Any]:
    """`content` with plain numbers in place of tables of friction; raises `FileError`.

    What is no table is left for the file's own rules to refuse.
    """
    tables = content.get("tensioner")
    if isinstance(tables, dict):
        return content | {"tensioner": _plain(tables, path)}
    if isinstance(tables, list):
        return content | {"tensioner": [_plain(table, path) for table in tables]}
    return content


def _plain(table: Any, path: object) -> Any:
    """A tensioner's table without a table of friction in it."""
    given = table.get(KEY) if isinstance(table, dict) else None
    if not isinstance(given, dict):
        return table
    key = f"tensioner.{table['name']}" if "name" in table else SINGLE
    for part, value in given.items():
        if part not in PARTS:
            message = f"found {shown(value)}; the keys here are {', '.join(PARTS)}"
            raise FileError(path, f"{key}.{KEY}.{part}", message)
        if part != "coulomb" and PARTS[part] in table:
            message = f"is given as {PARTS[part]}, too; give one of them"
            raise FileError(path, f"{key}.{KEY}.{part}", message)
    rest = {word: value for word, value in table.items() if word != KEY}
    return rest | {PARTS[part]: value for part, value in given.items()}
