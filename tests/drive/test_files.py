"""Drive files: exact round trips, units, and one clear line for everything that can be wrong."""

import math
import re

import jax
import pytest
from drives import EXAMPLES, example

import beltjax as bj

THREE = (EXAMPLES / "three_pulley.toml").read_text()
DRIVES = ["three_pulley", "seven_pulley", "two_pulley_table_5_1", "two_pulley_table_5_3"]


def load(tmp_path, text):
    path = tmp_path / "drive.toml"
    path.write_text(text)
    return bj.load_drive(path)


@pytest.mark.parametrize("name", DRIVES)
def test_round_trip_is_exact(name, tmp_path):
    drive, point = example(name)
    bj.save_drive(tmp_path / "copy.toml", drive, point)
    again = bj.load_drive(tmp_path / "copy.toml")
    assert jax.tree.structure(again) == jax.tree.structure((drive, point))
    assert jax.tree.all(jax.tree.map(lambda a, b: bool((a == b).all()), (drive, point), again))
    assert [path.name for path in tmp_path.iterdir()] == ["copy.toml"]


@pytest.mark.parametrize(
    ("old", "new", "read", "value"),
    [
        ("radius = 0.0889", 'radius = "88.9 mm"', lambda d, p: d.pulleys[0].radius, 0.0889),
        ("tension = 300.0", 'tension = "0.3 kN"', lambda d, p: d.installation.tension, 300.0),
        (
            "belt_speed = 20.0",
            'driver_speed = "750 rpm"',
            lambda d, p: p.driver_speed,
            25 * math.pi,
        ),
        (
            "stiffness = 116.4",
            'stiffness = "2 N m/deg"',
            lambda d, p: d.tensioner.stiffness,
            360 / math.pi,
        ),
        ("center = [0.0, 0.0]", 'center = ["1 cm", 0]', lambda d, p: d.pulleys[2].center[0], 0.01),
        (
            "mass_per_length = 0.1029",
            'mass_per_length = "102.9 g/m"',
            lambda d, p: d.belt.mass_per_length,
            0.1029,
        ),
    ],
)
def test_units_in_strings(old, new, read, value, tmp_path):
    text = THREE.replace(old, new, 1)
    assert text != THREE
    assert float(read(*load(tmp_path, text))) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize("name", ["three_pulley", "seven_pulley"])
def test_sense_is_found_where_only_one_is_possible(name, tmp_path):
    text = (EXAMPLES / f"{name}.toml").read_text()
    drive, _ = load(tmp_path, re.sub(r"(?m)^listed = .*$", "", text))
    assert float(drive.sense) == float(example(name)[0].sense)


def swap(old, new):
    assert old in THREE
    return THREE.replace(old, new, 1)


INSTALLATION = THREE[THREE.index("[installation]") : THREE.index("[operation]")]

