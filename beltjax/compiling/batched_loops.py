"""Batches of loops and of linear algebra."""

from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array

Numbers = TypeVar("Numbers")


def in_lanes_of(given: Array, state: Numbers) -> Numbers:
    """`state` unchanged, but under `vmap` an array of the batch wherever `given` is one.

    For the first state of a loop. JAX traces the batch of a loop again and again until it knows
    which parts of the state differ between lanes, and loops within loops that often each time.
    """
    lane = jnp.ravel(given)[0]
    return jax.tree.map(lambda x: jnp.where(lane == lane, x, x), state)


def ready_after(value: Array, earlier: Array) -> Array:
    """`value`, which is not ready before `earlier` is, and so are their derivatives.

    In a batch two calls of LAPACK that do not need each other run at the same time, and can wait
    for each other for ever in XLA's pool of threads, which has one for each core.
    """
    number = jnp.ravel(earlier)[0].real
    return value + 0.0 * jnp.where(jnp.isfinite(number), number, 0.0)
