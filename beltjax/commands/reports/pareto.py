"""The work of `beltjax pareto`: it turns a study file into a report."""

import os
import re
from typing import Any

from rich.console import Group
from rich.markup import escape
from rich.table import Table

from beltjax import optimize
from beltjax.commands.reports.documents import (
    Document,
    Maybe,
    Part,
    meaning,
    model_flags,
    plain,
)
from beltjax.commands.reports.report import Report
from beltjax.commands.reports.tables import plain_table
from beltjax.commands.reports.units import TableUnits
from beltjax.commands.reports.warnings import drive_warnings, warning_lines
from beltjax.commands.running import Advance
from beltjax.files.errors import FileError


class FrontPointPart(Part):
    """A design of the front."""

    objectives: dict[str, float]
    design: dict[str, float] = meaning("of the variables, SI")
    residual: Maybe = meaning("of the conditions of an optimum")


class ParetoDocument(Document):
    """`beltjax pareto`."""

    objectives: list[str] = meaning("names")
    points: list[FrontPointPart]
    success: bool


def pareto_report(
    path: str | os.PathLike[str],
    points: int | None,
    figure: str | None,
    advance: Advance,
    si: bool = False,
) -> Report:
    """Follow the front of a study's [pareto] objectives. Raises `FileError` where it has none."""
    study = optimize.load_study(path)
    if not study.pareto:
        raise FileError(path, "pareto", "is missing; give objectives = [..], two or three of them")
    front = optimize.pareto(study, points=points, advance=advance)
    document = pareto_document(front) | {
        "model": model_flags(study.drive),
        "warnings": drive_warnings(study.drive, study.point),
    }
    files: tuple[tuple[str, bytes], ...] = ()
    if figure:
        from beltjax.draw.front import front_figure  # slow to load
        from beltjax.draw.layouts import picture_bytes

        files = ((figure, picture_bytes(front_figure(front), figure)),)
    tables = Group(
        *warning_lines(document), pareto_table(document, front, TableUnits(study.drive, si))
    )
    return Report(document, tables, _failure(path, front), files)


def _failure(path: object, front: optimize.Front) -> str:
    missed = [n for n, anchor in zip(front.names, front.anchors, strict=True) if not anchor.success]
    if not missed:
        return ""
    text = f"no optimum of {missed[0]!r} alone was found; run `beltjax optimize` on it to see why"
    return str(FileError(path, "pareto.objectives", text))


def pareto_document(front: optimize.Front) -> dict[str, Any]:
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


def pareto_table(document: dict[str, Any], front: optimize.Front, units: TableUnits) -> Table:
    """The table of `beltjax pareto`: objectives and variables of every design of the front."""
    names = document["objectives"]
    points = document["points"]
    variables = list(points[0]["design"]) if points else []
    objectives = [units.of_quantity(1.0, unit) for unit in front.units]
    shown = [*objectives, *(units.unit_of_number(name) for name in variables)]
    # A header takes as many lines as its name has parts, so that the columns stay narrow.
    headers = [
        re.sub("(?<=[.:])", "\n", name) + (f"\n({unit})" if unit else "")
        for name, (_, unit) in zip((*names, *variables), shown, strict=True)
    ]
    table = plain_table("Pareto front", *map(escape, headers))
    for point in points:
        values = zip(point["objectives"].values(), objectives, strict=True)
        cells = [f"{factor * value:.6g}" for value, (factor, _) in values]
        cells += [units.of_number(name, value)[0] for name, value in point["design"].items()]
        table.add_row(*cells)
    return table
