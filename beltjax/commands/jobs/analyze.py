"""What `beltjax analyze` does, from a drive file to a report."""

import os
from typing import Any

import jax

from beltjax.analysis.linearization import has_inertias
from beltjax.analysis.sensitivity import canonical_sensitivities, in_names_of
from beltjax.commands.diagnosis import diagnose
from beltjax.commands.documents import (
    analysis_document,
    plain_numbers,
)
from beltjax.commands.jobs.vibrating import MOST_VIBRATING, require_few_pulleys, require_inertias
from beltjax.commands.report import Report
from beltjax.commands.tables import analysis_tables
from beltjax.commands.warnings import modes_left_out
from beltjax.compiling.kept_programs import run_kept
from beltjax.drive.canonical import canonical
from beltjax.drive.files import load_drive
from beltjax.files.errors import FileError
from beltjax.numerics.bases import Legendre

MODES = 8
_FUNCTIONS = 40  # a span: frequencies to 1e-6 for any bending stiffness, and mostly to 1e-10
_COORDINATES = 500  # of all spans, whose modes are found in some seconds


def analysis_job(path: str | os.PathLike[str], figure: str | None = None) -> Report:
    """Analyze one drive file, and draw its modes if asked.

    Raises `FileError` where the file describes no possible drive.
    """
    drive, point = load_drive(path)
    if figure:
        require_inertias(drive, path, "modes to draw need")
        require_few_pulleys(drive, path, "modes to draw")
    numbers = canonical(drive, point)
    pulleys = len(drive.pulleys)
    few = pulleys <= MOST_VIBRATING
    basis = Legendre(min(_FUNCTIONS, max(_COORDINATES // pulleys, 1)))
    asked = (MODES if few else 0), basis
    found = jax.device_get(run_kept(canonical_sensitivities, *numbers, *asked))
    found = in_names_of(drive, point, found)
    why = diagnose(drive, point, found.steady)
    if why and why.impossible:
        raise FileError(path, why.key, why.message)
    failure = str(FileError(path, why.key, why.message)) if why else ""
    document: dict[str, Any] = analysis_document(drive, found) | {"success": not failure}
    if has_inertias(drive) and not few:
        document["warnings"].append(modes_left_out(drive, MOST_VIBRATING))
    tables = analysis_tables(document, plain_numbers(drive, point))
    files: tuple[tuple[str, bytes], ...] = ()
    if figure and found.modes and not failure:
        from beltjax.draw.layouts import mode_shapes, picture_bytes  # slow to load

        picture = mode_shapes(drive, point, found.modes)
        files = ((figure, picture_bytes(picture, figure)),)
    return Report(document, tables, failure, files)
