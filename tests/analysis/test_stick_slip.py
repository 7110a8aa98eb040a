"""Dry friction that holds, by shooting: stored motions, power, locking, limits and derivatives."""

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

CASES = json.loads((Path(__file__).parents[1] / "data" / "periodic.json").read_text())
SPEED = 2000 * 2 * np.pi / 60
MODAL = bj.Damping(modal=0.02)
THREE = example("three_pulley")[0]
POINT = bj.OperatingPoint(driver_speed=SPEED)


def crank(degrees):
    return bj.Orders({2: bj.Excitation(crank=np.deg2rad(degrees))})


def held(torque, **parts):
    """The three-pulley drive with friction of its arm that holds."""
    parts = {"friction_torque": torque, "friction_speed": 0.0} | parts
    return eqx.tree_at(
        lambda d: tuple(getattr(d.tensioner, name) for name in parts), THREE,
        tuple(map(jnp.asarray, parts.values())),
    )  # fmt: skip


def moved(torque, degrees=0.1, **options):
    options = {"functions": 4, "damping": MODAL} | options
    return bj.periodic_response(held(torque), POINT, crank(degrees), **options)


def events_of(found):
    steps = found.signals.motion.trajectory.steps
    return np.asarray(steps.end)[np.asarray(steps.events) >= 0]


@pytest.mark.slow
def test_power_of_the_crank_is_that_of_friction_and_dampers():
    found = moved(0.5)
    lin, path = found.linearization, found.signals.motion.trajectory
    states, weights = path.stages
    n, w = path.positions, found.excited.frequency
    C = np.asarray(found.excited.model.damping)
    dampers = weights @ np.einsum("ta,ab,tb->t", states[:, n:], C, states[:, n:])
    phases = 2 * np.pi * path.parts
    gains = jax.vmap(found.signals.gains)(phases) / lin.scales.tension
    moment = (gains * lin.model.lam) @ lin.driving
    crank_power = weights @ (moment * -w * np.deg2rad(0.1) * np.sin(phases))
    friction = found.measures.friction_work[0] / lin.scales.energy / path.period
    assert friction > 0.2 * crank_power
    assert dampers + friction == pytest.approx(float(crank_power), rel=1e-6)


@pytest.mark.slow
def test_the_arm_sticks_between_its_events():
    found = moved(0.5)
    stop, slip, again, on = events_of(found)
    stuck = found.measures.stuck_fractions[0]
    assert stuck == pytest.approx((slip - stop) + (on - again), abs=1e-12)
    times = np.array([stop, slip]) * float(found.period)
    first, last = np.asarray(found.tensioner_motions(np.linspace(*times, 5)))[[0, -1], 0]
    assert last == pytest.approx(first, abs=1e-11)
    assert bool(found.stable)
    assert found.warning == bj.RESULTS.successful


def test_friction_above_what_locks_the_arm_holds_it():
    # "T = 2.0 does not slip, 0.69 slips by 0.0004 degrees", and the reaction spans 0.7058.
    locked = moved(2.0)
    assert locked.measures.stuck_fractions[0] == 1
    assert locked.measures.travels[0] == 0
    assert locked.measures.friction_work[0] == 0
    # Where it rests is free, which does not count as a loss of stability.
    assert bool(locked.stable)
    lin = bj.linearize(bj.steady_state(THREE, POINT), bj.Legendre(4))
    holding = float(
        bj.lock_torque(lin, 2 * SPEED, bj.Excitation(np.deg2rad(0.1)), damping=MODAL)[0, 0]
    )
    travels = [float(moved(part * holding).measures.travels[0]) for part in (0.978, 1.01)]
    assert 0 < np.rad2deg(travels[0]) < 0.001
    assert travels[1] < 1e-12


def test_more_friction_leaves_less_motion():
    travels = [float(moved(torque).measures.travels[0]) for torque in (0.01, 0.1, 0.3, 0.5, 0.65)]
    assert travels == sorted(travels, reverse=True)


def test_what_methods_do_not_know():
    with pytest.raises(
        ValueError, match="'tensioner' with friction_speed = 0 changes the equations"
    ):
        moved(0.5, method=bj.HarmonicBalance())
    with pytest.raises(ValueError, match=r"Shooting\.steps: found 3"):
        bj.Shooting(3)
    free = bj.Orders({2: bj.Excitation(torques={"accessory": 0.1})}, driver="free")
    with pytest.raises(ValueError, match="the driver is free"):
        bj.periodic_response(held(0.5), POINT, free)
    with pytest.raises(ValueError, match="friction_speed = 0 changes the equations"):
        bj.periodic_branch(held(0.5), POINT, crank(0.1), 200.0, 210.0)


