"""The tables of `beltjax analyze`, from its JSON document."""

import math
from typing import Any

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from beltjax.commands.reports.cushioned import cushion_tables
from beltjax.commands.reports.duties import duty_title, hub_load_table, worst_table
from beltjax.commands.reports.tables import largest_changes, number, plain_table
from beltjax.commands.reports.units import TableUnits
from beltjax.commands.reports.warnings import warning_lines
from beltjax.drive.installation import BELT_LENGTH

_LARGEST_SENSITIVITIES = 8
_POINTS = "center", "pivot", "direction", "gravity"  # whose two numbers have keys in .x and .y


def analyze_tables(document: dict[str, Any], sizes: dict[str, Any], units: TableUnits) -> Group:
    """The tables of `beltjax analyze`, from its JSON document and the numbers of the drive."""
    parts: list[RenderableType] = [*warning_lines(document)]
    if document["duties"]:
        for duty in document["duties"]:
            parts += state_tables(duty_title(duty, units), duty, duty["coupling"], units)
        parts += [worst_table(document["worst"], units)]
        parts += [hub_load_table(document["worst_hub_loads"], units)]
        where = "[operation]" if document["duty"] is None else f"duty {document['duty']}"
        parts.append(Text(f"Length, Gamma and what moves it, at {where}:\n"))
        parts.append(summary_table(document, units))
    else:
        # The summary stands between pulleys and tensioners.
        coupling = (document["steady"] or {}).get("coupling")
        spans, *others = state_tables(document["drive"], document, coupling, units)
        parts += [spans, others[0], summary_table(document, units), *others[1:]]
    parts.append(model_line(document))
    if document["modes"]:
        parts.append(mode_table(document["modes"]))
    if document["cushion"]:
        parts += cushion_tables(document["cushion"], units)
    if document["sensitivities"]:
        slopes = _gamma_table(document["sensitivities"]["coupling_total"], sizes, units)
        parts.append(slopes if slopes.row_count else Text(_gamma_is_zero(sizes)))
    return Group(*parts)


def state_tables(
    title: str, state: dict[str, Any], coupling: list[float | None] | None, units: TableUnits
) -> list[Table]:
    """The tables of one state, that of the document or of a duty: spans, pulleys, tensioners."""
    tables = [_span_table(title, state["spans"], coupling, units)]
    tables.append(_pulley_table(state["pulleys"], units))
    if state["coordinates"]:
        tables.append(_coordinate_table(state["coordinates"], units))
    return tables


def _span_table(
    title: str,
    spans: list[dict[str, Any]],
    coupling: list[float | None] | None,
    units: TableUnits,
) -> Table:
    # Both tensions are under the operating torques.
    tensions = units.head("standing", "N"), units.head("running", "N")
    meters = "meter (Hz)", "running (Hz)"
    headers = "span", units.head("length", "m"), *tensions, *meters, "Gamma_i"
    table = plain_table(escape(title), *headers)
    for row, gamma in zip(spans, coupling or [None] * len(spans), strict=True):
        length = units.text(row["length"], "m", 1)
        still, running = row["tension_at_rest"], row["tension"]
        cells = [length, units.text(still, "N", 1), units.text(running, "N", 1)]
        heard = number(row["meter_hz"], 1), number(row["meter_hz_running"], 1)
        table.add_row(escape(row["name"]), *cells, *heard, number(gamma, 4))
    return table


def _pulley_table(pulleys: list[dict[str, Any]], units: TableUnits) -> Table:
    columns = ("wrap", "rad"), ("speed", "rad/s"), ("torque", "N m"), ("hub load", "N")
    heads = [*(units.head(*column) for column in columns), units.head("towards", "rad")]
    slips = any(row["slip_margin"] is not None for row in pulleys)
    table = plain_table("", "pulley", *heads, *["slip margin"] * slips)
    for row in pulleys:
        force = row["hub_load"]
        load = None if force is None else math.hypot(*force)
        towards = None if force is None else math.atan2(force[1], force[0])
        wrap = None if row["wrap_deg"] is None else math.radians(row["wrap_deg"])
        forces = units.text(row["torque"], "N m", 2), units.text(load, "N", 0)
        cells = [units.text(wrap, "rad", 1), units.text(row["speed"], "rad/s", 0), *forces]
        cells += [units.text(towards, "rad", 0)] + [number(row["slip_margin"], 3)] * slips
        table.add_row(escape(row["name"]), *cells)
    return table


