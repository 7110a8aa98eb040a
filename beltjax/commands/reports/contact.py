"""The work of `beltjax contact`: it turns a drive file into a report."""

import os
from typing import Any, Literal

import jax
import numpy as np
from rich.console import Group
from rich.markup import escape
from rich.table import Table

from beltjax.analysis.contact import (
    ContactState,
    contact_question,
    contact_solution,
    unmet_need,
)
from beltjax.analysis.steady import SteadyState, steady_state
from beltjax.commands.reports.arguments import read_drive, titled
from beltjax.commands.reports.diagnosis import Diagnosis, advice, speed_key, taken_key, travel_lead
from beltjax.commands.reports.documents import (
    Maybe,
    Part,
    PointDocument,
    meaning,
    model_flags,
    plain,
)
from beltjax.commands.reports.report import Report
from beltjax.commands.reports.states import STOPS
from beltjax.commands.reports.tables import plain_table, quantity_table
from beltjax.commands.reports.units import TableUnits
from beltjax.commands.reports.warnings import file_warnings, load_warnings, warning_lines
from beltjax.compiling.kept_programs import run_kept
from beltjax.compiling.quick import quickly_compiled
from beltjax.drive.bodies import single_arm
from beltjax.drive.canonical import canonical
from beltjax.drive.installation import BELT_LENGTH, BeltGiven
from beltjax.drive.layout import layout
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.shafts import transmission
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.results import RESULTS, explanation, succeeded

# What a torque against the sense that is meant ends in.
_OF_TRAVEL = RESULTS.contact_pressure_lost, RESULTS.contact_not_found, RESULTS.span_slack


class BlurPart(Part):
    """Estimated errors by the sliding speed below which friction is viscous."""

    moment: Maybe = meaning("N m")
    slip: Maybe = meaning("of slip")
    loss: Maybe = meaning("W")
    penetration: Maybe = meaning("m")


class TouchedPulleyPart(Part):
    """A pulley and the belt on it."""

    name: str
    wrap_deg: Maybe = meaning("negative where the belt would have to bend back")
    slip_deg: Maybe
    adhesion_deg: Maybe = meaning("wrap less slip")
    moment: Maybe = meaning("N m, taken from the belt; the driver's is negative")
    speed: Maybe = meaning("rad/s, counterclockwise")
    contact_radius: Maybe = meaning(
        "of the belt at contact over the pulley's; 1 unless it touches at one point, or of a belt "
        "in grooves sinks in"
    )
    seating_deg: Maybe = meaning("of a belt in grooves; likewise what follows", default=None)
    sliding_deg: Maybe = meaning("the same as slip_deg", default=None)
    unseating_deg: Maybe = meaning("where the belt leaves the groove", default=None)
    penetration_max: Maybe = meaning("m", default=None)
    entry_angle_deg: Maybe = meaning("of the belt to the pulley's circle", default=None)
    exit_angle_deg: Maybe = meaning("likewise, where it leaves", default=None)
    loss: Maybe = meaning("W, of sliding", default=None)
    slip: Maybe = meaning("part by which the rim is slower than the driver's", default=None)
    blur: BlurPart | None = meaning(
        "how far friction, viscous at slow sliding, moves numbers", default=None
    )


class PowerPart(Part):
    """Powers of a belt in grooves: W."""

    input: Maybe = meaning("of the driver")
    output: Maybe = meaning("that the accessories take")
    friction_loss: Maybe = meaning("of sliding on all pulleys")
    balance: Maybe = meaning("what is missing: an error of the computation")


class FreeSpanPart(Part):
    """A free span, start and end in the direction of travel."""

    name: str
    length: Maybe = meaning("m, stretched")
    unstretched_length: Maybe = meaning("m")
    tension_start: Maybe = meaning("N")
    tension_mid: Maybe = meaning("N")
    tension_end: Maybe = meaning("N")
    speed_start: Maybe = meaning("m/s")
    speed_end: Maybe = meaning("m/s")
    angle_start_deg: Maybe = meaning("direction of the belt, from the line of centers")
    angle_end_deg: Maybe = meaning("likewise")


class RunningBeltPart(Part):
    """A belt as a whole."""

    name: str
    unstretched_length: Maybe = meaning("m")
    string_tension: Maybe = meaning("N, that this belt would have as a string, as drawn")
    unstretched_speed: Maybe = meaning("m/s, of the unstretched belt")
    mass_flow: Maybe = meaning("kg/s")


