"""Declares `beltjax pareto`; its work is in `reports/pareto.py`."""

from typing import TYPE_CHECKING

import click

from beltjax.commands.registry import (
    command,
    figure_option,
    json_option,
    quantities_option,
    si_option,
)
from beltjax.commands.running import Advance, answer

if TYPE_CHECKING:
    from beltjax.commands.reports.documents import Document
    from beltjax.commands.reports.report import Report


def _document() -> type["Document"]:
    from beltjax.commands.reports.pareto import ParetoDocument

    return ParetoDocument


@command(_document)
@click.argument("study_file", metavar="STUDY.toml")
@click.option(
    "--points", type=click.IntRange(2, 200), help="Set so many limits along each objective."
)
@quantities_option
@json_option
@figure_option
@si_option
def pareto(
    study_file: str, points: int | None, json_path: str | None, figure: str | None, si: bool
) -> None:
    """Designs of which none is better than another in all of a study's [pareto] objectives."""

    def work(advance: Advance) -> "Report":
        from beltjax.commands.reports.pareto import pareto_report

        return pareto_report(study_file, points, figure, advance, si)

    answer(work, read=study_file, json=json_path, pictures=(figure,))
