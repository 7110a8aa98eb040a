"""Trends that others published of dry friction and one-way clutches in belt drives."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from clutched import RPM, clutched, moved
from drives import example

import beltjax as bj
from beltjax.compiling.quick import quickly_compiled

pytestmark = pytest.mark.timeout(240)
MODAL = bj.Damping(modal=0.02)
DRIVE, _ = example("three_pulley")
CRANK = np.deg2rad(0.05)
ORDERS = bj.Orders({2: bj.Excitation(crank=CRANK)})


def linear(rpm, locked):
    drive = eqx.tree_at(lambda d: d.tensioner.locked, DRIVE, jnp.asarray(float(locked)))
    point, one = bj.OperatingPoint(driver_speed=1.0), bj.Excitation(crank=CRANK)
    found = bj.speed_response(
        drive, point, np.array([rpm * RPM]), one, damping=MODAL, basis=bj.Legendre(6)
    )
    return abs(found.rotations[0, 2]), abs(found.tensioner_motions[0, 0])


def with_friction(rpm, torque):
    places = lambda d: (d.tensioner.friction_torque, d.tensioner.friction_speed)  # noqa: E731
    drive = eqx.tree_at(places, DRIVE, (jnp.asarray(torque), jnp.asarray(0.02)))
    point = bj.OperatingPoint(driver_speed=rpm * RPM)
    found = bj.periodic_response(
        drive, point, ORDERS, damping=MODAL, basis=bj.Legendre(6), harmonics=12, stability=False
    )
    return float(found.measures.rotation_amplitudes[2]), float(found.measures.travels[0]) / 2


@pytest.mark.slow
@pytest.mark.parametrize(("rpm", "calms"), [(2000, True), (3000, False)])
def test_friction_calms_the_arm_and_not_always_the_rest(rpm, calms):
    # Leamy and Perkins (1998), Zhu and Parker (2008): with more friction the arm moves less, until
    # it is locked; the accessory's rotation may grow, since the arm no longer damps it.
    amplitudes = [with_friction(rpm, torque) for torque in (0.0, 0.1, 0.25, 3.0)]
    accessory, arm = (np.array(part) for part in zip(*amplitudes, strict=True))
    assert np.all(np.diff(arm) < 0)
    assert arm[-1] < 0.03 * arm[0]
    assert np.all(np.diff(accessory) < 0) if calms else accessory[-1] > 8 * accessory[0]
    # Both ends are linear drives: with the arm free, and bolted.
    assert accessory[0] == pytest.approx(linear(rpm, False)[0], rel=0.05)
    assert accessory[-1] == pytest.approx(linear(rpm, True)[0], rel=0.05)


@pytest.mark.slow
def test_a_one_way_clutch_softens_and_calms_the_accessory():
    # Zhu and Parker (2005): disengaging bends the resonance to lower speeds, and below what a
    # spring that never opens would do.
    run = quickly_compiled(moved)

    def at(rpm, law, degrees):
        shaken = bj.Orders({2: bj.Excitation(crank=np.deg2rad(degrees))})
        forcing = shaken.forcing(("crank", "a"), 12)
        orbit, found, _ = run(clutched(law), jnp.asarray(rpm * RPM), forcing, 384)
        assert orbit.converged
        return float(found.hub_rotation_amplitudes[1]) / np.deg2rad(degrees)

    resonance = 817.0  # of the linear drive
    assert at(resonance, "spring-clutch", 1.0) < 0.6 * at(resonance, "spring", 1.0)
    # The speed of the largest amplitude falls as the excitation grows.
    speeds = np.arange(650.0, 900.0, 50.0)
    peaks = [
        speeds[np.argmax([at(rpm, "spring-clutch", degrees) for rpm in speeds])]
        for degrees in (0.02, 0.3)
    ]
    assert peaks[1] < peaks[0]
