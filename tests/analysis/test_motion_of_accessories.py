"""Accessories whose torque follows their speed, and a driver that turns by its torque."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
from drives import example

import beltjax as bj
from beltjax.analysis.damping import damping_matrix

pytestmark = pytest.mark.timeout(240)
RPM = np.pi / 30
R, J, ARM = np.array([0.08, 0.03]), 0.004, 0.3
BELT = bj.Damping(belt=1e-4)  # [s]


def two_pulleys(inertia=0.07):
    return bj.Drive(
        belt=bj.Belt(120e3, 0.0, 0.1),
        pulleys=(
            bj.Pulley("crank", (0.0, 0.0), R[0], inertia=inertia, driver=1.0),
            bj.Pulley("fan", (ARM, 0.0), R[1], inertia=J),
        ),
        installation=bj.TensionGiven(900.0),
    )


def fan(speed, share=6.0):
    """A load that grows as the square of speed, 6 N m at `speed` [rad/s] of its pulley."""
    speeds = speed * np.linspace(0.2, 1.8, 33)
    return bj.Load(speed=speeds, torque=share * (speeds / speed) ** 2)


def belt_stiffness():
    """Stiffness of both spans together, by the travel of the rims [N/m]."""
    return 2 * 120e3 / np.sqrt(ARM**2 - (R[0] - R[1]) ** 2)


@pytest.mark.slow
def test_a_fan_is_moved_as_by_hand():
    # One degree of freedom: the fan's pulley between the belt and its torque, in plain SciPy.
    speed = 700 * RPM
    turning = speed * R[0] / R[1]
    load = fan(turning)
    point = bj.OperatingPoint(driver_speed=speed, load={"fan": load})
    crank = 0.02
    orders = bj.Orders({2: bj.Excitation(crank=crank)})
    found = bj.periodic_response(
        two_pulleys(), point, orders, damping=BELT, functions=0, harmonics=10
    )
    k, w = belt_stiffness(), 2 * speed
    speeds = np.linspace(0.2, 1.8, 20001) * turning
    torques = np.asarray(jax.vmap(load.at)(jnp.asarray(speeds)).torque)

    def slope(t, x):
        gain = R[0] * crank * np.cos(w * t) - R[1] * x[0]
        rate = -R[0] * crank * w * np.sin(w * t) - R[1] * x[1]
        torque = np.interp(turning + x[1], speeds, torques) - 6.0
        return [x[1], (R[1] * k * (gain + 1e-4 * rate) - torque) / J]

    period = 2 * np.pi / w
    settled = scipy.integrate.solve_ivp(
        slope, (0, 300 * period), [0, 0], method="DOP853", rtol=1e-10, atol=1e-12
    )
    times = np.linspace(0, period, 33)
    last = scipy.integrate.solve_ivp(
        slope, (0, period), settled.y[:, -1], method="DOP853", rtol=1e-11, atol=1e-13, t_eval=times
    )
    mine = np.asarray(found.rotations(times))[:, 1]
    size = np.max(np.abs(mine))
    assert size > 0.05  # the torque swings by tens of per cent
    np.testing.assert_allclose(mine, last.y[0], atol=1e-7 * size)


def test_a_load_damps_by_its_slope_in_the_linear_drive():
    # By hand again: (K - w^2 J + i w (c + belt)) theta = (K + i w belt) r1/r2 crank.
    speed = 700 * RPM
    turning = speed * R[0] / R[1]
    drag = bj.Load(speed=turning * np.array([0.5, 1.5]), torque=[3.0, 9.0])
    point = bj.OperatingPoint(driver_speed=speed, load={"fan": drag})
    found = bj.speed_response(
        two_pulleys(), point, np.array([speed]), bj.Excitation(crank=1.0), damping=BELT
    )
    w, k = 2 * speed, R[1] ** 2 * belt_stiffness()
    belt, c = 1j * w * 1e-4 * k, 6.0 / turning
    expected = (k + belt) * R[0] / R[1] / (k - w**2 * J + 1j * w * c + belt)
    assert found.rotations[0, 1] == pytest.approx(expected, rel=1e-9)


def test_a_constant_power_excites():
    load = bj.Load(power=1000.0)
    assert load.slope(jnp.asarray(500.0)) == pytest.approx(-1000 / 500**2, rel=1e-12)
    speed = 700 * RPM
    point = bj.OperatingPoint(driver_speed=speed, load={"fan": load})
    orders = bj.Orders({2: bj.Excitation(crank=1e-3)})
    found = bj.periodic_response(
        two_pulleys(), point, orders, functions=0, harmonics=10, throw=False
    )
    assert not found.stable  # nothing else damps


@pytest.mark.slow
def test_a_free_driver_is_the_linear_one_where_torques_are_small():
    drive, point = example("three_pulley")
    point = bj.OperatingPoint(driver_speed=2000 * RPM, torque=point.torque)
    drive = eqx.tree_at(
        lambda d: d.pulleys[0].inertia, drive, jnp.asarray(0.05), is_leaf=lambda x: x is None
    )
    damping = bj.Damping(modal=0.02)
    torque = bj.Excitation(torques={"crankshaft": 1e-5, "accessory": 5e-6j})
    orders = bj.Orders({2: torque}, driver="free")
    found = bj.periodic_response(
        drive, point, orders, damping=damping, basis=bj.Legendre(6), harmonics=2
    )
    steady = bj.steady_state(drive, point)
    lin = bj.linearize(steady, bj.Legendre(6), free=True)
    linear = bj.frequency_response(
        lin, 2 * point.driver_speed, torque, drive.pulley_names, damping=damping
    )
    times = np.linspace(0, float(found.period), 9)
    swing = np.exp(1j * 2 * float(point.driver_speed) * times)[:, None] * np.asarray(
        linear.rotations
    )
    size = np.max(np.abs(swing.real))
    np.testing.assert_allclose(found.rotations(times), swing.real, atol=1e-6 * size)

    # All multipliers are exponentials of the eigenvalues, but those of the rigid rotation.
    M, C, K = lin.mass, lin.gyroscopic + damping_matrix(lin, damping), lin.stiffness
    n = len(M)
    first = np.block(
        [[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]]
    )
    period = float(found.period / lin.scales.time)
    values = scipy.linalg.eigvals(first)
    rigid = np.argsort(np.abs(values))[:2]
    assert np.all(np.abs(values[rigid]) < 1e-5)
    expected = np.exp(np.delete(values, rigid) * period)
    expected = expected[np.argsort(-np.abs(expected))]
    np.testing.assert_allclose(np.abs(found.multipliers[:6]), np.abs(expected[:6]), rtol=1e-5)
    assert found.stable
    assert np.all(np.abs(found.multipliers[-2:]) < 1e-6)


@pytest.mark.slow
def test_mean_torque_of_a_free_driver_is_what_fluctuation_adds_to_its_loads():
    # The mean of the fan's torque grows with the square of the swing: times the ratio of speeds.
    speed = 700 * RPM
    turning = speed * R[0] / R[1]
    load = fan(turning)
    point = bj.OperatingPoint(driver_speed=speed, load={"fan": load})
    orders = bj.Orders({2: bj.Excitation(torques={"crank": 60.0})}, driver="free")
    found = bj.periodic_response(
        two_pulleys(), point, orders, damping=BELT, functions=0, harmonics=10
    )
    count = 64
    times = np.arange(count) * float(found.period) / count
    crank, swing = np.asarray(found.rotations(times)).T
    waves = np.fft.rfftfreq(count, float(found.period) / count) * 2j * np.pi
    rate = np.fft.irfft(waves * np.fft.rfft(swing), count)
    added = float(jnp.mean(jax.vmap(load.at)(jnp.asarray(turning + rate)).torque)) - 6.0
    assert added > 0.01
    assert found.mean_driver_torque == pytest.approx(added * R[0] / R[1], rel=1e-6)
    # What the mean torque twists beside, the drive has not turned on the mean.
    assert abs(np.mean(crank + R[0] / R[1] * swing)) < 1e-9


def test_what_a_free_driver_may_not_have():
    with pytest.raises(ValueError, match=r"crank motion of order 2, and the driver is free"):
        bj.Orders({2: bj.Excitation(crank=0.1)}, driver="free")
    with pytest.raises(ValueError, match=r"driver: found 'loose'; give 'prescribed' or 'free'"):
        bj.Orders({2: bj.Excitation(torques={"fan": 1.0})}, driver="loose")
