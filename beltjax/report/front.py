"""What `beltjax pareto` does, from a study file to a report."""

import importlib
import os
from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.console import Group

from beltjax.errors import FileError
from beltjax.report.documents import front_document
from beltjax.report.figures import AFTER, picture_bytes
from beltjax.report.jobs import Report
from beltjax.report.tables import front_table
from beltjax.report.warnings import drive_warnings, warning_lines


def front_job(
    path: str | os.PathLike[str],
    points: int | None,
    figure: str | None,
    advance: Callable[[str, int, int | None], None],
) -> Report:
    """Follow the front of a study's [pareto] objectives. Raises `FileError` where it has none."""
    optimize = importlib.import_module("beltjax.optimize")  # slow to load
    study = optimize.load_study(path)
    if not study.pareto:
        raise FileError(path, "pareto", "is missing; give objectives = [..], two or three of them")
    front = optimize.pareto(study, points=points, advance=advance)
    document = front_document(front) | {"warnings": drive_warnings(study.drive, study.point)}
    files = ((figure, picture_bytes(front_figure(front), figure)),) if figure else ()
    tables = Group(*warning_lines(document), front_table(document))
    return Report(document, tables, _failure(path, front), files)


def _failure(path: object, front: Any) -> str:
    missed = [n for n, anchor in zip(front.names, front.anchors, strict=True) if not anchor.success]
    if not missed:
        return ""
    text = f"no optimum of {missed[0]!r} alone was found; run `beltjax optimize` on it to see why"
    return str(FileError(path, "pareto.objectives", text))


def front_figure(front: Any) -> Figure:
    """Every pair of objectives against each other; for three, the third in color."""
    rows = np.array([point.objectives for point in front.points]).reshape(-1, len(front.names))
    labels = [f"{n.removeprefix('-')} ({u})" if u else n.removeprefix("-")
              for n, u in zip(front.names, front.units, strict=True)]  # fmt: skip
    pairs = [(0, 1)] if len(front.names) == 2 else [(0, 1), (0, 2), (1, 2)]
    figure = Figure(figsize=(1.5 + 4.5 * len(pairs), 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(pairs), squeeze=False)[0]
    for axes, (i, j) in zip(panels, pairs, strict=True):
        axes.plot(rows[:, i], rows[:, j], "o-" if len(pairs) == 1 else "o", color=AFTER)
        axes.set_xlabel(labels[i], parse_math=False)
        axes.set_ylabel(labels[j], parse_math=False)
        axes.grid(linewidth=0.3)
    return figure
