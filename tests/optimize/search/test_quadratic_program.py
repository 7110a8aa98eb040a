"""The quadratic program with priced rows against SciPy and a bound from below."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

import beltjax as bj

quadratic = bj.optimize.search.quadratic_program
LANES, N = 40, 5


# Of 12 rows all are counted; of 60 a few at a time, and where those do not settle, all.
@pytest.fixture(scope="module", params=[12, 60])
def programs(request):
    M = request.param
    rng = np.random.default_rng(5)
    root = rng.normal(size=(LANES, N, N))
    return quadratic.QuadraticProgram(
        B=root @ root.transpose(0, 2, 1) + 0.1 * np.eye(N),
        g=3 * rng.normal(size=(LANES, N)),
        J=rng.normal(size=(LANES, M, N)),
        c=rng.normal(size=(LANES, M)) - (0.5 if M == 12 else 2.0),
        least=-rng.uniform(0.1, 1.0, (LANES, N)),
        greatest=rng.uniform(0.1, 1.0, (LANES, N)),
        # At the low prices rows are paid for, at the high ones they are met where that can be.
        price=10.0 ** rng.uniform(-1, 3, LANES),
    )


@pytest.fixture(scope="module")
def solutions(programs):
    return jax.jit(jax.vmap(quadratic.solve_quadratic_program))(jax.tree.map(jnp.asarray, programs))


def lane_of(programs, lane):
    return quadratic.QuadraticProgram(*(np.asarray(part[lane]) for part in programs))


def cost(of, d):
    return d @ of.B @ d / 2 + of.g @ d + of.price * np.sum(np.maximum(of.c + of.J @ d, 0.0))


def by_scipy(of):
    """The same as a smooth program, with a variable for each row's violation."""

    def value(x):
        d, s = x[:N], x[N:]
        return d @ of.B @ d / 2 + of.g @ d + of.price * np.sum(s)

    def slope(x):
        return np.append(of.B @ x[:N] + of.g, np.full(M, of.price))

    M = len(of.c)
    rows = np.hstack([-of.J, np.eye(M)])
    met = {"type": "ineq", "fun": lambda x: rows @ x - of.c, "jac": lambda x: rows}
    bounds = [*zip(of.least, of.greatest, strict=True), *[(0, None)] * M]
    start = np.append(np.zeros(N), np.maximum(of.c, 0.0))
    options = {"ftol": 1e-15, "maxiter": 500}
    found = minimize(
        value, start, jac=slope, bounds=bounds, constraints=met, method="SLSQP", options=options
    )
    return found.x[:N]


def test_scipy_finds_the_same_cost(programs, solutions):
    lanes = range(0, LANES, len(programs.c[0]) // 12)
    same = 0
    for lane in lanes:
        of = lane_of(programs, lane)
        ours, other = cost(of, np.asarray(solutions.d[lane])), cost(of, by_scipy(of))
        assert ours <= other + 1e-9 * (1 + abs(other))
        same += int(ours == pytest.approx(other, rel=1e-6))
    if len(programs.c[0]) == 12:  # of so many rows SLSQP is capable, but for a stall now and then
        assert same >= len(lanes) - 2


def test_no_point_at_all_costs_less(programs, solutions):
    for lane in range(LANES):
        of, d = lane_of(programs, lane), np.asarray(solutions.d[lane])
        y = np.asarray(solutions.multipliers[lane])
        assert np.all((d >= of.least) & (d <= of.greatest))
        assert np.all((y >= 0) & (y <= of.price))
        # Multipliers from 0 to the price bound the cost from below by a convex function, and its
        # tangent plane at d bounds that within the bounds of d.
        slope = of.B @ d + of.g + of.J.T @ y
        tangent = np.minimum(slope * (of.least - d), slope * (of.greatest - d))
        bound = d @ of.B @ d / 2 + of.g @ d + y @ (of.c + of.J @ d) + np.sum(tangent)
        assert cost(of, d) - bound <= 1e-9 * (1 + abs(cost(of, d)))


def test_a_price_too_low_is_paid_and_one_high_enough_is_not():
    # min d^2/2 + price max(0, 1 - d): d = price where that is below 1, else 1 with multiplier 1.
    one = jnp.ones(1)
    for price, expected in ((0.3, 0.3), (4.0, 1.0)):
        found = quadratic.solve_quadratic_program(
            quadratic.QuadraticProgram(
                jnp.eye(1), 0 * one, -jnp.eye(1), one, -5 * one, 5 * one, jnp.array(price)
            )
        )
        assert float(found.d[0]) == pytest.approx(expected, abs=1e-12)
        assert float(found.multipliers[0]) == pytest.approx(expected, abs=1e-9)
