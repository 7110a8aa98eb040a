"""Declares `beltjax contact`; its work is in `reports/contact.py`."""

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
    from beltjax.commands.reports.contact import ContactDocument

    return ContactDocument


@command(_document)
@click.argument("drive_file", metavar="DRIVE.toml")
@click.option("--maximum", is_flag=True, help="Raise all torques until a pulley slips fully.")
@click.option(
    "--law",
    metavar="NAME",
    default="kong",
    show_default=True,
    help="Take this belt law; 'hyperelastic' conserves energy.",
)
@click.option(
    "--limit",
    type=click.Choice(["slip", "adhesion"]),
    help="Of a belt in grooves, with --maximum: which limit is meant (slip unless given).",
)
@duty_option
@json_option
@figure_option
@click.option(
    "--compare", metavar="FILE.png", help="Draw the spans beside those of fixed contact points."
)
@si_option
def contact(
    drive_file: str,
    maximum: bool,
    law: str,
    limit: str | None,
    duty: str | None,
    json_path: str | None,
    figure: str | None,
    compare: str | None,
    si: bool,
) -> None:
    """Where the belt touches, adheres and slips; tensions, speeds, efficiency."""

    def work(advance: Advance) -> "Report":
        from beltjax.commands.reports.contact import contact_report

        return contact_report(drive_file, maximum, law, (figure, compare), si, duty, limit)

    answer(
        work, read=drive_file, json=json_path, pictures=(figure, compare), busy="solving contact"
    )
