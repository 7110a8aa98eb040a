"""Decouplers, rigid and spring clutches by shooting, against stored motions and their limits."""

import json
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from clutched import HUB, RPM, clutched, moved, shot
from drives import example

import beltjax as bj
from beltjax.analysis.periodic import Resolution, _shot, asked_of, prepared
from beltjax.analysis.shooting import shot_system
from beltjax.compiling.quick import quickly_compiled
from beltjax.drive.canonical import canonical
from beltjax.numerics.shooting import shot_orbit

CASES = json.loads((Path(__file__).parents[1] / "data" / "periodic.json").read_text())
STEPS = 160
pytestmark = pytest.mark.slow  # they compile for half a minute


def forcing(degrees):
    return bj.Orders({2: bj.Excitation(crank=np.deg2rad(degrees))}).forcing(("crank", "a"), 2)


def found_of(drive, rpm=900.0, degrees=1.0, steps=STEPS):
    return quickly_compiled(shot)(drive, jnp.asarray(rpm * RPM), forcing(degrees), steps)


def test_a_decoupler_overruns_in_each_period():
    orbit, found, floquet, _ = found_of(clutched("decoupler"))
    case = CASES["two_pulley_decoupler"]
    assert orbit.converged
    assert found.overrun_per_period[0] == pytest.approx(case["overrun_per_period"], abs=5e-5)
    assert found.overrun_speeds[0] == pytest.approx(case["overspeed"], abs=5e-3)
    assert found.rotation_amplitudes[1] == pytest.approx(case["pulley_amplitude"], abs=5e-5)
    steps = orbit.trajectory.steps
    events = np.asarray(steps.end)[np.asarray(steps.events) >= 0]
    assert found.open_fractions[0] == pytest.approx(events[1] - events[0], abs=1e-12)
    assert abs(floquet[0]) < 1


def test_work_that_crosses_a_decoupler_is_what_the_hub_takes():
    orbit, found, _, (excited, lin) = found_of(clutched("decoupler"))
    path = orbit.trajectory
    states, weights = path.stages
    n, joints = path.positions, excited.model.joints
    rates, wound = states[:, n : 2 * n], states[:, 2 * n]
    # The hub's mean speed is higher by the overrun, and it takes its torque and its drag there.
    torque = joints.stiffness * wound
    across = weights @ (torque * rates[:, 0])
    load = joints.steady * joints.stiffness
    drag = HUB / (lin.scales.energy * lin.scales.time)
    taken = weights @ (load * rates[:, 0] + drag * rates[:, 0] ** 2)
    assert across == pytest.approx(float(taken), rel=1e-8)
    mean = weights @ rates[:, 0] / lin.scales.time
    assert mean == pytest.approx(float(found.overrun_speeds[0]), rel=1e-8)


@pytest.mark.parametrize("rpm", [900, 1500])
def test_a_spring_clutch_is_that_of_harmonic_balance(rpm):
    # "Shooting / HBM: 2e-5."
    case = CASES["spring_clutch"]["cases"][str(rpm)]
    orbit, found, floquet, _ = found_of(clutched(), rpm)
    assert orbit.converged
    for value, key in (
        (found.rotation_amplitudes[1], "pulley_amplitude_rad"),
        (found.hub_rotation_amplitudes[1], "hub_amplitude_rad"),
    ):
        assert value == pytest.approx(case[key], rel=2e-5 + case["relative_change"])
    assert abs(floquet[0]) == pytest.approx(case["floquet_largest"], rel=1e-3)
    assert found.overrun_per_period[0] == 0


def test_a_rigid_clutch_is_the_limit_of_stiff_decouplers():
    _, rigid, _, _ = found_of(clutched("rigid-clutch"))
    amplitude, overrun = rigid.hub_rotation_amplitudes[1], rigid.overrun_per_period[0]
    off = []
    for stiffness in (1e4, 4e4, 1e5):
        orbit, found, _, _ = found_of(clutched("decoupler", stiffness))
        assert orbit.converged
        off.append(float(found.hub_rotation_amplitudes[1] - amplitude))
    # In proportion to the compliance.
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.02)
    assert off[1] / off[2] == pytest.approx(2.5, rel=0.01)
    assert found.overrun_per_period[0] == pytest.approx(float(overrun), rel=0.01)


