"""Explorations: many designs, their quantities and modes, in a store that can be resumed."""

import functools
import os
import warnings
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax

from beltjax.analysis.linearization import has_inertias
from beltjax.analysis.sweep import BASIS
from beltjax.compiling.quick import usual_promotion
from beltjax.drive.files import drive_content
from beltjax.drive.numbers import unit_of
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.numerics.bases import AbstractBasis

from ..quantities import find_quantity
from .batches import FEW, FREQUENCY, Question, in_batches, library_versions
from .cluster import cluster, on_cluster
from .samples import Designs
from .store import Column, DamageWarning, Store, dataset

if TYPE_CHECKING:
    import xarray

BATCH = 4096  # designs; small against memory, large against the writing of a file
BATCH_WITH_MODES = 64  # matrices of a hundred rows and more for each design
MOST_IN_BATCH = 2**16  # designs, beyond which memory may not hold what finding them takes
MOST_IN_BATCH_WITH_MODES = 2**12
MOST_BATCHES = 2**20  # each of them a file for every quantity
Advance = Callable[[str, int, int | None], None]


@usual_promotion
def explore(
    drive: Drive,
    point: OperatingPoint,
    designs: Designs,
    quantities: Sequence[str],
    store: str | os.PathLike[str],
    *,
    modes: int = 0,
    basis: AbstractBasis = BASIS,
    batch: int | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    advance: Advance | None = None,
) -> "xarray.Dataset":
    """Quantities and the `modes` lowest frequencies of every design, in a Zarr store at `store`.

    Called again with the same arguments, it continues where it was stopped, whenever and however
    that was, and reaches the same bits; a store of other arguments is refused. Batches that were
    damaged since are computed anew, with a `DamageWarning`. A failed design has its code in
    `result` and nan for the values that could not be found. Pulleys that overlap are not a failure:
    include the quantity "clearance". docs/exploration.md.

    Args:
        drive: the nominal drive.
        point: its speeds and torques.
        designs: a `Grid` or `Samples` of numbers by their keys in the drive file.
        quantities: names of quantities, as studies use them.
        store: path of the store.
        modes: number of natural frequencies per design; 0 for none.
        basis: functions for the deflections of each span, `Legendre(24)` unless given.
        batch: number of designs that are computed and written at a time.
        workers: number of processes of this machine; without it and `scheduler`, this process
            computes, on all its devices.
        scheduler: address of the scheduler of a Dask cluster.
        advance: function that is called as `advance(stage, done, total)` after every batch.

    Returns:
        The store, opened, with variables along "design" and SI units in their attributes.

    Raises:
        ValueError: arguments cannot be used.
        FileError: the store cannot be used or written; it is a `ValueError`, too.
    """
    question = Question(drive, point, designs.names, tuple(quantities), modes, basis)
    if modes and not has_inertias(drive):
        raise ValueError("modes: need the inertia of every pulley and of the arm")
    size = _batch_size(batch, modes, designs.total)
    record, columns = _record(question, designs, size), _columns(question)
    progress = advance or (lambda stage, done, total: None)
    # Chosen by the whole, not by what is left: resuming must give the same bits.
    quick = designs.total <= FEW
    with (
        nullcontext() if workers is scheduler is None else cluster(workers, scheduler) as client,
        Store(store, record, columns, designs.total, size) as kept,
    ):
        if kept.damage:
            warnings.warn(f"{store} {kept.damage}", DamageWarning, stacklevel=2)
        pending = kept.pending()
        progress("compiling", kept.designs_done, designs.total)
        points = designs.walk(map(kept.span, pending))
        batches = zip(pending, points, strict=True)
        answered = in_batches if client is None else functools.partial(on_cluster, client)
        for number, found in answered(question, batches, size, quick=quick):
            kept.write(number, found)
            progress("exploring", kept.designs_done, designs.total)
    return dataset(Path(store))


def _batch_size(given: int | None, modes: int, total: int) -> int:
    most = MOST_IN_BATCH_WITH_MODES if modes else MOST_IN_BATCH
    least = -(-total // MOST_BATCHES)
    if given is not None and not 1 <= given <= most:
        raise ValueError(f"batch: found {given}; give at least 1 and at most {most}.")
    size = given or (BATCH_WITH_MODES if modes else BATCH)
    if size < least:
        found = f"found {size}, which makes {-(-total // size)} files for each quantity"
        raise ValueError(f"batch: {found}; give at least {least}.")
    return min(size, total)


def _columns(question: Question) -> list[Column]:
    columns = [Column(name, unit_of(question.drive, name)) for name in question.names]
    for name, parts in question.parts().items():
        columns.append(Column(name, find_quantity(name, question.drive).unit, parts))
    if question.modes:
        columns.append(Column(FREQUENCY, "rad/s", question.modes))
    return columns


def _record(question: Question, designs: Designs, size: int) -> dict[str, Any]:
    """Everything that the answers depend on, to the last bit."""
    return {
        "drive": drive_content(question.drive, question.point),
        "designs": designs.record(),
        "quantities": list(question.quantities),
        "modes": question.modes,
        "basis": repr(question.basis),
        "batch": size,
        "versions": library_versions(),
        "devices": f"{jax.local_device_count()} {jax.default_backend()}",
    }
