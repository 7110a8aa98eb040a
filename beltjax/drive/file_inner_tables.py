"""Inner tables of a drive file, such as `cushion = { .. }` of a belt: as plain numbers."""

from typing import Any

from beltjax.drive.file_bodies import SINGLE
from beltjax.files.errors import FileError
from beltjax.files.units import shown

FRICTION = "friction_torque"
# The numbers of each table by the keys of its inner ones.
INNER = {
    "tensioner": {
        FRICTION: {
            "coulomb": FRICTION,
            "hub": "friction_hub",
            "spring": "friction_spring",
            "unwinding": "friction_unwinding",
        },
    },
    "belt": {
        "cushion": {"radial": "cushion_radial", "shear": "cushion_shear"},
        "groove": {"angle": "wedge_angle", "wedge_stiffness": "wedge_stiffness"},
    },
    "pulley": {"groove": {"angle": "wedge_angle"}},
}
_LABELS = {"tensioner": SINGLE}  # of a table without a name, where that is not its own word


def inner_tables_as_numbers(content: dict[str, Any], path: object) -> dict[str, Any]:
    """`content` with plain numbers in place of inner tables; raises `FileError`.

    What is no table is left for the file's own rules to refuse.
    """
    plain = dict(content)
    for word, inner in INNER.items():
        tables, label = content.get(word), _LABELS.get(word, word)
        if isinstance(tables, dict):
            plain[word] = _plain(tables, (word, label), inner, path)
        elif isinstance(tables, list):
            plain[word] = [_plain(table, (word, label), inner, path) for table in tables]
    return plain


def plain_key(words: tuple[str, ...]) -> tuple[str, ...]:
    """The words of a number's own key, from those of its place in a file."""
    *before, key, part = ("", *words)
    numbers = INNER.get(words[0], {}).get(key, {})
    return (*before[1:], numbers[part]) if part in numbers else words


def _plain(
    table: Any, words: tuple[str, str], inner: dict[str, dict[str, str]], path: object
) -> Any:
    """A table without inner ones."""
    if not isinstance(table, dict):
        return table
    (word, label), found = words, dict(table)
    where = f"{word}.{table['name']}" if "name" in table else label
    for key, numbers in inner.items():
        given = table.get(key)
        if not isinstance(given, dict):
            continue
        del found[key]
        for part, value in given.items():
            if part not in numbers:
                message = f"found {shown(value)}; the keys here are {', '.join(numbers)}"
                raise FileError(path, f"{where}.{key}.{part}", message)
            if numbers[part] in found and numbers[part] != key:
                message = f"is given as {numbers[part]}, too; give one of them"
                raise FileError(path, f"{where}.{key}.{part}", message)
            found[numbers[part]] = value
    return found
