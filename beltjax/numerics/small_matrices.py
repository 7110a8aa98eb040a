"""Dense algebra on many small blocks at once, for CPU vector units and GPU alike.

A block array has shape [rows, columns, ..., lanes]: the block's own indices lead and the many
blocks trail, so that every operation is elementwise along the lanes. No call leaves for LAPACK:
one call a block is slow under `vmap`, and can hang XLA's thread pool on few cores.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from beltjax.compiling.batched_loops import in_lanes_of

Blocks = Float[Array, "rows columns *lanes"]


_CACHED = 16384  # numbers that stay in a core's cache with their copies


def matmul(a: Blocks, b: Blocks) -> Blocks:
    """The product a b, block by block."""
    # One sum, not a term at a time: as fast once compiled, and sooner compiled.
    return jnp.sum(a[:, :, None] * b[None], axis=1)


def matvec(a: Blocks, x: Float[Array, "columns *lanes"]) -> Float[Array, "rows *lanes"]:
    """The product a x, block by block."""
    return jnp.sum(a * x, axis=1)


def mix(weights: np.ndarray, x: Float[Array, "columns *rest"]) -> Float[Array, "rows *rest"]:
    """Rows of `weights` applied to the leading axis of `x`; one row gives one result."""
    return jnp.tensordot(jnp.asarray(weights), x, 1)


def identity(n: int, like: Blocks) -> Blocks:
    """Unit blocks with the lanes of `like`."""
    eye = jnp.eye(n, dtype=like.dtype).reshape(n, n, *(1,) * (like.ndim - 2))
    return jnp.broadcast_to(eye, (n, n, *like.shape[2:]))


@jax.custom_jvp
def inverse(a: Blocks) -> Blocks:
    """The inverse by Gauss-Jordan exchange with row pivoting; a singular block gives inf or nan.

    Differentiated as an inverse, not through the elimination. Rows stay where they are: each
    lane remembers which row each step used, and one permutation at the end puts them in order.
    """
    m = a.shape[0]
    many = a.reshape(m, m, -1)
    chunk = max(64, _CACHED // m**2)
    count = -(-many.shape[2] // chunk)
    if count < 3:
        return _exchanged(a)
    # Each of the m steps visits every block: a chunk that stays in the cache keeps cost linear.
    spare = count * chunk - many.shape[2]
    many = jnp.concatenate([many, identity(m, many[:, :, :spare])], axis=2)
    chunks = jnp.moveaxis(many.reshape(m, m, count, chunk), 2, 0)
    done = jnp.moveaxis(jax.lax.map(_exchanged, chunks), 0, 2).reshape(m, m, -1)
    return done[:, :, : done.shape[2] - spare].reshape(a.shape)


def _exchanged(a: Blocks) -> Blocks:
    m = a.shape[0]
    row = jnp.arange(m).reshape(m, *(1,) * (a.ndim - 2))

    def exchange(
        k: Int[Array, ""], state: tuple[Array, Array, Array]
    ) -> tuple[Array, Array, Array]:
        a, pivots, order = state
        used = order < m
        column = jax.lax.dynamic_index_in_dim(a, k, axis=1, keepdims=False)
        best = jnp.argmax(jnp.where(used, -1.0, jnp.abs(column)), axis=0)
        here = row == best
        pivot_row = jnp.sum(jnp.where(here[:, None], a, 0.0), axis=0)
        pivot = jnp.sum(jnp.where(here, column, 0.0), axis=0)
        # The exchanged variable's own column: 1/pivot in the pivot row, -column/pivot elsewhere.
        pivot_row = jnp.where(row == k, 1.0, pivot_row) / pivot
        rest = jnp.where((row == k)[None], 0.0, a)
        swept = rest - jnp.where(here, 0.0, column)[:, None] * pivot_row[None]
        a = jnp.where(here[:, None], pivot_row[None], swept)
        pivots = jax.lax.dynamic_update_index_in_dim(pivots, best, k, axis=0)
        return a, pivots, jnp.where(here, k, order)

    none = in_lanes_of(a, jnp.full((m, *a.shape[2:]), m))
    a, pivots, order = jax.lax.fori_loop(0, m, exchange, (a, none, none))
    # Row r_k now holds unknown k in terms of right-hand sides, column j that of equation r_j.
    a = jnp.take_along_axis(a, pivots[:, None], axis=0)
    return jnp.take_along_axis(a, order[None], axis=1)


@inverse.defjvp
def _inverse_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
    (a,), (da,) = primals, tangents
    result = inverse(a)
    return result, -matmul(matmul(result, da), result)


class Orthogonal(NamedTuple):
    """Q^T a = [R; 0] of tall blocks a, with both factors explicit."""

    transposed: Blocks  # Q^T [rows, rows]
    triangle: Blocks  # R [columns, columns]


def orthogonalize(a: Blocks) -> Orthogonal:
    """QR by Householder reflections, one unrolled step a column."""
    rows, columns = a.shape[:2]
    work = jnp.concatenate([a, identity(rows, a)], axis=1)
    done = []
    for j in range(columns):
        x = work[:, j]
        norm = jnp.sqrt(jnp.sum(x**2, axis=0))
        # The sign that does not cancel.
        head = x[0] + jnp.where(x[0] < 0, -norm, norm)
        v = jnp.concatenate([head[None], x[1:]])
        size = jnp.sum(v**2, axis=0)
        scale = jnp.where(size > 0, 2.0 / jnp.where(size > 0, size, 1.0), 0.0)
        work = work - (scale * v)[:, None] * jnp.sum(v[:, None] * work, axis=0)[None]
        done.append(work[0])
        work = work[1:]
    rows_of_q = jnp.concatenate([jnp.stack(done), work])
    return Orthogonal(rows_of_q[:, columns:], rows_of_q[:columns, :columns])


def solve_triangle(upper: Blocks, right: Blocks) -> Blocks:
    """R^-1 `right` for upper triangular blocks, by unrolled back substitution."""
    n = upper.shape[0]
    rows: list[Array] = []
    for i in reversed(range(n)):
        known = sum(upper[i, j] * rows[n - 1 - j] for j in range(i + 1, n))
        rows.append((right[i] - known) / upper[i, i])
    return jnp.stack(rows[::-1])
