"""A small convex quadratic program whose rows may be violated at a price.

    minimize d.B d/2 + g.d + price * sum(max(0, c + J d))   subject to   least <= d <= greatest

By a primal-dual interior-point method, whose only factorization is that of a matrix of the size of
d. It always has a solution, which is what a step of sequential quadratic programming needs: J.
Nocedal and S. Wright, Numerical Optimization (2006), sections 16.6 and 18.5. The same operations
are done whatever the numbers, so that a batch of programs is one program under `vmap`.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from beltjax.compiling.batched_loops import in_lanes_of

Vector = Float[Array, " n"]
Rows = Float[Array, " m"]

_CENTER = (0.02, 0.3)  # of the mean complementarity, least and greatest: where a step aims
_SHORT = 0.995  # of the way to the nearest bound
_NEAR = 1e-14  # mean complementarity, relative to the first one, at which the search ends
_REFINEMENTS = 3  # of the solution, once it is known what holds it
_STIFF = 1e4  # weight of the rows that hold, beside the curvature of the objective
_STEPS = 30
_ROUNDING = 1e-12


class QuadraticProgram(NamedTuple):
    """The numbers of one program."""

    B: Float[Array, "n n"]  # positive definite
    g: Vector
    J: Float[Array, "m n"]
    c: Rows
    least: Vector
    greatest: Vector
    price: Float[Array, ""]


class QuadraticSolution(NamedTuple):
    """A minimum, and the multipliers of the rows, from 0 to the price."""

    d: Vector
    multipliers: Rows


class _InteriorPoint(NamedTuple):
    """A point inside of all bounds; s is the violation paid for, z the slack of a row with it."""

    d: Vector
    s: Rows
    z: Rows
    of_z: Rows  # multipliers
    of_s: Rows
    of_least: Vector
    of_greatest: Vector


class _State(NamedTuple):
    """A point on the way."""

    at: _InteriorPoint
    left: Float[Array, ""]  # mean complementarity
    aim: Float[Array, ""]  # share of it to which the next step goes
    steps: Int[Array, ""]


def solve_quadratic_program(of: QuadraticProgram) -> QuadraticSolution:
    """The minimum of a program whose bounds leave room on both sides."""
    n, m = len(of.g), len(of.c)
    d = 0.5 * (of.least + of.greatest)
    short = of.c + of.J @ d
    s = jnp.maximum(short, 0.0) + 1.0
    half = jnp.full(m, 0.5) * of.price
    begin = _InteriorPoint(d, s, s - short, half, half, jnp.ones(n), jnp.ones(n))
    first = _complementarity(begin, of)
    # The products of each row's entries, of which every step takes a weighted sum.
    one, other = np.tril_indices(n)
    products = (of.J[:, one] * of.J[:, other]).T
    places = np.zeros((n, n), int)
    places[one, other] = places[other, one] = np.arange(len(one))

    def unfinished(state: _State) -> Bool[Array, ""]:
        return (state.steps < _STEPS) & (state.left > _NEAR * (1.0 + first))

    def step(state: _State) -> _State:
        at, left, aim, steps = state

        def weighted(weight: Rows) -> Float[Array, "n n"]:
            return (products @ weight)[places]

        moved, length = _step(at, aim * left, of, weighted)
        # Where rounding has spoilt a step, the point before it is the best there is.
        good = jnp.all(jnp.isfinite(moved.d)) & jnp.all(jnp.isfinite(moved.of_z))
        moved = jax.tree.map(lambda fresh, old: jnp.where(good, fresh, old), moved, at)
        steps = jnp.where(good, steps + 1, _STEPS)
        return _State(
            moved, _complementarity(moved, of), jnp.clip((1 - length) ** 2, *_CENTER), steps
        )

    start = _State(begin, first, jnp.array(_CENTER[1]), jnp.array(0))
    found = jax.lax.while_loop(unfinished, step, in_lanes_of(of.g, start)).at
    plain = QuadraticSolution(jnp.clip(found.d, of.least, of.greatest), found.of_z)
    return _refined(found, plain, of, products, places)


def _refined(
    at: _InteriorPoint,
    plain: QuadraticSolution,
    of: QuadraticProgram,
    products: Float[Array, "pairs m"],
    places: np.ndarray,
) -> QuadraticSolution:
    """The solution to rounding, by the method of multipliers on the rows and bounds that hold.

    Close to the solution an interior point tells which these are, but is itself inaccurate. Where
    it tells wrongly, the refined multipliers have a wrong sign, and the `plain` solution stays.
    """
    pays, low = at.of_s < at.s, at.of_least > at.d - of.least
    holds, high = ~pays & (at.of_z > at.z), at.of_greatest > of.greatest - at.d
    free = jnp.where(low | high, 0.0, 1.0)
    d = jnp.where(low, of.least, jnp.where(high, of.greatest, at.d))
    y = jnp.where(pays, of.price, jnp.where(holds, at.of_z, 0.0))
    size = jnp.trace(of.B) / jnp.maximum(jnp.max(jnp.sum(of.J**2, axis=1), initial=0.0), 1e-300)
    weight = jnp.where(holds, _STIFF * size, 0.0)
    matrix = (of.B + (products @ weight)[places]) * free[:, None] * free + jnp.diag(1 - free)
    stiff = _factored(matrix)
    for _ in range(_REFINEMENTS):
        slope = of.B @ d + of.g + (y + weight * (of.c + of.J @ d)) @ of.J
        d = d - _solved(stiff, free * slope)
        y = y + weight * (of.c + of.J @ d)
    slope, row = of.B @ d + of.g + y @ of.J, of.c + of.J @ d
    allowed = 1e-9 * (1.0 + jnp.max(jnp.abs(of.g)))
    right = jnp.all((y >= -allowed) & (y <= of.price + allowed))
    right = right & jnp.all(jnp.where(holds, jnp.abs(row), jnp.where(pays, -row, row)) <= 1e-9)
    right = right & jnp.all(jnp.where(low, slope, jnp.where(high, -slope, 0.0)) >= -allowed)
    right = right & jnp.all((d >= of.least - _ROUNDING) & (d <= of.greatest + _ROUNDING))
    fine = QuadraticSolution(jnp.clip(d, of.least, of.greatest), jnp.clip(y, 0.0, of.price))
    return jax.tree.map(lambda a, b: jnp.where(right, a, b), fine, plain)


def _complementarity(at: _InteriorPoint, of: QuadraticProgram) -> Float[Array, ""]:
    products = at.z @ at.of_z + at.s @ at.of_s
    products = products + (at.d - of.least) @ at.of_least + (of.greatest - at.d) @ at.of_greatest
    return products / (2 * (len(at.d) + len(at.s)))


def _step(
    at: _InteriorPoint,
    aim: Float[Array, ""],
    of: QuadraticProgram,
    weighted: Callable[[Rows], Float[Array, "n n"]],
) -> tuple[_InteriorPoint, Float[Array, ""]]:
    """Newton's step towards products that all equal `aim`, and the shorter of its two lengths.

    `weighted` sums the products of the rows' entries.
    """
    below, above = at.d - of.least, of.greatest - at.d
    # s, z and their multipliers are eliminated. A row's equations, c + J d = s - z and that its
    # multipliers add up to the price, hold from the start on and at every step.
    give = at.s / at.of_s
    s_first = aim / at.of_s - at.s
    stiff = at.z + at.of_z * give
    weight = at.of_z / stiff
    row = (aim - at.of_z * (at.z + s_first)) / stiff
    low, high = at.of_least / below, at.of_greatest / above
    matrix = of.B + weighted(weight) + jnp.diag(low + high)
    right = aim / below - aim / above - of.B @ at.d - of.g - (at.of_z + row) @ of.J
    d = _solved(_factored(matrix), right)
    moved = of.J @ d
    of_z = row + weight * moved
    s = s_first + give * of_z
    move = _InteriorPoint(
        d=d,
        s=s,
        z=s - moved,
        of_z=of_z,
        of_s=-of_z,
        of_least=aim / below - at.of_least - low * d,
        of_greatest=aim / above - at.of_greatest + high * d,
    )
    primal = _length((below, above, at.s, at.z), (d, -d, move.s, move.z))
    dual = _length(
        (at.of_z, at.of_s, at.of_least, at.of_greatest),
        (move.of_z, move.of_s, move.of_least, move.of_greatest),
    )
    lengths = _InteriorPoint(primal, primal, primal, *(dual,) * 4)
    there = jax.tree.map(lambda x, dx, length: x + length * dx, at, move, lengths)
    return there, jnp.minimum(primal, dual)


def _length(values: tuple[Array, ...], moves: tuple[Array, ...]) -> Float[Array, ""]:
    """How far all values may move and stay positive, at most 1."""
    x, dx = jnp.concatenate(values), jnp.concatenate(moves)
    reach = jnp.where(dx < 0, -x / jnp.where(dx < 0, dx, -1.0), jnp.inf)
    return jnp.minimum(1.0, _SHORT * jnp.min(reach))


class _Factors(NamedTuple):
    """L D L' of a positive definite matrix."""

    columns: list[Vector]
    pivots: list[Float[Array, ""]]


def _factored(matrix: Float[Array, "n n"]) -> _Factors:
    """Factors of a positive definite matrix, column by column, as vector operations on lanes."""
    columns, pivots = [], []
    # A pivot that rounding leaves of a column stands for a direction in which nothing moves.
    least = 1e-15 * jnp.diagonal(matrix)
    for j in range(len(matrix)):
        pivot = jnp.maximum(matrix[j, j], least[j])
        column = matrix[:, j] / pivot
        matrix = matrix - pivot * jnp.outer(column, column)
        columns.append(column)
        pivots.append(pivot)
    return _Factors(columns, pivots)


def _solved(factors: _Factors, right: Vector) -> Vector:
    """The solution of equations whose matrix has these factors."""
    columns, pivots = factors
    x, n = right, len(right)
    for j in range(n - 1):
        x = x.at[j + 1 :].add(-columns[j][j + 1 :] * x[j])
    x = x / jnp.stack(pivots)
    for j in reversed(range(n - 1)):
        x = x.at[j].add(-columns[j][j + 1 :] @ x[j + 1 :])
    return x
