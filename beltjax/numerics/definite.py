"""Small symmetric systems, whose pivots say whether they are positive definite."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float


class Definite(NamedTuple):
    """A solution, and whether its matrix is positive definite."""

    solution: Float[Array, " n"]
    definite: Bool[Array, ""]


def definite_solve(
    matrix: Float[Array, "n n"], right: Float[Array, " n"], wanted: Float[Array, " n"]
) -> Definite:
    """Solution of the equations and unknowns that are `wanted` (1, or 0 for those that stay 0).

    By elimination without pivoting, unrolled: for a handful of unknowns. Of no unknowns the
    matrix counts as positive definite. Where it is not, the solution is finite all the same.
    """
    count = len(right)
    unit = np.eye(count)
    square = matrix * wanted[:, None] * wanted + unit * (1.0 - wanted)
    if count == 1:  # most drives: nothing to put together
        good = square[0] > 0
        return Definite(right * wanted / jnp.where(good, square[0], 1.0), good[0])
    left = jnp.concatenate([square, (right * wanted)[:, None]], axis=1)
    definite = jnp.array(True)
    for i in range(count):
        good = left[i, i] > 0
        definite = definite & good
        pivot = jnp.where(good, left[i, i], 1.0)
        # All other rows lose their entry in this column, and this one is divided by its pivot.
        column = jnp.where(unit[i] > 0, pivot - 1.0, left[:, i])
        left = left - column[:, None] * (left[i] / pivot)
    return Definite(left[:, -1] if count else right, definite)
