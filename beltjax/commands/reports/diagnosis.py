"""Diagnoses of failed analyses, which name the key of the drive file and what to do."""

import dataclasses
import math
import re
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from beltjax.analysis.reference import LARGEST_STRAIN
from beltjax.analysis.steady import SteadyState, steady_state
from beltjax.compiling.quick import quickly_compiled
from beltjax.drive.buildable import drawn_arm_angle, layout_fault
from beltjax.drive.canonical import canonical
from beltjax.drive.components import KINDS
from beltjax.drive.file_makers_data import belt_length_key
from beltjax.drive.installation import (
    AdjustedToMark,
    AdjustedToTension,
    BeltGiven,
    Preloaded,
)
from beltjax.drive.layout import layout
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.files.units import in_unit
from beltjax.results import RESULTS, explanation, succeeded

_ROOM = 0.01  # of the path, by which a belt that resists bending may be longer and yet tight
_SWEEP = 1.0  # the arm is turned this far to either side to measure the path [rad]


class Diagnosis(NamedTuple):
    """A failure for people."""

    key: str  # of the drive file
    message: str
    impossible: bool  # the file describes no drive at all, rather than one that does not run


def diagnose(drive: Drive, point: OperatingPoint, steady: SteadyState) -> Diagnosis | None:
    """Say to the user why a steady state is no drive's; None where it is.

    The layout at rest is checked as the drawn one was: torques, or a belt that is given, may
    have turned the arm into another pulley.
    """
    if succeeded(steady.result):
        return _moved_layout_diagnosis(drive, steady)
    turned = _turn_off(drive, point, steady.result)
    if turned is not None:
        return turned
    found = _failure(drive, point, steady)
    if not _one_of(steady.result, *_OF_TRAVEL):
        return found
    lead = travel_lead(drive, point)
    return found if not lead else found._replace(message=f"{found.message}; {lead}")


def _failure(drive: Drive, point: OperatingPoint, steady: SteadyState) -> Diagnosis:
    result = steady.result
    rule = drive.installation
    if isinstance(rule, BeltGiven) and _one_of(result, *_UNFIT):
        return _belt_diagnosis(drive, rule)
    if isinstance(rule, AdjustedToTension | AdjustedToMark) and _one_of(result, *_UNFIT):
        unreached = _adjusted_diagnosis(drive, rule)
        if unreached is not None:
            return unreached
    if result == RESULTS.span_slack:
        return _slack_diagnosis(drive, point, steady)
    if result == RESULTS.arm_at_stop:
        where = places_in_words(drive, steady.reference.coordinates)
        return Diagnosis("tensioner.stops", f"{where}: {advice(drive, result).rstrip('.')}", False)
    if result == RESULTS.tensioner_unstable:
        return Diagnosis("tensioner.stiffness", advice(drive, result), False)
    if result == RESULTS.belt_overstretched:
        return _strain_diagnosis(drive, point, steady)
    key, rule = taken_key(point) or "installation", drive.installation
    if result == RESULTS.belt_does_not_fit and not isinstance(rule, BeltGiven):
        what = "these torques" if taken_key(point) else "what else pulls at it"
        message = (
            f"no place of the tensioners near the drawn one balances the belt and {what}: "
            f"{tightening(drive)}, or lower the torques"
        )
        return Diagnosis(key, message, False)
    return Diagnosis(key, advice(drive, result), False)


_UNFIT = RESULTS.belt_too_long, RESULTS.belt_too_short, RESULTS.belt_does_not_fit


# What a torque against the sense that is meant ends in.
_OF_TRAVEL = RESULTS.span_slack, RESULTS.belt_does_not_fit, RESULTS.arm_at_stop


def _turn_off(drive: Drive, point: OperatingPoint, result: RESULTS) -> Diagnosis | None:
    """Says so where a free angle does not fit, and one that is a whole turn away does."""
    rule = drive.installation
    if not isinstance(rule, BeltGiven) or rule.free_angle is None:
        return None
    if not _one_of(result, *_UNFIT, RESULTS.arm_at_stop, RESULTS.span_slack):
        return None
    for turns in (-1, 1):
        angle = rule.free_angle + 2 * np.pi * turns
        other = eqx.tree_at(lambda d: d.installation.free_angle, drive, angle)
        if _runs(other, point):
            given, fits, drawn = np.degrees(
                [float(rule.free_angle), float(angle), drawn_arm_angle(drive)]
            )
            return Diagnosis(
                "installation.free_angle",
                f"found {given:.6g} deg, which is read as it stands, from the drawn arm at "
                f"{drawn:.6g} deg; {fits:.6g} deg, one turn away, fits: give that",
                True,
            )
    return None


def travel_lead(drive: Drive, point: OperatingPoint) -> str:
    """Says so where the drive runs in the other sense of travel, and not in this one."""
    if not taken_key(point):
        return ""
    against = dataclasses.replace(point, travel=-point.travel)
    if _runs(drive, point) or not _runs(drive, against):
        return ""
    other = "opposite" if float(point.travel) > 0 else "listed"
    return f"or is operation.travel = {other!r} meant? In that sense the drive runs"


