"""The duties of a drive in a report: their states, and which is the worst for each quantity."""

import math
import os
from collections.abc import Callable, Iterator
from typing import Any, Literal, NamedTuple

import jax
import numpy as np
from rich.markup import escape
from rich.table import Table

from beltjax.analysis.duties import duty_numbers
from beltjax.analysis.steady import SteadyState
from beltjax.commands.reports import states
from beltjax.commands.reports.diagnosis import diagnose
from beltjax.commands.reports.documents import Maybe, Part, Row, WarningPart, meaning, plain
from beltjax.commands.reports.tables import plain_table
from beltjax.commands.reports.units import TableUnits
from beltjax.commands.reports.warnings import Warnings, steady_warnings
from beltjax.compiling.kept_programs import run_kept
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.results import RESULTS, succeeded


class DutyPart(Part):
    """A duty of the drive file."""

    name: str
    success: bool
    outcome: str | None = meaning("why it failed")
    warnings: list[WarningPart]
    belt_speed: Maybe = meaning("m/s, of the unstretched belt, of several that of the driver's")
    driver_speed: Maybe = meaning("rad/s")
    coupling: Row | None = meaning("Gamma of each span; null where the drive does not run")
    coupling_total: Maybe = meaning("Gamma")
    coordinates: list[states.CoordinatePart] | None = meaning("as for the file's [operation]")
    pulleys: list[states.PulleyPart]
    spans: list[states.SpanStatePart]


class WorstPart(Part):
    """A quantity at the duty where it is worst."""

    quantity: str = meaning(
        "`tension`, `hub_load`, `slip_margin`, `way_to_stop` or `coupling_total`"
    )
    extreme: Literal["least", "greatest"] = meaning("which of its values is the worst")
    at: str = meaning("span, pulley or tensioner; empty for the whole drive")
    duty: str = meaning("name of the duty")
    value: float
    unit: str = meaning("SI; empty for a pure number")


def duties_document(
    drive: Drive, point: OperatingPoint, duties: dict[str, OperatingPoint]
) -> dict[str, Any]:
    """The keys of a document that concern duties, of which `point` may be one."""
    found = jax.device_get(run_kept(_read_states, *duty_numbers(drive, duties)[:2]))
    each = [jax.tree.map(lambda x, k=k: x[k], found) for k in range(len(duties))]
    parts = [
        _duty(drive, name, point, *state)
        for (name, point), state in zip(duties.items(), each, strict=True)
    ]
    return {
        "duty": next((name for name, duty in duties.items() if duty is point), None),
        "duties": parts,
        "worst": [one for quantity in _JUDGED if (one := _worst(parts, quantity))],
        "worst_hub_loads": _worst_hub_loads(parts),
    }


def _read_states(drive: Drive, points: OperatingPoint) -> tuple[SteadyState, states.Readings]:
    """The steady state at each of the points, and what is read from it."""
    return jax.vmap(states.read_state, (None, 0))(drive, points)


def _duty(
    drive: Drive, name: str, point: OperatingPoint, steady: SteadyState, read: states.Readings
) -> dict[str, Any]:
    running = bool(succeeded(steady.result))
    why = diagnose(drive, point, steady)
    slack = bool(steady.reference.result == RESULTS.span_slack)
    rests = slack or bool(succeeded(steady.reference.result))
    speed = point.speed(drive)
    return {
        "name": name,
        "success": why is None,
        "outcome": f"{why.key}: {why.message}" if why else None,
        "warnings": steady_warnings(drive, point, steady, read),
        "belt_speed": plain(speed),
        "driver_speed": plain(speed / (drive.drives @ drive.radii)),
        "coupling": plain(steady.coupling) if running else None,
        "coupling_total": plain(np.sum(steady.coupling)) if running else None,
        "coordinates": states.coordinates(drive, steady, running) if rests else None,
        "pulleys": states.pulleys(drive, steady, read, running),
        "spans": states.spans(drive, steady, read, running),
    }


