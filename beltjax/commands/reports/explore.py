"""The work of `beltjax explore`: it reads ranges, fills a store and sums it up."""

import functools
import importlib.util
import os
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from datetime import timedelta
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from rich.console import Group
from rich.markup import escape

from beltjax import optimize
from beltjax.commands.reports.arguments import read_interval, read_named, read_option, read_range
from beltjax.commands.reports.documents import (
    Document,
    Maybe,
    Part,
    meaning,
    model_flags,
    plain,
)
from beltjax.commands.reports.report import Report
from beltjax.commands.reports.tables import plain_table
from beltjax.commands.reports.units import TableUnits
from beltjax.commands.reports.warnings import drive_warnings, warning_lines
from beltjax.commands.running import Advance
from beltjax.compiling.kept_programs import only_own_code
from beltjax.drive.files import load_drive
from beltjax.drive.numbers import require_numbers, shift_of, unit_of
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError

_SLICE = 65_536  # designs of a store read at once
# With modes a design takes some 10 ms, and each process as many seconds to begin and compile.
_WORTH_PROCESSES = 2000
_MOST_PROCESSES = 8  # each holds about half a gigabyte


class ExtremePart(Part):
    """An extreme and the design that has it."""

    value: Maybe
    at: dict[str, float]


class QuantityPart(Part):
    """A quantity over all designs."""

    name: str
    unit: str
    found: int = meaning("designs that have it")
    least: ExtremePart | None
    mean: Maybe = meaning("null for a quantity of parts")
    greatest: ExtremePart | None


class EndingPart(Part):
    """The number of designs that ended in one way."""

    result: str = meaning("a member of `bj.RESULTS`")
    designs: int
    text: str


class ExploreDocument(Document):
    """`beltjax explore`."""

    drive: str
    store: str = meaning("folder of the Zarr store")
    designs: int
    designs_before: int = meaning("that the store held already")
    repaired: list[str] = meaning("damage that was mended")
    seconds: float
    quantities: list[QuantityPart]
    outcomes: list[EndingPart] = meaning("the most frequent first")
    success: bool = meaning("whether any design succeeded")


class ExploreOptions(NamedTuple):
    """The options of `beltjax explore`, as text where they carry units."""

    over: Sequence[str]
    samples: int | None  # None: every combination of the points
    seed: int
    quantities: Sequence[str]
    modes: int
    batch: int | None
    workers: int | None
    scheduler: str | None
    store: str


def explore_report(path: str, given: ExploreOptions, advance: Advance, si: bool = False) -> Report:
    """Explore the designs of a drive file. Raises `FileError` for options that cannot be used."""
    if given.workers is not None and given.scheduler:
        raise FileError("--workers", "", "a scheduler has its own workers; leave out one of both")
    drive, point = load_drive(path)
    designs = _designs(drive, given)
    began, pace = time.monotonic(), _Pace(advance)
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", optimize.DamageWarning)
            data = optimize.explore(
                drive,
                point,
                designs,
                given.quantities,
                given.store,
                modes=given.modes,
                batch=given.batch,
                workers=_workers(given, designs.total),
                scheduler=given.scheduler,
                advance=pace,
            )
    except FileError:
        raise
    except ValueError as error:
        raise FileError("explore", "", str(error).rstrip(".")) from error
    wanted = [*given.quantities, *["frequency"] * bool(given.modes)]
    try:
        summary = _summary(data, designs.names, wanted)
    except (OSError, ValueError) as error:  # a checksum, or the file system
        message = f"was damaged while it was read ({error}); repeat the command to mend it"
        raise FileError(given.store, "", message) from error
    document = {
        "drive": drive.name,
        "model": model_flags(drive),
        "warnings": drive_warnings(drive, point),
        "store": str(Path(given.store)),
        "designs": designs.total,
        "designs_before": pace.before,
        "repaired": [str(w.message) for w in caught if w.category is optimize.DamageWarning],
        "seconds": time.monotonic() - began,
        **summary,
    }
    document["success"] = any(row["result"] == "successful" for row in document["outcomes"])
    failure = ""
    if not document["success"]:
        text = document["outcomes"][0]["text"]
        failure = str(FileError(path, "", f"no design succeeded: {text}"))
    tables = _tables(document, TableUnits(drive, si))
    return Report(document, Group(*warning_lines(document), tables), failure)


def _workers(given: ExploreOptions, total: int) -> int | None:
    """The processes that compute; None: this one does.

    XLA shares formulas between the cores by itself, but solves eigenproblems one after the other on
    one core. Where modes of many designs are asked each core has a process, unless the user has
    said otherwise or has added code, which other processes do not have.
    """
    chosen = given.workers is not None or given.scheduler
    if chosen or not given.modes or total < _WORTH_PROCESSES or not only_own_code():
        return given.workers
    several = jax.default_backend() == "cpu" and jax.local_device_count() == 1
    present = importlib.util.find_spec("distributed") is not None
    cores = min(available_cores(), _MOST_PROCESSES)
    return cores if several and present and cores > 1 else None


