"""The report of `beltjax analyze`: a page of tables and pictures that prints on two sheets."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table

from beltjax.analysis.sensitivity import Sensitivities
from beltjax.commands.reports.analyze_tables import (
    components,
    mode_table,
    model_line,
    state_tables,
    summary_table,
)
from beltjax.commands.reports.duties import duty_tables, hub_load_table, worst_table
from beltjax.commands.reports.pages import inline_svg, rendered
from beltjax.commands.reports.tables import PlainTable, plain_table, plain_tables
from beltjax.commands.reports.units import TableUnits
from beltjax.draw.layouts import layout_figure, mode_shapes
from beltjax.draw.spans import span_shapes
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive

_LARGEST = 12  # numbers shown
_FREQUENCIES = 3
_SHAPES = 4  # modes drawn
_WIDE = 6.5  # inches of a picture, so that its words are read on half a sheet


def analyze_page(
    drive: Drive,
    point: OperatingPoint,
    found: Sensitivities,
    document: dict[str, Any],
    sizes: dict[str, Any],
    failure: str,
    units: TableUnits,
) -> bytes:
    """A page that opens without a network, from the JSON document and the states behind it."""
    running = document["steady"] is not None
    moves = _moves(document, sizes) if document["sensitivities"] else None
    drawn = found.modes if running and document["modes"] else None
    return rendered(
        "analyze_page.html",
        document=document,
        failure=failure,
        model=model_line(document).plain.strip().replace("model:", "Model:") + ".",
        states=_states(document, units),
        summary=_plain([summary_table(document, units)]),
        frequencies=_plain([mode_table(document["modes"])] if drawn else []),
        moves=next(iter(_plain([moves]))) if moves and moves.row_count else None,
        layout=inline_svg(layout_figure(drive, found.steady.reference.layout, _WIDE)),
        shapes=inline_svg(span_shapes(drive, found.steady)) if running else None,
        modes=inline_svg(mode_shapes(drive, point, drawn, _SHAPES)) if drawn else None,
    )


def _plain(tables: Iterable[RenderableType]) -> list[PlainTable]:
    return list(plain_tables(Group(*tables)))


def _states(document: dict[str, Any], units: TableUnits) -> list[PlainTable]:
    """The tables of the states: of the duties side by side, where there are some."""
    if document["duties"]:
        worst = worst_table(document["worst"], units)
        hubs = hub_load_table(document["worst_hub_loads"], units)
        return _plain([worst, hubs, *duty_tables(document["duties"], units)])
    coupling = (document["steady"] or {}).get("coupling")
    return _plain(state_tables("", document, coupling, units))


def _moves(document: dict[str, Any], sizes: dict[str, Any]) -> Table:
    """How much of itself a result changes by one percent of a number; the largest first."""
    steady, modes, slopes = (document[key] for key in ("steady", "modes", "sensitivities"))
    results = {"Gamma": (steady["coupling_total"], slopes["coupling_total"])}
    if modes and slopes["frequencies"]:
        for k, hertz in enumerate(modes["hertz"][:_FREQUENCIES]):
            one = {name: rows[k] for name, rows in slopes["frequencies"].items()}
            results[f"mode {k + 1} ({hertz:.1f} Hz)"] = 2 * np.pi * hertz, one
    changes: dict[str, list[float]] = {}
    for value, of in results.values():
        for name, slope in of.items():
            for label, size, part in components(name, sizes[name], slope):
                changes.setdefault(label, []).append(size * part / value if value else 0.0)
    table = plain_table("", "number", *results)
    for name in sorted(changes, key=lambda name: -max(map(abs, changes[name])))[:_LARGEST]:
        if any(changes[name]):
            table.add_row(escape(name), *(f"{change:+.3f}" for change in changes[name]))
    return table
