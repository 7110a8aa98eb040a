"""Squeal of belts on their pulleys: cases, a force balance of its own, derivatives, results."""

import dataclasses
import json
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from squealing import squealing, with_laws

import beltjax as bj
from beltjax.compiling.quick import quickly_compiled

CASES = json.loads((Path(__file__).parents[1] / "data" / "friction_vibration.json").read_text())


def test_three_pulleys():
    drive, point = squealing("three_pulley")
    known = CASES["three_pulley"]
    found = bj.slip_stability(drive, point, "accessory", damping=known["belt_damping"])
    assert float(found.model.mass) == pytest.approx(known["arc_mass"], rel=1e-12)
    stiffness = found.model.effective_stiffness(found.onset_speed)
    assert float(stiffness) == pytest.approx(known["k_belt"], rel=1e-12)
    assert float(found.onset_speed) == pytest.approx(known["onset_one_mass"], rel=1e-11)
    hertz = float(found.squeal_frequency) / (2 * np.pi)
    assert hertz == pytest.approx(known["one_mass_hz"], rel=1e-12)
    assert abs(float(found.growth)) < 1e-9
    whole = bj.slip_onset(drive, point, "accessory", damping=known["belt_damping"], slopes=False)
    assert whole.speed == pytest.approx(known["onset_drive"], rel=1e-11)
    assert whole.growing.size == 0


@pytest.fixture(scope="module")
def seven():
    drive, point = squealing("seven_pulley")
    return drive, point, bj.slip_stability(drive, point, damping=50.0)


@pytest.mark.slow
def test_seven_pulleys(seven):
    drive, point, found = seven
    runaways = []
    for name, (alone, whole) in CASES["seven_pulley"].items():
        onset = float(found.onset_speed[drive.pulley(name)])
        assert onset == pytest.approx(alone, abs=5e-5)
        there = bj.slip_onset(drive, point, name, damping=50.0, slopes=False)
        # What is printed for the alternator is the crossing of another pair, at 490 Hz.
        assert there.speed == pytest.approx(whole, rel=5e-3 if name == "alternator" else 5e-5)
        assert there.speed == pytest.approx(onset, rel=5e-3)
        runaways.append(there.runaway_rate)
        # A real root is reported apart: the pair that is followed oscillates.
        assert 2 * np.pi * 1000 < there.frequency < 2 * np.pi * 1500
    assert min(runaways) == pytest.approx(18, abs=0.5)
    assert max(runaways) == pytest.approx(131, abs=0.5)
    assert np.all(np.asarray(found.fold_speed) > np.asarray(found.onset_speed))


@pytest.mark.slow
def test_a_pair_of_the_alternator_on_its_belt_crosses_where_it_is_printed(seven):
    drive, point, _ = seven
    at = bj.slip_stability(drive, point, "alternator", 0.9392, damping=50.0)
    pair = at.eigenvalues[np.argmin(np.abs(at.eigenvalues - 3077j))]
    assert abs(pair.real) < 0.05


@pytest.mark.parametrize("speed", CASES["alternator_cycles"])
def test_limit_cycle_of_the_belt_on_its_arc(seven, speed):
    drive, _, found = seven
    known, v = CASES["alternator_cycles"][speed], float(speed)
    m = jax.tree.map(lambda x: x[drive.pulley("alternator")], found.model)
    at_rest = m.load * (1 - m.gain * m.phi(v) / m.stiffness)
    law = bj.StribeckFriction(0.6, 0.3, 0.3)
    cycle = bj.friction_oscillator(
        m.mass, m.damping, m.stiffness, at_rest, law, v, load_rate=m.gain, wrap=m.wrap
    ).cycle
    assert 1 / float(cycle.period) == pytest.approx(known["hertz"], abs=0.6)
    assert float(cycle.stick_time / cycle.period) == pytest.approx(known["stuck"], abs=6e-4)
    assert float(cycle.amplitude) == pytest.approx(known["amplitude"], abs=6e-7)


