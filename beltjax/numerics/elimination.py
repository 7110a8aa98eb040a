"""Gaussian elimination of large matrices, which in a batch go one after the other.

XLA shares the members of a batch of matrices among its threads, and the thread that does so waits.
Two such calls at the same time may have no thread left, and wait for ever (jaxlib 0.10). One matrix
is taken apart in the thread that asks for it; of large ones hardly anything is lost.
"""

import functools
from typing import NamedTuple

import jax
from jax.custom_batching import sequential_vmap
from jaxtyping import Array, Float, Int


class Eliminated(NamedTuple):
    """A matrix taken apart, for many solutions."""

    matrix: Float[Array, "n n"]
    lu: Float[Array, "n n"]
    pivots: Int[Array, " n"]

    def solve(self, right: Float[Array, " n"], transposed: bool = False) -> Float[Array, " n"]:
        """The solution for one right side, with its derivatives by that."""
        matrix = self.matrix.T if transposed else self.matrix
        one, other = _back(transposed), _back(not transposed)
        return jax.lax.custom_linear_solve(
            lambda x: matrix @ x,
            right,
            lambda _, b: one(self.lu, self.pivots, b),
            lambda _, b: other(self.lu, self.pivots, b),
        )


def eliminated(matrix: Float[Array, "n n"]) -> Eliminated:
    """`matrix` taken apart, which counts as a constant."""
    fixed = jax.lax.stop_gradient(matrix)
    return Eliminated(fixed, *_factors(fixed))


@sequential_vmap
def _factors(matrix: Array) -> tuple[Array, Array]:
    return jax.scipy.linalg.lu_factor(matrix)


@functools.cache
def _back(transposed: bool):
    @sequential_vmap
    def solve(lu: Array, pivots: Array, right: Array) -> Array:
        return jax.scipy.linalg.lu_solve((lu, pivots), right, trans=int(transposed))

    return solve