class ContactDocument(PointDocument):
    """`beltjax contact`: numbers are null where no state was found.

    Lengths, speeds and flows of a single belt stand by themselves too; of several they are null.
    """

    feasible: bool = meaning("whether the state found can be: nothing slips fully, nothing leaves")
    pulleys: list[TouchedPulleyPart] | None
    spans: list[FreeSpanPart] | None
    belts: list[RunningBeltPart] | None
    unstretched_length: Maybe = meaning("m, of the belt")
    efficiency: Maybe = meaning("power taken over power given")
    driver_moment: Maybe = meaning("N m")
    driven_moment: Maybe = meaning("N m; of two pulleys only")
    torque_factor: Maybe = meaning("on the torques of the file; 1 without --maximum")
    string_tension: Maybe = meaning("N, that this belt would have as a string in the drawn layout")
    arm_angle: Maybe = meaning("rad; null unless one arm carries one pulley")
    free_angle: Maybe = meaning("rad; likewise")
    coordinates: dict[str, Maybe] = meaning("of each tensioner, from the drawn position: rad, or m")
    at_stop: dict[str, Literal["least", "greatest"] | None] = meaning("which stop holds each")
    unstretched_speed: Maybe = meaning("m/s, of the unstretched belt")
    mass_flow: Maybe = meaning("kg/s")
    message: str = meaning("why it is not feasible, or empty")
    power: PowerPart | None = meaning("of a belt in grooves", default=None)
    torque_loss: Maybe = meaning(
        "N m at the driver: its moment less what ideal pulleys of these radii would need; of a "
        "belt in grooves",
        default=None,
    )
    slip_velocity: Maybe = meaning(
        "sliding speed over the belt's below which friction is viscous; of a belt in grooves",
        default=None,
    )
    limit: Literal["slip", "adhesion"] | None = meaning(
        "which limit --maximum went to; of a belt in grooves", default=None
    )


def contact_report(
    path: str | os.PathLike[str],
    maximum: bool,
    law: str,
    pictures: tuple[str | None, str | None] = (None, None),
    si: bool = False,
    duty: str | None = None,
    limit: str | None = None,
) -> Report:
    """The contact state of one drive file, under its torques or under the largest.

    `pictures` are one of the state, and one of its spans beside those of `steady_state`. Tables are
    in the units of the file, or in SI.

    Raises `FileError` where the file leaves out what contact needs; a state that is not physical
    is a report with a `failure`.
    """
    try:
        question = contact_question(law, maximum)
    except ValueError as error:
        raise FileError("--law", "", str(error).rstrip(".")) from error
    drive, point, at = read_drive(path, duty)
    if drive.belt.wedge_angle is not None:
        from beltjax.commands.reports.groove import groove_report

        asked = (limit or "slip") if maximum else None
        if limit is not None and not maximum:
            raise FileError("--limit", "", "belongs to --maximum; add that, or leave it out")
        if law != "kong":
            raise FileError("--law", "", "belongs to a belt without groove; leave it out")
        return groove_report(path, (drive, point, at), asked, pictures, si)
    if limit is not None:
        raise FileError("--limit", "", "belongs to a belt with groove; leave it out")
    unmet = unmet_need(drive, point, maximum)
    if unmet is not None:
        raise FileError(path, unmet.key, unmet.message)
    state = jax.device_get(run_kept(contact_solution, *canonical(drive, point), *question))
    why = diagnose_contact(drive, point, state)
    if why and why.impossible:
        raise FileError(path, why.key, why.message)
    warnings = [*file_warnings(drive), *load_warnings((drive, point))]
    document = contact_document(drive, point, state) | {"at": at, "warnings": warnings}
    files = _pictures(drive, point, state, *pictures) if document["pulleys"] else ()
    failure = str(FileError(path, why.key, why.message)) if why else ""
    return Report(document, contact_tables(document, TableUnits(drive, si)), failure, files)


def _pictures(
    drive: Drive,
    point: OperatingPoint,
    state: ContactState,
    figure: str | None,
    compare: str | None,
) -> tuple[tuple[str, bytes], ...]:
    from beltjax.draw.contact import contact_figure, two_models_figure  # slow to load
    from beltjax.draw.layouts import picture_bytes

    drawn = []
    if figure:
        drawn.append((figure, contact_figure(drive, state)))
    if compare:
        steady = quickly_compiled(_fixed_contacts)(*canonical(drive, point))
        picture = two_models_figure(drive, [("", state, steady)])
        drawn.append((compare, picture))
    return tuple((name, picture_bytes(picture, name)) for name, picture in drawn)


def _fixed_contacts(drive: Drive, point: OperatingPoint) -> SteadyState:
    return steady_state(drive, point, throw=False)


