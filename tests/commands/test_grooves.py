"""`beltjax contact` of a belt in grooves: its document, tables, picture and refusals."""

import json

import numpy as np
import pytest
from drives import EXAMPLES

import beltjax as bj

TWO = EXAMPLES / "two_pulley_groove.toml"
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.mark.slow
def test_document_and_picture(run, tmp_path):
    text = TWO.read_text().replace("tension = 300.0", "belt_length = 0.6166")
    text += "\n[contact]\nslip_velocity = 1e-4\n"
    (tmp_path / "mine.toml").write_text(text)
    status, out, err = run("contact", "mine.toml", "--json", "c.json", "--figure", "c.png")
    assert (status, err) == (0, "")
    assert "unseating (deg)" in out
    assert (tmp_path / "c.png").read_bytes().startswith(PNG)
    found = json.loads((tmp_path / "c.json").read_text())
    state = bj.groove_state(*bj.load_drive(tmp_path / "mine.toml"))
    assert found["slip_velocity"] == 1e-4
    for i, row in enumerate(found["pulleys"]):
        zones = [row[f"{zone}_deg"] for zone in ("seating", "adhesion", "sliding", "unseating")]
        assert zones == pytest.approx(np.degrees(np.asarray(state.zones[i])), rel=1e-9)
        assert sum(zones) == pytest.approx(row["wrap_deg"])
        assert row["penetration_max"] == pytest.approx(float(state.penetrations[i]), rel=1e-9)
        assert row["entry_angle_deg"] < 0 < row["exit_angle_deg"]
        assert row["blur"]["loss"] < 0.1 * row["loss"]
    power = found["power"]
    assert power["input"] - power["output"] == pytest.approx(power["friction_loss"], rel=1e-8)
    assert power["output"] / power["input"] == pytest.approx(found["efficiency"], rel=1e-12)
    # The belt leaves each pulley deeper than it comes to the next, so that spans rise outwards.
    assert all(row["angle_start_deg"] > 0.1 for row in found["spans"])
    unstretched = sum(row["unstretched_length"] for row in found["spans"])
    assert 0 < unstretched < found["unstretched_length"]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--law", "hyperelastic"), "--law: belongs to a belt without groove"),
        (("--compare", "m.svg"), "--compare: belongs to a belt without groove"),
        (("--limit", "adhesion"), "--limit: belongs to --maximum; add that, or leave it out"),
    ],
    ids=["law", "compare", "limit"],
)
def test_options_of_flat_belts_are_refused(run, options, says):
    status, _, err = run("contact", TWO, *options)
    assert status == 1
    assert says in err


def test_limit_is_of_a_belt_in_grooves(run):
    flat = EXAMPLES / "two_pulley_table_5_1.toml"
    status, _, err = run("contact", flat, "--maximum", "--limit", "slip")
    assert status == 1
    assert "--limit: belongs to a belt with groove" in err


def test_file_without_friction_is_one_line(run, tmp_path):
    (tmp_path / "bare.toml").write_text(TWO.read_text().replace("\nfriction = 0.3\n", "\n", 1))
    status, _, err = run("contact", "bare.toml")
    assert status == 1
    assert "pulley.driven.friction: is missing; give the coefficient" in err
