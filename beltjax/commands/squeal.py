"""Declares `beltjax squeal`; its work is in `reports/squeal.py`."""

from typing import TYPE_CHECKING

import click

from beltjax.commands.registry import (
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
    from beltjax.commands.reports.squeal import SquealDocument

    return SquealDocument


@command(_document)
@click.argument("drive_file", metavar="DRIVE.toml")
@click.option(
    "--sliding",
    metavar="SPEED",
    help='Let the belt slide at this speed, as "0.5 m/s"; at the onset of squeal unless given.',
)
@click.option(
    "--damping",
    metavar="DAMPING",
    help="Damp the belt along each pulley by this (N s/m), in place of longitudinal_damping.",
)
@crank_option
@torque_option
@order_option
@orders_option
@modal_damping_option
@click.option(
    "--sensitivities/--no-sensitivities",
    default=True,
    show_default=True,
    help="Differentiate what squeal is judged by, for the JSON.",
)
@duty_option
@json_option
@figure_option
@si_option
def squeal(
    drive_file: str,
    sliding: str | None,
    damping: str | None,
    crank: str | None,
    torque: tuple[str, ...],
    order: float | None,
    orders: str | None,
    modal_damping: float | None,
    sensitivities: bool,
    duty: str | None,
    json_path: str | None,
    figure: str | None,
    si: bool,
) -> None:
    """Whether the belt slides on a pulley, and squeals there."""

    def work(advance: Advance) -> "Report":
        from beltjax.commands.reports.squeal import SquealOptions, squeal_report

        given = SquealOptions(
            sliding=sliding,
            damping=damping,
            crank=crank,
            torques=torque,
            order=order,
            orders=orders,
            modal_damping=modal_damping,
            duty=duty,
            slopes=sensitivities and json_path is not None,
        )
        return squeal_report(drive_file, given, figure, advance, si)

    answer(work, read=drive_file, json=json_path, pictures=(figure,))
