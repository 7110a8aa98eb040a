"""Declares `beltjax optimize`; its work is in `reports/optimize.py`."""

from typing import TYPE_CHECKING, Any

import click

from beltjax.commands.registry import (
    command,
    json_option,
    optimizers_option,
    quantities_option,
    report_option,
    si_option,
)
from beltjax.commands.running import Advance, answer

if TYPE_CHECKING:
    from beltjax.commands.reports.documents import Document
    from beltjax.commands.reports.report import Report


def _document() -> type["Document"]:
    from beltjax.commands.reports.optimize import OptimizeDocument

    return OptimizeDocument


@command(_document)
@click.argument("study_file", metavar="STUDY.toml")
@json_option
@click.option("--figure", metavar="FILE.png", help="Draw the layout before and after.")
@click.option(
    "--out", "--save-drive", "drive", metavar="DRIVE.toml", help="Write the optimized drive."
)
@report_option
@click.option("--method", metavar="NAME", help="Use this optimizer in place of the study's.")
@optimizers_option
@quantities_option
@click.option(
    "--time-limit",
    type=click.FloatRange(0, min_open=True),
    help="End the search after so many seconds.",
)
@click.option(
    "--checkpoint", metavar="FILE", help="Keep the search's state in a file, and go on from it."
)
@click.option("--warm", metavar="FILE.json", help="Also start from the design of an earlier run.")
@si_option
def optimize(study_file: str, json_path: str | None, figure: str | None, **given: Any) -> None:
    """The design that minimizes an objective under constraints."""
    outputs = tuple(given[name] for name in ("drive", "page", "checkpoint"))

    def work(advance: Advance) -> "Report":
        from beltjax.commands.reports.optimize import OptimizeOptions, optimize_report

        return optimize_report(study_file, OptimizeOptions(figure, **given), advance)

    answer(work, read=study_file, json=json_path, written=outputs, pictures=(figure,))