def _runs(drive: Drive, point: OperatingPoint) -> bool:
    steady = quickly_compiled(_steady)(*canonical(drive, point))
    return bool(succeeded(steady.result))


def _steady(drive: Drive, point: OperatingPoint) -> SteadyState:
    return steady_state(drive, point, throw=False)


def _moved_layout_diagnosis(drive: Drive, steady: SteadyState) -> Diagnosis | None:
    if not drive.tensioners:
        return None
    places = steady.reference.coordinates
    fault = layout_fault(drive, places)
    if fault is None:
        return None
    moved = f"where it rests ({places_in_words(drive, places)}), "
    return Diagnosis(fault.key, moved + fault.message, False)


def places_in_words(drive: Drive, coordinates: Any) -> str:
    """Where the tensioners stand, from the drawn positions, in words."""
    words = []
    for body, place in zip(drive.tensioners, np.asarray(coordinates), strict=True):
        turns = float(body.kind) == KINDS["rotary"]
        far = f"{np.degrees(place):.1f} deg" if turns else f"{1e3 * place:.1f} mm"
        words.append(f"{body.name} moved by {far}")
    return ", ".join(words)


def _one_of(result: RESULTS, *members: RESULTS) -> bool:
    return any(bool(result == member) for member in members)


def _belt_diagnosis(drive: Drive, rule: BeltGiven) -> Diagnosis:
    # Of a body that slides, what moves its pulley about as far.
    size = float(jnp.mean(layout(drive, throw=False).span_lengths))
    reach = np.array([_SWEEP if float(b.kind) else _SWEEP * size / 4 for b in drive.tensioners])
    turns = jnp.linspace(-1.0, 1.0, 41)[:, None] * reach if len(reach) else jnp.zeros((1, 0))
    paths = jax.vmap(lambda turn: layout(drive, turn, throw=False).path_lengths)(turns)
    ends = np.stack([jnp.min(paths, axis=0), jnp.max(paths, axis=0)], axis=1)
    lengths = np.broadcast_to(np.asarray(rule.belt_length), (len(drive.belts),))
    # The belt that is farthest from its path's range, or nearest to its end. A short one stretches.
    short, long = 1 - lengths * (1 + LARGEST_STRAIN) / ends[:, 0], lengths / ends[:, 1] - 1
    belt = int(np.argmax(np.maximum(short, long)))
    found, (shortest, longest) = float(lengths[belt]), ends[belt].tolist()
    key = belt_length_key(drive.belts[belt].name, len(drive.belts) == 1)
    reached = [shortest, longest] if len(turns) > 1 else [shortest]
    (length, *path), along = _as_the_file_counts(drive, key, found, *reached)
    too = (
        "too short"
        if found < shortest
        else "too long"
        if found > longest
        else "not held by the springs as they are relaxed"
    )
    remedy = "change belt_length"
    if len(turns) > 1:
        remedy += " or what its springs have (free_angle, free or preload)" + _stops_off(drive)
    stiff = float(drive.belts[belt].bending_stiffness) > 0
    if stiff and longest < found < (1 + _ROOM) * longest:
        remedy += "; that is for a string: `beltjax contact` finds whether a stiff belt is tight"
    message = f"found {length}, {too}: the path takes {' to '.join(path)} along the {along}"
    return Diagnosis(key, f"{message}; {remedy}", True)


def _as_the_file_counts(drive: Drive, key: str, *lengths: float) -> tuple[list[str], str]:
    """Lengths of a belt [m] in the file's unit and along its line, and the name of that line.

    They have so many decimals, a tenth of a millimeter at least, that none looks like another.
    """
    shift, unit = drive.units.shifts.get(key, 0.0), drive.units.get(key, "m")
    shown = [in_unit(length + shift, "m", unit) for length in lengths]
    least = max(4 - round(math.log10(in_unit(1.0, "m", unit))), 0)
    texts: list[str] = []
    for decimals in range(least, least + 12):
        texts = [f"{length:.{decimals}f}" for length in shown]
        if len(set(texts)) == len(set(shown)):
            break
    line = "effective line" if shift else "neutral axis"
    return [f"{text} {unit}" for text in texts], line


def _stops_off(drive: Drive) -> str:
    """Says so where the stops of a tensioner leave out its drawn position; else empty."""
    for body in drive.tensioners:
        least, greatest = np.asarray(body.stops)
        if not least <= 0 <= greatest:
            return (
                f"; the stops of {body.name} leave out the drawn position: those of [tensioner] "
                "are directions of the arm, those of [[tensioner]] count from the drawn position"
            )
    return ""