def duty_warnings(document: dict[str, Any]) -> Warnings:
    """The warnings of [operation] and all duties, each once, with what it is of."""
    texts: dict[tuple[str, str], list[str]] = {}
    of_operation = {"name": "[operation]", "warnings": document["warnings"]}
    for duty in [of_operation] * (document["duty"] is None) + document["duties"]:
        for one in duty["warnings"]:
            texts.setdefault((one["code"], one["text"]), []).append(duty["name"])
    return [
        {"code": code, "text": f"at {', '.join(names)}: {text}"}
        for (code, text), names in texts.items()
    ]


def duty_failure(duties: list[dict[str, Any]], path: str | os.PathLike[str]) -> str:
    """One line for the first duty that failed; empty where none did."""
    failed = [duty for duty in duties if not duty["success"]]
    if not failed:
        return ""
    more = f" (and {len(failed) - 1} more duties)" if len(failed) > 1 else ""
    return str(FileError(path, f"duty.{failed[0]['name']}", failed[0]["outcome"] + more))


class Judged(NamedTuple):
    """A quantity of which one extreme is the worst."""

    name: str
    extreme: Literal["least", "greatest"]
    unit: str
    words: str
    values: Callable[[dict[str, Any]], Iterator[tuple[str, float | None]]]  # of a duty, by place


def _tensions(duty: dict[str, Any]) -> Iterator[tuple[str, float | None]]:
    yield from ((row["name"], row["tension"]) for row in duty["spans"])


def _hub_loads(duty: dict[str, Any]) -> Iterator[tuple[str, float | None]]:
    yield from ((row["name"], _load(row)) for row in duty["pulleys"])


def _slip_margins(duty: dict[str, Any]) -> Iterator[tuple[str, float | None]]:
    yield from ((row["name"], row["slip_margin"]) for row in duty["pulleys"])


def _ways(kind: str) -> Callable[[dict[str, Any]], Iterator[tuple[str, float | None]]]:
    def ways(duty: dict[str, Any]) -> Iterator[tuple[str, float | None]]:
        for row in duty["coordinates"] or []:
            if row["kind"] == kind:
                yield from ((row["name"], row[end]) for end in ("to_least", "to_greatest"))

    return ways


def _coupling(duty: dict[str, Any]) -> Iterator[tuple[str, float | None]]:
    yield "", duty["coupling_total"]


_JUDGED = (
    Judged("tension", "least", "N", "running tension", _tensions),
    Judged("tension", "greatest", "N", "running tension", _tensions),
    Judged("hub_load", "greatest", "N", "hub load", _hub_loads),
    Judged("slip_margin", "least", "", "slip margin", _slip_margins),
    Judged("way_to_stop", "least", "rad", "way left to a stop", _ways("rotary")),
    Judged("way_to_stop", "least", "m", "way left to a stop", _ways("linear")),
    Judged("coupling_total", "greatest", "", "coupling Gamma, all spans", _coupling),
)


def _worst(duties: list[dict[str, Any]], of: Judged) -> dict[str, Any] | None:
    """The worst value of a quantity, with place and duty; None where none has a value."""
    found = [
        (value, place, duty["name"])
        for duty in duties
        if duty["success"]
        for place, value in of.values(duty)
        if value is not None
    ]
    if not found:
        return None
    extreme = min if of.extreme == "least" else max
    value, place, duty = extreme(found, key=lambda one: one[0])
    facts = {"quantity": of.name, "extreme": of.extreme, "unit": of.unit}
    return facts | {"at": place, "duty": duty, "value": value}


