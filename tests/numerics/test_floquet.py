"""Monodromy matrices and their growth against Mathieu's functions, SciPy and NumPy."""

import functools
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.optimize
import scipy.special

from beltjax.numerics.floquet import exponential, growth, log_spectral_radius, monodromy
from beltjax.numerics.roots import first_upcrossing

CASE = json.loads((Path(__file__).parents[1] / "data" / "parametric.json").read_text())[
    "A1_mathieu"
]


@functools.partial(jax.jit, static_argnums=2)
def mathieu(a, q, steps):
    """x'' + (a - 2 q cos 2t) x = 0 over its period pi."""

    def at(part):
        stiffness = a - 2 * q * jnp.cos(2 * jnp.pi * part)
        return jnp.array([[0.0, 1.0], [0.0, 0.0]]) - stiffness * jnp.array([[0.0, 0.0], [1.0, 0.0]])

    return monodromy(at, jnp.asarray(jnp.pi), steps)


@pytest.mark.parametrize("q", [0.5, 1.0, 3.0, 5.0])
@pytest.mark.parametrize("name", ["a0", "b1", "a1", "b2", "a2"])
def test_boundaries_of_mathieu(q, name):
    number = int(name[1])
    of = scipy.special.mathieu_a if name[0] == "a" else scipy.special.mathieu_b
    exact = of(number, q)
    if f"{name}(q={q})" in CASE["boundaries"]:
        assert exact == pytest.approx(CASE["boundaries"][f"{name}(q={q})"], rel=1e-12)
    sign = -2.0 if number % 2 else 2.0  # of the trace: a period doubles, or is that of the motion

    def left(a):
        return float(jnp.trace(mathieu(a, q, 512))) - sign

    found = scipy.optimize.brentq(left, exact - 1e-3, exact + 1e-3, xtol=1e-13)
    assert found == pytest.approx(exact, abs=1e-8)


@pytest.mark.parametrize(("a", "q"), [(1.0, 0.5), (4.0, 2.0), (2.0, 3.0)])
def test_growth_of_mathieu(a, q):
    found = float(growth(mathieu(a, q, 512), jnp.asarray(np.pi)))
    assert found == pytest.approx(CASE["growth"][f"a={a},q={q}"], abs=2e-9)

    def rate(t, x):
        return [x[1], -(a - 2 * q * np.cos(2 * t)) * x[0]]

    columns = [
        scipy.integrate.solve_ivp(rate, (0, np.pi), x, method="DOP853", rtol=1e-12, atol=1e-13).y
        for x in np.eye(2)
    ]
    whole = np.stack([one[:, -1] for one in columns], axis=1)
    largest = np.abs(np.linalg.eigvals(whole)).max()
    assert found == pytest.approx(np.log(largest) / np.pi, abs=2e-9)


def test_the_method_has_order_four():
    fine = mathieu(2.0, 1.0, 1024)
    errors = [float(jnp.abs(mathieu(2.0, 1.0, n) - fine).max()) for n in (16, 32, 64, 128)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 4.0, atol=0.1)


def test_a_quick_oscillation_is_damped_and_not_excited():
    for angle in (0.1, 1.0, 5.0, 13.0):
        turn = jnp.array([[0.0, -angle], [angle, 0.0]])
        assert float(log_spectral_radius(exponential(turn))) < 1e-12
    small = 0.3 * jnp.array([[0.1, -1.0], [1.0, 0.2]])
    np.testing.assert_allclose(exponential(small), scipy.linalg.expm(small), rtol=1e-13)


def matrices():
    """Matrices whose largest eigenvalue is a pair, single, and complex, with their differences."""
    rng = np.random.default_rng(5)
    found = [rng.normal(size=(7, 7)) for _ in range(6)]
    found.append(rng.normal(size=(7, 7)) + 1j * rng.normal(size=(7, 7)))
    found.append(np.diag([0.5, -0.9, 0.3, 0.1, 0.1, 0.1, 0.7]) + 0.0)
    return found


RADIUS = jax.jit(log_spectral_radius)


@pytest.mark.parametrize("k", range(8))
def test_spectral_radius_without_an_eigensolver(k):
    matrix = matrices()[k]
    exact = np.log(np.abs(np.linalg.eigvals(matrix)).max())
    assert float(RADIUS(matrix)) == pytest.approx(exact, abs=1e-11)


@pytest.mark.parametrize("k", range(6))
def test_derivative_of_the_spectral_radius(k):
    matrix = matrices()[k]
    direction = np.random.default_rng(9).normal(size=matrix.shape)
    _, forward = jax.jit(lambda a, b: jax.jvp(log_spectral_radius, (a,), (b,)))(matrix, direction)
    reverse = np.sum(np.asarray(jax.jit(jax.grad(log_spectral_radius))(matrix)) * direction)

    def exact(step):
        values = np.linalg.eigvals(matrix + step * direction)
        return np.log(np.abs(values).max())

    h = 1e-4
    difference = (8 * (exact(h) - exact(-h)) - exact(2 * h) + exact(-2 * h)) / (12 * h)
    assert float(forward) == pytest.approx(float(reverse), rel=1e-9)
    assert float(forward) == pytest.approx(difference, rel=1e-7, abs=1e-9)


def test_second_derivatives_are_nan_and_not_wrong():
    twice = jax.jit(jax.hessian(log_spectral_radius))(matrices()[0][:3, :3])
    assert np.all(np.isnan(np.asarray(twice)))


def test_a_bad_lane_leaves_the_others():
    many = np.stack(matrices()[:4])
    many[2] = np.nan
    found = np.asarray(jax.jit(jax.vmap(log_spectral_radius))(many))
    for k in (0, 1, 3):
        exact = np.log(np.abs(np.linalg.eigvals(many[k])).max())
        assert found[k] == pytest.approx(exact, abs=1e-11)
    assert not np.isfinite(found[2])


@pytest.mark.parametrize("one_by_one", [False, True])
@pytest.mark.parametrize("root", [0.0371, 0.5, 1.37, 3.9])
def test_first_upcrossing(root, one_by_one):
    tried = jnp.array([0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4])

    def value(x):  # falls again after its second root
        return jnp.tanh(3 * (x - root)) * (1 + x) - 40.0 * jnp.maximum(x - root - 4.0, 0.0)

    found, there = first_upcrossing(value, tried, one_by_one=one_by_one)
    assert bool(there)
    assert float(found) == pytest.approx(root, abs=1e-9)
    found, there = first_upcrossing(lambda x: x - 10.0, tried, one_by_one=one_by_one)
    assert not bool(there)
