"""What `beltjax contact` does, from a drive file to a report."""

import importlib
import os

import jax

from beltjax.analysis.contact import ContactState, Law, asked, contact_solution, without_friction
from beltjax.analysis.steady import SteadyState, steady_state
from beltjax.drive.canonical import canonical
from beltjax.drive.files import load_drive
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.errors import FileError
from beltjax.numerics.compilation import quickly_compiled
from beltjax.report.contact import contact_document, contact_tables, diagnose_contact
from beltjax.report.jobs import Report
from beltjax.report.programs import run_kept


def contact_job(
    path: str | os.PathLike[str],
    maximum: bool,
    law: Law,
    figure: str | None,
    compare: str | None,
) -> Report:
    """The contact state of one drive file, under its torques or under the largest.

    `figure` is a picture of it; `compare` one of its spans beside those of `steady_state`.

    Raises `FileError` where the file leaves out what contact needs; a state that is not physical
    is a report with a `failure`.
    """
    drive, point = load_drive(path)
    bare = without_friction(drive, point, maximum)
    if bare is not None:
        message = "is missing; this pulley has torque, which friction holds"
        raise FileError(path, f"pulley.{bare}.friction", message)
    state = jax.device_get(
        run_kept(contact_solution, *canonical(drive, point), *asked(law, maximum))
    )
    why = diagnose_contact(drive, point, state)
    if why and why.impossible:
        raise FileError(path, why.key, why.message)
    document = contact_document(drive, state)
    files = _pictures(drive, point, state, figure, compare) if document["pulleys"] else ()
    failure = str(FileError(path, why.key, why.message)) if why else ""
    return Report(document, contact_tables(document), failure, files)


def _pictures(
    drive: Drive,
    point: OperatingPoint,
    state: ContactState,
    figure: str | None,
    compare: str | None,
) -> tuple[tuple[str, bytes], ...]:
    contact_figures = importlib.import_module("beltjax.report.contact_figures")  # slow to load
    figures = importlib.import_module("beltjax.report.figures")
    drawn = []
    if figure:
        drawn.append((figure, contact_figures.contact_figure(drive, state)))
    if compare:
        steady = quickly_compiled(_fixed_contacts)(*canonical(drive, point))
        picture = contact_figures.two_models_figure(drive, [("", state, steady)])
        drawn.append((compare, picture))
    return tuple((name, figures.picture_bytes(picture, name)) for name, picture in drawn)


def _fixed_contacts(drive: Drive, point: OperatingPoint) -> SteadyState:
    return steady_state(drive, point, throw=False)
