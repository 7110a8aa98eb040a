"""Which standard belts are next to a drawn layout, and where a pulley stands for them.

Lengths are those of the path: of a belt that lies round the pulleys without tension.
"""

import dataclasses
import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from beltjax.drive.components import Belt, Tensioner
from beltjax.drive.installation import TensionGiven
from beltjax.drive.layout import layout
from beltjax.drive.system import Drive
from beltjax.results import succeeded

_SAME = 1e-9  # relative difference of two lengths that are one
_LARGEST = 0.3  # step of a search [rad], or in mean spans
_STEPS = 60


class FittingPlace(NamedTuple):
    """Where a body, or one of two fixed pulleys, stands for a belt of some length."""

    body: str | None  # name of the tensioner; None: the second of two pulleys is moved
    coordinate: float  # from the drawn position [rad] or [m]; of a pulley away from the first
    center_distance: float | None  # of two pulleys [m]
    beyond_stops: bool


class StandardBelt(NamedTuple):
    """A belt that is sold, next to a drawn one."""

    length: float  # along the neutral axis [m]
    teeth: int | None
    places: tuple[FittingPlace, ...]  # of each body that alone can fit it; none where none can


def next_lengths(belt: Belt, path_length: float) -> list[float]:
    """The standard lengths next to a path [m]: the next shorter or equal one, and the next longer.

    Of a toothed belt without a list they are the next whole numbers of teeth.
    """
    most = path_length * (1 + _SAME)
    if not belt.standard_lengths:
        if belt.pitch is None:
            return []
        teeth = math.floor(most / belt.pitch)
        return [count * belt.pitch for count in (teeth, teeth + 1) if count]
    shorter = [length for length in belt.standard_lengths if length <= most]
    longer = [length for length in belt.standard_lengths if length > most]
    return [*shorter[-1:], *longer[:1]]


def teeth_of(belt: Belt, length: float) -> int | None:
    """The number of teeth on this length [m]; None where it is no whole one, or without teeth."""
    if belt.pitch is None:
        return None
    teeth = round(length / belt.pitch)
    return teeth if abs(teeth * belt.pitch - length) <= 1e-6 * belt.pitch else None


def standard_belts(drive: Drive, belt: int, path_length: float) -> list[StandardBelt]:
    """The standard belts next to the drawn path of one belt, and the places that fit them.

    Each body that moves the belt's path is moved alone, the others stand as drawn. Two pulleys that
    no body carries are moved apart along their line of centers.
    """
    part, movable = drive.belts[belt], drive
    if not drive.tensioners and drive.loop_sizes == (2,):
        movable = _on_slide(drive)
    found = []
    for length in next_lengths(part, path_length):
        places = [_place(movable, body, belt, length) for body in range(len(movable.tensioners))]
        known = tuple(place for place in places if place is not None)
        if movable is not drive:
            apart = float(np.linalg.norm(np.subtract(*np.asarray(drive.centers))))
            known = tuple(
                place._replace(body=None, center_distance=apart + place.coordinate)
                for place in known
            )
        found.append(StandardBelt(length, teeth_of(part, length), known))
    return found


def _on_slide(drive: Drive) -> Drive:
    """A drive of two fixed pulleys with the second one on a slide, away from the first."""
    first, second = np.asarray(drive.centers)
    pulleys = [
        dataclasses.replace(pulley, on=[float(place)]) for place, pulley in enumerate(drive.pulleys)
    ]
    slide = Tensioner(kind="linear", direction=second - first, name="slide")
    rule = TensionGiven(1.0)
    return dataclasses.replace(drive, pulleys=pulleys, tensioners=(slide,), installation=rule)


def _place(drive: Drive, body: int, belt: int, length: float) -> FittingPlace | None:
    """Where one body stands alone so that a belt's path has this length; None if nowhere."""
    part, at = drive.tensioners[body], np.zeros(len(drive.tensioners))
    of_belt = drive.belt_of_span == belt
    for _ in range(_STEPS):
        there = layout(drive, jnp.asarray(at), throw=False)
        pull = float(np.sum(np.asarray(there.span_pulls)[of_belt, body]))
        left = length - float(there.path_lengths[belt])
        if not succeeded(there.result) or abs(pull) < 1e-9:
            return None
        if abs(left) <= 1e-12 * length:
            least, greatest = np.asarray(part.stops)
            beyond = not least <= at[body] <= greatest
            return FittingPlace(part.name, float(at[body]), None, beyond)
        largest = _LARGEST * (1.0 if float(part.kind) else float(np.mean(there.span_lengths)))
        at[body] += np.clip(left / pull, -largest, largest)
    return None
