"""The optimizer on textbook problems with known optima and multipliers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import beltjax as bj

lagrangian = bj.optimize.augmented_lagrangian


def solve(evaluate, starts, constraints, steps=30):
    states = jax.vmap(lambda x: lagrangian.first_iterate(x, constraints))(jnp.asarray(starts))
    step = jax.jit(jax.vmap(lambda s: lagrangian.outer_step(evaluate, s)))
    for _ in range(steps):
        states = step(states)
    return states, jax.vmap(lagrangian.to_unit)(states.z)


def test_hock_schittkowski_71_rescaled_to_the_unit_box():
    # Hock and Schittkowski (1981), problem 71 with its equality as an upper limit on -g and g.
    def evaluate(x):
        y = 1 + 4 * x
        product, square = jnp.prod(y), jnp.sum(y**2)
        objective = y[0] * y[3] * jnp.sum(y[:3]) + y[2]
        constraints = jnp.stack([25 - product, square - 40, 40 - square]) / 10
        return lagrangian.Evaluation(objective / 10, constraints, jnp.array(True))

    starts = np.random.default_rng(0).uniform(0.05, 0.95, (8, 4))
    states, x = solve(evaluate, starts, 3)
    best = int(jnp.argmin(jnp.where(states.violation < 1e-6, states.objective, jnp.inf)))
    assert float(states.objective[best]) * 10 == pytest.approx(17.0140173, rel=1e-6)
    known = [1.0, 4.7429994, 3.8211503, 1.3794082]
    np.testing.assert_allclose(1 + 4 * np.asarray(x[best]), known, rtol=1e-4)
    # Multipliers of the product and of the sum of squares, in the problem's own units.
    found = np.asarray(states.multipliers[best])
    assert found[0] == pytest.approx(0.5522936, rel=1e-3)
    assert abs(found[1] - found[2]) == pytest.approx(0.1614686, rel=1e-3)


def test_active_bound_and_constraint_with_exact_multiplier():
    # min (x - 2)^2 + (y - 2)^2, x + y <= 1.2: at (0.6, 0.6), multiplier 2 (2 - 0.6) = 2.8.
    def evaluate(x):
        return lagrangian.Evaluation(
            jnp.sum((x - 2) ** 2), jnp.array([jnp.sum(x) - 1.2]), jnp.array(True)
        )

    states, x = solve(evaluate, [[0.1, 0.9], [0.5, 0.5], [0.9, 0.2]], 1, steps=20)
    assert states.done.tolist() == [True] * 3
    np.testing.assert_allclose(x, 0.6, rtol=1e-6)
    np.testing.assert_allclose(states.multipliers, 2.8, rtol=1e-5)


def test_infeasible_lane_gives_up_and_leaves_its_neighbor_alone():
    # Feasible only from a start on the valid side of a cliff; the other cannot be evaluated.
    def evaluate(x):
        valid = x[0] < 0.7
        return lagrangian.Evaluation(
            jnp.where(valid, jnp.sum(x**2), 0.0), jnp.array([0.3 - x[0]]), valid
        )

    states, x = solve(evaluate, [[0.5, 0.5], [0.9, 0.5]], 1, steps=20)
    assert states.done.tolist() == [True, False]
    assert states.stopped.tolist() == [True, True]
    np.testing.assert_allclose(x[0], [0.3, 0.0], atol=1e-6)


def test_contradicting_constraints_stop_with_their_violation():
    def evaluate(x):
        return lagrangian.Evaluation(
            jnp.sum(x), jnp.array([0.8 - x[0], x[0] - 0.2]), jnp.array(True)
        )

    states, _ = solve(evaluate, [[0.5]], 2)
    assert not bool(states.done[0])
    assert bool(states.stopped[0])
    assert float(states.violation[0]) == pytest.approx(0.3, abs=1e-4)
