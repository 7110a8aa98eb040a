"""Batches of loops."""

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
