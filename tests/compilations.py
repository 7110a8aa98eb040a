"""Counting what XLA compiles, and drives that differ in numbers and names alone."""

import contextlib
import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

_COMPILED = "/jax/core/compile/backend_compile_duration"
_count = [0]
jax.monitoring.register_event_duration_secs_listener(
    lambda event, _, **__: _count.__setitem__(0, _count[0] + (event == _COMPILED))
)

# A number as a user may give it: of Python, NumPy or JAX, in whole or double precision, weakly
# typed or not.
TYPES = {
    "float": float,
    "int": int,
    "numpy": np.float64,
    "single": np.float32,
    "array": np.array,
    "strong": jnp.float64,
    "weak": jnp.asarray,
}


@contextlib.contextmanager
def compilations():
    """A list whose one number, when the block has ended, says how many programs it compiled."""
    found = [-1]
    before = _count[0]
    yield found
    found[0] = _count[0] - before


def renamed(drive, point, suffix):
    """The same drive under other names."""
    pulleys = [dataclasses.replace(p, name=p.name + suffix) for p in drive.pulleys]
    drive = dataclasses.replace(drive, pulleys=tuple(pulleys), name=drive.name + suffix)
    torque = {name + suffix: value for name, value in point.torque.items()}
    return drive, dataclasses.replace(point, torque=torque)


def variants(drive, point):
    """The drive and point with other stiffnesses, speeds and names, in all types of numbers."""
    for k, (name, typed) in enumerate(TYPES.items()):
        stiffness = typed(int(drive.tensioner.stiffness) + k)
        stiffer = eqx.tree_at(lambda d: d.tensioner.stiffness, drive, stiffness)
        faster = eqx.tree_at(lambda p: p.belt_speed, point, typed(10 + k))
        yield name, *renamed(stiffer, faster, f" {name}")
