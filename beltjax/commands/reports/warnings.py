"""Warnings: limits of the trust in a result, in words, for the JSON and the tables."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from rich.text import Text

from beltjax.analysis.damping import Damping
from beltjax.analysis.periodic import STEEPEST, PeriodicResponse
from beltjax.analysis.response import Response
from beltjax.analysis.steady import FARTHEST, STIFFEST, SteadyState
from beltjax.analysis.sweep import Sweep
from beltjax.analysis.transient import Transient
from beltjax.commands.reports.states import Readings, read_state, slip_margins
from beltjax.commands.reports.vibrating import RPM
from beltjax.compiling.kept_programs import run_kept
from beltjax.drive.canonical import canonical
from beltjax.drive.numbers import with_number
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.shafts import transmission
from beltjax.drive.system import Drive
from beltjax.results import RESULTS, succeeded, successes

Warnings = list[dict[str, str]]

_SLACK = "a span loses its tension during the motion, where slack is not in the model"
_STEEP = "a span deflects by a slope above 0.2, where equations for small slopes are off"
_SLIPS = "tensions differ by more than friction holds, and slip is not in the model"


def steady_warnings(
    drive: Drive, point: OperatingPoint, steady: SteadyState, read: Readings
) -> Warnings:
    """Warn where a steady state leaves the limits of its model."""
    if not succeeded(steady.result):
        return []
    return [
        *_stiff_belts(drive, np.asarray(steady.stiffness_ratios)),
        *_far_tensioners(drive, steady),
        *load_warnings((drive, point)),
        *_overloaded_belts(drive, steady),
        *_slipping_pulleys(drive, steady, read),
        *_idle_dampers(drive),
    ]


def file_warnings(drive: Drive) -> Warnings:
    """Warn of bare numbers of the drive's file that are hardly meant in SI units."""
    return [{"code": "number_without_unit", "text": text} for text in drive.units.doubts]


def load_warnings(*runs: tuple[Drive, OperatingPoint]) -> Warnings:
    """Warn of pulleys that turn faster or slower than the tables of their loads say in a run."""
    found: dict[str, str] = {}
    for drive, point in runs:
        tables = {name: load for name, load in point.load.items() if load.speed is not None}
        driven = transmission(drive, point) if tables else None
        for name, load in tables.items():
            k = drive.pulley(name)
            if driven is not None and load.speed is not None and driven.outside[k]:
                speeds = driven.speeds[k] / drive.radii[k], load.speed[0], load.speed[-1]
                speed, least, greatest = (RPM * float(x) for x in speeds)
                table = f"{_digits(least)} to {_digits(greatest)}"
                found[name] = f"{name} turns at {_digits(speed)} rpm ({table} rpm)"
    if not found:
        return []
    text = (
        f"outside of the table of its load {', '.join(found.values())}, where the torque at the "
        "end of the table is held; extend the table, or change the speed"
    )
    return [{"code": "load_outside_table", "text": text}]


def _digits(value: float) -> str:
    """A number with four digits at least, and no power of ten where it is large."""
    return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"


def _far_tensioners(drive: Drive, steady: SteadyState) -> Warnings:
    """Tensioners that move so far that equations linear in their motion are off."""
    moved = np.abs(np.asarray(steady.deviation) / np.asarray(steady.groups.units))
    far = [
        f"{body.name} ({change:.2g})"
        for body, change in zip(drive.tensioners, moved, strict=True)
        if change > FARTHEST
    ]
    if not far:
        return []
    text = (
        f"running moves {', '.join(far)} by more than {FARTHEST:g} rad, or mean spans of a linear "
        "one, for which the equations, linear in that motion, are off; with [model] "
        "stretching_arcs = true the running string is exact"
    )
    return [{"code": "tensioner_moves_far", "text": text}]


def _overloaded_belts(drive: Drive, steady: SteadyState) -> Warnings:
    """Belts whose tension, at rest or running, is above the maker's limit."""
    most = np.maximum(np.asarray(steady.running_tensions), np.asarray(steady.reference.tensions))
    above = []
    for place, belt in enumerate(drive.belts):
        spans = np.flatnonzero(drive.belt_of_span == place)
        worst = spans[np.argmax(most[spans])]
        if belt.allowable_tension is not None and most[worst] > float(belt.allowable_tension):
            limit = f"{float(belt.allowable_tension):.4g} N"
            above.append(f"{drive.span_names[worst]} has {most[worst]:.4g} N of {limit}")
    if not above:
        return []
    text = f"the tension is above the belt's allowable_tension: {', '.join(above)}"
    return [{"code": "tension_above_allowable", "text": text}]


def _slipping_pulleys(drive: Drive, steady: SteadyState, read: Readings) -> Warnings:
    """Pulleys whose friction and wrap do not hold the tensions beside them."""
    margins = zip(drive.pulley_names, slip_margins(drive, steady, read), strict=True)
    slip = [
        f"{name} ({margin:.2g})" for name, margin in margins if margin is not None and margin < 0
    ]
    if not slip:
        return []
    text = (
        f"the belt slips on {', '.join(slip)}: the slip margin, friction times wrap less the "
        "logarithm of the tensions' ratio, is below 0, so that the torques cannot be transmitted; "
        "raise the tension, the wrap or the friction"
    )
    return [{"code": "belt_slips", "text": text}]


