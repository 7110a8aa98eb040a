"""Batches of designs on a Dask cluster: the same answers, from other processes."""

import concurrent.futures
import contextlib
import functools
import logging
import os
import pickle
import time
from collections.abc import Iterable, Iterator
from typing import Any

import jax
import numpy as np

from .batches import Columns, Question, batch_columns, library_versions

_IN_FLIGHT = 2  # batches a worker holds, so that none waits for the next
_KEPT = "what is written is intact: repeat the command to go on"
_PATIENCE = 20.0  # [s] for a scheduler to answer
_ALONE = 60.0  # [s] without a worker, beyond which none is expected to come
_POLL = 0.01  # [s] between checks of what is ready
_CHECK = 1.0  # [s] between checks of whether there are workers
# A batch may be done and its worker dead before it is fetched. Dask tries to reach such a worker
# for 30 s, batch after batch: several of them were like a standstill.
_CONNECT = {"distributed.comm.timeouts.connect": "10s"}
_TALKATIVE = ("asyncio", "distributed", "tornado")
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
        import distributed
    except ImportError as error:
        message = "distributed is not installed: pip install 'beltjax[cluster]'"
        raise ValueError(message) from error
    with _quiet():
        if scheduler is None:
            with (
                _local_cluster(workers) as processes,
                distributed.Client(processes) as client,
            ):
                yield client
            return
        try:
            client = distributed.Client(scheduler, timeout=_PATIENCE)
        except (OSError, ValueError) as error:
            message = f"scheduler: found {scheduler!r}, where none answers; give tcp://HOST:PORT"
            raise ValueError(message) from error
        with client:
            yield client


@contextlib.contextmanager
def _local_cluster(workers: int | None) -> Iterator[Any]:
    from dask.config import set as configured
    from distributed import LocalCluster

    with configured(_CONNECT):
        try:
            processes = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                dashboard_address=":0",
                silence_logs=logging.CRITICAL,
            )
        except (OSError, RuntimeError) as error:  # one was killed before it had started
            why = f"workers: {workers} processes could not be started ({error})"
            raise ValueError(f"{why}; {_KEPT}") from error
        with processes:
            yield processes


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Nothing on the terminal of what Dask logs: what matters of it is raised, in one line."""
    names = [n for n in logging.root.manager.loggerDict if n.partition(".")[0] in _TALKATIVE]
    loggers = [logging.getLogger(name) for name in {*names, *_TALKATIVE}]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


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
    import distributed

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

    try:
        limit = _IN_FLIGHT * max(1, sum(client.nthreads().values()))
        first = [future for future in (submit() for _ in range(limit)) if future is not None]
        under_way = distributed.as_completed(first)
        for futures in _ready(client, under_way):
            following = [future for future in (submit() for _ in futures) if future is not None]
            under_way.update(following)
            # All at once: what has to be found again then keeps nothing else waiting.
            for future, columns in zip(futures, client.gather(futures), strict=True):
                yield numbers.pop(future.key), columns
    except (distributed.KilledWorker, concurrent.futures.CancelledError, OSError) as error:
        raise ValueError(f"the cluster was lost; {_KEPT} ({type(error).__name__})") from error


def _ready(client: Any, under_way: Any) -> Iterator[list[Any]]:
    """Futures as they come to their ends, all that did at once.

    Raises `ValueError` where there is no worker, and none comes.
    """
    checked = served = time.monotonic()
    while not under_way.is_empty():
        futures = under_way.next_batch(block=False)
        now = time.monotonic()
        if futures:
            served = now
            yield futures
            continue
        if now - checked > _CHECK:
            checked = now
            if client.nthreads():
                served = now
            elif now - served > _ALONE:
                raise ValueError(f"the cluster has had no worker for {_ALONE:g} s; {_KEPT}")
        time.sleep(_POLL)


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
