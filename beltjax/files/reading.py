"""Files read within limits: no pipe or device to wait for, nothing too large, deep or long.

Whatever a file holds, it is read in well under a second, or refused in one line.
"""

import json
import os
import re
import stat
import tomllib
from collections.abc import Callable
from typing import Any

from beltjax.files.errors import FileError
from beltjax.files.units import shown

_KIBIBYTE = 1024
_LARGEST_TOML = 256 * _KIBIBYTE  # a drive of 200 pulleys takes a sixth of it
_LARGEST_JSON = 16 * 1024 * _KIBIBYTE  # a study of 100,000 starts
_DEEPEST = 32  # tables within tables; drives and studies have four
_LONGEST = 1000  # characters of a key or a text
_MOST = 2000  # items of a list, keys of a table
_LARGEST_INTEGER = 10**30
# Keys joined by dots, more than are allowed. The parser's work grows with the square of their
# number. Each attempt begins where a word does and gives nothing back, so the search is linear.
_ONE_KEY = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_DEEP_KEY = re.compile(
    rf"(?<![\w-]){_ONE_KEY}(?:[ \t]*+\.[ \t]*+{_ONE_KEY}){{{_DEEPEST},}}", re.ASCII
)

_AT_LINE = re.compile(r"\(at line ([0-9]+), column")
_LONGEST_SHOWN = 200  # characters of a line that are looked at
_QUOTED_NAME = 'a name with other signs than letters, digits, - and _ stands in quotes, as in "A/C"'
_QUOTED_NUMBER = 'a number with its unit stands in quotes, as in "750 rpm"'
# What is often wrong with a line that is not TOML. The first that fits is told.
_TOML_HINTS = (
    (re.compile(r"^\[[^\"']*[^\w.\-\[\]\"'#][^\"']*\]", re.ASCII), _QUOTED_NAME),
    (re.compile(r"^[\w.\-]*[^\w.\-\s=\[\"'#][^=\"']*=", re.ASCII), _QUOTED_NAME),
    (re.compile(r"=\s*[-+]?[0-9]+,[0-9]"), "decimals follow a point, not a comma"),
    (re.compile(r"[=\[,]\s*[-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?\s*[A-Za-z°µ%]"), _QUOTED_NUMBER),
)


def read_toml(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The content of a TOML file.

    Raises `FileError` for what cannot be read or is not TOML, and for a file, a key, a text or an
    integer that is larger, deeper or longer than any drive or study needs.
    """
    remedy = "give a TOML file"
    data = read_file(path, _LARGEST_TOML, remedy)
    try:
        text = data.decode("utf-8-sig")  # editors on Windows begin files with a mark
    except UnicodeDecodeError as error:
        raise FileError(path, "", "is not UTF-8 text; save it as UTF-8") from error
    deep = _DEEP_KEY.search(text)
    if deep:
        line = text.count("\n", 0, deep.start()) + 1
        raise FileError(path, "", f"line {line} has more than {_DEEPEST} keys joined by dots")
    try:
        content = tomllib.loads(text)
    except RecursionError as error:
        raise FileError(path, "", "is nested too deep; correct that line") from error
    except ValueError as error:  # its error, and that of an integer of too many digits
        raise FileError(path, "", f"is not TOML: {error}; {_toml_lead(text, error)}") from error
    _require_moderate(path, content)
    return content


def _toml_lead(text: str, error: ValueError) -> str:
    """What to do about a text that is not TOML: the line, and what is often wrong with such."""
    lead = "correct that line"
    found = _AT_LINE.search(str(error))
    if not found:
        return lead
    line = text.split("\n")[int(found[1]) - 1].strip()[:_LONGEST_SHOWN]
    hints = (hint for pattern, hint in _TOML_HINTS if pattern.search(line))
    if "Cannot overwrite" in str(error):
        hints = iter(("the file gives it twice",))
    return f"{lead}, {shown(line)}" + "".join(f": {hint}" for hint in list(hints)[:1])


def read_json(path: str | os.PathLike[str], remedy: str) -> Any:
    """The content of a JSON file; raises `FileError`, which ends in `remedy`."""
    data = read_file(path, _LARGEST_JSON, remedy)
    return _parsed(path, lambda: json.loads(data), "JSON", remedy)


def read_file(path: str | os.PathLike[str], largest: int, remedy: str) -> bytes:
    """The bytes of a regular file of at most `largest` bytes; raises `FileError`."""
    data = b""
    try:
        mode = os.stat(path).st_mode
        if stat.S_ISREG(mode):
            with open(path, "rb") as file:
                data = file.read(largest + 1)
    except (OSError, ValueError) as error:  # ValueError: a path with a null character
        reason = getattr(error, "strerror", None) or str(error)
        raise FileError(path, "", f"cannot be read ({reason}); {remedy}") from error
    # A pipe would be waited for, and a device may never end.
    if not stat.S_ISREG(mode):
        raise FileError(path, "", f"is no file but a {_kind(mode)}; {remedy}")
    if len(data) > largest:
        limit = f"{largest // _KIBIBYTE} KiB"
        raise FileError(path, "", f"is larger than {limit}, the most that is read; {remedy}")
    return data


def _kind(mode: int) -> str:
    if stat.S_ISDIR(mode):
        return "folder"
    return "pipe" if stat.S_ISFIFO(mode) else "device or socket"


def _parsed(path: object, parse: Callable[[], Any], language: str, remedy: str) -> Any:
    try:
        return parse()
    except RecursionError as error:
        raise FileError(path, "", f"is nested too deep; {remedy}") from error
    except ValueError as error:  # the errors of both parsers are ValueErrors
        raise FileError(path, "", f"is not {language}: {error}; {remedy}") from error


def _require_moderate(path: object, content: Any) -> None:
    """Raise `FileError` for what is nested too deep, and for long lists, keys, texts, integers."""
    pending: list[tuple[tuple[Any, ...], Any]] = [((), content)]
    while pending:
        keys, value = pending.pop()
        if len(keys) > _DEEPEST:
            raise FileError(path, str(keys[0]), f"is nested more than {_DEEPEST} deep")
        if isinstance(value, dict | list) and len(value) > _MOST:
            message = f"found {len(value)} items; {_MOST} at most are read"
            raise FileError(path, _joined(keys), message)
        if isinstance(value, dict):
            for key in value:
                if len(key) > _LONGEST:
                    message = f"{key[:20]!r}... is longer than {_LONGEST} characters; shorten it"
                    raise FileError(path, _joined(keys), f"the key {message}")
            pending += [((*keys, key), item) for key, item in value.items()]
        elif isinstance(value, list):
            pending += [((*keys, place), item) for place, item in enumerate(value)]
        elif isinstance(value, str) and len(value) > _LONGEST:
            message = f"is a text of more than {_LONGEST} characters; shorten it"
            raise FileError(path, _joined(keys), message)
        elif isinstance(value, int) and abs(value) >= _LARGEST_INTEGER:
            raise FileError(
                path, _joined(keys), "found an integer of more than 30 digits; shorten it"
            )


def _joined(keys: tuple[Any, ...]) -> str:
    """'pulley[2].radius' for ('pulley', 2, 'radius')."""
    words = (f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys)
    return "".join(words).removeprefix(".")
