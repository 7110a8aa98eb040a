"""The work of `beltjax contact` for a belt that wedges in grooves."""

import os
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Group
from rich.markup import escape
from rich.table import Table

from beltjax.analysis.groove import GrooveState, groove_solution
from beltjax.analysis.groove_methods import (
    AdhesionLimit,
    SlipLimit,
    groove_method,
    groove_question,
    unmet_groove,
)
from beltjax.commands.reports.arguments import titled
from beltjax.commands.reports.diagnosis import Diagnosis, advice, speed_key, taken_key, travel_lead
from beltjax.commands.reports.documents import model_flags, plain
from beltjax.commands.reports.report import Report
from beltjax.commands.reports.states import STOPS
from beltjax.commands.reports.tables import plain_table, quantity_table
from beltjax.commands.reports.units import TableUnits
from beltjax.commands.reports.warnings import file_warnings, load_warnings, warning_lines
from beltjax.compiling.quick import thoroughly_compiled
from beltjax.drive.bodies import single_arm
from beltjax.drive.canonical import canonical
from beltjax.drive.layout import layout
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.shafts import transmission
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.results import RESULTS, code, explanation, outcomes, succeeded

_ZONES = "seating", "adhesion", "sliding", "unseating"


def groove_report(
    path: str | os.PathLike[str],
    read: tuple[Drive, OperatingPoint, Any],
    limit: str | None,
    pictures: tuple[str | None, str | None],
    si: bool,
) -> Report:
    """The state of a belt in grooves, under the file's torques or, with a `limit`, the largest.

    Raises `FileError` where the file leaves out what grooves need; a state that was not found is a
    report with a `failure`.
    """
    drive, point, at = read
    unmet = unmet_groove(drive, point, limit is not None)
    if unmet is not None:
        raise FileError(path, unmet.key, unmet.message)
    figure, compare = pictures
    if compare:
        raise FileError("--compare", "", "belongs to a belt without groove; leave it out")
    limits = {None: None, "slip": SlipLimit(drive.contact.slip_limit), "adhesion": AdhesionLimit()}
    question = groove_question(groove_method(drive), limits[limit])
    state = thoroughly_compiled(groove_solution)(*canonical(drive, point), *question)
    state = jax.device_get(state)
    why = diagnose_groove(drive, point, state)
    if why and why.impossible:
        raise FileError(path, why.key, why.message)
    warnings = [*file_warnings(drive), *load_warnings((drive, point)), *_blurred(state)]
    document = groove_document(drive, point, state) | {"at": at, "warnings": warnings}
    document["limit"] = limit
    drawn: tuple[tuple[str, bytes], ...] = ()
    if figure and document["pulleys"]:
        from beltjax.draw.groove import groove_figure  # slow to load
        from beltjax.draw.layouts import picture_bytes

        drawn = ((figure, picture_bytes(groove_figure(drive, state), figure)),)
    failure = str(FileError(path, why.key, why.message)) if why else ""
    return Report(document, groove_tables(document, TableUnits(drive, si)), failure, drawn)


def _blurred(state: GrooveState) -> list[dict[str, str]]:
    if succeeded(state.warning):
        return []
    names = {number: name for name, (number, _) in outcomes().items()}
    name = names[int(np.asarray(code(state.warning)))]
    return [{"code": name, "text": explanation(state.warning)}]


def diagnose_groove(drive: Drive, point: OperatingPoint, state: GrooveState) -> Diagnosis | None:
    """Say to the user why a state of grooves is not physical; None where it is."""
    result = state.result
    if succeeded(result):
        return None
    key, found = taken_key(point) or "operation.torque", ""
    if result == RESULTS.belt_overstretched:
        key = speed_key(point)
    if result == RESULTS.groove_unresolved:
        key = "contact.slip_velocity"
    lead = travel_lead(drive, point)
    message = found + advice(drive, result)
    if result == RESULTS.groove_not_found:
        message += lead and f" ({lead})"
    return Diagnosis(key, message, bool(result == RESULTS.no_torque_to_scale))


