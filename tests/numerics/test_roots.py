"""Searches for roots of small systems, and the roots' derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from beltjax.numerics.roots import (
    followed_root,
    implicit_root,
    implicit_solution,
    increasing_root,
    solve_dense,
    system_root,
)


def curved(x):
    """Two valleys that cross at (1, 1)."""
    return jnp.stack([10 * (x[1] - x[0] ** 2), 1 - x[0], jnp.sinh(x[2] - x[0])])


def test_a_search_does_not_know_how_its_equations_are_scaled():
    guess, largest = jnp.array([-1.2, 1.0, 0.0]), jnp.ones(3)
    mixed = jnp.array([[1e9, 0.0, 1.0], [0.0, 1e-7, 2e-7], [1.0, -1.0, 1.0]])
    one = system_root(curved, guess, largest)
    other = system_root(lambda x: mixed @ curved(x), guess, largest)
    assert one.converged
    assert other.converged
    assert int(one.steps) == int(other.steps)
    assert one.root == pytest.approx(np.ones(3), abs=1e-12)
    assert other.root == pytest.approx(np.ones(3), abs=1e-8)


def test_no_step_is_longer_than_allowed():
    found = system_root(lambda x: x - 100.0, jnp.zeros(1), jnp.ones(1), max_steps=50)
    assert not found.converged
    assert 0 < found.root[0] <= 50
    assert system_root(lambda x: x - 100.0, jnp.zeros(1), jnp.ones(1), max_steps=150).converged


def hidden(x, load):
    """A root at 5 load behind a hump that stops Newton's method from the left."""
    y = x - 5 * load
    return y * (y**2 + 3 * y + 2.5)


def test_following_the_load_passes_what_stops_a_direct_search():
    guess, largest = jnp.zeros(1), jnp.full(1, 0.5)
    assert not system_root(lambda x: hidden(x, 1.0), guess, largest, max_steps=25).converged
    found, load = followed_root(hidden, guess, guess, largest)
    assert found.converged
    assert load == 1
    assert found.root == pytest.approx([5.0])


def test_following_the_load_begins_at_its_own_origin():
    # From -9 the direct search and the first loads fail; from 0 they do not.
    far, origin, largest = jnp.full(1, -9.0), jnp.zeros(1), jnp.full(1, 0.5)
    assert not followed_root(hidden, far, far, largest)[0].converged
    found, _ = followed_root(hidden, far, origin, largest)
    assert found.root == pytest.approx([5.0])


def test_following_the_load_gives_up_at_a_fold():
    start = jnp.ones(1)
    found, load = followed_root(lambda x, load: x**2 + load - 0.6, start, start, jnp.ones(1))
    assert not found.converged
    assert 0.6 - 2 / 64 < load <= 0.6
    assert found.root**2 == pytest.approx(0.6 - float(load), abs=1e-9)


def test_an_increasing_function_without_a_root_ends_at_the_bound():
    found = increasing_root(lambda x: jnp.exp(x), jnp.asarray(-1.0), jnp.asarray(2.0))
    assert found.root == pytest.approx(-1.0, abs=1e-6)
    assert found.residual > 0


@pytest.mark.parametrize("n", [1, 2, 3, 10])
def test_linear_equations_are_solved(n):
    rng = np.random.default_rng(n)
    matrix, right = rng.normal(size=(n, n)), rng.normal(size=n)
    x = solve_dense(jnp.asarray(matrix), jnp.asarray(right))
    assert matrix @ np.asarray(x) == pytest.approx(right, rel=1e-10)


def test_a_root_is_differentiated_at_its_equations():
    def root(a):
        start = jax.lax.stop_gradient(jnp.stack([jnp.sqrt(a), a]))
        return implicit_root(lambda x, a: jnp.stack([x[0] ** 2 - a, x[1] - x[0] ** 2]), a, start)

    slope = jax.jacfwd(root)(4.0)
    assert slope == pytest.approx([0.25, 1.0])
    assert jax.jacrev(root)(4.0) == pytest.approx(slope)
    assert jax.jacfwd(jax.jacrev(root))(4.0) == pytest.approx([-1 / 32, 0.0])


def test_what_follows_from_a_root_is_differentiated_with_it():
    # x = sqrt(a), and with it a x = a^1.5 and its count of lanes, which is no number to move.
    def function(x, a):
        return x**2 - a["square"], {"cube": a["square"] * x, "count": jnp.array(len(x))}

    def cube(square):
        root = jax.lax.stop_gradient(jnp.sqrt(square))[None]
        x, rest = implicit_solution(function, {"square": square}, root)
        assert rest["count"].dtype == int
        return rest["cube"][0], x[0]

    for a in (0.3, 2.0):
        for slope in (jax.jacfwd, jax.jacrev):
            by_cube, by_root = slope(cube)(a)
            assert by_cube == pytest.approx(1.5 * a**0.5, rel=1e-14)
            assert by_root == pytest.approx(0.5 * a**-0.5, rel=1e-14)
        bent, _ = jax.jit(jax.hessian(cube))(a)
        assert bent == pytest.approx(0.75 * a**-0.5, rel=1e-14)
