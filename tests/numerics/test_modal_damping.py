"""The damping matrix of equal damping ratios, by SciPy and by differences."""

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg

from beltjax.numerics.gyroscopic import geometric_mean, modal_damping

SIZE = 6
KEYS = jax.random.split(jax.random.key(3), 4)


def _definite(key):
    part = jax.random.normal(key, (SIZE, SIZE))
    return part @ part.T + SIZE * jnp.eye(SIZE)


M, K = _definite(KEYS[0]), _definite(KEYS[1])
DM, DK = ((part + part.T) / 2 for part in (_definite(KEYS[2]), _definite(KEYS[3])))


def test_the_mean_is_that_of_matrix_roots():
    root = scipy.linalg.sqrtm(np.asarray(M))
    back = np.linalg.inv(root)
    expected = root @ scipy.linalg.sqrtm(back @ np.asarray(K) @ back) @ root
    found = geometric_mean(M, K)
    np.testing.assert_allclose(found, expected, rtol=1e-11)
    np.testing.assert_allclose(found @ np.linalg.solve(M, found), K, rtol=1e-11)


def test_every_mode_has_the_ratio():
    values, modes = scipy.linalg.eigh(K, M)
    damping = modes.T @ np.asarray(modal_damping(M, K, jnp.asarray(0.03))) @ modes
    np.testing.assert_allclose(damping, np.diag(0.06 * np.sqrt(values)), atol=1e-12)


def test_derivatives_three_ways():
    weights = jnp.asarray(np.cos(np.arange(SIZE * SIZE)).reshape(SIZE, SIZE))

    def measured(t):
        return jnp.sum(weights * geometric_mean(M + t * DM, K + t * DK))

    forward = jax.jvp(measured, (0.0,), (1.0,))[1]
    reverse = jax.grad(measured)(0.0)
    h = 1e-3
    values = [float(measured(step * h)) for step in (-2, -1, 1, 2)]
    difference = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * h)
    np.testing.assert_allclose([forward, reverse], difference, rtol=1e-9)


def test_equal_frequencies_have_finite_slopes():
    unit = jnp.eye(SIZE)
    slope = jax.jvp(lambda t: geometric_mean(unit, unit + t * DK), (0.0,), (1.0,))[1]
    np.testing.assert_allclose(slope, DK / 2, rtol=1e-12)  # of a root at 1
