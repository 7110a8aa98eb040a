"""Declares `beltjax sweep`; its work is in `reports/sweep.py`."""

from typing import TYPE_CHECKING

import click

from beltjax.commands.registry import (
    command,
    duty_option,
    figure_option,
    json_option,
    si_option,
)
from beltjax.commands.running import Advance, answer

if TYPE_CHECKING:
    from beltjax.commands.reports.documents import Document
    from beltjax.commands.reports.report import Report


def _document() -> type["Document"]:
    from beltjax.commands.reports.sweep import SweepDocument

    return SweepDocument


@command(_document)
@click.argument("drive_file", metavar="DRIVE.toml")
@click.option(
    "--over", required=True, metavar="NAME=FROM:TO:POINTS", help="Vary this number over a range."
)
@click.option("--count", default=8, show_default=True, help="Follow so many modes.")
@click.option("--orders", default="2,4", show_default=True, help="Draw these orders over a speed.")
@duty_option
@json_option
@click.option("--netcdf", metavar="FILE.nc", help="Write every row, with units.")
@figure_option
@si_option
def sweep(
    drive_file: str,
    over: str,
    count: int,
    orders: str,
    duty: str | None,
    json_path: str | None,
    netcdf: str | None,
    figure: str | None,
    si: bool,
) -> None:
    """Gamma and natural frequencies over any number of the drive file, each mode followed.

    For example --over "operation.driver_speed=600 rpm:6000 rpm:121"; bare numbers are SI.
    """

    def work(advance: Advance) -> "Report":
        from beltjax.commands.reports.sweep import sweep_report

        outputs = netcdf, figure
        return sweep_report(drive_file, over, count, orders, outputs, advance, si, duty)

    answer(work, read=drive_file, json=json_path, written=(netcdf,), pictures=(figure,))
