"""The command line as a user meets it: tables, JSON, exit status, one line for an error."""

import errno
import json
import math
import re
import subprocess
import sys

import numpy as np
import pytest
from drives import EXAMPLES

from beltjax.commands.reports.documents import json_bytes
from beltjax.files import writing

THREE = (EXAMPLES / "three_pulley.toml").read_text()
STUDY = (EXAMPLES / "three_pulley_study.toml").read_text()


def one_line(text):
    return text.count("\n") == 1 and "Traceback" not in text


def test_analyze_prints_a_table_and_writes_the_fixed_keys(run, tmp_path):
    files = "--json", "out.json", "--figure", "modes.png"
    status, out, err = run("analyze", EXAMPLES / "three_pulley.toml", *files)
    assert (status, err) == (0, "")
    assert (tmp_path / "modes.png").read_bytes().startswith(b"\x89PNG")
    assert "crankshaft-tensioner" in out
    assert "coupling Gamma" in out
    document = json.loads((tmp_path / "out.json").read_text())
    assert document["layout"]["spans"][0]["name"] == "crankshaft-tensioner"
    np.testing.assert_allclose(
        document["layout"]["alignment_angles_deg"], [135.782, 178.735], atol=1e-3
    )
    assert document["reference"]["tensioner_effectiveness"] == pytest.approx(0.78554, abs=5e-6)
    assert document["groups"]["stretch"] == 400.0
    assert document["steady"]["coupling_total"] == pytest.approx(
        sum(document["steady"]["coupling"])
    )
    slopes = document["sensitivities"]["coupling_total"]
    expected = {"belt.bending_stiffness", "pulley.tensioner.radius", "pulley.crankshaft.center"}
    expected |= {"tensioner.pivot", "installation.tension", "operation.belt_speed"}
    expected |= {"operation.torque.accessory", "pulley.accessory.inertia", "tensioner.stiffness"}
    assert expected <= set(slopes)
    assert len(slopes["tensioner.pivot"]) == 2
    assert slopes["pulley.accessory.inertia"] == 0.0


def test_json_to_standard_output_is_all_there_is_on_it(run):
    status, out, _ = run("analyze", EXAMPLES / "two_pulley_table_5_1.toml", "--json", "-")
    assert status == 0
    document = json.loads(out)
    assert document["layout"]["alignment_angles_deg"] is None
    assert document["reference"]["tensioner_effectiveness"] is None
    assert document["reference"]["arm_angle"] is None
    assert document["steady"]["arm_rotation"] is None


def test_bad_file_writes_nothing(run, tmp_path):
    bad = tmp_path / "bad.toml"
    bad.write_text(THREE.replace("radius = 0.0452", 'radius = "45 kg"'))
    status, out, err = run("analyze", bad, "--json", "out.json")
    assert (status, out) == (1, "")
    assert one_line(err)
    assert re.search(r"bad\.toml: pulley\.tensioner\.radius: found '45 kg'", err)
    assert not (tmp_path / "out.json").exists()


def test_belt_that_does_not_fit_is_a_bad_file(run, tmp_path):
    rule = "[installation]\nbelt_length = 1.2\nfree_angle = -0.23"
    bad = tmp_path / "short.toml"
    bad.write_text(THREE.replace("[installation]", rule).replace("tension = 300.0", ""))
    status, out, err = run("analyze", bad, "--json", "out.json")
    assert (status, out) == (1, "")
    assert one_line(err)
    assert re.search(
        r"installation\.belt_length: found 1\.2000 m, too short: .* change belt_length", err
    )
    assert not (tmp_path / "out.json").exists()


