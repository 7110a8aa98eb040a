"""The state of a search in a file, so that the same study goes on where it was stopped."""

import dataclasses
import hashlib
import io
import os
from typing import Any

import jax
import numpy as np

from beltjax.writing import write_whole

from .study import Study


class Checkpoint:
    """One study's state in one file, complete or absent at any moment."""

    def __init__(self, path: str | os.PathLike[str], study: Study, points: jax.Array):
        self._path, self._key = path, _fingerprint(study, points)

    def load(self) -> dict[str, np.ndarray] | None:
        """What `save` wrote last; None before that.

        Raises `ValueError` for a file that another study wrote, or none.
        """
        if not os.path.exists(self._path):
            return None
        try:
            with np.load(self._path, allow_pickle=False) as saved:
                found = dict(saved)
        except (OSError, ValueError, EOFError) as error:
            raise ValueError(f"{self._path}: is no checkpoint; remove it to start anew") from error
        if str(found.pop("key", "")) != self._key:
            raise ValueError(
                f"{self._path}: is of another study or other numbers; remove it to start anew"
            )
        return found

    def save(self, **arrays: Any) -> None:
        """Write in one move."""
        held = io.BytesIO()
        contents: dict[str, Any] = {name: np.asarray(x) for name, x in arrays.items()}
        np.savez(held, key=self._key, **contents)
        write_whole(self._path, held.getvalue())


def _fingerprint(study: Study, points: jax.Array) -> str:
    """Of every number and name of a study but its time limit."""
    leaves, structure = jax.tree.flatten((dataclasses.replace(study, time_limit=None), points))
    held = hashlib.sha256(str(structure).encode())
    for leaf in leaves:
        held.update(np.asarray(leaf).tobytes())
    return held.hexdigest()