def _idle_dampers(drive: Drive) -> Warnings:
    """Dampers on the hub of the driver, whose motion is given: they change nothing."""
    drives = np.asarray(drive.drives)
    idle = [
        damper.name
        for damper in drive.dampers
        if not float(damper.on_rim) and float(np.asarray(damper.pulley) @ drives)
    ]
    if not idle:
        return []
    text = (
        f"the damper on the hub of {', '.join(idle)} has no effect: the motion of the driver's hub "
        'is given; put it on the rim of an isolator (at = "rim") if it is there'
    )
    return [{"code": "damper_on_given_motion", "text": text}]


def drive_warnings(drive: Drive, point: OperatingPoint) -> Warnings:
    """The warnings of the drive from which a study of many drives starts."""
    return [*file_warnings(drive), *state_warnings(drive, point)]


def state_warnings(drive: Drive, point: OperatingPoint) -> Warnings:
    """`steady_warnings` of the drive's steady state at that point."""
    found = jax.device_get(run_kept(read_state, *canonical(drive, point)))
    return steady_warnings(drive, point, *found)


def sweep_warnings(drive: Drive, point: OperatingPoint, found: Sweep) -> Warnings:
    """Warn where the steady states of a sweep do so, at the worst of its values."""
    stiff = [*file_warnings(drive), *_stiff_belts(drive, found.stiffness_ratios[found.good])]
    if not point.load:
        return stiff
    return [*stiff, *load_warnings(*_ends(drive, point, found.name, found.values))]


def range_warnings(drive: Drive, point: OperatingPoint, speeds: np.ndarray) -> Warnings:
    """What loads do to vibration over a range of the driver's speed [rad/s]."""
    if not point.load:
        return []
    ends = _ends(drive, point, "operation.driver_speed", speeds)
    return [*load_warnings(*ends), *_exciting_loads(*ends)]


def _exciting_loads(*runs: tuple[Drive, OperatingPoint]) -> Warnings:
    """Warn of loads whose torque falls with speed."""
    found: dict[str, float] = {}
    for drive, point in runs:
        slopes = transmission(drive, point).slopes
        for name in point.load:
            found[name] = min(found.get(name, 0.0), float(slopes[drive.pulley(name)]))
    parts = [f"{name} ({slope:.2g} N m s/rad)" for name, slope in found.items() if slope < 0]
    if not parts:
        return []
    text = (
        f"a load takes less torque at a higher speed, which excites rotation: {', '.join(parts)}; "
        "it is counted"
    )
    return [{"code": "load_excites", "text": text}]


def _ends(
    drive: Drive, point: OperatingPoint, name: str, values: np.ndarray
) -> list[tuple[Drive, OperatingPoint]]:
    """The drive and point at the ends of a range of one number."""
    return [with_number(drive, point, name, x) for x in jnp.asarray(values)[jnp.array([0, -1])]]


def _stiff_belts(drive: Drive, ratios: np.ndarray) -> Warnings:
    """For which pulleys the belt is stiff; ratios [points, pulleys] or [pulleys]."""
    table = ratios.reshape(-1, len(drive.pulley_names))
    worst = np.max(table, axis=0, initial=0.0)
    stiff = [
        f"{name} ({ratio:.2g})"
        for name, ratio in zip(drive.pulley_names, worst, strict=True)
        if ratio > STIFFEST
    ]
    if not stiff:
        return []
    text = (
        f"the belt is stiff for {', '.join(stiff)}: sqrt(EI/T)/radius is above {STIFFEST:g}, so "
        "that tensions, wraps and Gamma with the contact points of a string are off; "
        "`beltjax contact` finds where the belt really touches"
    )
    return [{"code": "belt_stiff_on_pulley", "text": text}]


def modes_left_out(drive: Drive, most: int) -> dict[str, str]:
    """That a drive has more pulleys than modes are found for."""
    text = (
        f"modes are left out: they are found for {most} pulleys at most, and there are "
        f"{len(drive.pulleys)}"
    )
    return {"code": "modes_left_out", "text": text}


def response_warnings(drive: Drive, found: Response) -> Warnings:
    """Stiff belts, and which spans would go slack under which part of the excitation."""
    good = successes(found.result)
    if not good.any():
        return []
    stiff = _stiff_belts(drive, np.asarray(found.stiffness_ratios)[good])
    least = np.min(np.asarray(found.slack_factors)[good], axis=0)
    slack = [
        f"{name} from {factor:.3g} of this excitation on"
        for name, factor in zip(drive.span_names, least, strict=True)
        if factor < 1
    ]
    if not slack:
        return stiff
    text = (
        "the fluctuation of a tension exceeds the running tension, where a span goes slack and "
        f"linear amplitudes do not hold: {', '.join(slack)}; `beltjax periodic` finds the motion"
    )
    return [*stiff, {"code": "span_slackens", "text": text}]


