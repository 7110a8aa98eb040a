"""Sequential quadratic programming on printed problems, in batches and on pytrees."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hock_schittkowski import PROBLEMS as FIRST
from hock_schittkowski_engineering import MORE
from hock_schittkowski_harder import HARDER, PRINTED

import beltjax as bj
from beltjax.compiling.quick import quickly_compiled
from beltjax.results import successes

# Equalities, many active bounds, quartic and ill-scaled objectives, an exact vertex.
PROBLEMS = FIRST | MORE | HARDER
FEW = (10, 24, 26, 41, 64, 71, 76)


def solved(problem, **options):
    x = jnp.asarray(problem.start, dtype=float)
    least, greatest = (
        jnp.broadcast_to(jnp.asarray(bound, dtype=float), x.shape)
        for bound in (problem.least, problem.greatest)
    )

    def search(x):
        return bj.optimize.sqp(
            problem.f,
            problem.at_most,
            x,
            equalities=problem.equal,
            lower=least,
            upper=greatest,
            **options,
        )

    return quickly_compiled(search)(x)


def rows(function, x):
    """Values and slopes of constraints, none where there are none."""
    if function is None:
        return np.zeros(0), np.zeros((0, len(x)))
    value, slope = np.asarray(function(x)), np.asarray(jax.jacobian(function)(x))
    return np.atleast_1d(value), np.reshape(slope, (-1, len(x)))


def conditions(problem, found):
    """The residuals of the conditions of an optimum, in NumPy, with the multipliers found."""
    x, y = np.asarray(found.x), np.asarray(found.multipliers)
    (c, J), (h, K) = rows(problem.at_most, x), rows(problem.equal, x)
    inside, equal = y[: len(c)], y[len(c) :]
    slope = np.asarray(jax.grad(problem.f)(x))
    size = 1 + np.max(np.abs(slope))
    slope = slope + J.T @ inside + K.T @ equal
    free = np.abs(x - np.clip(x - slope, problem.least, problem.greatest))
    assert np.all(inside >= 0)
    violated = np.maximum(c, 0), np.abs(h), np.maximum(problem.least - x, 0)
    return {
        "stationarity": np.max(free) / size,
        "complementarity": np.max(np.abs(inside * c), initial=0.0) / size,
        "violation": np.max(np.concatenate(violated), initial=0.0),
        "bounds": np.max(np.maximum(x - problem.greatest, 0)),
    }


def check(number, **options):
    problem = PROBLEMS[number]
    found = solved(problem, **options)
    assert found.result == bj.RESULTS.successful, f"after {found.iterations} iterations"
    for name, residual in conditions(problem, found).items():
        assert residual <= 2e-9, name
    known = np.array([problem.best, problem.other])
    reached = np.abs(float(found.objective) - known) <= 1e-6 * (1 + np.abs(known))
    assert np.any(reached), float(found.objective)
    return bool(reached[0])


@pytest.mark.parametrize("number", FEW)
def test_printed_optima(number):
    assert check(number)


@pytest.mark.slow
@pytest.mark.parametrize("number", [n for n in PROBLEMS if n not in FEW])
def test_printed_optima_and_known_local_ones(number):
    # With longer first steps these two leave the valley of their best optimum.
    options = {"radius": 0.1} if number in (70, 105) else {}
    assert check(number, **options) or np.isfinite(PROBLEMS[number].other)


@pytest.mark.parametrize("number", PRINTED)
def test_statements_give_the_printed_objective_at_the_printed_solution(number):
    problem, x = HARDER[number], jnp.array(PRINTED[number])
    assert float(problem.f(x)) == pytest.approx(problem.best, rel=1e-6)
    for rows in (problem.at_most, problem.equal):
        if rows is not None:  # to the printed digits
            assert np.max(np.asarray(rows(x))) < 2e-5


@pytest.mark.slow
@pytest.mark.parametrize("number", [10, 26, 43, 71])
def test_updates_in_place_of_second_derivatives(number):
    assert check(number, second_derivatives=False, max_iterations=400)


def disk(x):
    """One disk, and a function that is not defined beyond a line."""
    return jnp.where(x[0] < 3, jnp.sum(x), jnp.nan), jnp.sum(x**2) - 2.0


def test_a_lane_that_fails_leaves_its_neighbors_as_they_are():
    def search(x):
        return bj.optimize.sqp(lambda x: disk(x)[0], lambda x: disk(x)[1], x)

    starts = jnp.array([[1.0, 0.5], [4.0, 0.0], [-0.3, 2.0]])
    found = quickly_compiled(jax.vmap(search))(starts)
    assert successes(found.result).tolist() == [True, False, True]
    # The sum of two numbers in a disk of radius sqrt(2) is least at (-1, -1), with multiplier 1/2.
    np.testing.assert_allclose(found.x[::2], -1, atol=1e-9)
    np.testing.assert_allclose(found.multipliers[::2, 0], 0.5, rtol=1e-8)
    assert int(found.iterations[1]) == 1  # the start itself


def test_pytrees_go_in_and_come_out():
    # The box of least surface for a volume of 8 is a cube of edge 2; with one edge of 4 or more the
    # other two are equal, too.
    def surface(box):
        a, (b, c) = box["depth"], box["walls"]
        return 2 * (a * b + b * c + c * a)

    def missing(box):
        return {"volume": 8 - box["depth"] * jnp.prod(box["walls"])}

    start = {"depth": 3.0, "walls": jnp.array([3.0, 1.0])}
    none = {"depth": -np.inf, "walls": -np.inf * np.ones(2)}
    least = {"depth": 4.0, "walls": 0.1 * np.ones(2)}
    for low, depth in ((none, 2.0), (least, 4.0)):
        found = bj.optimize.sqp(surface, missing, start, lower=low)
        wall = np.sqrt(8 / depth)
        assert found.result == bj.RESULTS.successful
        assert float(found.x["depth"]) == pytest.approx(depth, rel=1e-8)
        np.testing.assert_allclose(found.x["walls"], wall, rtol=1e-8)
        # Surface over volume, as a wall moves outwards.
        slope = 2 * (depth + wall) / (depth * wall)
        assert float(found.multipliers[0]) == pytest.approx(slope, rel=1e-7)


def test_limits_that_cannot_be_met_end_at_the_least_violation():
    # x >= 1 and x <= 0 are violated by half each at best, or by one in all anywhere between.
    found = bj.optimize.sqp(
        lambda x: x[0] ** 2, lambda x: jnp.stack([1 - x[0], x[0]]), jnp.array([3.0])
    )
    assert found.result == bj.RESULTS.constraints_infeasible
    assert 0.5 <= float(found.violation) <= 1.0 + 1e-9
    assert -1e-9 <= float(found.x[0]) <= 1.0 + 1e-9
