"""Derivatives, batches, growth of the mesh and dense output, on Bratu's problem and others."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import beltjax as bj
from beltjax.numerics.bvp.continuation import follow_branch
from beltjax.numerics.bvp.solve import solve_bvp
from beltjax.results import RESULTS

FLAT = (jnp.array([0.0, 1.0]), jnp.zeros((2, 2)))
UNIT = (0.0, 1.0)
FOLD = 3.513830719125161  # Bratu's: 8 z^2/cosh(z)^2 at z tanh z = 1


def bratu(x, y, p, factor):
    return jnp.stack([y[1], -factor * jnp.exp(y[0])])


def clamped(ya, yb, p, args):
    return jnp.stack([ya[0], yb[0]])


def exact_z(factor, upper=False):
    """8 z^2/cosh(z)^2 = factor: y(x) = 2 log(cosh(z)/cosh(z (1 - 2 x)))."""
    top = 1.1996786402577338
    return brentq(
        lambda z: 8 * z**2 / np.cosh(z) ** 2 - factor,
        *((top, 20.0) if upper else (0.0, top)),
        xtol=1e-15,
    )


def exact_peak(factor, upper=False):
    """y(1/2)."""
    return 2 * np.log(np.cosh(exact_z(factor, upper)))


def exact_peak_slopes(factor):
    """First and second derivative of the peak, by differentiating through z."""
    z = np.arccosh(np.exp(exact_peak(factor) / 2))
    f = lambda z: 8 * z**2 / jnp.cosh(z) ** 2  # noqa: E731
    f1, f2 = float(jax.grad(f)(z)), float(jax.grad(jax.grad(f))(z))
    p1, p2 = 2 * np.tanh(z), 2 / np.cosh(z) ** 2
    return p1 / f1, p2 / f1**2 - p1 * f2 / f1**3


def exact_value_slopes(scale, factor, b, x):
    """Derivatives of y(x) on [0, b], which is the unit problem's at x/b for scale factor b^2."""

    def value(z, t):
        return 2 * jnp.log(jnp.cosh(z) / jnp.cosh(z * (1 - 2 * t)))

    z = exact_z(scale * factor * b**2)
    by_z, by_t = (float(d) for d in jax.grad(value, (0, 1))(z, x / b))
    by_strength = by_z / float(jax.grad(lambda z: 8 * z**2 / jnp.cosh(z) ** 2)(z))
    by_b = by_strength * 2 * scale * factor * b - by_t * x / b**2
    return by_strength * factor * b**2, by_strength * scale * b**2, by_b, by_t / b


class At(NamedTuple):
    """Where Bratu's problem is solved, and y asked for."""

    scale: Any  # closed over
    factor: Any  # in args
    b: Any  # the interval's end
    x: Any


def height(at: At, guess):
    """y(x) of y'' = -scale factor e^y, y(0) = y(b) = 0; zero where there is no solution."""

    def rhs(x, y, p, factor):
        return bratu(x, y, p, at.scale * factor)

    fractions, y = guess
    guess = (fractions * at.b, y)
    solution = solve_bvp(rhs, clamped, (0.0, at.b), guess, args=at.factor, nodes=33, throw=False)
    good = solution.result == RESULTS.successful
    return jnp.where(good, solution(at.x)[0], 0.0), (good, solution.error)


GRID = np.linspace(0, 1, 33)
ZERO = jnp.asarray(GRID), jnp.zeros((2, 33))
HIGH = jnp.asarray(GRID), jnp.asarray(np.stack([16 * GRID * (1 - GRID), 16 * (1 - 2 * GRID)]))
EACH = At(None, 0, None, None)  # eight lanes that differ in the factor


@jax.jit
def _lanes(at: At, direction: At, guess):
    """Value, gradient, and the derivative of both along a direction: one program for all tests."""

    def total(at):
        values, found = jax.vmap(height, in_axes=(EACH, None))(at, guess)
        return jnp.sum(values), (values, *found)

    return jax.jvp(jax.value_and_grad(total, has_aux=True), (at,), (direction,))


class Lanes(NamedTuple):
    """What is known of eight lanes."""

    value: np.ndarray
    good: np.ndarray
    error: np.ndarray
    slope: At  # gradient of the sum
    forward: float  # derivative of the sum along the direction
    second: At  # derivative of the gradient along it


def lanes(factors, guess=ZERO, *, b=1.0, x=0.5, along=None):
    """Eight lanes of strength `factors`; derivatives also along the factor of lane `along`."""
    at = At(*map(jnp.asarray, (1.0, factors, b, x)))
    direction = jax.tree.map(jnp.zeros_like, at)
    if along is not None:
        direction = direction._replace(factor=direction.factor.at[along].set(1.0))
    ((_, found), slope), ((forward, _), second) = _lanes(at, direction, guess)
    return Lanes(*(np.asarray(part) for part in found), slope, float(forward), second)


@pytest.mark.slow
def test_bad_lanes_leave_their_neighbors_alone():
    """Beyond the fold there is no solution; nan and inf are no problems at all."""
    factors = np.array([0.5, 1.0, 4.0, 2.0, np.nan, 3.0, np.inf, 3.5])
    fine = np.array([True, True, False, True, False, True, False, True])
    found = lanes(factors, along=3)
    assert found.good.tolist() == fine.tolist()
    np.testing.assert_allclose(found.value[fine], [exact_peak(f) for f in factors[fine]], rtol=1e-9)
    slopes = np.array([exact_peak_slopes(f)[0] for f in factors[fine]])
    slope = np.asarray(found.slope.factor)
    np.testing.assert_allclose(slope[fine], slopes, rtol=1e-7)
    assert np.all(slope[~fine] == 0.0)
    assert np.all(found.error[~fine] == np.inf)
    # An argument that all lanes share gets its gradient from the good ones.
    assert float(found.slope.scale) == pytest.approx(np.sum(factors[fine] * slopes), rel=1e-7)
    second = np.asarray(found.second.factor)
    assert second[3] == pytest.approx(exact_peak_slopes(2.0)[1], rel=1e-7)
    assert np.all(np.delete(second, 3) == 0.0)


