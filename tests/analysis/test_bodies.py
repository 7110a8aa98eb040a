"""Any movable bodies, isolators and belts against cases converged by two other routes.

`tests/data/bodies.json` holds the cases, each with its drive file and with how far its two routes
agree.
"""

import functools
import json
import re
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drives import example

import beltjax as bj
from beltjax.drive.numbers import number_value, with_numbers
from beltjax.drive.shafts import rotor_names

DATA = Path(__file__).parents[1] / "data" / "bodies.json"
CASES = {name[:2]: case for name, case in json.loads(DATA.read_text())["cases"].items()}
# Case 24 adjusts an eccentric to a mark, where no adjustment of its belt length exists:
# `test_an_eccentric_is_turned_until_the_arm_stands_at_its_mark` has one that does.
FOUND = [name for name in CASES if name != "24"]
QUICK = {"06", "18", "22"}


def cases(quick):
    marked = [pytest.param(n, marks=[] if n in quick else [pytest.mark.slow]) for n in FOUND]
    return pytest.mark.parametrize("name", marked)


@pytest.fixture(scope="module")
def drive_of(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bodies")

    @functools.cache
    def load(name):
        case, path = CASES[name], folder / f"{name}.toml"
        curved = str(case["arm_curvature"]).lower()
        path.write_text(f"{case['file']}\n[model]\narm_curvature = {curved}\n")
        return bj.load_drive(path)

    return load


def assert_near(found, expected, tolerance):
    """Agreement relative to the largest of the numbers."""
    found, expected = np.asarray(found, float), np.asarray(expected, float)
    size = np.max(np.abs(expected), initial=0.0)
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * max(size, 1e-12))


def by_name(drive, numbers):
    return [numbers.get(body.name, 0.0) for body in drive.tensioners]


@cases(QUICK)
def test_states_are_those_of_two_other_routes(name, drive_of):
    drive, point = drive_of(name)
    steady, case = bj.steady_state(drive, point), CASES[name]
    rest, reference, running = case["reference"], steady.reference, case["steady"]
    assert_near(reference.coordinates, by_name(drive, rest["coordinates"]), 1e-9)
    assert_near(reference.installed, by_name(drive, rest["installed"]), 1e-9)
    assert_near(reference.tensions, rest["tensions"], 1e-11)
    assert_near(reference.unstretched_lengths, rest["unstretched_length"], 1e-12)
    assert_near(np.degrees(reference.layout.wraps), list(rest["wraps_deg"].values()), 1e-11)
    assert_near(steady.effectiveness, rest["effectiveness"], 1e-9)
    change = np.asarray(steady.tension_change) * float(steady.scales.tension)
    np.testing.assert_allclose(np.atleast_1d(change), running["tension_change"], rtol=1e-9)
    assert_near(steady.coordinate_change, by_name(drive, running["coordinate_change"]), 1e-9)
    np.testing.assert_allclose(steady.coupling, running["coupling"], rtol=1e-9)
    for arm, force in rest["at_stop_running"].items():
        assert float(steady.stop_reactions[drive.body(arm)]) == pytest.approx(force, rel=1e-9)


@cases({"18"})
def test_frequencies_and_responses_are_those_of_two_other_routes(name, drive_of):
    drive, point = drive_of(name)
    lin, case = bj.linearize(bj.steady_state(drive, point), bj.Legendre(28)), CASES[name]
    found = bj.modes(lin, 8, exact=True).frequencies / (2 * np.pi)
    np.testing.assert_allclose(found, case["hertz"], rtol=1e-8)
    rotors = list(rotor_names(drive))
    for expected in case["response_undamped"]:
        crank = bj.Excitation(crank=expected["crank_amplitude_rad"])
        at = 2 * np.pi * np.array([expected["hertz"]])
        answer = bj.frequency_response(lin, at, crank, exact=True)
        assert_near(np.abs(answer.tensions[0]), expected["tension_amplitudes"], 1e-8)
        bodies = by_name(drive, expected["coordinate_amplitudes"])
        assert_near(np.abs(answer.tensioner_motions[0]), bodies, 1e-8)
        turned = {n: abs(complex(answer.rotor_rotations[0, k])) for k, n in enumerate(rotors)}
        rotor = expected["rotor_amplitudes"]
        assert_near([turned[n] for n in rotor], list(rotor.values()), 1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["06", pytest.param("18", marks=pytest.mark.slow)])
