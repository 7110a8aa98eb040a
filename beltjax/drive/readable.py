"""Drives and results print as a short table of names, values and units."""

import dataclasses
import html
import importlib
import re
import typing
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

from beltjax.drive.contact_given import ContactGiven
from beltjax.drive.units_of_file import UnitsOfFile
from beltjax.files.fields import numbers
from beltjax.results import RESULTS, code, outcomes

_LONGEST = 8  # numbers of an array that are shown
_PICTURES = "beltjax.draw.plots"

# SI units of the fields of results; the units of a drive's numbers stand on their fields.
_UNITS_OF_RESULTS = {
    "pitch": "m",
    "span_lengths": "m",
    "unstretched_span_lengths": "m",
    "wraps": "rad",
    "slips": "rad",
    "adhesions": "rad",
    "arc_lengths": "m",
    "path_length": "m",
    "path_lengths": "m",
    "arm_angle": "rad",
    "alignment": "rad",
    "tensions": "N",
    "running_tensions": "N",
    "base_tension": "N",
    "unstretched_length": "m",
    "unstretched_speed": "m/s",
    "arm_rotation": "rad",
    "tension_change": "P0",
    "effective_tensions": "P0",
    "frequencies": "rad/s",
    "growth_rates": "1/s",
    "moments": "N m",
    "driver_moment": "N m",
    "pulley_speeds": "rad/s",
    "contact_curvatures": "1/m",
    "equilibrium": "m",
    "eigenvalues": "1/s",
    "onset_speed": "m/s",
    "fold_speed": "m/s",
    "sliding_speed": "m/s",
    "critical_damping": "N s/m",
    "squeal_frequency": "rad/s",
    "growth": "1/s",
    "runaway_rate": "1/s",
    "period": "s",
    "slip_time": "s",
    "stick_time": "s",
    "amplitude": "m",
    "v_max": "m/s",
    "release": "m",
    "capture": "m",
    "entry_angles": "rad",
    "loss": "W",
    "power_in": "W",
    "power_out": "W",
    "penetrations": "m",
    "span_speeds": "m/s",
    "mass_flow": "kg/s",
    "energy_balance": "W",
    "moment_balance": "N m",
    "hertz": "Hz",
}


class Readable(eqx.Module):
    """A module that prints as a table, and in notebooks as one of HTML.

    Each part of a drive is described in a row, and other modules are named alone. While JAX traces
    it, in a batch, or with other leaves than numbers it prints in the form of Equinox.
    """

    # Signs that stand for words, by the name of the field.
    words: ClassVar[Mapping[str, Mapping[str, float]]] = {}

    def unit_of_row(self, field: str, key: str | None = None) -> str:
        """SI unit of a field, or of its entry at `key` in a dictionary; empty for pure numbers."""
        fact = numbers(type(self)).get(field)
        if fact is None:
            return _UNITS_OF_RESULTS.get(field, "")
        if isinstance(fact.unit, str):
            return fact.unit
        kind = _word(self, "kind", getattr(self, "kind", None))
        return fact.unit[kind] if kind else ""

    def __repr__(self) -> str:
        if not _is_plain(self):
            return eqx.tree_pformat(self)
        rows = list(_rows(self))
        widths = [max(len(row[i]) for row in rows) for i in range(2)]
        lines = [f"  {name:<{widths[0]}}  {value:<{widths[1]}}  {u}" for name, value, u in rows]
        return "\n".join([type(self).__name__, *map(str.rstrip, lines)])

    def _repr_html_(self) -> str:
        if not _is_plain(self):
            return f"<pre>{html.escape(eqx.tree_pformat(self))}</pre>"
        cells = ("".join(f"<td>{html.escape(text)}</td>" for text in row) for row in _rows(self))
        body = "".join(f"<tr>{row}</tr>" for row in cells)
        return f"<table><caption>{type(self).__name__}</caption>{body}</table>"

    def plot(self, drive: Any = None) -> Any:
        """A picture, which a notebook shows and `.save(FILE)` writes; `.figure` is Matplotlib's.

        Args:
            drive: the drive that a result is of, for the pictures that need its names and outlines.

        Returns:
            The picture.

        Raises:
            TypeError: there is no picture of such an object; the message lists those there are.
            ValueError: the picture needs the drive, or the numbers are traced or a batch.

        Examples:
            >>> drive, point = bj.load_drive("examples/three_pulley.toml")
            >>> drive.plot()
            >>> bj.steady_state(drive, point).plot(drive).save("steady.svg")
        """
        if not _is_plain(self):
            raise ValueError(f"{type(self).__name__}: a picture is of one object of known numbers")
        # Found by its name: pictures know drives and results, and not the other way round.
        return importlib.import_module(_PICTURES).plotted(self, drive)


def _is_plain(module: eqx.Module) -> bool:
    """Whether a module's numbers are known, each with the rank that its field declares."""
    for field in dataclasses.fields(module):
        value = getattr(module, field.name, None)
        if isinstance(value, RESULTS):
            value, rank = code(value), 0
        else:
            rank = _rank(field.type)
        if isinstance(value, str) or field.metadata.get("static"):
            continue
        for leaf in jax.tree.leaves(value):
            if isinstance(leaf, Tracer) or not isinstance(leaf, _NUMBERS | str):
                return False
        if rank is not None and (value is None or np.ndim(value) != rank):
            return False
        if any(isinstance(part, Readable) and not _is_plain(part) for part in _parts(value)):
            return False
    return True


_NUMBERS = bool | int | float | complex | np.ndarray | np.generic | jax.Array


