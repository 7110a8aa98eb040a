"""The integrity of a store: a checksum guards its metadata, marks guard its batches.

A batch's mark is a hash over the files that hold it, so that a file that is missing, cut off,
changed or of another batch or store is found. The chunks carry a CRC-32C besides, which any
reader of Zarr checks whenever it reads one.
"""

import hashlib
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt64

DONE = "done"
RECORD = "exploration"  # attribute of the store: which exploration it is
QUESTION = "question"  # attribute of the array "done": hash of the record
METADATA = "zarr.json"
_CHECKSUM = "checksum"  # attribute of the store: hash of its metadata, this left blank
_ARRAYS = "consolidated_metadata"

Document = dict[str, Any]


def fingerprint(data: Any) -> str:
    """Hash of plain data."""
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def read_document(path: Path) -> Document | None:
    """A JSON object in a file; None where there is none that can be read."""
    try:
        found = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def attributes(document: Document | None) -> Document:
    """Attributes of a group or an array; none where its metadata cannot be read."""
    found = (document or {}).get("attributes")
    return found if isinstance(found, dict) else {}


def seal(store: Path) -> None:
    """Add their checksum to the metadata of a new store."""
    root = json.loads((store / METADATA).read_bytes())
    root["attributes"][_CHECKSUM] = ""
    text = json.dumps(root, indent=2)
    blank = f'"{_CHECKSUM}": "'
    digest = hashlib.sha256(text.encode()).hexdigest()
    (store / METADATA).write_text(text.replace(blank, blank + digest))


def sealed_root(store: Path) -> Document | None:
    """Metadata of a store; None where they are not, to the byte, those that were written."""
    root = read_document(store / METADATA)
    digest = attributes(root).get(_CHECKSUM)
    if not isinstance(digest, str) or len(digest) != 2 * hashlib.sha256().digest_size:
        return None
    rest = (store / METADATA).read_bytes().replace(digest.encode(), b"")
    return root if hashlib.sha256(rest).hexdigest() == digest else None


def arrays_of(root: Document) -> dict[str, Document]:
    """Metadata of each array, as the sealed metadata of the store repeat them."""
    return root[_ARRAYS]["metadata"]


def damaged_metadata(store: Path, root: Document) -> list[str]:
    """The arrays whose own metadata are not those that the sealed ones of the store repeat."""
    return [
        name
        for name, document in arrays_of(root).items()
        if read_document(store / name / METADATA) != document
    ]


class Batches:
    """The files of each batch of a store, found by its sealed metadata."""

    def __init__(self, store: Path, root: Document):
        arrays = arrays_of(root)
        self._store = store
        self._question: str = arrays[DONE]["attributes"][QUESTION]
        # A batch is the first chunk of its row: chunks are never split across.
        self._chunks = [
            (name, ("0",) * (len(document["shape"]) - 1))
            for name, document in sorted(arrays.items())
            if name != DONE
        ]

    def files(self, batch: int) -> list[Path]:
        """List the paths of a batch's chunks, whether they exist or not."""
        return [self._store.joinpath(n, "c", str(batch), *rest) for n, rest in self._chunks]

    def has_data(self, batch: int) -> bool:
        """Return whether any chunk of a batch exists."""
        return any(path.exists() for path in self.files(batch))

    def mark(self, batch: int) -> int:
        """Hash over what a batch's files hold and where they belong; never 0."""
        held = hashlib.blake2b(f"{self._question} {batch}".encode(), digest_size=8)
        for (name, _), path in zip(self._chunks, self.files(batch), strict=True):
            try:
                content = path.read_bytes()
            except FileNotFoundError:  # Zarr writes no chunk in which nothing was found
                held.update(f" {name} nothing".encode())
            except OSError as error:
                held.update(f" {name} {error}".encode())
            else:
                held.update(f" {name} {len(content)} ".encode())
                held.update(content)
        return int.from_bytes(held.digest(), "little") or 1

    def damaged(self, marks: UInt64[np.ndarray, " batches"], unread: Sequence[int]) -> list[int]:
        """The batches whose files differ from their marks, and those whose marks are `unread`."""
        marked = np.flatnonzero(marks).tolist()
        return sorted({*unread, *(batch for batch in marked if self.mark(batch) != marks[batch])})


def read_marks(done: Any) -> tuple[UInt64[np.ndarray, " batches"], list[int]]:
    """The marks in the array "done", 0 for a batch without one, and the batches of unread ones."""
    marks, unread = np.zeros(done.shape[0], np.uint64), []

    def read(start: int, stop: int) -> None:
        try:
            marks[start:stop] = done[start:stop]
        except Exception:  # what a decoder raises for damaged bytes is its own affair
            if stop - start == 1:
                unread.append(start)
                return
            middle = (start + stop) // 2
            read(start, middle)
            read(middle, stop)

    read(0, len(marks))
    return marks, unread


def numbered(batches: Iterable[int], most: int = 8) -> str:
    """Batches as people count them, in a line that stays short: "batches 3, 5 and 12 more"."""
    numbers = [str(batch + 1) for batch in batches]
    more = f" and {len(numbers) - most} more" if len(numbers) > most else ""
    return f"{'batch' if len(numbers) == 1 else 'batches'} {', '.join(numbers[:most])}{more}"