def contact_document(drive: Drive, point: OperatingPoint, state: ContactState) -> dict[str, Any]:
    """A contact state with the fixed keys; its numbers are None where no state was found."""
    found = bool(state.found)
    two = len(drive.pulleys) == 2
    moments = np.asarray(state.moments)
    driven = float(np.abs(moments[int(np.argmin(drive.drives))]))
    belts = _belts(drive, state) if found else None
    single = belts[0] if belts is not None and len(belts) == 1 else {}
    return {
        "drive": drive.name,
        "model": model_flags(drive),
        "feasible": bool(state.feasible),
        "pulleys": _pulleys(drive, point, state) if found else None,
        "spans": _spans(drive, state) if found else None,
        "belts": belts,
        "unstretched_length": single.get("unstretched_length"),
        "efficiency": plain(state.efficiency) if found else None,
        "driver_moment": plain(state.driver_moment) if found else None,
        "driven_moment": driven if found and two else None,
        "torque_factor": plain(state.torque_factor) if found else None,
        "string_tension": single.get("string_tension"),
        "arm_angle": plain(state.arm_angle) if found and single_arm(drive) else None,
        "free_angle": plain(state.free_angle) if found and single_arm(drive) else None,
        "coordinates": {
            body.name: plain(place) if found else None
            for body, place in zip(drive.tensioners, np.asarray(state.coordinates), strict=True)
        },
        "at_stop": {
            body.name: STOPS.get(int(stop)) if found else None
            for body, stop in zip(drive.tensioners, np.asarray(state.at_stop), strict=True)
        },
        "unstretched_speed": single.get("unstretched_speed"),
        "mass_flow": single.get("mass_flow"),
        "message": "" if state.feasible else explanation(state.result),
    }


def _belts(drive: Drive, state: ContactState) -> list[dict[str, Any]]:
    lengths = np.atleast_1d(state.unstretched_length)
    columns = zip(
        (belt.name for belt in drive.belts),
        plain(lengths),
        _string_tensions(drive, lengths),
        plain(np.atleast_1d(state.unstretched_speed)),
        plain(np.atleast_1d(state.mass_flow)),
        strict=True,
    )
    keys = "name", "unstretched_length", "string_tension", "unstretched_speed", "mass_flow"
    return [dict(zip(keys, row, strict=True)) for row in columns]


def _string_tensions(drive: Drive, lengths: np.ndarray) -> list[Any]:
    """Tension [N] that each belt would have as a string in the drawn layout, without torque.

    None where the belt is given and an arm moves, so that the drawn layout is not the one at rest.
    """
    if isinstance(drive.installation, BeltGiven) and drive.tensioners:
        return [None] * len(lengths)
    paths = np.asarray(layout(drive, throw=False).path_lengths)
    return plain(np.asarray(drive.axial_stiffnesses) * (paths / lengths - 1))


def _pulleys(drive: Drive, point: OperatingPoint, state: ContactState) -> list[dict[str, Any]]:
    turning = np.asarray(transmission(drive, point).turning)
    columns = zip(
        drive.pulley_names,
        *(plain(np.degrees(x)) for x in (state.wraps, state.slips, state.adhesions)),
        plain(state.moments),
        plain(turning * np.asarray(state.pulley_speeds)),
        plain(1 / (np.asarray(state.contact_curvatures) * np.asarray(drive.radii))),
        strict=True,
    )
    keys = "name", "wrap_deg", "slip_deg", "adhesion_deg", "moment", "speed", "contact_radius"
    return [dict(zip(keys, row, strict=True)) for row in columns]


def _spans(drive: Drive, state: ContactState) -> list[dict[str, Any]]:
    columns = zip(
        drive.span_names,
        plain(state.span_lengths),
        plain(state.unstretched_span_lengths),
        *(plain(state.tensions[:, k]) for k in range(3)),
        *(plain(state.speeds[:, k]) for k in range(2)),
        *(plain(np.degrees(state.angles[:, k])) for k in range(2)),
        strict=True,
    )
    keys = (
        "name",
        "length",
        "unstretched_length",
        *(f"tension_{where}" for where in ("start", "mid", "end")),
        *(f"speed_{where}" for where in ("start", "end")),
        *(f"angle_{where}_deg" for where in ("start", "end")),
    )
    return [dict(zip(keys, row, strict=True)) for row in columns]