def balance(drive, point, name, v, damping):
    """Accelerations of a drive by its forces, as a function of positions and speeds.

    Spans are lines between the rims of a layout that is drawn anew; a belt on its arc follows
    Euler's exponential.
    """
    steady = bj.steady_state(drive, point)
    at, k = steady.reference.layout, drive.pulley(name)
    n, driver = len(drive.pulleys), int(np.argmax(drive.drives))
    radii, wrap = np.asarray(drive.radii), float(at.wraps[k])
    EA, line = float(drive.belt.axial_stiffness), float(drive.belt.mass_per_length)
    Q0 = np.asarray(steady.effective_tensions * steady.scales.tension)
    start, lengths = np.asarray(steady.reference.coordinates), np.asarray(at.span_lengths)
    mass = line * (radii[k] * wrap + (lengths[k - 1] + lengths[k]) / 3)
    inertias = np.array([float(p.inertia) for p in drive.pulleys])
    arm, spring = float(drive.tensioner.inertia), float(drive.tensioner.stiffness)
    turning = [i for i in range(n) if i != driver]
    sense = 1.0 if Q0[k] >= Q0[k - 1] else -1.0
    rate = EA / lengths

    foot = np.asarray(drive.faces) * radii
    rolled = np.asarray(drive.senses) * (np.roll(foot, -1) - foot)

    @jax.jit
    def lines(theta):
        moved = bj.layout(drive, jnp.asarray(start) + theta, throw=False)
        across, along = moved.directions, at.directions
        cross = along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]
        # What a span gains between marks on its pulleys: its line, and what comes off the arcs.
        turned = jnp.arctan2(cross, jnp.sum(along * across, axis=1))
        return moved.span_lengths - lengths - rolled * turned, moved.span_pulls[:, 0]

    def law(v):
        return 0.3 + 0.3 * np.exp(-v / 0.3)

    def forces(z, rates):
        x = np.zeros(n)
        x[turning] = z[: n - 1]
        u = np.zeros(n)
        u[turning] = rates[: n - 1]
        theta, b, b_rate = z[n - 1], z[n], rates[n]
        belt = x.copy()
        belt[k] = b
        gained, pulls = map(np.asarray, lines(theta))
        Q = Q0 + rate * (gained + np.roll(belt, -1) - belt)
        sliding = v + sense * (b_rate - u[k])
        growth = np.exp(law(sliding) * wrap)
        mean = (Q[k] + Q[k - 1]) / 2
        friction = sense * 2 * mean * (growth - 1) / (growth + 1)
        on_rim = np.roll(Q, 1) - Q  # opposed to travel it is the next span that pulls
        on_rim[k] = -friction
        taken = np.roll(Q0, 1) - Q0
        grown = np.exp(law(v) * wrap)
        held = sense * (Q0[k] + Q0[k - 1]) * (grown - 1) / (grown + 1)
        taken[k] = -held
        turned = -(on_rim - taken)[turning] / (inertias / radii**2)[turning]
        swung = -(Q @ pulls - Q0 @ np.asarray(at.span_pulls)[:, 0]) - spring * theta
        along = Q[k] - Q[k - 1] - friction - (Q0[k] - Q0[k - 1] - held) - damping * b_rate
        return np.concatenate([turned, [swung / arm], [along / mass]])

    return forces, n + 1