@pytest.mark.slow
def test_traced_laws_are_not_taken_for_smooth_ones():
    def result(speed):
        drive = eqx.tree_at(lambda d: d.tensioner.friction_speed, held(0.5), speed)
        found = bj.periodic_response(
            drive, POINT, crank(0.1), functions=0, harmonics=2, damping=MODAL, throw=False
        )
        return found.result

    results = quickly_compiled(jax.vmap(result))(jnp.array([0.05, 0.0]))
    np.testing.assert_array_equal(results == bj.RESULTS.motion_has_modes, [False, True])


@pytest.mark.slow
@pytest.mark.parametrize("functions", [14, 16])
def test_stored_stick_slip(functions):
    # Four of the functions are layers in both, of another kind there: 1e-4.
    case = CASES["coulomb"][f"N{functions}_4layers"]
    found = moved(0.5, functions=functions)
    m = found.measures
    assert np.degrees(m.travels[0]) == pytest.approx(case["arm_peak_to_peak_deg"], rel=1e-4)
    amplitude = np.degrees(m.rotation_amplitudes[2])
    assert amplitude == pytest.approx(case["accessory_amplitude_deg"], rel=1e-4)
    assert m.friction_work[0] == pytest.approx(case["friction_work_J_per_period"], rel=1e-4)
    np.testing.assert_allclose(
        events_of(found), [at for at, _ in case["events_in_periods"]], atol=5e-5
    )
    assert abs(found.multipliers[0]) == pytest.approx(case["floquet"][0], abs=2e-6)


@pytest.mark.slow
def test_a_smooth_motion_is_that_of_harmonic_balance():
    options = {"functions": 2, "damping": MODAL, "harmonics": 24}
    one, other = (
        bj.periodic_response(THREE, POINT, crank(0.2), method=method, **options)
        for method in (bj.HarmonicBalance(), bj.Shooting())
    )
    times = np.linspace(0, float(one.period), 50)
    a, b = np.asarray(one.at(times)), np.asarray(other.at(times))
    np.testing.assert_allclose(a, b, atol=1e-8 * np.abs(a).max())
    size = np.abs(one.coefficients).max()
    np.testing.assert_allclose(one.coefficients, other.coefficients, atol=1e-8 * size)
    np.testing.assert_allclose(
        np.abs(one.multipliers[:6]), np.abs(other.multipliers[:6]), atol=1e-5
    )
    for name in ("travels", "mean_motions", "tension_min", "tension_max", "hub_load_max"):
        ours, theirs = getattr(one.measures, name), getattr(other.measures, name)
        np.testing.assert_allclose(ours, theirs, rtol=1e-7)
    assert other.error < 1e-7


@pytest.mark.slow
def test_shooting_again_with_twice_the_steps():
    coarse, fine = (moved(0.5, functions=14, method=bj.Shooting(n)) for n in (160, 320))
    a, b = coarse.measures, fine.measures
    assert a.travels[0] == pytest.approx(float(b.travels[0]), rel=1e-6)
    assert a.friction_work[0] == pytest.approx(float(b.friction_work[0]), rel=1e-6)


@pytest.mark.slow
def test_derivatives_of_stick_slip_three_ways():
    def numbers_of(drive):
        arm = drive.tensioner
        return (
            arm.friction_torque,
            arm.stiffness,
            drive.belt.axial_stiffness,
            drive.pulleys[2].radius,
        )

    def answers(values):
        drive = eqx.tree_at(numbers_of, held(0.5), tuple(values))
        found = bj.periodic_response(
            drive, POINT, crank(0.1), functions=2, damping=MODAL, method=bj.Shooting(), throw=False
        )
        m = found.measures
        return jnp.stack(
            [m.travels[0], jnp.min(m.tension_min), m.friction_work[0], m.stuck_fractions[0]]
        )

    values = jnp.stack(numbers_of(held(0.5)))
    forward = np.asarray(quickly_compiled(jax.jacfwd(answers))(values))
    np.testing.assert_allclose(quickly_compiled(jax.jacrev(answers))(values), forward, rtol=1e-7)
    by = quickly_compiled(answers)
    for k, value in enumerate(values):
        unit = jnp.zeros(len(values)).at[k].set(1e-4 * value)
        near = by(values + unit) - by(values - unit)
        far = by(values + 2 * unit) - by(values - 2 * unit)
        difference = (8 * near - far) / (12e-4 * value)
        np.testing.assert_allclose(forward[:, k], difference, rtol=2e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "near"), [(0.0, 1e-4), (0.02, 1e-3)])
