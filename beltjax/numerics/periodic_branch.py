"""Periodic orbits along a parameter, past folds: continuation by arc length.

H. B. Keller's pseudo-arclength method: the unknowns are the orbit's coefficients and the parameter,
and the last equation says how far the next point lies along the last direction. Coefficients count
in a typical size of theirs, the parameter in a tenth of its range.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from beltjax.compiling.batched_loops import in_lanes_of
from beltjax.numerics.harmonic_balance import Coefficients, Oscillator, jacobian, residual

Scalar = Float[Array, ""]
Vector = Float[Array, " n"]


class Point(NamedTuple):
    """A point of a branch, and the direction of the branch there; both in units of `Units`."""

    place: Vector  # flat coefficients, then the parameter
    direction: Vector


class Corrected(NamedTuple):
    """A point found from a guess, and the evidence."""

    point: Point
    converged: Bool[Array, ""]
    steps: Int[Array, ""]


class Units(NamedTuple):
    """In what a branch's unknowns count."""

    coefficients: Scalar
    parameter: Scalar


_TOL, _MOST_STEPS = 1e-9, 8


def corrected(
    system: Callable[[Any, Scalar], Oscillator],
    args: Any,
    units: Units,
    samples: int,
    shape: tuple[int, ...],
    guess: Vector,
    along: Vector,
) -> Corrected:
    """The point of the branch of `system(args, parameter)` in the plane across `along` at `guess`.

    Its direction points as `along` does.
    """
    count = shape[0] * shape[1]

    def equations(place: Vector) -> Vector:
        X = units.coefficients * place[:count].reshape(shape)
        return residual(system(args, units.parameter * place[count]), X, samples).ravel()

    def bordered(place: Vector) -> Float[Array, "n n"]:
        X = units.coefficients * place[:count].reshape(shape)
        at = system(args, units.parameter * place[count])
        square = units.coefficients * jacobian(at, X, samples)
        moved = jnp.zeros_like(place).at[count].set(1.0)
        column = jax.jvp(equations, (place,), (moved,))[1]
        return jnp.concatenate([jnp.column_stack([square, column]), along[None]])

    def body(state: tuple[Any, ...]) -> tuple[Any, ...]:
        place, _, before, _, steps = state
        matrix = bordered(place)
        right = jnp.append(equations(place), along @ (place - guess))
        last = jnp.zeros_like(place).at[count].set(1.0)
        step, direction = -jnp.linalg.solve(matrix, jnp.stack([right, -last], axis=1)).T
        length = jnp.linalg.norm(step)
        place = place + step
        done = length <= _TOL * jnp.linalg.norm(place)
        shrinks = length < 0.7 * before
        return place, direction, jnp.where(shrinks, length, jnp.nan), done, steps + 1

    def unfinished(state: tuple[Any, ...]) -> Bool[Array, ""]:
        _, _, length, done, steps = state
        return ~done & (length == length) & (steps < _MOST_STEPS)

    start = (guess, along, jnp.array(jnp.inf), jnp.array(False), jnp.array(0))
    place, direction, _, done, steps = jax.lax.while_loop(
        unfinished, body, in_lanes_of(guess, start)
    )
    direction = direction / jnp.linalg.norm(direction)
    good = done & jnp.all(jnp.isfinite(place)) & jnp.all(jnp.isfinite(direction))
    return Corrected(Point(place, direction), good, steps)


class Walk(NamedTuple):
    """A branch as far as it was followed."""

    points: list[Point]
    folds: list[int]  # places in `points` of those at which the parameter turns back
    complete: bool  # it left the range, and was not given up


_LARGEST, _SMALLEST = 1.0, 1e-4  # steps
_SHARPEST = 0.85  # least cosine between directions that follow each other
_REFINEMENTS = 4


def walked(
    correct: Callable[[Vector, Vector], Corrected],
    start: Point,
    step: float,
    ends: tuple[float, float],
    most: int,
) -> Walk:
    """Follow a branch from `start` until the parameter leaves `ends`, on the host.

    `correct(guess, along)` is `corrected` with the rest filled in. Steps grow while few
    corrections do, and shrink where they fail or the branch turns. At most `most` points.
    """
    points, folds = [start], []
    while len(points) < most:
        here = points[-1]
        found = correct(here.place + step * here.direction, here.direction)
        cosine = float(found.point.direction @ here.direction)
        if not (bool(found.converged) and cosine > _SHARPEST):
            step /= 2
            if step < _SMALLEST:
                return Walk(points, folds, False)
            continue
        rates = float(here.direction[-1]), float(found.point.direction[-1])
        if rates[0] * rates[1] < 0:
            fold = _fold(correct, here, found.point, step)
            if fold is not None:
                folds.append(len(points))
                points.append(fold)
        points.append(found.point)
        if not ends[0] <= float(found.point.place[-1]) <= ends[1]:
            return Walk(points, folds, True)
        if int(found.steps) <= 4:
            step = min(1.4 * step, _LARGEST)
    return Walk(points, folds, False)


def _fold(
    correct: Callable[[Vector, Vector], Corrected], here: Point, there: Point, step: float
) -> Point | None:
    """The point between two at which the parameter turns back, by the secant of its rate."""
    low, high = 0.0, step
    rates = float(here.direction[-1]), float(there.direction[-1])
    best = None
    for _ in range(_REFINEMENTS):
        middle = low + (high - low) * rates[0] / (rates[0] - rates[1])
        found = correct(here.place + middle * here.direction, here.direction)
        if not bool(found.converged):
            return best
        best, rate = found.point, float(found.point.direction[-1])
        if rate * rates[0] > 0:
            low, rates = middle, (rate, rates[1])
        else:
            high, rates = middle, (rates[0], rate)
    return best


def doublings(products: Float[np.ndarray, " points"]) -> list[int]:
    """Places after which the product of (1 + multiplier) changes its sign: the period doubles."""
    return np.flatnonzero(products[:-1] * products[1:] < 0).tolist()


def start_of(X: Coefficients, parameter: Scalar, units: Units) -> Vector:
    """The place of an orbit, in the units of its branch."""
    return jnp.append(X.ravel() / units.coefficients, parameter / units.parameter)
