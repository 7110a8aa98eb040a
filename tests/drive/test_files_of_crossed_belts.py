"""Crossed belts on two pulleys, and drives in the coordinates of their site."""

import json
import math
import re

import numpy as np
import pytest
from bodies_cases import load, swap

import beltjax as bj
from beltjax.drive.files import drive_content

# A flat belt that turns a line shaft against the motor.
CROSSED = """
[belt]
crossed = true
axial_stiffness = 2e5
bending_stiffness = 0.01
mass_per_length = 0.4
[[pulley]]
name = "motor"
center = [0.0, 0.0]
radius = 0.15
face = "grooved"
friction = 0.3
driver = true
[[pulley]]
name = "shaft"
center = [1.2, 0.9]
radius = 0.35
face = "grooved"
friction = 0.3
[installation]
tension = "600 N"
[operation]
driver_speed = "960 rpm"
torque = { shaft = "60 N m" }
"""


@pytest.mark.parametrize("apart", [1.5, 0.55], ids=["far", "near"])
def test_a_crossed_belt_is_that_of_the_handbook(tmp_path, apart):
    """L = 2 sqrt(d^2 - s^2) + s (pi + 2 asin(s/d)) with s = r1 + r2, and equal wraps."""
    drive, _ = load(tmp_path, swap(CROSSED, "[1.2, 0.9]", f"[{0.8 * apart}, {0.6 * apart}]"))
    at, s = bj.layout(drive), 0.5
    wrap = math.pi + 2 * math.asin(s / apart)
    np.testing.assert_allclose(at.wraps, wrap, rtol=1e-13)
    length = 2 * math.sqrt(apart**2 - s**2) + s * wrap
    assert float(at.path_length) == pytest.approx(length, rel=1e-13)


def test_its_pulleys_turn_opposite_ways(run, tmp_path):
    (tmp_path / "sheet.toml").write_text(CROSSED)
    status, _, err = run("layout", "sheet.toml", "--json", "out.json", "--figure", "out.png")
    assert (status, err) == (0, "")
    found = json.loads((tmp_path / "out.json").read_text())
    assert found["pulleys"][1]["speed_ratio"] == pytest.approx(-0.15 / 0.35)
    # The first pulley turns counterclockwise, as two pulleys are listed.
    assert found["pulleys"][0]["speed"] == pytest.approx(32 * math.pi)


@pytest.mark.slow
def test_statics_and_contact_of_a_crossed_belt(tmp_path):
    """T1 - T2 = M/r, and Euler and Eytelwein's arcs, ln(T1/T2)/mu on both pulleys."""
    drive, point = load(tmp_path, CROSSED)
    rest = bj.reference_state(drive, point)
    assert np.ptp(rest.tensions) == pytest.approx(60 / 0.35, rel=1e-12)
    string = bj.load_drive(_written(tmp_path, CROSSED.replace("0.01", "0.0")))
    found = bj.contact_state(*string)
    pulls = np.asarray(found.tensions[:, 1] - found.mass_flow * found.speeds[:, 0])
    slip = math.log(pulls.max() / pulls.min()) / 0.3
    np.testing.assert_allclose(found.slips, slip, rtol=1e-9)
    np.testing.assert_allclose(found.wraps, math.pi + 2 * math.asin(0.5 / 1.5), rtol=1e-12)
    stiff = bj.contact_state(drive, point)
    assert stiff.feasible
    np.testing.assert_allclose(stiff.tensions[:, 1], found.tensions[:, 1], rtol=1e-3)


def _written(folder, text):
    (folder / "string.toml").write_text(text)
    return folder / "string.toml"


def test_a_saved_file_has_the_same_belt(tmp_path):
    drive, point = load(tmp_path, CROSSED)
    bj.save_drive(tmp_path / "saved.toml", drive, point)
    again, same = bj.load_drive(tmp_path / "saved.toml")
    assert "crossed = true" in (tmp_path / "saved.toml").read_text()
    assert drive_content(again, same) == drive_content(drive, point)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("crossed = true\n", "", r"both 'grooved', and belt\.crossed = true if it shall"),
        ("crossed = true", "crossed = 1", r"belt\.crossed: found 1; give"),
        ("crossed = true", "crosed = true", r"belt\.crosed: is not a known key; did you mean 'crossed'"),
        (
            "crossed = true",
            'crossed = true\npitch_offset = "2 mm"\nstandard_lengths = { effective = [4.7] }',
            r"effective.*: found 4\.7; a crossed belt has no effective length of its own; give \{ pitch",
        ),
        ("[1.2, 0.9]", "[0.4, 0.3]", r"pulley\.shaft\.center: (overlaps|span motor-shaft has no tangent)"),
    ],
    ids=["not said", "number", "near", "effective", "overlap"],
)  # fmt: skip
def test_what_does_not_fit_is_one_line(tmp_path, old, new, says):
    text = swap(CROSSED, old, new)
    if not new:
        head, tail = text.rsplit('face = "grooved"', 1)
        text = f'{head}face = "back"{tail}'
    with pytest.raises(bj.FileError) as error:
        load(tmp_path, text)
    assert re.search(says, str(error.value))


def test_crossed_is_for_two_pulleys(tmp_path):
    third = '[[pulley]]\nname = "third"\ncenter = [0.0, 1.0]\nradius = 0.1\nface = "grooved"\n'
    with pytest.raises(bj.FileError, match=r"belt\.crossed: belongs to a belt on two pulleys"):
        load(tmp_path, swap(CROSSED, "[installation]", third + "[installation]"))
