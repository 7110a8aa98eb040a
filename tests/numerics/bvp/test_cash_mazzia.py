"""The Cash-Mazzia set at 64 intervals, through one compiled program."""

import numpy as np
import pytest

from beltjax.numerics.bvp.continuation import continue_bvp
from beltjax.results import RESULTS
from beltjax.validation import cash_mazzia as cm
from beltjax.validation.cash_mazzia_references import REFERENCES, points

TOL = 1e-6
RUNGS = 10
USUAL = (1e-2, 1e-3, 1e-4, 1e-6)
SMALL = {
    9: (1e-1, 1e-2, 1e-4),
    15: (1e-1, 1e-3),
    16: (1 / 3, 1 / 9, 1 / 21),
    17: (1e-1, 1e-3, 1e-6),
    35: (1e-1, 3e-2),
}
EXACT = [(c.number, e) for c in cm.CASES if c.exact for e in SMALL.get(c.number, USUAL)]

# What 65 nodes and a ladder of ten do not solve to 1e-6, and how that is reported.
BEYOND = [
    # 33 waves on 64 intervals; 257 nodes solve it.
    (15, 1e-5, RESULTS.mesh_exhausted),
    (26, 1e-6, RESULTS.mesh_exhausted),
    # The shock's place moves by more than its width from one rung to the next.
    (30, 1e-6, RESULTS.mesh_exhausted),
    # Resonance: the problem's own condition is e^(1/(2 eps)), here 5e21 and more.
    *((35, eps, RESULTS.singular_system) for eps in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8)),
]


def solve(number, eps, *, ladder=True, tol=TOL):
    case = cm.CASES[cm.BY_NUMBER[number]]
    path = cm.path(number, eps, RUNGS, start=0.1 if number == 24 else 1.0)
    if number == 16 or not ladder:  # 16: each eps is a different number of waves
        path = tuple(np.repeat(part[-1:], RUNGS, axis=0) for part in path)
    a, b = case.interval
    guess = cm.line(number, path[1][0])
    return case, continue_bvp(
        cm.rhs, cm.bc, (float(a), float(b)), guess, path=path, nodes=65, tol=tol, throw=False
    )


@pytest.mark.parametrize(("number", "eps"), EXACT)
def test_agrees_with_the_exact_solution(number, eps):
    case, solution = solve(number, eps)
    assert case.exact is not None
    assert solution.result == RESULTS.successful
    x = np.unique(np.concatenate([np.linspace(*case.interval, 1001), np.asarray(solution.x)]))
    exact = case.exact(x, eps)
    error = np.max(np.abs(np.asarray(solution(x))[0] - exact)) / (1 + np.max(np.abs(exact)))
    assert error <= TOL
    # The estimate is of the error, not of its square root: within three digits above, and
    # never below it by more than rounding and the points where it did not look.
    assert error <= 2.0 * float(solution.error) + 1e-9


@pytest.mark.parametrize(("number", "eps"), sorted(REFERENCES))
def test_agrees_with_a_converged_reference(number, eps):
    _, solution = solve(number, eps)
    assert solution.result == RESULTS.successful
    scale = 1 + np.max(np.abs(np.asarray(solution.y)[0]))
    found = solution(points(eps))[0]
    np.testing.assert_allclose(found, REFERENCES[number, eps], rtol=0, atol=TOL * scale)


@pytest.mark.parametrize(("number", "eps", "result"), BEYOND)
def test_what_is_beyond_it_is_reported(number, eps, result):
    _, solution = solve(number, eps)
    assert solution.result == result
    assert float(solution.error) > TOL
    assert np.isfinite(np.asarray(solution.y)).all()


@pytest.mark.parametrize("eps", [1e-3, 1e-4, 1e-5, 1e-6])
@pytest.mark.parametrize("tol", [TOL, 0.1])
def test_a_layer_that_no_node_sees_is_no_success(eps, tol):
    """From a line, nodes crowd at one end of problem 35 at most: y = 2x or -x for the true x/2.

    Both satisfy the equation to any accuracy and one end's condition through its layer; only
    the condition of the problem tells them from a solution.
    """
    _, solution = solve(35, eps, ladder=False, tol=tol)
    assert solution.result == RESULTS.singular_system
    assert float(solution.condition) > 1e12


@pytest.mark.parametrize("eps", [0.1, 0.05, 0.03, 0.02])
def test_condition_of_resonance(eps):
    """A jump of y at x = 0 moves problem 35's x/2 by about e^(1/(2 eps)) as much.

    The outgoing mode, one at the ends, is e^(-1/(2 eps)) there but for powers of eps.
    """
    _, solution = solve(35, eps)
    assert abs(np.log(float(solution.condition)) - 1 / (2 * eps)) < 2.5


@pytest.mark.parametrize("eps", [1e-2, 1e-4, 1e-6])
def test_condition_of_a_layer_does_not_grow(eps):
    """By the maximum principle a jump in problem 1 moves y by its own size at most; 128 jumps."""
    _, solution = solve(1, eps)
    assert 1.0 < float(solution.condition) < 200.0