@pytest.mark.slow
def test_a_length_is_refused_as_it_was_typed(run, tmp_path):
    """An effective length in mm; the path's ends less 2 pi offsets are what `layout` finds."""
    text = (EXAMPLES / "six_pulley_accessory.toml").read_text()
    rule = '[installation]\nbelt_length = { effective = "1431 mm" }\nfree_angle = 0.3\n[operation]'
    text = re.sub(r"preload = .*", "", text).replace("[operation]", rule)
    (tmp_path / "short.toml").write_text(text)
    status, _, err = run("analyze", "short.toml")
    assert status == 1
    assert one_line(err)
    assert "belt_length: found 1431.0 mm, too short: the path takes 16" in err
    assert "mm along the effective line; change belt_length" in err


@pytest.mark.slow
def test_of_several_belts_the_one_that_does_not_fit_is_named(run, tmp_path):
    """On fixed centers: one belt stretched by half a percent, the other too long by 2 mm."""
    text = (EXAMPLES / "combine_two_belts.toml").read_text()
    rule = '[installation.belt_length]\nmain = "3430 mm"\ndrum = "2880 mm"\n\n'
    text = re.sub(r"\[installation\.tension\](?s:.*?)\n\n", rule, text)
    (tmp_path / "long.toml").write_text(text)
    status, _, err = run("analyze", "long.toml")
    assert status == 1
    assert one_line(err)
    assert "belt_length.main: found 3430.0 mm, too long: the path takes 3428.2 mm along" in err


GIVEN_BELT = "belt_length = 1.508\nfree_angle = -0.23"


@pytest.mark.parametrize(
    ("rule", "says"),
    [
        ("tension = 300.0", "raise installation.tension, or lower the torques"),
        (
            GIVEN_BELT,
            "shorten installation.belt_length, or turn installation.free_angle further in",
        ),
    ],
    ids=["tension", "belt"],
)
def test_more_tension_is_advised_by_the_key_that_the_file_gives(run, tmp_path, rule, says):
    text = THREE.replace("tension = 300.0", rule).replace("accessory = 0.0", "accessory = -20.0")
    (tmp_path / "slack.toml").write_text(text)
    status, _, err = run("analyze", "slack.toml")
    assert status == 2
    assert one_line(err)
    assert says in err
    assert ("installation.tension" in err) == ("tension" in rule.split()[0])


def test_stops_that_leave_out_the_drawn_arm_are_told(run, tmp_path):
    """The drawn arm is at -3.749 deg, and [tensioner] counts directions."""
    rule = "[installation]\nbelt_length = 1.51\nfree_angle = -0.23"
    text = THREE.replace("[installation]", rule).replace("tension = 300.0", "")
    text = text.replace("stiffness = 116.4", 'stiffness = 116.4\nstops = ["20 deg", "50 deg"]')
    (tmp_path / "stops.toml").write_text(text)
    status, _, err = run("analyze", "stops.toml")
    assert status == 1
    assert one_line(err)
    assert "along the neutral axis; change belt_length or what its springs have" in err
    assert "the stops of tensioner leave out the drawn position" in err


def test_free_angle_that_is_a_turn_off_is_led_on(run, tmp_path):
    # The belt and the free angle of the drive as drawn, the angle told in (0, 360] degrees.
    rule = '[installation]\nbelt_length = 1.5103162923712807\nfree_angle = "346.5667431779692 deg"'
    (tmp_path / "turn.toml").write_text(
        THREE.replace("[installation]", rule).replace("tension = 300.0", "")
    )
    status, _, err = run("analyze", "turn.toml")
    assert status == 1
    assert one_line(err)
    assert "installation.free_angle: found 346.567 deg" in err
    assert "from the drawn arm at -3.74932 deg; -13.4333 deg, one turn away, fits" in err


@pytest.mark.slow
def test_belt_that_is_hardly_too_long_is_told_by_digits_and_sent_to_contact(run, tmp_path):
    (tmp_path / "long.toml").write_text(SLACK_STRING)
    status, _, err = run("analyze", "long.toml")
    assert status == 1
    assert one_line(err)
    assert (
        "found 0.23202 m, too long: the path takes 0.23200 m along the neutral axis; change belt_length"
        in err
    )
    assert "`beltjax contact` tells whether a stiff belt is tight" in err


