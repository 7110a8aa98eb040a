"""What solving many problems compiles and keeps, and how far from a solution a guess may be."""

import gc
import weakref
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from beltjax.numerics.bvp.arguments import checked_guess, checked_interval, first_start
from beltjax.numerics.bvp.compiled_parts import EVALUATIONS_KEPT, SOLVERS_KEPT, kept_for_few
from beltjax.numerics.bvp.continuation import continue_bvp
from beltjax.numerics.bvp.solve import solve_bvp
from beltjax.results import RESULTS

UNIT = (0.0, 1.0)
FLAT = (np.array([0.0, 1.0]), np.zeros((2, 2)))
COMPILED: list[str] = []  # an entry for every program of XLA

jax.monitoring.register_event_duration_secs_listener(
    lambda name, *_, **__: COMPILED.append(name) if "backend_compile" in name else None
)


def bratu(x, y, p, factor):
    return jnp.stack([y[1], -factor * jnp.exp(y[0])])


def clamped(ya, yb, p, args):
    return jnp.stack([ya[0], yb[0]])


def new_bratu(factor):
    """Another right-hand side, for all that JAX can tell."""
    return lambda x, y, p, args: bratu(x, y, p, factor)


NEW_NUMBERS = {
    "float": {"args": 0.5},
    "NumPy scalar": {"args": np.float64(0.6)},
    "array": {"args": np.array(0.7)},
    "strong type": {"args": jnp.array(0.8)},
    "weak type": {"args": jnp.asarray(0.9)},
    "guess": {"args": 1.0, "guess": (np.array([0.0, 0.9]), np.full((2, 2), 0.1))},
    "weakly typed guess": {"args": 1.0, "guess": (jnp.arange(2.0), jnp.full((2, 2), 0.1))},
    "interval": {"args": 1.0, "interval": (np.float64(0.0), 1)},
    "tol": {"args": 1.0, "tol": 1e-7},
}


@pytest.fixture(scope="module")
def first_solution():
    solve_bvp(bratu, clamped, UNIT, FLAT, args=jnp.asarray(1.0))
    return solve_bvp(bratu, clamped, UNIT, FLAT, args=1.0)


@pytest.mark.parametrize("change", NEW_NUMBERS.values(), ids=NEW_NUMBERS)
def test_new_numbers_compile_nothing(change, first_solution):
    assert first_solution.result == RESULTS.successful
    COMPILED.clear()
    given = {"interval": UNIT, "guess": FLAT} | change
    solution = solve_bvp(bratu, clamped, **given)
    assert solution.result == RESULTS.successful
    assert not COMPILED


def test_another_problem_of_the_same_size_compiles_only_its_equations(first_solution):
    """Those on the mesh, and those on the finer one of the estimate; likewise along a path."""
    COMPILED.clear()
    other = solve_bvp(new_bratu(1.0), clamped, UNIT, FLAT)
    assert len(COMPILED) == 2
    np.testing.assert_allclose(other.y, first_solution.y, rtol=1e-14, atol=1e-16)
    COMPILED.clear()
    path = np.array([0.5, 1.0])
    last = continue_bvp(bratu, clamped, UNIT, FLAT, path=path, nodes=32)
    assert len(COMPILED) <= 4
    np.testing.assert_allclose(last.y, first_solution.y, atol=1e-9)


def memory_maps():
    return len(Path("/proc/self/maps").read_text().splitlines())


def test_programs_of_earlier_problems_are_given_back(first_solution):
    """Kept programs would be as many as problems, and their memory maps a thousand times that."""
    rights, maps = [], []
    for k in range(EVALUATIONS_KEPT + 4):
        right = new_bratu(1.0 + 0.01 * k)
        rights.append(weakref.ref(right))
        solve_bvp(right, clamped, UNIT, FLAT, nodes=32)
        maps.append(memory_maps())
    gc.collect()
    assert sum(right() is not None for right in rights) <= EVALUATIONS_KEPT
    # Four problems more are kept no longer; the allocator's own maps come and go by a few.
    assert maps[-1] - maps[EVALUATIONS_KEPT] < 10