def groove_document(drive: Drive, point: OperatingPoint, state: GrooveState) -> dict[str, Any]:
    """A state of grooves with the keys of a contact; its numbers are None where none was found."""
    missing = RESULTS.groove_not_found, RESULTS.groove_unresolved, RESULTS.numbers_unusable
    found = not any(bool(state.result == one) for one in (*missing, RESULTS.no_torque_to_scale))
    moments = np.abs(np.asarray(state.moments))
    two = len(drive.pulleys) == 2
    places, stops = np.asarray(state.coordinates), np.asarray(state.at_stop)
    names = [body.name for body in drive.tensioners]
    single = single_arm(drive) and found
    arm = layout(drive, throw=False).arm_angle + places[0] if single else None
    belt = {
        "name": drive.belt.name,
        "unstretched_length": plain(state.unstretched_length),
        "string_tension": None,
        "unstretched_speed": plain(state.unstretched_speed),
        "mass_flow": plain(state.mass_flow),
    }
    alone = belt if found else {}
    ideal = _ideal_moment(drive, state)
    return {
        "drive": drive.name,
        "model": model_flags(drive),
        "feasible": bool(state.feasible),
        "pulleys": _pulleys(drive, point, state) if found else None,
        "spans": _spans(drive, state) if found else None,
        "belts": [belt] if found else None,
        "unstretched_length": alone.get("unstretched_length"),
        "efficiency": plain(state.efficiency) if found else None,
        "driver_moment": plain(state.driver_moment) if found else None,
        "driven_moment": float(moments[int(np.argmin(drive.drives))]) if found and two else None,
        "torque_factor": plain(state.torque_factor) if found else None,
        "string_tension": None,
        "arm_angle": None if arm is None else plain(arm),
        "free_angle": None,
        "coordinates": {
            name: plain(place) if found else None for name, place in zip(names, places, strict=True)
        },
        "at_stop": {
            name: STOPS.get(int(stop)) if found else None
            for name, stop in zip(names, stops, strict=True)
        },
        "unstretched_speed": alone.get("unstretched_speed"),
        "mass_flow": alone.get("mass_flow"),
        "message": "" if state.feasible else explanation(state.result),
        "power": _power(state) if found else None,
        "torque_loss": plain(state.driver_moment - ideal) if found else None,
        "slip_velocity": plain(state.slip_velocity),
    }


def _ideal_moment(drive: Drive, state: GrooveState) -> float:
    """Moment at the driver, were there neither slip nor loss [N m]."""
    driven = (1 - np.asarray(drive.drives)) * np.asarray(state.moments)
    radii = np.asarray(drive.radii)
    return float(np.sum(driven / radii) * (np.asarray(drive.drives) @ radii))


def _power(state: GrooveState) -> dict[str, Any]:
    return {
        "input": plain(state.power_in),
        "output": plain(state.power_out),
        "friction_loss": plain(np.sum(np.asarray(state.loss))),
        "balance": plain(state.energy_balance),
    }


def _pulleys(drive: Drive, point: OperatingPoint, state: GrooveState) -> list[dict[str, Any]]:
    turning, blur = np.asarray(transmission(drive, point).turning), state.regularization
    zones, angles = (np.degrees(np.asarray(x)) for x in (state.zones, state.contact_angles))
    depth = np.asarray(state.penetrations)
    rows = []
    for i, name in enumerate(drive.pulley_names):
        parts = dict(zip((f"{zone}_deg" for zone in _ZONES), plain(zones[i]), strict=True))
        rows.append(
            {
                "name": name,
                "wrap_deg": plain(np.degrees(state.wraps[i])),
                "slip_deg": parts["sliding_deg"],
                "moment": plain(state.moments[i]),
                "speed": plain(turning[i] * state.speeds[i]),
                "contact_radius": plain(1 - depth[i] / drive.radii[i]),
                **parts,
                "penetration_max": plain(depth[i]),
                "entry_angle_deg": plain(angles[i, 0]),
                "exit_angle_deg": plain(angles[i, 1]),
                "loss": plain(state.loss[i]),
                "slip": plain(state.slip[i]),
                "blur": {
                    "moment": plain(blur.moments[i]),
                    "slip": plain(blur.slip[i]),
                    "loss": plain(blur.loss[i]),
                    "penetration": plain(blur.penetrations[i]),
                },
            }
        )
    return rows