def test_derivatives_three_ways(name, drive_of):
    """The case's own, by complex steps or differences; forward; and reverse."""
    drive, point = drive_of(name)

    given = CASES[name]["derivatives"]
    # The cases count the coordinates of a point from 0.
    places = [re.sub(r"\.([01])$", lambda end: f".{'xy'[int(end[1])]}", key) for key in given]

    def total(values):
        numbers = dict(zip(places, values, strict=True))
        return jnp.sum(bj.steady_state(*with_numbers(drive, point, numbers)).coupling)

    own = jnp.stack([jnp.asarray(number_value(drive, point, place), float) for place in places])
    forward = bj.quick_jit(jax.jacfwd(total))(own)
    reverse = bj.quick_jit(jax.grad(total))(own)
    np.testing.assert_allclose(reverse, forward, rtol=1e-9)
    for slope, expected in zip(forward, given.values(), strict=True):
        tolerance = max(1e-9, 10 * expected["error"])
        assert float(slope) == pytest.approx(expected["coupling_total"], rel=tolerance)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["06", pytest.param("04", marks=pytest.mark.slow)])
def test_contact_is_that_of_another_route(name, drive_of):
    drive, point = drive_of(name)
    # The cases give the speed of the unstretched belt.
    point = bj.OperatingPoint(belt_speed=point.speed(drive), torque=point.torque)
    found, expected = bj.contact_state(drive, point), CASES[name]["contact"]
    assert_near(found.coordinates, by_name(drive, expected["coordinates"]), 1e-9)
    assert float(found.unstretched_length) == pytest.approx(
        expected["unstretched_length"], rel=1e-11
    )
    assert float(found.efficiency) == pytest.approx(expected["efficiency"], rel=1e-11)
    assert_near(np.degrees(found.wraps), list(expected["wrap_deg"].values()), 1e-9)
    assert_near(np.degrees(found.slips), list(expected["slip_deg"].values()), 1e-9)


def test_the_complete_model_runs_as_the_exact_string_does():
    """At 80 m/s without bending: the contact mechanics of a string, which shares no equation."""
    drive, _ = bj.load_drive(Path(__file__).parents[2] / "examples" / "three_pulley.toml")
    fast = bj.OperatingPoint(belt_speed=80.0)
    string = eqx.tree_at(lambda d: d.belt.bending_stiffness, drive, jnp.array(0.0))
    published = bj.steady_state(string, fast)
    np.testing.assert_allclose(published.running_tensions, 827.0, atol=0.05)
    complete = eqx.tree_at(lambda d: d.model, string, bj.Model(1, 1, 1))
    steady = bj.steady_state(complete, fast)
    np.testing.assert_allclose(steady.running_tensions, 793.58, atol=0.005)
    assert float(steady.effectiveness) == pytest.approx(0.7310, abs=5e-5)


@pytest.mark.slow
def test_the_complete_model_s_tension_follows_the_free_angle_as_the_reference_state_s():
    drive, point = bj.load_drive(Path(__file__).parents[2] / "examples" / "three_pulley.toml")
    rest = bj.reference_state(drive, point)
    rule = bj.BeltGiven(rest.unstretched_length, rest.free_angle)
    drive = eqx.tree_at(lambda d: (d.installation, d.model), drive, (rule, bj.Model(1, 1, 1)))

    def tension(angle):
        turned = eqx.tree_at(lambda d: d.installation.free_angle, drive, angle)
        return bj.reference_state(turned, point).tensions[0]

    slope = float(jax.grad(tension)(rest.free_angle))
    assert slope == pytest.approx(-1297.50490, abs=5e-6)
    # The same of the linearized running string at rest: give T = S q, A q = k df - S T.
    steady = bj.steady_state(drive, bj.OperatingPoint(belt_speed=0.0))
    g = steady.groups
    S, give = float(jnp.sum(g.pulls)), float(g.unstretched[0] / g.stretch)
    a, H = g.slopes[:, 0], g.curvatures[:, 0, 0]
    k = float(g.springs[0, 0])
    A = k + float(jnp.sum(g.tensions * (g.span_ratios * a**2 + H)))
    linear = S * k / (A * give + S**2) * float(steady.scales.tension)
    assert linear == pytest.approx(slope, rel=1e-9)