def test_derivatives_forward_reverse_nested_and_by_difference():
    h = 1e-3
    found = lanes(2.0 + h * np.arange(-4.0, 4.0), along=4)
    ends = found.value
    difference = (8 * (ends[5] - ends[3]) - (ends[6] - ends[2])) / (12 * h)
    first_exact, second_exact = exact_peak_slopes(2.0)
    assert found.forward == pytest.approx(float(found.slope.factor[4]), rel=1e-11)
    assert found.forward == pytest.approx(float(difference), rel=1e-8)
    assert found.forward == pytest.approx(first_exact, rel=1e-9)
    assert float(found.second.factor[4]) == pytest.approx(second_exact, rel=1e-7)


@pytest.mark.slow
def test_derivatives_with_respect_to_closure_interval_and_x():
    factors = np.full(8, 1.2)
    found = lanes(factors, b=1.5, x=0.7)
    by_scale, by_factor, by_b, by_x = exact_value_slopes(1.0, 1.2, 1.5, 0.7)
    expected = At(8 * by_scale, np.full(8, by_factor), 8 * by_b, 8 * by_x)
    for slope, exact in zip(found.slope, expected, strict=True):
        np.testing.assert_allclose(slope, exact, rtol=1e-7)


def exact_height(v, z):
    """y(x) of (scale, factor, b, x); Newton's steps from `z` carry the derivatives of the root."""
    scale, factor, b, x = v
    strength = lambda z: 8 * z**2 / jnp.cosh(z) ** 2  # noqa: E731
    for _ in range(4):
        z = z - (strength(z) - scale * factor * b**2) / jax.grad(strength)(z)
    return 2 * jnp.log(jnp.cosh(z) / jnp.cosh(z * (1 - 2 * x / b)))


@pytest.mark.slow  # each compiles for half a minute
@pytest.mark.parametrize(
    ("outer", "inner"),
    [(jax.jacfwd, jax.jacrev), (jax.jacrev, jax.jacrev), (jax.jacrev, jax.jacfwd)],
)
def test_second_derivatives_with_respect_to_all(outer, inner):
    """`jax.hessian` is forward over reverse."""
    at = jnp.array([1.0, 1.2, 1.1, 0.3])
    found = jax.jit(outer(inner(lambda v: height(At(*v), FLAT)[0])))(at)
    expected = jax.hessian(exact_height)(at, exact_z(1.2 * 1.1**2))
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-8)


def test_upper_branch_from_a_high_guess():
    found = lanes(np.full(8, 1.0), HIGH)
    assert found.good.all()
    np.testing.assert_allclose(found.value, exact_peak(1.0, upper=True), rtol=1e-8)
    assert np.all(found.slope.factor < 0)  # the upper branch falls as the factor grows


def test_branch_passes_the_fold():
    def rhs(x, y, p, args):
        return bratu(x, y, p, p[0])

    branch = follow_branch(
        rhs, clamped, UNIT, FLAT, jnp.array([0.5]), step=0.5, points=30, nodes=33
    )
    assert np.asarray(branch.solved).all()
    factors = np.asarray(branch.parameters)[:, 0]
    upper = np.asarray(branch.slope) < 0
    assert 5 < upper.sum() < 25
    middle = np.asarray(jax.vmap(lambda s: s(0.5)[0])(branch.solutions))
    exact = [exact_peak(f, high) for f, high in zip(factors, upper, strict=True)]
    np.testing.assert_allclose(middle, exact, rtol=1e-7)
    folds = np.asarray(branch.folds)
    assert folds[~np.isnan(folds)] == pytest.approx([FOLD], abs=1e-5)


def layered(x, y, p, eps):
    return jnp.stack([y[1], y[0] / eps**2])


@pytest.mark.slow
def test_mesh_grows_only_until_the_estimate_will_do():
    def ends(ya, yb, p, args):
        return jnp.stack([ya[0] - 1.0, yb[0]])

    solution = solve_bvp(layered, ends, UNIT, FLAT, args=jnp.array(1e-2), tol=1e-9)
    assert solution.result == RESULTS.successful
    assert solution.nodes > 32
    assert float(solution.error) <= 1e-9
    x = np.linspace(0, 1, 301)
    np.testing.assert_allclose(solution(x)[0], np.exp(-x / 1e-2), atol=1e-9)
    few = solve_bvp(
        layered, ends, UNIT, FLAT, args=jnp.array(1e-2), tol=1e-9, max_nodes=32, throw=False
    )
    assert few.result == RESULTS.mesh_exhausted
    assert few.nodes == 32
    with pytest.raises(Exception, match="Raise nodes or max_nodes"):
        solve_bvp(layered, ends, UNIT, FLAT, args=jnp.array(1e-2), tol=1e-9, max_nodes=32)


def test_public_names_are_exported():
    assert bj.solve_bvp is solve_bvp
    assert bj.follow_branch is follow_branch
