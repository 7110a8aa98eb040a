"""Compiling for few calls, where the wait for the compiler is most of the work."""

import functools
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import numpy as np

Numbers = TypeVar("Numbers")
Function = TypeVar("Function", bound=Callable)


@functools.cache
def quickly_compiled(function: Function) -> Function:
    """`function`, jitted by XLA's plain kernels and without LLVM's optimizations.

    On a CPU it compiles in a third of the time and runs at about half the speed: right for one
    drive or a few hundred designs, wrong for large batches. Elsewhere a plain jit.
    """
    jitted: Any = eqx.filter_jit  # whose overloads leave out what it passes on to jax.jit
    return jitted(function, compiler_options=quick_options())


def quick_options() -> dict[str, Any] | None:
    """What `jax.jit` must be told to compile quickly on this machine."""
    # Not by taking out XLA's fusion pass, which compiles as fast: without it XLA (jax 0.10) gives
    # wrong products of batched matrices.
    quick = {"xla_cpu_use_fusion_emitters": False, "xla_backend_optimization_level": 0}
    return quick if jax.default_backend() == "cpu" else None


def in_chunks(
    run: Callable[[np.ndarray], Numbers],
    values: np.ndarray,
    size: int,
    advance: Callable[[int, int], None],
) -> Numbers:
    """`run(values)` on the host, `size` values at a time, so that one shape compiles.

    `run` takes [size] and returns a pytree with that axis first; the last chunk is filled up
    with its own last value. `advance(done, total)` is told of every chunk.
    """
    parts = []
    for start in range(0, len(values), size):
        advance(start, len(values))
        chunk = values[start : start + size]
        full = np.append(chunk, np.full(size - len(chunk), chunk[-1]))
        part = jax.device_get(run(full))
        parts.append(jax.tree.map(lambda x, chunk=chunk: x[: len(chunk)], part))
    advance(len(values), len(values))
    return jax.tree.map(lambda *x: np.concatenate(x), *parts)
