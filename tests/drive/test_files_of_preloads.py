"""Preloads, forces and gravity in drive files: what comes back, and what is refused."""

import re

import numpy as np
import pytest
from bodies_cases import load, swap
from drives import EXAMPLES
from small_drives import PRESSED

import beltjax as bj
from beltjax.commands.reports.units import TableUnits
from beltjax.drive.files import drive_content

SPRUNG = (
    'gravity = [0, "-9.81 m/s^2"]'
    + PRESSED
    + """[[tensioner]]
name = "arm"
pulley = "idler"
pivot = [0.08, 0.14]
stiffness = "20 N m/rad"
preload = "-12 N m"
[operation]
belt_speed = 20.0
"""
)
SLIDE = SPRUNG.replace(
    'pivot = [0.08, 0.14]\nstiffness = "20 N m/rad"\npreload = "-12 N m"',
    'kind = "linear"\ndirection = [0, -1]\npreload = "150 N"',
)


def test_preload_over_rate_is_where_the_spring_is_relaxed(tmp_path):
    drive, _ = load(tmp_path, SPRUNG)
    np.testing.assert_allclose(drive.installation.free, [-12 / 20], rtol=1e-15)
    assert isinstance(drive.installation, bj.Preloaded)
    # 20 degrees from the drawn position the spring holds 20 N m/rad of that less.
    angle = np.degrees(np.arctan2(-0.09, 0.12)) - 20
    text = swap(SPRUNG, '"-12 N m"', f'"-12 N m"\nat_angle = "{angle!r} deg"')
    drive, _ = load(tmp_path, text.replace("np.float64(", "").replace(") deg", " deg"))
    np.testing.assert_allclose(drive.installation.free, [-12 / 20 - np.radians(20)], rtol=1e-14)


def test_a_study_may_choose_a_preload(tmp_path):
    """The drawn layout stays, and the tension grows as the moment that balances it does."""
    load(tmp_path, SPRUNG)
    (tmp_path / "study.toml").write_text(
        'drive = "drive.toml"\n[objective]\nminimize = "path_length"\n[[variable]]\n'
        'name = "tensioner.arm.preload"\nlower = "-24 N m"\nupper = "-90 lbf in"\n'
    )
    study = bj.optimize.load_study(tmp_path / "study.toml")
    np.testing.assert_allclose(study.variables.upper, [-90 * 4.4482216152605 * 0.0254], rtol=1e-12)
    drive, name = study.drive, "tensioner.arm.preload"
    assert float(bj.optimize.value_of(drive, name)) == pytest.approx(-12, rel=1e-15)
    assert drive.units[name] == "N m"
    doubled = bj.optimize.with_values(drive, {name: -24.0})
    still = bj.OperatingPoint(belt_speed=0.0)
    one, two = (bj.reference_state(d, still).tensions for d in (drive, doubled))
    np.testing.assert_allclose(two, 2 * np.asarray(one), rtol=1e-12)
    # With another stiffness the preload is the same, and not where the spring is relaxed.
    soft = bj.optimize.with_values(drive, {name: -12.0, "tensioner.arm.stiffness": 5.0})
    np.testing.assert_allclose(soft.installation.free, [-12 / 5], rtol=1e-15)
    np.testing.assert_allclose(bj.reference_state(soft, still).tensions, one, rtol=1e-12)


def test_a_preload_at_an_angle_is_shown_as_the_file_counts_it(tmp_path):
    text = swap(SPRUNG, '"-12 N m"', '"-12 N m"\nat_angle = "-50 deg"')
    drive, _ = load(tmp_path, text)
    turn = np.radians(-50) - np.arctan2(-0.09, 0.12)
    drawn = float(bj.optimize.value_of(drive, "tensioner.arm.preload"))
    assert drawn == pytest.approx(-12 + 20 * turn, rel=1e-12)
    assert TableUnits(drive).of_number("tensioner.arm.preload", drawn) == ("-12", "N m")


