"""Roots of a characteristic function of which it is known how many lie below a point."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

Scalar = Float[Array, ""]

_CLOSE = 1e-12  # relative width of the bracket in which a root has been caught
_NEARLY = 100.0  # times that width, to which rounding may spoil the function
_FIRST_STRIDE = 0.003
_APART = 1e-9  # relative distance from which on two points give a slope


class Counted(NamedTuple):
    """A root, and the evidence that it is the wanted one."""

    root: Scalar
    lower: Scalar  # fewer than `number` roots lie below here,
    upper: Scalar  # and at least `number` below here
    converged: Bool[Array, ""]
    steps: Int[Array, ""]


class _BracketState(NamedTuple):
    x: Scalar
    earlier: Float[Array, "2 2"]  # the two points before x, apart from each other: x and value
    slope: Scalar
    refined: Scalar  # x after one step to the zero of the function
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
    pole can be taken for the wanted one; the function, whose slope is that of the parabola
    through the last three points, only chooses the next point.
    The root is returned when the bracket is closed on it, to 1e-12, and never before. Where it
    is not `wanted`, as in a failed lane of a batch, nothing is done and the guess returned.
    """

    def body(state: _BracketState) -> _BracketState:
        here, below = value(state.x)
        slope, earlier = _through(state.x, here, state)
        newton = jnp.where(slope == 0, jnp.inf, -here / jnp.where(slope == 0, 1.0, slope))
        newton = jnp.where(here == 0, 0.0, newton)
        over = below >= number
        lower = jnp.where(over, state.lower, state.x)
        upper = jnp.where(over, state.x, state.upper)
        refined = jnp.clip(state.x + newton, lower, upper)
        seen = state._replace(
            earlier=earlier, slope=slope, refined=refined, lower=lower, upper=upper
        )
        return _moved(seen, newton, over)

    def open_(state: _BracketState) -> Bool[Array, ""]:
        return state.upper - state.lower > 4 * _CLOSE * state.x

    def unfinished(state: _BracketState) -> Bool[Array, ""]:
        return wanted & open_(state) & (state.steps < max_steps)

    zero, endless = jnp.zeros_like(guess), jnp.full_like(guess, jnp.inf)
    stride = jnp.full_like(guess, _FIRST_STRIDE)
    nowhere = jnp.array([[jnp.inf, 0.0], [-jnp.inf, 0.0]], guess.dtype)
    start = _BracketState(guess, nowhere, zero, guess, zero, endless, endless, stride, jnp.array(0))
    end = jax.lax.while_loop(unfinished, body, start)
    root = jnp.clip(end.refined, end.lower, end.upper)
    root = jnp.where(open_(end), guess, root)
    return Counted(root, end.lower, end.upper, ~open_(end), end.steps)


def _moved(state: _BracketState, newton: Scalar, over: Bool[Array, ""]) -> _BracketState:
    """The step to the next point, from an end of the bracket, the upper one if `over`."""
    x, lower, upper = state.x, state.lower, state.upper
    close = _CLOSE * x
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
    stride = jnp.where(bracketed, state.stride, 4.0 * state.stride)
    towards = jnp.where(against, jnp.inf, stepped)
    looking = x + jnp.where(over, -1.0, 1.0) * jnp.minimum(
        jnp.where(jnp.abs(newton) <= limit, 1.5 * jnp.abs(newton) + close, limit), limit
    )
    # An end of the bracket may be the root itself, and a step point past it; next to it is
    # the next point then.
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
    # After a bisection a step to anywhere in the bracket is progress, and as the first one there.
    last = jnp.where(inside | over_it, jnp.abs(trial - x), 1.01 * (upper - lower))
    last = jnp.where(bracketed, last, jnp.inf)
    return state._replace(x=trial, last=last, stride=stride, steps=state.steps + 1)


def _through(x: Scalar, here: Scalar, state: _BracketState) -> tuple[Scalar, Float[Array, "2 2"]]:
    """Slope at x of the parabola through x and the two points before it, and those to keep.

    A point at infinity leaves the chord of the others, or, with both there, the slope 0. Points too
    close that rounding spoils their slope are not taken.
    """
    (x1, f1), (x2, f2) = state.earlier
    apart = jnp.abs(x - x1) > _APART * x

    def chord(dx: Array, df: Array) -> Array:
        return df / jnp.where(dx == 0, jnp.inf, dx)

    first, across, before = (
        chord(x - x1, here - f1),
        chord(x - x2, here - f2),
        chord(x1 - x2, f1 - f2),
    )
    bent = jnp.where(jnp.abs(x - x2) > _APART * x, across - before, 0.0)
    now = jnp.stack([jnp.stack([x, here]), state.earlier[0]])
    return jnp.where(apart, first + bent, state.slope), jnp.where(apart, now, state.earlier)


def counted_derivative(
    value: Callable[[Scalar, Any], Scalar], args: Any, root: Scalar, repeated: Bool[Array, ""]
) -> Scalar:
    """`root`, with its derivative by `args` through `value(root, args)` = 0.

    Of a double root each of the two gets half the derivative of their sum, which is the one
    that exists: -value_xp/value_xx, the slopes taken between two points close by, to 1e-10.
    """
    return _held_root(args, root, repeated, value=value)


@eqx.filter_custom_jvp
def _held_root(args: Any, root: Array, repeated: Bool[Array, ""], *, value: Callable) -> Array:
    return root


@_held_root.def_jvp
def _held_root_jvp(
    primals: tuple[Any, ...], tangents: tuple[Any, ...], *, value: Callable
) -> tuple[Any, Any]:
    args, root, repeated = primals
    # As it follows from the arguments, for those who differentiate this rule in turn.
    root = _held_root(args, root, repeated, value=value)
    sides = jnp.array([1.0, -1.0])

    def residual(arguments: Any) -> Array:
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