def test_an_eccentric_is_turned_until_the_arm_stands_at_its_mark(drive_of):
    """The belt that the drawn layout takes at 300 N: nothing has to be turned."""
    drive, point = drive_of("24")
    drawn = bj.layout(drive)
    spring, pull = drive.tensioners[1].stiffness, jnp.sum(drawn.span_pulls[:, 1])
    tension, EA = 300.0, drive.belt.axial_stiffness
    belt = drawn.path_length / (1 + tension / EA)
    free = jnp.array([jnp.nan, tension * pull / spring])
    rule = eqx.tree_at(lambda r: (r.belt_length, r.free), drive.installation, (belt, free))
    drive = eqx.tree_at(lambda d: d.installation, drive, rule)
    still = bj.OperatingPoint(driver_speed=point.driver_speed)
    state = bj.reference_state(drive, still)
    np.testing.assert_allclose(state.installed, 0.0, atol=1e-9)
    assert float(state.base_tension) == pytest.approx(300.0, rel=1e-9)
    # A belt that is 20 um longer is taken up, and the arm is back at its mark.
    longer = eqx.tree_at(lambda d: d.installation.belt_length, drive, belt + 2e-5)
    state = bj.reference_state(longer, still)
    assert float(state.installed[1]) == pytest.approx(0.0, abs=1e-12)
    assert abs(float(state.installed[0])) > 1e-3
    assert float(state.unstretched_length) == pytest.approx(float(belt) + 2e-5, rel=1e-12)
    push = spring * (0.0 - free[1]) + state.base_tension * jnp.sum(
        bj.layout(longer, state.installed).span_pulls[:, 1]
    )
    assert abs(float(push)) < 1e-9


def test_loads_are_of_the_spans_that_touch_the_pulley(drive_of):
    """With two belts the span before a belt's first pulley is that belt's last one."""
    drive, point = drive_of("18")
    steady = bj.steady_state(drive, point)
    at = steady.reference.layout
    tensions = np.asarray(steady.effective_tensions * steady.scales.tension)
    quantities = bj.optimize.DriveAnalyses(drive, point, steady)
    for p, name in enumerate(drive.pulley_names):
        (before,) = (k for k, span in enumerate(drive.span_names) if span.endswith(f"-{name}"))
        (after,) = (k for k, span in enumerate(drive.span_names) if span.startswith(f"{name}-"))
        load = tensions[after] * at.directions[after] - tensions[before] * at.directions[before]
        np.testing.assert_allclose(steady.hub_loads[p], load, rtol=1e-12, atol=1e-9)
        measured = bj.optimize.find_quantity(f"hub_load:{name}", drive).measure(quantities)
        assert float(measured[0]) == pytest.approx(np.hypot(*load), rel=1e-12)
        Q = np.asarray(steady.effective_tensions)
        ratio = abs(np.log(Q[after] / Q[before]))
        assert float(steady.slip_exponents[p]) == pytest.approx(ratio, rel=1e-12)


@pytest.mark.parametrize("speed", [0.0, 3.0, 15.0])
def test_a_take_up_bears_its_weight_at_any_speed(speed):
    """The carriage is in balance: its drum's hub bears the 24 kN that pull it, and no more."""
    drive, _ = example("conveyor")
    [carriage] = drive.tensioners
    steady = bj.steady_state(drive, bj.OperatingPoint(belt_speed=speed))
    tail = drive.pulley_names.index("tail")
    pull = float(steady.hub_loads[tail] @ carriage.direction)
    assert pull == pytest.approx(-24e3, rel=1e-4)
