"""Several duties in one file: each is what a file of its own gives, and the worst is named."""

import json
import math
import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies_cases import load as load_drive
from bodies_cases import swap
from compilations import compilations
from drives import EXAMPLES

import beltjax as bj
from beltjax.commands.reports.arguments import read_drive
from beltjax.commands.reports.vibrating import vibrating
from beltjax.drive.file_operation import operation_content
from beltjax.drive.files import drive_content
from beltjax.results import explanations, successes

THREE = (EXAMPLES / "three_pulley.toml").read_text()
THREE = swap(THREE, "inertia = 0.001165", 'stops = ["-24 deg", "16 deg"]\ninertia = 0.001165')
THREE = swap(THREE, "[0.0, 0.0]", "[0.0, 0.0]\nfriction = 0.9")
BARE = THREE[: THREE.index("[operation]")]
POWER = '[operation]\nbelt_speed = 20\n[operation.load.accessory]\npower = "1 kW"\n'
DUTIES = (
    POWER
    + """
[[duty]]
name = "idle"
driver_speed = "750 rpm"
torque = { accessory = "0.5 N m" }
[[duty]]
name = "fast"
belt_speed = 30
[[duty]]
name = "heavy"
load = { accessory = { power = "4 kW" } }
"""
)
# The same, each as the [operation] of a file of its own.
ALONE = {
    "idle": '[operation]\ndriver_speed = "750 rpm"\n[operation.torque]\naccessory = 0.5\n',
    "fast": '[operation]\nbelt_speed = 30\n[operation.load.accessory]\npower = "1 kW"\n',
    "heavy": '[operation]\nbelt_speed = 20\n[operation.load.accessory]\npower = "4 kW"\n',
}
STATES = "coordinates", "pulleys", "spans"


def analyzed(run, tmp_path, text):
    (tmp_path / "drive.toml").write_text(text)
    status, out, err = run("analyze", "drive.toml", "--json", "out.json")
    return json.loads((tmp_path / "out.json").read_text()), status, out, err


def agree(one, two):
    """Whether two documents agree to 1e-12."""
    if isinstance(one, dict):
        return one.keys() == two.keys() and all(agree(one[key], two[key]) for key in one)
    if isinstance(one, list):
        return len(one) == len(two) and all(map(agree, one, two))
    return one == (pytest.approx(two, rel=1e-12, abs=1e-12) if isinstance(two, float) else two)


@pytest.mark.slow
def test_each_duty_is_what_a_file_of_its_own_gives(run, tmp_path):
    found, status, out, err = analyzed(run, tmp_path, BARE + DUTIES)
    assert (status, err) == (0, "")
    assert [duty["name"] for duty in found["duties"]] == list(ALONE)
    for duty in found["duties"]:
        alone, *_ = analyzed(run, tmp_path, BARE + ALONE[duty["name"]])
        assert all(agree(duty[key], alone[key]) for key in STATES)
        assert agree(duty["coupling"], alone["steady"]["coupling"])
        assert [one["code"] for one in duty["warnings"]] == [
            one["code"] for one in alone["warnings"]
        ]
        assert alone["duties"] is alone["worst"] is None
    # All else is of [operation].
    common, *_ = analyzed(run, tmp_path, BARE + POWER)
    assert found["duty"] is None
    assert agree(found["sensitivities"], common["sensitivities"])
    assert agree(found["steady"], common["steady"])
    heads = ["warning: at ", "Duty idle", "Duty fast", "Duty heavy", "Worst of the duties"]
    heads += ["Greatest hub load", "at [operation]:", "belt length", "What moves Gamma most"]
    places = [out.index(head) for head in heads]
    assert places == sorted(places)


