"""Transients against balances, other speeds' steady states, the linear response and derivatives."""

import importlib.util

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies_cases import ISOLATORS, load
from clutched import BELT, clutched
from drives import example

import beltjax as bj
from beltjax.analysis.motion import load_series
from beltjax.analysis.orders import Forcing
from beltjax.analysis.response import equations_at
from beltjax.compiling.quick import quickly_compiled
from beltjax.physics import motion

RPM = 2 * np.pi / 60
MODAL = bj.Damping(modal=0.02)
NONE = bj.Damping(arm=False)
THREE = example("three_pulley")  # read outside of what JAX traces
TIMES = 1024


def crank(degrees, order=2):
    return bj.Orders({order: bj.Excitation(crank=np.deg2rad(degrees))})


def moved(profile, *, drive=None, times=TIMES, **options):
    """The three-pulley drive under a profile in rpm; three knots share one program."""
    knots = np.array(profile, float) * [1, RPM]
    options = {"damping": MODAL, "functions": 8} | options
    saves = np.linspace(knots[0, 0], knots[-1, 0], times + 1)
    given, point = THREE
    return bj.transient(
        given if drive is None else drive, point, profile=knots, saves=saves, **options
    )


@pytest.mark.slow
def test_energy_of_an_undamped_drive_is_kept():
    rest = moved([(0, 2000), (0.1, 2000), (0.2, 2000)], damping=NONE)
    lin = rest.linearization
    size = len(lin.mass)
    z = jnp.zeros(size).at[jnp.array([0, 32, size - 1])].set(jnp.array([0.1, 0.15, 0.06]))
    options = {"initial": (z, 0 * z), "rtol": 1e-10, "atol": 1e-12}
    found = moved([(0, 2000), (0.1, 2000), (0.2, 2000)], damping=NONE, **options)
    whole, signals = found.signals.model, found.signals

    def energy(at):
        return motion.energy(whole, signals.state(at)[0], signals.motion.rate(at))

    energies = jax.vmap(energy)(signals.motion.times)
    np.testing.assert_allclose(energies, energies[0], rtol=1e-8)
    # Far from linear, and in motion.
    assert abs(float(z @ lin.stiffness @ z) / 2 / float(energies[0]) - 1) > 0.03
    assert np.ptp(found.tensions(found.times)[:, 0]) > 200


@pytest.mark.slow
def test_a_periodic_motion_goes_on():
    # Harmonic balance and steps in time, both with belts that follow the crank.
    drive, point = THREE
    at = bj.OperatingPoint(driver_speed=2000 * RPM, torque=point.torque)
    orbit = bj.periodic_response(
        drive, at, crank(0.1), harmonics=12, functions=8, damping=MODAL, belt_speed="varying"
    )
    end = 10 * float(orbit.period)
    found = moved(
        [(0, 2000), (end / 2, 2000), (end, 2000)], orders=crank(0.1), initial=orbit, rtol=1e-9,
        atol=1e-11,
    )  # fmt: skip
    expected = np.asarray(orbit.at(found.times))
    np.testing.assert_allclose(found.at(found.times), expected, atol=2e-6 * np.abs(expected).max())
    for name in ("tension_min", "tension_max", "travels", "span_peaks", "hub_load_max"):
        ours, theirs = (np.asarray(getattr(one.measures, name)) for one in (found, orbit))
        # Peaks of a deflection are looked for from a grid in space, too.
        near = 1e-4 if name == "span_peaks" else 1e-6
        np.testing.assert_allclose(ours, theirs, rtol=near)


