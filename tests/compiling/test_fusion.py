"""Bounded fusion: the same numbers from a program in which little is computed twice."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from beltjax.compiling.fusion import with_bounded_fusion
from beltjax.compiling.quick import quick_options, quickly_compiled

STEPS = 12


def much_used(x):
    """Each value of a chain is used by three more, so that unbounded copies would multiply."""
    kept = []
    for _ in range(STEPS):
        x = jnp.roll(x, 1) * x + jnp.cos(x) * 0.1 + jnp.where(x > 0, x, 0.5)
        kept.append(jnp.sum(x))
    return [jnp.stack(kept), x]


def looped(x):
    def body(carry, k):
        return carry + jax.jit(lambda y: jnp.sin(y) * y + y**2)(x) * k, jnp.sum(carry)

    end, sums = jax.lax.scan(body, x, jnp.arange(5.0))
    least = jax.lax.while_loop(lambda y: jnp.sum(y) > 1, lambda y: y * 0.5 - y**2 * 0.01, end)
    return [jax.lax.cond(jnp.sum(x) > 0, jnp.sin, jnp.cos, least), sums]


def derived(x):
    matrix = jnp.eye(3) * 3 + jnp.outer(x, x)
    return [jax.jacrev(lambda m: jnp.linalg.cholesky(m))(matrix), jax.grad(jnp.sum)(x)]


def unfolded(function):
    return jax.jit(function, compiler_options=quick_options())


def operations(function, x):
    return unfolded(function).lower(x).compile().as_text().count(" = ")


@pytest.mark.parametrize("function", [much_used, looped, derived])
def test_numbers_stay(function):
    x = jnp.array([0.3, -0.2, 0.5])
    found = unfolded(with_bounded_fusion(function))(x)
    for bounded, plain in zip(found, jax.jit(function)(x), strict=True):
        np.testing.assert_allclose(bounded, plain, rtol=1e-13)


@pytest.mark.skipif(jax.default_backend() != "cpu", reason="of XLA's compiler for CPUs")
def test_little_is_computed_twice():
    x = jnp.array([0.3, -0.2, 0.5])
    assert operations(with_bounded_fusion(much_used), x) < 0.5 * operations(much_used, x)


def test_static_parts_pass_through():
    @quickly_compiled
    def answer(x, words, *, power):
        return {"value": x**power, "words": (*words, "more"), "nothing": None}

    found = answer(jnp.arange(3.0), ("some",), power=2)
    np.testing.assert_array_equal(found["value"], [0.0, 1.0, 4.0])
    assert found["words"] == ("some", "more")
    assert found["nothing"] is None