def test_friction_that_depends_on_the_load(speed, near):
    # The work of a friction of bearing and spring, from hub loads and motions over time.
    hub, spring, unwinding = 0.002, 0.02, 0.4
    parts = {"friction_hub": hub, "friction_spring": spring, "friction_unwinding": unwinding}
    drive = held(0.05, friction_speed=speed, **parts)
    found = bj.periodic_response(drive, POINT, crank(0.1), functions=2, damping=MODAL, harmonics=24)
    lin, k = found.linearization, drive.pulley("tensioner")
    phases = np.linspace(0, 2 * np.pi, 8001)
    loads = np.asarray(jax.vmap(found.signals.hub_loads)(phases))[:, k]
    motion = np.asarray(jax.vmap(found.signals.motions)(phases))[:, 0]
    arm, reference = drive.tensioner, lin.steady.reference
    running = reference.coordinates[0] + lin.steady.coordinate_change[0]
    pull = float(arm.stiffness * (running - reference.free[0]))
    size = 0.05 + hub * loads + spring * np.abs(pull + float(arm.stiffness) * motion)
    moved = np.diff(motion)
    winds = moved * np.sign(pull) > 0
    middle = (size[1:] + size[:-1]) / 2 * np.where(winds, 1.0, unwinding)
    turned = 1.0 if speed == 0 else np.abs(np.tanh(moved * 8000 / float(found.period) / speed))
    work = float(np.sum(middle * turned * np.abs(moved)))
    assert found.measures.friction_work[0] == pytest.approx(work, rel=near)
    assert work > 2e-4


def test_a_table_of_friction_in_a_file(tmp_path):
    text = (EXAMPLES / "three_pulley.toml").read_text()
    table = '{ coulomb = "50 N cm", hub = "2 mm", spring = "5 %", unwinding = 0.5 }'
    lines = f"inertia = 0.001165\nfriction_torque = {table}\nfriction_speed = 0\n"
    path = tmp_path / "dry.toml"
    path.write_text(text.replace("inertia = 0.001165", lines, 1))
    drive, point = bj.load_drive(path)
    bj.save_drive(tmp_path / "again.toml", drive, point)
    for arm in (drive.tensioner, bj.load_drive(tmp_path / "again.toml")[0].tensioner):
        found = arm.friction_torque, arm.friction_hub, arm.friction_spring, arm.friction_unwinding
        np.testing.assert_allclose(found, [0.5, 0.002, 0.05, 0.5], rtol=1e-12)
        assert float(arm.friction_speed) == 0


@pytest.mark.slow
def test_the_command_line_counts_sticking_and_overrun(run, tmp_path):
    text = (EXAMPLES / "three_pulley.toml").read_text()
    lines = "inertia = 0.001165\nfriction_torque = 1.5\nfriction_speed = 0\n"
    text = text.replace("inertia = 0.001165", lines, 1).replace(
        "accessory = 0.0", "accessory = 1.0"
    )
    text += """
[[isolator]]
pulley = "accessory"
stiffness = 200.0
rim_inertia = 1e-4
law = "decoupler"
"""
    path = tmp_path / "joined.toml"
    path.write_text(text)
    words = "--speeds", "2000 rpm", "--crank", "0.3 deg", "--functions", "0", "--json", "-"
    words = *words, "--belt-damping", "0.5 ms"
    status, output, _ = run("periodic", path, *words)
    document = json.loads(output)
    (motion,) = document["periodic"]
    assert [one["code"] for one in document["warnings"]].count("damping_joins_clutch") == 0
    assert status in (0, 2)
    assert motion["success"]
    assert 0 < motion["coordinates"][0]["stuck_fraction"] < 1
    overrun = [one["overrun_per_period"] for one in motion["pulleys"]]
    assert overrun[:2] == [None, None]
    assert overrun[2] > 0
    assert motion["isolators"][0]["open_fraction"] > 0
    status, _, error = run(
        "periodic", path, "--speeds", "2000 rpm:2100 rpm", *words[2:4], "--branch", "up"
    )
    assert status == 1
    assert "--branch: follows motions without events" in error


@pytest.mark.slow
def test_a_bad_lane_disturbs_none():
    def at(torque, rpm):
        found = bj.periodic_response(
            held(torque), bj.OperatingPoint(driver_speed=rpm * 2 * np.pi / 60), crank(0.1),
            functions=2, harmonics=4, damping=MODAL, method=bj.Shooting(80), throw=False,
        )  # fmt: skip
        return found.measures.travels[0], found.result

    torques, speeds = jnp.array([0.5, jnp.nan, 0.3, 0.5]), jnp.array([2000.0, 2000.0, 2100.0, 1e6])
    both = jax.vmap(jax.value_and_grad(at, has_aux=True))
    (travels, results), slopes = quickly_compiled(both)(torques, speeds)
    np.testing.assert_array_equal(results == bj.RESULTS.successful, [True, False, True, False])
    assert np.all(np.isfinite(travels))
    np.testing.assert_array_equal(slopes[jnp.array([1, 3])], 0.0)
    assert np.all(slopes[jnp.array([0, 2])] < 0)
    alone, _ = quickly_compiled(at)(torques[2], speeds[2])
    assert travels[2] == pytest.approx(float(alone), rel=1e-9)
