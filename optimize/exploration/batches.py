"""One question put to many designs at once: compiled once, in batches of one size."""

import functools
import importlib.metadata
from collections.abc import Iterable, Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Array, Float

from beltjax.analysis.linearization import linearize
from beltjax.analysis.modes import modes
from beltjax.analysis.steady import steady_state
from beltjax.analysis.sweep import BASIS, require_count
from beltjax.compiling.quick import quickly_compiled, thoroughly_compiled
from beltjax.drive.numbers import require_numbers, with_numbers
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.numerics.bases import AbstractBasis
from beltjax.results import RESULTS, code, succeeded

from ..drive_analyses import DriveAnalyses
from ..quantities import definition_of, find_quantity

RESULT, FREQUENCY = "result", "frequency"
# Designs up to which compiling quickly saves more than running quickly.
FEW = 200_000

Columns = dict[str, np.ndarray]  # [designs, ...] each: the designs' numbers and what was found


class Question(eqx.Module):
    """The quantities and the lowest natural frequencies to be found of each design.

    Raises `ValueError` for numbers and quantities that the drive does not have, and for more
    modes than the basis has room for.
    """

    drive: Drive
    point: OperatingPoint
    names: tuple[str, ...] = eqx.field(static=True)  # of the numbers that differ between designs
    quantities: tuple[str, ...] = eqx.field(static=True)
    modes: int = eqx.field(static=True, default=0)
    basis: AbstractBasis = BASIS

    def __check_init__(self):
        require_numbers(self.drive, self.names)
        for name in self.quantities:
            try:
                find_quantity(name, self.drive, self.point)
            except KeyError as error:
                raise ValueError(str(error.args[0])) from error
        if len(set(self.quantities)) < len(self.quantities):
            raise ValueError("quantities: one is given twice; remove it")
        if self.modes:
            require_count(self.drive, self.modes, self.basis)

    def analyses(self, values: Float[Array, " numbers"]) -> DriveAnalyses:
        """The analyses of one design."""
        changed = dict(zip(self.names, values, strict=True))
        drive, point = with_numbers(self.drive, self.point, changed)
        return DriveAnalyses(drive, point, steady_state(drive, point, throw=False))

    def parts(self) -> dict[str, int | None]:
        """Count the numbers of each quantity; None stands for a plain number."""
        if not any(definition_of(name).many for name in self.quantities):
            return dict.fromkeys(self.quantities)
        blank = jnp.zeros((1, len(self.names)))
        found = eqx.filter_eval_shape(_answers, self, blank)
        return {
            name: found[name].shape[1] if found[name].ndim > 1 else None for name in self.quantities
        }


def library_versions() -> dict[str, str]:
    """The versions of the libraries that compute: others may differ in the last digits."""
    libraries = ("beltjax", "jax", "jaxlib", "scipy")
    return {name: importlib.metadata.version(name) for name in libraries}


def answers(question: Question, values: np.ndarray, *, quick: bool) -> dict[str, Array]:
    """Quantities and frequencies of designs [designs, numbers], on all local devices.

    By the names of the quantities, "frequency" [designs, modes] in rad/s, and "result", whose
    codes are those of `beltjax.results.outcomes`. A quantity of a failed design is nan.
    """
    devices = jax.local_device_count()
    if devices > 1:
        return _sharded(devices)(question, jnp.asarray(_filled(values, devices)))
    compiled = quickly_compiled if quick else thoroughly_compiled
    return compiled(_answers)(question, jnp.asarray(values))


def in_batches(
    question: Question, batches: Iterable[tuple[int, np.ndarray]], size: int, *, quick: bool
) -> Iterator[tuple[int, Columns]]:
    """Numbers and answers of batches of at most `size` designs; one is computed as one is used."""
    waiting = None
    for number, values in batches:
        started = number, values, answers(question, _padded(values, size), quick=quick)
        if waiting is not None:
            yield _fetched(question, *waiting)
        waiting = started
    if waiting is not None:
        yield _fetched(question, *waiting)


def batch_columns(question: Question, values: np.ndarray, size: int, *, quick: bool) -> Columns:
    """Answers to one batch of at most `size` designs, on the host."""
    ((_, columns),) = in_batches(question, [(0, values)], size, quick=quick)
    return columns


def _fetched(
    question: Question, number: int, values: np.ndarray, found: dict[str, Array]
) -> tuple[int, Columns]:
    columns = dict(zip(question.names, values.T, strict=True))
    answered = jax.device_get(found).items()
    return number, columns | {name: np.asarray(x)[: len(values)] for name, x in answered}


def _padded(values: np.ndarray, size: int) -> Float[np.ndarray, "designs numbers"]:
    """`values` filled up to `size` designs with the last one, so that one shape compiles."""
    return np.concatenate([values, np.repeat(values[-1:], size - len(values), axis=0)])


def _filled(values: np.ndarray, devices: int) -> Float[np.ndarray, "designs numbers"]:
    return _padded(values, -(-len(values) // devices) * devices)


def _answers(question: Question, values: Float[Array, "designs numbers"]) -> dict[str, Array]:
    return jax.vmap(lambda one: _answer(question, one))(values)


@functools.cache
def _sharded(devices: int) -> Any:
    """`_answers` with an equal share of the designs on each local device."""
    mesh = Mesh(np.array(jax.local_devices()[:devices]), ("designs",))
    shared, split = PartitionSpec(), PartitionSpec("designs")

    @eqx.filter_jit
    def run(question: Question, values: Float[Array, "designs numbers"]) -> dict[str, Array]:
        arrays, rest = eqx.partition(question, eqx.is_array)

        def share(arrays: Any, values: Array) -> dict[str, Array]:
            return _answers(eqx.combine(arrays, rest), values)

        # Each device runs its own loops to their own ends: nothing is exchanged.
        split_up = jax.shard_map(
            share, mesh=mesh, in_specs=(shared, split), out_specs=split, check_vma=False
        )
        return split_up(arrays, values)

    return run


def _answer(question: Question, values: Float[Array, " numbers"]) -> dict[str, Array]:
    of = question.analyses(values)
    found = {name: find_quantity(name, of.drive).measure(of) for name in question.quantities}
    runs = of.all_found()
    found = {
        name: jnp.where(runs, x if definition_of(name).many else x[0], jnp.nan)
        for name, x in found.items()
    }
    result = of.result
    if question.modes:
        lin = linearize(of.steady, question.basis, throw=False)
        lowest = modes(lin, question.modes, route="hermitian", throw=False)
        stable = succeeded(lowest.result)
        found[FREQUENCY] = jnp.where(stable, lowest.frequencies, jnp.nan)
        result = RESULTS.where(succeeded(result), lowest.result, result)
    return found | {RESULT: code(result)}