def test_the_worst_duty_is_named(run, tmp_path):
    """By hand: all is the accessory's pull, P/v or M/r = 18.5, 33.3 and 200 N between its spans.

    The step is the greatest for "heavy", and with it the tight span and the ratio of tensions. At
    30 m/s the running belt regains the most of what its momentum takes, so that "idle" and "heavy"
    are those with loose spans: at equal mean tension the greater step leaves less. The loads on the
    accessory's hub, around which the belt goes half a turn, are the sums of its spans' tensions,
    each without the m v^2 that turns the belt round.
    """
    found, _, out, _ = analyzed(run, tmp_path, BARE + DUTIES)
    worst = {(one["quantity"], one["extreme"]): one for one in found["worst"]}
    duties = {duty["name"]: duty for duty in found["duties"]}
    for name, step in (("idle", 0.5 / 0.02697), ("fast", 1000 / 30), ("heavy", 4000 / 20)):
        slack, tight = (duties[name]["spans"][k]["tension"] for k in (1, 2))
        assert tight - slack == pytest.approx(step, rel=1e-12)
    tight = worst["tension", "greatest"]
    assert (tight["duty"], tight["at"]) == ("heavy", "accessory-crankshaft")
    least = worst["slip_margin", "least"]
    assert (least["duty"], least["at"]) == ("heavy", "accessory")
    tensions = {name: [row["tension"] for row in duties[name]["spans"]] for name in duties}
    slack = worst["tension", "least"]
    assert slack["value"] == min(map(min, tensions.values()))
    assert slack["value"] == tensions[slack["duty"]][1]
    load = worst["hub_load", "greatest"]
    mass = float(load_drive(tmp_path, BARE + POWER)[0].belt.mass_per_length)
    held = {
        name: sum(tensions[name][1:]) - 2 * mass * duties[name]["belt_speed"] ** 2
        for name in duties
    }
    greatest = max(held, key=lambda name: held[name])
    assert (load["duty"], load["at"], load["unit"]) == (greatest, "accessory", "N")
    assert load["value"] == pytest.approx(held[greatest], rel=1e-3)
    way = worst["way_to_stop", "least"]
    ways = {
        (name, end): duties[name]["coordinates"][0][f"to_{end}"]
        for name in duties
        for end in ("least", "greatest")
    }
    name, _ = min(ways, key=ways.get)
    assert (way["duty"], way["at"], way["unit"]) == (name, "tensioner", "rad")
    for one in duties.values():
        [arm] = one["coordinates"]
        assert arm["to_least"] + arm["to_greatest"] == pytest.approx(math.radians(40), rel=1e-12)
    assert worst["coupling_total", "greatest"]["at"] == ""
    hubs = {one["at"]: one for one in found["worst_hub_loads"]}
    assert list(hubs) == ["crankshaft", "tensioner", "accessory"]
    assert hubs["accessory"]["value"] == load["value"]
    assert re.search(r"greatest running tension +[\d.]+ +N +accessory-crankshaft +heavy", out)


@pytest.mark.slow
def test_a_meter_hears_a_running_string_lower(run, tmp_path):
    """A string of tension T that runs at v: (1 - v^2 m/T) sqrt(T/m)/(2 l) (Sack 1954)."""
    string = swap(BARE, "bending_stiffness = 0.015", "bending_stiffness = 0")
    found, *_ = analyzed(run, tmp_path, string + "[operation]\nbelt_speed = 30\n")
    for span in found["spans"]:
        wave = math.sqrt(span["tension"] / 0.1029)
        hertz = wave / (2 * span["length"]) * (1 - (30 / wave) ** 2)
        assert span["meter_hz_running"] == pytest.approx(hertz, rel=1e-9)
        still = math.sqrt(span["tension_at_rest"] / 0.1029) / (2 * span["length"])
        assert span["meter_hz"] == pytest.approx(still, rel=1e-12)


def test_the_standard_lengths_next_to_the_path_are_shown(run, tmp_path):
    """The path takes 1.5143 m."""
    lengths = '["1490 mm", "1510 mm", "1525 mm", "1550 mm"]'
    text = swap(BARE, "[belt]\n", f"[belt]\nstandard_lengths = {lengths}\n") + POWER
    found, _, out, _ = analyzed(run, tmp_path, text)
    [belt] = found["belts"]
    assert belt["path_length"] == pytest.approx(1.5143, abs=1e-4)
    assert belt["standard_lengths"] == pytest.approx([1.510, 1.525], rel=1e-14)
    assert re.search(r"next to the path of belt +1510\.000, 1525\.000 +mm", out)


