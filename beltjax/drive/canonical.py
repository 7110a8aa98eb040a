"""The form in which compiled programs take a drive: arrays alone, and no names of the user's.

JAX compiles anew for every value that is not an array, and for every other pytree structure, of
which names are a part. Public functions therefore bring their drives into this form before they
enter compiled code, so that only the number of pulleys and the optional numbers present compile.
"""

import dataclasses
import functools
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

from beltjax.drive.components import as_complex, as_real
from beltjax.drive.contact_given import ContactGiven
from beltjax.drive.installation import TensionGiven
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive, all_held
from beltjax.drive.units_of_file import UnitsOfFile

Numbers = TypeVar("Numbers")
_NAME = "drive"


def strongly_typed(numbers: Numbers) -> Numbers:
    """A result or an option whose floating-point leaves are strongly typed double arrays."""

    def typed(leaf: Any) -> Any:
        if isinstance(leaf, complex) or jnp.iscomplexobj(leaf):
            return as_complex(leaf)
        real = isinstance(leaf, float) or jnp.issubdtype(jnp.result_type(leaf), jnp.floating)
        return as_real(leaf) if real else leaf

    return jax.tree.map(typed, numbers)


def canonical_name(place: int) -> str:
    """The name that the pulley at that place of the list has in compiled programs."""
    return _name("pulley", place)


def canonical_drive(drive: Drive) -> Drive:
    """`drive` with strongly typed arrays for numbers and canonical names for its pulleys."""
    leaves, structure = jax.tree.flatten(drive)
    found = jax.tree.unflatten(_canonical_structure(structure), map(as_real, leaves))
    held = all_held(found.tensioners)
    if held is not None and isinstance(found.installation, TensionGiven):
        return _renamed(found, installation=_renamed(found.installation, as_drawn=held))
    return found


def canonical(drive: Drive, point: OperatingPoint) -> tuple[Drive, OperatingPoint]:
    """`drive` and `point` as compiled programs take them.

    Every pulley has a torque, 0 where none is given; the pulleys that have a load are structure.
    The excitation is left out: it concerns forced vibration alone, which takes it as an argument of
    its own. Raises `KeyError` for a torque or a load on a pulley that the drive does not have.
    """
    for name in point.names_of_takers:
        drive.pulley(name)
    torque = {
        canonical_name(i): point.torque.get(name, 0.0) for i, name in enumerate(drive.pulley_names)
    }
    real = jax.tree.map(as_real, point)
    load = {canonical_name(drive.pulley(name)): one for name, one in real.load.items()}
    point = dataclasses.replace(real, torque=torque, load=load, excitation=None)
    return canonical_drive(drive), point


def restored(
    numbers: tuple[Any, Any], drive: Drive, point: OperatingPoint
) -> tuple[Drive, OperatingPoint]:
    """A gradient by the canonical drive and point as one by `drive` and `point`.

    The excitation has no gradient and is left out; so are torques that `point` does not name.
    """
    of_drive, of_point = numbers
    named = jax.tree.unflatten(jax.tree.structure(drive), jax.tree.leaves(of_drive))
    torque = {name: of_point.torque[canonical_name(drive.pulley(name))] for name in point.torque}
    load = {name: of_point.load[canonical_name(drive.pulley(name))] for name in point.load}
    return named, dataclasses.replace(of_point, torque=torque, load=load)


@functools.lru_cache(maxsize=256)
def _canonical_structure(structure: Any) -> Any:
    """The pytree structure of a drive whose names are replaced by canonical ones."""
    drive = jax.tree.unflatten(structure, [0.0] * structure.num_leaves)
    several, first_on_shaft = len(drive.belts) > 1, {}
    for shaft in drive.shafts:
        for place in shaft[1:]:
            first_on_shaft[place] = canonical_name(shaft[0])
    pulleys = [
        _renamed(
            pulley,
            name=canonical_name(place),
            belt=_name("belt", belt) if several else None,
            shaft=first_on_shaft.get(place),
        )
        for place, (pulley, belt) in enumerate(
            zip(drive.pulleys, drive.belt_of_span.tolist(), strict=True)
        )
    ]
    named = {
        field: tuple(_renamed(part, name=_name(word, i)) for i, part in enumerate(parts))
        for field, word, parts in (
            ("belts", "belt", drive.belts),
            ("tensioners", "tensioner", drive.tensioners),
            ("arm_springs", "spring", drive.arm_springs),
            ("isolators", "isolator", drive.isolators),
            ("dampers", "damper", drive.dampers),
        )
    }
    named["belts"] = tuple(_renamed(b, pitch=None, standard_lengths=()) for b in named["belts"])
    model = _renamed(drive.model, schema=1)
    renamed = _renamed(
        drive,
        name=_NAME,
        pulleys=tuple(pulleys),
        model=model,
        units=UnitsOfFile(),
        origin=(0.0, 0.0),
        contact=ContactGiven(),
        **named,
    )
    return jax.tree.structure(renamed)


def _name(word: str, place: int) -> str:
    return f"{word} {place}"


def _renamed(module: Any, **fields: Any) -> Any:
    """`module` with these fields; its checks are skipped, since its leaves are placeholders."""
    copy = object.__new__(type(module))
    for field in dataclasses.fields(module):
        value = fields.get(field.name, getattr(module, field.name))
        object.__setattr__(copy, field.name, value)
    return copy
