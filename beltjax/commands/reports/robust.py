"""The work of `beltjax robust`: it reads tolerances and scatters a drive by them."""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

from rich.console import Group
from rich.markup import escape
from rich.table import Table

from beltjax import optimize
from beltjax.commands.reports.arguments import read_named, read_option, read_size
from beltjax.commands.reports.documents import (
    Document,
    Part,
    meaning,
    model_flags,
)
from beltjax.commands.reports.report import Report
from beltjax.commands.reports.tables import plain_table
from beltjax.commands.reports.units import TableUnits
from beltjax.commands.reports.warnings import drive_warnings, warning_lines
from beltjax.drive.files import load_drive
from beltjax.drive.numbers import require_numbers, unit_of
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError


class IndexPart(Part):
    """Sobol indices of one tolerance."""

    first: float
    total: float


class SpreadPart(Part):
    """The scatter of a quantity, SI."""

    name: str
    unit: str
    nominal: float
    mean: float
    deviation: float = meaning("standard")
    low: float = meaning("below it lies 1 - quantile")
    high: float = meaning("above it lies 1 - quantile")
    linear_deviation: float = meaning("by exact slopes")
    shares: dict[str, float] = meaning("of the variance by slopes, by tolerance")
    indices: dict[str, IndexPart] = meaning("only with --indices", default={})


class RobustDocument(Document):
    """`beltjax robust`."""

    drive: str
    success: bool
    samples: int
    failed: int = meaning("samples in which no such drive runs; left out")
    quantile: float
    quantities: list[SpreadPart]


class RobustOptions(NamedTuple):
    """The options of `beltjax robust`, as text where they carry units."""

    within: Sequence[str]
    deviation: Sequence[str]
    quantities: Sequence[str]
    samples: int
    seed: int
    quantile: float
    indices: bool


def robust_report(path: str, given: RobustOptions, si: bool = False) -> Report:
    """Scatter the drive of a file. Raises `FileError` for options that cannot be used."""
    drive, point = load_drive(path)
    kinds = _tolerances(drive, given)
    options = {"samples": given.samples, "seed": given.seed, "quantile": given.quantile}
    try:
        found = optimize.robustness(drive, point, given.quantities, kinds, **options)
        indices = None
        if given.indices:
            indices = optimize.sensitivity_indices(
                drive, point, given.quantities, kinds, seed=given.seed
            )
    except ValueError as error:
        raise FileError(path, "", str(error).rstrip(".")) from error
    document = _document(drive, found, indices) | {
        "model": model_flags(drive),
        "warnings": drive_warnings(drive, point),
    }
    return Report(document, _tables(document, TableUnits(drive, si)), "")


def _tolerances(
    drive: Drive, given: RobustOptions
) -> dict[str, optimize.Normal | optimize.Uniform]:
    """`Uniform` for each --within and `Normal` for each --deviation, by the number's key."""
    kinds: dict[str, optimize.Normal | optimize.Uniform] = {}
    for option, texts, kind in (
        ("--within", given.within, optimize.Uniform),
        ("--deviation", given.deviation, optimize.Normal),
    ):
        for text in texts:
            name, size = read_option(option, functools.partial(read_named, text, "NAME=SIZE"))
            read_option(option, functools.partial(require_numbers, drive, [*kinds, name]))
            kinds[name] = kind(
                read_option(
                    f"{option} {name}", functools.partial(read_size, size, unit_of(drive, name))
                )
            )
    if not kinds:
        raise FileError("--within", "", "is missing; give at least one tolerance, NAME=SIZE")
    return kinds


def _document(
    drive: Drive, found: optimize.Robustness, indices: dict[str, optimize.Indices] | None
) -> dict[str, Any]:
    quantities = []
    for name, spread in found.spreads.items():
        row = {"name": name} | spread._asdict()
        if indices is not None:
            values = zip(spread.shares, indices[name].first, indices[name].total, strict=True)
            row["indices"] = {
                number: {"first": float(first), "total": float(total)}
                for number, first, total in values
            }
        quantities.append(row)
    return {
        "drive": drive.name,
        "success": True,
        "samples": found.samples,
        "failed": found.failed,
        "quantile": found.quantile,
        "quantities": quantities,
    }


def _tables(document: dict[str, Any], units: TableUnits) -> Group:
    percent = 100 * document["quantile"]
    table = plain_table(
        escape(f"{document['drive']}: {document['samples']:,} drives within the tolerances"),
        "quantity",
        "nominal",
        "mean",
        "deviation",
        "by slopes",
        f"{100 - percent:g} %",
        f"{percent:g} %",
        "unit",
    )
    keys = "nominal", "mean", "deviation", "linear_deviation", "low", "high"
    for row in document["quantities"]:
        factor, unit = units.of_quantity(1.0, row["unit"])
        values = (f"{factor * row[key]:.5g}" for key in keys)
        table.add_row(escape(row["name"]), *values, unit)
    parts = [*warning_lines(document), table, _share_table(document)]
    if document["failed"]:
        parts.append(f"{document['failed']} of the drives do not run and are left out")
    return Group(*parts)


def _share_table(document: dict[str, Any]) -> Table:
    """The table of the shares that each tolerance has in each variance."""
    rows = document["quantities"]
    sampled = "indices" in rows[0]
    title = "Share of the variance" + (", interactions included" if sampled else ", by slopes")
    table = plain_table(title, "tolerance", *(row["name"] for row in rows))
    for number in rows[0]["shares"]:
        shares = [
            row["indices"][number]["total"] if sampled else row["shares"][number] for row in rows
        ]
        table.add_row(escape(number), *(f"{share:.4f}" for share in shares))
    return table