def test_programs_of_earlier_derivatives_are_given_back():
    """A derivative taken eagerly compiles the derivative of a kept program: it goes with it."""
    run = kept_for_few(lambda function, x: function(x))

    def slope(factor):
        return jax.grad(lambda x: run(lambda x: jnp.sum(jnp.sin(factor * x) ** 3), x))(jnp.ones(5))

    maps, further = [], 8
    for k in range(SOLVERS_KEPT + 2 + further):
        assert slope(float(k)) == pytest.approx(3 * k * np.sin(k) ** 2 * np.cos(k))
        maps.append(memory_maps())
    gc.collect()
    # A kept program has a map or more; the allocator's own maps come and go by a few.
    assert memory_maps() - maps[SOLVERS_KEPT + 1] < further


# Guesses far from the solution.


def stagnation(x, y, p, args):
    """Hiemenz's flow towards a wall: y''' = -y y'' + y'^2 - 1."""
    return jnp.stack([y[1], y[2], -y[0] * y[2] + y[1] ** 2 - 1])


def wall_and_stream(ya, yb, p, args):
    return jnp.stack([ya[0], ya[1], yb[1] - 1])


def rotating_disk(x, y, p, args):
    """Von Karman's swirling flow; y is (F, F', G, G', H)."""
    F, F1, G, G1, H = y
    return jnp.stack([F1, F**2 - G**2 + H * F1, G1, 2 * F * G + H * G1, -2 * F])


def disk_and_rest(ya, yb, p, args):
    return jnp.stack([ya[0], ya[2] - 1, ya[4], yb[0], yb[2]])


def constant(b, values):
    return np.array([0.0, b]), np.repeat(np.array(values, float)[:, None], 2, axis=1)


# Newton's method alone fails from each of these.
@pytest.mark.parametrize(
    "guess", [(0, 0, 1), (5, 1, 1), (-1, -1, -1), (0, 0, 1.2), (0.1, 0.1, 0.1), (1, 0, 1)]
)
def test_stagnation_flow_from_a_constant(guess):
    solution = solve_bvp(stagnation, wall_and_stream, (0.0, 10.0), constant(10.0, guess))
    assert float(solution.y[2, 0]) == pytest.approx(1.2325876568, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    "guess",
    [
        (0, 0, 0, 0, 0),
        (1, 1, 1, 1, 1),
        (-1, -1, -1, -1, -1),
        (0, 0, 1, 0, 0),
        (0.1, 0.1, 0.1, 0.1, 0.1),
        (0, 0.5, 0, -0.6, 0),
    ],
)
def test_rotating_disk_from_a_constant(guess):
    solution = solve_bvp(rotating_disk, disk_and_rest, (0.0, 20.0), constant(20.0, guess))
    assert float(solution.y[1, 0]) == pytest.approx(0.510233, abs=5e-7)
    assert float(solution.y[3, 0]) == pytest.approx(-0.615922, abs=5e-7)


def test_first_slopes_of_a_guess_are_those_by_x():
    """Not by fractions of the interval, which are twenty times as large on [0, 20]."""
    interval = checked_interval((0.0, 20.0))
    x, y = checked_guess((np.array([0.0, 20.0]), np.array([[1.0, 5.0]])), interval, 9)
    start = first_start(interval, x, y, jnp.zeros(0), 9, 4)
    np.testing.assert_allclose(start.z.K, 0.2, rtol=1e-12)


@pytest.mark.slow
def test_no_solution_is_a_failure_after_two_sizes():
    """Bratu's problem beyond its fold; every further size would compile anew."""
    found = solve_bvp(bratu, clamped, UNIT, FLAT, args=4.0, throw=False)
    assert found.result == RESULTS.newton_failed
    assert found.nodes in (32, 128)
    COMPILED.clear()
    solve_bvp(bratu, clamped, UNIT, FLAT, args=5.0, throw=False)
    assert not COMPILED