def _worst_hub_loads(duties: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The greatest load on each hub."""
    of = next(one for one in _JUDGED if one.name == "hub_load")
    names = [row["name"] for row in duties[0]["pulleys"]]
    single = [
        of._replace(values=lambda duty, name=name: (x for x in of.values(duty) if x[0] == name))
        for name in names
    ]
    return [one for quantity in single if (one := _worst(duties, quantity))]


def duty_title(duty: dict[str, Any], units: TableUnits) -> str:
    """The title above the tables of a duty."""
    speeds = (
        f"{what} {units.text(duty[key], si, 2 if si == 'm/s' else 0)} {units.name(si)}"
        for what, key, si in (("belt", "belt_speed", "m/s"), ("driver", "driver_speed", "rad/s"))
    )
    failed = "" if duty["success"] else " (does not run)"
    return f"Duty {duty['name']}{failed}: {', '.join(speeds)}"


def worst_table(worst: list[dict[str, Any]], units: TableUnits) -> Table:
    """The worst duty for each quantity."""
    table = plain_table("Worst of the duties", "quantity", "value", "unit", "at", "duty")
    for column in table.columns[3:]:
        column.justify = "left"
    for row in worst:
        own = row["quantity"], row["extreme"]
        of = next(one for one in _JUDGED if (one.name, one.extreme) == own)
        digits = {"N": 1, "rad": 3, "m": 3}.get(row["unit"], 4)
        value = units.text(row["value"], row["unit"], digits)
        where = escape(row["at"]) or "-"
        cells = value, units.name(row["unit"]), where, escape(row["duty"])
        table.add_row(f"{row['extreme']} {of.words}", *cells)
    return table


def hub_load_table(loads: list[dict[str, Any]], units: TableUnits) -> Table:
    """The greatest load on each hub, for its bearing."""
    columns = "pulley", units.head("load", "N"), "duty"
    table = plain_table("Greatest hub load of each pulley", *columns)
    table.columns[2].justify = "left"
    for row in loads:
        table.add_row(escape(row["at"]), units.text(row["value"], "N", 0), escape(row["duty"]))
    return table


class _Row(NamedTuple):
    """A quantity of every span, pulley or tensioner at every duty."""

    title: str
    part: str  # of the document
    si: str
    decimals: int
    value: Callable[[dict[str, Any]], float | None]


def _load(row: dict[str, Any]) -> float | None:
    return None if row["hub_load"] is None else math.hypot(*row["hub_load"])


def _place(row: dict[str, Any]) -> float | None:
    return row["at_rest"] + row["change"]


def _way(row: dict[str, Any]) -> float | None:
    ways = [row[end] for end in ("to_least", "to_greatest") if row[end] is not None]
    return min(ways, default=None)


_BESIDE = (
    _Row("Tension, running", "spans", "N", 1, lambda row: row["tension"]),
    _Row("Tension meter, at rest", "spans", "Hz", 1, lambda row: row["meter_hz"]),
    _Row("Tension meter, running", "spans", "Hz", 1, lambda row: row["meter_hz_running"]),
    _Row("Hub load", "pulleys", "N", 0, _load),
    _Row("Speed", "pulleys", "rad/s", 0, lambda row: row["speed"]),
    _Row("Torque taken", "pulleys", "N m", 2, lambda row: row["torque"]),
    _Row("Slip margin", "pulleys", "", 3, lambda row: row["slip_margin"]),
    _Row("Place, running, from the drawn position", "coordinates", "", 3, _place),
    _Row("Way left to the nearer stop", "coordinates", "", 3, _way),
)
_NAMES = {"spans": "span", "pulleys": "pulley", "coordinates": "tensioner"}


def duty_tables(duties: list[dict[str, Any]], units: TableUnits) -> list[Table]:
    """The duties side by side: a table for each quantity, a column for each duty."""
    tables = []
    for one in _BESIDE:
        labels = [row["name"] for row in next(filter(None, (d[one.part] for d in duties)), [])]
        texts = {
            name: [_text(duty, one, k, units) for duty in duties] for k, name in enumerate(labels)
        }
        if any(text != "-" for row in texts.values() for text in row):
            head = units.head(one.title, one.si) if one.si else one.title
            table = plain_table(head, _NAMES[one.part], *(escape(d["name"]) for d in duties))
            for name, row in texts.items():
                table.add_row(escape(name), *row)
            tables.append(table)
    return tables


def _text(duty: dict[str, Any], of: _Row, k: int, units: TableUnits) -> str:
    """One cell; of tensioners with its unit, since they may be of two kinds."""
    if not duty[of.part] or not duty["success"]:
        return "-"
    row = duty[of.part][k]
    if of.part != "coordinates":
        return units.text(of.value(row), of.si, of.decimals)
    si = "rad" if row["kind"] == "rotary" else "m"
    text = units.text(of.value(row), si, of.decimals)
    return text if text == "-" else f"{text} {units.name(si)}"