def _coordinate_table(coordinates: list[dict[str, Any]], units: TableUnits) -> Table:
    columns = "installed", "at rest", "running", "to least", "to greatest", "", "stop"
    table = plain_table("Tensioners, from the drawn position", "tensioner", *columns)
    for row in coordinates:
        unit = "rad" if row["kind"] == "rotary" else "m"
        running = row["at_rest"] + row["change"]
        ways = row["to_least"], row["to_greatest"]
        places = (row["installed"], row["at_rest"], running, *ways)
        cells = (units.text(x, unit, 3) for x in places)
        table.add_row(escape(row["name"]), *cells, units.name(unit), row["at_stop"] or "")
    return table


def model_line(document: dict[str, Any]) -> Text:
    """Which model the numbers are of."""
    model = document["model"]
    counted = [name.replace("_", " ") for name, counts in model.items() if counts]
    if not counted:
        return Text("model: Kong (2003), as published; docs/model.md says what it leaves out\n")
    return Text(f"model: with {', '.join(counted)} ([model] of the drive file)\n")


def summary_table(document: dict[str, Any], units: TableUnits) -> Table:
    """Lengths, Gamma and the numbers of the whole drive."""
    table = plain_table("", "quantity", "value", "unit")
    layout, reference = document["layout"], document["reference"] or {}
    groups, steady = document["groups"] or {}, document["steady"] or {}
    rows = [
        ("coupling Gamma, all spans", steady.get("coupling_total"), 4, ""),
        ("tensioner effectiveness eta", reference.get("tensioner_effectiveness"), 4, ""),
        ("tension change T", steady.get("tension_change"), 6, "P0"),
        ("arm's turn, drawn to rest", reference.get("arm_turn"), 4, "rad"),
        ("arm rotation theta_t, rest to running", steady.get("arm_rotation"), 4, "rad"),
        ("belt length, unstretched", reference.get("unstretched_length"), 3, "m"),
        ("path length", layout["path_length"], 3, "m"),
        ("bending eps", groups.get("bending"), 5, ""),
        ("speed s", groups.get("speed"), 5, ""),
        ("stretch gamma", groups.get("stretch"), 2, ""),
    ]
    rows += [
        (f"standard lengths next to the path of {belt['name']}", belt["standard_lengths"], 3, "m")
        for belt in document["belts"] or []
        if belt["standard_lengths"]
    ]
    for label, value, digits, unit in rows:
        if value is not None:
            values = value if isinstance(value, list) else [value]  # of several belts
            kind = BELT_LENGTH if unit == "m" else ""
            words = ", ".join(units.text(one, unit, digits, kind) for one in values)
            table.add_row(label, words, units.name(unit, kind))
    return table


def mode_table(modes: dict[str, Any]) -> Table:
    """The lowest natural modes."""
    table = plain_table("Natural modes", "moves most", "Hz", "dimensionless")
    for label, hertz, omega in zip(
        modes["labels"], modes["hertz"], modes["dimensionless"], strict=True
    ):
        table.add_row(escape(label), number(hertz, 2), number(omega, 4))
    return table


def _gamma_table(slopes: dict[str, Any], sizes: dict[str, Any], units: TableUnits) -> Table:
    table = plain_table(
        "What moves Gamma most, per 1 % of each number, and per unit",
        "number",
        "change of Gamma",
        "d Gamma/d number",
        "unit",
    )
    parts = (p for name in slopes for p in components(name, sizes[name], slopes[name]))
    for name, change, slope in largest_changes(parts)[:_LARGEST_SENSITIVITIES]:
        one, unit = units.unit_of_number(name.partition("[")[0])
        per = f"1/({unit})" if set(unit) & set(" /*") else f"1/{unit}" if unit else ""
        table.add_row(escape(name), f"{change:+.3e}", f"{slope / one:+.4g}", per)
    return table


def _gamma_is_zero(sizes: dict[str, Any]) -> str:
    """Say why nothing moves Gamma."""
    stiff = [size for name, size in sizes.items() if name.endswith(".bending_stiffness")]
    if not any(stiff):
        return (
            "Nothing moves Gamma: the spans of a belt without bending stiffness are straight, and "
            "it is zero (belt.bending_stiffness = 0)."
        )
    return "Nothing moves Gamma: all its derivatives are zero."


def components(name: str, size: Any, slope: Any) -> list[tuple[str, float, float]]:
    """Name, size and slope of each single number of one that may be a vector."""
    if not isinstance(slope, list):
        return [(name, size, slope)]
    indices = [f"[{i}]" for i in range(len(slope))]
    labels = [".x", ".y"] if name.endswith(_POINTS) else indices
    return [(name + label, *part) for label, *part in zip(labels, size, slope, strict=True)]
