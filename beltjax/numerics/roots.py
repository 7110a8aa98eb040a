"""Roots of small systems: searched with safeguards, differentiated at the equations.

A search (`increasing_root`, `bracketed_root`, `system_root`) finds a root and is never
differentiated: hand it arguments without derivatives. `implicit_root` gives a root found in any
way its derivative, forward and reverse and to any order, by one linear solve with the converged
equations, and `implicit_solution` what follows from the root, too. Between the two a caller can
replace what failed by something harmless, so that no lane of a batch disturbs its neighbors.

The linear solves are done here, not by LAPACK: a call a lane is slow under `vmap`, and can hang
XLA's thread pool on few cores.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from beltjax.compiling.batched_loops import in_lanes_of
from beltjax.numerics.small_matrices import inverse

Scalar = Float[Array, ""]
Vector = Float[Array, " n"]
Rest = TypeVar("Rest")


class Search(NamedTuple):
    """Where a search ended, and the evidence."""

    root: Array
    residual: Array  # at the last point but one, from which the last step was taken
    converged: Bool[Array, ""]
    steps: Int[Array, ""]


def solve_dense(matrix: Float[Array, "n n"], right: Vector) -> Vector:
    """Solution of a few linear equations; of two, finite also if they are singular."""
    if right.size == 2:
        (a, b), (c, d) = matrix
        determinant = a * d - b * c
        numerator = jnp.stack([d * right[0] - b * right[1], a * right[1] - c * right[0]])
        return numerator / jnp.where(determinant == 0, 1.0, determinant)
    return _eliminated(matrix, right) if right.size <= _FEW else inverse(matrix) @ right


_FEW = 6  # equations up to which unrolled elimination compiles sooner than a loop


def _eliminated(matrix: Float[Array, "n n"], right: Vector) -> Vector:
    """The solution by Gauss-Jordan elimination with row pivoting, unrolled; linear in `right`."""
    places, used = jnp.arange(right.size), jnp.zeros(right.size, bool)
    pivots = []
    for i in range(right.size):
        column = matrix[:, i]
        here = places == jnp.argmax(jnp.where(used, -1.0, jnp.abs(column)))
        pivot = jnp.sum(jnp.where(here, column, 0.0))
        row = jnp.sum(jnp.where(here[:, None], matrix, 0.0), axis=0) / pivot
        value = jnp.sum(jnp.where(here, right, 0.0)) / pivot
        matrix = jnp.where(here[:, None], row, matrix - column[:, None] * row)
        right = jnp.where(here, value, right - column * value)
        used = used | here
        pivots.append(here)
    # Row r_i now holds unknown i.
    return jnp.sum(jnp.where(jnp.stack(pivots), right, 0.0), axis=1)


def increasing_root(
    residual: Callable[[Scalar], Scalar],
    lower: Scalar,
    guess: Scalar,
    *,
    least_slope: Scalar | float = 0.0,
    tol: float = 1e-9,
    max_steps: int = 80,
) -> Search:
    """The root above `lower` of a function that changes sign at most once, from minus to plus.

    Newton's method, kept inside the bracket found so far; a step out of it is replaced by
    half the way back. Where the function is known to rise by `least_slope` at least, each of its
    values brackets the root from both sides. The last step taken is below `tol` relative to the
    root, so that the error, being quadratic in it, is at rounding. If the function is positive
    everywhere the search ends at `lower` with a positive residual.
    """

    def body(state: tuple[Any, ...]) -> tuple[Any, ...]:
        x, low, high, _, _, steps = state
        value, slope = jax.jvp(residual, (x,), (jnp.ones_like(x),))
        reach = x - value / least_slope if bounded else x
        low = jnp.where(value < 0, x, jnp.maximum(low, reach) if bounded else low)
        high = jnp.where(value >= 0, x, jnp.minimum(high, reach) if bounded else high)
        step = -value / jnp.where(slope == 0, 1.0, slope)
        retreat = jnp.where(step < 0, 0.5 * (low - x), jnp.minimum(0.5 * (high - x), 1e3))
        inside = (x + step >= low) & (x + step <= high) & (slope > 0)
        # At the root itself the bracket closes on x and no step stays strictly inside it.
        small = jnp.abs(step) <= tol * (1.0 + jnp.abs(x))
        step = jnp.where(inside | small, step, retreat)
        done = jnp.abs(step) <= tol * (1.0 + jnp.abs(x))
        return x + step, low, high, value, done, steps + 1

    def unfinished(state: tuple[Any, ...]) -> Bool[Array, ""]:
        *_, done, steps = state
        return ~done & (steps < max_steps)

    bounded = not (isinstance(least_slope, float) and least_slope == 0.0)
    high = jnp.full_like(lower, jnp.inf)
    start = (guess, lower, high, jnp.zeros_like(guess), jnp.array(False), jnp.array(0))
    x, _, _, value, done, steps = jax.lax.while_loop(unfinished, body, start)
    return Search(x, value, done, steps)


def bracketed_root(
    residual: Callable[[Scalar], Scalar],
    lower: Scalar,
    upper: Scalar,
    *,
    tol: float = 1e-13,
    max_steps: int = 80,
) -> Search:
    """A root between `lower`, where the function is negative, and `upper`, where it is not.

    Newton's method; a step out of the bracket found so far is replaced by half of it.
    """

    def body(state: tuple[Any, ...]) -> tuple[Any, ...]:
        x, low, high, _, _, steps = state
        value, slope = jax.jvp(residual, (x,), (jnp.ones_like(x),))
        low, high = jnp.where(value < 0, x, low), jnp.where(value < 0, high, x)
        after = x - value / jnp.where(slope > 0, slope, jnp.inf)
        inside = (slope > 0) & (after > low) & (after < high)
        # At the root itself the bracket closes on x and no step stays strictly inside it.
        small = (slope > 0) & (jnp.abs(after - x) <= tol * (jnp.abs(x) + upper - lower))
        after = jnp.where(inside | small, after, (low + high) / 2)
        done = small | (high - low <= tol * (upper - lower))
        return after, low, high, value, done, steps + 1

    def unfinished(state: tuple[Any, ...]) -> Bool[Array, ""]:
        *_, done, steps = state
        return ~done & (steps < max_steps)

    middle = (lower + upper) / 2
    start = (middle, lower, upper, jnp.zeros_like(middle), jnp.array(False), jnp.array(0))
    x, _, _, value, done, steps = jax.lax.while_loop(unfinished, body, in_lanes_of(middle, start))
    return Search(x, value, done, steps)


def system_root(
    residual: Callable[[Vector], Vector],
    guess: Vector,
    largest_step: Vector,
    *,
    tol: float = 1e-9,
    max_steps: int = 60,
    wanted: Bool[Array, ""] | None = None,
) -> Search:
    """A root of a few equations near `guess`, by Newton's method with limited, damped steps.

    Where it is not `wanted`, nothing is computed, and the search has not converged.

    No component moves by more than its `largest_step` at once. A step after which the same
    Jacobian would need a longer correction than before is halved: P. Deuflhard's natural
    monotonicity test (Newton Methods for Nonlinear Problems, 2004), which does not depend on how
    the equations are scaled, so that no steep one among them holds the others up.
    """

    def value_and_jacobian(x: Array) -> Any:
        # Values and slopes in one pass: inside a loop `jax.linearize` would make it two.
        push = jax.vmap(lambda t: jax.jvp(residual, (x,), (t,)), out_axes=(None, -1))
        return push(jnp.eye(len(guess)))

    def size(correction: Array) -> Array:
        return jnp.sum((correction / largest_step) ** 2)

    def body(state: tuple[Any, ...]) -> tuple[Any, ...]:
        x, step, matrix, length, kept, _, steps = state
        value, jacobian = value_and_jacobian(x + step)
        # The step from here, and the one that the Jacobian before would take: one solver for both.
        newton, before = -jax.vmap(solve_dense, (0, None))(jnp.stack([jacobian, matrix]), value)
        full = size(newton)
        newton = newton / jnp.maximum(1.0, jnp.max(jnp.abs(newton) / largest_step))
        # Close to the root rounding decides which correction is the longer.
        small = jnp.max(jnp.abs(newton)) <= tol
        better = (size(before) < length) | small
        x = jnp.where(better, x + step, x)
        matrix = jnp.where(better, jacobian, matrix)
        length = jnp.where(better, full, length)
        kept = jnp.where(better, value, kept)
        step = jnp.where(better, newton, 0.5 * step)
        return x, step, matrix, length, kept, small, steps + 1

    def unfinished(state: tuple[Any, ...]) -> Bool[Array, ""]:
        _, step, _, _, _, done, steps = state
        going = ~done & (steps < max_steps) & jnp.all(jnp.isfinite(step))
        return going if wanted is None else going & wanted

    nothing, unit = jnp.zeros_like(guess), jnp.eye(len(guess))
    start = (guess, nothing, unit, jnp.array(jnp.inf), nothing, jnp.array(False), jnp.array(0))
    start = in_lanes_of(guess, start)
    x, step, _, _, value, done, steps = jax.lax.while_loop(unfinished, body, start)
    return Search(jnp.where(done, x + step, x), value, done, steps)


def followed_root(
    residual: Callable[[Vector, Scalar], Vector],
    guess: Vector,
    origin: Vector,
    largest_step: Vector,
    *,
    smallest_load: float = 1 / 64,
    max_steps: int = 25,
) -> tuple[Search, Scalar]:
    """A root of `residual(x, 1)`: at once if `system_root` finds it, else by following `load`.

    The second argument rises from 0, where `guess` is close to a root, in steps that are halved
    where the search fails and doubled where it does not; one below `smallest_load` is given up.
    Where not even a first step succeeds, all is tried once more from `origin`, if that is another.
    Gives the load reached too; `steps` counts those of all searches.
    """

    def body(state: tuple[Any, ...]) -> tuple[Any, ...]:
        last, load, step, steps, untried = state
        found = system_root(
            lambda x: residual(x, load + step), last.root, largest_step, max_steps=max_steps
        )
        steps = steps + found.steps
        good = found.converged & jnp.all(jnp.isfinite(found.root))
        kept = last._replace(residual=found.residual, converged=jnp.array(False))
        last = jax.tree.map(lambda a, b: jnp.where(good, a, b), found, kept)
        load = jnp.where(good, load + step, load)
        step = jnp.minimum(jnp.where(good, 2 * step, step / 2), 1 - load)
        anew = untried & (load == 0) & (step < smallest_load)
        last = last._replace(root=jnp.where(anew, origin, last.root))
        return last, load, jnp.where(anew, 1.0, step), steps, untried & ~anew

    def unfinished(state: tuple[Any, ...]) -> Bool[Array, ""]:
        _, load, step, *_ = state
        return (load < 1) & (step >= smallest_load)

    nothing = Search(guess, jnp.zeros_like(guess), jnp.array(False), jnp.array(0))
    start = (nothing, jnp.zeros(()), jnp.ones(()), jnp.array(0), jnp.any(origin != guess))
    start = in_lanes_of(guess, start)
    last, load, _, steps, _ = jax.lax.while_loop(unfinished, body, start)
    return last._replace(converged=last.converged & (load >= 1), steps=steps), load


def implicit_root(residual: Callable[[Array, Any], Array], args: Any, root: Array) -> Array:
    """`root`, a scalar or a vector, differentiated with respect to `args` through `residual`.

    `residual(root, args)` must vanish; its derivative at the root is the only thing used.
    """

    def keep(_: Any, start: Any) -> Any:
        return start

    return jax.lax.custom_root(
        lambda x: residual(x, args), jax.lax.stop_gradient(root), keep, _solve_linear
    )


def implicit_solution(
    function: Callable[[Vector, Any], tuple[Vector, Rest]], args: Any, root: Vector
) -> tuple[Vector, Rest]:
    """`root` and `rest` of `function(root, args)` = (residual, rest), as functions of `args`.

    The same as `implicit_root` and a second call of the function at the root, but one
    linearization serves both: for a long function, of which less is compiled.
    """
    return _solution(args, jax.lax.stop_gradient(root), function=function)


@eqx.filter_custom_jvp
def _solution(args: Any, root: Array, *, function: Callable) -> Any:
    return root, function(root, args)[1]


@_solution.def_jvp
def _solution_jvp(
    primals: tuple[Any, ...], tangents: tuple[Any, ...], *, function: Callable
) -> tuple[Any, Any]:
    args, root = primals
    value, shift, change = _moved(args, root, tangents[0], function)
    return value, (shift, change)


@eqx.filter_custom_jvp
def _root_alone(args: Any, root: Array, *, function: Callable) -> Array:
    return root


@_root_alone.def_jvp
def _root_alone_jvp(
    primals: tuple[Any, ...], tangents: tuple[Any, ...], *, function: Callable
) -> tuple[Array, Array]:
    args, root = primals
    (root, _), shift, _ = _moved(args, root, tangents[0], function)
    return root, shift


def _moved(args: Any, root: Array, moved: Any, function: Callable) -> tuple[Any, Array, Any]:
    """Root and rest, and by how much both move with the arguments."""
    # As it follows from the arguments, for those who differentiate this rule in turn.
    root = _root_alone(args, root, function=function)
    moves = jax.tree.map(lambda x: x is not None, moved, is_leaf=lambda x: x is None)
    numbers, others = eqx.partition(args, moves)
    still = jax.tree.map(jnp.zeros_like, moved)

    def at(root: Array, numbers: Any) -> Any:
        residual, rest = function(root, eqx.combine(numbers, others))
        rest, other_rest = eqx.partition(rest, eqx.is_inexact_array)
        return (residual, rest), other_rest

    (_, rest), push, other_rest = jax.linearize(at, root, numbers, has_aux=True)
    columns, by_root = jax.vmap(lambda row: push(row, still), out_axes=-1)(jnp.eye(len(root)))
    forced, change = push(jnp.zeros_like(root), moved)
    shift = -solve_dense(columns, forced)
    change = jax.tree.map(lambda x, slopes: x + slopes @ shift, change, by_root)
    return (root, eqx.combine(rest, other_rest)), shift, change


def _solve_linear(linear: Callable[[Array], Array], right: Array) -> Array:
    if right.ndim == 0:
        slope = linear(jnp.ones_like(right))
        return right / jnp.where(slope == 0, 1.0, slope)
    return solve_dense(jax.vmap(linear, out_axes=-1)(jnp.eye(len(right))), right)


class _Bracket(NamedTuple):
    """A place below which a value is negative and one above which it is not; what is left to do."""

    low: Scalar
    bottom: Scalar
    high: Scalar
    top: Scalar
    closed: Bool[Array, ""]  # whether both are found
    latest: Int[Array, ""]  # which moved last: 1 the upper, -1 the lower, 0 none
    tried: Int[Array, ""]
    refined: Int[Array, ""]


def first_upcrossing(
    value: Callable[[Scalar], Scalar],
    tried: Float[Array, " points"],
    *,
    one_by_one: bool = False,
    refinements: int = 16,
) -> tuple[Scalar, Bool[Array, ""]]:
    """The first place among increasing `tried` ones at which `value` rises above 0, and whether.

    Their values are taken at once or, where each is long to find, `one_by_one` until one is above
    0; the place 0 stands before them, where the value is taken to be negative. Then secants are
    drawn between a place below and one above, the end that stays being given less weight so that
    both move (the method of M. Dowell and P. Jarratt, 1972).
    """
    count = len(tried)

    def refined(at: _Bracket, middle: Scalar, found: Scalar) -> _Bracket:
        up = found > 0
        was = jnp.where(up, at.top, at.bottom)  # of the end that is replaced
        again = at.latest == jnp.where(up, 1, -1)
        less = jnp.where(again, was / jnp.where(was + found == 0, 1.0, was + found), 1.0)
        there = found == 0  # both ends are the root then
        return at._replace(
            low=jnp.where(up & ~there, at.low, middle),
            bottom=jnp.where(up, less * at.bottom, found),
            high=jnp.where(up | there, middle, at.high),
            top=jnp.where(up | there, found, less * at.top),
            refined=at.refined + 1,
            latest=jnp.where(up, 1, -1),
        )

    def between(at: _Bracket) -> Scalar:
        width = at.top - at.bottom
        secant = (at.low * at.top - at.high * at.bottom) / jnp.where(width == 0, 1.0, width)
        inside = (secant >= at.low) & (secant <= at.high)
        return jnp.where(inside, secant, (at.low + at.high) / 2)

    def met(at: _Bracket, place: Scalar, found: Scalar) -> _Bracket:
        up = found > 0
        # Nothing is known of the value at 0: as far below as that of the first point is above.
        bottom = jnp.where(at.tried == 0, -found, at.bottom)
        return at._replace(
            low=jnp.where(up, at.low, place), bottom=jnp.where(up, bottom, found),
            high=place, top=found, closed=up, tried=at.tried + 1,
        )  # fmt: skip

    def step(at: _Bracket) -> _Bracket:
        place = jnp.where(at.closed, between(at), tried[jnp.minimum(at.tried, count - 1)])
        found = value(place)
        one, other = refined(at, place, found), met(at, place, found)
        return jax.tree.map(lambda a, b: jnp.where(at.closed, a, b), one, other)

    def unfinished(at: _Bracket) -> Bool[Array, ""]:
        return jnp.where(at.closed, at.refined < refinements, at.tried < count)

    zero, none = jnp.zeros(()), jnp.array(0)
    start = _Bracket(zero, zero, zero, zero, jnp.array(False), none, none, none)
    if not one_by_one:
        values = jax.vmap(value)(tried)
        place = jnp.argmax(values > 0)
        before = jnp.maximum(place - 1, 0)
        start = start._replace(
            low=jnp.where(place == 0, 0.0, tried[before]),
            bottom=jnp.where(place == 0, -values[0], values[before]),
            high=tried[place], top=values[place], closed=jnp.any(values > 0),
            tried=jnp.array(count),
        )  # fmt: skip
    end = jax.lax.while_loop(unfinished, step, in_lanes_of(tried, start))
    return between(end), end.closed
