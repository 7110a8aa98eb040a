"""Compiling for few calls, where the wait for the compiler is most of the work."""

import functools
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax

Function = TypeVar("Function", bound=Callable)


@functools.cache
def quickly_compiled(function: Function) -> Function:
    """`function`, jitted without fusing its kernels.

    On a CPU it compiles in less than half the time and runs at about half the speed: right
    for one drive or a few hundred designs, wrong for large batches. Elsewhere a plain jit.
    """
    options = {"xla_disable_hlo_passes": "fusion"} if jax.default_backend() == "cpu" else None
    jitted: Any = eqx.filter_jit  # whose overloads leave out what it passes on to jax.jit
    return jitted(function, compiler_options=options)
