"""`beltjax layout`: a file that has geometry alone, against what a ruler and a hand find."""

import csv
import json
import math
import re
import tomllib

import numpy as np
import pytest
import tomli_w
from drives import EXAMPLES

OPEN = """
name = "open belt"
[[pulley]]
name = "motor"
center = [0, 0]
radius = "50 mm"
face = "grooved"
driver = true
[[pulley]]
name = "fan"
center = ["400 mm", 0]
radius = "125 mm"
face = "grooved"
"""


def document(run, tmp_path, text, *options):
    (tmp_path / "sheet.toml").write_text(text)
    status, out, err = run("layout", "sheet.toml", "--json", "out.json", *options)
    assert (status, err) == (0, "")
    return json.loads((tmp_path / "out.json").read_text()), out


def test_two_pulleys_are_those_of_the_handbook(run, tmp_path):
    """The open belt's length, 2 c cos(a) + pi (R + r) + 2 a (R - r) with sin(a) = (R - r)/c."""
    found, out = document(run, tmp_path, OPEN, "--figure", "sheet.png")
    r, R, c = 0.05, 0.125, 0.4
    a = math.asin((R - r) / c)
    length = 2 * c * math.cos(a) + math.pi * (R + r) + 2 * a * (R - r)
    assert found["belts"][0]["path_length"] == pytest.approx(length, rel=1e-12)
    wraps = [pulley["wrap_deg"] for pulley in found["pulleys"]]
    assert wraps == pytest.approx([180 - math.degrees(2 * a), 180 + math.degrees(2 * a)], rel=1e-12)
    assert [pulley["speed_ratio"] for pulley in found["pulleys"]] == pytest.approx([1.0, 0.4])
    assert found["pulleys"][0]["speed"] is None
    assert found["clearances"] == [{"between": ["motor", "fan"], "gap": pytest.approx(0.225)}]
    assert re.search(rf"whole path +{1e3 * length:.2f}", out)
    assert (tmp_path / "sheet.png").read_bytes()[:4] == b"\x89PNG"


def test_a_path_along_the_effective_line_is_that_of_the_grooves_diameters(run, tmp_path):
    """A belt whose pulleys have the effective diameters as pitch diameters is as long as that."""
    plain, out = document(run, tmp_path, OPEN)
    assert plain["belts"][0]["effective_length"] is None
    assert "effective" not in out
    printed = OPEN.replace('radius = "50 mm"', 'effective_diameter = "100 mm"')
    printed = printed.replace('radius = "125 mm"', 'effective_diameter = "250 mm"')
    printed = '[belt]\npitch_offset = "1.5 mm"\n' + printed.replace('name = "open belt"', "")
    found, out = document(run, tmp_path, printed)
    effective, path = plain["belts"][0]["path_length"], found["belts"][0]["path_length"]
    assert found["belts"][0]["effective_length"] == pytest.approx(effective, rel=1e-12)
    assert path > effective + 0.009
    assert re.search(rf"along the effective line +{1e3 * effective:.2f}", out)


def test_a_speed_is_shown_where_there_is_one(run, tmp_path):
    found, out = document(run, tmp_path, OPEN + '[operation]\ndriver_speed = "1500 rpm"\n')
    assert found["pulleys"][1]["speed"] == pytest.approx(600 * math.pi / 30)
    assert found["belts"][0]["speed"] == pytest.approx(0.05 * 50 * math.pi)
    assert re.search(r"fan +.* 0\.4000 +600\.0", out)


def test_moving_the_arm_takes_the_path_along(run, tmp_path):
    """Differences of the path's length, the pulley turned about the pivot by hand."""
    drive = tomllib.loads((EXAMPLES / "three_pulley.toml").read_text())
    pivot = np.array(drive["tensioner"]["pivot"])
    carried = next(p for p in drive["pulley"] if p["name"] == drive["tensioner"]["pulley"])
    arm = np.array(carried["center"]) - pivot
    tensioner, lengths = None, {}
    for turn in (-1e-5, 0.0, 1e-5):
        cos, sin = math.cos(turn), math.sin(turn)
        turned = np.array([[cos, -sin], [sin, cos]]) @ arm
        carried["center"] = (pivot + turned).tolist()
        found, _ = document(run, tmp_path, tomli_w.dumps(drive))
        lengths[turn] = found["belts"][0]["path_length"]
        if not turn:
            tensioner = found["tensioners"][0]
    assert tensioner is not None
    assert tensioner["arm_length"] == pytest.approx(math.hypot(*arm), rel=1e-12)
    slope = (lengths[1e-5] - lengths[-1e-5]) / 2e-5
    assert tensioner["path_per_move"] == pytest.approx(slope, rel=1e-7)


# Two pulleys and an idler on a slide that presses the belt in from above; its maker's lengths.
PRESSED = """
listed = "counterclockwise"
[belt]
pitch_offset = "1.5 mm"
back_offset = "1.5 mm"
standard_lengths = { effective = ["1250 mm", "1280 mm"] }
[[pulley]]
name = "motor"
center = [0, 0]
effective_diameter = "160 mm"
face = "grooved"
driver = true
[[pulley]]
name = "fan"
center = ["400 mm", 0]
effective_diameter = "160 mm"
face = "grooved"
[[pulley]]
name = "idler"
center = ["200 mm", "100 mm"]
smooth_diameter = "60 mm"
face = "back"
[[tensioner]]
name = "slide"
kind = "linear"
pulley = "idler"
direction = "90 deg"
[installation]
belt_length = { effective = "1320 mm" }
"""


