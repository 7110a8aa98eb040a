"""Readable tables of results, for a terminal or a file."""

import csv
import io
from collections.abc import Iterable, Iterator

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text


def plain_table(title: str, *columns: str) -> Table:
    """A table whose first column is words and the others numbers."""
    table = Table(title=title, title_justify="left", title_style="bold", box=None, padding=(0, 2))
    for i, column in enumerate(columns):
        table.add_column(column, justify="left" if i == 0 else "right", no_wrap=True)
    return table


def largest_changes(parts: Iterable[tuple[str, float, float]]) -> list[tuple[str, float, float]]:
    """Name, change per 1 % of the size, and slope of each number; the largest change first."""
    rows = [(name, 0.01 * size * slope, slope) for name, size, slope in parts if size and slope]
    return sorted(rows, key=lambda row: -abs(row[1]))


def number(value: float | None, digits: int) -> str:
    """`value` with fixed digits, or a dash."""
    return "-" if value is None else f"{value:.{digits}f}"


def csv_bytes(shown: RenderableType) -> bytes:
    """All tables of an answer as comma-separated values, an empty line between two of them.

    Before the heads of a table stands its title, where it has one. Numbers are as they are shown.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    for k, table in enumerate(_tables_in(shown)):
        if k:
            writer.writerow([])
        if table.title:
            writer.writerow([_plain(table.title)])
        writer.writerow([_plain(column.header) for column in table.columns])
        columns = ([_plain(cell) for cell in column.cells] for column in table.columns)
        writer.writerows(zip(*columns, strict=True))
    return out.getvalue().encode()


def _tables_in(shown: RenderableType) -> Iterator[Table]:
    if isinstance(shown, Table):
        yield shown
    elif isinstance(shown, Group):
        for part in shown.renderables:
            yield from _tables_in(part)


def _plain(cell: RenderableType) -> str:
    return Text.from_markup(cell).plain if isinstance(cell, str) else str(cell)
