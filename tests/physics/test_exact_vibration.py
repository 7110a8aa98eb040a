"""The elimination behind the characteristic function, at a root to rounding."""

import jax
import jax.numpy as jnp
import pytest

from beltjax.physics.exact_vibration import _pivots


def test_slope_is_kept_where_a_pivot_is_zero():
    def determinant(x):
        matrix = jnp.array([[2.0, 1.0 + 1.0j], [1.0 - 1.0j, 1.0]])
        return jnp.prod(_pivots(matrix + x * jnp.eye(2)))

    assert abs(determinant(0.0)) < 1e-100
    assert jax.grad(determinant)(0.0) == pytest.approx(3.0)
