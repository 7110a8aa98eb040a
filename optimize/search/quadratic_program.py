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

_CENTER = (1e-6, 0.5)  # of the mean complementarity, least and greatest: where a step aims
_SHORT = 0.995  # of the way to the nearest bound
_NEAR = 1e-14  # mean complementarity, relative to the first one, at which the search ends
_REFINEMENTS = 3  # of the solution, once it is known what holds it
_STIFF = 1e4  # weight of the rows that hold, beside the curvature of the objective
_STEPS = 30
_ROUNDS = 6  # of rows chosen
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


class _Products(NamedTuple):
    """Numbers times their multipliers, each of which vanishes at the minimum."""

    of_z: Rows
    of_s: Rows
    of_least: Vector
    of_greatest: Vector


class _Working(NamedTuple):
    """A solution with some of the rows."""

    solution: QuadraticSolution
    order: Rows  # the greater, the sooner a row is chosen
    unmet: Bool[Array, " m"]  # which rows count as not met where they are left out
    changed: Bool[Array, ""]  # whether a row that was left out has changed sign
    rounds: Int[Array, ""]


class _State(NamedTuple):
    """A point on the way."""

    at: _InteriorPoint
    left: Float[Array, ""]  # mean complementarity
    steps: Int[Array, ""]


def solve_quadratic_program(of: QuadraticProgram) -> QuadraticSolution:
    """The minimum of a program whose bounds leave room on both sides.

    Of many rows only a few change sign close to a minimum. The others are met, and count nothing,
    or are not, and count as linear terms. So the program is solved with those few alone, and again
    with others until none of those left out has changed sign; if that does not end, with all.
    """
    n, m = len(of.g), len(of.c)
    count = n + 4
    if m <= 2 * count:
        return _solved_with_all(of)
    sizes = jnp.sum(jnp.abs(of.J), axis=1)
    sizes = jnp.where(sizes > 0, sizes, 1.0)
    least, most = _extremes(of)

    def unfinished(state: _Working) -> Bool[Array, ""]:
        return state.changed & (state.rounds < _ROUNDS)

    def again(state: _Working) -> _Working:
        place = jax.lax.top_k(state.order.astype(jnp.float32), count)[1]
        spread = place == jnp.arange(m)[:, None]
        left_out = ~jnp.any(spread, axis=1)
        paid = left_out & state.unmet
        few = of._replace(g=of.g + of.price * (paid @ of.J), J=of.J[place], c=of.c[place])
        found = _solved_with_all(few)
        multipliers = jnp.where(paid, of.price, spread @ found.multipliers)
        values = of.c + of.J @ found.d
        changed = jnp.where(state.unmet, values < -_ROUNDING, values > _ROUNDING)
        # The closer to a change of sign, the sooner a row is chosen, unless none is possible.
        order = jnp.where((least < 0) & (most > 0), -jnp.abs(values) / sizes, -jnp.inf)
        fresh = QuadraticSolution(found.d, multipliers)
        unmet = values > 0
        return _Working(fresh, order, unmet, jnp.any(left_out & changed), state.rounds + 1)

    begin = QuadraticSolution(jnp.zeros_like(of.g), jnp.zeros_like(of.c))
    # What is not met here is most likely to be met after the step.
    order = jnp.where((least < 0) & (most > 0), of.c / sizes, -jnp.inf)
    start = _Working(begin, order, of.c > 0, jnp.array(True), jnp.array(0))
    found = jax.lax.while_loop(unfinished, again, in_lanes_of(of.g, start))

    def wholly(state: _Working) -> _Working:
        # The price depends on the state, or XLA would solve the program before the loop is entered.
        priced = of._replace(price=jnp.where(state.changed, of.price, 1.0))
        return state._replace(solution=_solved_with_all(priced), changed=jnp.array(False))

    # A loop rather than a condition: in a batch it is passed over unless a lane needs it.
    return jax.lax.while_loop(lambda state: state.changed, wholly, found).solution


def _extremes(of: QuadraticProgram) -> tuple[Rows, Rows]:
    """The least and the greatest value of each row in the box."""
    low, high = of.J * of.least, of.J * of.greatest
    least, most = jnp.minimum(low, high), jnp.maximum(low, high)
    return of.c + jnp.sum(least, axis=1), of.c + jnp.sum(most, axis=1)


