"""Declares `beltjax periodic`; its work is in `reports/periodic.py`."""

from typing import TYPE_CHECKING, Literal

import click

from beltjax.commands.registry import (
    belt_damping_option,
    command,
    crank_option,
    driver_option,
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
    from beltjax.commands.reports.periodic import PeriodicDocument

    return PeriodicDocument


@command(_document)
@click.argument("drive_file", metavar="DRIVE.toml")
@crank_option
@torque_option
@order_option
@driver_option
@orders_option
@click.option(
    "--speeds",
    metavar="SPEED|FROM:TO[:POINTS]",
    help="Run the driver at this speed, or over this range; as the file says unless given.",
)
@click.option(
    "--branch",
    type=click.Choice(["up", "down"]),
    help="Follow the motion over the range of speeds, from its lower or upper end, through folds.",
)
@modal_damping_option
@belt_damping_option
@click.option(
    "--belt-speed",
    type=click.Choice(["constant", "varying"]),
    default="constant",
    show_default=True,
    help="Let the belts follow the rotation of the driver, or run at its mean speed.",
)
@click.option(
    "--harmonics",
    type=click.IntRange(1),
    default=12,
    show_default=True,
    help="Describe the motion by so many harmonics.",
)
@functions_option(16)
@click.option(
    "--sensitivities/--no-sensitivities",
    default=True,
    show_default=True,
    help="Differentiate the motion at a single speed, for the JSON.",
)
@duty_option
@json_option
@figure_option
@si_option
def periodic(
    drive_file: str,
    crank: str | None,
    torque: tuple[str, ...],
    order: float | None,
    driver: str | None,
    orders: str | None,
    speeds: str | None,
    branch: str | None,
    modal_damping: float | None,
    belt_damping: str | None,
    belt_speed: Literal["constant", "varying"],
    harmonics: int,
    functions: int,
    sensitivities: bool,
    duty: str | None,
    json_path: str | None,
    figure: str | None,
    si: bool,
) -> None:
    """Periodic vibration of finite amplitude: its stability, extremes of tension and motion."""

    def work(advance: Advance) -> "Report":
        from beltjax.commands.reports.periodic import PeriodicOptions, periodic_report

        given = PeriodicOptions(
            crank=crank,
            torques=torque,
            order=order,
            orders=orders,
            speeds=speeds,
            modal_damping=modal_damping,
            harmonics=harmonics,
            functions=functions,
            duty=duty,
            branch=branch,
            belt_speed=belt_speed,
            driver=driver,
            belt_damping=belt_damping,
            slopes=sensitivities and json_path is not None,
            document=json_path is not None,
        )
        return periodic_report(drive_file, given, figure, advance, si)

    answer(work, read=drive_file, json=json_path, pictures=(figure,))
