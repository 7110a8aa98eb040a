"""The work of `beltjax sweep`: it turns a drive file into a report."""

import os
from typing import Any

import numpy as np
from rich.console import Group
from rich.markup import escape

from beltjax.analysis.sweep import Sweep, require_count, sweep
from beltjax.commands.reports.arguments import (
    read_named,
    read_option,
    read_orders,
    read_range,
    titled,
)
from beltjax.commands.reports.documents import (
    Part,
    PointDocument,
    Row,
    meaning,
    model_flags,
    plain,
)
from beltjax.commands.reports.report import Report
from beltjax.commands.reports.tables import number, plain_table
from beltjax.commands.reports.units import TableUnits
from beltjax.commands.reports.vibrating import all_failed, vibrating
from beltjax.commands.reports.warnings import sweep_warnings, warning_lines
from beltjax.commands.running import Advance
from beltjax.draw.labels import span_label
from beltjax.drive.numbers import require_number, shift_of, unit_of
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive

_ROWS = 13  # of a sweep's table; every row is in the JSON and the NetCDF file
_COLUMNS = 8  # of them, to fit the width of a page


class VeeringPart(Part):
    """Two modes that come close and exchange their shapes."""

    value: float = meaning("of the swept number, SI")
    modes: list[int] = meaning("counted from 1")
    gap_hertz: float = meaning("Hz, least distance")
    resolved: bool = meaning("false: the gap is an upper bound")


class SweepDocument(PointDocument):
    """`beltjax sweep`: rows by value, columns by mode."""

    success: bool = meaning("whether any point succeeded")
    over: str = meaning("key of the swept number")
    unit: str = meaning("SI; empty for a pure number")
    values: list[float] = meaning("of the swept number, with those inserted")
    hertz: list[Row] = meaning("Hz; null where a mode is absent")
    dimensionless: list[Row]
    labels: list[str] = meaning("what moves most in each mode")
    error: list[Row] = meaning("relative, of the frequencies")
    mac: list[Row] = meaning("agreement of shapes with the last good point")
    coupling: list[Row] = meaning("Gamma of each span")
    coupling_total: Row = meaning("Gamma")
    veerings: list[VeeringPart]
    failures: list[str | None] = meaning("why each point failed")


def sweep_report(
    path: str | os.PathLike[str],
    over: str,
    count: int,
    orders: str,
    outputs: tuple[str | None, str | None],
    advance: Advance,
    si: bool = False,
    duty: str | None = None,
) -> Report:
    """Sweep one number of a drive file; `outputs` name a NetCDF file and a picture.

    Raises `FileError` for options that cannot be used.
    """
    drive, point, at = vibrating(path, duty)
    netcdf, figure = outputs
    name, text = read_option("--over", lambda: read_named(over, "NAME=FROM:TO:POINTS"))
    read_option("--over", lambda: require_number(drive, name))
    values = read_option("--over", lambda: read_range(text, unit_of(drive, name)))
    values = values - shift_of(drive, name)
    lines = read_option("--orders", lambda: read_orders(orders))
    read_option("--count", lambda: require_count(drive, count))
    found = sweep(drive, point, name, values, count=count, advance=advance)
    document = sweep_document(drive, point, found) | {"at": at}
    files = []
    if netcdf:
        files.append((netcdf, _netcdf(found)))
    if figure:
        from beltjax.draw.curves import sweep_figure  # slow to load
        from beltjax.draw.layouts import picture_bytes

        picture = sweep_figure(drive, found, document["labels"], lines)
        files.append((figure, picture_bytes(picture, figure)))
    failure = all_failed(path, name, found.outcomes)
    tables = sweep_tables(document, TableUnits(drive, si))
    return Report(document, tables, failure, tuple(files))


def _netcdf(found: Sweep) -> bytes:
    data: Any = found.to_xarray().to_netcdf(engine="scipy")
    return bytes(data)


def sweep_document(drive: Drive, point: OperatingPoint, found: Sweep) -> dict[str, Any]:
    """A sweep; rows by value, columns by mode, modes counted from 1, null where absent."""
    veerings = [
        {
            "value": veering.value,
            "modes": [mode + 1 for mode in veering.modes],
            "gap_hertz": veering.gap / (2 * np.pi),
            "resolved": veering.resolved,
        }
        for veering in found.veerings
    ]
    return {
        "drive": drive.name,
        "success": bool(found.good.any()),
        "model": model_flags(drive),
        "warnings": sweep_warnings(drive, point, found),
        "over": found.name,
        "unit": found.unit,
        "values": plain(found.values),
        "hertz": plain(found.frequencies / (2 * np.pi)),
        "dimensionless": plain(found.dimensionless),
        "labels": [span_label(drive, label) for label in found.labels],
        "error": plain(found.error),
        "mac": plain(found.mac),
        "coupling": plain(found.coupling),
        "coupling_total": plain(np.sum(found.coupling, axis=1)),
        "veerings": veerings,
        "failures": [text or None for text in found.outcomes],
    }


def sweep_tables(document: dict[str, Any], units: TableUnits) -> Group:
    """Some rows and columns of a sweep, all its modes and its veerings."""
    parts = [*warning_lines(document), _sweep_table(document, units), _modes_table(document)]
    if document["veerings"]:
        parts.append(_veering_table(document, units))
    failed = sum(text is not None for text in document["failures"])
    if failed:
        why = next(text for text in document["failures"] if text)
        parts.append(f"{failed} of {len(document['values'])} points failed; the first: {why}")
    return Group(*parts)


def _sweep_table(document: dict[str, Any], units: TableUnits) -> Any:
    shown = min(len(document["labels"]), _COLUMNS)
    _, unit = units.unit_of_number(document["over"])
    title = f"{titled(document)}: natural frequencies (Hz) over {document['over']}"
    columns = ["Gamma", *(str(k + 1) for k in range(shown))]
    table = plain_table(escape(title), f"at ({unit})" if unit else "at", *columns)
    count = len(document["values"])
    for p in np.unique(np.linspace(0, count - 1, min(count, _ROWS)).round().astype(int)):
        row = document["hertz"][p][:shown]
        gamma = number(document["coupling_total"][p], 4)
        at, _ = units.of_number(document["over"], document["values"][p])
        table.add_row(at, gamma, *(number(x, 2) for x in row))
    return table


def _modes_table(document: dict[str, Any]) -> Any:
    table = plain_table("Modes, each followed by its shape", "mode", "moves most", "least MAC")
    agreement = np.array(document["mac"], dtype=float)
    for k, label in enumerate(document["labels"]):
        followed = agreement[:, k][agreement[:, k] > 0]  # nan and 0: not there before
        least = number(float(followed.min()), 4) if len(followed) else "-"
        table.add_row(str(k + 1), escape(label), least)
    return table


def _veering_table(document: dict[str, Any], units: TableUnits) -> Any:
    _, unit = units.unit_of_number(document["over"])
    head = f"at ({unit})" if unit else "at"
    table = plain_table("Veerings", "modes", head, "gap (Hz)", "")
    for veering in document["veerings"]:
        modes = " and ".join(map(str, veering["modes"]))
        note = "" if veering["resolved"] else "not resolved: an upper bound"
        at, _ = units.of_number(document["over"], veering["value"])
        table.add_row(modes, at, number(veering["gap_hertz"], 3), note)
    return table
