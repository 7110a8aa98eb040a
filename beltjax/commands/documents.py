"""What the command line writes as JSON: plain dictionaries with the fixed keys."""

import json
import math
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from beltjax.analysis.modes import Modes
from beltjax.analysis.sensitivity import Gradient, Sensitivities
from beltjax.analysis.steady import SteadyState
from beltjax.commands.schema import VERSION
from beltjax.commands.warnings import steady_warnings
from beltjax.draw.labels import mode_labels
from beltjax.drive.bodies import single_arm
from beltjax.drive.components import KINDS
from beltjax.drive.layout import Loops, alignment_angles
from beltjax.drive.numbers import named_numbers
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.shafts import transmission
from beltjax.drive.system import Drive
from beltjax.results import RESULTS, succeeded


def analysis_document(drive: Drive, point: OperatingPoint, found: Sensitivities) -> dict[str, Any]:
    """Layout, reference state, groups, steady state, modes and sensitivities of one drive.

    What does not apply is None: the arm of a drive without tensioner, the states beyond one
    that failed.
    """
    steady = found.steady
    running = bool(succeeded(steady.result))
    rested = bool(succeeded(steady.reference.result))
    rests = rested or bool(steady.reference.result == RESULTS.span_slack)
    return {
        "drive": drive.name,
        "model": model_flags(drive),
        "success": running,
        "warnings": steady_warnings(drive, steady),
        "layout": _layout(drive, steady),
        "reference": _reference(drive, steady, rested) if rests else None,
        "groups": _groups(steady) if rested else None,
        "steady": _steady(drive, steady) if running else None,
        "coordinates": coordinates(drive, steady) if rests else None,
        "belts": _belts(drive, steady, running) if rests else None,
        "pulleys": _pulleys(drive, point, steady, running),
        "spans": _spans(drive, steady, running),
        "isolators": _isolators(drive, steady) if rests else None,
        "modes": _modes(drive, found.modes) if running and found.modes else None,
        "sensitivities": _sensitivities(drive, found) if running else None,
    }


def _layout(drive: Drive, steady: SteadyState) -> dict[str, Any]:
    at = steady.reference.layout
    lengths = plain(at.span_lengths)
    spans = [
        {"name": name, "length": length}
        for name, length in zip(drive.span_names, lengths, strict=True)
    ]
    return {
        "spans": spans,
        "wraps_deg": plain(np.degrees(at.wraps)),
        "path_length": plain(at.path_length),
        "alignment_angles_deg": plain(np.degrees(alignment_angles(drive, at)[0]))
        if single_arm(drive)
        else None,
    }


def _reference(drive: Drive, steady: SteadyState, rested: bool) -> dict[str, Any]:
    reference = steady.reference
    arm = single_arm(drive)
    effective = rested and len(drive.tensioners) > 0
    return {
        "tensions": plain(reference.tensions),
        "unstretched_length": plain(reference.unstretched_length),
        "arm_angle": plain(reference.arm_angle) if arm else None,
        "arm_turn": plain(reference.coordinates[0]) if arm else None,  # from drawn
        "free_angle": plain(reference.free_angle) if arm else None,
        "tensioner_effectiveness": plain(steady.effectiveness) if effective else None,
    }


def _groups(steady: SteadyState) -> dict[str, Any]:
    groups, scales = steady.groups, steady.scales
    return {
        "bending": plain(groups.bending),
        "speed": plain(groups.speed),
        "stretch": plain(groups.stretch),
        "spring": plain(groups.spring) if len(groups.units) == 1 else None,
        "tensions": plain(groups.tensions),
        "length": plain(scales.length),
        "time": plain(scales.time),
    }


def _steady(drive: Drive, steady: SteadyState) -> dict[str, Any]:
    return {
        "tension_change": plain(steady.tension_change),
        "tensions": plain(steady.running_tensions),
        "arm_rotation": plain(steady.arm_rotation) if single_arm(drive) else None,
        "coupling": plain(steady.coupling),
        "stiffness_ratios": plain(steady.stiffness_ratios),
        "coupling_total": plain(np.sum(steady.coupling)),
    }


def model_flags(drive: Drive) -> dict[str, bool]:
    """Which terms that the source leaves out are counted."""
    names = "arm_curvature", "stretching_arcs", "belt_inertia"
    return {name: bool(float(getattr(drive.model, name))) for name in names}


