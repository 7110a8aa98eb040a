"""What a belt's cushion changes, in documents and tables: `cushion` of `beltjax analyze`."""

import math
from typing import Any, Literal

import jax
import numpy as np
from rich.markup import escape
from rich.table import Table

from beltjax.analysis.cushion import Cushion, CushionState, ThinCushion, cushion_state
from beltjax.analysis.cushion_vibration import has_all_for_vibration
from beltjax.analysis.linearization import linearize
from beltjax.analysis.modes import modes
from beltjax.commands.reports.documents import Maybe, Part, Row, meaning, plain
from beltjax.commands.reports.tables import number, plain_table
from beltjax.commands.reports.units import TableUnits
from beltjax.compiling.kept_programs import run_kept
from beltjax.drive.canonical import canonical
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.results import RESULTS, succeeded

MODES = 8


class CushionPulleyPart(Part):
    """The cords on one pulley."""

    name: str
    wrap_deg: Maybe = meaning("over which the cords touch")
    slip_deg: Maybe = meaning("over which they slide")
    entry_angle_deg: Maybe = meaning("of the belt to the pulley where it comes in; negative")
    exit_angle_deg: Maybe = meaning("where it leaves")
    penetration_max: Maybe = meaning("m, give of the cords towards the axis")
    shear: Maybe = meaning("m, carried out where the belt leaves")
    loss: Maybe = meaning("W")
    hub_load: list[float] | None = meaning("N, [x, y], running")


class CushionSpanPart(Part):
    """A free span."""

    name: str
    length: Maybe = meaning("m")
    tension: Maybe = meaning("N, running")
    coupling: Maybe = meaning("Gamma")


class CushionPart(Part):
    """The running belt on its cushion, which the other keys leave out."""

    method: Literal["exact", "thin"] = meaning("thin layers where no exact state was found")
    pulleys: list[CushionPulleyPart] = meaning("in listed order")
    spans: list[CushionSpanPart] = meaning("in listed order")
    coupling_total: Maybe = meaning("Gamma")
    efficiency: Maybe = meaning("power delivered over power taken up; null without torques")
    unstretched_length: Maybe = meaning("m, of the belt")
    error: Maybe = meaning("relative, estimated, of the state")
    hertz: Row | None = meaning(
        "Hz, lowest modes of cords that move on the pulleys, without torques and bending; null "
        "without inertias"
    )


def cushion_part(
    drive: Drive, point: OperatingPoint
) -> tuple[dict[str, Any] | None, list[dict[str, str]]]:
    """The part of a document, None without a cushion or where it fails, and its warnings."""
    if all(belt.cushion_radial is None for belt in drive.belts):
        return None, []
    try:
        state = run_kept(_state, *canonical(drive, point), Cushion())
        if state.result == RESULTS.cushion_state_not_found:  # as of layers that are very hard
            state = run_kept(_state, *canonical(drive, point), ThinCushion())
        hertz, result = None, state.result
        if succeeded(state.result) and has_all_for_vibration(drive):
            found = run_kept(_modes, state)
            hertz, result = plain(np.asarray(found[0]) / (2 * math.pi)), found[1]
    except ValueError as error:
        return None, [{"code": "cushion_left_out", "text": f"the cushion is left out: {error}"}]
    if not succeeded(result):
        text = f"the cushion is left out: {RESULTS[result]}"
        return None, [{"code": "cushion_left_out", "text": text}]
    return _part(drive, jax.device_get(state), hertz), []


def _state(drive: Drive, point: OperatingPoint, method: Cushion | ThinCushion) -> CushionState:
    return cushion_state(drive, point, method, throw=False)


def _modes(state: CushionState) -> tuple[Any, RESULTS]:
    found = modes(linearize(state, throw=False), MODES, throw=False)
    return found.frequencies, found.result


def _part(drive: Drive, state: CushionState, hertz: Any) -> dict[str, Any]:
    columns = {
        "wrap_deg": np.degrees(state.wraps),
        "slip_deg": np.degrees(state.slips),
        "entry_angle_deg": np.degrees(state.contact_angles[:, 0]),
        "exit_angle_deg": np.degrees(state.contact_angles[:, 1]),
        "penetration_max": state.penetrations,
        "shear": state.shears,
        "loss": state.losses,
        "hub_load": state.hub_loads,
    }
    along = {
        "length": state.span_lengths,
        "tension": state.tensions,
        "coupling": state.coupling,
    }
    return {
        "method": "exact" if isinstance(state.method, Cushion) else "thin",
        "pulleys": _rows([pulley.name for pulley in drive.pulleys], columns),
        "spans": _rows(drive.span_names, along),
        "coupling_total": plain(np.sum(state.coupling)),
        "efficiency": None if bool(state.torque_free) else plain(state.efficiency),
        "unstretched_length": plain(state.unstretched_length),
        "error": plain(state.error),
        "hertz": hertz,
    }


def _rows(names: Any, columns: dict[str, Any]) -> list[dict[str, Any]]:
    values = {key: plain(column) for key, column in columns.items()}
    return [
        {"name": name} | {key: column[place] for key, column in values.items()}
        for place, name in enumerate(names)
    ]


def cushion_tables(part: dict[str, Any], units: TableUnits) -> list[Table]:
    """The tables of the cushion: pulleys, spans and frequencies."""
    heads = [
        units.head("wrap", "rad"),
        units.head("in", "rad"),
        units.head("out", "rad"),
        "give (mm)",
        "shear (mm)",
        units.head("loss", "W"),
        units.head("hub load", "N"),
    ]
    pulleys = plain_table("On the cushion", "pulley", *heads)
    for row in part["pulleys"]:
        angles = row["wrap_deg"], row["entry_angle_deg"], row["exit_angle_deg"]
        depths = (number(1e3 * row[key], 3) for key in ("penetration_max", "shear"))
        cells = [units.text(math.radians(angle), "rad", 1) for angle in angles]
        load = units.text(math.hypot(*row["hub_load"]), "N", 0)
        pulleys.add_row(escape(row["name"]), *cells, *depths, units.text(row["loss"], "W", 2), load)
    spans = plain_table(
        "", "span", units.head("length", "m"), units.head("running", "N"), "Gamma_i"
    )
    for row in part["spans"]:
        length, pull = units.text(row["length"], "m", 1), units.text(row["tension"], "N", 1)
        spans.add_row(escape(row["name"]), length, pull, number(row["coupling"], 4))
    tables = [pulleys, spans]
    if part["hertz"]:
        table = plain_table("Natural modes on the cushion, without torques", "mode", "Hz")
        for place, hertz in enumerate(part["hertz"], start=1):
            table.add_row(str(place), number(hertz, 3))
        tables.append(table)
    return tables