def _rank(kind: Any) -> int | None:
    """The rank of an annotated array; None for other types, and for one that may be absent."""
    if typing.get_args(kind) and type(None) in typing.get_args(kind):
        return None
    shape = getattr(kind, "dim_str", None)
    if shape is None or "..." in shape or "*" in shape:
        return None
    return len(shape.split())


def _parts(value: Any) -> tuple[Any, ...]:
    several = isinstance(value, tuple) and not hasattr(value, "_fields")  # a record is one
    return value if several else (value,)


def _rows(module: Readable) -> Iterator[tuple[str, str, str]]:
    """Name, value and unit of each entry of a module."""
    kind = _word(module, "kind", getattr(module, "kind", None))
    for field in dataclasses.fields(module):
        name, value = field.name, getattr(module, field.name)
        fact = numbers(type(module)).get(name)
        if isinstance(value, UnitsOfFile | ContactGiven) or (
            fact and fact.kinds and kind not in fact.kinds
        ):
            continue
        if isinstance(value, dict):
            for key, item in value.items():
                if isinstance(item, Readable):
                    yield f"{name} {key}", ", ".join(_inline(item, module)), ""
                else:
                    yield f"{name} {key}", *_told(item, module.unit_of_row(name, key))
            continue
        for part in _parts(value):
            if isinstance(part, Readable) and _is_of_drive(part) and _is_of_drive(module):
                label = name if part is value else _label(part, _parts(value))
                yield label, ", ".join(_inline(part, module)), ""
            elif part is not None and part is not value:
                yield name, _counted(value), ""
                break
            elif part is not None and _is_shown(part):
                sign = _word(module, name, part)
                yield (name, sign, "") if sign else (name, *_told(part, module.unit_of_row(name)))


def _label(part: Readable, among: tuple[Any, ...]) -> str:
    """The label of a part: "belt", "pulley idler", "arm spring twin"."""
    word = re.sub(r"(?<!^)(?=[A-Z])", " ", type(part).__name__).lower()
    name = getattr(part, "name", "")
    return word if len(among) == 1 and name in ("", word) else f"{word} {name}"


def _is_shown(value: Any) -> bool:
    """Whether a value is neither an empty text nor an empty array."""
    if isinstance(value, str):
        return bool(value)
    return not isinstance(value, _NUMBERS) or np.size(value) > 0


def _is_of_drive(module: Readable) -> bool:
    """Whether a module describes a drive, or a part of it."""
    return type(module).__module__.startswith("beltjax.drive.")


def _inline(part: Readable, whole: Readable) -> Iterator[str]:
    """Entries of a part of `whole`, as words for one line that begins with the part's name."""
    defaults = {field.name: field.default for field in dataclasses.fields(part)}
    for name, value, unit in _rows(part):
        held = getattr(part, name, None)
        if name in _PLACES:
            marked = _marked(whole, name, held)
            yield from [f"{name} {', '.join(part.name for part in marked)}"] * bool(marked)
        elif name in _FLAGS:
            yield from [name] * bool(np.any(held))
        elif name != "name" and (name in part.words or not _is_default(held, defaults.get(name))):
            # A spring between two tensioners has the unit of the tensioners' own springs.
            ends = _marked(whole, "between", getattr(part, "between", ()))
            yield f"{name} {value} {ends[0].unit_of_row(name) if ends else unit}".rstrip()


# Fields that mark places with ones, and the list of the drive that has them.
_PLACES = {
    "on": "tensioners",
    "between": "tensioners",
    "adjusted": "tensioners",
    "marked": "tensioners",
    "pulleys": "pulleys",
    "pulley": "pulleys",
}
_FLAGS = ("driver", "housed", "locked", "on_rim")


def _marked(whole: Readable, field: str, flags: Any) -> list[Any]:
    """The parts of `whole` that the flags of a part mark."""
    parts = getattr(whole, _PLACES[field], ())
    return [part for part, flag in zip(parts, np.ravel(flags), strict=False) if flag]


def _is_default(value: Any, default: Any) -> bool:
    """Whether numbers are the default of their field."""
    if not isinstance(default, float | tuple):
        return False
    return np.array_equal(value, np.broadcast_to(default, np.shape(value)))


def _word(module: Readable, name: str, value: Any) -> str:
    """The word for which a sign stands; empty where the field holds no sign."""
    if name not in module.words or value is None:
        return ""
    signs = np.ravel(np.asarray(value)).tolist()
    known = {sign: word for word, sign in module.words[name].items()}
    return ", ".join(known[sign] for sign in signs) if set(signs) <= set(known) else ""


def _counted(values: tuple[Any, ...]) -> str:
    """The words of a tuple, or the number and the type of its entries."""
    if all(isinstance(value, str) for value in values):
        return ", ".join(values)
    return f"{len(values)} {type(values[0]).__name__}"


def _told(value: Any, unit: str) -> tuple[str, str]:
    """A value in few words, and its unit."""
    if isinstance(value, RESULTS):
        return _result(value), ""
    if isinstance(value, str):
        return value, ""
    if isinstance(value, _NUMBERS):
        return _number(np.asarray(value)), unit
    ended = getattr(value, "result", None)
    kind = type(value).__name__
    return (f"{kind}, {_result(ended)}" if isinstance(ended, RESULTS) else kind), ""


def _result(result: RESULTS) -> str:
    number = int(code(result))
    return next(name for name, (other, _) in outcomes().items() if other == number)


def _number(value: np.ndarray) -> str:
    if value.ndim == 0:
        return str(value) if value.dtype.kind in "bi" else f"{value.item():.6g}"
    if value.ndim == 1 and value.size <= _LONGEST and value.dtype.kind != "c":
        return f"({', '.join(_number(item) for item in value)})"
    return " x ".join(map(str, value.shape)) + " numbers"
