"""A spring-clutch against stored motions, its spring where it stays wound up, and its file."""

import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from bodies_cases import ISOLATORS, load, swap
from clutched import RPM, clutched, moved

import beltjax as bj
from beltjax.compiling.quick import quickly_compiled

CASE = json.loads((Path(__file__).parents[1] / "data" / "periodic.json").read_text())
CASES = CASE["spring_clutch"]["cases"]
H, S = 24, 768


def forcing(degrees):
    return bj.Orders({2: bj.Excitation(crank=np.deg2rad(degrees))}).forcing(("crank", "a"), H)


@pytest.mark.slow
@pytest.mark.parametrize("rpm", [700, 900, 1500])  # at 700 rpm the branch from rest folds twice
def test_stored_motions(rpm):
    case = CASES[str(rpm)]
    orbit, found, floquet = quickly_compiled(moved)(
        clutched(), jnp.asarray(rpm * RPM), forcing(1.0), S
    )
    assert orbit.converged
    near = case["relative_change"]
    for value, key in (
        (found.rotation_amplitudes[1], "pulley_amplitude_rad"),
        (found.hub_rotation_amplitudes[1], "hub_amplitude_rad"),
    ):
        assert value == pytest.approx(case[key], rel=near)
    assert found.open_fractions[0] == pytest.approx(case["fraction_open"], abs=2e-4)
    # The tangent jumps where the clutch opens; the integrator's steps do not end there.
    assert abs(floquet[0]) == pytest.approx(case["floquet_largest"], rel=1e-3)


def test_small_motion_is_that_of_the_spring():
    found = [
        quickly_compiled(moved)(clutched(law), jnp.asarray(900 * RPM), forcing(0.05), S)
        for law in ("spring", "spring-clutch")
    ]
    spring, clutch = (orbit.coefficients for orbit, _, _ in found)
    np.testing.assert_allclose(clutch, spring, rtol=1e-12, atol=1e-16)
    assert found[1][1].open_fractions[0] == 0


@pytest.mark.slow
def test_law_in_a_file(tmp_path):
    text = swap(ISOLATORS, "stiffness = 35.0", 'stiffness = 35.0\nlaw = "spring-clutch"')
    drive, point = load(tmp_path, text)
    assert [float(part.law) for part in drive.isolators].count(1.0) == 1
    bj.save_drive(tmp_path / "again.toml", drive, point)
    again, _ = bj.load_drive(tmp_path / "again.toml")
    assert [float(part.law) for part in again.isolators] == [
        float(part.law) for part in drive.isolators
    ]
    # Lightly loaded the clutch opens.
    light = bj.OperatingPoint(
        driver_speed=2500 * RPM, torque={**point.torque, "alternator": jnp.asarray(1.0)}
    )
    orders = bj.Orders({2: bj.Excitation(crank=np.deg2rad(2.0))})
    options = {"functions": 0, "harmonics": 8, "damping": bj.Damping(modal=0.05)}
    loose = bj.periodic_response(drive, light, orders, **options)
    held, _ = load(tmp_path, ISOLATORS)
    tight = bj.periodic_response(held, light, orders, **options)
    clutch = [float(part.law) for part in drive.isolators].index(1.0)
    assert 0.4 < loose.measures.open_fractions[clutch] < 0.6
    assert loose.measures.open_fractions[1 - clutch] == 0
    hub = drive.pulley("alternator")
    swung = [one.measures.hub_rotation_amplitudes[hub] for one in (loose, tight)]
    assert swung[0] < 0.9 * swung[1]


def test_a_clutch_on_the_driver_is_refused(tmp_path):
    text = swap(ISOLATORS, "stiffness = 400.0", 'stiffness = 400.0\nlaw = "spring-clutch"')
    with pytest.raises(bj.FileError, match=r"isolator\[0\]\.law: is on the driver's shaft"):
        load(tmp_path, text)
