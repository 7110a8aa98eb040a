"""Numbers with units, as they stand in files: SI numbers, or strings such as "90 mm"."""

import difflib
import functools
import math
import os
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic_core import PydanticCustomError

from beltjax.errors import FileError

# Hertz and rad/s have the same dimension to a units library, but differ by 2 pi to people.
_AMBIGUOUS = {"rad/s": ("hz", "hertz", "cps", "becquerel")}


@functools.cache
def _units():
    import pint  # here, because most files are plain SI and a unit registry takes long to build

    return pint.UnitRegistry(cache_folder=":auto:")


def to_si(value: Any, unit: str) -> float:
    """`value`, an SI number or a string with its unit, in `unit`.

    Raises `ValueError` with a text that says what was found and what is expected.
    """
    if isinstance(value, str):
        value = _parsed(value, unit)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"found {value!r}; give a number in {unit or 'no unit'}")
    if not math.isfinite(value):
        raise ValueError(f"found {value}, which is not finite; give a number in {unit}")
    return float(value)


def _parsed(text: str, unit: str) -> float:
    import pint

    example = f'a number in {unit}, or a string such as "1.0 {unit}"' if unit else "a plain number"
    if any(word in text.lower() for word in _AMBIGUOUS.get(unit, ())):
        raise ValueError(f"found {text!r}, which may mean rad/s or turns/s; use rpm or rad/s")
    try:
        quantity = _units().Quantity(text)
        if unit and quantity.unitless and not unit.startswith("rad"):
            raise ValueError(f"found {text!r}, which has no unit; give {example}")
        return float(quantity.to(unit or "dimensionless").magnitude)
    except pint.errors.DimensionalityError as error:
        raise ValueError(f"found {text!r}, whose unit is not a {unit}; give {example}") from error
    except ValueError:
        raise
    except Exception as error:  # the parser of units raises many kinds
        raise ValueError(f"found {text!r}, which is not understood; give {example}") from error


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
    except tomllib.TOMLDecodeError as error:
        raise FileError(path, "", f"is not TOML: {error}; correct that line") from error


def validated(table: type[TableType], content: dict[str, Any], path: object) -> TableType:
    """`content` as a `table`; raises `FileError` for the first thing that is wrong with it."""
    try:
        return table.model_validate(content)
    except ValidationError as failure:
        errors = failure.errors()
        first = errors[0]
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
        return f"found {found!r}; must be greater than {error['ctx']['gt']:g}"
    if kind == "greater_than_equal":
        return f"found {found!r}; must not be less than {error['ctx']['ge']:g}"
    if kind == "unit":
        return error["msg"]
    text = error["msg"].removeprefix("Input should be ")
    shown = repr(found) if not isinstance(found, dict | list) else f"a {type(found).__name__}"
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