def test_what_is_not_found_is_zero():
    # Its spring swings more than once in a step.
    orbit, found, _, _ = found_of(clutched("decoupler", 4e5))
    assert not orbit.converged
    assert not np.any(orbit.trajectory.steps.states)
    assert not np.any(found.overrun_per_period)


def test_small_motion_is_that_of_the_spring():
    found = [found_of(clutched(law), degrees=0.05)[1] for law in ("spring", "decoupler")]
    spring, decoupler = (m.hub_rotation_amplitudes[1] for m in found)
    assert decoupler == pytest.approx(float(spring), rel=1e-10)
    assert found[1].open_fractions[0] == 0
    assert found[1].overrun_per_period[0] == pytest.approx(0.0, abs=1e-12)


def test_overrun_grows_with_the_excitation():
    gains = [
        float(found_of(clutched("decoupler"), degrees=size)[1].overrun_per_period[0])
        for size in (0.4, 0.7, 1.0, 1.5)
    ]
    assert gains == sorted(gains)
    assert gains[0] < 0.5 * gains[-1]


def test_stops_by_two_methods():
    stops = {"stops": (-1.0, 0.08), "stop_stiffness": 300.0}
    drive, speed = clutched("spring", **stops), jnp.asarray(900 * RPM)
    _, found, floquet, _ = quickly_compiled(shot)(drive, speed, forcing(0.25), 640)
    many = bj.Orders({2: bj.Excitation(crank=np.deg2rad(0.25))}).forcing(("crank", "a"), 24)
    orbit, other, balanced = quickly_compiled(moved)(drive, speed, many, 768)
    assert orbit.converged
    ours, theirs = (m.hub_rotation_amplitudes[1] for m in (found, other))
    assert ours == pytest.approx(float(theirs), rel=1e-5)
    assert abs(floquet[0]) == pytest.approx(abs(balanced[0]), rel=1e-4)
    _, free, _, _ = quickly_compiled(shot)(clutched("spring"), speed, forcing(0.25), 640)
    assert free.hub_rotation_amplitudes[1] != pytest.approx(float(ours), rel=0.01)


def test_stops_of_a_decoupler_limit_its_wind_up():
    # Stops of k beside a spring of k are a spring of 2 k beyond them.
    far, near = (
        clutched("decoupler", stops=(-1.0, greatest), stop_stiffness=1e4)
        for greatest in (10.0, 0.06)
    )
    winds = []
    for drive in (clutched("decoupler"), far, near):
        orbit, _, _, (excited, _) = found_of(drive)
        assert orbit.converged
        states, _ = orbit.trajectory.stages
        winds.append(float(jnp.max(states[:, 2 * len(excited.model.mass)])))
    assert winds[1] == pytest.approx(winds[0], rel=1e-12)
    assert 0.06 < winds[2] < 0.07 < winds[0]


def test_derivatives_of_the_overrun():
    drive = clutched("decoupler")

    def overrun(numbers):
        joint = drive.isolators[0]
        changed = eqx.tree_at(lambda j: (j.stiffness, j.rim_inertia), joint, tuple(numbers))
        moved = eqx.tree_at(lambda d: d.isolators, drive, (changed,))
        return shot(moved, jnp.asarray(900 * RPM), forcing(1.0), STEPS)[1].overrun_per_period[0]

    at = jnp.array([100.0, 0.00025])
    forward = quickly_compiled(jax.jacfwd(overrun))(at)
    np.testing.assert_allclose(quickly_compiled(jax.jacrev(overrun))(at), forward, rtol=1e-9)
    value = quickly_compiled(overrun)
    for k in range(2):
        unit = jnp.zeros(2).at[k].set(1e-4 * at[k])
        near, far = value(at + unit) - value(at - unit), value(at + 2 * unit) - value(at - 2 * unit)
        assert forward[k] == pytest.approx((8 * near - far) / (12e-4 * at[k]), rel=1e-6)


