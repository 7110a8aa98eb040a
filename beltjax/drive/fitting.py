"""Which standard belts are next to a drawn layout, and where a pulley stands for a belt.

Lengths are those of the path: of a belt that lies round the pulleys without tension.
"""

import dataclasses
import math
from collections.abc import Iterable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from beltjax.drive.components import Belt, Tensioner
from beltjax.drive.installation import TensionGiven
from beltjax.drive.layout import layout
from beltjax.drive.system import Drive
from beltjax.results import explanation, succeeded

_SAME = 1e-9  # relative difference of two lengths that are one
_LARGEST = 0.3  # step of a search [rad], or in mean spans
_BESIDE = 1e-3  # of that step
_STEPS = 60


class FittingPlace(NamedTuple):
    """Where a body, or one of two fixed pulleys, stands for a belt of some length."""

    body: str | None  # name of the tensioner; None: the second of two pulleys is moved
    coordinate: float  # from the drawn position [rad] or [m]; of a pulley away from the first
    center_distance: float | None  # of two pulleys [m]
    beyond_stops: bool


class FittedBelt(NamedTuple):
    """A belt, and what makes room for it."""

    length: float  # along the neutral axis [m]
    teeth: int | None
    places: tuple[FittingPlace, ...]  # of each body that alone can fit it; none where none can
    reason: str  # why none can; else empty


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


def fitted_belts(drive: Drive, belt: int, lengths: Iterable[float]) -> list[FittedBelt]:
    """Belts of these lengths [m] in place of one of a drive's, and the places that fit them.

    Each body that moves the belt's path is moved alone, the others stand as drawn. Two pulleys that
    no body carries are moved apart along their line of centers.
    """
    part, movable = drive.belts[belt], drive
    if not drive.tensioners and drive.loop_sizes == (2,):
        movable = _on_slide(drive)
    found = []
    for length in lengths:
        places = [_place(movable, body, belt, length) for body in range(len(movable.tensioners))]
        known = tuple(place for place in places if isinstance(place, FittingPlace))
        if movable is not drive:
            apart = float(np.linalg.norm(np.subtract(*np.asarray(drive.centers))))
            known = tuple(
                place._replace(body=None, center_distance=apart + place.coordinate)
                for place in known
            )
        reasons = [place for place in places if isinstance(place, str)] or ["no pulley can move"]
        reason = "" if known else "; ".join(reasons)
        found.append(FittedBelt(length, teeth_of(part, length), known, reason))
    return found


def _on_slide(drive: Drive) -> Drive:
    """A drive of two fixed pulleys with the second one on a slide, away from the first."""
    first, second = np.asarray(drive.centers)
    pulleys = [
        dataclasses.replace(pulley, on=[float(place)]) for place, pulley in enumerate(drive.pulleys)
    ]
    slide = Tensioner(kind="linear", direction=second - first, name="the second pulley")
    rule = TensionGiven(1.0)
    return dataclasses.replace(drive, pulleys=pulleys, tensioners=(slide,), installation=rule)


def _place(drive: Drive, body: int, belt: int, length: float) -> FittingPlace | str:
    """Where one body stands alone so that a belt's path has this length; else why it cannot."""
    part, at, left = drive.tensioners[body], np.zeros(len(drive.tensioners)), 0.0
    of_belt = drive.belt_of_span == belt
    for step in range(_STEPS):
        there = layout(drive, jnp.asarray(at), throw=False)
        pull = float(np.sum(np.asarray(there.span_pulls)[of_belt, body]))
        left = length - float(there.path_lengths[belt])
        if not succeeded(there.result):
            why = explanation(there.result).partition(".")[0].partition(":")[0]
            return f"as {part.name} is moved, {why[0].lower()}{why[1:]}"
        largest = _LARGEST * (1.0 if float(part.kind) else float(np.mean(there.span_lengths)))
        if abs(pull) < 1e-9 and abs(left) > 1e-12 * length:
            # Where the path is longest or shortest, a body moves the belt only from beside it.
            if step == 1:
                return f"{part.name} does not move this belt"
            if step > 1:
                break
            at[body] = _BESIDE * largest
            continue
        if abs(left) <= 1e-12 * length:
            least, greatest = np.asarray(part.stops)
            beyond = not least <= at[body] <= greatest
            return FittingPlace(part.name, float(at[body]), None, beyond)
        at[body] += np.clip(left / pull, -largest, largest)
    return f"no place of {part.name} makes the path so {'long' if left > 0 else 'short'}"
