"""What the benchmarks share: timing and the table they print."""

import os
import resource
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
from rich.console import Console
from rich.table import Table

import beltjax as bj

REPEATS = 7


class Row(NamedTuple):
    """One way to an answer; what does not apply is None."""

    way: str
    batch: int
    error: float | None
    slope_error: float | None
    compile: float | None  # [s]
    run: float  # [s] for one of the batch


def best_time(function, *arguments):
    """Shortest of several runs [s]; the machine's other work only ever adds."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        jax.block_until_ready(function(*arguments))
        times.append(time.perf_counter() - start)
    return min(times)


def compiled(function, *arguments):
    """A function compiled for large batches, and how long tracing and compiling took [s]."""
    start = time.perf_counter()
    result = bj.thorough_jit(function).lower(*arguments).compile()
    return result, time.perf_counter() - start


def resident_memory() -> float:
    """What this process holds [MiB] (Linux)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def show(title: str, one: str, rows: list[Row]) -> None:
    """Print the rows; the last is the peer that all are compared with. `one` of the batch."""
    columns = ("way", "batch", "error", "slope error", "compile (s)", f"run (us/{one})")
    found = []
    for row in rows:
        wrong = ["-" if x is None else f"{float(x):.1e}" for x in (row.error, row.slope_error)]
        wait = "-" if row.compile is None else f"{row.compile:.1f}"
        ratio = f"{rows[-1].run / row.run:,.0f}"
        found.append((row.way, f"{row.batch}", *wrong, wait, f"{1e6 * row.run:.3g}", ratio))
    cores = len(os.sched_getaffinity(0))
    title = f"{title}, {cores} cores, {jax.default_backend()}"
    print_table(title, (*columns, "peer over this"), found)


def print_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print rows of text; the first column is what the row is of."""
    table = Table(title=title, box=None)
    for place, column in enumerate(columns):
        table.add_column(column, justify="right" if place else "left", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    console = Console()
    console.width = max(console.width, 120)
    console.print(table)
