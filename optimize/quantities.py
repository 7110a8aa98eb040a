"""Named quantities of a running drive, for objectives and constraints (SI and radians).

A quantity is an array: one number, or one for each thing that the name covers ("clearance" has
one for each gap), so that a limit on it is a smooth limit on each.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from beltjax.analysis.contact import ContactState, contact_state, maximum_moment
from beltjax.analysis.steady import SteadyState
from beltjax.drive.checks import clearances
from beltjax.drive.components import Drive, OperatingPoint
from beltjax.results import RESULTS, succeeded


class Answers:
    """What the analyses say of one drive, each asked when a quantity needs it, and once."""

    def __init__(self, drive: Drive, point: OperatingPoint, steady: SteadyState):
        self.drive, self.point, self.steady = drive, point, steady
        self._contacts: list[ContactState] = []

    @functools.cached_property
    def contact(self) -> ContactState:
        """Belt and pulleys in contact, under the operating point's torques."""
        return self._kept(contact_state(self.drive, self.point, throw=False))

    @functools.cached_property
    def slipping(self) -> ContactState:
        """The same under the largest torques."""
        return self._kept(maximum_moment(self.drive, self.point, throw=False))

    def _kept(self, found: ContactState) -> ContactState:
        self._contacts.append(found)
        return found

    def found(self) -> Bool[Array, ""]:
        """Whether all that was asked so far has an answer, be it of a drive that slips."""
        good = succeeded(self.steady.result)
        for state in self._contacts:
            slips = (state.result == RESULTS.gross_slip) | (state.result == RESULTS.wrap_vanished)
            good = good & (succeeded(state.result) | slips)
        return good


Measure = Callable[[Answers], Float[Array, " parts"]]


class Quantity(NamedTuple):
    """What a name in a study means."""

    name: str
    unit: str
    measure: Measure


class _Kind(NamedTuple):
    unit: str
    of: str  # "", "pulley" or "span": what follows the colon
    measure: Callable[..., Float[Array, "..."]]  # of the answers, and of the place where named
    friction: bool = False  # whether it needs the friction of every pulley


def _hub_load(of: Answers, j: int):
    at, tensions = of.steady.reference.layout, of.steady.running_tensions
    pull = tensions[j] * at.directions[j] - tensions[j - 1] * at.directions[j - 1]
    # Parallel spans of equal tension round an idler leave no load; its direction is then free.
    return jnp.sqrt(jnp.sum(pull**2) + 1e-30)


def _slip_margin(of: Answers, j: int):
    friction = of.drive.pulleys[j].friction
    assert friction is not None  # as `quantity` holds
    ratio = of.steady.effective_tensions[j] / of.steady.effective_tensions[j - 1]
    return friction * of.steady.reference.layout.wraps[j] - jnp.abs(jnp.log(ratio))


def _all_gaps(of: Answers):
    gaps = clearances(of.drive, of.steady.reference.layout)
    return jnp.concatenate([gaps.rims, gaps.belt.ravel()])


def _tightness(of: Answers):
    """Span tensions at rest and effective tensions running, over P0: all positive, or slack."""
    return jnp.concatenate([of.steady.groups.tensions, of.steady.effective_tensions])


def _speed_ratio(of: Answers, j: int):
    return (of.drive.drives @ of.drive.radii) / of.drive.pulleys[j].radius


_KINDS = {
    "coupling": _Kind("", "", lambda of: jnp.sum(of.steady.coupling)),
    "coupling:": _Kind("", "span", lambda of, i: of.steady.coupling[i]),
    "tensioner_effectiveness": _Kind("", "", lambda of: of.steady.effectiveness),
    "wraps": _Kind("rad", "", lambda of: of.steady.reference.layout.wraps),
    "wrap:": _Kind("rad", "pulley", lambda of, j: of.steady.reference.layout.wraps[j]),
    "clearance": _Kind("m", "", _all_gaps),
    "tightness": _Kind("", "", _tightness),
    "speed_ratio:": _Kind("", "pulley", _speed_ratio),
    "tension:": _Kind("N", "span", lambda of, i: of.steady.running_tensions[i]),
    "hub_load:": _Kind("N", "pulley", _hub_load),
    "slip_margin:": _Kind("", "pulley", _slip_margin),
    "path_length": _Kind("m", "", lambda of: of.steady.reference.layout.path_length),
    "belt_length": _Kind("m", "", lambda of: of.steady.reference.unstretched_length),
    "span_length:": _Kind("m", "span", lambda of, i: of.steady.reference.layout.span_lengths[i]),
    "efficiency": _Kind("", "", lambda of: of.contact.efficiency, friction=True),
    "adhesion:": _Kind("rad", "pulley", lambda of, j: of.contact.adhesions[j], friction=True),
    "contact_wrap:": _Kind("rad", "pulley", lambda of, j: of.contact.wraps[j], friction=True),
    "torque_factor": _Kind("", "", lambda of: of.slipping.torque_factor, friction=True),
    "maximum_moment": _Kind("N m", "", lambda of: of.slipping.driver_moment, friction=True),
    "arm_rotation": _Kind("rad", "", lambda of: of.steady.arm_rotation),
}


# Quantities that are many numbers at once: fit to be limited, not to be minimized.
MANY = ("clearance", "wraps", "tightness")


def quantity(name: str, drive: Drive) -> Quantity:
    """The quantity of that name; raises `KeyError` with a text that lists what there is."""
    word, colon, place = name.partition(":")
    kind = _KINDS.get(word + colon)
    if kind is None:
        known = ", ".join(
            k + ("NAME" if v.of == "pulley" else "SPAN" if v.of else "") for k, v in _KINDS.items()
        )
        raise KeyError(f"there is no quantity {name!r}; give one of {known}")
    if word == "tensioner_effectiveness" and drive.tensioner is None:
        raise KeyError("this drive has no tensioner")
    i = 0
    if kind.of:
        i = drive.pulley(place) if kind.of == "pulley" else drive.span(place)
    if word == "slip_margin" and drive.pulleys[i].friction is None:
        raise KeyError(f"pulley {place!r} has no friction; add it to the drive file")
    bare = [pulley.name for pulley in drive.pulleys if pulley.friction is None]
    if kind.friction and bare:
        missing = f"pulley {bare[0]!r} has no friction, which {name!r} needs"
        raise KeyError(f"{missing}; add it to the drive file")
    places = (i,) if kind.of else ()
    return Quantity(name, kind.unit, lambda of: jnp.atleast_1d(kind.measure(of, *places)))
