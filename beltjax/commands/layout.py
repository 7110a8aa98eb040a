"""Declares `beltjax layout`; its work is in `reports/layout.py`."""

from typing import TYPE_CHECKING

import click

from beltjax.commands.registry import command, figure_option, json_option, si_option
from beltjax.commands.running import Advance, answer

if TYPE_CHECKING:
    from beltjax.commands.reports.documents import Document
    from beltjax.commands.reports.report import Report


def _document() -> type["Document"]:
    from beltjax.commands.reports.layout import LayoutDocument

    return LayoutDocument


@command(_document)
@click.argument("drive_file", metavar="DRIVE.toml")
@json_option
@figure_option
@si_option
def layout(drive_file: str, json_path: str | None, figure: str | None, si: bool) -> None:
    """Spans, wraps, lengths, speeds and clearances of a file that may have geometry alone."""

    def work(advance: Advance) -> "Report":
        from beltjax.commands.reports.layout import layout_report

        return layout_report(drive_file, figure, si)

    answer(work, read=drive_file, json=json_path, pictures=(figure,), busy="drawing")
