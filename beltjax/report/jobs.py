"""What each command of the command line does, from a file to its report."""

import os
from typing import Any, NamedTuple

import jax
from rich.console import RenderableType

from beltjax.analysis.sensitivity import coupling_sensitivity
from beltjax.drive.files import load_drive
from beltjax.errors import FileError
from beltjax.report.diagnosis import diagnose
from beltjax.report.documents import analysis_document, plain_numbers
from beltjax.report.tables import analysis_tables
from beltjax.results import succeeded


class Report(NamedTuple):
    """The answer to one command."""

    document: dict[str, Any]  # the JSON
    tables: RenderableType
    failure: str  # one line; empty where all went well


def analysis_job(path: str | os.PathLike[str]) -> Report:
    """Analyze one drive file. Raises `FileError` where the file describes no possible drive."""
    drive, point = load_drive(path)
    steady, gradient = jax.device_get(compiled_for_one(coupling_sensitivity)(drive, point))
    failure = ""
    if not succeeded(steady.result):
        why = diagnose(drive, point, steady)
        if why.impossible:
            raise FileError(path, why.key, why.message)
        failure = str(FileError(path, why.key, why.message))
    document = analysis_document(drive, steady, gradient)
    tables = analysis_tables(document, plain_numbers(drive, point))
    return Report(document, tables, failure)


def compiled_for_one(function: Any) -> Any:
    """`function` compiled for a single call: fusing kernels pays in batches alone."""
    options = {"xla_disable_hlo_passes": "fusion"} if jax.default_backend() == "cpu" else None
    return jax.jit(function, compiler_options=options)