def available_cores() -> int:
    """The processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class _Pace:
    """Adds the rate and the time that is left to each report of progress."""

    def __init__(self, advance: Advance):
        self.before = 0  # designs that an earlier run has left
        self._advance, self._began = advance, (0, 0.0)

    def __call__(self, stage: str, done: int, total: int | None) -> None:
        now = time.monotonic()
        if stage == "compiling":
            self.before = done
        elif not self._began[1]:  # the first batch waits for the compiler
            self._began = done, now
        elif done > self._began[0] and total is not None:
            rate = (done - self._began[0]) / (now - self._began[1])
            left = timedelta(seconds=round((total - done) / rate))
            stage = f"{stage}: {done:,} of {total:,}, {rate:,.0f} designs/s, {left} left"
        self._advance(stage, done, total)


def _designs(drive: Drive, given: ExploreOptions) -> optimize.Grid | optimize.Samples:
    """The `Grid` or `Samples` that the options describe."""
    shape = "NAME=FROM:TO:POINTS" if given.samples is None else "NAME=FROM:TO"
    pairs = [
        read_option("--over", lambda text=text: read_named(text, shape)) for text in given.over
    ]
    read_option("--over", lambda: require_numbers(drive, [name for name, _ in pairs]))
    read = read_range if given.samples is None else read_interval
    ranges = {}
    for name, text in pairs:
        reading = functools.partial(read, text, unit_of(drive, name))
        found = np.asarray(read_option(f"--over {name}", reading)) - shift_of(drive, name)
        ranges[name] = found if given.samples is None else tuple(found.tolist())
    if given.samples is None:
        return read_option("--over", lambda: optimize.Grid(ranges))
    count = given.samples
    return read_option("--samples", lambda: optimize.Samples(ranges, count, given.seed))


def _summary(data: Any, names: Sequence[str], quantities: Sequence[str]) -> dict[str, Any]:
    """Extremes and means of each quantity, and how the designs ended; a slice at a time."""
    rows = {label: _Extremes(unit) for _, label, unit, _ in _columns(data, 0, quantities)}
    counts: dict[int, int] = {}
    for start in range(0, data.sizes["design"], _SLICE):
        for _, label, _, values in _columns(data, start, quantities):
            rows[label].take(start, values)
        found = np.unique(data.result[start : start + _SLICE].values, return_counts=True)
        for code, count in zip(*(part.tolist() for part in found), strict=True):
            counts[code] = counts.get(code, 0) + count

    def numbers(at: int) -> dict[str, float]:
        return {name: float(data[optimize.array_name(name)][at]) for name in names}

    return {
        "quantities": [
            {"name": label, "unit": row.unit, **row.document(numbers)}
            for label, row in rows.items()
        ],
        "outcomes": _outcomes(data.result.attrs, counts),
    }


def _columns(
    data: Any, start: int, quantities: Sequence[str]
) -> Iterator[tuple[str, str, str, np.ndarray]]:
    """Array, label, unit and values [designs, parts] of a slice; one mode is one column."""
    for name in quantities:
        array = data[optimize.array_name(name)]
        values = array[start : start + _SLICE].values
        values, unit = values.reshape(len(values), -1), array.attrs["units"]
        if name == "frequency":
            for k, column in enumerate(values.T / (2 * np.pi)):
                yield name, f"frequency {k + 1}", "Hz", column[:, None]
        else:
            yield name, name, "" if unit == "1" else unit, values


class _Extremes:
    """Least and greatest of a quantity, where they are, and its mean."""

    def __init__(self, unit: str):
        self.unit, self._found, self._sum = unit, 0, 0.0  # the sum is nan for quantities of parts
        self._least, self._greatest = (np.inf, 0), (-np.inf, 0)

    def take(self, start: int, values: np.ndarray) -> None:
        """Take in the values [designs, parts] of designs from `start` on."""
        found = np.flatnonzero(np.isfinite(values).all(axis=1))
        if not len(found):
            return
        low, high = values[found].min(axis=1), values[found].max(axis=1)
        self._found += len(found)
        self._sum += float(low.sum()) if values.shape[1] == 1 else np.nan
        self._least = min(self._least, (float(low.min()), start + int(found[low.argmin()])))
        highest = float(high.max()), start + int(found[high.argmax()])
        self._greatest = max(self._greatest, highest)

    def document(self, numbers: Callable[[int], dict[str, float]]) -> dict[str, Any]:
        if not self._found:
            return {"found": 0, "least": None, "mean": None, "greatest": None}
        ends = {"least": self._least, "greatest": self._greatest}
        places = {
            key: {"value": plain(value), "at": numbers(at)} for key, (value, at) in ends.items()
        }
        return {"found": self._found, **places, "mean": plain(self._sum / self._found)}


def _outcomes(flags: dict[str, Any], counts: dict[int, int]) -> list[dict[str, Any]]:
    """Count the designs by the way in which they ended, the most frequent first."""
    meanings = zip(flags["flag_values"], flags["flag_meanings"].split(), strict=True)
    texts = dict(zip(flags["flag_values"], flags["texts"], strict=True))
    names = {value: name for value, name in meanings}
    rows = [
        {"result": names[code], "designs": count, "text": texts[code]}
        for code, count in counts.items()
    ]
    return sorted(rows, key=lambda row: -row["designs"])


def _tables(document: dict[str, Any], units: TableUnits) -> Group:
    title = f"{document['drive']}: {document['designs']:,} designs in {document['store']}"
    table = plain_table(escape(title), "quantity", "least", "mean", "greatest", "unit", "found")
    for row in document["quantities"]:
        ends = [row[key] and row[key]["value"] for key in ("least", "greatest")]
        values = [ends[0], row["mean"], ends[1]]
        factor, unit = units.of_quantity(1.0, row["unit"])
        words = ["-" if value is None else f"{factor * value:.5g}" for value in values]
        table.add_row(escape(row["name"]), *words, unit, f"{row['found']:,}")
    ends = plain_table("", "result", "designs")
    for row in document["outcomes"]:
        ends.add_row(row["result"], f"{row['designs']:,}")
    new = document["designs"] - document["designs_before"]
    spent = f"{new:,} designs in {document['seconds']:.1f} s, compiling included"
    if document["designs_before"]:
        spent += f"; {document['designs_before']:,} were there before"
    return Group(table, ends, spent, *map(escape, document["repaired"]))
