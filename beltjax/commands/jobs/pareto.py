"""What `beltjax pareto` does, from a study file to a report."""

import importlib
import os
from collections.abc import Callable
from typing import Any

from rich.console import Group

from beltjax.commands.documents import front_document
from beltjax.commands.report import Report
from beltjax.commands.tables import front_table
from beltjax.commands.warnings import drive_warnings, warning_lines
from beltjax.files.errors import FileError


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
    files: tuple[tuple[str, bytes], ...] = ()
    if figure:
        from beltjax.draw.front import front_figure  # slow to load
        from beltjax.draw.layouts import picture_bytes

        files = ((figure, picture_bytes(front_figure(front), figure)),)
    tables = Group(*warning_lines(document), front_table(document))
    return Report(document, tables, _failure(path, front), files)


def _failure(path: object, front: Any) -> str:
    missed = [n for n, anchor in zip(front.names, front.anchors, strict=True) if not anchor.success]
    if not missed:
        return ""
    text = f"no optimum of {missed[0]!r} alone was found; run `beltjax optimize` on it to see why"
    return str(FileError(path, "pareto.objectives", text))
