"""Compiled programs that all pages of a process share."""

import threading
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax

from beltjax.compiling.kept_programs import kept_call

_programs: dict[Any, Callable] = {}
_locks: dict[Any, threading.Lock] = {}
_looking = threading.Lock()


def program(function: Callable, *args: Any) -> Callable:
    """`function` compiled for arguments like these, once, whichever thread asks first."""
    arrays, rest = eqx.partition(args, eqx.is_array)
    shapes = tuple((x.shape, str(x.dtype)) for x in jax.tree.leaves(arrays))
    key = function, shapes, jax.tree.structure(arrays), eqx.tree_pformat(rest)
    with _looking:
        own = _locks.setdefault(key, threading.Lock())
    with own:
        if key not in _programs:
            made = kept_call(function, *args)
            made(*args)  # where no program is kept, the first call compiles
            _programs[key] = made
        return _programs[key]
