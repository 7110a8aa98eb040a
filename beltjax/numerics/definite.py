"""Small symmetric systems, whose pivots say whether they are positive definite."""

from typing import NamedTuple

import jax.numpy as jnp
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
    rows = [[matrix[i, j] * wanted[i] * wanted[j] for j in range(count)] for i in range(count)]
    for i in range(count):
        rows[i][i] = rows[i][i] + (1.0 - wanted[i])
    values = [right[i] * wanted[i] for i in range(count)]
    definite = jnp.array(True)
    for i in range(count):
        good = rows[i][i] > 0
        definite = definite & good
        pivot = jnp.where(good, rows[i][i], 1.0)
        rows[i][i] = pivot
        for k in range(i + 1, count):
            factor = rows[k][i] / pivot
            for j in range(i + 1, count):
                rows[k][j] = rows[k][j] - factor * rows[i][j]
            values[k] = values[k] - factor * values[i]
    found: list[Array] = []
    for i in reversed(range(count)):
        known = sum(
            (rows[i][j] * x for j, x in zip(range(count - 1, i, -1), found, strict=True)),
            start=jnp.zeros(()),
        )
        found.append((values[i] - known) / rows[i][i])
    return Definite(jnp.stack(found[::-1]) if found else right, definite)
