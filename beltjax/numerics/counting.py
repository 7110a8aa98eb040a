"""Roots of a characteristic function that can tell how many of them lie below a point."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

Scalar = Float[Array, ""]

_CLOSE = 1e-12  # relative width of the bracket in which a root has been caught
_NEARLY = 100.0  # times that width, to which rounding may spoil the function
_FIRST_STRIDE = 0.01


class Counted(NamedTuple):
    """A root, and the evidence that it is the one asked for."""

    root: Scalar
    lower: Scalar  # fewer than `number` roots lie below here,
    upper: Scalar  # and at least `number` below here
    converged: Bool[Array, ""]
    steps: Int[Array, ""]


class _State(NamedTuple):
    x: Scalar
    refined: Scalar  # x after one Newton step
    lower: Scalar
    upper: Scalar
    last: Scalar  # size of the last step, twice that of a bisection
    stride: Scalar
    steps: Int[Array, ""]


def counted_root(
    value: Callable[[Scalar], tuple[Scalar, Int[Array, ""]]],
    number: Int[Array, ""],
    guess: Scalar,
    *,
    wanted: Bool[Array, ""] | bool = True,
    max_steps: int = 120,
) -> Counted:
    """The positive root with that number, 1 for the lowest, of a function that counts them.

    `value(x)` is the function at x > 0 and the number of its roots below x, repeated ones as
    often as they repeat. The count alone moves the bracket, so neither a neighboring root nor a
    pole can be taken for the one asked for; Newton's method only chooses where to look next.
    The root is returned when the bracket is closed on it, to 1e-12, and never before. Where it
    is not `wanted`, as in a failed lane of a batch, nothing is done and the guess returned.
    """

    def body(state: _State) -> _State:
        x = state.x
        (here, below), (slope, _) = jax.jvp(value, (x,), (jnp.ones_like(x),))
        over = below >= number
        lower = jnp.where(over, state.lower, x)
        upper = jnp.where(over, x, state.upper)
        newton = -here / jnp.where(slope == 0, 1.0, slope)
        close = _CLOSE * x
        refined = jnp.clip(x + newton, lower, upper)
        # At a root the last thing to do is to step over it, so that the bracket closes. Rounding
        # may put the function's zero a little to the other side of x than the count does: then
        # twice as far, the way the count points.
        small = jnp.abs(newton) <= _NEARLY * close
        against = over != (newton < 0)
        reach = jnp.where(against, 2.0, 1.0) * jnp.abs(newton)
        stepped = jnp.where(over, -1.0, 1.0) * jnp.maximum(reach, close)
        shrinks = jnp.abs(newton) <= jnp.maximum(0.5 * state.last, close)
        bracketed = jnp.isfinite(upper) & (lower > 0)
        limit = state.stride * x
        stride = jnp.where(bracketed, state.stride, 2.0 * state.stride)
        towards = jnp.where(against, jnp.inf, stepped)
        looking = x + jnp.where(over, -1.0, 1.0) * jnp.minimum(
            jnp.where(jnp.abs(newton) <= limit, 1.5 * jnp.abs(newton) + close, limit), limit
        )
        # An end of the bracket may be the root itself, and a step point past it; next to it is
        # where to look then.
        target = x + towards
        outside = jnp.maximum(lower - target, target - upper)
        inside = (outside < jnp.maximum(_NEARLY * close, 0.1 * (upper - lower))) & shrinks
        target = jnp.clip(target, lower + close, upper - close)
        trial = jnp.where(inside, target, 0.5 * (lower + upper))
        # Towards a root that is all but reached, also when the step itself points away from it.
        over_it = (jnp.abs(newton) <= close) | (against & small)
        trial = jnp.where(over_it, jnp.clip(x + stepped, lower, upper), trial)
        trial = jnp.where(bracketed, trial, looking)
        trial = jnp.maximum(trial, 0.25 * x)
        # After a bisection a Newton step to anywhere in the bracket is progress.
        bisected = bracketed & ~inside & ~over_it
        last = jnp.where(bisected, 1.01 * (upper - lower), jnp.abs(trial - x))
        return _State(trial, refined, lower, upper, last, stride, state.steps + 1)

    def open_(state: _State) -> Bool[Array, ""]:
        return state.upper - state.lower > 4 * _CLOSE * state.x

    def unfinished(state: _State):
        return wanted & open_(state) & (state.steps < max_steps)

    zero, endless = jnp.zeros_like(guess), jnp.full_like(guess, jnp.inf)
    stride = jnp.full_like(guess, _FIRST_STRIDE)
    start = _State(guess, guess, zero, endless, endless, stride, jnp.array(0))
    end = jax.lax.while_loop(unfinished, body, start)
    root = jnp.clip(end.refined, end.lower, end.upper)
    root = jnp.where(open_(end), guess, root)
    return Counted(root, end.lower, end.upper, ~open_(end), end.steps)


def counted_derivative(
    value: Callable[[Scalar, Any], Scalar], args: Any, root: Scalar, repeated: Bool[Array, ""]
) -> Scalar:
    """`root`, with its derivative by `args` through `value(root, args)` = 0.

    Of a double root each of the two gets half the derivative of their sum, which is the one
    that exists: -value_xp/value_xx, the slopes taken between two points close by, to 1e-10.
    """
    return _held_root(args, root, repeated, value=value)


@eqx.filter_custom_jvp
def _held_root(args, root, repeated, *, value):
    return root


@_held_root.def_jvp
def _held_root_jvp(primals, tangents, *, value):
    args, root, repeated = primals
    sides = jnp.array([1.0, -1.0])

    def residual(arguments):
        x, args = arguments
        apart = jnp.where(repeated, 1e-5 * jax.lax.stop_gradient(x), 0.0)
        here, there = jax.vmap(lambda h: value(x + h, args))(apart * sides)
        return jnp.where(repeated, here - there, here)

    # One reverse pass gives every slope; what is left to transpose is a sum.
    by_root, by_args = eqx.filter_grad(residual)((root, args))
    parts = jax.tree.map(
        lambda slope, tangent: None if tangent is None else jnp.sum(slope * tangent),
        by_args,
        tangents[0],
        is_leaf=lambda leaf: leaf is None,
    )
    change = sum(jax.tree.leaves(parts), jnp.zeros(()))
    return root, -change / jnp.where(by_root == 0, 1.0, by_root)
