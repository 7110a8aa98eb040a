"""Sequential quadratic programming as a function of its own, for any smooth problem."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Int

from beltjax.compiling.batched_loops import in_lanes_of

from .sl1qp import (
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


class Minimum(NamedTuple):
    """Where a search ended, and the evidence."""

    x: Any  # as the start
    objective: Scalar
    multipliers: Rows  # of constraints, then of equalities
    stationarity: Scalar  # largest component of the Lagrangian's gradient that no bound holds
    violation: Scalar  # the largest
    complementarity: Scalar  # largest multiplier times distance from its limit
    steps: Int[Array, ""]  # evaluations, of which the first is that of the start
    converged: Bool[Array, ""]


def sqp(
    objective: Callable[[Point], Scalar],
    constraints: Callable[[Point], Any] | None,
    start: Point,
    *,
    equalities: Callable[[Point], Any] | None = None,
    least: Point | None = None,
    greatest: Point | None = None,
    tol: float = 1e-9,
    max_steps: int = 200,
    radius: float = 1.0,
    second_derivatives: bool = True,
) -> Minimum:
    """The minimum of a smooth function under smooth constraints, from one start.

    Under `vmap` every start is a lane of one program. Scale the variables so that a change of
    `radius` is moderate; the objective and the constraints so that they are of order one.

    Args:
        objective: the function to minimize, of a pytree of real numbers.
        constraints: what must be 0 or less, as an array or a pytree of arrays; or None.
        start: the pytree from which to search.
        equalities: what must be 0, likewise; or None.
        least: the least values, as `start`; None where there are none.
        greatest: the greatest values, likewise.
        tol: the residual of the conditions of an optimum, relative to the objective's gradient
            where that is large.
        max_steps: evaluations, after which a search ends without having converged.
        radius: the largest change of a variable in the first step.
        second_derivatives: whether to take the exact second derivatives, by which steps are fewer;
            without them updates stand for them, which cost less where there are many variables.

    Returns:
        The minimum, with its multipliers and the residuals of its conditions.

    Examples:
        >>> def circle(x):
        ...     return jnp.sum(x**2) - 2.0
        >>> bj.optimize.sqp(jnp.sum, circle, jnp.array([1.0, 0.5])).x  # -1, -1
    """
    flat, back = ravel_pytree(jax.tree.map(lambda x: jnp.asarray(x, float), start))
    inside = Bounds(_flat(least, flat, -jnp.inf), _flat(greatest, flat, jnp.inf))

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
        return ~s.stopped & (s.steps < max_steps)

    begin = in_lanes_of(x, first_iterate(x, rows, radius))
    end = jax.lax.while_loop(unfinished, lambda s: next_iterate(by, s), begin)
    at_most = len(end.multipliers) - 2 * equal
    up, down = end.multipliers[at_most : at_most + equal], end.multipliers[at_most + equal :]
    return Minimum(
        x=back(end.x),
        objective=end.at.f,
        multipliers=jnp.concatenate([end.multipliers[:at_most], up - down]),
        stationarity=end.stationarity,
        violation=end.violation,
        complementarity=end.complementarity,
        steps=end.steps,
        converged=end.done,
    )


def _flat(bound: Any, like: Vector, missing: float) -> Vector:
    if bound is None:
        return jnp.full_like(like, missing)
    return ravel_pytree(jax.tree.map(lambda x: jnp.asarray(x, float), bound))[0]


def _rows(function: Callable[[Any], Any] | None, point: Any) -> Rows:
    if function is None:
        return jnp.zeros(0)
    return ravel_pytree(function(point))[0]
