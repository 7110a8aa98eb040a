"""Answers to many designs in a Zarr store that survives its writer.

A batch of designs is one chunk of every array. Its data are written first, then its mark in the
array "done", each file in one move: whenever the writer is killed, what is marked is whole, and
what is not marked is done again. The mark is a checksum: what was damaged since is done again, too.
"""

import contextlib
import json
import os
import shutil
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from beltjax.files.errors import FileError
from beltjax.results import outcomes

from .batches import FREQUENCY, RESULT, Columns
from .store_integrity import (
    DONE,
    METADATA,
    QUESTION,
    RECORD,
    Batches,
    attributes,
    damaged_metadata,
    fingerprint,
    numbered,
    read_document,
    read_marks,
    seal,
    sealed_root,
)

if TYPE_CHECKING:
    import xarray

_NOT_YET = -1  # in place of a result's code
_REPEAT = "repeat the command that began it: it mends the store and computes only what is missing"


class DamageWarning(UserWarning):
    """A store was damaged; what was is computed anew."""


class Column(NamedTuple):
    """One array of the store: its name, SI unit and number of parts (None: a plain number)."""

    name: str
    unit: str
    parts: int | None = None


class Store:
    """The answers to `total` designs in batches of `size`, at a path.

    `record` says in plain data which exploration it is; a store that holds another one is refused.
    What an earlier writer left is checked; `damage` says in words what of it was damaged and is
    to be done again, and is empty where nothing was.
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
        self._zarr = _zarr_library()
        record = json.loads(json.dumps(record))
        if not self.path.exists():
            if not self.path.absolute().parent.is_dir():
                raise FileError(path, "", "lies in no folder; give a path in one that exists")
            with self._saving("the store was begun"), self._skeleton(record, columns) as new:
                os.rename(new, self.path.resolve())
        self._lock = self._locked()
        try:
            mended = self._require_same(record)
            with self._saving("the store was read"):
                mended = self._mend(record, columns, mended)
                self._open()
        except BaseException:
            self.__exit__()
            raise
        self.damage = self._damage(mended)

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *_: object) -> None:
        if self._lock is not None:
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
            for path in self._batches.files(batch):
                path.unlink(missing_ok=True)  # Zarr would read what is there to complete it
            # The result comes last: until then a design counts as not computed.
            for name in sorted(columns, key=lambda name: name == RESULT):
                self._group[array_name(name)][at] = columns[name]
            self._group[DONE][batch] = self._batches.mark(batch)
        self.done[batch] = True

    @contextlib.contextmanager
    def _skeleton(self, record: Mapping[str, Any], columns: list[Column]) -> Iterator[Path]:
        """A store without data under another name, beside this one, to be moved into place."""
        target = self.path.resolve()
        new = target.with_name(f".{target.name}.new")
        shutil.rmtree(new, ignore_errors=True)
        try:
            group = self._zarr.open_group(new, mode="w", zarr_format=3)
            group.attrs[RECORD] = record
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
            notes = {"long_name": "checksum of each batch, 0 until it is written"}
            notes[QUESTION] = fingerprint(record)
            batches = -(-self.total // self.size)
            self._array(group, DONE, "uint64", 0, ("batch",), (batches,), notes, (1,))
            with warnings.catch_warnings():  # that consolidation is not yet part of version 3
                warnings.simplefilter("ignore")
                self._zarr.consolidate_metadata(group.store)
            seal(new)
            yield new
        finally:
            shutil.rmtree(new, ignore_errors=True)

    def _add(self, group: Any, column: Column) -> None:
        notes = {"long_name": column.name, "units": column.unit or "1"}
        axes, shape = ("design",), (self.total,)
        if column.parts is not None:
            part = "mode" if column.name == FREQUENCY else f"part of {column.name}"
            axes, shape = (*axes, part), (*shape, column.parts)
        self._array(group, array_name(column.name), "float64", np.nan, axes, shape, notes)

    def _array(
        self,
        group: Any,
        name: str,
        kind: str,
        blank: float,
        axes: tuple[str, ...],
        shape: tuple[int, ...],
        notes: Mapping[str, Any],
        chunks: tuple[int, ...] | None = None,
    ) -> None:
        group.create_array(
            name,
            shape=shape,
            chunks=chunks or (self.size, *shape[1:]),
            dtype=kind,
            fill_value=blank,
            compressors=(self._zarr.codecs.ZstdCodec(), self._zarr.codecs.Crc32cCodec()),
            dimension_names=axes,
            attributes=notes,
        )

    def _locked(self) -> int | None:
        """A hold on the store that ends with this process, however it ends."""
        try:
            return _hold(self.path, "LOCK_EX")
        except BlockingIOError as error:
            message = "another process is writing it; wait for it, or give another path"
            raise FileError(self.path, "", message) from error

    def _require_same(self, record: Mapping[str, Any]) -> bool:
        """Return whether the metadata of this exploration are damaged; refuse another one."""
        root = sealed_root(self.path)
        if root is not None:
            differs = _difference(attributes(root)[RECORD], record)
            if differs:
                key, before, now = differs
                message = f"was begun with {before} and is now to have {now}"
                remedy = "repeat the command that began it, or give another path"
                raise FileError(self.path, key, f"{message}; {remedy}")
            return bool(damaged_metadata(self.path, root))
        question = attributes(read_document(self.path / DONE / METADATA)).get(QUESTION)
        if question == fingerprint(record):
            return True
        if question is not None:
            message = f"its metadata ({METADATA}) are damaged, and it was begun by another command"
            raise FileError(self.path, "", f"{message}; repeat that one, or give another path")
        raise FileError(self.path, "", f"{_unknown(self.path)}; give another path")

    def _mend(self, record: Mapping[str, Any], columns: list[Column], damaged: bool) -> bool:
        """Write damaged metadata anew; they follow from the record."""
        if damaged:
            with self._skeleton(record, columns) as new:
                for document in new.rglob(METADATA):
                    target = self.path / document.relative_to(new)
                    target.parent.mkdir(exist_ok=True)
                    os.replace(document, target)
        return damaged

    def _open(self) -> None:
        """Find what is done, and remove what a killed writer left half-written."""
        self._group = self._zarr.open_group(self.path, mode="r+", use_consolidated=False)
        root = sealed_root(self.path)
        assert root is not None  # it was just checked or written
        self._batches = Batches(self.path, root)
        marks, unread = read_marks(self._group[DONE])
        self._damaged = self._batches.damaged(marks, unread)
        self.done = marks != 0
        self.done[self._damaged] = False
        for torn in self.path.rglob("*.partial"):
            torn.unlink()

    def _damage(self, mended: bool) -> str:
        parts = ["its metadata"] * mended
        if self._damaged:
            parts.append(f"{numbered(self._damaged)} (of {len(self.done)})")
        return f"was damaged; made anew: {', '.join(parts)}" if parts else ""

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
    """A store of `explore` as a dataset that reads on demand, with the numbers as coordinates.

    Every file of it is checked first, which reads all of them once. Raises `FileError` for a path
    that holds no exploration and for one that is damaged, with what of it is intact.
    """
    folder = Path(path)
    root = _checked_root(folder)
    metadata, (batches, intact, total) = damaged_metadata(folder, root), _unsound(folder, root)
    parts = []
    if metadata:
        parts.append(f"its metadata ({', '.join(f'{name}/{METADATA}' for name in metadata)})")
    if batches:
        parts.append(numbered(batches))
    if parts:
        what = f"is damaged or incomplete: {', '.join(parts)}"
        message = f"{what}; {intact} of {total} batches are intact; {_REPEAT}"
        raise FileError(path, "", message)
    return dataset(folder)


def dataset(folder: Path) -> "xarray.Dataset":
    """A store as `open_exploration` gives it, without its checks."""
    import xarray

    _zarr_library()  # which xarray needs for it
    found = xarray.open_zarr(folder, chunks=None)
    design = found.attrs[RECORD]["designs"]
    names = design.get("grid") or design["sobol"]
    return found.set_coords([array_name(name) for name in names])


def _checked_root(folder: Path) -> dict[str, Any]:
    """The metadata of a store; raises `FileError` where they are damaged or of something else."""
    if not folder.exists():
        raise FileError(folder, "", "is not there; give the path of a store of `explore`")
    root = sealed_root(folder)
    if root is not None:
        return root
    if QUESTION in attributes(read_document(folder / DONE / METADATA)):
        message = f"is damaged: its metadata ({METADATA}); its batches are left as they are"
        raise FileError(folder, "", f"{message}; {_REPEAT}")
    raise FileError(folder, "", f"{_unknown(folder)}; `xarray.open_zarr` may read it, unchecked")


def _unsound(folder: Path, root: dict[str, Any]) -> tuple[list[int], int, int]:
    """The batches that differ from their marks, how many are intact, and how many there are."""
    batches = Batches(folder, root)
    done = _zarr_library().open_group(folder, mode="r", use_consolidated=True)[DONE]
    marks, unread = read_marks(done)
    unsound = batches.damaged(marks, unread)
    intact = int(np.count_nonzero(marks)) + len(unread) - len(unsound)
    if not _is_being_written(folder):  # else what has data and no mark is about to be marked
        without = np.flatnonzero(marks == 0).tolist()
        unsound += [batch for batch in without if batch not in unread and batches.has_data(batch)]
    return sorted(unsound), intact, len(marks)


def _unknown(folder: Path) -> str:
    """In words, what a path holds whose metadata are not those of an exploration."""
    if RECORD in attributes(read_document(folder / METADATA)):
        return "has no valid checksum: it is of an earlier version of beltjax, or damaged"
    return "is there already and is no exploration"


def _hold(folder: Path, kind: str) -> int | None:
    """A lock on a folder, by its descriptor; raises `BlockingIOError` where another is held."""
    try:
        import fcntl
    except ImportError:  # a system without such locks
        return None
    hold = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(hold, getattr(fcntl, kind) | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(hold)
        raise
    except OSError:
        pass  # a file system without such locks
    return hold


def _is_being_written(folder: Path) -> bool:
    try:
        hold = _hold(folder, "LOCK_SH")
    except BlockingIOError:
        return True
    if hold is not None:
        os.close(hold)
    return False


def array_name(name: str) -> str:
    """`name`, which may be any pulley's, as the name of a file."""
    return name.replace("%", "%25").replace("/", "%2F")


def _zarr_library() -> ModuleType:
    """Zarr, an extra."""
    try:
        import zarr
    except ImportError as error:
        raise ValueError("zarr is not installed: pip install 'beltjax[explore]'") from error
    return zarr


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