def periodic_warnings(
    drive: Drive, speeds: np.ndarray, found: Sequence[PeriodicResponse]
) -> Warnings:
    """At which speeds motions that were found leave the limits of their model, and where."""
    good = [
        (speed, one)
        for speed, one in zip(speeds, found, strict=True)
        if bool(succeeded(one.result))
    ]
    if not good:
        return []
    rpm = np.array([speed for speed, _ in good]) * RPM

    def table(of: Callable[[PeriodicResponse], Any]) -> np.ndarray:
        return np.array([np.asarray(of(one)) for _, one in good])

    ratios = table(lambda one: one.linearization.steady.stiffness_ratios)
    largest = np.abs(table(_largest_multiplier))[:, None]
    spans, pulleys = drive.span_names, drive.pulley_names
    return [
        *_stiff_belts(drive, ratios),
        *_where("orbit_unstable", "the motion is unstable", rpm, largest > 1, [""]),
        *_where(
            "span_slack_in_motion",
            _SLACK,
            rpm,
            table(lambda one: one.measures.tension_min) < 0,
            spans,
        ),
        *_where(
            "slope_too_large",
            _STEEP,
            rpm,
            table(lambda one: one.measures.slope_max) > STEEPEST,
            spans,
        ),
        *_where(
            "belt_slips_in_motion",
            _SLIPS,
            rpm,
            table(lambda one: one.friction_use) > 1,
            pulleys,
        ),
        *_where(
            "grazing",
            "an event only just happens, and derivatives hold as long as it does",
            rpm,
            table(lambda one: one.warning == RESULTS.grazing)[:, None],
            [""],
        ),
    ]


def transient_warnings(drive: Drive, found: Transient) -> Warnings:
    """Where a motion over time leaves the limits of its model."""
    if not bool(succeeded(found.result)):
        return []
    m, spans = found.measures, drive.span_names
    flags = (
        ("span_slack_in_motion", _SLACK, m.tension_min < 0, spans),
        ("slope_too_large", _STEEP, m.slope_max > STEEPEST, spans),
        ("belt_slips_in_motion", _SLIPS, found.friction_use > 1, drive.pulley_names),
    )
    return [
        *_stiff_belts(drive, np.asarray(found.linearization.steady.stiffness_ratios)),
        *(
            {"code": code, "text": f"{text}: {', '.join(np.array(names)[np.asarray(bad)])}"}
            for code, text, bad, names in flags
            if np.any(bad)
        ),
    ]


def joined_clutches(drive: Drive, damping: Damping) -> Warnings:
    """Clutches whose sides modal damping joins while they are open."""
    clutches = [part.name for part in drive.isolators if float(part.law)]
    if not (clutches and float(damping.modal)):
        return []
    text = (
        "modal damping joins rim and hub also while a clutch is open, and brakes its overrun: "
        f"{', '.join(clutches)}; give --belt-damping in its place"
    )
    return [{"code": "damping_joins_clutch", "text": text}]


def _largest_multiplier(found: PeriodicResponse) -> Any:
    assert found.multipliers is not None  # the command asks for stability
    return found.multipliers[0]


def _where(
    code: str, text: str, rpm: np.ndarray, bad: np.ndarray, names: Sequence[str]
) -> Warnings:
    """A warning of the parts and speeds that are `bad` [speeds, parts]."""
    if not bad.any():
        return []
    at = rpm[bad.any(axis=1)]
    parts = ", ".join(filter(None, np.array(names, object)[bad.any(axis=0)]))
    speeds = (
        f"{_digits(at[0])} rpm"
        if len(at) == 1
        else f"{len(at)} speeds, the first {_digits(at[0])} rpm"
    )
    return [{"code": code, "text": f"{text}: {parts + ', ' if parts else ''}at {speeds}"}]


def slack_first(tongues: Sequence[dict[str, Any]], alone: bool, modes_left: bool) -> Warnings:
    """Warn of tongues that are reached only with a slack span, and of modes not looked at."""
    found: Warnings = []
    beyond = [one for one in tongues if one["slack"] and one["critical_factor"] is not None]
    if beyond and alone:
        least = min(one["slack_factor"] for one in beyond)
        text = (
            f"slack comes first: a span goes slack at {least:.3g} times the excitation, before any "
            "tongue is reached, and linear theory ends there"
        )
        found.append({"code": "span_slackens", "text": text})
    if modes_left:
        text = (
            "modes are left out: pairs of higher modes than are looked at resonate at the upper "
            "end of the range; lower --speeds"
        )
        found.append({"code": "modes_left_out", "text": text})
    return found


def warning_lines(document: dict[str, Any]) -> list[Text]:
    """The warnings of a document as they stand above its tables."""
    return [Text(f"warning: {one['text']}\n", style="yellow") for one in document["warnings"]]