def _adjusted_diagnosis(drive: Drive, rule: AdjustedToTension | AdjustedToMark) -> Diagnosis | None:
    """Says so where no place of the tensioner that is adjusted makes a path of the belt's length.

    The belt may be shorter than the path by its stretch under the given tension.
    """
    if len(drive.belts) > 1:
        return None
    body = drive.tensioners[int(np.argmax(np.asarray(rule.adjusted)))]
    turns = float(body.kind) == KINDS["rotary"]
    size = np.pi if turns else float(jnp.mean(layout(drive, throw=False).span_lengths))
    least, greatest = np.clip(np.asarray(body.stops, float).reshape(-1, 2)[0], -size, size)
    places = jnp.linspace(least, greatest, 361)[:, None] * rule.adjusted

    def path(place: Any) -> tuple[Any, Any]:
        at = layout(drive, place, throw=False)
        return at.path_length, jnp.min(at.wraps)

    lengths, wraps = (np.asarray(x) for x in jax.vmap(path)(places))
    paths = lengths[wraps > 0]
    length, strain = float(rule.belt_length), LARGEST_STRAIN
    if isinstance(rule, AdjustedToTension):
        strain = float(rule.tension / drive.belt.axial_stiffness)
    if not paths.size or paths.min() / (1 + strain) <= length <= paths.max():
        return None
    too = "too long" if length > paths.max() else "too short"
    key = "installation.belt_length"
    ends = float(paths.min()), float(paths.max())
    (given, *reached), along = _as_the_file_counts(drive, key, length, *ends)
    return Diagnosis(
        key,
        f"found {given}, {too}: with {body.name} in the places that it reaches the path takes "
        f"{' to '.join(reached)} along the {along}; change belt_length, or give {body.name} more "
        "reach",
        True,
    )


def _strain_diagnosis(drive: Drive, point: OperatingPoint, steady: SteadyState) -> Diagnosis:
    at_rest = float(np.max(np.asarray(steady.reference.tensions)) / drive.belt.axial_stiffness)
    if at_rest > LARGEST_STRAIN:
        given = isinstance(drive.installation, BeltGiven | AdjustedToMark)
        key = "installation.belt_length" if given else "installation.tension"
        remedy = "give a longer one" if given else "lower it"
        message = f"stretches the belt by {at_rest:.3g} of its length at rest: {remedy}, or check "
        return Diagnosis(key, message + "belt.axial_stiffness", False)
    if float(steady.groups.bending) > 1.0:
        message = "makes the belt stiffer than its tension: check its value and unit"
        return Diagnosis("belt.bending_stiffness", message, False)
    return Diagnosis(speed_key(point), advice(drive, steady.result), False)


def _slack_diagnosis(drive: Drive, point: OperatingPoint, steady: SteadyState) -> Diagnosis:
    reference = steady.reference
    if reference.result == RESULTS.span_slack:
        tensions = np.asarray(reference.tensions)
        i = int(np.argmin(tensions))
        found = f"span {drive.span_names[i]} is slack at rest ({tensions[i]:.4g} N)"
        if getattr(drive.installation, "span_tensions", None) is not None:
            return Diagnosis("installation.span_tensions", f"{found}: give tensions above 0", False)
        remedy = f"{tightening(drive)}, or lower the torques"
        key = taken_key(point) or "operation.torque"
        return Diagnosis(key, f"{found} under these torques: {remedy}", False)
    span = drive.span_names[int(np.argmin(np.asarray(reference.tensions)))]
    return Diagnosis(
        speed_key(point),
        f"span {span} goes slack at a belt speed of {float(point.speed(drive)):.4g} m/s: lower the "
        f"speed, or {tightening(drive)}",
        False,
    )


def tightening(drive: Drive) -> str:
    """What an engineer does to have more tension, by the keys that the file gives."""
    rule = drive.installation
    if isinstance(rule, Preloaded):
        return "raise the preload, force or weight of its tensioner"
    if isinstance(rule, AdjustedToMark):
        return "move the mark (installation.until) to where its spring pulls more"
    if not isinstance(rule, BeltGiven):
        return "raise installation.tension"
    if rule.free_angle is not None:
        return "shorten installation.belt_length, or turn installation.free_angle further in"
    if drive.tensioners:
        return "shorten installation.belt_length, or relax its springs further in (free or preload)"
    return "shorten installation.belt_length"


def advice(drive: Drive, result: RESULTS) -> str:
    """The text of a result, and where its remedy is tension what the file has for that."""
    text, tight = explanation(result), tightening(drive)
    tense = re.search(r"[Rr]aise the (pre)?tension|the tension or", text)
    return f"{text} For more tension, {tight}." if tense else text


def taken_key(point: OperatingPoint) -> str:
    """The key of what accessories take; empty where they take nothing."""
    if any(float(torque) for torque in point.torque.values()):
        return "operation.torque"
    return "operation.load" if point.load else ""


def speed_key(point: OperatingPoint) -> str:
    """The key of the speed that the file gives."""
    return "operation.driver_speed" if point.belt_speed is None else "operation.belt_speed"
