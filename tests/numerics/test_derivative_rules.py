"""A function whose slopes are taken once has the same derivatives as it would have otherwise."""

import jax
import jax.numpy as jnp
import numpy as np

from beltjax.numerics.derivative_rules import with_own_slopes


def plain(x, y, z):
    def twice(_, pair):
        return pair[0] * jnp.sin(pair[1]), pair[0] + pair[1] * y

    a, b = jax.lax.fori_loop(0, 5, twice, (x, z))
    return jnp.stack([a, b, a * b])


def mixed(function):
    """The function in a larger program, where y is a constant to whoever differentiates."""

    def value(p):
        return jnp.sum(function(p[0] ** 2, 0.7, p[0] * p[1]) ** 2) + p[1]

    return value


def test_every_derivative_is_that_of_the_plain_function():
    p = jnp.array([0.9, -1.3])
    own, other = mixed(with_own_slopes(plain)), mixed(plain)
    np.testing.assert_allclose(own(p), other(p), rtol=1e-14)
    for slopes in (jax.jacfwd, jax.jacrev, jax.hessian):
        np.testing.assert_allclose(slopes(own)(p), slopes(other)(p), rtol=1e-12)
    many = jnp.stack([p, 2 * p])
    np.testing.assert_allclose(
        jax.vmap(jax.grad(own))(many), jax.vmap(jax.grad(other))(many), rtol=1e-12
    )


def test_by_constants_no_slopes_are_taken():
    def rough(x, y):
        # Its slope by y at 0 is not finite.
        return jnp.stack([x * jnp.sqrt(y)])

    assert jax.grad(lambda x: with_own_slopes(rough)(x, 0.0)[0])(2.0) == 0.0