def test_a_duty_that_does_not_run_is_named_and_the_others_stand(run, tmp_path):
    text = swap(DUTIES, 'load = { accessory = { power = "4 kW" } }', "torque = { accessory = -40 }")
    found, status, out, err = analyzed(run, tmp_path, BARE + text)
    assert status == 2
    assert err.count("\n") == 1
    assert "duty.heavy: operation.torque: span" in err
    assert "slack at rest" in err
    assert [duty["success"] for duty in found["duties"]] == [True, True, False]
    assert {one["duty"] for one in found["worst"]} <= {"idle", "fast"}
    assert not found["success"]
    assert "Duty heavy (does not run)" in out
    good, *_ = analyzed(run, tmp_path, BARE + DUTIES)
    for before, after in zip(good["duties"][:2], found["duties"][:2], strict=True):
        assert all(agree(before[key], after[key]) for key in STATES)


@pytest.mark.slow
def test_without_a_speed_of_its_own_the_operation_is_the_first_duty(run, tmp_path):
    text = swap(BARE + DUTIES, "belt_speed = 20\n", "")
    text = swap(text, 'name = "heavy"\n', 'name = "heavy"\nbelt_speed = 20\n')
    found, status, out, _ = analyzed(run, tmp_path, text)
    assert (status, found["duty"]) == (0, "idle")
    assert "at duty idle:" in out
    assert agree(found["pulleys"], found["duties"][0]["pulleys"])
    _, point = load_drive(tmp_path, text)
    assert float(point.driver_speed) == pytest.approx(25 * math.pi, rel=1e-15)


def test_other_commands_take_the_duty_that_is_named(run, tmp_path):
    (tmp_path / "drive.toml").write_text(BARE + DUTIES)
    for name, (_, point, at) in {
        "heavy": vibrating(tmp_path / "drive.toml", "heavy"),
        "fast": read_drive(tmp_path / "drive.toml", "fast"),
    }.items():
        assert at == f"duty {name}"
        assert operation_content(point) == operation_content(
            load_drive(tmp_path, BARE + ALONE[name])[1]
        )
        (tmp_path / "drive.toml").write_text(BARE + DUTIES)
    sweep = "sweep", "drive.toml", "--over", "installation.tension=300:310:2"
    for words in (("contact", "drive.toml"), sweep, ("response", "drive.toml")):
        status, _, err = run(*words, "--duty", "slow")
        assert status == 1
        assert "there is no duty 'slow' in drive.toml; give one of idle, fast, heavy" in err
        assert err.count("\n") == 1


@pytest.mark.slow
def test_a_title_says_at_which_of_several_points_it_answers(run, tmp_path):
    """With [operation] and duties, with duties alone, and without duties."""
    alone = swap(BARE + DUTIES, "belt_speed = 20\n", "")
    alone = swap(alone, 'name = "heavy"\n', 'name = "heavy"\nbelt_speed = 20\n')
    sweep = "sweep", "drive.toml", "--over", "installation.tension=300:310:2", "--json", "s.json"
    for text, at in [(BARE + DUTIES, "[operation]"), (alone, "duty idle"), (THREE, "")]:
        (tmp_path / "drive.toml").write_text(text)
        status, out, _ = run(*sweep)
        assert status == 0
        assert json.loads((tmp_path / "s.json").read_text())["at"] == at
        assert f"{at and f' at {at}'}: natural frequencies" in out


