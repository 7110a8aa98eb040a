"""What `beltjax optimize` does, from a study file to a report."""

import dataclasses
import importlib
import math
import os
from collections.abc import Callable
from typing import Any, NamedTuple

from beltjax.commands.documents import (
    chosen_document,
    design_document,
    robust_document,
)
from beltjax.commands.report import Report
from beltjax.commands.tables import design_tables
from beltjax.drive.files import drive_bytes
from beltjax.files.errors import FileError
from beltjax.files.reading import read_json
from beltjax.files.units import shown
from beltjax.results import RESULTS, explanation

_RUN = "give the JSON of a run of this study"


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
        from beltjax.draw.layouts import before_and_after, picture_bytes  # slow to load

        picture = before_and_after(
            (study.drive, design.before.reference.layout),
            (design.drive, design.steady.reference.layout),
            f"{study.drive.name}: objective {_text(design.initial)} to {_text(design.final)}",
        )
        files.append((given.figure, picture_bytes(picture, given.figure)))
    if given.drive and design.success:
        files.append((given.drive, drive_bytes(design.drive, study.point)))
    if given.page:
        from beltjax.commands.page import study_page  # slow to load

        files.append((given.page, study_page(study, design, document, before)))
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