def _spans(drive: Drive, state: GrooveState) -> list[dict[str, Any]]:
    speeds = np.asarray(state.span_speeds)
    stretch = speeds / np.asarray(state.unstretched_speed)
    stretch = np.where(np.isfinite(stretch), stretch, _stretch(drive, state))
    lengths, tensions = np.asarray(state.span_lengths), np.asarray(state.tensions)
    angles = np.degrees(_inclinations(drive, state))
    return [
        {
            "name": name,
            "length": plain(lengths[i]),
            "unstretched_length": plain(lengths[i] / stretch[i]),
            **{f"tension_{where}": plain(tensions[i]) for where in ("start", "mid", "end")},
            **{f"speed_{where}": plain(speeds[i]) for where in ("start", "end")},
            **{f"angle_{where}_deg": plain(angles[i]) for where in ("start", "end")},
        }
        for i, name in enumerate(drive.span_names)
    ]


def _stretch(drive: Drive, state: GrooveState) -> np.ndarray:
    return 1 + np.asarray(state.tensions) / float(drive.belt.axial_stiffness)


def _inclinations(drive: Drive, state: GrooveState) -> np.ndarray:
    """Directions of the spans from the lines of centers, positive outwards [rad]."""
    spans, loops = state.solved.loop.spans, drive.loops
    x, y = (np.asarray(c)[np.asarray(state.order.pulleys)] for c in (spans.there.x, spans.there.y))
    across, up = (np.asarray(loops.following(jnp.asarray(c))) - c for c in (x, y))
    along_x, along_y = (
        np.asarray(c)[np.asarray(state.order.spans)] for c in (spans.along_x, spans.along_y)
    )
    # Against the listed order the belt runs from a span's end to its start.
    forward = np.sign(across * along_x + up * along_y)
    turned = forward * (across * along_y - up * along_x) / np.hypot(across, up)
    return -np.asarray(drive.senses) * np.arcsin(np.clip(turned, -1, 1))


def groove_tables(document: dict[str, Any], units: TableUnits) -> Group:
    """The tables of `beltjax contact` for grooves, from the JSON document."""
    if document["pulleys"] is None:
        return Group(escape(f"{titled(document)}: no state of the belt in its grooves"))
    shown = (
        table(document, units) for table in (_pulley_table, _zone_table, _span_table, _summary)
    )
    return Group(*warning_lines(document), *shown)


def _pulley_table(document: dict[str, Any], units: TableUnits) -> Table:
    columns = ("moment", "N m", 3), ("speed", "rad/s", 1), ("loss", "W", 2)
    heads = [units.head(name, unit) for name, unit, _ in columns]
    depth = units.head("deepest", "m")
    table = plain_table(escape(titled(document)), "pulley", *heads, "slip (%)", depth)
    for row in document["pulleys"]:
        cells = (units.text(row[name], unit, digits) for name, unit, digits in columns)
        slip, sunk = f"{100 * row['slip']:.3f}", units.text(row["penetration_max"], "m", 3)
        table.add_row(escape(row["name"]), *cells, slip, sunk)
    return table


def _zone_table(document: dict[str, Any], units: TableUnits) -> Table:
    names = "wrap", *_ZONES, "entry_angle", "exit_angle"
    heads = [units.head(name.replace("_", " "), "rad") for name in names]
    table = plain_table("", "pulley", *heads)
    for row in document["pulleys"]:
        cells = (units.text(np.radians(row[f"{name}_deg"]), "rad", 2) for name in names)
        table.add_row(escape(row["name"]), *cells)
    return table


def _span_table(document: dict[str, Any], units: TableUnits) -> Table:
    columns = ("length", "m", 1), ("tension_mid", "N", 2), ("speed_start", "m/s", 3)
    labels = "length", "tension", "speed"
    heads = [units.head(a, unit) for a, (_, unit, _) in zip(labels, columns, strict=True)]
    table = plain_table("", "span", *heads)
    for row in document["spans"]:
        cells = (units.text(row[name], unit, digits) for name, unit, digits in columns)
        table.add_row(escape(row["name"]), *cells)
    return table


def _summary(document: dict[str, Any], units: TableUnits) -> Table:
    rows = [
        ("efficiency", document["efficiency"], 6, ""),
        ("driver's moment", document["driver_moment"], 4, "N m"),
        ("of it lost", document["torque_loss"], 4, "N m"),
        ("factor on the torques", document["torque_factor"], 4, ""),
        ("power in", document["power"]["input"], 2, "W"),
        ("lost by sliding", document["power"]["friction_loss"], 2, "W"),
        ("belt length, unstretched", document["unstretched_length"], 3, "m"),
    ]
    table = quantity_table(rows, units)
    if document["limit"]:
        table.add_row("limit", document["limit"], "")
    return table