@pytest.mark.slow
def test_stiff_belt_that_is_slack_as_a_string_is_tight_in_contact(run, tmp_path):
    (tmp_path / "long.toml").write_text(SLACK_STRING)
    given = "tension = 10.14255222"
    (tmp_path / "tight.toml").write_text(SLACK_STRING.replace("belt_length = 0.23202", given))
    found = []
    for name in ("long.toml", "tight.toml"):
        status, out, _ = run("contact", name, "--json", "-")
        assert status == 0
        found.append(json.loads(out))
    # One belt, found from its length and from its tension.
    assert found[0]["spans"][0]["tension_mid"] == pytest.approx(10.14255222, rel=1e-6)
    assert found[1]["unstretched_length"] == pytest.approx(0.23202, rel=1e-8)
    assert found[0]["string_tension"] < 0


SLACK_STRING = """
[belt]
axial_stiffness = "6 kN"
bending_stiffness = 1e-4
mass_per_length = 0.02
[[pulley]]
name = "a"
center = [0, 0]
radius = "5.093 mm"
face = "grooved"
driver = true
[[pulley]]
name = "b"
center = ["100 mm", 0]
radius = "5.093 mm"
face = "grooved"
[installation]
belt_length = 0.23202
[operation]
belt_speed = 0
"""


def test_arm_turned_by_torque_is_shown_and_no_arm_is_not(run, tmp_path):
    (tmp_path / "loaded.toml").write_text(THREE.replace("accessory = 0.0", "accessory = 6.0"))
    status, out, _ = run("analyze", "loaded.toml", "--json", "loaded.json")
    assert status == 0
    turn = json.loads((tmp_path / "loaded.json").read_text())["reference"]["arm_turn"]
    # By hand: the drawn arm is at -3.749 deg.
    angle = json.loads((tmp_path / "loaded.json").read_text())["reference"]["arm_angle"]
    assert turn == pytest.approx(angle + math.atan2(0.00635, 0.0969), rel=1e-9)
    shown = f"{math.degrees(turn):.4f}"
    assert re.search(rf"arm's turn, drawn to rest +{shown} +deg", out)
    _, out, _ = run("analyze", "loaded.toml", "--si")
    assert re.search(rf"arm's turn, drawn to rest +{turn:.6f} +rad", out)
    _, out, _ = run("analyze", EXAMPLES / "two_pulley_table_5_1.toml")
    assert "coupling Gamma" in out
    assert "arm" not in out
    assert "tensioner" not in out