def test_what_has_no_rate_is_a_constant_force(tmp_path):
    drive, _ = load(tmp_path, SLIDE)
    assert float(drive.tensioners[0].force) == 150.0
    assert float(drive.tensioners[0].stiffness) == 0.0


@pytest.mark.parametrize("text", [SPRUNG, SLIDE], ids=["spring", "cylinder"])
def test_a_saved_file_has_the_same_drive(tmp_path, text):
    drive, point = load(tmp_path, text)
    np.testing.assert_array_equal(drive.gravity, [0, -9.81])
    bj.save_drive(tmp_path / "saved.toml", drive, point)
    again, same = bj.load_drive(tmp_path / "saved.toml")
    assert drive_content(again, same) == drive_content(drive, point)
    assert type(again.installation) is type(drive.installation)


@pytest.mark.parametrize(
    ("old", "new"),
    [('stiffness = "20 N m/rad"\n', ""), ('"-12 N m"', '"-12 N m"\nat_angle = "-50 deg"')],
    ids=["no stiffness", "at an angle"],
)
def test_geometry_alone_needs_no_spring(run, tmp_path, old, new):
    (tmp_path / "sheet.toml").write_text(swap(SPRUNG, old, new))
    status, out, _ = run("layout", "sheet.toml")
    assert (status, "idler" in out) == (0, True)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('"-12 N m"', '"12 N m"', r"tensioner: preload, force and weight push away from 'belt', whose tension would be -\d+\.?\d* N; turn their sign"),
        ('"-12 N m"', '"-12 N"', r"tensioner\.arm\.preload: found '-12 N', whose unit is not N m"),
        ('preload = "-12 N m"', 'at_angle = "30 deg"', r"tensioner\.arm\.at_angle: goes with preload"),
        ('preload = "-12 N m"', 'prelaod = "-12 N m"', r"tensioner\.arm\.prelaod: is not a known key; did you mean 'preload'"),
        ('preload = "-12 N m"', "", r"installation: found neither tension nor belt_length"),
        ('"-12 N m"', '"-12 N m"\nforce = 3.0', r"tensioner\.arm\.preload: force is given, too"),
        ("[operation]", '[installation]\ntension = "300 N"\n[operation]', r"tensioner\.arm\.preload: gives the tension, as installation\.tension does"),
        ("[operation]", "[installation]\nfree = { arm = 0.3 }\n[operation]", r"tensioner\.arm\.preload: installation\.free\.arm says where"),
        ('stiffness = "20 N m/rad"\npreload = "-12 N m"', 'preload = "-12 N m"\nat_angle = 0.1', r"tensioner\.arm\.at_angle: belongs to a spring"),
        ('[0, "-9.81 m/s^2"]', '[0, "-9.81 m"]', r"gravity.*found '-9\.81 m', whose unit is not m/s\^2"),
        ('preload = "-12 N m"', 'locked = true\npreload = "-12 N m"', r"installation: nothing gives the tension"),
    ],
    ids=["sign", "unit", "alone", "near", "none", "force", "tension", "free", "angle", "gravity", "bolted"],
)  # fmt: skip
def test_what_does_not_fit_is_one_line(tmp_path, old, new, says):
    with pytest.raises(bj.FileError) as error:
        load(tmp_path, swap(SPRUNG, old, new))
    assert re.search(says, str(error.value))


@pytest.mark.slow
def test_a_slack_belt_leads_to_what_tightens_it(run, tmp_path):
    """12 kN m at 0.4 m take 30 kN, more than the two strands' 24 kN together."""
    text = (EXAMPLES / "conveyor.toml").read_text()
    (tmp_path / "slack.toml").write_text(swap(text, '"3.2 kN m"', '"12 kN m"'))
    status, _, err = run("analyze", "slack.toml")
    assert (status, err.count("\n")) == (2, 1)
    assert re.search(r"slack at rest \(-3000 N\).*raise the preload, force or weight of its", err)
