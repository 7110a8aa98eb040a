"""The registry of quantities: named numbers of a running drive, for objectives and limits.

A quantity is a function of a drive's analyses, registered under a name:

    @quantity("hub_load", unit="N", place="pulley")
    def hub_load(analyses: DriveAnalyses, pulley: int) -> Array: ...

It returns an array in SI and radians: one number, or one for each thing that the name covers
("clearance" has one for each gap), so that a limit on it is a smooth limit on each.
"""

import difflib
import inspect
import math
from collections.abc import Callable
from typing import Literal, NamedTuple, TypeVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.analysis.groove_methods import unmet_groove
from beltjax.analysis.linearization import has_inertias
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive

from .drive_analyses import MODES, DriveAnalyses

Place = Literal["", "pulley", "span", "mode", "order"]
Need = Literal[
    "",
    "tensioner",
    "friction",
    "pulley friction",
    "falling friction",
    "groove",
    "excited friction",
    "inertia",
    "excitation",
    "allowable tension",
    "offset",
]
MeasureFunction = TypeVar("MeasureFunction", bound=Callable[..., Array])


class Quantity(NamedTuple):
    """A quantity of one drive, as a name in a study means it."""

    name: str
    unit: str  # SI; empty for a pure number
    measure: Callable[[DriveAnalyses], Float[Array, " parts"]]


class QuantityDefinition(NamedTuple):
    """A registered quantity, which holds for any drive that has what it needs."""

    name: str  # with a colon behind it where a place follows
    unit: str
    place: Place
    needs: Need
    many: bool
    meaning: str  # one line
    measure: Callable[..., Array]

    @property
    def pattern(self) -> str:
        """The name as people write it, such as "hub_load:PULLEY"."""
        return self.name + _PLACES[self.place]


_PLACES: dict[Place, str] = {
    "": "",
    "pulley": "PULLEY",
    "span": "SPAN",
    "mode": "K",
    "order": "N",
}
_DEFINITIONS: dict[str, QuantityDefinition] = {}


def quantity(
    name: str, *, unit: str = "", place: Place = "", needs: Need = "", many: bool = False
) -> Callable[[MeasureFunction], MeasureFunction]:
    """Register a function as the quantity of that name, for studies, explorations and tolerances.

    The function takes a `DriveAnalyses` and returns an array in SI and radians. JAX traces and
    differentiates it. The first line of its docstring describes it in listings.

    Args:
        name: the name in a study; where there is a `place`, the study writes "NAME:PLACE".
        unit: the SI unit of the numbers, empty for pure numbers. Limits in a study file may use
            any unit of the same kind.
        place: the function's second argument: the number of a "pulley" or of a "span" (from 0), of
            a "mode" (from 0; names count from 1), or an "order" of the driver's speed. It is empty
            where the function takes the analyses alone.
        needs: what a drive must have: a "tensioner", "friction" of every pulley, "pulley
            friction" of the one named, "falling friction" of that one and belts with damping, a
            "groove" of the belt and friction of its pulleys,
            "excited friction" of it and "excitation", "offset" of some pulley, "inertia" of every
            part, "excitation" and inertias, the "allowable tension" of every belt.
        many: whether it returns many numbers, which can be limited but not minimized.

    Returns:
        A decorator that registers the function and returns it unchanged.

    Raises:
        ValueError: the name is taken (programs compiled with the earlier function would continue
            to use it) or holds ':', '@', '-' or a space, or `place` or `needs` is unknown.

    Examples:
        >>> @bj.optimize.quantity("belt_mass", unit="kg")
        ... def belt_mass(analyses):
        ...     "Mass of the belt."
        ...     belt = analyses.drive.belt
        ...     return belt.mass_per_length * analyses.steady.reference.unstretched_length
    """
    key = f"{name}:" if place else name
    if not name or set(name) & set(":@- "):
        raise ValueError(f"quantity: found the name {name!r}; give one without ':', '@', '-', ' '.")
    if place not in _PLACES or needs not in _CHECKS:
        raise ValueError(
            f"quantity {name!r}: found place {place!r} and needs {needs!r}; give a place of "
            f"{', '.join(map(repr, _PLACES))} and a need of {', '.join(map(repr, _CHECKS))}."
        )
    if key in _DEFINITIONS:
        raise ValueError(f"quantity: there is a quantity {key!r} already; choose another name.")

    def register(measure: MeasureFunction) -> MeasureFunction:
        meaning = (inspect.getdoc(measure) or "").split("\n")[0]
        _DEFINITIONS[key] = QuantityDefinition(key, unit, place, needs, many, meaning, measure)
        return measure

    return register


def quantity_definitions() -> tuple[QuantityDefinition, ...]:
    """All registered quantities, in the order of their registration.

    Returns:
        Their definitions, which hold for any drive that has what a quantity needs.
    """
    return tuple(_DEFINITIONS.values())


def definition_of(name: str) -> QuantityDefinition:
    """The definition behind a name; raises `KeyError` with a text that lists what there is."""
    word, colon, _ = name.partition(":")
    definition = _DEFINITIONS.get(word + colon)
    if definition is None:
        words = [key.rstrip(":") for key in _DEFINITIONS]
        close = difflib.get_close_matches(word, words, n=1)
        meant = f"did you mean {close[0]!r}? There are" if close else "give one of"
        known = ", ".join(one.pattern for one in _DEFINITIONS.values())
        raise KeyError(f"there is no quantity {name!r}; {meant} {known}")
    return definition


