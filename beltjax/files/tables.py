"""Tables of files whose numbers carry units, and one line for the first thing that is wrong."""

import difflib
import math
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, create_model
from pydantic_core import PydanticCustomError

from beltjax.files.errors import FileError
from beltjax.files.fields import Number, numbers
from beltjax.files.units import is_quoted, shown, to_si

# Keys that others use, and what to give here.
_FOREIGN_KEYS = {
    "pitch_diameter": "give diameter, which is to the neutral axis of the belt",
    "outside_diameter": "give effective_diameter or smooth_diameter",
    "teeth": "give belt_length = { teeth = .. } in [installation], and teeth of each pulley",
    "x": "give center = [x, y]",
    "y": "give center = [x, y]",
    "position": "give center = [x, y]",
    "rpm": 'give driver_speed = "... rpm", or speed = ["... rpm", ...] of a load',
    "speed": "give belt_speed, or driver_speed from which it follows",
    "power": "give it in [operation.load.NAME], NAME being the pulley that takes it",
    "length": "give belt_length",
    "width": "axial_stiffness, bending_stiffness and mass_per_length are those of the whole width",
    "ribs": "axial_stiffness, bending_stiffness and mass_per_length are those of all ribs",
    "density": "give mass_per_length: density times cross section",
    "modulus": "give axial_stiffness: modulus times cross section",
    "youngs_modulus": "give axial_stiffness: modulus times cross section",
}

_OF_TABLES = "model_type", "dict_type"
# Kinds of errors where something in quotes may be what is wanted.
_WITHOUT_QUOTES = {"list_type": list, "bool_type": bool} | dict.fromkeys(_OF_TABLES, dict)
_MOST_KEYS = 4  # named beside the first that is wrong


def checked(value: Any, number: Number, kind: str | None = None) -> float:
    """A file's value of `number`, whose owner is of this kind, in SI.

    Raises `ValueError` with a text that says what was found and what is expected.
    """
    if number.largest_bare is not None:
        require_moderate(value, number.largest_bare)
    if number.unbounded and isinstance(value, float) and math.isinf(value):
        return value
    found = to_si(value, number.unit_for(kind))
    if number.above is not None and not found > number.above:
        raise ValueError(f"found {shown(value)}; must be greater than {number.above:g}")
    if number.at_least is not None and not found >= number.at_least:
        raise ValueError(f"found {shown(value)}; must not be less than {number.at_least:g}")
    return found


def require_moderate(value: Any, largest: float) -> None:
    """Raise `ValueError` for a bare number above `largest`, which is hardly meant in meters."""
    if type(value) in (int, float) and value > largest:
        lead = f'millimeters are written "{value:g} mm", and such large pulleys "{value:g} m"'
        raise ValueError(f"found {value:g}; a bare number is in meters, {lead}")


def valid(owner: type, field: str, kind: str | None = None) -> BeforeValidator:
    """A validator that turns a file's value of a field of `owner` into SI."""
    number = numbers(owner)[field]

    def convert(value: Any) -> float:
        try:
            return checked(value, number, kind)
        except ValueError as error:
            raise PydanticCustomError("unit", "{text}", {"text": str(error)}) from error

    return BeforeValidator(convert)


def valid_one_or_more(owner: type, field: str) -> BeforeValidator:
    """`valid`, for a field that holds one number or a list of them."""
    number = numbers(owner)[field]

    def convert(value: Any) -> float | list[float]:
        place = ""
        try:
            if not isinstance(value, list):
                return checked(value, number)
            found = []
            for k, item in enumerate(value, start=1):
                place = f"item {k}: "
                found.append(checked(item, number))
            return found
        except ValueError as error:
            raise PydanticCustomError("unit", "{text}", {"text": f"{place}{error}"}) from error

    return BeforeValidator(convert)


