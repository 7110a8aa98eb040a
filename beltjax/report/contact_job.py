"""What `beltjax contact` does, from a drive file to a report."""

import importlib
import os

import jax

from beltjax.analysis.contact import Law, asked, contact_solution
from beltjax.drive.components import Drive, OperatingPoint
from beltjax.drive.files import load_drive
from beltjax.errors import FileError
from beltjax.report.contact import contact_document, contact_tables, diagnose_contact
from beltjax.report.jobs import Report
from beltjax.report.programs import run_kept


def contact_job(
    path: str | os.PathLike[str], maximum: bool, law: Law, figure: str | None
) -> Report:
    """The contact state of one drive file, under its torques or under the largest.

    Raises `FileError` where the file leaves out what contact needs; a state that is not physical
    is a report with a `failure`.
    """
    drive, point = load_drive(path)
    _require_friction(path, drive, point, maximum)
    state = jax.device_get(run_kept(contact_solution, drive, point, *asked(law, maximum)))
    why = diagnose_contact(drive, point, state)
    if why and why.impossible:
        raise FileError(path, why.key, why.message)
    document = contact_document(drive, state)
    files: tuple[tuple[str, bytes], ...] = ()
    if figure and document["pulleys"] is not None:
        pictures = importlib.import_module("beltjax.report.contact_figures")  # slow to load
        figures = importlib.import_module("beltjax.report.figures")
        picture = pictures.contact_figure(drive, state)
        files = ((figure, figures.picture_bytes(picture, figure)),)
    failure = str(FileError(path, why.key, why.message)) if why else ""
    return Report(document, contact_tables(document), failure, files)


def _require_friction(path, drive: Drive, point: OperatingPoint, maximum: bool) -> None:
    alone = maximum and len(drive.pulleys) == 2
    turned = any(float(torque) for torque in point.torque.values())
    for pulley in drive.pulleys:
        torque = float(point.torque.get(pulley.name, 0.0)) or (turned and float(pulley.driver))
        if pulley.friction is None and (alone or torque):
            key = f"pulley.{pulley.name}.friction"
            raise FileError(path, key, "is missing; this pulley has torque, which friction holds")