def find_quantity(name: str, drive: Drive, point: OperatingPoint | None = None) -> Quantity:
    """The quantity of that name for a drive.

    Args:
        name: the name as a study writes it, such as "hub_load:idler".
        drive: the drive.
        point: an operating point; where it is given, its excitation is checked, too.

    Returns:
        The quantity, whose `measure` takes a `DriveAnalyses` and returns [parts].

    Raises:
        KeyError: there is no such quantity or place, or the drive lacks what the quantity needs.
    """
    definition = definition_of(name)
    text = name.partition(":")[2]
    places = (_place(definition.place, text, drive),) if definition.place else ()
    _CHECKS[definition.needs](name, drive, places)
    excited = definition.needs in ("excitation", "excited friction")
    if point is not None and excited and point.excitation is None:
        raise KeyError(f"{name!r} needs [excitation] in the drive file; add that table")
    return Quantity(
        name,
        definition.unit,
        lambda analyses: jnp.atleast_1d(definition.measure(analyses, *places)),
    )


def _place(place: Place, text: str, drive: Drive) -> int | float:
    """The place behind the colon, as a measure takes it; names count modes from 1."""
    if place == "pulley":
        return drive.pulley(text)
    if place == "span":
        return drive.span(text)
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if place == "mode":
        if number not in range(1, MODES + 1):
            raise KeyError(f"there is no mode {text!r}; give one of 1 to {MODES}")
        return int(number) - 1
    if not 0 < number < math.inf:
        raise KeyError(f"{text!r} is no order of the driver's speed; give a number such as 2")
    return number


Places = tuple[int | float, ...]


def _needs_nothing(name: str, drive: Drive, places: Places) -> None:
    pass


def _needs_tensioner(name: str, drive: Drive, places: Places) -> None:
    if not drive.tensioners:
        raise KeyError("this drive has no tensioner")
    if len(drive.belts) > 1:
        raise KeyError(f"{name!r} is a number of a drive with one belt; leave it out")


def _needs_inertia(name: str, drive: Drive, places: Places) -> None:
    if not has_inertias(drive):
        raise KeyError(f"{name!r} needs the inertia of every pulley and of the arm; add them")


def _needs_friction(name: str, drive: Drive, places: Places) -> None:
    lacking = [pulley.name for pulley in drive.pulleys if pulley.friction is None]
    if lacking:
        missing = f"pulley {lacking[0]!r} has no friction, which {name!r} needs"
        raise KeyError(f"{missing}; add it to the drive file")


def _needs_pulley_friction(name: str, drive: Drive, places: Places) -> None:
    pulley = drive.pulleys[int(places[0])]
    if pulley.friction is None:
        missing = f"pulley {pulley.name!r} has no friction, which {name!r} needs"
        raise KeyError(f"{missing}; add it to the drive file")


def _needs_falling_friction(name: str, drive: Drive, places: Places) -> None:
    pulley = drive.pulleys[int(places[0])]
    if pulley.friction_static is None:
        missing = f"pulley {pulley.name!r} has no friction_static and friction_speed"
        raise KeyError(f"{missing}, which {name!r} needs; add them to the drive file")
    lacking = [belt.name for belt in drive.belts if belt.longitudinal_damping is None]
    if lacking:
        missing = f"belt {lacking[0]!r} has no longitudinal_damping, which {name!r} needs"
        raise KeyError(f"{missing}; add it to the drive file")


def _needs_groove(name: str, drive: Drive, places: Places) -> None:
    unmet = unmet_groove(drive, None, False)
    if unmet is not None:
        raise KeyError(f"{name!r} is of a belt in grooves: {unmet.key} {unmet.message}")


def _needs_excited_friction(name: str, drive: Drive, places: Places) -> None:
    _needs_pulley_friction(name, drive, places)
    _needs_inertia(name, drive, places)


def _needs_offset(name: str, drive: Drive, places: Places) -> None:
    if all(pulley.offset is None for pulley in drive.pulleys):
        raise KeyError(f"no pulley has an offset, which {name!r} needs; add it to the drive file")


def _needs_allowable_tension(name: str, drive: Drive, places: Places) -> None:
    lacking = [belt.name for belt in drive.belts if belt.allowable_tension is None]
    if lacking:
        missing = f"belt {lacking[0]!r} has no allowable_tension, which {name!r} needs"
        raise KeyError(f"{missing}; add it to the drive file")


_CHECKS: dict[Need, Callable[[str, Drive, Places], None]] = {
    "": _needs_nothing,
    "tensioner": _needs_tensioner,
    "friction": _needs_friction,
    "pulley friction": _needs_pulley_friction,
    "falling friction": _needs_falling_friction,
    "groove": _needs_groove,
    "excited friction": _needs_excited_friction,
    "offset": _needs_offset,
    "inertia": _needs_inertia,
    "excitation": _needs_inertia,
    "allowable tension": _needs_allowable_tension,
}