def test_nothing_moves_the_gamma_of_a_string(run, tmp_path):
    (tmp_path / "string.toml").write_text(
        re.sub(r"bending_stiffness = \S+", "bending_stiffness = 0", THREE)
    )
    status, out, _ = run("analyze", "string.toml")
    assert status == 0
    assert "What moves Gamma" not in out
    assert "Nothing moves Gamma: the spans of a belt without bending stiffness are straight" in out


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        # Beyond the string's critical speed (s = 2.35) there is no tight state.
        ("bending_stiffness = 0.015      # EI [N m^2]: eps = 0.0202", "bending_stiffness = 0", r"belt_speed: span .* goes slack at .* 140 m/s: lower"),
        # A stiff belt holds on, at tensions that no belt bears.
        ("belt_speed = 20.0", "belt_speed = 900.0", r"belt_speed: The running belt would be stretched"),
        ("accessory = 0.0", "accessory = -40.0", r"operation\.torque: span accessory-crankshaft is slack at rest \(-961\.7 N\) .* or is operation\.travel = 'opposite' meant\?"),
    ],
)  # fmt: skip
def test_drive_that_cannot_run_is_an_answer(run, tmp_path, old, new, says):
    assert old in THREE
    text = THREE.replace(old, new)
    if "bending_stiffness = 0" in new:
        text = text.replace("belt_speed = 20.0", "belt_speed = 140.0")
    (tmp_path / "fast.toml").write_text(text)
    status, _, err = run("analyze", "fast.toml", "--json", "out.json")
    assert status == 2
    assert one_line(err)
    assert re.search("fast.toml: .*" + says, err), err
    document = json.loads((tmp_path / "out.json").read_text())
    assert document["success"] is False
    assert document["steady"] is None
    assert len(document["layout"]["spans"]) == 3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("teeth", "found"), [(110, "0.5500 m, too short"), (130, "0.6500 m, too long")]
)
def test_a_belt_that_no_place_of_its_eccentric_holds_is_told_by_the_paths(
    run, tmp_path, teeth, found
):
    """The roller, 6 mm off its axis, moves the path of 119 teeth by less than 24 mm."""
    text = (EXAMPLES / "timing_belt_eccentric.toml").read_text()
    (tmp_path / "other.toml").write_text(text.replace("teeth = 119 }", f"teeth = {teeth} }}"))
    status, _, err = run("analyze", "other.toml")
    assert status == 1
    assert one_line(err)
    assert f"installation.belt_length: found {found}: with eccentric" in err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("analyze",), "Missing argument"),
        (("analyse", "x.toml"), "No such command"),
        (("analyze", "x.toml", "--jsno", "y"), "No such option"),
        (("analyze", "nowhere.toml"), "nowhere.toml: cannot be read"),
        (
            ("analyze", EXAMPLES / "three_pulley.toml", "--json", "no/folder/x.json"),
            "cannot be written",
        ),
        (("optimize", "nowhere.toml"), "nowhere.toml: cannot be read"),
    ],
)
def test_wrong_arguments(run, tmp_path, words, says):
    status, out, err = run(*words)
    assert (status, out) == (1, "")
    assert one_line(err)
    assert says in err
    assert list(tmp_path.iterdir()) == []


def test_optimize_writes_json_picture_and_drive(run, tmp_path):
    words = ["optimize", EXAMPLES / "three_pulley_study.toml", "--json", "out.json"]
    words += ["--figure", "layout.png"]
    status, out, err = run(*words, "--save-drive", "after.toml")
    assert (status, err) == (0, "")
    assert "active" in out
    document = json.loads((tmp_path / "out.json").read_text())
    assert document["success"] is True
    assert document["objective"]["final"] < 0.6 * document["objective"]["initial"]
    assert set(document["design"]) == {
        "pulley.tensioner.radius", "pulley.accessory.radius", "tensioner.angle",
    }  # fmt: skip
    keys = {"quantity", "value", "lower", "upper", "multiplier", "active"}
    assert all(keys <= set(constraint) for constraint in document["constraints"])
    assert len(document["starts"]) == 64
    assert (tmp_path / "layout.png").read_bytes()[:4] == b"\x89PNG"
    # Nothing that was not asked for.
    assert {path.name for path in tmp_path.iterdir()} == {"out.json", "after.toml", "layout.png"}
    status, out, _ = run("analyze", "after.toml", "--json", "-")
    assert json.loads(out)["steady"]["coupling_total"] == pytest.approx(
        document["objective"]["final"]
    )


def test_infeasible_study_is_an_answer(run, tmp_path):
    study = STUDY.replace("lower = 2.5", "lower = 4.5")  # as many starts: the same program
    (tmp_path / "study.toml").write_text(
        study.replace('"three_pulley.toml"', f'"{EXAMPLES}/three_pulley.toml"')
    )
    status, _, err = run("optimize", "study.toml", "--json", "out.json")
    assert status == 2
    assert one_line(err)
    assert re.search(r"constraint\.speed_ratio:accessory: cannot be met: .* missed by 0\.459", err)
    assert json.loads((tmp_path / "out.json").read_text())["success"] is False


