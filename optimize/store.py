"""Answers to many designs in a Zarr store that survives its writer.

A batch of designs is one chunk of every array. Its data are written first, then its mark in the
array "done", each file in one move: whenever the writer is killed, what is marked is whole, and
what is not marked is done again.
"""

import contextlib
import importlib
import json
import os
import shutil
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from beltjax.errors import FileError
from beltjax.results import outcomes

from .batches import FREQUENCY, RESULT, Columns

if TYPE_CHECKING:
    import xarray

DONE = "done"
_RECORD = "exploration"  # attribute of the store: what was asked, to be compared on resuming
_NOT_YET = -1  # in place of a result's code


class Column(NamedTuple):
    """One array of the store: its name, SI unit and number of parts (None: a plain number)."""

    name: str
    unit: str
    parts: int | None = None


class Store:
    """The answers to `total` designs in batches of `size`, at a path.

    `record` says in plain data what was asked; a store that holds another one is refused.
    Raises `FileError` for that, for a path that holds something else, lies in no folder or is
    written by another process, and where the file system fails, with what is left intact.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        record: Mapping[str, Any],
        columns: list[Column],
        total: int,
        size: int,
    ):
        self.path, self.total, self.size = Path(path), total, size
        self._zarr = _library("zarr", "explore")
        record = json.loads(json.dumps(record))
        if not self.path.exists():
            if not self.path.absolute().parent.is_dir():
                raise FileError(path, "", "lies in no folder; give a path in one that exists")
            with self._saving("the store was begun"):
                self._create(record, columns)
        self._group = self._opened()
        self._require_same(record)
        self._lock = self._locked()
        with self._saving("the store was read"):
            self.done = np.asarray(self._group[DONE][:]) != 0
            for torn in self.path.rglob("*.partial"):  # of a writer that was killed
                torn.unlink()

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._lock)

    def pending(self) -> list[int]:
        """Numbers of the batches that are still to be done."""
        return np.flatnonzero(~self.done).tolist()

    def span(self, batch: int) -> tuple[int, int]:
        """The designs of a batch, the end excluded."""
        return batch * self.size, min((batch + 1) * self.size, self.total)

    @property
    def designs_done(self) -> int:
        """Number of designs that are safe."""
        spans = (self.span(batch) for batch in np.flatnonzero(self.done).tolist())
        return sum(stop - start for start, stop in spans)

    def write(self, batch: int, columns: Columns) -> None:
        """Put one batch into the store, and mark it when all of it is there."""
        with self._saving(f"batch {batch + 1} of {len(self.done)} was written"):
            at = slice(*self.span(batch))
            for name, values in columns.items():
                self._group[array_name(name)][at] = values
            self._group[DONE][batch] = 1
        self.done[batch] = True

    def _create(self, record: Mapping[str, Any], columns: list[Column]) -> None:
        """Begin the store under another name, so that it is complete or absent."""
        target = self.path.resolve()
        new = target.with_name(f".{target.name}.new")
        shutil.rmtree(new, ignore_errors=True)
        try:
            group = self._zarr.open_group(new, mode="w", zarr_format=3)
            group.attrs[_RECORD] = record
            for column in columns:
                self._add(group, column)
            names = outcomes()
            flags = {
                "long_name": "how each design ended",
                "flag_values": [_NOT_YET, *(number for number, _ in names.values())],
                "flag_meanings": " ".join(["not_computed_yet", *names]),
                "texts": ["", *(text for _, text in names.values())],
            }
            self._array(group, RESULT, "int16", _NOT_YET, ("design",), (self.total,), flags)
            batches = -(-self.total // self.size)
            self._array(group, DONE, "uint8", 0, ("batch",), (batches,), {}, (1,))
            with warnings.catch_warnings():  # that consolidation is not yet part of version 3
                warnings.simplefilter("ignore")
                self._zarr.consolidate_metadata(group.store)
            os.rename(new, target)
        except BaseException:
            shutil.rmtree(new, ignore_errors=True)
            raise

    def _add(self, group: Any, column: Column) -> None:
        notes = {"long_name": column.name, "units": column.unit or "1"}
        axes, shape = ("design",), (self.total,)
        if column.parts is not None:
            part = "mode" if column.name == FREQUENCY else f"part of {column.name}"
            axes, shape = (*axes, part), (*shape, column.parts)
        self._array(group, array_name(column.name), "float64", np.nan, axes, shape, notes)

    def _array(self, group, name, kind, blank, axes, shape, notes, chunks=None) -> None:
        group.create_array(
            name,
            shape=shape,
            chunks=chunks or (self.size, *shape[1:]),
            dtype=kind,
            fill_value=blank,
            dimension_names=axes,
            attributes=notes,
        )

    def _opened(self) -> Any:
        try:
            group = self._zarr.open_group(self.path, mode="r+", use_consolidated=False)
            group.attrs[_RECORD]
        except (OSError, ValueError, KeyError) as error:
            message = "is there already and is no exploration; give another path"
            raise FileError(self.path, "", message) from error
        return group

    def _locked(self) -> int:
        """A hold on the store that ends with this process, however it ends."""
        hold = os.open(self.path / "zarr.json", os.O_RDONLY)
        try:
            locks = importlib.import_module("fcntl")
            locks.flock(hold, locks.LOCK_EX | locks.LOCK_NB)
        except BlockingIOError as error:
            os.close(hold)
            message = "another process is writing it; wait for it, or give another path"
            raise FileError(self.path, "", message) from error
        except (ImportError, OSError):
            pass  # a system or a file system without such locks
        return hold

    def _require_same(self, record: Mapping[str, Any]) -> None:
        differs = _difference(self._group.attrs[_RECORD], record)
        if differs:
            key, before, now = differs
            message = f"was begun with {before} and is now asked for {now}"
            remedy = "repeat the command that began it, or give another path"
            raise FileError(self.path, key, f"{message}; {remedy}")

    @contextlib.contextmanager
    def _saving(self, doing: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            why = f"the file system failed when {doing} ({error.strerror or error})"
            batches = getattr(self, DONE, np.zeros(0))
            if batches.any():
                kept = f"{batches.sum()} batches ({self.designs_done} designs) are intact"
                why += f"; {kept}: make room and repeat the command to go on"
            raise FileError(self.path, "", why) from error


def open_exploration(path: str | os.PathLike[str]) -> "xarray.Dataset":
    """A store of `explore` as a dataset that reads what is looked at, numbers as coordinates."""
    found = _library("xarray", "explore").open_zarr(path, chunks=None)
    design = found.attrs[_RECORD]["designs"]
    names = design.get("grid") or design["sobol"]
    return found.set_coords([array_name(name) for name in names])


def array_name(name: str) -> str:
    """`name`, which may be any pulley's, as the name of a file."""
    return name.replace("%", "%25").replace("/", "%2F")


def _library(name: str, extra: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ValueError(f"{name} is not installed: pip install 'beltjax[{extra}]'") from error


def _difference(before: Any, now: Any, key: str = "") -> tuple[str, str, str] | None:
    """Key and values of the first place where two records differ."""
    if before == now:
        return None
    if isinstance(before, dict) and isinstance(now, dict):
        both = (*before, *(name for name in now if name not in before))
        name = next(name for name in both if before.get(name) != now.get(name))
        return _difference(before.get(name), now.get(name), f"{key}.{name}".lstrip("."))
    return key, _short(before), _short(now)


def _short(value: Any) -> str:
    if value is None:
        return "nothing"
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."