def _solved_with_all(of: QuadraticProgram) -> QuadraticSolution:
    """The minimum of a program, all of its rows counted."""
    begin = _beginning(of)
    first = _complementarity(begin, of)
    weighted = _weighted_products(of.J)

    def unfinished(state: _State) -> Bool[Array, ""]:
        return (state.steps < _STEPS) & (state.left > _NEAR * (1.0 + first))

    def step(state: _State) -> _State:
        at, left, steps = state
        moved = _step(at, left, of, weighted)
        # Where rounding has spoilt a step, the point before it is the best there is.
        good = jnp.all(jnp.isfinite(moved.d)) & jnp.all(jnp.isfinite(moved.of_z))
        moved = jax.tree.map(lambda fresh, old: jnp.where(good, fresh, old), moved, at)
        return _State(moved, _complementarity(moved, of), jnp.where(good, steps + 1, _STEPS))

    start = _State(begin, first, jnp.array(0))
    found = jax.lax.while_loop(unfinished, step, in_lanes_of(of.g, start)).at
    plain = QuadraticSolution(jnp.clip(found.d, of.least, of.greatest), found.of_z)
    return _refined(found, plain, of, weighted)


def _beginning(of: QuadraticProgram) -> _InteriorPoint:
    """The point inside of all bounds from which the search begins."""
    n, m = len(of.g), len(of.c)
    d = 0.5 * (of.least + of.greatest)
    short = of.c + of.J @ d
    s = jnp.maximum(short, 0.0) + 1.0
    half = jnp.full(m, 0.5) * of.price
    return _InteriorPoint(d, s, s - short, half, half, jnp.ones(n), jnp.ones(n))


def _weighted_products(J: Float[Array, "m n"]) -> Callable[[Rows], Float[Array, "n n"]]:
    """The function w -> J' diag(w) J, whose products of each row's entries are taken once."""
    one, other = np.tril_indices(J.shape[1])
    products = (J[:, one] * J[:, other]).T
    places = np.zeros((J.shape[1],) * 2, int)
    places[one, other] = places[other, one] = np.arange(len(one))
    return lambda weight: (products @ weight)[places]


def _refined(
    at: _InteriorPoint,
    plain: QuadraticSolution,
    of: QuadraticProgram,
    weighted: Callable[[Rows], Float[Array, "n n"]],
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
    matrix = (of.B + weighted(weight)) * free[:, None] * free + jnp.diag(1 - free)
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
    left: Float[Array, ""],
    of: QuadraticProgram,
    weighted: Callable[[Rows], Float[Array, "n n"]],
) -> _InteriorPoint:
    """The point after S. Mehrotra's step: a look at where all products vanish, then the step.

    The look tells how far to go at once, and what the products bend; both solve the same equations.
    """
    below, above = at.d - of.least, of.greatest - at.d
    # s, z and their multipliers are eliminated. A row's equations, c + J d = s - z and that its
    # multipliers add up to the price, hold from the start on and at every step.
    give = at.s / at.of_s
    stiff = at.z + at.of_z * give
    weight = at.of_z / stiff
    low, high = at.of_least / below, at.of_greatest / above
    factors = _factored(of.B + weighted(weight) + jnp.diag(low + high))
    slope = of.B @ at.d + of.g + at.of_z @ of.J

    def move(aims: _Products) -> _InteriorPoint:
        s_first = aims.of_s / at.of_s - at.s
        row = (aims.of_z - at.of_z * (at.z + s_first)) / stiff
        right = aims.of_least / below - aims.of_greatest / above - slope - row @ of.J
        d = _solved(factors, right)
        moved = of.J @ d
        of_z = row + weight * moved
        s = s_first + give * of_z
        return _InteriorPoint(
            d=d,
            s=s,
            z=s - moved,
            of_z=of_z,
            of_s=-of_z,
            of_least=aims.of_least / below - at.of_least - low * d,
            of_greatest=aims.of_greatest / above - at.of_greatest + high * d,
        )

    look = move(_Products(*(jnp.zeros_like(x) for x in (at.z, at.s, below, above))))
    there = _moved(at, look, _length(at, look, of, 1.0))
    aim = jnp.clip((_complementarity(there, of) / left) ** 3, *_CENTER) * left
    bent = _Products(
        look.z * look.of_z, look.s * look.of_s, look.d * look.of_least, -look.d * look.of_greatest
    )
    step = move(jax.tree.map(lambda product: aim - product, bent))
    return _moved(at, step, _length(at, step, of, _SHORT))


def _moved(at: _InteriorPoint, move: _InteriorPoint, length: Float[Array, ""]) -> _InteriorPoint:
    return jax.tree.map(lambda x, dx: x + length * dx, at, move)


def _length(
    at: _InteriorPoint, move: _InteriorPoint, of: QuadraticProgram, part: float
) -> Float[Array, ""]:
    """How far numbers and multipliers may go: 1, or that part of the way to the nearest bound.

    The same for both: a quadratic program couples them, and of different lengths steps may cycle.
    """
    below, above = at.d - of.least, of.greatest - at.d
    x = jnp.concatenate((below, above, *at[1:]))
    dx = jnp.concatenate((move.d, -move.d, *move[1:]))
    reach = jnp.where(dx < 0, -x / jnp.where(dx < 0, dx, -1.0), jnp.inf)
    return jnp.minimum(1.0, part * jnp.min(reach))


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
