"""Published problems with parameters, periodic conditions, singular terms and four states."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.special

from beltjax.numerics.bvp.continuation import continue_bvp
from beltjax.numerics.bvp.solve import solve_bvp
from beltjax.results import RESULTS
from beltjax.validation.cash_mazzia_references import SWIRL, SWIRL_POINTS
from numerics.bvp import bvp_problems as problems

NODES = 65
X = np.linspace(0.0, 1.0, 41)


def _args(which, value):
    # The choice is data: every member of a group runs the same compiled program.
    return jnp.array(which), jnp.array(value)


def with_parameter(which, value, interval, guess, p=0.0, *, m=0.0, **options):
    """A member of the group with -m y'/x added to y''; `guess` is of x [101]."""
    rhs, bc = problems.with_parameter
    x = jnp.linspace(interval[0], interval[1], 101)
    y = jnp.asarray(np.stack(guess(np.asarray(x))))
    term = jnp.array([[0.0, 0.0], [0.0, -m]])
    args = _args(which, value)
    return solve_bvp(rhs, bc, interval, (x, y), jnp.array([p]), args, term, nodes=NODES, **options)


def four_states(which, value, interval=(0.0, 1.0), guess=None):
    rhs, bc = problems.four_states
    if guess is None:
        guess = (jnp.linspace(interval[0], interval[1], 201), jnp.zeros((4, 201)))
    args = _args(which, value)
    return solve_bvp(rhs, bc, interval, guess, args=args, nodes=NODES, throw=False)


@pytest.mark.parametrize(("order", "q"), [(0, 5.0), (2, 5.0), (4, 5.0), (4, 15.0)])
def test_mathieu_characteristic_value(order, q):
    def guess(x):
        return np.cos(order * x), -order * np.sin(order * x)

    start = scipy.special.mathieu_a(order, q) + 0.5
    solution = with_parameter(problems.MATHIEU, q, (0.0, np.pi), guess, start)
    assert float(solution.parameters[0]) == pytest.approx(
        scipy.special.mathieu_a(order, q), abs=1e-8
    )


@pytest.mark.parametrize(
    ("mu", "period"),
    # Andersen and Geer (1982): series in mu^2 to order 163.
    [(1.0, 6.66328685932313), (2.0, 7.62987447967484), (3.0, 8.85909549923762)],
)
def test_van_der_pol_period(mu, period):
    orbit = _van_der_pol_orbit(mu)

    def guess(x):
        return [np.interp(x, np.linspace(0, 1, len(part)), part) for part in orbit]

    start = 1.05 * period
    solution = with_parameter(problems.VAN_DER_POL, mu, (0.0, 1.0), guess, start, tol=1e-5)
    assert float(solution.parameters[0]) == pytest.approx(period, abs=2e-7)


def _van_der_pol_orbit(mu):
    """A crude orbit over about a period from y' = 0, for a guess."""

    def field(t, y):
        return [y[1], mu * (1 - y[0] ** 2) * y[1] - y[0]]

    start = scipy.integrate.solve_ivp(field, (0, 50), [2.0, 0.0], events=lambda t, y: y[1])
    top = [i for i, y in enumerate(start.y_events[0]) if y[0] > 0][-1]
    times = np.linspace(0, 6.66 + 1.1 * (mu - 1), 60)
    return scipy.integrate.solve_ivp(field, (0, 10), start.y_events[0][top], t_eval=times).y


def test_forced_oscillator_is_periodic():
    def guess(x):
        return np.cos(x) / 3, -np.sin(x) / 3

    solution = with_parameter(problems.FORCED, 0.3, (0.0, 2 * np.pi), guess, 0.0)
    x = np.linspace(0, 2 * np.pi, 50)
    exact = np.real(np.exp(1j * x) / (3 + 0.3j))
    np.testing.assert_allclose(solution(x)[0], exact, atol=1e-7)


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_sturm_liouville_eigenvalue(n):
    exact = 0.25 + (n * np.pi / np.log(2)) ** 2

    def guess(x):
        return np.sin(n * np.pi * x) / (n * np.pi), np.cos(n * np.pi * x)

    solution = with_parameter(problems.EIGENVALUE, 0.0, (0.0, 1.0), guess, 0.95 * exact)
    assert float(solution.parameters[0]) == pytest.approx(exact, rel=1e-8)


SLOW_SWIRL = [pytest.param(e, marks=pytest.mark.slow) for e in sorted(SWIRL)[1:]]


