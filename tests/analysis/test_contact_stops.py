"""A tensioner that the running belt in contact pushes against its stop."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from contact_drives import seven

import beltjax as bj

LIGHT = (0.0, 2.0, 0.0, 1.0, 0.1, 3.0)  # torques that hold with the arm at its stop


def with_stop(drive, greatest):
    stops = jnp.array([-1.0, float(greatest)])
    return eqx.tree_at(lambda d: d.tensioners[0].stops, drive, stops)


def test_an_arm_stands_at_its_stop_and_no_farther():
    drive, point = seven(torque=LIGHT)
    free = bj.contact_state(drive, point)
    turned = float(free.coordinates[0])
    held = bj.contact_state(with_stop(drive, 0.6 * turned), point)
    loose = bj.contact_state(with_stop(drive, 1.1 * turned), point)
    assert turned > 0.005
    assert float(held.coordinates[0]) == pytest.approx(0.6 * turned, abs=1e-12)
    assert held.at_stop.tolist() == [1.0]
    assert loose.at_stop.tolist() == free.at_stop.tolist() == [0.0]
    np.testing.assert_allclose(loose.tensions, free.tensions, rtol=1e-9)
    # A stop does nothing at rest without torques: the belt is the same. It keeps the arm from
    # taking up what the torques stretch, so that the belt is less tight.
    assert float(held.unstretched_length) == pytest.approx(float(free.unstretched_length), rel=1e-9)
    assert np.all(np.asarray(held.tensions) < np.asarray(free.tensions))


@pytest.mark.slow
def test_a_stop_holds_as_a_lock_does():
    """The same belt on the same pulleys, the arm drawn at the stop and locked there."""
    drive, point = seven(torque=LIGHT)
    angle = 0.6 * float(bj.contact_state(drive, point).coordinates[0])
    held = bj.contact_state(with_stop(drive, angle), point)
    arm = next(k for k, pulley in enumerate(drive.pulleys) if np.any(np.asarray(pulley.on)))
    pivot, center = (np.asarray(x) for x in (drive.tensioners[0].pivot, drive.pulleys[arm].center))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    locked = eqx.tree_at(
        lambda d: (d.pulleys[arm].center, d.tensioners[0].locked),
        drive,
        (jnp.asarray(pivot + turn @ (center - pivot)), jnp.ones(())),
    )
    belt = bj.BeltGiven(held.unstretched_length, free=jnp.zeros(1))
    locked = bj.contact_state(dataclasses.replace(locked, installation=belt), point)
    for key in ("tensions", "speeds", "wraps", "slips"):
        np.testing.assert_allclose(getattr(held, key), getattr(locked, key), rtol=1e-10)
