"""Conditions of an optimum, Newton's polish, derivatives of optima, limits in conflict."""

import numpy as np
import pytest
from nonlinear_problems import HS71_OPTIMUM, HS71_VALUE, hs71, local

import beltjax as bj

find_optimizer = bj.optimize.find_optimizer
SOLVERS = [
    name
    for name in bj.optimize.optimizer_names()
    if isinstance(find_optimizer(name), bj.optimize.AbstractLocalOptimizer)
]
Problem = bj.optimize.UnitBoxProblem
conditions, conflicts = bj.optimize.optimality, bj.optimize.conflicts


def test_a_published_optimum_is_reached_from_nearby():
    at = conditions.polished(hs71((HS71_OPTIMUM - 1) / 4 + [0.0, 1e-5, -2e-5, 1e-5]), hs71)
    np.testing.assert_allclose(1 + 4 * at.x, HS71_OPTIMUM, atol=5e-8)  # as printed
    assert at.f == pytest.approx(HS71_VALUE, abs=5e-8)
    shown = conditions.optimality(at, hs71)
    assert shown.residual < 1e-10
    assert shown.curvature > 0
    # The book's multipliers: 1.0878712 of the lower bound, 0.5522937 of the product.
    n = len(shown.multipliers) - 8
    assert shown.multipliers[n] / 4 == pytest.approx(1.0878712, rel=1e-6)
    assert shown.multipliers[0] == pytest.approx(0.5522937, rel=1e-6)


@pytest.mark.parametrize("method", SOLVERS)
def test_other_libraries_reach_it_too(method):
    ended = find_optimizer(method).run(Problem(hs71, hs71([0.0, 1.0, 1.0, 0.0])))
    np.testing.assert_allclose(1 + 4 * ended.x, HS71_OPTIMUM, atol=1e-5)


@pytest.mark.parametrize("method", SOLVERS)
def test_no_time_is_said(method):
    problem = Problem(hs71, hs71([0.0, 1.0, 1.0, 0.0]), deadline=0.0)
    ended = find_optimizer(method).run(problem)
    assert not ended.converged
    assert len(problem.path) <= 2


def test_a_saddle_is_no_optimum():
    def saddle(x):
        u, v = np.asarray(x) - 0.5
        return local(x, u**2 - v**2, [], [2 * u, -2 * v], [])

    shown = conditions.optimality(saddle([0.5, 0.5]), saddle)
    assert shown.residual < 1e-12
    assert shown.curvature == pytest.approx(-2.0)


def nearest(p):
    """The point of x + y <= 1 that is nearest to (p, 1)."""

    def look(x):
        u, v = x[0] - p, x[1] - 1.0
        return local(x, u**2 + v**2, [x[0] + x[1] - 1], [2 * u, 2 * v], [1.0, 1.0])

    return look


def test_derivative_of_an_optimum():
    # x = p/2, y = 1 - p/2, f = p^2/2.
    look = nearest(0.6)
    at = conditions.polished(look(np.array([0.25, 0.65])), look)
    np.testing.assert_allclose(at.x, [0.3, 0.7], atol=1e-12)
    shown = conditions.optimality(at, look)
    slope = conditions.response_to(at, shown, look, np.array([[-2.0], [0.0]]), np.zeros((5, 1)))
    np.testing.assert_allclose(slope[:, 0], [0.5, -0.5], atol=1e-9)
    assert shown.multipliers[0] == pytest.approx(0.6)


def test_limits_in_conflict_are_named_and_no_others():
    def look(x):
        c = [x[0] + x[1] - 0.4, 0.8 - x[0], x[1] - 0.9]  # the last has nothing to do with it
        return local(x, 0.0, c, [0.0, 0.0], [[1, 1], [-1, 0], [0, 1]])

    best = conflicts.least_violated(look(np.array([0.9, 0.5])), look)
    # With y = 0: (x - 0.4)^2 + (0.8 - x)^2 is least at 0.6.
    np.testing.assert_allclose(best.x, [0.6, 0.0], atol=1e-6)
    names = ["sum", "x", "y", *(f"{v} {side}" for side in ("lower", "upper") for v in "xy")]
    assert set(conflicts.conflicting(best, names)) == {"sum", "x", "y lower"}
