"""Declares `beltjax response`; its work is in `reports/response.py`."""

from typing import TYPE_CHECKING

import click

from beltjax.commands.registry import (
    command,
    crank_option,
    driver_option,
    duty_option,
    figure_option,
    json_option,
    modal_damping_option,
    order_option,
    si_option,
    torque_option,
)
from beltjax.commands.running import Advance, answer

if TYPE_CHECKING:
    from beltjax.commands.reports.documents import Document
    from beltjax.commands.reports.report import Report


def _document() -> type["Document"]:
    from beltjax.commands.reports.response import ResponseDocument

    return ResponseDocument


@command(_document)
@click.argument("drive_file", metavar="DRIVE.toml")
@crank_option
@torque_option
@order_option
@driver_option
@click.option(
    "--speeds",
    default="600 rpm:6000 rpm:200",
    show_default=True,
    help="Vary the driver's speed over this range.",
)
@modal_damping_option
@duty_option
@json_option
@figure_option
@si_option
def response(
    drive_file: str,
    crank: str | None,
    torque: tuple[str, ...],
    order: float | None,
    driver: str | None,
    speeds: str,
    modal_damping: float | None,
    duty: str | None,
    json_path: str | None,
    figure: str | None,
    si: bool,
) -> None:
    """Forced vibration over the driver's speed, by crank motion or accessory torque."""

    def work(advance: Advance) -> "Report":
        from beltjax.commands.reports.response import ResponseOptions, response_report

        return response_report(
            drive_file,
            ResponseOptions(crank, torque, order, speeds, modal_damping, duty, driver),
            figure,
            advance,
            si,
        )

    answer(work, read=drive_file, json=json_path, pictures=(figure,))
