"""Contact on the command line: JSON keys, the table, pictures, one line for what cannot be."""

import json
import re

import numpy as np
import pytest
from drives import EXAMPLES

TWO = EXAMPLES / "two_pulley_table_5_1.toml"
SEVEN = EXAMPLES / "seven_pulley.toml"
PNG = b"\x89PNG\r\n\x1a\n"
PULLEY_KEYS = {"name", "wrap_deg", "slip_deg", "adhesion_deg", "moment"}
SPAN_KEYS = {"name", "length", "unstretched_length", "tension_start", "tension_mid", "tension_end"}
SPAN_KEYS |= {"speed_start", "speed_end", "angle_start_deg", "angle_end_deg"}
KEYS = {"pulleys", "spans", "unstretched_length", "efficiency"}
KEYS |= {"driver_moment", "driven_moment", "feasible"}


def changed(tmp_path, old, new, source=TWO):
    text = source.read_text()
    assert old in text
    path = tmp_path / "changed.toml"
    path.write_text(text.replace(old, new))
    return path


def test_the_table_5_1_drive_with_all_keys_and_pictures(run, tmp_path):
    files = "--json", "c.json", "--figure", "c.png", "--compare", "m.svg"
    status, out, err = run("contact", TWO, *files)
    assert (status, err) == (0, "")
    assert "87.45" in out
    found = json.loads((tmp_path / "c.json").read_text())
    assert set(found) >= KEYS
    assert all(set(row) >= PULLEY_KEYS for row in found["pulleys"])
    assert all(set(row) >= SPAN_KEYS for row in found["spans"])
    driver, driven = found["pulleys"]
    assert (driver["moment"], driven["moment"]) == (pytest.approx(-2.0), pytest.approx(2.0))
    assert found["driver_moment"] == pytest.approx(found["driven_moment"]) == pytest.approx(2.0)
    # Table 5.2: the tight span is the one that arrives at the driver.
    slack, tight = found["spans"]
    assert tight["name"] == "driven-driver"
    assert tight["tension_start"] == pytest.approx(79.189, abs=5e-4)
    # The print's th1(0) is where the belt leaves the driver's tight side, against its travel.
    angles = tight["angle_end_deg"], slack["angle_end_deg"]
    assert np.abs(angles) == pytest.approx((16.873, 25.973), abs=5e-4)
    # The belt bulges outwards: up from its start, down to its end.
    assert slack["angle_start_deg"] > 0 > slack["angle_end_deg"]
    assert (tmp_path / "c.png").read_bytes().startswith(PNG)
    assert b"<svg" in (tmp_path / "m.svg").read_bytes()[:600]


def test_speeds_have_the_sign_that_analyze_gives_them(run, tmp_path):
    """The belt of the table runs one way and then the other."""
    senses = []
    for travel in ("listed", "opposite"):
        text = re.sub(r'travel = "\w+"', "", TWO.read_text())
        text = text.replace("[operation]", f'[operation]\ntravel = "{travel}"')
        (tmp_path / "drive.toml").write_text(text)
        speeds = []
        for command in ("contact", "analyze"):
            _, out, _ = run(command, "drive.toml", "--json", "-")
            speeds.append([row["speed"] for row in json.loads(out)["pulleys"]])
        assert np.sign(speeds[0]) == pytest.approx(np.sign(speeds[1]))
        assert speeds[0][0] == pytest.approx(speeds[1][0], rel=1e-9)  # the driver's is given
        senses.append(np.sign(speeds[0][0]))
    assert senses == [1.0, -1.0]


@pytest.mark.slow
def test_the_largest_torques_of_seven_pulleys(run):
    status, out, _ = run("contact", SEVEN, "--maximum", "--json", "-")
    found = json.loads(out)
    assert status == 0
    assert found["feasible"]
    assert found["driven_moment"] is None
    assert found["torque_factor"] == pytest.approx(1.251, abs=5e-4)
    assert found["pulleys"][0]["adhesion_deg"] == pytest.approx(0.0, abs=1e-9)


def test_gross_slip_is_written_and_said(run, tmp_path):
    path = changed(tmp_path, "driven = 2.0", "driven = 3.8")
    status, out, err = run("contact", path, "--json", "-")
    found = json.loads(out)
    assert status == 2
    assert found["feasible"] is False
    assert min(pulley["adhesion_deg"] for pulley in found["pulleys"]) < 0
    assert err.startswith(f"beltjax: {path}: operation.torque: driver, driven: A pulley slips")
    assert err.count("\n") == 1


def test_a_belt_too_stiff_for_its_pulleys_has_no_state(run, tmp_path):
    path = changed(tmp_path, "bending_stiffness = 0.015", "bending_stiffness = 0.5")
    status, out, err = run("contact", path, "--json", "-")
    found = json.loads(out)
    assert (status, found["feasible"], found["spans"]) == (2, False, None)
    assert "belt.bending_stiffness" in err
    assert "Enlarge the smallest pulley" in err


def test_missing_friction_names_the_pulley_and_writes_nothing(run, tmp_path):
    text = 'face = "grooved"\nfriction = 0.6\n'
    path = changed(tmp_path, text, 'face = "grooved"\n')
    status, out, err = run("contact", path, "--json", "x.json")
    assert (status, out) == (1, "")
    assert "pulley.driven.friction: is missing" in err
    assert not (tmp_path / "x.json").exists()


@pytest.mark.slow
def test_three_pulleys_without_torque_have_no_largest(run):
    status, _, err = run("contact", EXAMPLES / "three_pulley.toml", "--maximum")
    assert status == 1
    assert "nothing to raise to its maximum" in err


@pytest.mark.slow
def test_torque_against_the_sense_that_is_meant_is_led_on(run, tmp_path):
    text = (EXAMPLES / "three_pulley.toml").read_text()
    text = text.replace('face = "grooved"', 'face = "grooved"\nfriction = 20.0')
    (tmp_path / "against.toml").write_text(text.replace("accessory = 0.0", "accessory = -40.0"))
    status, _, err = run("contact", "against.toml")
    assert status == 2
    assert "operation.torque: The belt does not press on a pulley any more" in err
    assert "(or is operation.travel = 'opposite' meant? In that sense the drive runs)" in err
