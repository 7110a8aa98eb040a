"""Carlson's integrals and Jacobi's functions against SciPy's and against their own identities."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import ellipj, ellipkm1, elliprd, elliprf, elliprj

from beltjax.numerics.elliptic import carlson, jacobi_dn_sd

COUNT = 4000


@pytest.fixture(scope="module")
def arguments():
    """Arguments over sixteen orders of magnitude; p is no larger than the largest of the rest."""
    rng = np.random.default_rng(0)
    x, y, z, share = 10 ** rng.uniform(-16, 0, (4, COUNT))
    x[::20] = 0.0
    return x, y, z, share * np.maximum(np.maximum(x, y), z)


@pytest.fixture(scope="module")
def found(arguments):
    def integrals(*numbers):
        integral = carlson(*numbers)
        return integral, jax.jvp(lambda x: carlson(x, *numbers[1:]).rf, numbers[:1], (1.0,))[1]

    return jax.device_get(jax.jit(jax.vmap(integrals))(*arguments))


def test_first_and_second_kind_agree_with_scipy(arguments, found):
    x, y, z, _ = arguments
    assert found[0].rf == pytest.approx(elliprf(x, y, z), rel=2e-15)
    assert found[0].rd == pytest.approx(elliprd(x, y, z), rel=2e-15)


def test_third_kind_agrees_with_scipy(arguments, found):
    x, y, z, p = arguments
    # Eleven duplications round a few times each; more digits go where p is the smallest by far
    # (a span's p is all but z).
    allowed = 1e-14 + 1e-16 * np.sqrt(np.maximum(np.maximum(x, y), z) / p)
    assert np.max(np.abs(found[0].rj / elliprj(x, y, z, p) - 1) / allowed) < 1
    assert carlson(0.3, 0.4, 0.2, 0.2).rj == pytest.approx(float(carlson(0.3, 0.4, 0.2).rd))


def test_slope_is_an_integral_of_the_second_kind(arguments, found):
    x, y, z, _ = arguments
    bent = x > 0  # at 0 the slope is infinite
    expected = -elliprd(y, z, x)[bent] / 6
    assert found[1][bent] == pytest.approx(expected, rel=1e-13)


def test_jacobi_agrees_with_scipy_and_with_the_integral():
    rng = np.random.default_rng(1)
    complement = 10 ** rng.uniform(-16, 0, COUNT)
    u = rng.uniform(-1, 1, COUNT) * ellipkm1(complement)
    dn, sd = jax.device_get(jax.jit(jacobi_dn_sd)(u, complement))
    # SciPy takes the parameter itself, in which a small complement is rounded off.
    plain = complement > 1e-2
    sn, _, expected, _ = ellipj(u[plain], 1 - complement[plain])
    assert dn[plain] == pytest.approx(expected, rel=1e-13)
    assert sd[plain] == pytest.approx(sn / expected, rel=1e-13)
    # u as an integral from the point itself: sn^2 = 1 - cn^2 with the small terms kept.
    back = sd * elliprf(1 - complement * sd**2, 1.0, 1 + (1 - complement) * sd**2)
    assert back == pytest.approx(u, rel=1e-12)
    assert dn**2 * (1 + (1 - complement) * sd**2) == pytest.approx(np.ones(COUNT), rel=1e-12)


def test_jacobi_at_zero():
    dn, sd = jacobi_dn_sd(jnp.zeros(()), jnp.asarray(0.3))
    assert (float(dn), float(sd)) == (1.0, 0.0)
    assert float(jax.grad(lambda u: jacobi_dn_sd(u, jnp.asarray(0.3))[1])(0.0)) == 1.0
