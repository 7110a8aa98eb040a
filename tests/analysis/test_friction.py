"""Dry friction of a tensioner against stored stick-slip, power, and what locks the arm."""

import json
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drives import EXAMPLES, example

import beltjax as bj
from beltjax.compiling.quick import quickly_compiled

CASE = json.loads((Path(__file__).parents[1] / "data" / "periodic.json").read_text())["friction"]
SPEED = 2000 * 2 * np.pi / 60
MODAL = bj.Damping(modal=0.02)
CRANK = bj.Excitation(crank=np.deg2rad(0.1))
THREE = example("three_pulley")


def with_friction(torque, speed=0.05):
    numbers = jnp.asarray(torque), jnp.asarray(speed)
    places = lambda d: (d.tensioner.friction_torque, d.tensioner.friction_speed)  # noqa: E731
    return eqx.tree_at(places, THREE[0], numbers)


def moved(torque, speed=0.05, **options):
    options = {"functions": 8, "harmonics": 12} | options
    point = bj.OperatingPoint(driver_speed=SPEED)
    return bj.periodic_response(
        with_friction(torque, speed), point, bj.Orders({2: CRANK}), damping=MODAL, **options
    )


@pytest.mark.slow
def test_stored_stick_slip_of_a_smooth_law():
    found = moved(0.5, functions=16, harmonics=16)
    m, case = found.measures, CASE["tanh_0p05"]
    assert np.degrees(m.travels[0]) == pytest.approx(case["arm_pp_deg"], rel=1e-5)
    assert np.degrees(m.rotation_amplitudes[2]) == pytest.approx(case["accessory_deg"], rel=1e-5)
    assert m.friction_work[0] == pytest.approx(case["work"], rel=1e-5)
    least = CASE["derivatives"]["value"]["tension_min"]
    assert np.min(m.tension_min) == pytest.approx(least, rel=1e-6)
    # Set-valued friction, by shooting with events: "differ by 1-2 %".
    stuck = CASE["set_valued"]
    assert np.degrees(m.travels[0]) == pytest.approx(stuck["arm_peak_to_peak_deg"], rel=0.02)
    assert m.friction_work[0] == pytest.approx(stuck["friction_work_J_per_period"], rel=0.03)


@pytest.mark.slow
def test_work_of_the_crank_is_that_of_friction_and_dampers():
    from beltjax.analysis.damping import damping_matrix

    found = moved(0.5)
    lin, w = found.linearization, float(found.frequency)
    times = np.arange(2000) * float(found.period) / 2000
    rates = np.asarray(jax.jvp(found.at, (times,), (np.ones(2000),))[1]) * float(lin.scales.time)
    C = np.asarray(damping_matrix(lin, MODAL))
    power = float(lin.scales.energy / lin.scales.time)
    taken = np.mean(np.einsum("ta,ab,tb->t", rates, C, rates)) * power
    gained = (found.tensions(times) - lin.steady.running_tensions) / lin.scales.tension
    moment = np.asarray(gained * lin.model.lam) @ np.asarray(lin.driving) * float(lin.scales.energy)
    given = np.mean(moment * -w * np.deg2rad(0.1) * np.sin(w * times))
    friction = float(found.measures.friction_work[0] / found.period)
    assert friction > 0.2 * given
    # 96 samples project the law onto 12 harmonics; what they miss is the law's sharpness.
    assert taken + friction == pytest.approx(given, rel=2e-3)


def test_what_locks_the_arm():
    drive, _ = THREE
    point = bj.OperatingPoint(driver_speed=SPEED)
    lin = bj.linearize(bj.steady_state(drive, point), bj.Legendre(8))
    locking = bj.lock_torque(lin, 2 * SPEED, CRANK, damping=MODAL)
    assert locking.shape == (1, 1)
    assert locking[0, 0] == pytest.approx(0.7062, abs=5e-5)
    # Half the range of the reaction of the locked nonlinear drive.
    assert locking[0, 0] == pytest.approx(CASE["lock_torque"], rel=1e-3)
    below, above = moved(0.6 * float(locking[0, 0])), moved(1.3 * float(locking[0, 0]))
    # Below it slips; above it creeps with the law's slope alone, by tanh(q'/v) = R/T.
    assert below.measures.travels[0] > 10 * above.measures.travels[0]
    creep = 2 * 0.05 * np.arctanh(1 / 1.3) / float(above.frequency)
    assert above.measures.travels[0] < creep
    twice = bj.lock_torque(lin, [2 * SPEED], bj.Excitation(crank=2 * CRANK.crank), damping=MODAL)
    np.testing.assert_allclose(twice, 2 * locking, rtol=1e-12)


@pytest.mark.slow
def test_derivatives_by_friction():
    def answers(numbers):
        m = moved(*numbers, throw=False).measures
        return jnp.stack([m.travels[0], m.friction_work[0], jnp.min(m.tension_min)])

    at = jnp.array([0.5, 0.05])
    slopes = np.asarray(quickly_compiled(jax.jacrev(answers))(at))
    value = quickly_compiled(answers)
    for k in range(2):
        unit = jnp.zeros(2).at[k].set(1e-4 * at[k])
        near, far = value(at + unit) - value(at - unit), value(at + 2 * unit) - value(at - 2 * unit)
        difference = (8 * near - far) / (12e-4 * at[k])
        np.testing.assert_allclose(slopes[:, k], difference, rtol=1e-6)


@pytest.mark.slow
def test_stored_derivatives_by_friction():
    def answers(torque):
        m = moved(torque, functions=16, harmonics=16, throw=False).measures
        return jnp.stack([jnp.rad2deg(m.travels[0]), jnp.min(m.tension_min)])

    slopes = quickly_compiled(jax.jacrev(answers))(jnp.asarray(0.5))
    case = CASE["derivatives"]
    stored = [case["d_arm_pp_deg_d_Tf"], case["d_tension_min_d_Tf"]]
    np.testing.assert_allclose(slopes, stored, rtol=4e-4)


def test_friction_in_a_file(tmp_path):
    text = (EXAMPLES / "three_pulley.toml").read_text()
    lines = 'inertia = 0.001165\nfriction_torque = 0.5\nfriction_speed = "1 deg/s"\n'
    path = tmp_path / "dry.toml"
    path.write_text(text.replace("inertia = 0.001165", lines, 1))
    drive, point = bj.load_drive(path)
    assert float(drive.tensioner.friction_torque) == 0.5
    assert float(drive.tensioner.friction_speed) == pytest.approx(np.pi / 180)
    bj.save_drive(tmp_path / "again.toml", drive, point)
    again, _ = bj.load_drive(tmp_path / "again.toml")
    assert float(again.tensioner.friction_torque) == 0.5
    assert "[tensioner]" in (tmp_path / "again.toml").read_text()
    path.write_text(text.replace("inertia = 0.001165", "friction_speed = -1\n", 1))
    with pytest.raises(bj.FileError, match=r"tensioner\.friction_speed: found -1; must not be"):
        bj.load_drive(path)
