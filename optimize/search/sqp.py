"""Sequential quadratic programming as a function of its own, for any smooth problem."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Int

from beltjax.compiling.batched_loops import in_lanes_of
from beltjax.results import RESULTS, first_failure

from .sl1qp import (
    LARGEST_PRICE,
    Bounds,
    Method,
    Rows,
    Scalar,
    SequentialIterate,
    Vector,
    curvature_of,
    first_iterate,
    next_iterate,
    slopes_of,
)

Point = TypeVar("Point")


class Solution(NamedTuple):
    """Where a search ended, and the evidence."""

    x: Any  # as the start
    objective: Scalar
    multipliers: Rows  # of constraints, then of equalities
    residual: Scalar  # the largest of the three below; infinite where the start has no value
    stationarity: Scalar  # largest component of the Lagrangian's gradient that no bound holds
    violation: Scalar  # the largest
    complementarity: Scalar  # largest multiplier times distance from its limit
    iterations: Int[Array, ""]  # evaluations, of which the first is that of the start
    result: RESULTS


def sqp(
    objective: Callable[[Point], Scalar],
    constraints: Callable[[Point], Any] | None,
    start: Point,
    *,
    equalities: Callable[[Point], Any] | None = None,
    lower: Point | None = None,
    upper: Point | None = None,
    tol: float = 1e-9,
    max_iterations: int = 200,
    radius: float = 1.0,
    second_derivatives: bool = True,
) -> Solution:
    """The minimum of a smooth function under smooth constraints, from one start.

    Under `vmap` every start is a lane of one program. Scale the variables so that a change of
    `radius` is moderate; the objective and the constraints so that they are of order one.

    Args:
        objective: the function to minimize, of a pytree of real numbers.
        constraints: what must be 0 or less, as an array or a pytree of arrays; or None.
        start: the pytree from which to search.
        equalities: what must be 0, likewise; or None.
        lower: the least values, as `start`; None where there are none.
        upper: the greatest values, likewise.
        tol: the residual of the conditions of an optimum, relative to the objective's gradient
            where that is large.
        max_iterations: evaluations, after which a search ends without having converged.
        radius: the largest change of a variable in the first step.
        second_derivatives: whether to take the exact second derivatives, by which steps are fewer;
            without them updates stand for them, which cost less where there are many variables.

    Returns:
        The minimum, with its multipliers, the residuals of its conditions, and in `result` whether
        they are met: else `equations_nonfinite` where there is no value at the start,
        `constraints_infeasible` where no small change lowers the violation, or
        `optimum_not_reached`. It raises nothing.

    Examples:
        >>> def circle(x):
        ...     return jnp.sum(x**2) - 2.0
        >>> bj.optimize.sqp(jnp.sum, circle, jnp.array([1.0, 0.5])).x  # -1, -1
    """
    flat, back = ravel_pytree(jax.tree.map(lambda x: jnp.asarray(x, float), start))
    inside = Bounds(_flat(lower, flat, -jnp.inf), _flat(upper, flat, jnp.inf))

    def evaluate(x: Vector) -> tuple[Scalar, Rows, Bool[Array, ""]]:
        point = back(x)
        at_most = _rows(constraints, point)
        equal = _rows(equalities, point)
        return objective(point), jnp.concatenate([at_most, equal, -equal]), jnp.array(True)

    curvature = curvature_of(evaluate) if second_derivatives else None
    equal = len(_rows(equalities, start))
    rows = len(_rows(constraints, start)) + 2 * equal
    x = jnp.clip(flat, *inside)
    sizes = jnp.maximum(jnp.abs(x), 1.0)
    by = Method(slopes_of(evaluate), inside, radius, tol, curvature, sizes, equal)

    def unfinished(s: SequentialIterate) -> Bool[Array, ""]:
        return ~s.stopped & (s.steps < max_iterations)

    begin = in_lanes_of(x, first_iterate(x, rows, radius))
    end = jax.lax.while_loop(unfinished, lambda s: next_iterate(by, s), begin)
    at_most = len(end.multipliers) - 2 * equal
    up, down = end.multipliers[at_most : at_most + equal], end.multipliers[at_most + equal :]
    hopeless = end.stopped | (end.price >= LARGEST_PRICE)
    residuals = end.stationarity, end.violation, end.complementarity
    return Solution(
        x=back(end.x),
        objective=end.at.f,
        multipliers=jnp.concatenate([end.multipliers[:at_most], up - down]),
        residual=jnp.max(jnp.stack(residuals)),
        stationarity=end.stationarity,
        violation=end.violation,
        complementarity=end.complementarity,
        iterations=end.steps,
        result=first_failure(
            (~end.at.valid, RESULTS.equations_nonfinite),
            (~end.done & hopeless & (end.violation > tol), RESULTS.constraints_infeasible),
            (~end.done, RESULTS.optimum_not_reached),
        ),
    )


def _flat(bound: Any, like: Vector, missing: float) -> Vector:
    if bound is None:
        return jnp.full_like(like, missing)
    return ravel_pytree(jax.tree.map(lambda x: jnp.asarray(x, float), bound))[0]


def _rows(function: Callable[[Any], Any] | None, point: Any) -> Rows:
    if function is None:
        return jnp.zeros(0)
    return ravel_pytree(function(point))[0]
