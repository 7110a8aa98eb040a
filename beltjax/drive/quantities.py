"""Numbers with units, as they stand in files: SI numbers, or strings such as "90 mm"."""

import difflib
import functools
import math
import os
import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic_core import PydanticCustomError

from beltjax.errors import FileError

_NUMBER_WITH_UNIT = re.compile(
    r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\W\d_].*|[%°].*)?"
)
_STACKED_POWERS = re.compile(r"(\*\*|\^)[\s(+-]*[\d.]+[\s)]*(\*\*|\^)")  # would be computed
# Words that make a unit one of angle. To a units library an angle has no dimension, so that
# hertz, "1/min" and a bare number would all pass for angles and differ by 2 pi or 60.
_ANGLE_UNITS = {
    "radian",
    "degree",
    "turn",
    "revolution",
    "cycle",
    "arcminute",
    "arcsecond",
    "grade",
}
_ANGLE_UNITS |= {"revolutions_per_minute", "revolutions_per_second", "rpm", "rps", "milliradian"}


@functools.cache
def _units() -> Any:
    import pint  # here, because most files are plain SI and a unit registry takes long to build

    registry = pint.UnitRegistry()
    for alias in ("Nm = newton * meter", "RPM = revolutions_per_minute", "rev = revolution"):
        registry.define(alias)
    return registry


def to_si(value: Any, unit: str) -> float:
    """`value`, an SI number or a string with its unit, in `unit`.

    Raises `ValueError` with a text that says what was found and what is expected.
    """
    wanted = f"a number in {unit}" if unit else "a plain number"
    if isinstance(value, str):
        value = _parsed(value, unit)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"found {_shown(value)}; give {wanted}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"found {_shown(value)}, which is not finite; give {wanted}")
    return number


def _shown(value: Any) -> str:
    """`value` as it is shown in a message, long ones cut."""
    if isinstance(value, int) and abs(value) >= 10**30:
        return "an integer of more than 30 digits"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _parsed(text: str, unit: str) -> float:
    example = f'a number in {unit}, or a string such as "1.0 {unit}"' if unit else "a plain number"
    parts = _NUMBER_WITH_UNIT.fullmatch(text)
    if not parts or _STACKED_POWERS.search(text):
        raise ValueError(f"found {_shown(text)}, which is not a number with a unit; give {example}")
    number, written = float(parts[1]), (parts[2] or "").strip()
    if unit and not written:
        raise ValueError(f"found {_shown(text)}, which has no unit; give {example}")
    registry = _units()
    try:
        quantity = registry.Quantity(number, registry.Unit(written))
        converted = float(quantity.to(unit or "dimensionless").magnitude)
    except registry_errors() as error:
        unfit = f"whose unit is not {unit}" if unit else "which is a pure number"
        raise ValueError(f"found {_shown(text)}, {unfit}; give {example}") from error
    if unit.startswith("rad") and not _ANGLE_UNITS & set(dict(quantity.unit_items())):
        raise ValueError(
            f"found {_shown(text)}, whose unit is no angle; give rad, deg, rad/s or rpm"
        )
    return converted


def registry_errors() -> tuple[type[Exception], ...]:
    """What the units library raises for a unit that does not exist or does not fit."""
    import pint

    # Its parser passes on whatever Python's tokenizer and arithmetic raise.
    return (
        pint.errors.PintError,
        AttributeError,
        TypeError,
        ValueError,
        ArithmeticError,
        SyntaxError,
    )


def in_unit(unit: str) -> BeforeValidator:
    """A validator that turns a file's value into SI."""

    def convert(value: Any) -> float:
        try:
            return to_si(value, unit)
        except ValueError as error:
            raise PydanticCustomError("unit", "{text}", {"text": str(error)}) from error

    return BeforeValidator(convert)


Meter = Annotated[float, in_unit("m")]
Radian = Annotated[float, in_unit("rad")]
Newton = Annotated[float, in_unit("N")]
NewtonMeter = Annotated[float, in_unit("N m")]
Number = Annotated[float, in_unit("")]
Positive = Field(gt=0)
NotNegative = Field(ge=0)


class Table(BaseModel):
    """A table of a file: no key but those named."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


TableType = TypeVar("TableType", bound=Table)


def read_toml(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The content of a TOML file; raises `FileError`."""
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        reason = error.strerror or str(error)
        raise FileError(path, "", f"cannot be read ({reason}); give a TOML file") from error
    except UnicodeDecodeError as error:
        raise FileError(path, "", "is not UTF-8 text; give a TOML file") from error
    except (ValueError, RecursionError) as error:  # TOMLDecodeError is a ValueError
        raise FileError(path, "", f"is not TOML: {error}; correct that line") from error


def validated(table: type[TableType], content: dict[str, Any], path: object) -> TableType:
    """`content` as a `table`; raises `FileError` for the first thing that is wrong with it."""
    try:
        return table.model_validate(content)
    except ValidationError as failure:
        errors = failure.errors()
        # A misspelt key is also a missing one; the misspelling is what helps.
        first = min(errors, key=lambda error: error["type"] != "extra_forbidden")
        more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
        key = _key(first["loc"], content)
        raise FileError(path, key, _message(first, table) + more) from failure


def _key(location: Iterable[int | str], content: Any) -> str:
    """'pulley.accessory.radius' for ('pulley', 2, 'radius'): items go by their names."""
    words: list[str] = []
    for step in location:
        try:
            content = content[step]
        except (KeyError, IndexError, TypeError):
            content = None
        if isinstance(step, int):
            label = (
                content.get("name", content.get("quantity")) if isinstance(content, dict) else None
            )
            words.append(f".{label}" if isinstance(label, str) else f"[{step}]")
        else:
            words.append(f".{step}" if words else step)
    return "".join(words)


def _message(error: Any, table: type[Table]) -> str:
    kind, found = error["type"], error["input"]
    if kind == "missing":
        return "is missing; add it"
    if kind == "extra_forbidden":
        word = str(error["loc"][-1])
        close = difflib.get_close_matches(word, sorted(_all_keys(table)), n=1)
        return "is not a known key; " + (f"did you mean {close[0]!r}?" if close else "remove it")
    if kind == "greater_than":
        return f"found {_shown(found)}; must be greater than {error['ctx']['gt']:g}"
    if kind == "greater_than_equal":
        return f"found {_shown(found)}; must not be less than {error['ctx']['ge']:g}"
    if kind == "unit":
        return error["msg"]
    if kind in ("too_long", "too_short"):
        wanted = error["ctx"].get("max_length", error["ctx"].get("min_length"))
        return f"found {len(found)} items; give {wanted}"
    if kind in ("model_type", "dict_type"):
        return f"found {_shown(found)}; give a table"
    text = error["msg"].removeprefix("Input should be ")
    shown = _shown(found) if not isinstance(found, dict | list) else f"a {type(found).__name__}"
    return f"found {shown}; give {text}"


def _all_keys(table: type[Table]) -> set[str]:
    """Keys of a table and of the tables inside it, to find the one that was meant."""
    keys: set[str] = set()
    pending: list[Any] = [table]
    while pending:
        kind = pending.pop()
        if isinstance(kind, type) and issubclass(kind, Table):
            keys |= {field.alias or name for name, field in kind.model_fields.items()}
            pending += [field.annotation for field in kind.model_fields.values()]
        else:
            pending += list(getattr(kind, "__args__", ()))
    return keys
