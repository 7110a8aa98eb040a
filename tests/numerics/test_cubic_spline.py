"""The spline against SciPy's, and its order up to the ends."""

import jax
import jax.numpy as jnp
import numpy as np
import scipy.interpolate

from beltjax.numerics.cubic_spline import cubic_spline


def test_spline_is_that_of_scipy_with_the_same_slopes_at_the_ends():
    x = np.array([0.0, 0.4, 0.5, 1.1, 1.3, 2.0])
    y = np.array([1.0, -0.3, 0.2, 0.9, 0.4, 2.0])
    # A cubic through four data has its slope at the end.
    ends = [
        np.polyder(np.poly1d(np.polyfit(x[k], y[k], 3)))(x[at])
        for k, at in ((slice(4), 0), (slice(2, 6), 5))
    ]
    exact = scipy.interpolate.CubicSpline(x, y, bc_type=[(1, ends[0]), (1, ends[1])])
    at = np.linspace(0, 2, 41)
    found = jax.vmap(cubic_spline(jnp.asarray(x), jnp.asarray(y)).at)(jnp.asarray(at))
    expected = [exact.antiderivative()(at), *(exact(at, order) for order in range(3))]
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-11)


def test_errors_of_value_and_second_derivative_fall_by_their_orders():
    def errors(count):
        x = jnp.linspace(0.0, 3.0, count)
        at = jnp.linspace(0.0, 3.0, 1000)
        _, value, _, second = jax.vmap(cubic_spline(x, jnp.sin(x)).at)(at)
        return np.abs(value - jnp.sin(at)).max(), np.abs(second + jnp.sin(at)).max()

    coarse, fine = errors(40), errors(80)
    assert coarse[0] / fine[0] > 14
    assert coarse[1] / fine[1] > 3.6


def test_derivative_by_the_data():
    x = jnp.linspace(0.0, 1.0, 6)

    def value(y):
        return cubic_spline(x, y).at(jnp.asarray(0.37))[1]

    y = jnp.cos(3 * x)
    slope = jax.grad(value)(y)
    # The spline is linear in its data.
    assert abs(slope @ y - value(y)) < 1e-14
