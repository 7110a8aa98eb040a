"""Named quantities of a running drive, for objectives and constraints (SI and radians).

A quantity is an array: one number, or one for each thing that the name covers ("clearance" has
one for each gap), so that a limit on it is a smooth limit on each.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.analysis.steady import SteadyState
from beltjax.drive.checks import clearances
from beltjax.drive.components import Drive

Measure = Callable[[Drive, SteadyState], Float[Array, " parts"]]


class Quantity(NamedTuple):
    """What a name in a study means."""

    name: str
    unit: str
    measure: Measure


class _Kind(NamedTuple):
    unit: str
    of: str  # "", "pulley" or "span": what follows the colon
    measure: Callable[..., Float[Array, "..."]]  # (drive, steady) or (drive, steady, place)


def _hub_load(drive: Drive, steady: SteadyState, j: int):
    at, tensions = steady.reference.layout, steady.running_tensions
    pull = tensions[j] * at.directions[j] - tensions[j - 1] * at.directions[j - 1]
    # Parallel spans of equal tension round an idler leave no load; its direction is then free.
    return jnp.sqrt(jnp.sum(pull**2) + 1e-30)


def _slip_margin(drive: Drive, steady: SteadyState, j: int):
    friction = drive.pulleys[j].friction
    assert friction is not None  # as `quantity` holds
    ratio = steady.effective_tensions[j] / steady.effective_tensions[j - 1]
    return friction * steady.reference.layout.wraps[j] - jnp.abs(jnp.log(ratio))


def _all_gaps(drive: Drive, steady: SteadyState):
    gaps = clearances(drive, steady.reference.layout)
    return jnp.concatenate([gaps.rims, gaps.belt.ravel()])


def _tightness(drive: Drive, steady: SteadyState):
    """Span tensions at rest and effective tensions running, over P0: all positive, or slack."""
    return jnp.concatenate([steady.groups.tensions, steady.effective_tensions])


def _speed_ratio(drive: Drive, steady: SteadyState, j: int):
    return (drive.drives @ drive.radii) / drive.pulleys[j].radius


_KINDS = {
    "coupling": _Kind("", "", lambda d, s: jnp.sum(s.coupling)),
    "coupling:": _Kind("", "span", lambda d, s, i: s.coupling[i]),
    "tensioner_effectiveness": _Kind("", "", lambda d, s: s.effectiveness),
    "wraps": _Kind("rad", "", lambda d, s: s.reference.layout.wraps),
    "wrap:": _Kind("rad", "pulley", lambda d, s, j: s.reference.layout.wraps[j]),
    "clearance": _Kind("m", "", _all_gaps),
    "tightness": _Kind("", "", _tightness),
    "speed_ratio:": _Kind("", "pulley", _speed_ratio),
    "tension:": _Kind("N", "span", lambda d, s, i: s.running_tensions[i]),
    "hub_load:": _Kind("N", "pulley", _hub_load),
    "slip_margin:": _Kind("", "pulley", _slip_margin),
    "path_length": _Kind("m", "", lambda d, s: s.reference.layout.path_length),
    "belt_length": _Kind("m", "", lambda d, s: s.reference.unstretched_length),
    "span_length:": _Kind("m", "span", lambda d, s, i: s.reference.layout.span_lengths[i]),
    "arm_rotation": _Kind("rad", "", lambda d, s: s.arm_rotation),
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
    if not kind.of:
        return Quantity(name, kind.unit, lambda d, s: jnp.atleast_1d(kind.measure(d, s)))
    i = drive.pulley(place) if kind.of == "pulley" else drive.span(place)
    if word == "slip_margin" and drive.pulleys[i].friction is None:
        raise KeyError(f"pulley {place!r} has no friction; add it to the drive file")
    return Quantity(name, kind.unit, lambda d, s: jnp.atleast_1d(kind.measure(d, s, i)))
