"""The state of a search in a file, so that the same study goes on where it was stopped."""

import dataclasses
import hashlib
import io
import os
from pathlib import Path
from typing import Any

import jax
import numpy as np

from beltjax.files.writing import write_whole

from .study import Study

_MARK = b"beltjax checkpoint 2\n"
_ANEW = "remove it to start anew"


class Checkpoint:
    """One study's state in one file, complete or absent at any moment.

    The file is a line that says what it is, a SHA-256 of the rest, and the arrays as NumPy saves
    them. Raises `ValueError` for a file that is damaged or no checkpoint.
    """

    def __init__(self, path: str | os.PathLike[str]):
        self._path, self._key = path, ""
        self._saved = _read(path)

    def load(self, study: Study, points: jax.Array) -> dict[str, np.ndarray] | None:
        """The arrays that `save` wrote last for this study from these points, or None.

        Raises `ValueError` for a file that another study wrote.
        """
        self._key = _fingerprint(study, points)
        if self._saved is None:
            return None
        found = dict(self._saved)
        if str(found.pop("key", "")) != self._key:
            raise ValueError(f"{self._path}: is of another study or other numbers; {_ANEW}")
        return found

    def save(self, **arrays: Any) -> None:
        """Write in one move."""
        held = io.BytesIO()
        contents: dict[str, Any] = {name: np.asarray(x) for name, x in arrays.items()}
        np.savez(held, key=self._key, **contents)
        content = held.getvalue()
        write_whole(self._path, _MARK + hashlib.sha256(content).digest() + content)


def _read(path: str | os.PathLike[str]) -> dict[str, np.ndarray] | None:
    """The arrays in a file; None where there is no file."""
    if not os.path.exists(path):
        return None
    if not os.path.isfile(path):
        raise ValueError(f"{path}: is no file; give another path")
    try:
        text = Path(path).read_bytes()
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from error
    if not text.startswith(_MARK):
        message = "is no checkpoint of this version of beltjax, or damaged"
        raise ValueError(f"{path}: {message}; {_ANEW}")
    rest = text.removeprefix(_MARK)
    size = hashlib.sha256().digest_size
    digest, content = rest[:size], rest[size:]
    if hashlib.sha256(content).digest() != digest:
        raise ValueError(f"{path}: is a damaged checkpoint: its checksum is wrong; {_ANEW}")
    with np.load(io.BytesIO(content), allow_pickle=False) as saved:
        return dict(saved)


def _fingerprint(study: Study, points: jax.Array) -> str:
    """A hash of every number and name of a study but its time limit."""
    leaves, structure = jax.tree.flatten((dataclasses.replace(study, time_limit=None), points))
    held = hashlib.sha256(str(structure).encode())
    for leaf in leaves:
        held.update(np.asarray(leaf).tobytes())
    return held.hexdigest()
