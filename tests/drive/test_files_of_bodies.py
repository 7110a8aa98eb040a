"""Drive files with several tensioners, springs, isolators and belts: read, written, refused."""

import dataclasses
import re

import equinox as eqx
import jax
import numpy as np
import pytest
from bodies_cases import (
    CASES,
    ECCENTRIC,
    ISOLATORS,
    LEVER,
    SLIDE,
    TWIN,
    TWO_ARMS,
    TWO_BELTS,
    load,
    swap,
)
from drives import EXAMPLES

import beltjax as bj
from beltjax.drive.buildable import layout_fault

THREE = (EXAMPLES / "three_pulley.toml").read_text()


def saved_and_loaded(tmp_path, drive, point):
    bj.save_drive(tmp_path / "copy.toml", drive, point)
    return bj.load_drive(tmp_path / "copy.toml")


def assert_equal(one, other):
    assert jax.tree.structure(one) == jax.tree.structure(other)
    same = jax.tree.map(lambda a, b: np.array_equal(a, b, equal_nan=True), one, other)
    assert jax.tree.all(same)


@pytest.mark.parametrize("name", CASES)
def test_cases_are_read_built_and_saved_exactly(name, tmp_path):
    drive, point = load(tmp_path, CASES[name]["file"])
    assert layout_fault(drive) is None
    assert_equal(saved_and_loaded(tmp_path, drive, point), (drive, point))
    # The file's names and order are those of the stored coordinates and spans.
    reference = CASES[name]["reference"]
    assert set(reference["coordinates"]) == {body.name for body in drive.tensioners}
    assert CASES[name]["spans"] == list(drive.span_names)
    at = bj.layout(drive, [reference["coordinates"][body.name] for body in drive.tensioners])
    np.testing.assert_allclose(at.span_lengths, reference["span_lengths"], rtol=1e-11)
    wraps = [reference["wraps_deg"][pulley] for pulley in drive.pulley_names]
    np.testing.assert_allclose(np.degrees(at.wraps), wraps, rtol=1e-11)


def test_a_twin_arm_is_two_tensioners_and_a_spring(tmp_path):
    text = swap(TWIN, "inertia = [0.0024, 0.0024]", "inertia = [0.0024, 0.0025]\ndamping = 0.1")
    text = swap(text, "damping = 0.1", 'damping = 0.1\nstops = ["-8 deg", "8 deg"]')
    drive, point = load(tmp_path, text)
    assert [body.name for body in drive.tensioners] == ["twin.0", "twin.1"]
    one, two = drive.tensioners
    assert (one.pivot == two.pivot).all()
    assert float(one.stiffness) == float(two.stiffness) == 0.0
    assert (float(one.inertia), float(two.inertia)) == (0.0024, 0.0025)
    assert one.stops.tolist() == two.stops.tolist() == [-np.deg2rad(8), np.deg2rad(8)]
    (spring,) = drive.arm_springs
    assert spring.name == "twin"
    assert spring.between.tolist() == [-1.0, 1.0]
    assert (float(spring.stiffness), float(spring.damping)) == (60.0, 0.1)
    carried = [p.name for p in drive.pulleys if float(p.on[0])]
    assert carried == ["right"]
    assert_equal(saved_and_loaded(tmp_path, drive, point), (drive, point))
    assert 'kind = "twin-arm"' in (tmp_path / "copy.toml").read_text()


def test_what_a_twin_arm_cannot_say_is_saved_as_two_tensioners(tmp_path):
    drive, point = load(tmp_path, TWIN)
    pivot = drive.tensioners[1].pivot + 1e-3
    moved = eqx.tree_at(lambda d: d.tensioners[1].pivot, drive, pivot)
    assert_equal(saved_and_loaded(tmp_path, moved, point), (moved, point))
    assert "[[arm_spring]]" in (tmp_path / "copy.toml").read_text()


