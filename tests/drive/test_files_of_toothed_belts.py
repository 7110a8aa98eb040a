"""Toothed belts as they are sold: teeth for radii and lengths, and the centers that fit them."""

import json
import math
import re

import numpy as np
import pytest
from bodies_cases import load, swap
from drives import EXAMPLES
from scipy.optimize import brentq

import beltjax as bj
from beltjax.drive.files import drive_content

# 8 mm pitch, 22 and 44 teeth, as a saw's motor and spindle.
SAW = """
name = "saw"
[belt]
pitch = "8 mm"
axial_stiffness = 300e3
bending_stiffness = 0.0
mass_per_length = 0.2
[[pulley]]
name = "motor"
center = [0, 0]
teeth = 22
face = "grooved"
driver = true
[[pulley]]
name = "spindle"
center = ["310 mm", 0]
teeth = 44
face = "grooved"
[installation]
tension = "400 N"
[operation]
driver_speed = "3000 rpm"
torque = { spindle = 12.0 }
"""
PITCH = 'pitch = "8 mm"'
ECCENTRIC = """
[[tensioner]]
name = "eccentric"
kind = "rotary"
pulley = "spindle"
pivot = ["300 mm", 0]
locked = true
stops = ["-170 deg", "10 deg"]
"""


def open_belt(apart):
    """Length of an open belt round 22 and 44 teeth of 8 mm, as handbooks have it."""
    small, large = 22 * 0.008 / (2 * math.pi), 44 * 0.008 / (2 * math.pi)
    a = math.asin((large - small) / apart)
    return 2 * apart * math.cos(a) + math.pi * (large + small) + 2 * a * (large - small)


def fits(run, tmp_path, text):
    (tmp_path / "sheet.toml").write_text(text)
    status, out, err = run("layout", "sheet.toml", "--json", "out.json")
    assert (status, err) == (0, "")
    return json.loads((tmp_path / "out.json").read_text()), out


def test_teeth_give_radii_and_an_exact_speed_ratio(tmp_path):
    drive, point = load(tmp_path, SAW)
    around = 2 * math.pi * np.asarray(drive.radii)
    np.testing.assert_allclose(around, [0.176, 0.352], rtol=1e-14)
    assert float(drive.radii[0] / drive.radii[1]) == 0.5
    # 12 N m on 44 teeth are 6 N m on 22: T1 - T2 = M/r, and locked centers keep the sum.
    tensions = np.asarray(bj.reference_state(drive, point).tensions)
    assert np.ptp(tensions) == pytest.approx(12 / float(drive.radii[1]), rel=1e-9)


def test_a_length_in_teeth(tmp_path):
    given, _ = load(tmp_path, swap(SAW, 'tension = "400 N"', "belt_length = { teeth = 111 }"))
    assert float(given.installation.belt_length) == pytest.approx(0.888, rel=1e-14)


def test_a_saved_file_has_the_same_belt(tmp_path):
    listed = swap(
        SAW, 'pitch = "8 mm"', 'pitch = "8 mm"\nstandard_lengths = { teeth = [120, 110] }'
    )
    drive, point = load(tmp_path, listed)
    assert drive.belt.standard_lengths == (0.88, 0.96)
    bj.save_drive(tmp_path / "saved.toml", drive, point)
    again, same = bj.load_drive(tmp_path / "saved.toml")
    assert drive_content(again, same) == drive_content(drive, point)
    assert again.belt.pitch == 0.008


def test_whole_teeth_on_both_sides_of_the_drawing(run, tmp_path):
    """The center distance of each, from the handbook's length by SciPy's root."""
    found, out = fits(run, tmp_path, SAW)
    teeth = open_belt(0.310) / 0.008
    assert found["belts"][0]["teeth"] == pytest.approx(teeth, rel=1e-12)
    shorter, longer = found["standard_belts"]
    assert (shorter["teeth"], longer["teeth"]) == (math.floor(teeth), math.ceil(teeth))
    for belt in (shorter, longer):
        length = belt["teeth"] * 0.008
        apart = brentq(lambda d, wanted=length: open_belt(d) - wanted, 0.2, 0.5, xtol=1e-15)
        assert belt["fits"][0]["center_distance"] == pytest.approx(apart, rel=1e-12)
        assert belt["fits"][0]["tensioner"] is None
    assert re.search(rf"in teeth +{teeth:.3f}", out)
    assert "center distance" in out


