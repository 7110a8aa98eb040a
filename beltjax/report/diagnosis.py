"""Why an analysis failed, in the words of the drive file: which key, what was found, what to do."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from beltjax.analysis.reference import LARGEST_STRAIN
from beltjax.analysis.steady import SteadyState
from beltjax.drive.checks import layout_fault
from beltjax.drive.components import BeltGiven, Drive, OperatingPoint
from beltjax.drive.layout import layout
from beltjax.results import RESULTS, explanation, succeeded

_SWEEP = 1.0  # the arm is looked at this far to either side of where it is drawn [rad]


class Diagnosis(NamedTuple):
    """A failure for people."""

    key: str  # of the drive file
    message: str
    impossible: bool  # the file describes no drive at all, rather than one that does not run


def diagnose(drive: Drive, point: OperatingPoint, steady: SteadyState) -> Diagnosis | None:
    """What to tell the user about a steady state that is no drive's; None if all is well.

    The layout at rest is checked as the drawn one was: torques, or a belt that is given, may
    have turned the arm into another pulley.
    """
    result = steady.result
    if succeeded(result):
        return _moved_layout_diagnosis(drive, steady)
    if isinstance(drive.installation, BeltGiven) and _one_of(
        result, RESULTS.belt_too_long, RESULTS.belt_too_short, RESULTS.belt_does_not_fit
    ):
        return _belt_diagnosis(drive, drive.installation)
    if result == RESULTS.span_slack:
        return _slack_diagnosis(drive, point, steady)
    if result == RESULTS.arm_at_stop:
        angle = np.degrees(float(steady.reference.layout.arm_angle))
        return Diagnosis(
            "tensioner.stops",
            f"the arm would stand at {angle:.1f} deg: {explanation(result)}",
            False,
        )
    if result == RESULTS.belt_overstretched:
        return _strain_diagnosis(drive, point, steady)
    loaded = any(float(torque) for torque in point.torque.values())
    key = "operation.torque" if loaded else "installation"
    return Diagnosis(key, explanation(result), False)


def _moved_layout_diagnosis(drive: Drive, steady: SteadyState) -> Diagnosis | None:
    if drive.tensioner is None:
        return None
    # In NumPy: JAX would compile each operation.
    carried = next(pulley.center for pulley in drive.pulleys if float(pulley.on_arm))
    x, y = np.asarray(carried) - np.asarray(drive.tensioner.pivot)
    drawn = float(np.arctan2(y, x))
    turn = float(steady.reference.layout.arm_angle) - drawn
    fault = layout_fault(drive, turn)
    if fault is None:
        return None
    moved = f"with the arm turned by {np.degrees(turn):.1f} deg to where it rests, "
    return Diagnosis(fault.key, moved + fault.message, False)


def _one_of(result: RESULTS, *members: RESULTS) -> bool:
    return any(bool(result == member) for member in members)


def _belt_diagnosis(drive: Drive, rule: BeltGiven) -> Diagnosis:
    turns = jnp.linspace(-_SWEEP, _SWEEP, 41) if drive.tensioner is not None else jnp.zeros(1)
    paths = jax.vmap(lambda turn: layout(drive, turn, throw=False).path_length)(turns)
    shortest, longest = float(jnp.min(paths)), float(jnp.max(paths))
    found = float(rule.belt_length)
    reach = f"{shortest:.4f} m" if len(turns) == 1 else f"{shortest:.4f} to {longest:.4f} m"
    too = (
        "too short"
        if found < shortest
        else "too long"
        if found > longest
        else "not held by free_angle"
    )
    remedy = "change belt_length or free_angle" if len(turns) > 1 else "change belt_length"
    return Diagnosis(
        "installation.belt_length",
        f"found {found:.4f} m, {too}: the path takes {reach}; {remedy}",
        True,
    )


def _strain_diagnosis(drive: Drive, point: OperatingPoint, steady: SteadyState) -> Diagnosis:
    at_rest = float(np.max(np.asarray(steady.reference.tensions)) / drive.belt.axial_stiffness)
    if at_rest > LARGEST_STRAIN:
        message = f"stretches the belt by {at_rest:.3g} of its length at rest: lower it, or check "
        return Diagnosis("installation.tension", message + "belt.axial_stiffness", False)
    if float(steady.groups.bending) > 1.0:
        message = "makes the belt stiffer than its tension: check its value and unit"
        return Diagnosis("belt.bending_stiffness", message, False)
    return Diagnosis(speed_key(point), explanation(steady.result), False)


def _slack_diagnosis(drive: Drive, point: OperatingPoint, steady: SteadyState) -> Diagnosis:
    reference = steady.reference
    if reference.result == RESULTS.span_slack:
        tensions = np.asarray(reference.tensions)
        i = int(np.argmin(tensions))
        found = f"span {drive.span_names[i]} is slack at rest ({tensions[i]:.4g} N)"
        if getattr(drive.installation, "span_tensions", None) is not None:
            return Diagnosis("installation.span_tensions", f"{found}: give tensions above 0", False)
        remedy = "raise installation.tension, or lower the torques"
        return Diagnosis("operation.torque", f"{found} under these torques: {remedy}", False)
    span = drive.span_names[int(np.argmin(np.asarray(reference.tensions)))]
    return Diagnosis(
        speed_key(point),
        f"span {span} goes slack at a belt speed of {float(point.speed(drive)):.4g} m/s: lower the "
        "speed or raise installation.tension",
        False,
    )


def speed_key(point: OperatingPoint) -> str:
    """The key of the speed that the file gives."""
    return "operation.driver_speed" if point.belt_speed is None else "operation.belt_speed"
