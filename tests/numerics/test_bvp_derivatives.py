"""Derivatives, batches, growth of the mesh and dense output, on Bratu's problem and others."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import beltjax as bj
from beltjax.numerics.bvp import solve_bvp
from beltjax.numerics.bvp_continuation import follow_branch
from beltjax.results import RESULTS

FLAT = (jnp.array([0.0, 1.0]), jnp.zeros((2, 2)))
UNIT = (0.0, 1.0)
FOLD = 3.513830719125161  # Bratu's: 8 z^2/cosh(z)^2 at z tanh z = 1


def bratu(x, y, p, factor):
    return jnp.stack([y[1], -factor * jnp.exp(y[0])])


def clamped(ya, yb, p, args):
    return jnp.stack([ya[0], yb[0]])


def exact_peak(factor, upper=False):
    """y(1/2) = 2 log cosh(z), with 8 z^2/cosh(z)^2 = factor."""
    top = 1.1996786402577338
    z: float = brentq(  # pyright: ignore
        lambda z: 8 * z**2 / np.cosh(z) ** 2 - factor,
        *((top, 20.0) if upper else (0.0, top)),
        xtol=1e-15,
    )
    return 2 * np.log(np.cosh(z))


def exact_peak_slopes(factor):
    """First and second derivative of the peak, by differentiating through z."""
    z = np.arccosh(np.exp(exact_peak(factor) / 2))
    f = lambda z: 8 * z**2 / jnp.cosh(z) ** 2  # noqa: E731
    f1, f2 = float(jax.grad(f)(z)), float(jax.grad(jax.grad(f))(z))
    p1, p2 = 2 * np.tanh(z), 2 / np.cosh(z) ** 2
    return p1 / f1, p2 / f1**2 - p1 * f2 / f1**3


def shared(x, y, p, args):
    return bratu(x, y, p, args[0] * args[1])


def peak(scale, factor, guess=FLAT):
    solution = solve_bvp(shared, clamped, UNIT, guess, args=(scale, factor), nodes=33, throw=False)
    good = solution.result == RESULTS.successful
    return jnp.where(good, solution(0.5)[0], 0.0), (good, solution.error)


GRID = np.linspace(0, 1, 33)
ZERO = jnp.asarray(GRID), jnp.zeros((2, 33))
HIGH = jnp.asarray(GRID), jnp.asarray(np.stack([16 * GRID * (1 - GRID), 16 * (1 - 2 * GRID)]))


@functools.cache
def compiled_batch():
    def total(scale, factors, guess):
        values, found = jax.vmap(peak, in_axes=(None, 0, None))(scale, factors, guess)
        return jnp.sum(values), (values, *found)

    return jax.jit(jax.value_and_grad(total, argnums=(0, 1), has_aux=True))


def batch(factors, guess=ZERO):
    """Of eight lanes: values, good, error, slope a lane, and slope of the scale they share."""
    (_, found), (together, each) = compiled_batch()(1.0, jnp.asarray(factors), guess)
    return *(np.asarray(part) for part in found), np.asarray(each), float(together)


def test_bad_lanes_leave_their_neighbors_alone():
    """Beyond the fold there is no solution; nan and inf are no problems at all."""
    factors = np.array([0.5, 1.0, 4.0, 2.0, np.nan, 3.0, np.inf, 3.5])
    fine = np.array([True, True, False, True, False, True, False, True])
    value, good, error, slope, together = batch(factors)
    assert good.tolist() == fine.tolist()
    np.testing.assert_allclose(value[fine], [exact_peak(f) for f in factors[fine]], rtol=1e-9)
    slopes = np.array([exact_peak_slopes(f)[0] for f in factors[fine]])
    np.testing.assert_allclose(slope[fine], slopes, rtol=1e-7)
    assert np.all(slope[~fine] == 0.0)
    assert np.all(error[~fine] == np.inf)
    # An argument that all lanes share gets its gradient from the good ones.
    assert together == pytest.approx(np.sum(factors[fine] * slopes), rel=1e-7)


def test_derivatives_forward_reverse_nested_and_by_difference():
    @jax.jit
    def nested(factor):
        slope = jax.value_and_grad(lambda f: peak(1.0, f)[0])
        return jax.jvp(slope, (factor,), (1.0,))

    (_, reverse), (forward, second) = nested(2.0)
    h = 1e-3
    ends, *_ = batch(2.0 + h * np.arange(-4.0, 4.0))
    difference = (8 * (ends[5] - ends[3]) - (ends[6] - ends[2])) / (12 * h)
    first_exact, second_exact = exact_peak_slopes(2.0)
    assert float(forward) == pytest.approx(float(reverse), rel=1e-11)
    assert float(forward) == pytest.approx(float(difference), rel=1e-8)
    assert float(forward) == pytest.approx(first_exact, rel=1e-9)
    assert float(second) == pytest.approx(second_exact, rel=1e-7)


def test_derivatives_with_respect_to_closure_interval_and_x():
    """y'' = c y on [0, b], y(0) = 0, y(b) = 1: y = sinh(r x)/sinh(r b), r^2 = c."""

    def at(c, b, x):
        def rhs(x, y, p, args):
            return jnp.stack([y[1], c * y[0]])

        def ends(ya, yb, p, args):
            return jnp.stack([ya[0], yb[0] - 1.0])

        guess = (jnp.stack([0.0 * b, b]), jnp.zeros((2, 2)))
        return solve_bvp(rhs, ends, (0.0, b), guess, nodes=33)(x)[0]

    def exact(c, b, x):
        return jnp.sinh(jnp.sqrt(c) * x) / jnp.sinh(jnp.sqrt(c) * b)

    here = (2.0, 1.5, 0.7)
    found = jax.jit(jax.grad(at, argnums=(0, 1, 2)))(*here)
    np.testing.assert_allclose(found, jax.grad(exact, argnums=(0, 1, 2))(*here), rtol=1e-7)


def test_upper_branch_from_a_high_guess():
    factors = np.full(8, 1.0)
    value, good, _, slope, _ = batch(factors, HIGH)
    assert good.all()
    np.testing.assert_allclose(value, exact_peak(1.0, upper=True), rtol=1e-8)
    assert np.all(slope < 0)  # the upper branch falls as the factor grows


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


def test_a_singular_problem_is_named():
    """y'' = 0 with the slope given at both ends: any constant may be added."""

    def straight(x, y, p, args):
        return jnp.stack([y[1], 0.0 * y[0]])

    def slopes(ya, yb, p, args):
        return jnp.stack([ya[1], yb[1] - 1.0])

    solution = solve_bvp(straight, slopes, UNIT, FLAT, nodes=33, throw=False)
    assert solution.result == RESULTS.singular_system


def test_public_names_are_exported():
    assert bj.solve_bvp is solve_bvp
    assert bj.follow_branch is follow_branch
