"""Batches of designs on a Dask cluster: the same answers, from other processes."""

import concurrent.futures
import contextlib
import functools
import importlib
import logging
import os
import pickle
from collections.abc import Iterable, Iterator
from typing import Any

import jax
import numpy as np

from .batches import Columns, Question, batch_columns, library_versions

_IN_FLIGHT = 2  # batches a worker holds, so that none waits for the next
_KEPT = "what is written is intact: repeat the command to go on"
_PATIENCE = 20.0  # [s] for a scheduler to answer
_WORKERS_PER_PROCESSOR = 4  # more than one only wait for each other, and take memory


@contextlib.contextmanager
def cluster(workers: int | None, scheduler: str | None) -> Iterator[Any]:
    """A client of the scheduler at that address or, without one, of `workers` local processes.

    Raises `ValueError` where Dask is missing, no scheduler answers, or there are no workers or
    more than four for each processor.
    """
    most = _WORKERS_PER_PROCESSOR * (os.cpu_count() or 1)
    if workers is not None and not 1 <= workers <= most:
        raise ValueError(f"workers: found {workers}; give 1 to {most} on this machine.")
    try:
        distributed = importlib.import_module("distributed")
    except ImportError as error:
        message = "distributed is not installed: pip install 'beltjax[cluster]'"
        raise ValueError(message) from error
    if scheduler is None:
        processes = distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=":0",
            silence_logs=logging.CRITICAL,
        )
        with processes, distributed.Client(processes) as client:
            yield client
        return
    try:
        client = distributed.Client(scheduler, timeout=_PATIENCE)
    except (OSError, ValueError) as error:
        message = f"scheduler: found {scheduler!r}, where none answers; give tcp://HOST:PORT"
        raise ValueError(message) from error
    with client:
        yield client


def on_cluster(
    client: Any,
    question: Question,
    batches: Iterable[tuple[int, np.ndarray]],
    size: int,
    *,
    quick: bool,
) -> Iterator[tuple[int, Columns]]:
    """Answers to numbered batches as they come; few are under way, however many there are.

    Raises `ValueError` where the cluster is lost or has other versions of the libraries.
    """
    distributed = importlib.import_module("distributed")
    # As bytes: unpacked before double precision is set, its numbers would lose half their digits.
    packed, versions = pickle.dumps(question), library_versions()
    waiting = iter(batches)
    numbers: dict[Any, int] = {}

    def submit() -> Any:
        for number, values in waiting:
            future = client.submit(answer_packed, packed, versions, values, size, quick, pure=False)
            numbers[future.key] = number
            return future
        return None

    limit = _IN_FLIGHT * max(1, sum(client.nthreads().values()))
    first = [future for future in (submit() for _ in range(limit)) if future is not None]
    under_way = distributed.as_completed(first)
    for future in under_way:
        following = submit()
        if following is not None:
            under_way.add(following)
        try:
            columns = future.result()
        except (distributed.KilledWorker, concurrent.futures.CancelledError, OSError) as error:
            raise ValueError(f"the cluster was lost; {_KEPT} ({type(error).__name__})") from error
        yield numbers.pop(future.key), columns


def answer_packed(
    packed: bytes, versions: dict[str, str], values: np.ndarray, size: int, quick: bool
) -> Columns:
    """Answers to one batch, in a worker's process; raises `ValueError` for other versions."""
    own = library_versions()
    if own != versions:
        message = f"a worker has {own} and not {versions}; install the same versions there"
        raise ValueError(message)
    jax.config.update("jax_enable_x64", True)
    return batch_columns(_unpacked(packed), values, size, quick=quick)


@functools.lru_cache(maxsize=4)
def _unpacked(packed: bytes) -> Question:
    return pickle.loads(packed)
