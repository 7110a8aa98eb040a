"""Readable tables of results, for a terminal or a file."""

import csv
import io
import re
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from beltjax.commands.reports.units import TableUnits
from beltjax.drive.installation import BELT_LENGTH

_NUMBER = re.compile(r"[-+]?[0-9]+(?:\.[0-9]+)?(?:e[-+][0-9]+)?")


def plain_table(title: str, *columns: str) -> Table:
    """A table whose first column is words and the others numbers."""
    table = Table(title=title, title_justify="left", title_style="bold", box=None, padding=(0, 2))
    for i, column in enumerate(columns):
        table.add_column(column, justify="left" if i == 0 else "right", no_wrap=True)
    return table


def quantity_table(rows: Iterable[tuple[str, Any, int, str]], units: TableUnits) -> Table:
    """Quantities of a whole drive: label, value in SI, digits and SI unit of each."""
    table = plain_table("", "quantity", "value", "unit")
    for label, value, digits, unit in rows:
        kind = BELT_LENGTH if unit == "m" else ""
        table.add_row(label, units.text(value, unit, digits, kind), units.name(unit, kind))
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
    for k, table in enumerate(plain_tables(shown)):
        if k:
            writer.writerow([])
        if table.title:
            writer.writerow([table.title])
        writer.writerow(table.heads)
        writer.writerows(table.rows)
    return out.getvalue().encode()


def xlsx_bytes(shown: RenderableType) -> bytes:
    """All tables of an answer as a workbook, each on a sheet of its own.

    Numbers are as they are shown, with as many decimals, but are numbers to the spreadsheet.

    Raises `ModuleNotFoundError` where openpyxl is not installed.
    """
    from openpyxl import Workbook

    book = Workbook()
    book.remove(book.worksheets[0])
    for k, table in enumerate(plain_tables(shown), start=1):
        title = re.sub(r"[\[\]:*?/\\']", " ", table.title or table.heads[0])
        # Excel's sheets have names of at most 31 characters, each of its own.
        sheet = book.create_sheet(f"{k} {title}"[:31])
        for i, row in enumerate([table.heads, *table.rows], start=1):
            for j, text in enumerate(row, start=1):
                is_number = i > 1 and not table.are_words[j - 1] and _NUMBER.fullmatch(text)
                _write_cell(sheet.cell(i, j), text, bool(is_number), head=i == 1)
        for column in sheet.columns:
            width = max(len(str(cell.value or "")) for cell in column)
            sheet.column_dimensions[column[0].column_letter].width = width + 2
        sheet.freeze_panes = "B2"
    if not book.worksheets:
        book.create_sheet("empty")  # a workbook without sheets cannot be written
    out = io.BytesIO()
    book.save(out)
    return out.getvalue()


def _write_cell(cell: Any, text: str, is_number: bool, head: bool) -> None:
    from openpyxl.styles import Font

    if is_number:
        cell.value = float(text)
        decimals = len(text.partition(".")[2])
        scientific = "e" in text
        cell.number_format = "0.000E+00" if scientific else f"0.{'0' * decimals}".rstrip(".")
    else:
        cell.value = text or None
        cell.data_type = "s" if text else "n"  # "=1" is text, not a formula
    if head:
        cell.font = Font(bold=True)


def width_of(shown: RenderableType) -> int:
    """Characters in which every table is shown whole, and lines of text are read well."""
    room = Console(width=10_000)
    return max([120, *(room.measure(table).maximum for table in _tables_in(shown))])


class PlainTable(NamedTuple):
    """A table as text: what it is called, the heads of its columns, and its cells."""

    title: str  # empty where it has none
    heads: list[str]
    rows: list[list[str]]
    are_words: list[bool]  # of each column, or numbers

    @property
    def width(self) -> int:
        """Characters of its columns beside each other, with gaps between them."""
        columns = zip(self.heads, *self.rows, strict=True)
        return sum(2 + max(map(len, column)) for column in columns)


def plain_tables(shown: RenderableType) -> Iterator[PlainTable]:
    """The tables of an answer as text."""
    for table in _tables_in(shown):
        columns = ([_plain(cell) for cell in column.cells] for column in table.columns)
        yield PlainTable(
            title=_plain(table.title or ""),
            heads=[_plain(column.header) for column in table.columns],
            rows=[list(row) for row in zip(*columns, strict=True)],
            are_words=[column.justify == "left" for column in table.columns],
        )


def _tables_in(shown: RenderableType) -> Iterator[Table]:
    if isinstance(shown, Table):
        yield shown
    elif isinstance(shown, Group):
        for part in shown.renderables:
            yield from _tables_in(part)


def _plain(cell: RenderableType) -> str:
    return Text.from_markup(cell).plain if isinstance(cell, str) else str(cell)
