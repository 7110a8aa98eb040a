"""GMRES with a fixed number of directions: the same products for every lane of a batch."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from beltjax.compiling.batched_loops import in_lanes_of

Vector = Float[Array, " n"]
_TINY = 1e-300


def gmres(
    product: Callable[[Vector], Vector],
    right: Vector,
    directions: int,
    tol: float = 1e-3,
    cycles: int = 1,
) -> Vector:
    """The x for which A x is `right` to `tol` of its size, or as close as the cycles lead.

    Y. Saad and M. H. Schultz (1986), begun anew after so many `directions`. `product` is A x, of a
    matrix close to 1. Lineax's method of that name took ten times as long in a batch.
    """

    def unfinished(state: tuple[Array, Array, Array]) -> Bool[Array, ""]:
        _, left, cycle = state
        far = jnp.linalg.norm(left) > tol * jnp.linalg.norm(right)
        return far & (cycle < cycles)

    def improve(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        x, left, cycle = state
        x = x + _best_in_space(product, left, directions)
        return x, right - product(x), cycle + 1

    start = jnp.zeros_like(right), right, jnp.array(0)
    return jax.lax.while_loop(unfinished, improve, in_lanes_of(right, start))[0]


def _best_in_space(product: Callable[[Vector], Vector], right: Vector, directions: int) -> Vector:
    """The x in the Krylov space of `right` that leaves the least of A x = right."""
    size = jnp.linalg.norm(right)
    basis = jnp.zeros((directions + 1, len(right))).at[0].set(right / (size + _TINY))

    def extend(basis: Array, k: Array) -> tuple[Array, Vector]:
        new = product(basis[k])
        # Twice, since once leaves the directions orthogonal to half of the digits.
        first = basis @ new
        new = new - first @ basis
        second = basis @ new
        new = new - second @ basis
        length = jnp.linalg.norm(new)
        # Where nothing is left the space holds the solution, and what follows is zero.
        kept = jnp.where(length > _ROUNDING * jnp.linalg.norm(first), new / (length + _TINY), 0.0)
        column = (first + second).at[k + 1].set(length)
        return basis.at[k + 1].set(kept), column

    basis, columns = jax.lax.scan(extend, in_lanes_of(right, basis), jnp.arange(directions))
    hessenberg = columns.T  # [directions + 1, directions]
    along = jnp.zeros(directions + 1).at[0].set(size)
    Q, R = jnp.linalg.qr(hessenberg)
    diagonal = jnp.abs(jnp.diag(R))
    # Directions that are zero count nothing.
    R = R + jnp.diag(jnp.where(diagonal > _ROUNDING * jnp.max(diagonal), 0.0, jnp.inf))
    weights = jax.scipy.linalg.solve_triangular(R, along @ Q)
    return weights @ basis[:-1]


_ROUNDING = 1e-14
