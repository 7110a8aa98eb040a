"""Diameters and lengths as makers print them, against geometry by hand."""

import math
import re

import numpy as np
import pytest
from bodies_cases import load, swap
from drives import EXAMPLES

import beltjax as bj
from beltjax.commands.reports.units import TableUnits
from beltjax.drive.files import drive_content

THREE = (EXAMPLES / "three_pulley.toml").read_text()
RIBBED = """
[belt]
bending_stiffness = 0.05
axial_stiffness = 120e3
mass_per_length = 0.1
pitch_offset = "1.5 mm"
back_offset = "2.4 mm"
[[pulley]]
name = "crank"
center = [0, 0]
effective_diameter = "160 mm"
face = "grooved"
driver = true
[[pulley]]
name = "idler"
center = ["150 mm", "140 mm"]
smooth_diameter = "60 mm"
face = "back"
[[pulley]]
name = "alternator"
center = ["250 mm", "250 mm"]
effective_diameter = "56 mm"
face = "grooved"
[[pulley]]
name = "pump"
center = ["-60 mm", "300 mm"]
diameter = "113 mm"
face = "grooved"
[installation]
belt_length = { effective = "1337.3 mm" }
[operation]
driver_speed = "1000 rpm"
"""


def test_radii_are_to_the_neutral_axis(tmp_path):
    drive, _ = load(tmp_path, RIBBED)
    np.testing.assert_allclose(drive.radii, [0.0815, 0.0324, 0.0295, 0.0565], rtol=1e-14)
    assert drive.units["pulley.crank.radius"] == "mm"


def test_the_neutral_axis_is_one_turn_of_the_offset_longer(tmp_path):
    """The effective line runs inside of the neutral axis by the offset, all the way round."""
    drive, _ = load(tmp_path, RIBBED)
    b = 0.0015
    inner = RIBBED.replace('"1.5 mm"', "0.0").replace('"2.4 mm"', "0.0039")
    inner = inner.replace('"113 mm"', '"110 mm"')
    at_neutral, at_effective = (
        float(bj.layout(load(tmp_path, text)[0]).path_length) for text in (RIBBED, inner)
    )
    assert at_neutral - at_effective == pytest.approx(2 * math.pi * b, rel=1e-10)
    assert float(drive.installation.belt_length) == pytest.approx(1.3373 + 2 * math.pi * b)
    pitch, _ = load(tmp_path, RIBBED.replace("{ effective =", "{ pitch ="))
    assert float(pitch.installation.belt_length) == pytest.approx(1.3373, rel=1e-14)


def test_a_saved_file_has_the_same_drive(tmp_path):
    drive, point = load(tmp_path, RIBBED)
    bj.save_drive(tmp_path / "saved.toml", drive, point)
    again, same = bj.load_drive(tmp_path / "saved.toml")
    assert drive_content(again, same) == drive_content(drive, point)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('smooth_diameter = "60 mm"', 'effective_diameter = "60 mm"', r"pulley\.idler\.effective_diameter: belongs to a pulley with face = 'grooved'; give smooth_diameter or diameter"),
        ('diameter = "113 mm"', 'diameter = "113 mm"\nradius = 0.05', r"pulley\.pump\.diameter: radius is given, too; give one of them"),
        ('pitch_offset = "1.5 mm"\n', "", r"belt\.pitch_offset: is missing; add the distance from the belt's effective line"),
        ('diameter = "113 mm"', 'diameter = "113 N"', r"pulley\.pump\.diameter: found '113 N', whose unit is not m"),
        ('diameter = "113 mm"', "diameter = 113", r"pulley\.pump\.diameter: found 113; a bare number is in meters, millimeters are written \"113 mm\""),
        ('face = "back"', 'face = "back"\nfriction = 0.3\ngroove_angle = "40 deg"', r"pulley\.idler\.groove_angle: belongs to a pulley with face = 'grooved' and friction"),
        ('face = "grooved"\ndriver', 'face = "grooved"\nfriction = 0.3\ngroove_angle = "200 deg"\ndriver', r"pulley\.crank\.groove_angle: found '200 deg'; give the angle between the flanks"),
        ('face = "grooved"\ndriver', 'face = "grooved"\ngroove_angle = "40 deg"\ndriver', r"pulley\.crank\.groove_angle: belongs to .* friction"),
        ('{ effective = "1337.3 mm" }', '{ outside = "1.4 m" }', r"installation\.belt_length.*outside"),
        ('{ effective = "1337.3 mm" }', '"1337.3 mm"', r"installation\.belt_length: found '1337\.3 mm', along the effective line or along the neutral axis \(belt\.pitch_offset is between them\)\? Give \{ effective = \"1337\.3 mm\" \}, as makers print it, or \{ pitch = \"1337\.3 mm\" \}"),
        ('{ effective = "1337.3 mm" }', "1.3373", r"installation\.belt_length: found 1\.3373, .* Give \{ effective = 1\.3373 \}"),
        ('pitch_offset = "1.5 mm"', 'pitch_offset = "1.5 mm"\nstandard_lengths = [1.33, 1.36]', r"belt\.standard_lengths: found a list of 2, along .* Give \{ effective = \[\.\.\] \}"),
    ],
    ids=["face", "twice", "offset", "unit", "millimeters", "groove on the back", "angle", "no friction", "length", "which length", "which number", "which lengths"],
)  # fmt: skip
def test_what_does_not_fit_is_one_line(tmp_path, old, new, says):
    with pytest.raises(bj.FileError) as error:
        load(tmp_path, swap(RIBBED, old, new))
    assert re.search(says, str(error.value))


def test_a_study_bounds_the_length_that_the_file_gives(tmp_path):
    load(tmp_path, RIBBED)
    (tmp_path / "study.toml").write_text(
        'drive = "drive.toml"\n[objective]\nminimize = "path_length"\n[[variable]]\n'
        'name = "installation.belt_length"\nlower = "1330 mm"\nupper = "1345 mm"\n'
    )
    study = bj.optimize.load_study(tmp_path / "study.toml")
    excess = 2 * math.pi * 0.0015
    np.testing.assert_allclose(study.variables.lower, [1.330 + excess], rtol=1e-14)
    length = float(study.drive.installation.belt_length)
    shown = TableUnits(study.drive).of_number("installation.belt_length", length)
    assert shown == ("1337.3", "mm")


def test_a_length_has_one_meaning_where_both_lines_are_one(tmp_path):
    """Without an offset, or with none given, a bare length is that of the neutral axis."""
    bare = swap(RIBBED, '{ effective = "1337.3 mm" }', '"1337.3 mm"')
    drive, _ = load(tmp_path, swap(bare, 'pitch_offset = "1.5 mm"', "pitch_offset = 0"))
    assert float(drive.installation.belt_length) == 1.3373


def test_flanks_hold_like_a_wedge(tmp_path):
    """Classical V-belts: 0.3 between flanks of 40 degrees hold like 0.877 on a flat rim."""
    groove = swap(
        RIBBED,
        'face = "grooved"\ndriver',
        'face = "grooved"\nfriction = 0.3\ngroove_angle = "40 deg"\ndriver',
    )
    drive, _ = load(tmp_path, groove)
    assert float(drive.pulleys[0].friction) == pytest.approx(0.877, abs=5e-4)


def test_a_diameter_is_twice_the_radius(tmp_path):
    drive, _ = load(tmp_path, swap(THREE, "radius = 0.0889", 'diameter = "7 in"'))
    assert float(drive.pulleys[0].radius) == pytest.approx(0.0889, rel=1e-14)