@pytest.mark.parametrize("e", [sorted(SWIRL)[0], *SLOW_SWIRL])
def test_swirling_flow(e):
    x = jnp.linspace(0.0, 1.0, 2)
    guess = (x, jnp.stack([0 * x, 0 * x, 0 * x, 0 * x, 2 * x - 1, 2 + 0 * x]))
    path = np.geomspace(1.0, e, 6)
    solution = continue_bvp(
        problems.swirling, problems.disks, (0.0, 1.0), guess, path=path, nodes=NODES
    )
    f, _, _, _, g, _ = solution(SWIRL_POINTS)
    np.testing.assert_allclose(f, SWIRL[e][0], atol=1e-7)
    np.testing.assert_allclose(g, SWIRL[e][1], atol=1e-7)


@pytest.mark.parametrize(
    "e", [0.3, *(pytest.param(e, marks=pytest.mark.slow) for e in (0.02, 1e-3, 1e-4))]
)
def test_tensioned_beam(e):
    solution = four_states(problems.TENSIONED, e)
    assert solution.result == RESULTS.successful
    np.testing.assert_allclose(solution(X)[0], problems.tensioned_beam(X, e), atol=1e-7)


def test_beam_of_graded_stiffness():
    solution = four_states(problems.GRADED, 0.0, (1.0, 2.0))
    assert solution.result == RESULTS.successful
    np.testing.assert_allclose(solution(1 + X)[0], problems.graded_beam(1 + X), atol=1e-9)


@pytest.mark.parametrize(
    ("which", "value"),
    [
        (problems.BUCKLED, 0.1),
        (problems.BUCKLED, 0.02),
        (problems.POROUS, 10.0),
        (problems.POROUS, 100.0),
        (problems.POROUS, 1000.0),
    ],
)
def test_four_states_agree_with_scipy(which, value):
    rhs, bc = problems.four_states
    args = _args(which, value)
    x = np.linspace(0, 1, 201)
    start = np.zeros((4, 201))
    if which == problems.POROUS:
        start[:2] = x**2 * (3 - 2 * x), 6 * x * (1 - x)
    columns = jax.jit(jax.vmap(lambda x, y: rhs(x, y, None, args), in_axes=(0, 1), out_axes=1))
    ends = jax.jit(lambda a, b: bc(a, b, None, args))
    reference = scipy.integrate.solve_bvp(
        lambda x, y: np.asarray(_padded(columns, x, y)),
        lambda a, b: np.asarray(ends(a, b)),
        x,
        start,
        tol=1e-8,
        max_nodes=20000,
    )
    assert reference.status == 0
    solution = four_states(which, value, guess=(jnp.asarray(x), jnp.asarray(start)))
    assert solution.result == RESULTS.successful
    scale = 1 + np.max(np.abs(reference.y), axis=1, keepdims=True)
    error = np.abs(np.asarray(solution(X)) - reference.sol(X)) / scale
    assert error.max() < 1e-6


def _padded(columns, x, y):
    """SciPy's mesh changes size; one compiled size serves it."""
    size = 1 << int(np.ceil(np.log2(len(x))))
    extra = size - len(x)
    x, y = np.pad(x, (0, extra), mode="edge"), np.pad(y, ((0, 0), (0, extra)), mode="edge")
    return columns(x, y)[:, : size - extra]


def singular_problem(which, m, b):
    def guess(x):
        return 1.0 - 0.2 * x / b, 0.0 * x

    solution = with_parameter(which, 0.0, (0.0, b), guess, m=m)
    assert solution.result == RESULTS.successful
    return solution


def test_lane_emden_with_a_singular_term():
    solution = singular_problem(problems.EMDEN, 2.0, 1.0)
    np.testing.assert_allclose(solution(X)[0], 1 / np.sqrt(1 + X**2 / 3), atol=1e-8)


def test_bessel_function_with_a_singular_term():
    solution = singular_problem(problems.BESSEL, 1.0, 2.0)
    np.testing.assert_allclose(solution(2 * X)[0], scipy.special.j0(2 * X), atol=1e-8)


def test_isothermal_sphere_against_its_series():
    """Chandrasekhar (1939): x^2/6 - x^4/120 + x^6/1890 - 61 x^8/1632960 + ..."""
    solution = singular_problem(problems.CHANDRASEKHAR, 2.0, 1.0)
    x = 0.5 * X
    series = x**2 / 6 - x**4 / 120 + x**6 / 1890 - 61 * x**8 / 1632960 + 629 * x**10 / 224532000
    np.testing.assert_allclose(solution(x)[0], series, atol=1e-8)


def test_a_singular_problem_is_named():
    def guess(x):
        return 0.0 * x, 0.0 * x

    solution = with_parameter(problems.STRAIGHT, 0.0, (0.0, 1.0), guess, throw=False)
    assert solution.result == RESULTS.singular_system