def test_a_single_arm_is_saved_as_the_shorthand_with_its_directions(tmp_path):
    text = swap(THREE, "stiffness = 116.4", 'stiffness = 116.4\nstops = ["-20 deg", "15 deg"]')
    drive, point = load(tmp_path, text)
    drawn = np.arctan2(0.05715 - 0.0635, 0.3477 - 0.2508)
    stops = np.deg2rad([-20.0, 15.0]) - drawn
    np.testing.assert_allclose(drive.tensioner.stops, stops, rtol=1e-15)
    # Written a whole turn further they mean the same.
    turned = swap(text, '["-20 deg", "15 deg"]', '["340 deg", "375 deg"]')
    np.testing.assert_allclose(load(tmp_path, turned)[0].tensioner.stops, stops, rtol=1e-13)
    assert_equal(saved_and_loaded(tmp_path, drive, point), (drive, point))
    written = (tmp_path / "copy.toml").read_text()
    assert "\n[tensioner]\n" in written
    assert float(re.search(r"stops = \[\s*([-.0-9]+)", written)[1]) == np.deg2rad(-20.0)


@pytest.mark.parametrize("stops", [(-0.1, 0.3), (-0.123456789, np.pi / 7), (-np.inf, 0.2)])
@pytest.mark.parametrize("name", ["tensioner", "t1"])
def test_stops_of_any_arm_come_back_exactly(stops, name, tmp_path):
    text = swap(TWO_ARMS[: TWO_ARMS.index("[[tensioner]]")], "schema = 1", "schema = 2")
    words = str(list(stops)).replace("np.float64", "")
    text += f'[[tensioner]]\nname = "{name}"\npulley = "idler"\npivot = [-0.11, 0.36]\n'
    text += f"stiffness = 25\nstops = {words}\n[installation]\ntension = 350\n"
    drive, point = load(tmp_path, text + "[operation]\nbelt_speed = 5")
    assert drive.tensioner.stops.tolist() == list(stops)
    assert_equal(saved_and_loaded(tmp_path, drive, point), (drive, point))


def test_slides_have_masses_and_units_of_their_own(tmp_path):
    text = swap(SLIDE, "stiffness = 4000", 'stiffness = "4 N/mm"\nstops = ["-5 mm", "5 mm"]')
    drive, point = load(tmp_path, text)
    slide = drive.tensioner
    assert float(slide.stiffness) == 4000.0
    assert slide.stops.tolist() == [-0.005, 0.005]
    assert (float(slide.mass), float(slide.inertia)) == (0.25, 0.0)
    np.testing.assert_allclose(slide.direction, [np.cos(np.pi / 18), np.sin(np.pi / 18)])
    assert_equal(saved_and_loaded(tmp_path, drive, point), (drive, point))


def test_tensioners_are_sorted_parents_first(tmp_path):
    first, second = LEVER.index("[[tensioner]]"), LEVER.rindex("[[tensioner]]")
    end = LEVER.index("[installation]")
    text = LEVER[:first] + LEVER[second:end] + LEVER[first:second] + LEVER[end:]
    drive, point = load(tmp_path, text)
    assert [body.name for body in drive.tensioners] == ["housing", "lever"]
    assert drive.tensioners[1].on.tolist() == [1.0, 0.0]
    assert float(drive.tensioners[1].inertia) == 0.0
    assert_equal((drive, point), load(tmp_path, LEVER))


def test_pulleys_are_sorted_belt_after_belt(tmp_path):
    start, end = TWO_BELTS.index('[[pulley]]\nname = "crank2"'), TWO_BELTS.index("[[tensioner]]")
    first = TWO_BELTS.index("[[pulley]]")
    text = TWO_BELTS[:first] + TWO_BELTS[start:end] + TWO_BELTS[first:start] + TWO_BELTS[end:]
    assert_equal(load(tmp_path, text), load(tmp_path, TWO_BELTS))