# What is in the file, the key that the message names, and what it says.
BAD = {
    "unknown key": (swap("radius = 0.0889", "radios = 0.0889"), "pulley.crankshaft.radi", "did you mean 'radius'"),
    "extra key": (swap("[belt]", "[belt]\nlenght = 1"), "belt.lenght", "not a known key"),
    "missing key": (swap("axial_stiffness = 120e3", ""), "belt.axial_stiffness", "is missing"),
    "doubled key": (swap("radius = 0.0889", "radius = 0.0889\nradius = 0.09"), "", "not TOML.*correct that line, 'radius = 0.09.*: the file gives it twice"),
    "not TOML": ("this is not toml", "", "not TOML.*; correct that line, 'this is not toml'"),
    "decimal comma": (swap("radius = 0.0889", "radius = 0,0889"), "", "correct that line, 'radius = 0,0889.*: decimals follow a point, not a comma"),
    "unit without quotes": (swap("radius = 0.0889", "radius = 88.9 mm"), "", "correct that line, 'radius = 88.9 mm.*: a number with its unit stands in quotes"),
    "name without quotes": (swap("[belt]", "[operation.load.A/C]\n[belt]"), "", r"correct that line, '\[operation\.load\.A/C\]': a name with other signs than letters.* stands in quotes"),
    "key without quotes": (swap("accessory = 0.0", "W/P = 0.0"), "", "correct that line, 'W/P = 0.0.*': a name with other signs"),
    "small letters of a unit": (swap("tension = 300.0", 'tension = "0.3 KN"'), "installation.tension", 'whose unit is not N; write "0.3 kN"'),
    "one stop": (swap("stiffness = 116.4", 'stiffness = 116.4\nstops = "60 deg"'), "tensioner.stops", r"found '60 deg'; give a list, as in \[a, b\]"),
    "number of ribs": (swap("[belt]", "[belt]\nribs = 6"), "belt.ribs", "mass_per_length are those of all ribs"),
    "wrong type": (swap("radius = 0.0889", "radius = true"), "pulley.crankshaft.radius", "found True"),
    "wrong unit": (swap("radius = 0.0889", 'radius = "89 kg"'), "pulley.crankshaft.radius", "'89 kg', whose unit is not m"),
    "no unit": (swap("radius = 0.0889", 'radius = "89"'), "pulley.crankshaft.radius", "no unit"),
    "nonsense unit": (swap("radius = 0.0889", 'radius = "9 foo"'), "pulley.crankshaft.radius", "'9 foo', whose unit is not m"),
    "hertz": (swap("belt_speed = 20.0", 'driver_speed = "12 Hz"'), "operation.driver_speed", 'no angle; .* write "720 rpm"'),
    "hertz in disguise": (swap("belt_speed = 20.0", 'driver_speed = "900 /min"'), "operation.driver_speed", 'write "900 rpm"'),
    "angle without unit": (swap("stiffness = 116.4", 'stiffness = 116.4\nstops = ["30", "60 deg"]'), "tensioner.stops", "no unit"),
    "stacked powers": (swap("radius = 0.0889", 'radius = "9**9**9 m"'), "pulley.crankshaft.radius", "not a number with a unit"),
    "huge integer": (swap("radius = 0.0889", "radius = " + "9" * 400), r"pulley\[0\]\.radius", "more than 30 digits"),
    "too long an integer": (swap("radius = 0.0889", "radius = " + "9" * 5000), "", "not TOML"),
    "too deep": (swap("radius = 0.0889", "radius = " + "[" * 5000), "", "nested too deep"),
    "out of proportion": (swap("center = [0.0, 0.0]", "center = [-1e200, 0.3]"), "pulley", "out of all proportion"),
    "millimeters": (swap("radius = 0.0889", "radius = 88.9"), "pulley.crankshaft.radius", 'bare number is in meters, millimeters are written "88.9 mm", .* "88.9 m"'),
    "a study": ('drive = "three_pulley.toml"\nobjective.minimize = "coupling"', "drive", "is the key of a study"),
    "not finite": (swap("tension = 300.0", "tension = inf"), "installation.tension", "not finite"),
    "nan": (swap("tension = 300.0", "tension = nan"), "installation.tension", "not finite"),
    "negative radius": (swap("radius = 0.0452", "radius = -0.0452"), "pulley.tensioner.radius", "greater than 0"),
    "no stiffness": (swap("stiffness = 116.4", "stiffness = 0.0"), "tensioner.stiffness", "greater than 0"),
    "no mass": (swap("mass_per_length = 0.1029", "mass_per_length = 0"), "belt.mass_per_length", "greater than 0"),
    "wrong face": (swap('"back"', '"smooth"'), "pulley.tensioner.face", "'grooved' or 'back'"),
    "center of one number": (swap("center = [0.0, 0.0]", "center = [0.0]"), "pulley.accessory.center", "found 1 items; give 2"),
    "one pulley": (THREE[: THREE.index("[[pulley]]")] + '[[pulley]]\nname = "a"\ncenter = [0, 0]\nradius = 0.1\nface = "grooved"\ndriver = true\n' + INSTALLATION + "[operation]\nbelt_speed = 1", "pulley", "at least two"),
    "no driver": (swap("driver = true", ""), "pulley.driver", "found none"),
    "two drivers": (swap("radius = 0.02697", "radius = 0.02697\ndriver = true"), "pulley.driver", "crankshaft, accessory"),
    "names repeat": (swap('name = "accessory"', 'name = "crankshaft"'), "pulley.crankshaft", "used twice"),
    "name with a dot": (swap('name = "accessory"', 'name = "a.c"'), "pulley", "without . : ="),
    "tensioner unknown": (swap('pulley = "tensioner"', 'pulley = "tensoner"'), "tensioner.pulley", "no pulley 'tensoner'"),
    "tensioner is the driver": (swap('pulley = "tensioner"', 'pulley = "crankshaft"'), "tensioner.pulley", "driver"),
    "torque unknown": (swap("accessory = 0.0", "alternator = 2.0"), "operation.torque.alternator", "no pulley"),
    "torque on the driver": (swap("accessory = 0.0", "crankshaft = 2.0"), "operation.torque.crankshaft", "balances"),
    "overlap": (swap("center = [0.0, 0.0]", "center = [0.3, 0.05]"), "pulley.accessory.center|pulley.tensioner.center", "overlaps"),
    "no tangent": (swap("radius = 0.0452", "radius = 0.15\nrim_radius = 0.02"), "pulley.", "no tangent"),
    "does not touch": (swap("center = [0.3477, 0.05715]", "center = [0.3477, 0.2]"), "pulley.tensioner.center", "does not touch"),
    "crosses itself": (swap('listed = "counterclockwise"', 'listed = "clockwise"'), "listed", "found 'clockwise', in which .*; 'counterclockwise' gives a path"),
    "pivot on the pulley": (swap("pivot = [0.2508, 0.0635]", "pivot = [0.3477, 0.05715]"), "tensioner.pivot", "arm"),
    "both rules": (swap("tension = 300.0", "tension = 300.0\nbelt_length = 1.5"), "installation", "both"),
    "neither rule": (swap("tension = 300.0", ""), "installation", "neither"),
    "no free angle": (THREE.replace(INSTALLATION, "[installation]\nbelt_length = 1.51\n"), "installation.free_angle", "missing"),
    "free angle with tension": (swap("tension = 300.0", "tension = 300.0\nfree_angle = 0.1"), "installation.free_angle", "belt_length"),
    "span tensions": (swap("tension = 300.0", "tension = 300.0\nspan_tensions = [300, 300]"), "installation.span_tensions", "one for each span"),
    "no speed": (swap("belt_speed = 20.0", ""), "operation", "neither"),
    "two speeds": (swap("belt_speed = 20.0", "belt_speed = 20.0\ndriver_speed = 5"), "operation", "both"),
    "mass flow": (swap("belt_speed = 20.0", "belt_speed = 20.0\nmass_flow = 1"), "operation.mass_flow", "driver_speed"),
    "stops": (swap("stiffness = 116.4", "stiffness = 116.4\nstops = [1, 0]"), "tensioner.stops", "least, greatest"),
    "schema": (swap("schema = 1", "schema = 7"), "schema", "give 1"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_file_is_one_line_that_names_file_key_and_remedy(case, tmp_path):
    text, key, says = BAD[case]
    with pytest.raises(bj.FileError) as caught:
        load(tmp_path, text)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(f"{tmp_path / 'drive.toml'}: ")
    assert re.search(key, caught.value.key)
    assert re.search(says, message), message


def square(*extra):
    """A file of four pulleys on the corners of a square, and more behind the first."""
    corners = [("a", 0, 0, "grooved"), *extra, ("b", 1, 0, "grooved"), ("c", 1, 1, "grooved")]
    lines = ["[installation]\ntension = 300\n[operation]\nbelt_speed = 5\n[belt]"]
    lines += ["axial_stiffness = 1e5\nbending_stiffness = 0.01\nmass_per_length = 0.1"]
    for name, x, y, face in [*corners, ("d", 0, 1, "grooved")]:
        driver = "driver = true" if name == "a" else ""
        lines.append(
            f'[[pulley]]\nname = "{name}"\ncenter = [{x}, {y}]\nradius = 0.1\nface = "{face}"\n{driver}'
        )
    return "\n".join(lines)


def test_span_that_runs_through_a_pulley_is_named(tmp_path):
    load(tmp_path, square(("e", 0.5, 0.2, "back")))
    with pytest.raises(bj.FileError, match=r"pulley\.e\.center: span c-d runs through this pulley"):
        load(tmp_path, square(("e", 0.5, 1.04, "back")))


def test_spans_that_cross_are_named_in_the_reading_that_comes_closest(tmp_path):
    with pytest.raises(bj.FileError, match=r"crosses itself: spans a-e and c-d"):
        load(tmp_path, square(("e", 0.5, 1.4, "back")))


def two_and_an_idler(x, y, radius, face):
    """Two pulleys 400 mm apart and an idler, in a file that does not say the sense of its list."""
    lines = ["[installation]\ntension = 300\n[operation]\nbelt_speed = 5\n[belt]"]
    lines += ["axial_stiffness = 1e5\nbending_stiffness = 0.01\nmass_per_length = 0.1"]
    pulleys = ("a", 0, 0, 50, "grooved"), ("b", 400, 0, 50, "grooved"), ("i", x, y, radius, face)
    for name, across, up, size, side in pulleys:
        driver = "driver = true" if name == "a" else ""
        lines.append(
            f'[[pulley]]\nname = "{name}"\ncenter = ["{across} mm", "{up} mm"]\n'
            f'radius = "{size} mm"\nface = "{side}"\n{driver}'
        )
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("idler", "missed"),
    [
        ((200, 81, 30, "back"), "1 mm"),
        ((200, 19, 30, "grooved"), "1 mm"),
        ((200, 92.5, 30, "back"), "12.5 mm"),
    ],
)
def test_idler_that_misses_the_belt_is_named_with_its_gap(idler, missed, tmp_path):
    # The strand runs along y = 50 mm.
    says = rf"pulley\.i\.center: the belt does not touch this pulley \(it misses it by {missed}, wrap -"
    with pytest.raises(bj.FileError, match=says):
        load(tmp_path, two_and_an_idler(*idler))
    x, y, radius, face = idler
    inwards = -1 if face == "back" else 1
    drive, _ = load(tmp_path, two_and_an_idler(x, y + inwards * 15, radius, face))
    assert float(drive.sense) == 1.0


def test_large_drives_are_read_and_a_bare_millimeter_is_not(tmp_path):
    conveyor = two_and_an_idler(200, 70, 30, "back").replace('"400 mm"', '"400 m"')
    conveyor = conveyor.replace('"200 mm"', '"200 m"')
    drive, _ = load(tmp_path, conveyor)
    assert float(drive.pulleys[1].center[0]) == 400.0
    # A wheel of 12 m is written with its unit, by `save_drive` too.
    big = THREE.replace("[0.0, 0.0]", "[-13.0, 0.0]").replace("radius = 0.02697", 'radius = "12 m"')
    drive, point = load(tmp_path, big)
    bj.save_drive(tmp_path / "copy.toml", drive, point)
    again, _ = bj.load_drive(tmp_path / "copy.toml")
    assert float(again.pulleys[2].radius) == 12.0
    with pytest.raises(bj.FileError, match=r"center: is out of all proportion, 4e\+07 m"):
        load(tmp_path, two_and_an_idler(200, 70, 30, "back").replace('"400 mm"', "4e7"))


def test_pulleys_are_bounded(tmp_path):
    row = '[[pulley]]\nname = "p{0}"\ncenter = [{0}, 0]\nradius = 0.1\nface = "grooved"\n'
    many = "".join(row.format(i) for i in range(201))
    text = THREE[: THREE.index("[[pulley]]")] + many + INSTALLATION + "[operation]\nbelt_speed = 1"
    with pytest.raises(bj.FileError, match="pulley: found 201; a drive file has 200 at most"):
        load(tmp_path, text)


def test_missing_file_is_named(tmp_path):
    with pytest.raises(bj.FileError, match=r"nowhere\.toml: cannot be read"):
        bj.load_drive(tmp_path / "nowhere.toml")


def test_two_pulleys_are_counterclockwise(tmp_path):
    text = re.sub(r"(?m)^listed = .*$", "", (EXAMPLES / "two_pulley_table_5_1.toml").read_text())
    drive, _ = load(tmp_path, text)
    assert float(drive.sense) == 1.0


def test_both_senses_possible_asks_for_one(tmp_path):
    # A back-side idler midway between two equal pulleys may press on either strand.
    middle = re.sub(r'"tensioner"\ncenter = .*', '"tensioner"\ncenter = [0.3, 0]', THREE)
    text = re.sub(r"(?m)^listed = .*$", "", middle)
    text = text.replace("[0.5525, 0.0556]", "[0.6, 0.0]").replace("0.02697", "0.0889")
    with pytest.raises(bj.FileError, match=r"listed: both senses .*; say 'counterclockwise'"):
        load(tmp_path, text)
    for sense in ("counterclockwise", "clockwise"):
        load(tmp_path, f'listed = "{sense}"\n' + text)


def test_single_precision_is_refused():
    jax.config.update("jax_enable_x64", False)
    try:
        with pytest.raises(RuntimeError, match="jax_enable_x64"):
            example("three_pulley")
        with pytest.raises(RuntimeError, match="jax_enable_x64"):
            bj.Belt(1.0, 1.0, 1.0)
    finally:
        jax.config.update("jax_enable_x64", True)


def test_wrong_structures_are_refused_when_built():
    wheel = bj.Pulley("a", [0, 0], 0.1, driver=True)
    belt, rule = bj.Belt(1e5, 0.01, 0.1), bj.TensionGiven(300.0)
    with pytest.raises(ValueError, match="at least two"):
        bj.Drive(belt, (wheel,), rule)
    with pytest.raises(ValueError, match="repeat"):
        bj.Drive(belt, (wheel, wheel), rule)
    with pytest.raises(ValueError, match="exactly one pulley drives"):
        bj.Drive(belt, (wheel, bj.Pulley("b", [1, 0], 0.1, driver=True)), rule)
    with pytest.raises(ValueError, match="on, a flag for each tensioner"):
        bj.Drive(belt, (wheel, bj.Pulley("b", [1, 0], 0.1, on=[1.0])), rule)
    with pytest.raises(ValueError, match="center"):
        bj.Pulley("a", [0, 0, 0], 0.1)
    with pytest.raises(ValueError, match="face"):
        bj.Pulley("a", [0, 0], 0.1, face=0.5)
    with pytest.raises(ValueError, match="belt_speed or driver_speed"):
        bj.OperatingPoint()
