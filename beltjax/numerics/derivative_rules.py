"""Derivatives: of few numbers taken once, of failures none."""

import functools
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero, zero_from_primal
from jaxtyping import Array, Bool, Float

Scalar = Float[Array, ""]
Numbers, Found = TypeVar("Numbers"), TypeVar("Found")


def frozen_unless(good: Bool[Array, ""], numbers: Numbers) -> Numbers:
    """`numbers`, whose floating-point arrays carry no derivative unless `good`.

    Of a computation that may fail, freeze what comes out and what goes in: the first stops
    tangents that are not finite, the second cotangents.
    """

    def freeze(leaf: Any) -> Any:
        if not eqx.is_inexact_array(leaf):
            return leaf
        return jnp.where(good, leaf, jax.lax.stop_gradient(leaf))

    return jax.tree.map(freeze, numbers)


def without_slopes(function: Callable[[Numbers], Found]) -> Callable[[Numbers], Found]:
    """`function`, whose results count as constants.

    Of a search whose answer gets its derivatives elsewhere. To stop what goes in would not do: in
    a batch that runs in turn JAX makes zeros of absent tangents, and takes them through each step.
    """
    held = jax.custom_jvp(function)

    @held.defjvp
    def rule(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
        found = held(*primals)
        return found, jax.tree.map(zero_from_primal, found)

    return held


def with_own_slopes(function: Callable[..., Float[Array, " m"]]) -> Callable[..., Array]:
    """`function` of scalars, with the same values and derivatives.

    Its slopes by each of its arguments are taken once, forward. Every derivative is then their
    product with a few numbers: forward by any number of directions, or in reverse, where nothing
    inside of `function` is transposed. By arguments that are constants no slopes are taken.
    """
    # Jitted, both are traced once, however many loops and derivatives they occur in.
    held = jax.custom_jvp(jax.jit(function))

    @functools.partial(jax.jit, static_argnums=0)
    def with_slopes(moving: tuple[int, ...], *primals: Array) -> tuple[Array, Array]:
        def along(*moved: Array) -> Array:
            arguments = list(primals)
            for k, value in zip(moving, moved, strict=True):
                arguments[k] = value
            return function(*arguments)

        def push(row: Array) -> tuple[Array, Array]:
            return jax.jvp(along, tuple(primals[k] for k in moving), tuple(row))

        return jax.vmap(push, out_axes=(None, 0))(jnp.eye(len(moving)))

    def rule(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
        moving = [k for k, tangent in enumerate(tangents) if type(tangent) is not SymbolicZero]
        value, slopes = with_slopes(tuple(moving), *primals)
        steps = jnp.stack([tangents[k] for k in moving])
        return value, jnp.sum(slopes * steps[:, None], axis=0)

    held.defjvp(rule, symbolic_zeros=True)
    return held


@jax.custom_jvp
def without_derivative(numbers: Any) -> Any:
    """`numbers`, whose derivatives are NaN rather than silently wrong."""
    return numbers


@without_derivative.defjvp
def _without_derivative_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
    return *primals, jax.tree.map(lambda tangent: jnp.nan * tangent, *tangents)


def differentiated_once(numbers: Numbers) -> Numbers:
    """`numbers` with their first derivatives; all second ones are NaN."""
    arrays, rest = eqx.partition(numbers, eqx.is_inexact_array)
    return eqx.combine(_differentiated_once(arrays), rest)


@jax.custom_jvp
def _differentiated_once(arrays: Numbers) -> Numbers:
    return arrays


@_differentiated_once.defjvp
def _differentiated_once_jvp(
    primals: tuple[Any, ...], tangents: tuple[Any, ...]
) -> tuple[Any, Any]:
    (arrays,), (moved,) = primals, tangents
    return arrays, jax.tree.map(lambda x, t: _one(x) * t, arrays, moved)


@jax.custom_jvp
def _one(x: Array) -> Array:
    """1, whose derivative by x is NaN."""
    return jnp.ones_like(x)


@_one.defjvp
def _one_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
    return _one(*primals), jnp.nan * tangents[0]
