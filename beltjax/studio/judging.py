"""Objective and limits of a design: the true ones, or by their derivatives where they are slow."""

import time
from typing import Any

import jax
import numpy as np

from beltjax import optimize
from beltjax.studio.compiled import program
from beltjax.studio.programs import JudgedStudy, Names, judged

_SLOW = 0.15  # [s] that a drag does not wait for


class Judge:
    """Judges designs of one study, which differ in their numbers alone.

    Quantities of forced or periodic motion and of contact take seconds to find and minutes to
    compile. One that is not `patient` knows nothing before `prepare` has compiled.
    """

    def __init__(self, names: Names):
        self.names = names
        self.patient = True
        self._program: Any = None
        self._last: tuple[np.ndarray, JudgedStudy] | None = None
        self._took = 0.0

    @property
    def ready(self) -> bool:
        """Whether it is compiled."""
        return self._program is not None

    @property
    def slow(self) -> bool:
        """Whether the last design took longer to judge than a drag waits."""
        return self._took > _SLOW

    def prepare(self, study: optimize.Study) -> None:
        """Compile for studies like this canonical one."""
        self._program = program(judged, study, self.names)

    def known(self, numbers: np.ndarray) -> JudgedStudy | None:
        """What the derivatives at the last design that was judged say of these numbers."""
        if self._last is None:
            return None
        before, found = self._last
        step = numbers - before
        values = jax.tree.map(
            lambda value, slope: np.asarray(value) + np.asarray(slope) @ step,
            found.values[:-1],
            found.slopes[:-1],
        )
        return JudgedStudy(found.values._make((*values, found.values.found)), found.slopes)

    def __call__(self, study: optimize.Study, numbers: np.ndarray) -> JudgedStudy | None:
        """What a canonical study's design is worth; None before it is compiled."""
        if not self.ready:
            if not self.patient:
                return None
            self.prepare(study)
        begun = time.monotonic()
        found = jax.block_until_ready(self._program(study, self.names))
        self._took = time.monotonic() - begun
        if bool(found.values.found):
            self._last = numbers, found
        return found