def test_senses_of_several_belts_are_found_each(tmp_path):
    drive, _ = load(tmp_path, re.sub(r"(?m)^listed = .*$", "", TWO_BELTS))
    assert drive.sense.tolist() == [-1.0, 1.0]


def test_a_shaft_may_be_named_by_a_word_of_its_own(tmp_path):
    text = swap(TWO_BELTS, 'shaft = "crankshaft"', 'shaft = "front end"')
    text = swap(text, 'name = "crankshaft"', 'name = "crankshaft"\nshaft = "front end"')
    assert_equal(load(tmp_path, text), load(tmp_path, TWO_BELTS))


def test_a_tensioner_carries_the_whole_shaft_of_its_pulley(tmp_path):
    text = swap(TWO_BELTS, 'shaft = "crankshaft"', "")
    text = swap(text, 'name = "crank2"', 'name = "crank2"\nshaft = "alternator"')
    text = swap(text, "center = [0, 0]\nradius = 0.06", "center = [-0.195, 0.29]\nradius = 0.06")
    text = swap(text, "center = [0.1, -0.3]", "center = [-0.4, 0.29]")
    text = swap(text, "center = [0.125, -0.15]", "center = [-0.3, 0.359]")
    text = swap(text, "pivot = [0.19, -0.16]", "pivot = [-0.3, 0.41]")
    text = swap(text, 'pulleys = ["crankshaft", "crank2"]', 'pulley = "crankshaft"')
    text += '\n[[tensioner]]\nname = "third"\npulley = "alternator"\npivot = [-0.27, 0.24]\n'
    text = re.sub(r"(?m)^listed = .*$", "", text + "stiffness = 200\n")
    drive, _ = load(tmp_path, text)
    on = {pulley.name: pulley.on.tolist() for pulley in drive.pulleys}
    assert on["alternator"] == on["crank2"] == [0.0, 0.0, 1.0]


def test_models_and_schemas_are_kept(tmp_path):
    for schema, given, flags in [
        (1, "", (0, 0, 0)),
        (2, "", (1, 1, 1)),
        (1, "[model]\narm_curvature = true", (1, 0, 0)),
        (2, "[model]\nstretching_arcs = false", (1, 0, 1)),
    ]:
        text = swap(THREE, "schema = 1", f"schema = {schema}") + f"\n{given}\n"
        drive, point = load(tmp_path, text)
        model = drive.model
        assert (model.arm_curvature, model.stretching_arcs, model.belt_inertia) == flags
        assert_equal(saved_and_loaded(tmp_path, drive, point), (drive, point))
        assert f"schema = {schema}\n" in (tmp_path / "copy.toml").read_text()


def test_installations_say_where_springs_are_relaxed(tmp_path):
    belt = 'belt_length = 1.4\nfree = {t1 = "20 deg", t2 = -0.1}'
    drive, point = load(tmp_path, swap(TWO_ARMS, "tension = 350.0", belt))
    np.testing.assert_allclose(drive.installation.free, [np.pi / 9, -0.1])
    assert_equal(saved_and_loaded(tmp_path, drive, point), (drive, point))
    # One force for each direction in which springs act: here three springs on two arms.
    spring = '\n[[arm_spring]]\nname = "between"\nbetween = ["t1", "t2"]\nstiffness = "5 N m/rad"\n'
    over = swap(TWO_ARMS, "tension = 350.0", "tension = 350.0\nfree = {between = 0.2}") + spring
    drive, point = load(tmp_path, over)
    np.testing.assert_array_equal(drive.installation.free, [np.nan, np.nan, 0.2])
    assert drive.arm_springs[0].between.tolist() == [-1.0, 1.0]
    assert_equal(saved_and_loaded(tmp_path, drive, point), (drive, point))


