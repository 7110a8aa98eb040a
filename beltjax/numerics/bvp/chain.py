"""Linear equations along a chain of nodes: almost block diagonal, with conditions at both ends.

    A_i y_i + B_i y_{i+1} + E_i p = g_i    i = 0 .. N-1        (n equations a link)
    C_a y_0 + C_b y_N + C_p p = g_c                            (n + k conditions)

Two neighboring links are merged into one by eliminating the node between them: an orthogonal
transformation of [B_i; A_{i+1}] leaves n equations that hold that node and n that do not. This
is stable whatever the growth along the chain (Wright, 1992), takes conditions that do not
separate, and costs O(N). Links are merged in about sqrt(N) groups side by side, then the groups:
the chain is sequential, but most of the work runs across groups (and across a batch). Both
rounds run through one compiled loop.
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.numerics.small_matrices import (
    identity,
    inverse,
    matmul,
    matvec,
    orthogonalize,
    solve_triangle,
)


class ChainLinks(NamedTuple):
    """Equations between neighboring nodes, one link a lane."""

    A: Float[Array, "n n lanes"]
    B: Float[Array, "n n lanes"]
    E: Float[Array, "n k lanes"]


class ChainEnds(NamedTuple):
    """Coefficients of the conditions."""

    A: Float[Array, "m n"]
    B: Float[Array, "m n"]
    P: Float[Array, "m k"]


class Merges(NamedTuple):
    """The factors of each merge that apply to right-hand sides; the leading axis is the step."""

    rows: Float[Array, "steps 2n 2n lanes"]  # [top; bottom], of [g_i; g_{i+1}]
    first: Float[Array, "steps n n lanes"]  # middle node = top g - first y_0 - last y_{i+1} - par p
    last: Float[Array, "steps n n lanes"]
    par: Float[Array, "steps n k lanes"]


class ChainFactor(NamedTuple):
    """A factored chain."""

    rounds: Merges  # stacked: within the groups, then of the groups
    ends: Float[Array, "m+n m+n 1"]  # inverse of the equations for y_0, y_N and p


def group_size(links: int) -> int:
    """Number of links per group, and of groups: the least whose square is at least `links`."""
    return math.isqrt(max(links, 1) - 1) + 1


def factor_chain(links: ChainLinks, ends: ChainEnds) -> ChainFactor:
    """Eliminate every node but the two ends."""
    n, k, N = links.E.shape
    side = group_size(N)
    # Links that only pass the last node's value on fill the last group, and the second round.
    unit = identity(n, links.A[:, :, :1])
    idle = ChainLinks(-unit, unit, jnp.zeros((n, k, 1), unit.dtype))

    def grouped(x: Array, fill: Array) -> Array:
        spare = jnp.broadcast_to(fill, (*x.shape[:2], side * side - N))
        x = jnp.concatenate([x, spare], axis=2).reshape(*x.shape[:2], side, side)
        return jnp.moveaxis(x, -1, 0)

    def once(links: ChainLinks, _: None) -> tuple[ChainLinks, Merges]:
        merged, merges = merge_links(links)
        onwards = ChainLinks(*(_as_sequence(x, fill) for x, fill in zip(merged, idle, strict=True)))
        return onwards, merges

    start = ChainLinks(*(grouped(x, fill) for x, fill in zip(links, idle, strict=True)))
    merged, rounds = jax.lax.scan(once, start, None, length=2)
    top = jnp.concatenate([x[0, ..., 0] for x in merged], axis=1)
    matrix = jnp.concatenate([top, jnp.concatenate(ends, axis=1)])
    # Conditions come in any units: rows of size one let the pivoting compare them.
    size = jnp.max(jnp.abs(matrix), axis=1, keepdims=True)
    size = jnp.where(size > 0, size, 1.0)
    return ChainFactor(rounds, inverse((matrix / size)[..., None]) / size.T[..., None])


def _as_sequence(x: Array, fill: Array) -> Array:
    """Merged links, one a lane, as a sequence in the first lane; idle links in the others."""
    x = jnp.moveaxis(x, -1, 0)[..., None]
    spare = jnp.broadcast_to(fill, (*x.shape[:-1], x.shape[0] - 1))
    return jnp.concatenate([x, spare], axis=-1)


def solve_chain(
    factor: ChainFactor, g: Float[Array, "n N"], conditions: Float[Array, " m"]
) -> tuple[Float[Array, "n N+1"], Float[Array, " k"]]:
    """(y, p) of a factored chain."""
    n, N = g.shape
    side = group_size(N)
    g = jnp.pad(g, ((0, 0), (0, side * side - N))).reshape(n, side, side)
    zero = jnp.zeros((n, 1), g.dtype)

    def reduce(g: Array, merges: Merges) -> tuple[Array, Array]:
        g, tops = carry_forward(merges, g)
        return _as_sequence(g, zero), tops

    g, tops = jax.lax.scan(reduce, jnp.moveaxis(g, -1, 0), factor.rounds)
    solved = matvec(factor.ends, jnp.concatenate([g[0, :, :1], conditions[:, None]]))
    first, last, p = solved[:n], solved[n : 2 * n], solved[2 * n :]

    def expand(known: Array, given: tuple[Any, ...]) -> tuple[Array, Array]:
        # Nodes between which each lane's merged link lies, to those of its own links.
        merges, tops = given
        left, right = known[:, :-1], known[:, 1:]
        middle = carry_back(merges, tops, left, right, p)
        inside = jnp.moveaxis(jnp.concatenate([left[None], middle]), 0, -1)  # [n, lane, link]
        # Only the second round, done first, has its links in one lane; the other lanes idle.
        return jnp.concatenate([inside[:, 0], right[:, :1]], axis=1), inside

    idle = jnp.broadcast_to(last, (n, side))
    start = jnp.concatenate([first, idle], axis=1)
    _, inside = jax.lax.scan(expand, start, (factor.rounds, tops), reverse=True)
    y = jnp.concatenate([inside[0].reshape(n, side * side), last], axis=1)
    return y[:, : N + 1], p[:, 0]


def merge_links(links: ChainLinks) -> tuple[ChainLinks, Merges]:
    """Merge the links of a sequence (leading axis) into one, lane by lane."""
    n = links.A.shape[1]

    def step(acc: ChainLinks, following: ChainLinks) -> tuple[ChainLinks, Merges]:
        q, r = orthogonalize(jnp.concatenate([acc.B, following.A]))
        top = solve_triangle(r, q[:n])
        rows = jnp.concatenate([top, q[n:]])
        first = matmul(rows[:, :n], acc.A)
        last = matmul(rows[:, n:], following.B)
        par = matmul(rows[:, :n], acc.E) + matmul(rows[:, n:], following.E)
        merged = ChainLinks(first[n:], last[n:], par[n:])
        return merged, Merges(rows, first[:n], last[:n], par[:n])

    start = ChainLinks(*(x[0] for x in links))
    return jax.lax.scan(step, start, ChainLinks(*(x[1:] for x in links)))


def carry_forward(merges: Merges, g: Float[Array, "steps+1 n lanes"]) -> tuple[Array, Array]:
    """Right-hand sides (of the merged link, of each middle node) for those of the links."""
    n = g.shape[1]

    def step(acc: Array, given: tuple[Any, ...]) -> tuple[Array, Array]:
        rows, following = given
        both = matvec(rows, jnp.concatenate([acc, following]))
        return both[n:], both[:n]

    return jax.lax.scan(step, g[0], (merges.rows, g[1:]))


def carry_back(merges: Merges, tops: Array, y_first: Array, y_last: Array, p: Array) -> Array:
    """The middle nodes, from the nodes at the merged link's ends and p."""
    known = tops - jnp.sum(merges.first * y_first, axis=2) - jnp.sum(merges.par * p, axis=2)

    def step(y_next: Array, given: tuple[Any, ...]) -> tuple[Array, Array]:
        last, known = given
        y = known - matvec(last, y_next)
        return y, y

    _, middle = jax.lax.scan(step, y_last, (merges.last, known), reverse=True)
    return middle