def test_an_eccentric_turns_to_the_belts_that_are_sold(run, tmp_path):
    """The spindle on a circle of 10 mm: its distance from the motor by the law of cosines."""
    listed = swap(
        SAW, 'pitch = "8 mm"', 'pitch = "8 mm"\nstandard_lengths = { teeth = [110, 100] }'
    )
    listed = swap(listed, "[installation]", ECCENTRIC + "[installation]")
    listed = swap(listed, '"310 mm", 0', f"{0.3 + 0.01 * math.cos(1.0)}, {0.01 * math.sin(1.0)}")
    found, out = fits(run, tmp_path, listed)

    def length(turn):
        return open_belt(math.hypot(0.3 + 0.01 * math.cos(1 + turn), 0.01 * math.sin(1 + turn)))

    assert [belt["teeth"] for belt in found["standard_belts"]] == [100, 110]
    turned = {belt["teeth"]: belt["fits"] for belt in found["standard_belts"]}
    # From 1 rad the eccentric reaches its largest distance at 0 rad: -1 of the coordinate.
    reach = {n: (length(-1.0) - n * 0.008) * (length(math.pi - 1) - n * 0.008) < 0 for n in turned}
    for teeth, places in turned.items():
        assert bool(places) == reach[teeth]
        for place in places:
            assert place["tensioner"] == "eccentric"
            assert length(place["coordinate"]) == pytest.approx(teeth * 0.008, rel=1e-12)
            assert place["beyond_stops"] == (not -170 <= math.degrees(place["coordinate"]) <= 10)
    assert reach == {100: False, 110: True}
    assert "eccentric" in out


def test_contact_says_in_one_line_that_nothing_slips(run, tmp_path):
    (tmp_path / "saw.toml").write_text(SAW)
    status, out, err = run("contact", "saw.toml")
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert re.search(r"belt\.pitch: is of a toothed belt, which does not slip.*analyze", err)
    with pytest.raises(ValueError, match="does not slip"):
        bj.contact_state(*bj.load_drive(tmp_path / "saw.toml"))


def test_contact_says_what_to_do_about_one_toothed_belt_of_several(run, tmp_path):
    text = (EXAMPLES / "combine_two_belts.toml").read_text()
    toothed = swap(text, 'name = "drum"\n', 'name = "drum"\npitch = "20 mm"\n')
    held, slipping = toothed.split('name = "pinion"')
    slipping = slipping.replace("friction = 0.9\n", "")
    (tmp_path / "two.toml").write_text(f'{held}name = "pinion"{slipping}')
    status, out, err = run("contact", "two.toml")
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert re.search(r"belt\.drum\.pitch: .* for the others describe a drive", err)
    with pytest.raises(ValueError, match="for the others describe a drive without this belt"):
        bj.contact_state(*bj.load_drive(tmp_path / "two.toml"))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("teeth = 22", "teeth = 22.5", r"pulley\.motor\.teeth: found 22\.5; give the number of teeth"),
        ("teeth = 22", "teeth = 0", r"pulley\.motor\.teeth: found 0; give"),
        ("teeth = 22", "teeth = 22\ndiameter = 0.056", r"pulley\.motor\.teeth: diameter is given, too"),
        ("teeth = 22", "tooth = 22", r"pulley\.motor\.tooth: is not a known key; did you mean 'teeth'"),
        ('pitch = "8 mm"\n', "", r"belt\.pitch: is missing; add the distance from tooth to tooth"),
        ('pitch = "8 mm"', 'pitch = "8 mm"\nteeth = 100', r"belt\.teeth: .* belt_length = \{ teeth"),
        ('pitch = "8 mm"', "pitch = 0", r"belt\.pitch: found 0; must be greater than 0"),
        ('pitch = "8 mm"', 'pitch = "8 mm"\nstandard_lengths = "880 mm"', r"belt\.standard_lengths: found '880 mm'; give a list"),
        ("teeth = 44", "teeth = 44\nfriction = 0.3", r"pulley\.spindle\.friction: the toothed belt \(belt\.pitch\) does not slip"),
    ],
    ids=["half a tooth", "none", "twice", "near", "pitch", "of the belt", "no pitch", "list", "slip"],
)  # fmt: skip
def test_what_does_not_fit_is_one_line(tmp_path, old, new, says):
    with pytest.raises(bj.FileError) as error:
        load(tmp_path, swap(SAW, old, new))
    assert re.search(says, str(error.value))
