"""Threads of XLA on a CPU."""

import os

_ENOUGH = 16


def give_xla_threads() -> None:
    """Let XLA's pool have more threads than routines of linear algebra that it runs at a time.

    It has one for each core. In a batch a routine keeps its thread while others work for it: on two
    cores two routines at a time wait for each other for ever (jaxlib 0.10). Some programs take a
    few percent longer so. A pool that has begun keeps its size, and who sets the variable is not
    overruled; a version of XLA that does not know it has as many threads as before.
    """
    os.environ.setdefault("PJRT_NPROC", str(max(_ENOUGH, os.cpu_count() or 1)))
