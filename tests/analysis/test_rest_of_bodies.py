"""Where bodies stand at rest and running strings: stops, torques, and what cannot be held."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies_cases import ECCENTRIC, load
from drives import example

import beltjax as bj


def test_a_floating_arm_is_installed_at_the_stop_that_the_belt_pulls_it_to():
    drive, _ = example("three_pulley")
    arm = dataclasses.replace(drive.tensioner, stiffness=0.0, stops=(-0.1, 0.1))
    free = bj.Drive(drive.belts, drive.pulleys, bj.TensionGiven(300.0), arm, drive.sense)
    still = bj.OperatingPoint(belt_speed=0.0)
    state = bj.reference_state(free, still)
    paths = [float(bj.layout(free, at).path_length) for at in (-0.1, 0.1)]
    # The belt shortens its path.
    end = (-0.1, 0.1)[int(np.argmin(paths))]
    np.testing.assert_allclose(state.installed, [end], atol=1e-12)
    strain = 300.0 / float(drive.belt.axial_stiffness)
    np.testing.assert_allclose(state.unstretched_length, min(paths) / (1 + strain), rtol=1e-12)
    np.testing.assert_allclose(state.tensions, 300.0, rtol=1e-10)
    assert float(state.stop_reactions[0]) * end < 0


def test_torques_of_the_running_string_act_on_what_the_momentum_flux_leaves_of_its_tension():
    """docs/theory/contact.md, (C2) and (C3): r times the change of P - G V is the torque."""
    drive, _ = example("three_pulley")
    string = eqx.tree_at(
        lambda d: (d.belt.bending_stiffness, d.model),
        drive,
        (jnp.array(0.0), bj.Model(1, 1, 1)),
    )
    point = bj.OperatingPoint(belt_speed=60.0, torque={"accessory": 4.0})
    steady = bj.steady_state(string, point)
    left = np.asarray(steady.running_tensions) * (
        1 - float(drive.belt.mass_per_length) * 60.0**2 / float(drive.belt.axial_stiffness)
    )
    place = drive.pulley("accessory")
    change = left[place] - left[place - 1]
    np.testing.assert_allclose(change * float(drive.pulleys[place].radius), 4.0, rtol=1e-10)


@pytest.mark.slow
def test_an_adjustment_that_does_not_exist_has_finite_derivatives(tmp_path):
    """Case 24 adjusts an eccentric to a mark that no place of it reaches."""
    drive, point = load(tmp_path, ECCENTRIC)

    def total(numbers):
        steady = bj.steady_state(*numbers, throw=False)
        return jnp.sum(steady.coupling), steady.result

    (_, result), slopes = bj.quick_jit(jax.value_and_grad(total, has_aux=True))((drive, point))
    assert result == bj.RESULTS.belt_does_not_fit
    assert all(np.all(np.asarray(leaf) == 0) for leaf in jax.tree.leaves(slopes))


def test_a_spring_that_the_tension_settles_is_not_relaxed_elsewhere():
    drive, point = example("three_pulley")
    settled = bj.reference_state(drive, point)
    for offset, result in ((0.0, bj.RESULTS.successful), (0.3, bj.RESULTS.belt_does_not_fit)):
        rule = bj.TensionGiven(drive.installation.tension, free=settled.free + offset)
        given = eqx.tree_at(
            lambda d: d.installation, drive, dataclasses.replace(rule, as_drawn=True)
        )
        assert bj.reference_state(given, point, throw=False).result == result