class Table(BaseModel):
    """A table of a file: no key but those named."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)
    # Keys of the file that are put in terms of others before the table is read.
    translated: ClassVar[tuple[str, ...]] = ()

    def number(self, name: str) -> Any:
        """A number that `numbers_of` gave the table; None where it is absent."""
        return getattr(self, name)


TableType = TypeVar("TableType", bound=Table)


def meaning(doc: str, unit: str = "") -> Any:
    """What a key means, for the documentation."""
    return Field(description=doc, json_schema_extra={"unit": unit})


def meaning_of(owner: type, field: str) -> Any:
    """What the key of a number of `owner` means, by its field."""
    fact = numbers(owner)[field]
    units = [fact.unit] if isinstance(fact.unit, str) else fact.unit.values()
    return meaning(fact.doc, " or ".join(units))


def numbers_of(
    owner: type,
    kind: str | None = None,
    *,
    only: Iterable[str] | None = None,
    without: Iterable[str] = (),
    required: Iterable[str] = (),
    docs: Mapping[str, str] | None = None,
) -> Callable[[type[TableType]], type[TableType]]:
    """Give a table the numbers that `owner` holds, of this kind, with their units and bounds.

    A number is required where the field of `owner` has no default; absent ones are None. `docs`
    says what those mean that mean another thing in this table.
    """

    def extended(table: type[TableType]) -> type[TableType]:
        fields: dict[str, Any] = {}
        for name, fact in numbers(owner).items():
            if name in without or (only is not None and name not in only):
                continue
            annotation: Any = Annotated[float, valid(owner, name, kind)]
            for size in fact.shape:
                exactly = Field(min_length=size, max_length=size)
                annotation = Annotated[list[annotation], exactly]
            needed = fact.required or name in required
            doc = (docs or {}).get(name, fact.doc)
            means = meaning(doc if needed else f"optional: {doc}", fact.unit_for(kind))
            annotation = Annotated[annotation if needed else annotation | None, means]
            fields[name] = (annotation, ...) if needed else (annotation, None)
        return create_model(
            table.__name__,
            __base__=table,
            __doc__=table.__doc__,
            __module__=table.__module__,
            **fields,
        )

    return extended


def given_numbers(record: Table, owner: type) -> dict[str, Any]:
    """The numbers of `owner` that a table holds."""
    fields = {name: getattr(record, name, None) for name in numbers(owner)}
    return {name: value for name, value in fields.items() if value is not None}


def validated(table: type[TableType], content: dict[str, Any], path: object) -> TableType:
    """`content` as a `table`; raises `FileError` for the first thing that is wrong with it."""
    try:
        return table.model_validate(content)
    except ValidationError as failure:
        first, *others = _problems(failure.errors(), content, table)
        message = _message(first, table) + _others(others, content, table)
        raise FileError(path, _key(first["loc"], content), message) from failure


def _problems(errors: list[Any], content: Any, table: type[Table]) -> list[Any]:
    """One error for each key that is wrong, misspelt ones first.

    A misspelt key is also a missing one, which is no problem of its own.
    """
    unknown = [error for error in errors if error["type"] == "extra_forbidden"]
    homes = _homes(table) if unknown else {}
    meant = {(*error["loc"][:-1], _close(str(error["loc"][-1]), homes)) for error in unknown}
    others = [
        error
        for error in errors
        if error["type"] != "extra_forbidden"
        and not (error["type"] == "missing" and error["loc"] in meant)
    ]
    by_key: dict[str, Any] = {}
    for error in (*unknown, *others):
        by_key.setdefault(_key(error["loc"], content), error)
    return list(by_key.values())


def _others(errors: list[Any], content: Any, table: type[Table]) -> str:
    """What else is wrong: a single problem in words, of several their keys."""
    keys = [_key(error["loc"], content) for error in errors[:_MOST_KEYS]]
    if not errors:
        return ""
    if len(errors) == 1:
        return f" (and 1 more problem: {keys[0]}: {_message(errors[0], table)})"
    keys += ["..."] * (len(errors) > _MOST_KEYS)
    return f" (and {len(errors)} more problems: {', '.join(keys)})"


def _key(location: Iterable[Any], content: Any) -> str:
    """'pulley.accessory.radius' for ('pulley', 2, 'radius'): items go by their names."""
    words: list[str] = []
    for step in location:
        # Where several types are allowed the library adds which one it tried.
        if not isinstance(content, dict | list) or str(step).endswith("Table"):
            continue
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
        return _of_unknown_key(error["loc"], table)
    if kind == "greater_than":
        return f"found {shown(found)}; must be greater than {error['ctx']['gt']:g}"
    if kind == "greater_than_equal":
        return f"found {shown(found)}; must not be less than {error['ctx']['ge']:g}"
    if kind == "unit":
        return error["msg"]
    if kind in ("too_long", "too_short"):
        wanted = error["ctx"].get("max_length", error["ctx"].get("min_length"))
        return f"found {len(found)} items; give {wanted}"
    return _of_another_type(error)


def _of_another_type(error: Any) -> str:
    """What to do about a value of another type than its key takes."""
    kind, found = error["type"], error["input"]
    if kind == "list_type" and isinstance(found, dict):
        return f"found one table; write its heading in double brackets: [[{error['loc'][-1]}]]"
    if kind in _WITHOUT_QUOTES and is_quoted(found, _WITHOUT_QUOTES[kind]):
        return f"found {shown(found)}; write it without quotes"
    wanted = {"list_type": "a list, as in [a, b]"} | dict.fromkeys(_OF_TABLES, "a table")
    text = wanted.get(kind, error["msg"].removeprefix("Input should be "))
    return f"found {shown(found)}; give {text}"


def _of_unknown_key(location: tuple[Any, ...], table: type[Table]) -> str:
    """What to do about a key that its table does not have."""
    word, homes = str(location[-1]), _homes(table)
    if word in _FOREIGN_KEYS:
        lead = "is not a key of this table" if word in homes else "is not a known key"
        return f"{lead}; {_FOREIGN_KEYS[word]}"
    if word in homes:
        # A kind of the same table may have it.
        here = any(home.strip("[]").startswith(str(location[0])) for home in homes[word])
        elsewhere = sorted(homes[word]) if len(homes[word]) < 3 and not here else []
        lead = f"it belongs in {' or '.join(elsewhere)}" if elsewhere else "remove it"
        return f"is not a key of this table; {lead}"
    close = _close(word, homes)
    return "is not a known key; " + (f"did you mean {close!r}?" if close else "remove it")


def _close(word: str, homes: Mapping[str, Any]) -> str:
    """The known key that is spelt much like a word; empty where there is none."""
    return next(iter(difflib.get_close_matches(word, sorted(homes), n=1)), "")


def _homes(table: type[Table]) -> dict[str, list[str]]:
    """Keys of a table and of those inside it, and under which headings each may stand.

    The description of a table begins with its heading; that of a whole file has none.
    """
    homes: dict[str, list[str]] = {}
    pending: list[Any] = [table]
    while pending:
        kind = pending.pop()
        if isinstance(kind, type) and issubclass(kind, Table):
            heading = re.match(r"\[+[^\]]+\]+", kind.__doc__ or "")
            keys = {field.alias or name for name, field in kind.model_fields.items()}
            for key in keys | set(kind.translated):
                known = homes.setdefault(key, [])
                if heading and heading[0] not in known:
                    known.append(heading[0])
            pending += [field.annotation for field in kind.model_fields.values()]
        else:
            pending += list(getattr(kind, "__args__", ()))
    return homes