@pytest.mark.slow
def test_a_signal_of_the_crank_is_the_same_as_its_order():
    by_order = moved([(0, 2000), (0.1, 2600)], orders=crank(0.1))
    times = np.linspace(0, 0.1, 600)
    psi = RPM * (2000 * times + 3000 * times**2)
    theta = np.deg2rad(0.1) * np.cos(2 * psi)
    options = {"rtol": 1e-7, "atol": 1e-9}
    expected = np.asarray(by_order.tensioner_motions(by_order.times))
    signals = (
        bj.CrankSignal(times, angles=theta),
        bj.CrankSignal(
            times, speeds=RPM * (2000 + 6000 * times) * (1 - np.deg2rad(0.2) * np.sin(2 * psi))
        ),
    )
    by_angle, by_speed = (
        moved([(0, 2000), (0.1, 2600)], crank=signal, **options) for signal in signals
    )
    reach = np.abs(expected).max()
    found = by_angle.tensioner_motions(by_angle.times)
    np.testing.assert_allclose(found, expected, atol=2e-5 * reach)
    # A speed leaves open where the rotation begins: the drive turns with it.
    found = by_speed.tensioner_motions(by_speed.times)
    np.testing.assert_allclose(found, expected, atol=2e-5 * reach)
    turned = np.asarray(by_order.rotations(by_order.times))
    ratios = float(THREE[0].pulleys[0].radius) / np.asarray(THREE[0].radii)
    found = by_speed.rotations(by_speed.times) + np.deg2rad(0.1) * ratios
    np.testing.assert_allclose(found, turned, atol=2e-5 * np.abs(turned).max())


