"""What each command of the command line does, from a file to its report."""

import dataclasses
import importlib
import math
import os
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
from rich.console import RenderableType

from beltjax.analysis.linearization import has_inertias
from beltjax.analysis.sensitivity import canonical_sensitivities, in_names_of
from beltjax.drive.canonical import canonical
from beltjax.drive.files import drive_bytes, load_drive
from beltjax.drive.system import Drive
from beltjax.drive.units import shown
from beltjax.errors import FileError
from beltjax.numerics.bases import Legendre
from beltjax.reading import read_json
from beltjax.report.diagnosis import diagnose
from beltjax.report.documents import (
    analysis_document,
    chosen_document,
    design_document,
    plain_numbers,
    robust_document,
)
from beltjax.report.programs import run_kept
from beltjax.report.tables import analysis_tables, design_tables
from beltjax.report.warnings import modes_left_out
from beltjax.results import RESULTS, explanation

MODES = 8
_RUN = "give the JSON of a run of this study"
MOST_VIBRATING = 40  # pulleys; the work for modes grows with the cube of their number
_FUNCTIONS = 40  # a span: frequencies to 1e-6 for any bending stiffness, and mostly to 1e-10
_COORDINATES = 500  # of all spans, whose modes are found in some seconds


class Report(NamedTuple):
    """The answer to one command."""

    document: dict[str, Any]  # the JSON
    tables: RenderableType
    failure: str  # one line; empty where all went well
    files: tuple[tuple[str, bytes], ...] = ()  # paths and contents, to be written at the end


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
        figures = importlib.import_module("beltjax.report.figures")  # slow to load
        picture = figures.mode_shapes(drive, point, found.modes)
        files = ((figure, figures.picture_bytes(picture, figure)),)
    return Report(document, tables, failure, files)


def require_inertias(drive: Drive, path: str | os.PathLike[str], what: str) -> None:
    """Raise `FileError`, which names the first inertia that is missing and `what` needs it."""
    if not has_inertias(drive):
        lacking = [f"pulley.{p.name}.inertia" for p in drive.pulleys if p.inertia is None]
        key = (lacking or ["tensioner.inertia"])[0]
        raise FileError(path, key, f"is missing; {what} the inertia of every pulley and of the arm")


def require_few_pulleys(drive: Drive, path: str | os.PathLike[str], what: str) -> None:
    """Raise `FileError` where a drive has more pulleys than `what` can be found for."""
    if len(drive.pulleys) > MOST_VIBRATING:
        message = f"found {len(drive.pulleys)}; {what} are found for {MOST_VIBRATING} at most"
        raise FileError(path, "pulley", message)


class StudyRequest(NamedTuple):
    """What `beltjax optimize` was given beside the study; None: nothing, or the study's."""

    figure: str | None = None
    drive: str | None = None  # where to write the optimized drive
    page: str | None = None  # where to write the HTML report
    method: str | None = None
    time_limit: float | None = None  # [s]
    checkpoint: str | None = None
    warm: str | None = None  # the JSON of an earlier run


def study_job(
    path: str | os.PathLike[str],
    given: StudyRequest,
    advance: Callable[[str, int, int | None], None],
) -> Report:
    """Run one study, with the files that were asked for.

    Raises `FileError` for a study that cannot be posed; a study without a solution is a report
    whose `failure` says which limit is missed and by how much.
    """
    optimize = importlib.import_module("beltjax.optimize")  # slow to load; `analyze` needs none
    study = _changed(optimize.load_study(path), given)
    warm = () if given.warm is None else (_warm_start(given.warm, study.variables.names),)
    if study.choices:
        chosen = optimize.enumerated(study, advance)
        design, choices = chosen[0].design, chosen_document(chosen)
    else:
        design, choices = _minimized(study, advance, warm, given.checkpoint), {}
    document = design_document(design) | choices
    if study.scatter is not None:
        document |= robust_document(design, study.scatter)
    before = {
        name: (float(optimize.value_of(study.drive, name)), optimize.unit_of(study.drive, name))
        for name in design.values
    }
    files = []
    if given.figure:
        figures = importlib.import_module("beltjax.report.figures")
        picture = figures.before_and_after(
            (study.drive, design.before.reference.layout),
            (design.drive, design.steady.reference.layout),
            f"{study.drive.name}: objective {_text(design.initial)} to {_text(design.final)}",
        )
        files.append((given.figure, figures.picture_bytes(picture, given.figure)))
    if given.drive and design.success:
        files.append((given.drive, drive_bytes(design.drive, study.point)))
    if given.page:
        page = importlib.import_module("beltjax.report.page")
        files.append((given.page, page.study_page(study, design, document, before)))
    failure = "" if design.success else str(FileError(path, *_missed(design)))
    return Report(document, design_tables(document, before), failure, tuple(files))


def _minimized(study: Any, advance: Any, warm: tuple, checkpoint: str | None) -> Any:
    optimize = importlib.import_module("beltjax.optimize")
    try:
        return optimize.minimize(study, advance, warm=warm, checkpoint=checkpoint)
    except ValueError as error:
        raise FileError("--checkpoint", "", str(error)) from error


def _changed(study: Any, given: StudyRequest) -> Any:
    """`study` with the method and the time limit that the command names."""
    changes = {"method": given.method, "time_limit": given.time_limit}
    changes = {name: value for name, value in changes.items() if value is not None}
    return dataclasses.replace(study, **changes)


def _warm_start(path: str, names: tuple[str, ...]) -> dict[str, float]:
    """The design of an earlier run's JSON; raises `FileError` where there is none."""
    document = read_json(path, _RUN)
    design = document.get("design") if isinstance(document, dict) else None
    if not isinstance(design, dict):
        raise FileError(path, "design", f"is missing; {_RUN}")
    return {name: _finite(path, name, design.get(name)) for name in names}


def _finite(path: str, name: str, value: Any) -> float:
    try:
        number = float(value) if type(value) in (int, float) else math.nan
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        message = f"found {shown(value)} for {name!r}, no finite number; {_RUN}"
        if value is None:
            message = f"has no number for {name!r}; {_RUN}"
        raise FileError(path, "design", message)
    return number


def _text(objective: float | None) -> str:
    return "-" if objective is None else f"{objective:.4g}"


def _missed(design: Any) -> tuple[str, str]:
    """Key and message of what keeps a design from being a success."""
    optimize = importlib.import_module("beltjax.optimize")
    missed = [constraint for constraint in design.constraints if constraint.violation]
    if design.result == RESULTS.no_starting_design:
        return "variable", explanation(design.result)
    if design.result == RESULTS.time_limit_reached:
        return "optimizer.time_limit", explanation(design.result)
    if design.result != RESULTS.constraints_infeasible or not missed:
        return "optimizer.starts", explanation(design.result)
    parts = []
    for constraint in missed:
        low = constraint.lower is not None and constraint.value < constraint.lower
        limit = constraint.lower if low else constraint.upper
        side = "at least" if low else "at most"
        name, _ = optimize.study.split_name(constraint.quantity)
        unit = optimize.quantity(name, design.drive).unit
        parts.append(
            f"{constraint.quantity} must be {side} {limit:.6g} and gets to {constraint.value:.6g}, "
            f"missed by {constraint.violation:.3g} {unit}".rstrip()
        )
    key = f"constraint.{missed[0].quantity}"
    return key, f"cannot be met: {'; '.join(parts)}; relax a limit or widen the bounds"