def test_what_a_duty_does_not_state_is_that_of_the_operation(tmp_path):
    text = """
[operation]
driver_speed = 100
travel = "opposite"
[operation.torque]
tensioner = 0.1
[operation.load.accessory]
power = 500
[[duty]]
name = "a"
[[duty]]
name = "b"
belt_speed = 3
torque.accessory = 2
[[duty]]
name = "c"
travel = "listed"
load.tensioner.drag = 0.3
"""
    (tmp_path / "drive.toml").write_text(BARE + text)
    drive, duties = bj.load_duties(tmp_path / "drive.toml")
    a, b, c = duties.values()
    assert drive_content(drive, a) == drive_content(*load_drive(tmp_path, BARE + text))
    assert (float(b.belt_speed), b.driver_speed, float(b.travel)) == (3.0, None, -1.0)
    assert {name: float(x) for name, x in b.torque.items()} == {"tensioner": 0.1, "accessory": 2.0}
    assert b.load == {}
    assert (float(c.travel), c.torque) == (1.0, {})
    assert float(c.load["tensioner"].drag) == 0.3
    assert float(c.load["accessory"].power) == 500.0


def test_round_trip(tmp_path):
    (tmp_path / "drive.toml").write_text(BARE + DUTIES)
    drive, duties = bj.load_duties(tmp_path / "drive.toml")
    _, point = bj.load_drive(tmp_path / "drive.toml")
    bj.save_drive(tmp_path / "copy.toml", drive, point, duties)
    again, same = bj.load_duties(tmp_path / "copy.toml")
    np.testing.assert_array_equal(
        bj.duty_states(again, same).running_tensions, bj.duty_states(drive, duties).running_tensions
    )
    for name in duties:
        np.testing.assert_array_equal(same[name].torques(again), duties[name].torques(drive))
    assert list(bj.load_duties(EXAMPLES / "three_pulley.toml")[1]) == ["operation"]


def test_states_of_duties_are_one_program(tmp_path):
    """Other numbers, loads in place of torques and another number of duties compile nothing."""
    (tmp_path / "drive.toml").write_text(BARE + DUTIES)
    drive, duties = bj.load_duties(tmp_path / "drive.toml")
    found = bj.duty_states(drive, duties)
    assert found.running_tensions.shape == (3, 3)
    for k, point in enumerate(duties.values()):
        alone = bj.steady_state(drive, point)
        np.testing.assert_allclose(found.running_tensions[k], alone.running_tensions, rtol=1e-13)
    more = duties | {"more": bj.OperatingPoint(belt_speed=7.0)}
    with compilations() as count:
        bj.duty_states(drive, more)
    assert count == [0]
    still = {"still": bj.OperatingPoint(belt_speed=0.0, load={"accessory": bj.Load(power=9.0)})}
    failed = bj.duty_states(drive, duties | still)
    assert successes(failed.result).tolist() == [True, True, True, False]
    np.testing.assert_array_equal(failed.running_tensions[:3], found.running_tensions)
    table = bj.Load(torque=[1.0, 1.0], speed=[1.0, 5.0])
    flexible = eqx.tree_at(lambda d: d.belt.bending_stiffness, drive, jnp.array(1e-4))
    beyond = {"beyond": bj.OperatingPoint(belt_speed=20.0, load={"accessory": table})}
    warned = bj.duty_states(flexible, duties | beyond)
    assert explanations(warned.warning)[3].startswith("A pulley turns faster or slower")
    assert explanations(warned.warning)[:3] == ("", "", "")


@pytest.mark.slow
def test_derivatives_follow_speeds_and_loads(tmp_path):
    (tmp_path / "drive.toml").write_text(BARE + DUTIES)
    drive, duties = bj.load_duties(tmp_path / "drive.toml")

    def tight(drive):
        return bj.duty_states(drive, duties).running_tensions[:, 2].sum()

    def one_by_one(drive):
        states = [bj.steady_state(drive, point) for point in duties.values()]
        return sum(state.running_tensions[2] for state in states)

    together, apart = (jax.grad(f)(drive) for f in (tight, one_by_one))
    for one, two in zip(jax.tree.leaves(together), jax.tree.leaves(apart), strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-9, atol=1e-9 * float(jnp.abs(two).max()))


