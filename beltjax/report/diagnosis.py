"""Why an analysis failed, in the words of the drive file: which key, what was found, what to do."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from beltjax.analysis.steady import SteadyState
from beltjax.drive.components import BeltGiven, Drive, OperatingPoint
from beltjax.drive.layout import layout
from beltjax.results import RESULTS, explanation

_SWEEP = 1.0  # the arm is looked at this far to either side of where it is drawn [rad]


class Diagnosis(NamedTuple):
    """A failure for people."""

    key: str  # of the drive file
    message: str
    impossible: bool  # the file describes no drive at all, rather than one that does not run


def diagnose(drive: Drive, point: OperatingPoint, steady: SteadyState) -> Diagnosis:
    """What to tell the user about a steady state whose `result` is not successful."""
    result = steady.result
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
    key = "operation.torque" if point.torque else "installation"
    if result == RESULTS.belt_overstretched:
        key = _speed_key(point)
    return Diagnosis(key, explanation(result), False)


def _one_of(result: RESULTS, *members: RESULTS) -> bool:
    return any(bool(result == member) for member in members)


def _belt_diagnosis(drive: Drive, rule: BeltGiven) -> Diagnosis:
    turns = jnp.linspace(-_SWEEP, _SWEEP, 41) if drive.tensioner is not None else jnp.zeros(1)
    paths = jax.vmap(lambda turn: layout(drive, turn).path_length)(turns)
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


def _slack_diagnosis(drive: Drive, point: OperatingPoint, steady: SteadyState) -> Diagnosis:
    reference = steady.reference
    if reference.result == RESULTS.span_slack:
        return Diagnosis(
            "operation.torque" if point.torque else "installation.span_tensions",
            "a span is slack at rest under these torques: raise installation.tension, or lower "
            "the torques",
            False,
        )
    span = drive.span_names[int(np.argmin(np.asarray(reference.tensions)))]
    return Diagnosis(
        _speed_key(point),
        f"span {span} goes slack at a belt speed of {float(point.speed(drive)):.4g} m/s: lower the "
        "speed or raise installation.tension",
        False,
    )


def _speed_key(point: OperatingPoint) -> str:
    return "operation.driver_speed" if point.belt_speed is None else "operation.belt_speed"