def coordinates(drive: Drive, steady: SteadyState) -> list[dict[str, Any]]:
    """Where each tensioner stands: installed, at rest with torques, and how running moves it."""
    reference, stops = steady.reference, {-1: "least", 1: "greatest"}
    columns = zip(
        drive.tensioners,
        plain(reference.installed),
        plain(reference.coordinates),
        plain(steady.coordinate_change),
        np.where(steady.at_stop != 0, steady.at_stop, reference.at_stop).tolist(),
        strict=True,
    )
    kinds = {sign: word for word, sign in KINDS.items()}
    return [
        {
            "name": body.name,
            "kind": kinds[float(body.kind)],
            "installed": installed,
            "at_rest": at_rest,
            "change": change,
            "at_stop": stops.get(int(at_stop)),
        }
        for body, installed, at_rest, change, at_stop in columns
    ]


def _belts(drive: Drive, steady: SteadyState, running: bool) -> list[dict[str, Any]]:
    reference, scales = steady.reference, steady.scales
    changes = np.atleast_1d(np.asarray(steady.tension_change)) * float(scales.tension)
    mass = float(drive.belt.mass_per_length)
    speeds = np.asarray(steady.groups.speeds) * np.sqrt(float(scales.tension) / mass)
    columns = zip(
        drive.belts,
        plain(changes),
        plain(reference.unstretched_lengths),
        plain(reference.layout.path_lengths),
        plain(speeds),
        strict=True,
    )
    return [
        {
            "name": belt.name,
            "tension_change": change if running else None,
            "unstretched_length": unstretched,
            "path_length": path,
            "speed": speed,
        }
        for belt, change, unstretched, path, speed in columns
    ]


def _pulleys(
    drive: Drive, point: OperatingPoint, steady: SteadyState, running: bool
) -> list[dict[str, Any]]:
    at, driven = steady.reference.layout, transmission(drive, point)
    pulls = np.asarray(steady.running_tensions)[:, None] * np.asarray(at.directions)
    loads = pulls - np.asarray(Loops(drive.loop_sizes).preceding(jnp.asarray(pulls)))
    columns = zip(
        drive.pulley_names,
        plain(np.degrees(at.wraps)),
        plain(np.asarray(driven.turning * driven.speeds / drive.radii)),
        plain(loads),
        plain(driven.torques),
        strict=True,
    )
    return [
        {
            "name": name,
            "wrap_deg": wrap,
            "speed": speed,
            "hub_load": load if running else None,
            "torque": torque,
        }
        for name, wrap, speed, load, torque in columns
    ]


def _spans(drive: Drive, steady: SteadyState, running: bool) -> list[dict[str, Any]]:
    at, rest = steady.reference.layout, np.asarray(steady.reference.tensions)
    of_span = [drive.belts[b] for b in drive.belt_of_span]
    bending = np.array([float(belt.bending_stiffness) for belt in of_span])
    mass = np.array([float(belt.mass_per_length) for belt in of_span])
    number = np.pi / np.asarray(at.span_lengths)  # of the half wave
    # What a tension meter hears: the held span at rest, whose ends turn freely.
    squares = number**2 * (rest + bending * number**2) / mass
    hertz = np.sqrt(np.maximum(squares, 0.0)) / (2 * np.pi)
    columns = zip(
        drive.span_names,
        plain(at.span_lengths),
        plain(steady.running_tensions),
        plain(hertz),
        strict=True,
    )
    rests = bool(succeeded(steady.reference.result))
    return [
        {
            "name": name,
            "length": length,
            "tension": tension if running else None,
            "meter_hz": heard if rests else None,
        }
        for name, length, tension, heard in columns
    ]


def _isolators(drive: Drive, steady: SteadyState) -> list[dict[str, Any]]:
    torques = np.asarray(steady.reference.torques)
    found = []
    for isolator in drive.isolators:
        flags = np.asarray(isolator.pulleys)
        torque = float(np.sum(flags * torques))
        found.append(
            {
                "pulley": drive.pulley_names[int(np.argmax(flags))],
                "torque": torque,
                "wind_up": torque / float(isolator.stiffness),
            }
        )
    return found


def _modes(drive: Drive, modes: Modes) -> dict[str, Any]:
    return {
        "dimensionless": plain(modes.dimensionless),
        "hertz": plain(np.asarray(modes.frequencies) / (2 * np.pi)),
        "labels": list(mode_labels(drive, modes)),
        "error": plain(modes.error),
    }