@pytest.mark.parametrize("name", ["accessory", "tensioner", "crankshaft"])
def test_equations_of_a_drive_against_a_balance_of_forces(name):
    drive, point = squealing("three_pulley")
    name = {"crankshaft": drive.pulley_names[0]}.get(name, name)
    drive = dataclasses.replace(drive, model=dataclasses.replace(drive.model, arm_curvature=1.0))
    point = dataclasses.replace(point, belt_speed=0.0)  # a tensioner that runs is moved linearly
    v, damping = 0.7, 30.0
    forces, size = balance(drive, point, name, v, damping)
    still, step = np.zeros(size), 1e-7
    by_place = np.zeros((size, size))
    by_rate = np.zeros((size, size))
    for j, unit in enumerate(np.eye(size)):
        h = step
        by_place[:, j] = (forces(h * unit, still) - forces(-h * unit, still)) / (2 * h)
        by_rate[:, j] = (forces(still, 1e-4 * unit) - forces(still, -1e-4 * unit)) / 2e-4
    states = np.block([[np.zeros((size, size)), np.eye(size)], [by_place, by_rate]])
    expected = np.linalg.eigvals(states)
    found = bj.slip_stability(drive, point, name, v, damping=damping).eigenvalues
    scale = np.abs(expected).max()
    for value in expected:
        assert np.abs(found - value).min() < 3e-6 * max(abs(value), 1e-3 * scale), value


DRIVE, POINT = squealing("three_pulley")


def numbers_in(numbers):
    drive, point = numbers
    pulley = drive.pulleys[2]
    return [
        drive.belt.axial_stiffness, drive.belt.mass_per_length, drive.installation.tension,
        pulley.radius, pulley.friction, pulley.friction_static, pulley.friction_speed,
        pulley.inertia, point.belt_speed,
    ]  # fmt: skip


def vector_of(x):
    drive, point = eqx.tree_at(numbers_in, (DRIVE, POINT), list(x))
    found = bj.slip_stability(drive, point, "accessory", 0.4, damping=30.0, throw=False)
    numbers = [
        found.onset_speed, found.fold_speed, found.squeal_frequency, found.critical_damping,
        found.growth, found.runaway_rate,
    ]  # fmt: skip
    return jnp.stack(numbers), found.result


def of_lane(x):
    along = x * ALONG
    value, forward, result = jax.jvp(vector_of, (x,), (along,), has_aux=True)
    return value, forward, jax.jacrev(lambda x: vector_of(x)[0])(x), result


ALONG = jnp.asarray(np.random.default_rng(1).normal(size=9))
VALUES = jnp.stack(numbers_in((DRIVE, POINT)))


@pytest.fixture(scope="module")
def lanes():
    """The drive, one whose belt is slack, one without tension, one whose friction has no speed."""
    slack, none = VALUES.at[2].set(1.0), VALUES.at[2].set(-5.0)
    x = jnp.stack([VALUES, slack, none, VALUES.at[6].set(-1.0), VALUES.at[3].set(jnp.nan)])
    return quickly_compiled(jax.vmap(of_lane))(x)


@pytest.mark.slow
def test_derivatives_three_ways(lanes):
    forward, reverse = (np.asarray(part[0]) for part in lanes[1:3])
    x = np.asarray(VALUES)
    np.testing.assert_allclose(forward, reverse @ (x * ALONG), rtol=1e-9)
    h = 1e-4 * x
    steps = np.concatenate([c * np.diag(h) for c in (-2, -1, 1, 2)])
    values, _ = quickly_compiled(jax.vmap(vector_of))(x + steps)
    m2, m1, p1, p2 = np.split(np.asarray(values), 4)
    differences = ((m2 - p2) + 8 * (p1 - m1)).T / (12 * h)
    size = np.max(np.abs(reverse) * h, axis=1, keepdims=True) / h
    assert np.max(np.abs(reverse - differences) / size) < 1e-7