def test_a_locked_tensioner_is_adjusted_to_a_tension_or_to_a_mark(tmp_path):
    drive, point = load(tmp_path, ECCENTRIC)
    rule = drive.installation
    assert isinstance(rule, bj.AdjustedToMark)
    assert (rule.adjusted.tolist(), rule.marked.tolist()) == ([1.0, 0.0], [0.0, 1.0])
    assert rule.free.tolist() == [0.0, 0.4055]
    marks = 'free = {"arm" = 0.4055}\nadjust = "eccentric"\nuntil = {"arm" = 0.0}'
    text = swap(ECCENTRIC, marks, 'tension = "300 N"\nadjust = "eccentric"')
    drive, point = load(tmp_path, text)
    assert isinstance(drive.installation, bj.AdjustedToTension)
    assert float(drive.installation.tension) == 300.0
    assert_equal(saved_and_loaded(tmp_path, drive, point), (drive, point))


SPRING = '\n[[arm_spring]]\nname = "s"\nbetween = ["t1", "t2"]\nstiffness = 5\n'
RING = 'shaft = "crankshaft"\nbelt = "second"\ncenter = [0, 0]'
SECOND = '[[pulley]]\nname = "fan"\nbelt = "second"'
BAD = {
    "two of no name": (swap(TWO_ARMS, 'name = "t2"', ""), r"tensioner\[1\]\.name", "name each of several"),
    "name twice": (swap(TWO_ARMS, 'name = "t2"', 'name = "t1"'), r"tensioner\.t1", "used twice"),
    "name with a colon": (swap(TWO_ARMS, 'name = "t2"', 'name = "t:2"'), r"tensioner\.name", "without . : ="),
    "name of a spring": (TWO_ARMS + SPRING.replace('"s"', '"t1"'), r"arm_spring\.t1", "used twice"),
    "pulley on two": (swap(TWO_ARMS, 'pulley = "idler"', 'pulley = "tensioner"'), r"tensioner\.t2\.pulley", "on tensioner 't1' already"),
    "unknown pulley": (swap(TWO_ARMS, 'pulley = "idler"', 'pulley = "idle"'), r"tensioner\.t2\.pulley", "no pulley 'idle'"),
    "no pulley": (swap(TWO_ARMS, 'pulley = "idler"', ""), r"tensioner\.t2\.pulley", r"is missing; .*pulleys = \[\]"),
    "both keys": (swap(TWO_ARMS, 'pulley = "idler"', 'pulley = "idler"\npulleys = []'), r"tensioner\.t2\.pulleys", "beside pulley"),
    "carries nothing": (swap(TWO_ARMS, 'pulley = "idler"', "pulleys = []"), r"tensioner\.t2\.pulleys", "carries no pulley"),
    "the driver": (swap(TWO_ARMS, 'pulley = "idler"', 'pulley = "crankshaft"'), r"tensioner\.t2\.pulley", "driver"),
    "kind": (swap(SLIDE, '"linear"', '"sliding"'), r"tensioner\.slide", 'kind = "rotary" or kind = "linear" or kind = "twin-arm"'),
    "unit of a slide": (swap(SLIDE, "stiffness = 4000", 'stiffness = "4 N m/rad"'), r"slide\.stiffness", "not N/m;"),
    "no direction": (swap(SLIDE, 'direction = "10 deg"', "direction = [0, 0]"), r"slide\.direction", "not both 0"),
    "pivot of a slide": (swap(SLIDE, 'direction = "10 deg"', "pivot = [0, 0]"), r"slide\.pivot", "not a key of this table"),
    "stops": (swap(SLIDE, "mass = 0.25", "stops = [0.1, 0]"), r"slide\.stops", "least, greatest"),
    "key of the several": (THREE.replace("stiffness = 116.4", "stiffness = 116.4\nlocked = true"), r"tensioner\.locked", r"\[\[tensioner\]\]"),
    "circle": (swap(LEVER, "stiffness = 0\n", 'stiffness = 0\non = "lever"\n').replace("inertia = 0.005", "mass = 1\nmass_center = [0, 0]"), r"tensioner\.housing\.on", "in a circle"),
    "on nothing": (swap(LEVER, 'on = "housing"', 'on = "house"'), r"lever\.on", "no tensioner 'house'"),
    "inertia on another": (swap(LEVER, "mass = 0.3", "inertia = 0.3"), r"lever\.inertia", "mass_center and inertia_center"),
    "no mass": (swap(LEVER, "mass = 0.3", ""), r"lever\.mass", "mass_center goes with it"),
    "no mass center": (swap(LEVER, "mass_center = [0.0, 0.235]", ""), r"lever\.mass_center", "mass goes with it"),
    "one arm of a twin": (swap(TWIN, '["right", "left"]', '["right"]'), r"twin\.pulleys", "one on each arm"),
    "inertia of a twin": (swap(TWIN, "[0.0024, 0.0024]", "0.0024"), r"twin\.inertia", r"give a list, as in \[a, b\]"),
    "spring to nothing": (TWO_ARMS + SPRING.replace('"t2"', '"t3"'), r"arm_spring\.s\.between", "no tensioner 't3'"),
    "spring to itself": (TWO_ARMS + SPRING.replace('"t2"', '"t1"'), r"arm_spring\.s\.between", "name two"),
    "unit of a spring": (TWO_ARMS + SPRING.replace("= 5", '= "5 N/m"'), r"arm_spring\.s\.stiffness", "not N m/rad"),
    "spring not settled": (TWO_ARMS + SPRING, r"installation\.free\.s", r"give installation.free = \{s = \.\.\.\}"),
    "free that follows": (swap(TWO_ARMS, "tension = 350.0", "tension = 350.0\nfree = {t1 = 0.1}"), r"installation\.free\.t1", "follows from the tension"),
    "free of nothing": (swap(TWO_ARMS, "tension = 350.0", "belt_length = 1.4\nfree = {t3 = 0.1}"), r"installation\.free\.t3", "no spring 't3'"),
    "free missing": (swap(TWO_ARMS, "tension = 350.0", "belt_length = 1.4\nfree = {t1 = 0.1}"), r"installation\.free", "'t2' is missing"),
    "free angle of two": (swap(TWO_ARMS, "tension = 350.0", "belt_length = 1.4\nfree_angle = 0.1"), r"installation\.free_angle", r"free = \{t1 = \.\.\.\}"),
    "unit of free": (swap(SLIDE, "tension = 350.0", 'belt_length = 1.4\nfree = {slide = "3 deg"}'), r"installation\.free\.slide", "not m;"),
    "adjust nothing": (swap(ECCENTRIC, 'adjust = "eccentric"', 'adjust = "slide"'), r"installation\.adjust", "no tensioner 'slide'"),
    "adjust the unlocked": (swap(ECCENTRIC, "locked = true", "locked = false"), r"installation\.adjust", "is not locked"),
    "adjust without a mark": (swap(ECCENTRIC, 'until = {"arm" = 0.0}', ""), r"installation\.adjust", "neither tension nor until"),
    "mark of the locked": (swap(ECCENTRIC, 'until = {"arm" = 0.0}', "until = {eccentric = 0}"), r"until\.eccentric", "is locked"),
    "two marks": (swap(ECCENTRIC, '{"arm" = 0.0}', "{arm = 0, eccentric = 0}"), r"installation\.until", "give one tensioner"),
    "until alone": (swap(TWO_ARMS, "tension = 350.0", "tension = 350.0\nuntil = {t1 = 0}"), r"installation\.until", "goes with adjust"),
    "housing": (swap(TWO_ARMS, 'name = "alternator"', 'name = "alternator"\nhousing = "arm"'), r"alternator\.housing", "no tensioner carries"),
    "unknown belt": (swap(TWO_BELTS, 'belt = "main"', 'belt = "mane"'), r"pulley\.crankshaft\.belt", "no belt 'mane'; give one of main, second"),
    "no belt": (swap(TWO_BELTS, 'belt = "main"', ""), r"pulley\.crankshaft\.belt", "is missing; give one of main, second"),
    "belts of one name": (swap(TWO_BELTS, 'name = "second"', 'name = "main"'), r"belt\.main", "used twice"),
    "unknown shaft": (swap(TWO_BELTS, 'shaft = "crankshaft"', 'shaft = "crank"'), r"pulley\.crank2\.shaft", "no pulley 'crank'"),
    "apart": (swap(TWO_BELTS, 'shaft = "crankshaft"', ""), r"belt\.second", "shares no shaft"),
    "two centers": (swap(TWO_BELTS, RING, RING.replace("[0, 0]", "[0, 0.001]")), r"pulley\.crank2\.center", "give them one center"),
    "ring of belts": (swap(TWO_BELTS, SECOND, SECOND + '\nshaft = "power steering"').replace("[0.1, -0.3]", "[0.165, 0.335]"), r"pulley\.fan\.shaft", "split of the load"),
    "a tension for two": (swap(TWO_BELTS, '{"main" = 350.0, "second" = 250.0}', "350"), r"installation\.tension", r"give tension = \{main = 350, second = 350\}"),
    "tension of one": (swap(TWO_BELTS, ', "second" = 250.0', ""), r"installation\.tension\.second", "is missing"),
    "tension of none": (swap(TWO_BELTS, '"second" = 250.0', '"third" = 250.0'), r"installation\.tension\.third", "no belt 'third'"),
    "listed": (swap(TWO_BELTS, '"second" = "counterclockwise"', '"second" = "left"'), r"listed\.second", "'counterclockwise' or 'clockwise'"),
    "listed otherwise": (swap(TWO_BELTS, '"second" = "counterclockwise"', '"second" = "clockwise"'), r"listed\.second", "'counterclockwise' gives a path"),
    "torque beside the driver": (swap(TWO_BELTS, '"fan" = 6.0', '"crank2" = 6.0'), r"torque\.crank2", "on the driver's shaft"),
    "isolator of nothing": (swap(ISOLATORS, '[[isolator]]\npulley = "alternator"', '[[isolator]]\npulley = "dynamo"'), r"isolator\[1\]\.pulley", "no pulley 'dynamo'"),
    "two isolators": (swap(ISOLATORS, '[[isolator]]\npulley = "alternator"', '[[isolator]]\npulley = "crankshaft"'), r"isolator\[1\]\.pulley", "has an isolator already"),
    "rim on two shafts": (swap(TWO_BELTS, '["crankshaft", "crank2"]', '["crankshaft", "fan"]'), r"isolator\[0\]\.pulleys", "on two shafts"),
    "law": (swap(ISOLATORS, "stiffness = 35.0", 'stiffness = 35.0\nlaw = "ratchet"'), r"isolator\[1\]\.law", "not modeled yet"),
    "stops alone": (swap(ISOLATORS, "stiffness = 35.0", "stiffness = 35.0\nstops = [0, 1]"), r"isolator\[1\]\.stop_stiffness", "go together"),
    "stiff stops alone": (swap(ISOLATORS, "stiffness = 35.0", "stiffness = 35.0\nstop_stiffness = 9"), r"isolator\[1\]\.stops", "go together"),
    "stops in order": (swap(ISOLATORS, "stiffness = 35.0", "stiffness = 35.0\nstop_stiffness = 9\nstops = [1, 0]"), r"isolator\[1\]\.stops", r"give \[least, greatest\]"),
    "stops of a rigid clutch": (swap(ISOLATORS, "stiffness = 35.0", 'stiffness = 35.0\nstop_stiffness = 9\nstops = [0, 1]\nlaw = "rigid-clutch"'), r"isolator\[1\]\.stops", "a rigid clutch does not; remove them"),
    "friction of what": (swap(SLIDE, 'kind = "linear"', 'kind = "linear"\nfriction_torque = { coulomb = 1, hup = 0.1 }'), r"friction_torque\.hup", "the keys here are coulomb, hub, spring, unwinding"),
    "friction twice": (swap(SLIDE, 'kind = "linear"', 'kind = "linear"\nfriction_torque = { hub = 0.1 }\nfriction_hub = 0.1'), r"friction_torque\.hub", "given as friction_hub, too"),
    "friction below 0": (swap(SLIDE, 'kind = "linear"', 'kind = "linear"\nfriction_torque = { spring = -1 }'), r"friction_spring", "found -1; must"),
    "one way": (swap(ISOLATORS, "stiffness = 35.0", "stiffness = 35.0\none_way = true"), r"isolator\[1\]\.one_way", "not modeled yet"),
    "damper of nothing": (swap(ISOLATORS, '[[damper]]\npulley = "crankshaft"', '[[damper]]\npulley = "crank"'), r"damper\[0\]\.pulley", "no pulley 'crank'"),
    "name of a damper": (ISOLATORS + '\n[[damper]]\nname = "crankshaft"\npulley = "idler"\nstiffness = 1\ninertia = 1\n', r"damper\[1\]\.name", "is used already"),
    "model": (TWO_ARMS + "\n[model]\narm_curvature = 1\n", r"model\.arm_curvature", "give a valid boolean"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_file_is_one_line_that_names_key_and_remedy(case, tmp_path):
    text, key, says = BAD[case]
    with pytest.raises(bj.FileError) as caught:
        load(tmp_path, text)
    message = str(caught.value)
    assert "\n" not in message
    assert re.search(key, caught.value.key), message
    assert re.search(says, message), message


def test_isolators_and_dampers_are_called_like_their_pulleys(tmp_path):
    ring = '\n[[damper]]\npulley = "crankshaft"\nstiffness = 1\ninertia = 1\n'
    drive, point = load(tmp_path, ISOLATORS + ring + ring + 'name = "second ring"\n')
    assert [part.name for part in drive.isolators] == ["crankshaft", "alternator"]
    assert [part.name for part in drive.dampers] == ["crankshaft", "crankshaft 2", "second ring"]
    assert_equal(saved_and_loaded(tmp_path, drive, point), (drive, point))
    # So are those that are built without names.
    parts = [dataclasses.replace(part, name="") for part in drive.dampers]
    named = dataclasses.replace(drive, dampers=parts)
    assert [part.name for part in named.dampers] == ["crankshaft", "crankshaft 2", "crankshaft 3"]


def test_belts_and_shafts_that_form_no_tree_are_refused_when_built():
    def pulley(name, belt, shaft=None):
        driver = name == "a1"
        return bj.Pulley(name, [0, 0], 0.1, belt=belt, shaft=shaft, driver=driver)

    def drive(*shafts):
        belts = [bj.Belt(1e5, 0.01, 0.1, name=name) for name in "abc"]
        pulleys = [
            pulley(f"{name}{k}", name, dict(shafts).get(f"{name}{k}"))
            for name in "abc"
            for k in "123"
        ]
        return bj.Drive(belts, pulleys, bj.TensionGiven([300.0] * 3))

    assert len(drive(("b1", "a1"), ("c1", "b2")).shafts) == 7
    # Two belts that share two shafts leave out the third, though the numbers of shafts agree.
    for shafts in ([("b1", "a1"), ("b2", "a2")], [("b1", "a1")], [("b1", "a1"), ("a2", "a3")]):
        with pytest.raises(ValueError, match="one tree"):
            drive(*shafts)


def test_torque_is_allowed_on_a_carried_pulley(tmp_path):
    _, point = load(tmp_path, swap(TWO_ARMS, '"alternator" = 7', '"alternator" = 7\nidler = 0.5'))
    assert float(point.torque["idler"]) == 0.5