BAD_STUDIES = {
    "no drive": ('drive = "three_pulley.toml"', 'drive = "gone.toml"', r"drive: there is no file"),
    "unknown variable": ('"pulley.accessory.radius"', '"pulley.accesory.radius"', r"no pulley 'accesory'"),
    "not a variable": ('"tensioner.angle"', '"tensioner.anlge"', r"variable\.tensioner\.anlge: is not a variable"),
    "variable twice": ('"pulley.accessory.radius"', '"pulley.tensioner.radius"', r"given twice"),
    "bounds cross": ('lower = "35 mm"', 'lower = "65 mm"', r"lower must be less than upper"),
    "wrong unit": ('lower = "35 mm"', 'lower = "35 N"', r"\.lower: found '35 N'"),
    "unknown quantity": ('"tensioner_effectiveness"', '"efectiveness"', r"no quantity 'efectiveness'"),
    "quantity of nothing": ('"wrap:tensioner"', '"wrap:tensoner"', r"no pulley 'tensoner'"),
    "no limit": ('quantity = "clearance"               # between rims, and between belt and pulleys\nlower = "10 mm"', 'quantity = "clearance"', r"has no limit"),
    "limits cross": ("lower = 0.7", "lower = 0.7\nupper = 0.5", r"no design can meet both"),
    "no friction": ('"wrap:tensioner"\nlower = "35 deg"', '"slip_margin:tensioner"\nlower = 0.1', r"has no friction"),
    "unknown objective": ('minimize = "coupling"', 'minimize = "noise"', r"objective\.minimize: there is no quantity"),
    "no starts": ("starts = 64", "starts = 0", r"optimizer\.starts"),
    "unknown key": ("seed = 0", "sead = 0", r"optimizer\.sead: is not a known key; did you mean 'seed'"),
    "not finite": ('lower = "35 mm"', "lower = inf", r"not finite"),
    "negative radius": ('lower = "35 mm"', "lower = -0.1", r"must be positive"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_STUDIES)
def test_bad_study_is_one_line_and_writes_nothing(case, run, tmp_path):
    old, new, says = BAD_STUDIES[case]
    assert old in STUDY
    (tmp_path / "three_pulley.toml").write_text(THREE)
    (tmp_path / "study.toml").write_text(STUDY.replace(old, new, 1))
    status, out, err = run("optimize", "study.toml", "--json", "out.json")
    assert (status, out) == (1, "")
    assert one_line(err)
    assert "study.toml: " in err
    assert re.search(says, err), err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["study.toml", "three_pulley.toml"]


def test_fresh_process_sets_double_precision_and_handles_an_interrupt(tmp_path):
    code = (
        "import beltjax.__main__, beltjax.commands.reports.analyze as jobs, sys\n"
        "def stop(*_): raise KeyboardInterrupt\n"
        "jobs.analyze_report = stop\n"
        "sys.argv = ['beltjax', 'analyze', 'x.toml', '--json', 'out.json']\n"
        "beltjax.__main__.main()"
    )
    (tmp_path / "x.toml").touch()
    ended = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert ended.returncode == 130
    assert one_line(ended.stderr)
    assert [path.name for path in tmp_path.iterdir()] == ["x.toml"]


def test_what_is_no_json_is_never_written():
    with pytest.raises(ValueError, match="Out of range"):
        json_bytes({"x": float("nan")})


def test_an_answer_that_cannot_be_written_is_shown(run, monkeypatch):
    def refuse(given):
        assert [path for path, _ in given] == ["out.json"]
        raise OSError(errno.ENOSPC, "No space left on device", "out.json")

    monkeypatch.setattr(writing, "write_together", refuse)
    status, out, err = run("analyze", EXAMPLES / "three_pulley.toml", "--json", "out.json")
    assert status == 1
    assert "coupling Gamma" in out
    assert err == "beltjax: out.json: cannot be written (No space left on device)\n"
