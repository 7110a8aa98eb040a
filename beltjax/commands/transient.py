"""Declares `beltjax transient`; its work is in `reports/transient.py`."""

from typing import TYPE_CHECKING

import click

from beltjax.commands.registry import (
    belt_damping_option,
    command,
    crank_option,
    duty_option,
    figure_option,
    functions_option,
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
    from beltjax.commands.reports.transient import TransientDocument

    return TransientDocument


@command(_document)
@click.argument("drive_file", metavar="DRIVE.toml")
@click.option("--duration", metavar="TIME", help="Move the drive for so long (s).")
@click.option(
    "--runup",
    metavar="FROM:TO:TIME",
    help="Run the driver up, or down, from one speed to another in this time.",
)
@click.option(
    "--profile",
    metavar="FILE.csv",
    help="Run the driver at the speeds of a table over time, joined by lines.",
)
@click.option(
    "--crank-signal",
    metavar="FILE.csv",
    help="Turn the driver by the angles, or at the speeds, of a table over time, joined smoothly.",
)
@crank_option
@torque_option
@order_option
@orders_option
@modal_damping_option
@belt_damping_option
@functions_option(12)
@duty_option
@json_option
@click.option("--netcdf", metavar="FILE.nc", help="Write the motion over time, with units.")
@figure_option
@si_option
def transient(
    drive_file: str,
    duration: str | None,
    runup: str | None,
    profile: str | None,
    crank_signal: str | None,
    crank: str | None,
    torque: tuple[str, ...],
    order: float | None,
    orders: str | None,
    modal_damping: float | None,
    belt_damping: str | None,
    functions: int,
    duty: str | None,
    json_path: str | None,
    netcdf: str | None,
    figure: str | None,
    si: bool,
) -> None:
    """Motion over time: run-up, coast-down, start and stop, and any motion of the crank.

    For example --runup "600 rpm:6000 rpm:5 s" --crank "0.1 deg" --order 2.
    """

    def work(advance: Advance) -> "Report":
        from beltjax.commands.reports.transient import TransientOptions, transient_report

        given = TransientOptions(
            duration=duration,
            runup=runup,
            profile=profile,
            crank_signal=crank_signal,
            crank=crank,
            torques=torque,
            order=order,
            orders=orders,
            modal_damping=modal_damping,
            functions=functions,
            duty=duty,
            belt_damping=belt_damping,
        )
        return transient_report(drive_file, given, (netcdf, figure), advance, si)

    answer(work, read=drive_file, json=json_path, written=(netcdf,), pictures=(figure,))