def contact_tables(document: dict[str, Any], units: TableUnits) -> Group:
    """The tables of `beltjax contact`, from its JSON document."""
    if document["pulleys"] is None:
        return Group(escape(f"{titled(document)}: no state of contact"))
    several = len(document["belts"]) > 1
    tables = _pulley_table, _span_table, *([_belt_table] if several else []), _summary
    shown = (table(document, units) for table in tables)
    return Group(*warning_lines(document), *shown)


def _pulley_table(document: dict[str, Any], units: TableUnits) -> Table:
    arcs = "wrap", "slip", "adhesion"
    columns = *((arc, "rad") for arc in arcs), ("moment", "N m"), ("speed", "rad/s")
    heads = (units.head(*column) for column in columns)
    table = plain_table(escape(titled(document)), "pulley", *heads)
    for row in document["pulleys"]:
        angles = (units.text(np.radians(row[f"{arc}_deg"]), "rad", 2) for arc in arcs)
        moment, speed = units.text(row["moment"], "N m", 3), units.text(row["speed"], "rad/s", 1)
        table.add_row(escape(row["name"]), *angles, moment, speed)
    return table


def _span_table(document: dict[str, Any], units: TableUnits) -> Table:
    places = "start", "mid", "end"
    columns = ("length", "m"), *((f"T {where}", "N") for where in places), ("angles", "rad")
    table = plain_table("", "span", *(units.head(*column) for column in columns))
    for row in document["spans"]:
        tensions = (units.text(row[f"tension_{where}"], "N", 2) for where in places)
        ends = np.radians([row["angle_start_deg"], row["angle_end_deg"]])
        angles = ", ".join(units.text(end, "rad", 2) for end in ends)
        table.add_row(escape(row["name"]), units.text(row["length"], "m", 1), *tensions, angles)
    return table


def _belt_table(document: dict[str, Any], units: TableUnits) -> Table:
    columns = [
        ("unstretched_length", "length, unstretched", "m", 3),
        ("string_tension", "T as a string", "N", 2),
        ("unstretched_speed", "speed", "m/s", 3),
        ("mass_flow", "mass flow", "kg/s", 4),
    ]
    kinds = {"m": BELT_LENGTH}
    heads = (units.head(label, unit, kinds.get(unit, "")) for _, label, unit, _ in columns)
    table = plain_table("", "belt", *heads)
    for row in document["belts"]:
        cells = (
            units.text(row[key], unit, digits, kinds.get(unit, ""))
            for key, _, unit, digits in columns
        )
        table.add_row(escape(row["name"]), *cells)
    return table


def _summary(document: dict[str, Any], units: TableUnits) -> Table:
    rows = [
        ("efficiency", document["efficiency"], 6, ""),
        ("driver's moment", document["driver_moment"], 4, "N m"),
        ("factor on the torques", document["torque_factor"], 4, ""),
    ]
    if len(document["belts"]) == 1:
        rows += [
            ("belt length, unstretched", document["unstretched_length"], 3, "m"),
            ("tension of that belt as a string", document["string_tension"], 2, "N"),
            ("mass flow", document["mass_flow"], 4, "kg/s"),
        ]
    return quantity_table(rows, units)


def diagnose_contact(drive: Drive, point: OperatingPoint, state: ContactState) -> Diagnosis | None:
    """Say to the user why a contact state is not physical; None where it is."""
    result = state.result
    if succeeded(result):
        return None
    key, found = _cause(drive, point, state)
    message = found + advice(drive, result)
    if any(result == one for one in _OF_TRAVEL):
        lead = travel_lead(drive, point)
        message += lead and f" ({lead})"
    return Diagnosis(key, message, bool(result == RESULTS.no_torque_to_scale))


def _cause(drive: Drive, point: OperatingPoint, state: ContactState) -> tuple[str, str]:
    """Key of the drive file, and which pulleys it concerns."""
    result, loaded = state.result, np.asarray(state.moments) != 0
    names = np.array(drive.pulley_names)
    if result == RESULTS.gross_slip:
        slipping = names[loaded & (np.asarray(state.adhesions) < 0)]
        return taken_key(point) or "operation.torque", f"{', '.join(slipping)}: "
    if result == RESULTS.wrap_vanished:
        bare = names[loaded & (np.asarray(state.wraps) <= 0)]
        return "belt.bending_stiffness", f"{', '.join(bare)}: "
    if result == RESULTS.belt_too_stiff:
        return "belt.bending_stiffness", f"pulley {names[int(np.argmin(drive.radii))]}: "
    if result == RESULTS.belt_overstretched:
        return speed_key(point), ""
    given = isinstance(drive.installation, BeltGiven)
    return "installation.belt_length" if given else taken_key(point) or "operation.torque", ""
