"""Listings of what is registered: quantities and optimizers, for a terminal and for the docs."""

import inspect

from rich.markup import escape
from rich.table import Table

from beltjax import optimize
from beltjax.commands.reports.tables import plain_table


def quantity_rows() -> list[tuple[str, str, str, str]]:
    """Pattern of the name, SI unit, meaning and need of every registered quantity."""
    return [
        (one.pattern, one.unit, one.meaning.rstrip("."), one.needs)
        for one in optimize.quantity_definitions()
    ]


def quantity_listing() -> Table:
    """All quantities, for a terminal."""
    table = plain_table("Quantities (SI, rad)", "name", "unit", "is", "needs")
    for column in table.columns:
        column.justify = "left"
    table.columns[2].no_wrap = False
    for row in quantity_rows():
        table.add_row(*map(escape, row))
    return table


def optimizer_listing() -> Table:
    """All optimizers, for a terminal."""
    table = plain_table("Optimizers", "name", "is")
    table.columns[1].justify = "left"
    for name in optimize.optimizer_names():
        meaning = inspect.getdoc(type(optimize.find_optimizer(name))) or ""
        table.add_row(escape(name), escape(meaning.split("\n")[0].rstrip(".")))
    return table


def quantity_page() -> str:
    """The table of docs/optimizing.md."""
    rows = "\n".join(
        f"| `{name}` | {unit} | {meaning} | {needs} |"
        for name, unit, meaning, needs in quantity_rows()
    )
    return f"| name | unit | is | needs |\n|---|---|---|---|\n{rows}\n"
