"""Bases against quadrature and against mpmath's own quadrature of the layer."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import beltjax as bj

X, W = np.polynomial.legendre.leggauss(200)
X, W = (X + 1) / 2, W / 2
BASES = [bj.Sine(12), bj.Legendre(12)]
IDS = ["sine", "legendre"]


@pytest.mark.parametrize("basis", BASES, ids=IDS)
def test_products_are_the_integrals(basis):
    values, slopes, bends = (np.asarray(basis.values(jnp.asarray(X), k)) for k in range(3))
    of = basis.products()

    def integral(f, g):
        return np.einsum("q,qa,qb->ab", W, f, g)

    np.testing.assert_allclose(integral(slopes, slopes), np.eye(12), atol=1e-12)
    np.testing.assert_allclose(of.value, integral(values, values), atol=1e-14)
    np.testing.assert_allclose(of.curvature, integral(bends, bends), rtol=1e-11, atol=1e-8)
    np.testing.assert_allclose(of.skew, integral(values, slopes), atol=1e-13)
    graded = np.einsum("q,qa,qb->ab", W * (X - 0.5), slopes, slopes)
    np.testing.assert_allclose(of.graded, graded, atol=1e-12)
    np.testing.assert_allclose(of.mean, W @ values, atol=1e-14)
    np.testing.assert_allclose(of.first, (W * X) @ values, atol=1e-14)


@pytest.mark.parametrize("basis", BASES, ids=IDS)
def test_functions_vanish_at_both_ends(basis):
    np.testing.assert_allclose(basis.values(jnp.array([0.0, 1.0])), 0.0, atol=1e-15)


def graded(k):
    """Quadrature in the layer's own variable: [0, 1] cut where e^{-k(1-x)} has decayed."""
    cuts = np.unique(np.clip(1 - np.array([0.0, 2, 5, 10, 20, 40, 80]) / max(k, 1e-9), 0.0, 1.0))
    cuts = np.union1d(cuts, [0.0, 1.0])
    lengths = np.diff(cuts)
    return (cuts[:-1, None] + lengths[:, None] * X).ravel(), (lengths[:, None] * W).ravel()


def sinh_ratio(k, x):
    return np.exp(-k * (1 - x)) * -np.expm1(-2 * k * x) / -np.expm1(-2 * k) if k else x


@pytest.mark.parametrize("k", [0.0, 0.3, 1.7, 1.74, 8.0, 60.0, 900.0, 3e4])
@pytest.mark.parametrize("basis", [bj.Sine(12), bj.Legendre(40)], ids=IDS)
def test_moments_of_the_end_layer(basis, k):
    thick = k**2 < 3.0
    u, z = (1.0, k**2) if thick else (1 / k, np.inf)
    starts, ends = basis.layer_moments(jnp.asarray(u), jnp.asarray(z))
    x, w = graded(k)
    values = np.asarray(basis.values(jnp.asarray(x)))
    exact = (w * sinh_ratio(k, x)) @ values
    np.testing.assert_allclose(ends, exact, atol=1e-13 * np.abs(exact).max())
    mirrored = (w * sinh_ratio(k, x)) @ np.asarray(basis.values(jnp.asarray(1 - x)))
    np.testing.assert_allclose(starts, mirrored, atol=1e-13 * np.abs(exact).max())


@pytest.mark.parametrize("k", [0.3, 1.7, 8.0, 900.0])
def test_slopes_of_the_moments(k):
    basis, thick = bj.Legendre(12), k**2 < 3.0
    layer = k**2 if thick else 1 / k

    def moments(layer):
        given = (jnp.ones(()), layer) if thick else (layer, jnp.asarray(jnp.inf))
        return jnp.concatenate(basis.layer_moments(*given))

    forward, reverse = jax.jacfwd(moments)(layer), jax.jacrev(moments)(layer)
    np.testing.assert_allclose(forward, reverse, rtol=1e-13)
    h = 1e-4 * layer
    near, far = (
        moments(layer + h) - moments(layer - h),
        moments(layer + 2 * h) - moments(layer - 2 * h),
    )
    differences = (8 * near - far) / (12 * h)
    np.testing.assert_allclose(forward, differences, rtol=0, atol=1e-9 * np.abs(differences).max())


def test_a_string_has_no_layer():
    for basis in BASES:
        starts, ends = basis.layer_moments(jnp.zeros(()), jnp.asarray(jnp.inf))
        np.testing.assert_array_equal(np.concatenate([starts, ends]), 0.0)
        slope = jax.jacfwd(lambda u, b=basis: b.layer_moments(u, jnp.asarray(jnp.inf))[1])(0.0)
        assert np.all(np.isfinite(slope))


@pytest.mark.parametrize("size", [0, -3])
def test_a_basis_needs_functions(size):
    with pytest.raises(ValueError, match="size must be at least 1"):
        bj.Sine(size)
