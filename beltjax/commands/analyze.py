"""Declares `beltjax analyze`; its work is in `reports/analyze.py`."""

from typing import TYPE_CHECKING

import click

from beltjax.commands.registry import (
    command,
    figure_option,
    json_option,
    report_option,
    si_option,
)
from beltjax.commands.running import Advance, answer

if TYPE_CHECKING:
    from beltjax.commands.reports.documents import Document
    from beltjax.commands.reports.report import Report


def _document() -> type["Document"]:
    from beltjax.commands.reports.analyze import AnalyzeDocument

    return AnalyzeDocument


@command(_document)
@click.argument("drive_file", metavar="DRIVE.toml")
@json_option
@figure_option
@report_option
@si_option
def analyze(
    drive_file: str, json_path: str | None, figure: str | None, page: str | None, si: bool
) -> None:
    """Layout, tensions, belt-pulley coupling Gamma, modes, and what moves Gamma."""

    def work(advance: Advance) -> "Report":
        from beltjax.commands.reports.analyze import analyze_report

        return analyze_report(drive_file, figure, si, page)

    answer(
        work,
        read=drive_file,
        json=json_path,
        written=(page,),
        pictures=(figure,),
        busy="analyzing",
    )
