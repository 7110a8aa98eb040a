"""Derivatives of a function of few numbers, taken once however many are asked for."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

Scalar = Float[Array, ""]


def with_own_slopes(function: Callable[..., Float[Array, " m"]]) -> Callable[..., Array]:
    """`function` of scalars, with the same values and derivatives.

    Its slopes by each of its arguments are taken once, forward. Every derivative is then their
    product with a few numbers: forward by any number of directions, or in reverse, where nothing
    inside of `function` is transposed. By arguments that are constants no slopes are taken.
    """
    held = jax.custom_jvp(function)

    def rule(primals, tangents):
        moving = [k for k, tangent in enumerate(tangents) if type(tangent) is not SymbolicZero]

        def along(*moved):
            arguments = list(primals)
            for k, value in zip(moving, moved, strict=True):
                arguments[k] = value
            return function(*arguments)

        def push(row):
            return jax.jvp(along, tuple(primals[k] for k in moving), tuple(row))

        value, slopes = jax.vmap(push, out_axes=(None, 0))(jnp.eye(len(moving)))
        steps = jnp.stack([tangents[k] for k in moving])
        return value, jnp.sum(slopes * steps[:, None], axis=0)

    held.defjvp(rule, symbolic_zeros=True)
    return held