@pytest.mark.slow
def test_run_up_loads_the_belt_by_inertia_and_ends_in_the_steady_state():
    drive, point = THREE
    found = moved([(0, 1000), (1.0, 3000), (1.5, 3000)], damping=bj.Damping(modal=0.3))
    reference, ramp = found.linearization.steady, slice(TIMES // 3, TIMES // 2)
    mean = np.asarray(found.tensions(found.times))[ramp].mean(axis=0)
    gained = (mean - reference.running_tensions) - np.roll(mean - reference.running_tensions, 1)
    # The belt turns every pulley faster by the difference of the tensions beside it.
    rise = 2000 * RPM * float(drive.pulleys[0].radius)
    for k in (1, 2):
        pulley = drive.pulleys[k]
        expected = float(pulley.inertia) * rise / float(pulley.radius) ** 2
        # Its slow drift against the driver is damped, too.
        assert gained[k] == pytest.approx(expected, rel=0.01)
    there = bj.steady_state(drive, bj.OperatingPoint(driver_speed=3000 * RPM, torque=point.torque))
    turned = reference.coordinate_change + found.tensioner_motions(1.5)
    assert turned[0] == pytest.approx(float(there.coordinate_change[0]), rel=1e-4)
    np.testing.assert_allclose(found.tensions(1.5), there.running_tensions, rtol=1e-6)


@pytest.mark.slow
def test_coast_down_ends_at_rest():
    drive, point = THREE
    found = moved([(0, 3000), (0.5, 0), (1.0, 0)], damping=bj.Damping(modal=0.3))
    rest = bj.steady_state(drive, bj.OperatingPoint(belt_speed=0.0, torque=point.torque))
    steady = found.linearization.steady
    turned = steady.coordinate_change + found.tensioner_motions(1.0)
    assert turned[0] == pytest.approx(float(rest.coordinate_change[0]), abs=1e-6)
    np.testing.assert_allclose(found.tensions(1.0), rest.running_tensions, rtol=1e-4)
    assert float(found.driver_speeds[-1]) == 0
    np.testing.assert_allclose(found.signals.motion.rate(found._variable(1.0)), 0, atol=1e-4)


def test_a_slow_run_up_meets_the_resonance_of_the_linear_drive():
    # A crank so small that the drive is linear: its part is the difference of two motions.
    drive, point = THREE
    speeds = np.linspace(2300, 2450, 61) * RPM
    small = crank(1e-3)
    linear = bj.speed_response(drive, point, speeds, small.excitations[2.0], damping=MODAL)
    amplitude = np.abs(np.asarray(linear.tensioner_motions[:, 0]))
    profile = [(0, 2300), (0.5, 2375), (1.0, 2450)]
    shaken, still = moved(profile, orders=small), moved(profile)
    part = np.asarray(shaken.tensioner_motions(shaken.times) - still.tensioner_motions(still.times))
    half = TIMES // 2  # after what began with the crank
    peak = half + np.argmax(np.abs(part[half:, 0]))
    assert np.abs(part[peak, 0]) == pytest.approx(amplitude.max(), rel=0.05)
    # A drive that passes a resonance answers with a delay of 1/(damping ratio * frequency).
    late = float(shaken.driver_speeds[peak]) / RPM - speeds[np.argmax(amplitude)] / RPM
    assert 0 < late < 40


def numbers_of(drive):
    return [drive.tensioner.stiffness, drive.pulleys[2].inertia, drive.belt.axial_stiffness]


def answers(values, derivatives="reverse"):
    """Least tension, and the arm at the end of a short run-up with a crank."""
    drive = eqx.tree_at(numbers_of, THREE[0], list(values))
    found = moved(
        [(0, 2000), (0.02, 2300)], drive=drive, orders=crank(0.3), functions=2, times=64,
        derivatives=derivatives, max_steps=2000, throw=False, rtol=1e-9, atol=1e-11,
    )  # fmt: skip
    return jnp.stack([jnp.min(found.measures.tension_min), found.tensioner_motions(0.02)[0]])


@pytest.mark.slow
def test_derivatives_three_ways():
    values = jnp.stack(numbers_of(THREE[0]))
    reverse = np.asarray(quickly_compiled(jax.jacrev(answers))(values))
    forward = quickly_compiled(jax.jacfwd(lambda v: answers(v, "forward")))(values)
    np.testing.assert_allclose(reverse, forward, rtol=1e-7)
    by = eqx.filter_jit(answers)
    for k, value in enumerate(values):
        unit = jnp.zeros(len(values)).at[k].set(1e-4 * value)
        near, far = (by(values + m * unit) - by(values - m * unit) for m in (1, 2))
        np.testing.assert_allclose(reverse[:, k], (8 * near - far) / (12e-4 * value), rtol=1e-5)


@pytest.mark.slow
def test_what_the_driver_transmits_is_that_of_the_linear_response(tmp_path):
    # By angle, rate and acceleration, through isolators, damped belts and the belt's inertia.
    drive, point = load(tmp_path, ISOLATORS)
    drive = eqx.tree_at(lambda d: d.model.belt_inertia, drive, jnp.asarray(1.0))
    lin = bj.linearize(bj.steady_state(drive, point), bj.Legendre(2))
    damping = bj.Damping(stiffness=1e-4, belt=2e-4)
    omega, amplitude = jnp.asarray(1.7), jnp.asarray(0.3 - 0.2j)
    torques = jnp.arange(len(drive.pulleys)) * (1.0 + 0.5j)
    expected = equations_at(lin, omega, amplitude, torques / lin.scales.energy, damping)[1]
    forcing = Forcing(jnp.array([0.0, amplitude]), jnp.stack([0 * torques, torques]))
    _, found = load_series(lin, forcing, omega, damping)
    stretched = amplitude * (lin.elongations.T @ (lin.model.lam * lin.model.gam * lin.driving))
    np.testing.assert_allclose(
        found[1] - 1j * found[2] - stretched, expected, rtol=1e-10, atol=1e-12
    )


def test_questions_that_have_no_answer():
    drive, point = THREE
    start = [(0, 100), (1, 200)]
    for options, message in (
        ({}, "duration: found none, and no profile"),
        ({"profile": [(0, 100), (0, 200)]}, "times must be finite and increase"),
        ({"profile": [(0, 100), (1, -2)]}, "speeds must be finite and not negative"),
        ({"profile": [1.0, 2.0]}, r"profile: found shape \(2,\)"),
        ({"profile": start, "duration": 0.5}, "duration: is shorter than the profile"),
        ({"profile": start, "saves": [0.5, 1.0]}, "saves: begin at 0.5 s, and the motion at 0 s"),
        ({"profile": start, "method": "euler"}, "method: found 'euler'; give explicit or implicit"),
        ({"profile": start, "functions": 40}, "functions: found 40"),
        (
            {"profile": start, "crank": bj.CrankSignal([0, 0.1, 0.2, 0.3], angles=[0, 1, 0, 1])},
            "crank: lasts from 0 to 0.3 s, the motion from 0 to 1 s",
        ),
        ({"profile": start, "orders": bj.Orders({2: bj.Excitation()}, driver="free")}, "free"),
    ):
        with pytest.raises(ValueError, match=message):
            bj.transient(drive, point, **options)
    for arguments, message in (
        ({"times": [0, 1, 2], "angles": [0, 1, 2]}, "at least 4"),
        ({"times": [0, 1, 2, 3]}, "either angles or speeds"),
        ({"times": [0, 1, 1, 3], "angles": [0, 1, 2, 3]}, "must increase"),
        ({"times": [0, 1, 2, 3], "speeds": [0, 1, 2]}, "speeds: found shape"),
    ):
        with pytest.raises(ValueError, match=message):
            bj.CrankSignal(**arguments)


@pytest.mark.slow
def test_a_decoupler_comes_to_the_orbit_of_shooting():
    # The hub has a torque that grows with its speed; half of the periods it overruns.
    drive, speed = clutched("decoupler"), 900 * RPM
    mean = speed * 0.08 / 0.03
    fan = bj.Load(speed=[0.0, 2 * mean], torque=[5 - 0.03 * mean, 5 + 0.03 * mean])
    point = bj.OperatingPoint(driver_speed=speed, load={"alternator": fan})
    options = {"orders": crank(1.0), "functions": 0, "damping": BELT}
    orbit = bj.periodic_response(drive, point, belt_speed="varying", **options)
    period = float(orbit.period)
    saves = np.linspace(0, 80 * period, 80 * 64 + 1)
    found = bj.transient(drive, point, 80 * period, saves=saves, **options)
    times = np.linspace(79 * period, 80 * period, 60)
    expected = np.asarray(orbit.tensions(times))
    np.testing.assert_allclose(
        found.tensions(times), expected, atol=2e-5 * np.ptp(expected, axis=0).max()
    )
    late = found.rotations(times[[0, -1]])[:, 1]
    assert float(late[1] - late[0]) == pytest.approx(
        float(orbit.measures.overrun_per_period[0]), rel=1e-4
    )


@pytest.mark.slow
def test_a_motion_goes_on_at_its_own_speed():
    drive, point = THREE
    at = bj.OperatingPoint(driver_speed=2000 * RPM, torque=point.torque)
    orbit = bj.periodic_response(drive, at, crank(0.1), harmonics=2, functions=2, damping=MODAL)
    with pytest.raises(ValueError, match=r"initial: is a motion at 209\.44 rad/s of the driver"):
        moved([(0, 2100), (1, 2200)], initial=orbit)


def test_diffrax_is_asked_for_in_one_line(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        ValueError, match=r"diffrax is not installed: pip install 'beltjax\[time\]'"
    ):
        moved([(0, 1000), (1, 2000)])


@pytest.mark.slow
def test_too_many_steps_are_a_result():
    options = {"max_steps": 300, "throw": False}
    found = moved([(0, 2000), (0.1, 2100), (0.2, 2000)], **options)
    assert found.result == bj.RESULTS.too_many_steps
    assert not np.any(found.at(0.1))
    with pytest.raises(bj.AnalysisError, match="raise max_steps"):
        moved([(0, 2000), (0.1, 2100), (0.2, 2000)], max_steps=300)


@pytest.mark.slow
def test_a_bad_lane_disturbs_none():
    def least(stiffness):
        drive = eqx.tree_at(lambda d: d.tensioner.stiffness, THREE[0], stiffness)
        found = moved(
            [(0, 2000), (0.02, 2300)], drive=drive, orders=crank(0.3), functions=2, times=64,
            max_steps=2000, throw=False,
        )  # fmt: skip
        return jnp.min(found.measures.tension_min), found.result

    good = float(THREE[0].tensioner.stiffness)
    lanes = jnp.array([good, jnp.nan, 1.1 * good])
    values, results = quickly_compiled(jax.vmap(least))(lanes)
    alone = quickly_compiled(least)
    assert bool((results == bj.RESULTS.successful)[0])
    assert not bool((results == bj.RESULTS.successful)[1])
    for k in (0, 2):
        assert values[k] == pytest.approx(float(alone(lanes[k])[0]), rel=1e-9)


@pytest.mark.slow
def test_implicit_steps_give_the_same_motion():
    profile, options = [(0, 2000), (0.02, 2300)], {"functions": 2, "times": 64}
    one, other = (
        moved(profile, orders=crank(0.3), method=method, rtol=1e-8, atol=1e-10, **options)
        for method in ("explicit", "implicit")
    )
    expected = np.asarray(one.tensions(one.times))
    np.testing.assert_allclose(other.tensions(other.times), expected, rtol=1e-6)


@pytest.mark.slow
def test_parts_with_progress_are_the_whole():
    calls = []
    profile = [(0, 2000), (0.1, 2100), (0.2, 2000)]
    found = moved(profile, orders=crank(0.1), advance=lambda *call: calls.append(call))
    whole = moved(profile, orders=crank(0.1))
    np.testing.assert_allclose(found.tensions(0.2), whole.tensions(0.2), rtol=1e-5)
    assert calls[0] == ("moving", 0, 16)
    assert calls[-1] == ("moving", 16, 16)


@pytest.mark.slow
def test_named_axes_and_times_above_a_limit():
    drive, _ = THREE
    found = moved([(0, 2000), (0.1, 2100), (0.2, 2000)], orders=crank(0.1))
    data = found.to_xarray(drive)
    assert data["tension"].dims == ("time", "span")
    assert data["tension"].units == "N"
    assert list(data["pulley"].values) == list(drive.pulley_names)
    np.testing.assert_allclose(data["tensioner_motion"], found.tensioner_motions(found.times))
    tensions = found.tensions(found.times)
    limit = float(np.median(tensions[:, 0]))
    assert found.time_above(tensions, limit)[0] == pytest.approx(0.1, rel=0.01)
    assert found.time_above(tensions[:, 0], 1e6) == 0


@pytest.fixture(scope="module")
def rubbed():
    """The drive whose tensioner sticks and slips, and its orbit by shooting."""
    drive, point = THREE
    friction = jnp.asarray(0.5), jnp.asarray(0.0)
    dry = eqx.tree_at(
        lambda d: (d.tensioner.friction_torque, d.tensioner.friction_speed), drive, friction
    )
    at = bj.OperatingPoint(driver_speed=2000 * RPM, torque=point.torque)
    orbit = bj.periodic_response(
        dry, at, crank(0.1), functions=4, damping=MODAL, belt_speed="varying"
    )
    return dry, orbit


@pytest.mark.slow
def test_a_tensioner_that_sticks_and_slips_stays_on_its_orbit(rubbed):
    dry, orbit = rubbed
    end = 4 * float(orbit.period)
    options = {"drive": dry, "orders": crank(0.1), "functions": 4, "max_events": 300}
    found = moved([(0, 2000), (end / 2, 2000), (end, 2000)], initial=orbit, **options)
    expected = np.asarray(orbit.at(found.times))
    np.testing.assert_allclose(found.at(found.times), expected, atol=1e-5 * np.abs(expected).max())
    assert int(found.stats["events"]) == 16
    part = orbit.measures.stuck_fractions[0]
    assert found.measures.stuck_fractions[0] == pytest.approx(float(part), abs=2e-3)
    work = 4 * orbit.measures.friction_work[0]
    assert found.measures.friction_work[0] == pytest.approx(float(work), rel=1e-4)


@pytest.mark.slow
def test_from_rest_a_tensioner_with_friction_comes_to_its_orbit(rubbed):
    dry, orbit = rubbed
    period = float(orbit.period)
    end = 60 * period
    options = {"drive": dry, "orders": crank(0.1), "functions": 4, "max_events": 300}
    found = moved([(0, 2000), (end / 2, 2000), (end, 2000)], **options)
    times = end - period + np.linspace(0, period, 50)
    expected = np.asarray(orbit.tensioner_motions(times))
    travel = np.ptp(expected)
    np.testing.assert_allclose(found.tensioner_motions(times), expected, atol=2e-3 * travel)


@pytest.mark.slow
def test_derivative_through_events(rubbed):
    dry, orbit = rubbed
    end = 2 * float(orbit.period)

    def at_end(friction):
        drive = eqx.tree_at(lambda d: d.tensioner.friction_torque, dry, friction)
        found = moved(
            [(0, 2000), (end / 2, 2000), (end, 2000)], drive=drive, orders=crank(0.1),
            functions=2, max_events=24, derivatives="forward", rtol=1e-9, atol=1e-11, times=64,
            max_steps=4000, throw=False,
        )  # fmt: skip
        return jnp.stack([found.tensioner_motions(end)[0], jnp.min(found.measures.tension_min)])

    one, step = jnp.ones(()), 1e-5
    friction = jnp.asarray(0.1)
    _, slopes = quickly_compiled(lambda T: jax.jvp(at_end, (T,), (one,)))(friction)
    by = quickly_compiled(at_end)
    difference = (by(friction + step) - by(friction - step)) / (2 * step)
    np.testing.assert_allclose(slopes, difference, rtol=1e-4)
    assert np.abs(slopes).min() > 1e-4