def pressed_path(y):
    """Path round pulleys of 160 mm, 400 mm apart, and the idler pressed in to a height y [m]."""
    r, s = 0.0815, 0.0315
    apart, between = math.hypot(0.2, y), math.atan2(y, 0.2)
    lean = math.asin((r + s) / apart)  # of the crossed tangents between pulley and idler
    down = lean - between
    side = math.sqrt(apart**2 - (r + s) ** 2)
    return 0.4 + 2 * math.pi * r + 2 * side + 2 * (r + s) * down


def test_the_files_own_belt_is_fitted_in_its_makers_measure(run, tmp_path):
    """Where the path round the idler is the length, by hand; a belt too long for any is said so."""
    found, out = document(run, tmp_path, PRESSED)
    excess = 2 * math.pi * 0.0015
    (given,), (shorter,) = found["given_belts"], found["standard_belts"]
    assert given["effective_length"] == pytest.approx(1.320, rel=1e-12)
    assert given["length"] == pytest.approx(1.320 + excess, rel=1e-12)
    path = found["belts"][0]["path_length"]
    assert path == pytest.approx(pressed_path(0.1), rel=1e-12)
    assert given["less_path"] == pytest.approx(1.320 + excess - path, rel=1e-9)
    (fit,) = given["fits"]
    assert pressed_path(0.1 + fit["coordinate"]) == pytest.approx(1.320 + excess, rel=1e-10)
    assert (given["reason"], shorter["fits"]) == ("", [])
    assert shorter["effective_length"] == pytest.approx(1.280, rel=1e-12)
    assert re.search(r"belt +effective length \(mm\) +less the path \(mm\)", out)
    assert re.search(r"belt +1320\.00 +16\.49 +- +slide +-44\.8\d mm", out)
    assert re.search(r"belt +1280\.00 +-23\.51 .* as slide is moved, the belt does not touch", out)
    # The same belt by its other length, which then is the one shown.
    plain, out = document(run, tmp_path, PRESSED.replace('effective = "1320', 'pitch = "1329.42'))
    assert plain["given_belts"][0]["length"] == pytest.approx(given["length"], abs=1e-5)


def test_belts_of_several_loops_are_fitted_each(run, tmp_path):
    """Bare pulleys on fixed centers: nothing makes room, and what is missing is said."""
    text = (EXAMPLES / "combine_two_belts.toml").read_text()
    given = '[installation.belt_length]\nmain = "3.42 m"\ndrum = "2.9 m"\n'
    changed = re.sub(r"\[installation\.tension\](?s:.*?)\n\n", given + "\n", text)
    found, _ = document(run, tmp_path, changed)
    paths = {belt["name"]: belt["path_length"] for belt in found["belts"]}
    for belt, length in zip(found["given_belts"], (3.42, 2.9), strict=True):
        assert belt["less_path"] == pytest.approx(length - paths[belt["belt"]], rel=1e-12)
        assert (belt["fits"], belt["reason"]) == ([], "no pulley can move")
    without = re.sub(r"\[installation\.tension\](?s:.*?)\n\n", "", text)
    assert document(run, tmp_path, without)[0]["given_belts"] == []


def test_what_a_body_cannot_reach_is_said(run, tmp_path):
    """An arm whose pulley goes round in a circle makes the path no longer than it is on top."""
    arm = 'kind = "rotary"\npulley = "idler"\npivot = ["200 mm", "115 mm"]'
    turning = re.sub(r'kind = "linear"(?s:.*?)90 deg"', arm, PRESSED)
    found, out = document(run, tmp_path, turning.replace('"1320 mm"', '"1400 mm"'))
    assert found["given_belts"][0]["reason"] == "no place of slide makes the path so long"
    assert "no place of slide makes the path so long" in out


def test_tables_are_written_as_comma_separated_values(run, tmp_path):
    found, out = document(run, tmp_path, OPEN.replace("fan", "fan [left], low"), "--csv", "out.csv")
    assert "wrote out.json, out.csv" in out
    rows = list(csv.reader((tmp_path / "out.csv").open()))
    blank = rows.index([])
    title, heads, *pulleys = rows[:blank]
    assert title == ["open belt"]
    assert heads == ["pulley", "wrap (deg)", "arc (mm)", "speed ratio", "speed (rpm)"]
    assert [row[0] for row in pulleys] == ["motor", "fan [left], low"]
    for row, pulley in zip(pulleys, found["pulleys"], strict=True):
        assert float(row[1]) == pytest.approx(pulley["wrap_deg"], abs=0.005)
        assert float(row[2]) == pytest.approx(1e3 * pulley["arc_length"], abs=0.005)
    assert rows[blank + 1] == ["span", "length (mm)"]


def test_no_output_is_written_over_another(run, tmp_path):
    (tmp_path / "sheet.toml").write_text(OPEN)
    for csv_path, says in [("out.json", "given for two outputs"), ("sheet.toml", "is read")]:
        status, _, err = run("layout", "sheet.toml", "--json", "out.json", "--csv", csv_path)
        assert status == 1
        assert says in err
    assert (tmp_path / "sheet.toml").read_text() == OPEN
    assert not (tmp_path / "out.json").exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('face = "grooved"', 'face = "groved"'), r"pulley\.motor\.face: found 'groved'"),
        (('radius = "125 mm"', 'radius = "400 mm"'), r"overlaps pulley 'motor' by 50 mm"),
        (("[[pulley]]", '[belt]\nthicknes = "5 mm"\n[[pulley]]'), r"did you mean 'thickness'"),
    ],
    ids=["face", "overlap", "typo"],
)
def test_what_is_there_must_be_right(run, tmp_path, change, message):
    (tmp_path / "sheet.toml").write_text(OPEN.replace(*change, 1))
    status, out, err = run("layout", "sheet.toml", "--json", "out.json")
    assert (status, out) == (1, "")
    assert err.count("\n") == 1
    assert re.search(message, err)
    assert not (tmp_path / "out.json").exists()
