"""Declares `beltjax explore`; its work is in `reports/explore.py`."""

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
    from beltjax.commands.reports.explore import ExploreDocument

    return ExploreDocument


@command(_document)
@click.argument("drive_file", metavar="DRIVE.toml")
@click.option(
    "--over",
    required=True,
    multiple=True,
    metavar="NAME=FROM:TO:POINTS",
    help="Vary this number over a range; NAME=FROM:TO with --samples. Give one for each number.",
)
@click.option(
    "--samples", type=int, metavar="N", help="Draw so many quasi-random designs in place of a grid."
)
@seed_option
@click.option(
    "--out",
    "store",
    required=True,
    metavar="STORE.zarr",
    help="Write this store, or go on with it.",
)
@quantity_option
@quantities_option
@click.option(
    "--modes", default=0, show_default=True, help="Find so many of the lowest frequencies."
)
@click.option("--batch", type=int, metavar="N", help="Compute and write so many designs at once.")
@click.option(
    "--workers",
    type=int,
    metavar="N",
    help="Use so many processes on this machine, by Dask; for modes of many designs one for each "
    "core unless given.",
)
@click.option("--scheduler", metavar="ADDRESS", help="Use the Dask cluster at tcp://HOST:PORT.")
@json_option
@si_option
def explore(
    drive_file: str,
    quantity: tuple[str, ...],
    json_path: str | None,
    store: str,
    si: bool,
    **given: Any,
) -> None:
    """Quantities and modes of many designs over any numbers of the drive file.

    Written batch by batch to a Zarr store. Killed or interrupted, the same command goes on.
    """

    def work(advance: Advance) -> "Report":
        from beltjax.commands.reports.explore import ExploreOptions, explore_report

        return explore_report(
            drive_file,
            ExploreOptions(quantities=quantity or ("coupling",), store=store, **given),
            advance,
            si,
        )

    answer(work, read=drive_file, json=json_path, resumed=store)
