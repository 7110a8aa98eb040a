"""How drives and results print: a short table of names, values and units."""

import dataclasses
import html
import typing
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

from beltjax.results import RESULTS, code, outcomes

_LONGEST = 8  # numbers of an array that are shown

# SI unit of each number, by the last word of its name; the rest are pure numbers.
UNITS = {
    "radius": "m",
    "x": "m",
    "y": "m",
    "angle": "rad",
    "arm_length": "m",
    "stiffness": "N m/rad",
    "tension": "N",
    "belt_length": "m",
    "free_angle": "rad",
    "axial_stiffness": "N",
    "bending_stiffness": "N m^2",
    "mass_per_length": "kg/m",
    "thickness": "m",
    "inertia": "kg m^2",
    "friction": "",
    "rim_radius": "m",
    "damping": "N m s/rad",
    "belt_speed": "m/s",
    "driver_speed": "rad/s",
}
# And of what only results hold.
_UNITS_OF_RESULTS = {
    "center": "m",
    "pivot": "m",
    "stops": "rad",
    "crank": "rad",
    "torque": "N m",
    "span_tensions": "N",
    "mass_flow": "kg/s",
    "span_lengths": "m",
    "unstretched_span_lengths": "m",
    "wraps": "rad",
    "slips": "rad",
    "adhesions": "rad",
    "arc_lengths": "m",
    "path_length": "m",
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
}


class Readable(eqx.Module):
    """A module that prints as a table, and in notebooks as one of HTML.

    Parts that are defined beside it are shown in a row each, others by their names alone. While
    JAX traces it, in a batch, or with other leaves than numbers it prints as Equinox has it.
    """

    # Signs that stand for words, by the name of the field.
    words: ClassVar[Mapping[str, Mapping[str, float]]] = {}

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


def _is_plain(module: eqx.Module) -> bool:
    """Whether the numbers of a module are there, each of the rank that its field says."""
    for field in dataclasses.fields(module):
        value = getattr(module, field.name, None)
        if isinstance(value, RESULTS):
            value, rank = code(value), 0
        else:
            rank = _rank(field.type)
        if isinstance(value, str):
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
    """The rank that an annotation asks of an array; None where it is no array or may be absent."""
    if typing.get_args(kind) and type(None) in typing.get_args(kind):
        return None
    shape = getattr(kind, "dim_str", None)
    return None if shape is None or "..." in shape else len(shape.split())


def _parts(value: Any) -> tuple[Any, ...]:
    several = isinstance(value, tuple) and not hasattr(value, "_fields")  # a record is one
    return value if several else (value,)


def _rows(module: Readable) -> Iterator[tuple[str, str, str]]:
    """Name, value and unit of what a module holds."""
    for field in dataclasses.fields(module):
        name, value = field.name, getattr(module, field.name)
        if isinstance(value, dict):
            for key, item in value.items():
                # The values of design variables have each their own unit.
                yield f"{name} {key}", *_told(key if name == "values" else name, item)
            continue
        for part in _parts(value):
            if isinstance(part, Readable) and _is_of_drive(part) and _is_of_drive(module):
                one = f"{type(part).__name__.lower()} {getattr(part, 'name', '')}"
                label = name if part is value else one.rstrip()
                yield label, ", ".join(_inline(part)), ""
            elif part is not None and part is not value:
                yield name, _counted(value), ""
                break
            elif part is not None:
                sign = _word(module, name, part)
                yield (name, sign, "") if sign else (name, *_told(name, part))


def _is_of_drive(module: Readable) -> bool:
    """Whether a module describes a drive, or a part of it."""
    return type(module).__module__.startswith("beltjax.drive.")


def _inline(module: Readable) -> Iterator[str]:
    """What a part holds, in words of one line; its name stands before them."""
    for name, value, unit in _rows(module):
        if name != "name" and not (name in ("driver", "housed") and value == "0"):
            flag = name in ("driver", "housed")
            yield name if flag else f"{name} {value} {unit}".rstrip()


def _word(module: Readable, name: str, value: Any) -> str:
    """The word for which a sign stands; empty where the field holds no sign."""
    for word, sign in module.words.get(name, {}).items():
        if float(value) == sign:
            return word
    return ""


def _counted(values: tuple[Any, ...]) -> str:
    """A tuple of words, or how many of what there are."""
    if all(isinstance(value, str) for value in values):
        return ", ".join(values)
    return f"{len(values)} {type(values[0]).__name__}"


def _told(name: str, value: Any) -> tuple[str, str]:
    """A value in few words, and its unit."""
    if isinstance(value, RESULTS):
        return _result(value), ""
    if isinstance(value, str):
        return value, ""
    if isinstance(value, _NUMBERS):
        last = name.rsplit(".", 1)[-1]
        return _number(np.asarray(value)), UNITS.get(last, _UNITS_OF_RESULTS.get(last, ""))
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
