"""Roots of small systems, safeguarded going forward and differentiated at the equations.

The derivative of a root comes from one linear solve with the converged equations, never from
the iterations, forward and reverse and to any order. Batches run under `vmap`: the solves are
unrolled by hand, because a LAPACK call per lane is slow and can hang XLA's thread pool on few
cores.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

Scalar = Float[Array, ""]
Pair = Float[Array, "2"]


class Root(NamedTuple):
    """A root and the evidence for it."""

    value: Array
    converged: Bool[Array, ""]
    steps: Int[Array, ""]


def solve_pair(matrix: Float[Array, "2 2"], right: Pair) -> Pair:
    """Solution of two linear equations by Cramer's rule."""
    (a, b), (c, d) = matrix
    return jnp.stack([d * right[0] - b * right[1], a * right[1] - c * right[0]]) / (a * d - b * c)


def increasing_root(
    residual: Callable[[Scalar], Scalar],
    lower: Scalar,
    guess: Scalar,
    *,
    tol: float = 1e-9,
    max_steps: int = 80,
) -> Root:
    """The root above `lower` of a scalar function that changes sign once, from minus to plus.

    Newton's method, kept inside the bracket found so far; a step out of it is replaced by
    half the way back. The last step taken is below `tol` relative to the root, so that the
    error, being quadratic in it, is at rounding. `residual(lower)` must be negative; if the
    root does not exist the search runs to `max_steps` and reports `converged` false.
    """

    def solve(function, start):
        def slope_at(x):
            return jax.jvp(function, (x,), (jnp.ones_like(x),))

        def body(state):
            x, low, high, _, steps = state
            value, slope = slope_at(x)
            low = jnp.where(value < 0, x, low)
            high = jnp.where(value >= 0, x, high)
            step = -value / jnp.where(slope == 0, 1.0, slope)
            retreat = jnp.where(step < 0, 0.5 * (low - x), jnp.minimum(0.5 * (high - x), 1e3))
            inside = (x + step > low) & (x + step < high) & (slope > 0)
            # At the root itself the bracket closes on x and no step stays strictly inside it.
            done = jnp.abs(step) <= tol * (1.0 + jnp.abs(x))
            step = jnp.where(inside | done, step, retreat)
            return x + step, low, high, done, steps + 1

        def unfinished(state):
            _, _, _, done, steps = state
            return ~done & (steps < max_steps)

        start_state = (start, lower, jnp.full_like(lower, jnp.inf), jnp.array(False), jnp.array(0))
        x, _, _, done, steps = jax.lax.while_loop(unfinished, body, start_state)
        return x, _as_evidence(done, steps)

    lower = jax.lax.stop_gradient(lower)
    return _as_root(
        *jax.lax.custom_root(residual, jax.lax.stop_gradient(guess), solve, _divide, has_aux=True)
    )


def pair_root(
    residual: Callable[[Pair], Pair],
    guess: Pair,
    largest_step: Pair,
    *,
    tol: float = 1e-9,
    max_steps: int = 60,
) -> Root:
    """A root of two equations near `guess`, by Newton's method with limited, damped steps.

    No component moves by more than its `largest_step` at once; a step that does not lower the
    residual's norm is halved. Unknowns and residuals should be scaled to order one.
    """

    def solve(function, start):
        jacobian = jax.jacfwd(function)

        def newton_step(x, value):
            step = -solve_pair(jacobian(x), value)
            excess = jnp.max(jnp.abs(step) / largest_step)
            return step / jnp.maximum(1.0, excess)

        def body(state):
            x, step, norm, _, steps = state
            value = function(x + step)
            new_norm = jnp.sum(value**2)
            # Close to the root rounding decides which norm is the smaller.
            small = jnp.max(jnp.abs(step)) <= tol
            better = (new_norm < norm) | small
            x = jnp.where(better, x + step, x)
            norm = jnp.where(better, new_norm, norm)
            step = jnp.where(better, newton_step(x, value), 0.5 * step)
            done = better & (small | (jnp.max(jnp.abs(step)) <= tol**2))
            return x, step, norm, done, steps + 1

        def unfinished(state):
            _, step, _, done, steps = state
            return ~done & (steps < max_steps) & jnp.all(jnp.isfinite(step))

        value = function(start)
        state = (
            start,
            newton_step(start, value),
            jnp.sum(value**2),
            jnp.array(False),
            jnp.array(0),
        )
        x, _, _, done, steps = jax.lax.while_loop(unfinished, body, state)
        return x, _as_evidence(done, steps)

    guess = jax.lax.stop_gradient(guess)
    return _as_root(*jax.lax.custom_root(residual, guess, solve, _solve_linear_pair, has_aux=True))


def _as_evidence(done, steps):
    # As real numbers: `custom_root` cannot differentiate past auxiliary flags and integers.
    return done.astype(float), steps.astype(float)


def _as_root(value, evidence) -> Root:
    done, steps = jax.lax.stop_gradient(evidence)
    return Root(value, done > 0, steps.astype(int))


def _divide(linear: Callable[[Scalar], Scalar], right: Scalar) -> Scalar:
    slope = linear(jnp.ones_like(right))
    return right / jnp.where(slope == 0, 1.0, slope)


def _solve_linear_pair(linear: Callable[[Pair], Pair], right: Pair) -> Pair:
    columns = [linear(unit) for unit in jnp.eye(2)]
    matrix = jnp.stack(columns, axis=-1)
    (a, b), (c, d) = matrix
    # A lane that has no root may end where the equations are singular; its derivative is
    # discarded, but must not be NaN.
    regular = (a * d - b * c) != 0
    return solve_pair(jnp.where(regular, matrix, jnp.eye(2)), right)