STUDY = """
drive = "drive.toml"
[objective]
minimize = "coupling"
[[variable]]
name = "pulley.accessory.radius"
lower = "22 mm"
upper = "45 mm"
[[constraint]]
quantity = "hub_load:accessory@heavy"
upper = 900
"""
BY_DRIVER = (
    POWER.replace("belt_speed = 20", "driver_speed = 225")
    + """
[[duty]]
name = "idle"
driver_speed = "750 rpm"
torque = { accessory = "0.5 N m" }
[[duty]]
name = "heavy"
load = { accessory = { power = "4 kW" } }
"""
)


def test_a_study_is_over_the_duties_of_its_drive(tmp_path):
    (tmp_path / "drive.toml").write_text(BARE + BY_DRIVER)
    (tmp_path / "study.toml").write_text(STUDY)
    study = bj.optimize.load_study(tmp_path / "study.toml")
    assert study.cases.names == ("idle", "heavy")
    drive, duties = bj.load_duties(tmp_path / "drive.toml")
    bj.save_drive(tmp_path / "saved.toml", study.drive, study.point, study.cases.duties)
    _, saved = bj.load_duties(tmp_path / "saved.toml")
    for name, point in duties.items():
        np.testing.assert_allclose(saved[name].torques(drive), point.torques(drive), rtol=1e-15)
    wider = bj.optimize.with_values(drive, {"pulley.accessory.radius": jnp.array(0.04)})
    found = bj.optimize.problem.run_measured(study, wider)
    totals = bj.duty_states(wider, duties).coupling.sum(axis=1)
    assert float(found.worst) == pytest.approx(float(totals.max()), rel=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('name = "fast"', 'name = "idle"', r"duty\.idle: needs a name of its own"),
        ('name = "fast"', 'name = "a.b"', r"duty\.a\.b: needs a name of its own, without '\.'"),
        ("belt_speed = 30", "belt_speed = 30\ndriver_speed = 3", r"duty\.fast: found both of belt_speed and driver_speed; give one"),
        ("belt_speed = 30", 'belt_speed = "30 rpm"', r"duty\.fast\.belt_speed: found '30 rpm'.* operation\.driver_speed takes rpm"),
        ("belt_speed = 30", "belt_sped = 30", r"duty\.fast\.belt_sped: is not a known key; did you mean 'belt_speed'"),
        ("belt_speed = 30", "torque = { pump = 3 }", r"duty\.fast\.torque\.pump: there is no pulley 'pump'"),
        ("belt_speed = 30", "torque = { crankshaft = 3 }", r"duty\.fast\.torque\.crankshaft: the driver balances"),
        ("belt_speed = 30", "belt_speed = 0", r"duty\.fast\.load\.accessory\.power: nothing turns"),
        ("belt_speed = 30", "mass_flow = 1", r"duty\.fast\.mass_flow: goes with driver_speed"),
        ('name = "fast"\n', "", r"duty\[1\]\.name: is missing"),
        (DUTIES, POWER + '[duty]\nname = "a"\n', r"duty: found one table; write its heading in double brackets: \[\[duty\]\]"),
    ],
)  # fmt: skip
def test_wrong_duties_are_one_line(tmp_path, old, new, says):
    with pytest.raises(bj.FileError) as error:
        load_drive(tmp_path, BARE + swap(DUTIES, old, new))
    assert "\n" not in str(error.value)
    assert re.search(says, str(error.value))


def test_duties_that_no_study_can_join_are_refused(tmp_path):
    (tmp_path / "drive.toml").write_text(BARE + DUTIES)
    (tmp_path / "study.toml").write_text(STUDY)
    with pytest.raises(bj.FileError, match=r"duty: some give belt_speed and some driver_speed"):
        bj.optimize.load_study(tmp_path / "study.toml")
    table = "load = { accessory = { speed = [1, 2000], power = [0, 4e3] } }"
    text = swap(BY_DRIVER, 'load = { accessory = { power = "4 kW" } }', table)
    text = swap(text, "torque = { accessory", "torque = { tensioner")
    (tmp_path / "drive.toml").write_text(BARE + text)
    with pytest.raises(bj.FileError, match=r"the load of 'accessory' at '.*' has other numbers"):
        bj.optimize.load_study(tmp_path / "study.toml")