@pytest.mark.slow
def test_a_bad_lane_leaves_its_neighbors_alone(lanes):
    values, forward, reverse, result = lanes
    alone = bj.slip_stability(DRIVE, POINT, "accessory", 0.4, damping=30.0)
    np.testing.assert_array_equal(result == bj.RESULTS.successful, [True, *[False] * 4])
    assert float(values[0][0]) == pytest.approx(float(alone.onset_speed), rel=1e-12)
    for part in (values, forward, reverse):
        assert np.all(np.isfinite(part))
        np.testing.assert_array_equal(np.asarray(part)[1:], 0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "where",
    [
        lambda d: d.belt.axial_stiffness,
        lambda d: d.installation.tension,
        lambda d: d.pulleys[2].friction,
        lambda d: d.pulleys[2].inertia,
        lambda d: d.pulleys[1].center,
        lambda d: d.tensioner.stiffness,
        lambda d: d.belt.longitudinal_damping,
    ],
    ids=["EA", "tension", "friction", "inertia", "center", "spring", "damping"],
)
def test_slope_of_the_onset_of_the_whole_drive(where):
    drive, point = squealing("three_pulley")
    belt = dataclasses.replace(drive.belt, longitudinal_damping=30.0)
    drive = dataclasses.replace(drive, belts=(belt,))
    slope = where(bj.slip_onset(drive, point, "accessory").gradient[0])
    value = where(drive)
    along = jnp.ones_like(value)
    h = 1e-4 * float(jnp.max(jnp.abs(value)))
    onsets = [
        bj.slip_onset(
            eqx.tree_at(where, drive, value + c * h * along), point, "accessory", slopes=False
        ).speed
        for c in (-2, -1, 1, 2)
    ]
    difference = (onsets[0] - onsets[3] + 8 * (onsets[2] - onsets[1])) / (12 * h)
    assert float(jnp.sum(slope)) == pytest.approx(difference, rel=1e-6)


def test_why_there_is_no_squeal():
    drive, point = squealing("three_pulley")
    heavy = bj.slip_stability(drive, point, "accessory", damping=1e4)
    assert heavy.result == bj.RESULTS.onset_beyond_stick
    assert float(heavy.onset_speed) == 0
    flat, _ = squealing("three_pulley", friction_static=0.3)
    found = bj.slip_stability(flat, point, "accessory", damping=30.0)
    assert found.result == bj.RESULTS.no_negative_slope
    assert float(found.onset_speed) == float(found.critical_damping) == 0
    critical = bj.slip_stability(drive, point, "accessory", damping=30.0).critical_damping
    just = bj.slip_stability(drive, point, "accessory", damping=float(critical) * 0.999999)
    assert 0 < float(just.onset_speed) < 0.3
    at = bj.slip_stability(drive, point, "accessory", 0.5, damping=30.0)
    there = bj.slip_stability(drive, point, "accessory", damping=float(at.critical_damping))
    assert float(there.onset_speed) == pytest.approx(0.5, rel=1e-9)


def test_cubic_friction_on_a_pulley():
    drive, point = squealing("three_pulley")
    cubic = with_laws(drive, friction_law="cubic", friction_speed=1.0)
    found = bj.slip_stability(cubic, point, "accessory", damping=30.0)
    assert 0 < float(found.fold_speed) < float(found.onset_speed) < 1.0


def test_what_is_refused():
    drive, point = squealing("three_pulley")
    with pytest.raises(ValueError, match="longitudinal_damping is missing"):
        bj.slip_stability(drive, point, "accessory")
    with pytest.raises(ValueError, match="damping: must be positive"):
        bj.slip_stability(drive, point, "accessory", damping=0.0)
    with pytest.raises(ValueError, match="sliding_speed: must be positive"):
        bj.slip_stability(drive, point, "accessory", -1.0, damping=30.0)
    with pytest.raises(KeyError, match="no pulley 'pump'"):
        bj.slip_stability(drive, point, "pump", damping=30.0)
    with pytest.raises(ValueError, match="needs friction and friction_speed"):
        dataclasses.replace(drive.pulleys[0], friction=None)
    bare, _ = squealing("three_pulley", friction=None, friction_static=None, friction_speed=None)
    with pytest.raises(ValueError, match="friction is missing"):
        bj.slip_stability(bare, point, "accessory", damping=30.0)


@pytest.mark.slow
def test_a_drive_without_inertias_has_arcs_alone():
    drive, point = squealing("three_pulley")
    none = eqx.tree_at(lambda d: d.pulleys[0].inertia, drive, None, is_leaf=lambda x: x is None)
    lacking = bj.slip_stability(none, point, "accessory", damping=30.0)
    with pytest.raises(ValueError, match="an inertia is missing"):
        _ = lacking.eigenvalues
