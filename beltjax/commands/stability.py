"""Declares `beltjax stability`; its work is in `reports/stability.py`."""

from typing import TYPE_CHECKING

import click

from beltjax.commands.registry import (
    belt_damping_option,
    command,
    crank_option,
    duty_option,
    figure_option,
    json_option,
    modal_damping_option,
    order_option,
    orders_option,
    si_option,
    torque_option,
)
from beltjax.commands.running import Advance, answer

if TYPE_CHECKING:
    from beltjax.commands.reports.documents import Document
    from beltjax.commands.reports.report import Report


def _document() -> type["Document"]:
    from beltjax.commands.reports.stability import StabilityDocument

    return StabilityDocument


@command(_document)
@click.argument("drive_file", metavar="DRIVE.toml")
@crank_option
@torque_option
@order_option
@orders_option
@click.option(
    "--speeds",
    metavar="FROM:TO",
    default="600 rpm:6000 rpm",
    show_default=True,
    help="Look for unstable speeds of the driver in this range.",
)
@modal_damping_option
@belt_damping_option
@click.option("--exact", is_flag=True, help="Refine the least tongues by Floquet's theory.")
@duty_option
@json_option
@figure_option
@si_option
def stability(
    drive_file: str,
    crank: str | None,
    torque: tuple[str, ...],
    order: float | None,
    orders: str | None,
    speeds: str,
    modal_damping: float | None,
    belt_damping: str | None,
    exact: bool,
    duty: str | None,
    json_path: str | None,
    figure: str | None,
    si: bool,
) -> None:
    """Parametric instability: at which speeds a shaking crank makes spans and pulleys swing up."""

    def work(advance: Advance) -> "Report":
        from beltjax.commands.reports.stability import StabilityOptions, stability_report

        given = StabilityOptions(
            crank=crank,
            torques=torque,
            order=order,
            orders=orders,
            speeds=speeds,
            modal_damping=modal_damping,
            belt_damping=belt_damping,
            exact=exact,
            duty=duty,
            slopes=json_path is not None,
        )
        return stability_report(drive_file, given, figure, advance, si)

    answer(work, read=drive_file, json=json_path, pictures=(figure,))
