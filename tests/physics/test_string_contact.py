"""The string limit by itself, against the whole solver at EI = 0 and against print."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from drives import example

import beltjax as bj
from beltjax.physics.string_contact import critical_speed, string_drive


def test_critical_speed_of_table_5_3():
    # Printed 374 m/s.
    assert float(critical_speed(800.0, 40e3, 0.0056)) == pytest.approx(374.24, abs=5e-3)


@pytest.mark.parametrize("maximum", [False, True])
@pytest.mark.parametrize("name", ["two_pulley_table_5_1", "two_pulley_table_5_3"])
def test_string_route_agrees_with_the_general_one(name, maximum):
    drive, point = example(name)
    drive = eqx.tree_at(lambda d: d.belt.bending_stiffness, drive, jnp.zeros(()))
    state = (bj.maximum_moment if maximum else bj.contact_state)(drive, point)
    loop = state.solved.loop
    string = string_drive(state.model, jnp.ones(()), loop.g, maximum)
    assert string.converged
    factor = np.exp(state.solved.unknown.scale)
    np.testing.assert_allclose(string.P, loop.C, rtol=1e-11)
    np.testing.assert_allclose(string.L, loop.spans.L, rtol=1e-13)
    np.testing.assert_allclose(string.wrap, loop.wrap, rtol=1e-13)
    np.testing.assert_allclose(string.slip, loop.slip, atol=1e-11)
    np.testing.assert_allclose(string.pull, factor * state.model.pull, atol=1e-11)
    assert float(string.L0) == pytest.approx(float(state.solved.held.L0[0]), rel=1e-13)
