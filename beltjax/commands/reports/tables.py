"""Readable tables of results, for a terminal or a file."""

from collections.abc import Iterable

from rich.table import Table


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