def seven(torque):
    """The seven-pulley drive with a decoupler in its alternator, whose torque rises with speed."""
    drive, point = example("seven_pulley")
    turning = 900 * RPM * 0.075 / 0.027
    slope = np.array([-1.0, 3.0]) * HUB_SLOPE * turning
    load = bj.Load(speed=[0.0, 4 * turning], torque=torque + slope)
    pulleys = tuple(
        eqx.tree_at(lambda p: p.inertia, p, jnp.asarray(0.0032)) if p.name == "alternator" else p
        for p in drive.pulleys
    )
    on = [float(name == "alternator") for name in drive.pulley_names]
    joint = bj.Isolator(on, 25.0, rim_inertia=0.0003, law="decoupler")
    drive = eqx.tree_at(lambda d: (d.pulleys, d.isolators), drive, (pulleys, (joint,)))
    others = {name: value for name, value in point.torque.items() if name != "alternator"}
    at = bj.OperatingPoint(driver_speed=900 * RPM, torque=others, load={"alternator": load})
    return drive, at


HUB_SLOPE = 0.02  # [N m s/rad]


def undamped_joint(drive, point, asked, steps):
    """The motion with stiffness damping of all but the joint, as the stored case has it."""
    made = prepared(drive, point, asked)

    def without(model):
        joints = model.joints
        taken = joints.rows.T @ (joints.damping[:, None] * joints.rows)
        return eqx.tree_at(
            lambda m: (m.damping, m.joints.damping), model,
            (model.damping - taken, jnp.zeros_like(joints.damping)),
        )  # fmt: skip

    excited = made.excited._replace(model=without(made.excited.model))
    made = made._replace(model=without(made.model), excited=excited)
    return _shot(made, shot_orbit(shot_system, excited, steps), 12)


@pytest.mark.parametrize(
    ("torque", "group", "degrees"),
    [(1.0, "light", "1.0"), (1.0, "light", "1.5"), (7.0, "heavy", "0.5"), (7.0, "heavy", "1.5")],
)
def test_stored_motions_of_seven_pulleys(torque, group, degrees):
    drive, point = seven(torque)
    case, orders = (
        CASES["decoupler"][group][degrees],
        {2: bj.Excitation(np.deg2rad(float(degrees)))},
    )
    asked = asked_of(
        drive, point, bj.Orders(orders), Resolution(12, None, 2, None),
        bj.Damping(stiffness=2e-4), bj.Shooting(80),
    )  # fmt: skip
    found = quickly_compiled(undamped_joint)(*canonical(drive, point), asked, 80)
    assert found.result == bj.RESULTS.successful
    m, k = found.measures, drive.pulley("alternator")
    overrun = np.rad2deg(m.overrun_per_period[0])
    assert overrun == pytest.approx(case["overrun_deg_per_period"], rel=1e-6, abs=1e-5)
    assert m.overrun_speeds[0] == pytest.approx(case["hub_overspeed_rad_s"], rel=1e-6, abs=1e-5)
    # Stored extremes are those of 80 points of the period.
    for value, key in (
        (m.rotation_amplitudes[k], "pulley_amplitude_deg"),
        (m.hub_rotation_amplitudes[k], "hub_amplitude_deg"),
        (m.travels[0], "arm_pp_deg"),
    ):
        assert np.rad2deg(value) == pytest.approx(case[key], rel=2e-3)
    assert np.min(m.tension_min) == pytest.approx(case["tension_min"], rel=1e-3)
    assert np.max(m.tension_max) == pytest.approx(case["tension_max"], rel=1e-3)
    steps = found.signals.motion.trajectory.steps
    events = np.asarray(steps.end)[np.asarray(steps.events) >= 0]
    np.testing.assert_allclose(events, [at for at, _ in case["events"]], atol=1e-6)
