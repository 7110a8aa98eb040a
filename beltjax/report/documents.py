"""What the command line writes as JSON: plain dictionaries with the fixed keys."""

import json
import math
import os
from typing import Any

import numpy as np

from beltjax.analysis.modes import Modes
from beltjax.analysis.sensitivity import Sensitivities, named_numbers
from beltjax.analysis.steady import SteadyState
from beltjax.drive.components import Drive, OperatingPoint
from beltjax.results import RESULTS, succeeded
from beltjax.writing import write_whole


def analysis_document(drive: Drive, found: Sensitivities) -> dict[str, Any]:
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
        "success": running,
        "layout": _layout(drive, steady),
        "reference": _reference(drive, steady, rested) if rests else None,
        "groups": _groups(steady) if rested else None,
        "steady": _steady(steady) if running else None,
        "modes": _modes(drive, found.modes) if running and found.modes else None,
        "sensitivities": _sensitivities(found) if running else None,
    }


def _layout(drive: Drive, steady: SteadyState) -> dict[str, Any]:
    at = steady.reference.layout
    lengths = _plain(at.span_lengths)
    spans = [
        {"name": name, "length": length}
        for name, length in zip(drive.span_names, lengths, strict=True)
    ]
    return {
        "spans": spans,
        "wraps_deg": _plain(np.degrees(at.wraps)),
        "path_length": _plain(at.path_length),
        "alignment_angles_deg": None
        if drive.tensioner is None
        else _plain(np.degrees(at.alignment)),
    }


def _reference(drive: Drive, steady: SteadyState, rested: bool) -> dict[str, Any]:
    reference = steady.reference
    effective = rested and drive.tensioner is not None
    return {
        "tensions": _plain(reference.tensions),
        "unstretched_length": _plain(reference.unstretched_length),
        "arm_angle": _plain(reference.arm_angle),
        "free_angle": _plain(reference.free_angle),
        "tensioner_effectiveness": _plain(steady.effectiveness) if effective else None,
    }


def _groups(steady: SteadyState) -> dict[str, Any]:
    groups, scales = steady.groups, steady.scales
    return {
        "bending": _plain(groups.bending),
        "speed": _plain(groups.speed),
        "stretch": _plain(groups.stretch),
        "spring": None if steady.reference.arm_angle is None else _plain(groups.spring),
        "tensions": _plain(groups.tensions),
        "length": _plain(scales.length),
        "time": _plain(scales.time),
    }


def _steady(steady: SteadyState) -> dict[str, Any]:
    return {
        "tension_change": _plain(steady.tension_change),
        "arm_rotation": _plain(steady.arm_rotation),
        "coupling": _plain(steady.coupling),
        "coupling_total": _plain(np.sum(steady.coupling)),
    }


def _modes(drive: Drive, modes: Modes) -> dict[str, Any]:
    return {
        "dimensionless": _plain(modes.dimensionless),
        "hertz": _plain(np.asarray(modes.frequencies) / (2 * np.pi)),
        "labels": list(mode_labels(drive, modes)),
        "error": _plain(modes.error),
    }


def mode_labels(drive: Drive, modes: Modes) -> tuple[str, ...]:
    """The modes' labels with the spans' names in them."""
    names = {f"span {i}": f"span {name}" for i, name in enumerate(drive.span_names)}
    return tuple(names.get(label, label) for label in modes.labels)


def _sensitivities(found: Sensitivities) -> dict[str, Any]:
    frequencies = found.frequencies
    return {
        "coupling_total": plain_numbers(*found.coupling),
        "frequencies": None if frequencies is None else plain_numbers(*frequencies),
    }


def plain_numbers(drive: Drive, point: OperatingPoint) -> dict[str, Any]:
    """The numbers of a drive, or of a gradient of one, by their keys in the file."""
    return {name: _plain(value) for name, value in named_numbers(drive, point).items()}


def design_document(design: Any) -> dict[str, Any]:
    """The outcome of a `beltjax.optimize.Design`."""
    asked = [constraint for constraint in design.constraints if not constraint.implied]
    implied = [constraint for constraint in design.constraints if constraint.implied]
    return {
        "design": dict(design.values),
        "objective": {"initial": design.initial, "final": design.final},  # None: nothing runs
        "constraints": [_constraint(constraint) for constraint in asked],
        "implied_constraints": [_constraint(constraint) for constraint in implied],
        "success": design.success,
        "starts": [{"final": start.final, "result": start.result} for start in design.starts],
    }


def _constraint(constraint: Any) -> dict[str, Any]:
    keys = ("quantity", "value", "lower", "upper", "multiplier", "active", "violation")
    return {key: getattr(constraint, key) for key in keys}


def _plain(value: Any) -> Any:
    """An array as a number or nested lists; what is not finite becomes None."""
    if value is None:
        return None
    plain = np.asarray(value).tolist()
    if isinstance(plain, list):
        return [_plain(item) for item in plain]
    return plain if math.isfinite(plain) else None


def write_json(document: dict[str, Any], path: str | os.PathLike[str]) -> None:
    """Write one JSON object in one move: the file is complete or absent."""
    write_whole(path, (json_text(document) + "\n").encode())


def json_text(document: dict[str, Any]) -> str:
    """`document` as JSON text."""
    return json.dumps(document, indent=2, allow_nan=False)
