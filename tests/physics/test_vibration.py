"""M, G and K against the second derivatives of the drive's energy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drives import at_groups, vibrating
from vibration import matrices

import beltjax as bj
from beltjax.physics.vibration import Motion, energy, forms_of_spans

X, W = np.polynomial.legendre.leggauss(40)
X, W = (X + 1) / 2, W / 2


def points(layer):
    """A quadrature rule on [0, 1], fine in both ends' layers."""
    deep = np.array([1, 2, 4, 8, 16, 32]) * layer
    cuts = np.unique(np.concatenate([[0.0, 0.5, 1.0], deep[deep < 0.5], 1 - deep[deep < 0.5]]))
    lengths = np.diff(cuts)
    return (cuts[:-1, None] + lengths[:, None] * X).ravel(), (lengths[:, None] * W).ravel()


def by_energy(steady, model, basis):
    """Second derivatives of the Lagrangian by JAX, with every integral by quadrature."""
    layer = float(jnp.min(jnp.where(jnp.isinf(model.z), model.u, 1.0)))
    x, w = points(layer)
    spans, n = len(model.lam), basis.size
    slope = jax.jit(
        jax.vmap(jax.grad(lambda x, i: steady.deflection(i, x)), (0, None)), static_argnums=1
    )
    slopes = jnp.stack([slope(jnp.asarray(x), i) for i in range(spans)])
    functions = [basis.values(jnp.asarray(x), order) for order in range(3)]

    def motion(z):
        c = z[: spans * n].reshape(spans, n)
        q = z[-len(model.movable) :]
        w_, w_x, w_xx = (c @ f.T for f in functions)
        start, slope = (model.W0 @ q)[:, None], (model.a @ q)[:, None]
        return Motion(w_ + start + slope * x, w_x + slope, w_xx, z[spans * n : -len(q)], q)

    weights = jnp.broadcast_to(jnp.asarray(w), slopes.shape)

    def lagrangian(z, rate):
        return energy(motion(z), motion(rate), slopes, weights, model)

    rest = jnp.zeros(spans * n + len(model.M_r) + len(model.movable))
    (zz, zr), (_, rr) = jax.jit(jax.hessian(lagrangian, argnums=(0, 1)))(rest, rest)
    return rr, zr.T - zr, -zz


FAST = [("three_pulley", 0), ("three_pulley", 1)]


@pytest.mark.parametrize(
    ("name", "basis"),
    [
        pytest.param(name, basis, marks=() if (name, k) in FAST else pytest.mark.slow)
        for name in ("three_pulley", "four_pulley", "seven_pulley")
        for k, basis in enumerate((bj.Sine(4), bj.Legendre(4)))
    ],
)
def test_matrices_are_the_energys_second_derivatives(name, basis):
    drive, point = at_groups(vibrating(name), 0.03, 0.5)
    steady = bj.steady_state(drive, point)
    model = bj.linearize(steady, basis).model
    found = matrices(model, basis)
    for assembled_matrix, derived in zip(found, by_energy(steady, model, basis), strict=True):
        size = np.abs(derived).max()
        np.testing.assert_allclose(assembled_matrix, derived, rtol=0, atol=1e-12 * size)
    M, G, K = (np.asarray(matrix) for matrix in found)
    np.testing.assert_array_equal(M, M.T)
    np.testing.assert_allclose(K, K.T, rtol=0, atol=1e-15 * np.abs(K).max())
    np.testing.assert_allclose(G, -G.T, rtol=0, atol=1e-14 * np.abs(G).max())


@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize(
    "name", ["three_pulley", pytest.param("four_pulley", marks=pytest.mark.slow)]
)
def test_forms_of_spans_are_those_of_the_matrices(name, free):
    drive, point = at_groups(vibrating(name), 0.03, 0.5)
    lin = bj.linearize(bj.steady_state(drive, point), bj.Legendre(6), free=free)
    random = np.random.default_rng(3)
    shape = (2, 5, len(lin.mass))
    left, right = random.normal(size=shape) + 1j * random.normal(size=shape)
    found = forms_of_spans(lin.model, lin.basis, lin.elongations, lin.rotors, left, right)
    whole = np.array([lin.mass, lin.gyroscopic, lin.stiffness])
    expected = np.einsum("ka,mab,kb->mk", left.conj(), whole, right)
    for form, value in zip(found, expected, strict=True):
        np.testing.assert_allclose(form, value, atol=1e-13 * np.abs(value).max())


@pytest.mark.parametrize("name", ["three_pulley", "seven_pulley"])
def test_a_free_drive_turns_rigidly(name):
    # r_i theta_i = const stretches nothing.
    drive, point = at_groups(vibrating(name), 0.03, 0.5)
    lin = bj.linearize(bj.steady_state(drive, point), bj.Legendre(6), free=True)
    z = jnp.zeros(len(lin.mass))
    n = lin.spans * lin.basis.size
    radii = lin.steady.groups.radius_ratios
    z = z.at[n : n + lin.spans].set(1 / radii[lin.rotors])
    assert float(jnp.max(jnp.abs(lin.stiffness @ z))) < 1e-12 * float(jnp.max(lin.stiffness))
