"""Branches of periodic motions against stored folds, and against single motions."""

import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from clutched import RPM, clutched, excited_at, moved
from drives import example

import beltjax as bj
from beltjax.analysis.motion import oscillator
from beltjax.compiling.quick import quickly_compiled
from beltjax.numerics.periodic_branch import Units, corrected, start_of, walked

FOLDS = json.loads((Path(__file__).parents[1] / "data" / "periodic.json").read_text())[
    "spring_clutch"
]["folds"]
MODAL = bj.Damping(modal=0.02)


@pytest.mark.slow
def test_folds_of_an_opening_clutch():
    samples, drive = 256, clutched()
    forcing = bj.Orders({2: bj.Excitation(crank=np.deg2rad(0.3))}).forcing(drive.pulley_names, 12)

    def system(_, speed):
        return oscillator(excited_at(drive, speed, forcing)[0], jnp.ones(()))

    top = jnp.asarray(900 * RPM)
    orbit, _, _ = quickly_compiled(moved)(drive, top, forcing, samples)
    units = Units(jnp.linalg.norm(orbit.coefficients), jnp.asarray(30 * RPM))
    shape = orbit.coefficients.shape
    correct = quickly_compiled(
        lambda guess, along: corrected(system, None, units, samples, shape, guess, along)
    )
    start = start_of(orbit.coefficients, top, units)
    down = jnp.zeros(len(start)).at[-1].set(-1.0)
    walk = walked(correct, correct(start, down).point, 0.1, (580 / 30, 30.0 + 1e-9), 100)
    assert walk.complete
    upper, lower = (30 * float(walk.points[k].place[-1]) for k in walk.folds)
    assert upper == pytest.approx(FOLDS["upper_fold_rpm"], abs=FOLDS["upper_accuracy_rpm"])
    assert lower == pytest.approx(FOLDS["lower_fold_rpm"], abs=FOLDS["lower_accuracy_rpm"])
    coefficients = walk.points[walk.folds[0]].place[:-1].reshape(shape) * units.coefficients
    phases = np.linspace(0, 2 * np.pi, 721)
    orders = np.arange(1, 13) * phases[:, None]
    hub = np.cos(orders) @ coefficients[1::2, 0] + np.sin(orders) @ coefficients[2::2, 0]
    assert np.ptp(hub) / 2 == pytest.approx(FOLDS["hub_amplitude_at_upper"], abs=5e-4)


@pytest.fixture(scope="module")
def branch():
    drive, point = example("three_pulley")
    orders = bj.Orders({2: bj.Excitation(crank=np.deg2rad(0.2))})
    options = {"damping": MODAL, "functions": 4, "harmonics": 5}
    speeds = 2550 * RPM, 2250 * RPM
    return bj.periodic_branch(drive, point, orders, *speeds, **options), orders, options


@pytest.mark.slow
def test_points_are_motions_of_their_own(branch):
    found, orders, options = branch
    assert found.complete
    assert found.values[0] == pytest.approx(2550 * RPM)
    assert found.values[-1] < 2250 * RPM
    assert np.all(np.diff(found.values) < 0)  # no fold
    assert len(found.folds) == 0
    drive, point = example("three_pulley")
    at = bj.OperatingPoint(driver_speed=found.values[-1], torque=point.torque)
    alone = bj.periodic_response(drive, at, orders, **options)
    last = found.responses[-1]
    size = np.abs(alone.coefficients).max()
    np.testing.assert_allclose(last.coefficients, alone.coefficients, atol=1e-9 * size)
    np.testing.assert_allclose(last.multipliers, alone.multipliers, atol=1e-7)
    assert all(float(one.stats["residual"]) < 1e-9 for one in found.responses)


@pytest.mark.slow
def test_period_doubles_where_a_multiplier_is_minus_one(branch):
    found, orders, options = branch
    (flip,) = found.flips
    drive, point = example("three_pulley")
    stable = found.stable
    assert list(stable) == sorted(stable)
    assert found.values[~stable][-1] > flip > found.values[stable][0]
    at = bj.OperatingPoint(driver_speed=flip, torque=point.torque)
    alone = bj.periodic_response(drive, at, orders, **options)
    # The place lies between two points, by a straight line.
    assert alone.multipliers[0] == pytest.approx(-1.0, abs=0.02)


def test_what_cannot_be_followed():
    drive, point = example("three_pulley")
    orders = bj.Orders({2: bj.Excitation(crank=0.001)})
    with pytest.raises(ValueError, match="give two different numbers"):
        bj.periodic_branch(drive, point, orders, 200.0, 200.0)
    with pytest.raises(ValueError, match="belt_sped"):
        bj.periodic_branch(drive, point, orders, 200.0, 210.0, over="operation.belt_sped")
