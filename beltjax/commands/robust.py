"""Declares `beltjax robust`; its work is in `reports/robust.py`."""

from typing import TYPE_CHECKING, Any

import click

from beltjax.commands.registry import (
    command,
    json_option,
    quantities_option,
    quantity_option,
    seed_option,
    si_option,
)
from beltjax.commands.running import Advance, answer

if TYPE_CHECKING:
    from beltjax.commands.reports.documents import Document
    from beltjax.commands.reports.report import Report


def _document() -> type["Document"]:
    from beltjax.commands.reports.robust import RobustDocument

    return RobustDocument


@command(_document)
@click.argument("drive_file", metavar="DRIVE.toml")
@click.option(
    "--within",
    multiple=True,
    metavar="NAME=SIZE",
    help="Scatter a number evenly, up to SIZE from nominal.",
)
@click.option(
    "--deviation",
    multiple=True,
    metavar="NAME=SIZE",
    help="Scatter a number normally, by this standard deviation.",
)
@quantity_option
@quantities_option
@click.option("--samples", default=4096, show_default=True, help="Compute so many drives.")
@seed_option
@click.option(
    "--quantile",
    default=0.99,
    show_default=True,
    help="Report this quantile of the values and its opposite.",
)
@click.option(
    "--indices", is_flag=True, help="Find shares of the variance from a sample, by SALib."
)
@json_option
@si_option
def robust(
    drive_file: str, quantity: tuple[str, ...], json_path: str | None, si: bool, **given: Any
) -> None:
    """What tolerances make of a drive: means, deviations, quantiles, and which one matters.

    For example --within "pulley.idler.center.x=0.5 mm" --deviation installation.tension=15.
    """

    def work(advance: Advance) -> "Report":
        from beltjax.commands.reports.robust import RobustOptions, robust_report

        options = RobustOptions(quantities=quantity or ("coupling",), **given)
        return robust_report(drive_file, options, si)

    answer(work, read=drive_file, json=json_path, busy="scattering the drive")
