"""Grooves in drive files."""

import dataclasses

import numpy as np
import pytest
from drives import EXAMPLES, example

import beltjax as bj

TEXT = (EXAMPLES / "two_pulley_groove.toml").read_text()
GROOVE = 'groove = { angle = "40 deg", wedge_stiffness = 6e6 }'


def load(tmp_path, text):
    path = tmp_path / "drive.toml"
    path.write_text(text)
    return bj.load_drive(path)


def swap(old, new):
    assert old in TEXT
    return TEXT.replace(old, new, 1)


def test_a_groove_is_read_and_written(tmp_path):
    text = swap('name = "driven"', 'name = "driven"\ngroove = { angle = "36 deg" }')
    text += "\n[contact]\nslip_velocity = 1e-4\nslip_limit = 0.1\n"
    drive, point = load(tmp_path, text)
    assert float(drive.belt.wedge_angle) == pytest.approx(np.radians(40))
    assert float(drive.belt.wedge_stiffness) == 6e6
    assert drive.pulleys[0].wedge_angle is None
    assert float(drive.pulleys[1].wedge_angle) == pytest.approx(np.radians(36))
    assert drive.contact == ("full", 1e-4, 0.1)
    bj.save_drive(tmp_path / "saved.toml", drive, point)
    again, _ = bj.load_drive(tmp_path / "saved.toml")
    assert again.contact == drive.contact
    assert float(again.pulleys[1].wedge_angle) == float(drive.pulleys[1].wedge_angle)


def test_a_smooth_rim_is_read_and_written(tmp_path):
    drive, point = load(tmp_path, swap('name = "driven"', 'name = "driven"\ngroove = false'))
    assert [float(pulley.wedged) for pulley in drive.pulleys] == [1.0, 0.0]
    bj.save_drive(tmp_path / "saved.toml", drive, point)
    again, _ = bj.load_drive(tmp_path / "saved.toml")
    assert float(again.pulleys[1].wedged) == 0.0


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (GROOVE, 'groove = { angle = "40 deg" }', r"belt\.groove\.wedge_stiffness: is missing"),
        (GROOVE, "groove = true", r"belt\.groove: found True; give \{ angle"),
        (GROOVE, GROOVE.replace(" }", ", ribs = 4 }"), r"belt\.groove\.ribs: found 4; the keys"),
        (GROOVE, GROOVE + "\nwedge_angle = 0.7", r"belt\.groove\.angle: is given as wedge_angle"),
        (GROOVE, "", r"pulley\.driven\.groove: belongs to a belt with groove"),
        ("[installation]", "groove_angle = 0.7\n[installation]", r"groove_angle: turns friction"),
        ("36 deg", "-36 deg", r"pulley\.driven\.wedge_angle: found '-36 deg'; must be greater"),
    ],
    ids=["half", "flag", "unknown", "twice", "no belt", "apparent friction", "negative"],
)
def test_what_does_not_fit_is_one_line(tmp_path, old, new, says):
    text = swap('name = "driven"', 'name = "driven"\ngroove = { angle = "36 deg" }')
    assert old in text
    with pytest.raises(bj.FileError, match=says):
        load(tmp_path, text.replace(old, new, 1))


def test_half_a_groove_is_refused():
    drive, _ = example("two_pulley_groove")
    with pytest.raises(ValueError, match="wedge_angle and wedge_stiffness go together"):
        dataclasses.replace(drive.belt, wedge_stiffness=None)


def with_belt(drive, **numbers):
    return dataclasses.replace(drive, belts=(dataclasses.replace(drive.belt, **numbers),))


def with_driven(drive, **numbers):
    first, second = drive.pulleys
    return dataclasses.replace(drive, pulleys=(first, dataclasses.replace(second, **numbers)))


FLAT = {"wedge_angle": None, "wedge_stiffness": None}


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: with_belt(d, **FLAT), "belt.groove is missing"),
        (lambda d: with_driven(d, friction=None), "pulley.driven.friction is missing"),
        (lambda d: with_driven(d, friction=4.0), "belt.groove.angle and friction leave no wedge"),
        (
            lambda d: with_driven(d, wedge_angle=3.0),
            r"pulley.driven.groove.angle and friction leave no wedge",
        ),
        (
            lambda d: dataclasses.replace(
                d, installation=bj.TensionGiven(tension=300.0, tension_of="string")
            ),
            "installation.tension_of is that of a string",
        ),
    ],
    ids=["no groove", "no friction", "no wedge", "no wedge of its own", "string"],
)
def test_what_grooves_need_is_said(change, says):
    drive, point = example("two_pulley_groove")
    with pytest.raises(ValueError, match=says):
        bj.groove_state(change(drive), point)


def test_a_flat_belt_has_no_limit_of_slip():
    drive, point = example("two_pulley_table_5_1")
    with pytest.raises(ValueError, match="belong to a belt with wedge_angle"):
        bj.maximum_moment(drive, point, limit=bj.SlipLimit())
