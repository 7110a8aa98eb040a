"""Monotone cubic interpolation against SciPy's, and its derivatives against differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from beltjax.numerics.monotone_cubic import interpolated

TABLES = {
    "two points": ([0.0, 2.0], [1.0, 4.0]),
    "saturating": ([1.0, 2.0, 4.0, 8.0], [0.8, 2.1, 3.0, 3.2]),
    "flat in the middle": ([0.0, 1.0, 1.5, 4.0], [0.0, 2.0, 2.0, 5.0]),
    "up and down": ([0.0, 1.0, 3.0, 3.5, 7.0], [0.0, 4.0, -1.0, 2.0, 1.9]),
    "steep end": ([0.0, 1.0, 1.1, 2.0], [0.0, 0.1, 5.0, -5.0]),
}
both = jax.jit(jax.vmap(interpolated, (0, None, None)))


@pytest.mark.parametrize("name", TABLES)
def test_values_and_slopes_are_those_of_scipy(name):
    x, y = map(np.array, TABLES[name])
    at = np.linspace(x[0], x[-1], 97)
    value, slope = both(at, x, y)
    peer = PchipInterpolator(x, y)
    np.testing.assert_allclose(value, peer(at), rtol=0, atol=1e-13)
    np.testing.assert_allclose(slope, peer(at, 1), rtol=1e-13, atol=1e-12)


def test_nothing_is_overshot():
    """Between two data the interpolant stays between them; a cubic spline would leave."""
    x, y = map(np.array, TABLES["steep end"])
    for k in range(len(x) - 1):
        value, _ = both(np.linspace(x[k], x[k + 1], 50), x, y)
        assert min(y[k], y[k + 1]) - 1e-14 <= value.min()
        assert value.max() <= max(y[k], y[k + 1]) + 1e-14


def test_derivatives_by_place_and_data():
    x, y = (jnp.array(column) for column in TABLES["saturating"])
    at = jnp.array(2.9)

    def value(at, x, y):
        return interpolated(at, x, y)[0]

    slope, of_x, of_y = jax.grad(value, (0, 1, 2))(at, x, y)
    assert float(slope) == pytest.approx(float(interpolated(at, x, y)[1]), rel=1e-14)
    step = 1e-6
    for k in range(4):
        one = step * np.eye(4)[k]
        by_x = (PchipInterpolator(x + one, y)(at) - PchipInterpolator(x - one, y)(at)) / (2 * step)
        by_y = (PchipInterpolator(x, y + one)(at) - PchipInterpolator(x, y - one)(at)) / (2 * step)
        assert float(of_x[k]) == pytest.approx(float(by_x), abs=1e-9)
        assert float(of_y[k]) == pytest.approx(float(by_y), abs=1e-9)
    # Moved as a whole, or scaled in height, the interpolant is the same curve.
    assert float(of_x.sum()) == pytest.approx(-float(slope), rel=1e-13)
    assert float(of_y @ y) == pytest.approx(float(value(at, x, y)), rel=1e-13)


def test_coinciding_points_stay_finite():
    """Placeholders of failed lanes are such tables."""
    ones = jnp.ones(4)
    assert all(bool(jnp.isfinite(x)) for x in interpolated(jnp.array(2.0), ones, ones))