def _sensitivities(drive: Drive, found: Sensitivities) -> dict[str, Any]:
    def named(gradient: Gradient) -> dict[str, Any]:
        # The point of a gradient has the numbers that the drive's own has.
        return plain_numbers(*gradient, of=(drive, gradient[1]))

    frequencies = found.frequencies
    return {
        "coupling_total": named(found.coupling),
        "frequencies": None if frequencies is None else named(frequencies),
    }


def plain_numbers(
    drive: Drive, point: OperatingPoint, of: tuple[Drive, OperatingPoint] | None = None
) -> dict[str, Any]:
    """The numbers of a drive, or of a gradient by those `of` one, by their keys in the file."""
    return {name: plain(value) for name, value in named_numbers(drive, point, of).items()}


def design_document(design: Any) -> dict[str, Any]:
    """The outcome of a `beltjax.optimize.Design`."""
    asked = [constraint for constraint in design.constraints if not constraint.implied]
    implied = [constraint for constraint in design.constraints if constraint.implied]
    return {
        "model": model_flags(design.drive),
        "warnings": steady_warnings(design.drive, design.steady),
        "design": dict(design.values),
        "objective": {"initial": design.initial, "final": design.final},  # None: nothing runs
        "constraints": [_constraint(constraint) for constraint in asked],
        "implied_constraints": [_constraint(constraint) for constraint in implied],
        "success": design.success,
        "starts": [{"final": start.final, "result": start.result} for start in design.starts],
        "active_bounds": design.bounds,
        "conflicts": list(design.conflicts),
        "optimality": _optimality(design.optimality),
        "optima": [optimum._asdict() for optimum in design.optima],
        "scales": design.scales,
        "history": {name: plain(path) for name, path in design.history._asdict().items()},
    }


def chosen_document(chosen: Sequence[Any]) -> dict[str, Any]:
    """The best design of every combination of a study's choices, the best first."""
    rows = [
        {
            "labels": one.labels,
            "numbers": one.numbers,
            "objective": one.design.final,
            "design": dict(one.design.values),
            "success": one.design.success,
        }
        for one in chosen
    ]
    return {"choices": rows}


def robust_document(design: Any, scatter: Any) -> dict[str, Any]:
    """What a study counts of its tolerances, and its design's values without them."""
    shown = [constraint for constraint in design.constraints if not constraint.implied]
    drawn = {
        "objective": design.as_drawn,
        "constraints": {constraint.quantity: constraint.as_drawn for constraint in shown},
    }
    return {"robust": {"counted": str(scatter), "numbers": list(scatter.names), "as_drawn": drawn}}


def front_document(front: Any) -> dict[str, Any]:
    """A `beltjax.optimize.Front`."""
    points = [
        {
            "objectives": dict(zip(front.names, point.objectives, strict=True)),
            "design": point.values,
            "residual": plain(point.residual),
        }
        for point in front.points
    ]
    return {"objectives": list(front.names), "points": points, "success": front.success}


def _optimality(shown: Any) -> dict[str, Any] | None:
    """How well the conditions of an optimum are met, in the scaled problem."""
    if shown is None:
        return None
    keys = ("residual", "stationarity", "violation", "complementarity", "curvature")
    return {key: getattr(shown, key) for key in keys}


def _constraint(constraint: Any) -> dict[str, Any]:
    keys = ("quantity", "value", "lower", "upper", "multiplier", "active", "violation")
    return {key: getattr(constraint, key) for key in keys}


def plain(value: Any) -> Any:
    """An array as a number or nested lists; what is not finite becomes None."""
    if value is None:
        return None
    number = np.asarray(value).tolist()
    if isinstance(number, list):
        return [plain(item) for item in number]
    return number if math.isfinite(number) else None


def complete(document: dict[str, Any]) -> dict[str, Any]:
    """A command's document with what all of them have: its version, and its warnings if none."""
    return {"schema": VERSION, "warnings": []} | document


def json_bytes(document: dict[str, Any]) -> bytes:
    """A JSON file of one object."""
    return (json_text(document) + "\n").encode()


def json_text(document: dict[str, Any]) -> str:
    """`document` as JSON text."""
    return json.dumps(document, indent=2, allow_nan=False)
