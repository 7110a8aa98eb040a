"""Tied and snapped variables, against geometry by hand of two idlers that mirror each other."""

import math
import re

import numpy as np
import pytest
from scipy.optimize import brentq
from small_drives import belt, pulley

import beltjax as bj

# Two pulleys above each other, and an idler that presses the belt inwards on either side.
DRIVE = (
    belt()
    + 'pitch = "5 mm"\n'
    + pulley("crank", 0.0, 0.0, 0.08, more="driver = true")
    + pulley("right", 0.09, 0.2, 0.03, "back")
    + pulley("pump", 0.0, 0.4, 0.08)
    + pulley("left", -0.09, 0.2, 0.03, "back")
    + """
[installation]
tension = 400.0
[operation]
belt_speed = 0.0
"""
)
STUDY = """
drive = "drive.toml"
[objective]
minimize = "path_length"
[[variable]]
name = "pulley.right.center.x"
lower = "70 mm"
upper = "105 mm"
[[tie]]
name = "pulley.left.center.x"
to = "pulley.right.center.x"
mirror = "0 mm"
[[constraint]]
quantity = "wrap:crank"
lower = "200 deg"
[optimizer]
starts = 2
"""
RADII = """
[[variable]]
name = "pulley.right.radius"
lower = "25 mm"
upper = "40 mm"
snap = ["30 mm", "36 mm"]
[[tie]]
name = "pulley.left.radius"
to = "pulley.right.radius"
"""


def tilt(x, r):
    """By how much a span leans, from the inner tangent of radii 0.08 and r at (x, 0.2)."""
    d = math.hypot(x, 0.2)
    return math.asin((0.08 + r) / d) - math.atan2(x, 0.2)


def wrap(x, r):
    return math.pi + 2 * tilt(x, r)


def length(x, r):
    span = math.sqrt(x**2 + 0.2**2 - (0.08 + r) ** 2)
    return 4 * span + 2 * 0.08 * wrap(x, r) + 2 * r * 2 * tilt(x, r)


def limited(r):
    """The idlers' distance from the middle at which the crank has 200 degrees."""
    return brentq(lambda x: wrap(x, r) - math.radians(200), 0.07, 0.12, xtol=1e-15)


def minimized(folder, study):
    (folder / "drive.toml").write_text(DRIVE)
    (folder / "study.toml").write_text(study)
    return bj.optimize.minimize(bj.optimize.load_study(folder / "study.toml"))


@pytest.mark.slow
def test_two_idlers_move_together_as_mirror_images(tmp_path):
    design = minimized(tmp_path, STUDY)
    x = limited(0.03)
    assert design.success
    assert design.values["pulley.right.center.x"] == pytest.approx(x, rel=1e-8)
    assert design.values["pulley.left.center.x"] == pytest.approx(-x, rel=1e-8)
    wraps = np.asarray(design.steady.reference.layout.wraps)
    np.testing.assert_allclose(wraps[[0, 2]], math.radians(200), rtol=1e-8)
    assert design.final == pytest.approx(length(x, 0.03), rel=1e-10)
    assert design.initial == pytest.approx(length(0.09, 0.03), rel=1e-12)
    # The price counts both idlers: the slope of the length over that of the wrap, along the tie.
    h = 1e-6
    slopes = [(f(x + h, 0.03) - f(x - h, 0.03)) / (2 * h) for f in (length, wrap)]
    (limit,) = (c for c in design.constraints if c.quantity == "wrap:crank")
    assert limit.multiplier == pytest.approx(slopes[0] / slopes[1], rel=1e-6)


@pytest.mark.slow
def test_a_snapped_radius_lets_the_others_be_optimized_again(tmp_path):
    design = minimized(tmp_path, swapped(STUDY, "[[constraint]]", RADII + "[[constraint]]"))
    best = min((0.025, 0.04), key=lambda r: length(limited(r), r))
    taken = {0.025: 0.03, 0.04: 0.036}[best]
    assert design.success
    assert design.snapped.values == {"pulley.right.radius": pytest.approx(taken, rel=1e-15)}
    assert design.snapped.before["pulley.right.radius"] == pytest.approx(best, rel=1e-8)
    assert design.values["pulley.left.radius"] == pytest.approx(taken, rel=1e-15)
    assert design.values["pulley.left.center.x"] == pytest.approx(-limited(taken), rel=1e-8)
    lost = length(limited(taken), taken) - length(limited(best), best)
    assert design.snapped.loss == pytest.approx(lost, rel=1e-6)
    assert lost > 0
    with pytest.raises(ValueError, match="snapped variables are no optimum"):
        bj.optimize.post_optimal(bj.optimize.load_study(tmp_path / "study.toml"), design)


@pytest.mark.slow
def test_where_all_is_snapped_nothing_is_searched(run, tmp_path):
    """The crank keeps its 200 degrees only at the farther of the two places."""
    study = swapped(STUDY, 'upper = "105 mm"', 'upper = "105 mm"\nsnap = ["72 mm", "0.078 m"]')
    (tmp_path / "drive.toml").write_text(DRIVE)
    (tmp_path / "study.toml").write_text(study)
    status, out, _ = run("optimize", "study.toml", "--json", "out.json", "--report", "out.html")
    near = min(
        (0.072, 0.078), key=lambda x: length(x, 0.03) if wrap(x, 0.03) > math.radians(200) else 9
    )
    assert status == 0
    lost = length(near, 0.03) - length(limited(0.03), 0.03)
    assert re.search(
        rf"snapped: pulley\.right\.center\.x from \S+ to {1e3 * near:g} mm;",
        re.sub(r"\s+", " ", out),
    )
    assert f"by {lost:+.3g}" in re.sub(r"\s+", " ", out)
    assert "snapped" in (tmp_path / "out.html").read_text()


def swapped(text, old, new):
    assert old in text
    return text.replace(old, new, 1)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('to = "pulley.right.center.x"', 'to = "pulley.right.center.y"', r"tie\.pulley\.left\.center\.x\.to: found 'pulley\.right\.center\.y', which is no \[\[variable\]\]"),
        ('mirror = "0 mm"', 'mirror = "5 mm"', r"tie\.pulley\.left\.center\.x: the drive has -0\.09, and by this tie it would have -0\.08"),
        ('mirror = "0 mm"', "factor = 0.0", r"tie\.\S+\.factor: found 0\.0; give a number other than 0"),
        ('mirror = "0 mm"', 'mirror = "0 mm"\noffset = "1 mm"', r"tie\.\S+\.mirror: takes the place of factor and offset"),
        ('name = "pulley.left.center.x"', 'name = "pulley.left.center.z"', r"tie\.pulley\.left\.center\.z: is not a number of this drive"),
        ('name = "pulley.left.center.x"', 'name = "pulley.right.center.x"', r"tie\.pulley\.right\.center\.x: is a variable; a tied"),
        ('name = "pulley.left.center.x"', 'name = "belt.bending_stiffness"', r"to: is in m, and the tied number in N m\^2"),
        ('upper = "105 mm"', 'upper = "105 mm"\nsnap = "teeth"', r"snap: found 'teeth'; give \"teeth\" for the radius"),
        ('upper = "105 mm"', 'upper = "105 mm"\nsnap = ["1 m"]', r"snap: has no value within the variable's bounds"),
        ('mirror = "0 mm"', 'miror = "0 mm"', r"tie\.\S+\.miror: is not a known key; did you mean 'mirror'"),
    ],
    ids=["to", "not kept", "factor", "both", "unknown", "itself", "kinds", "teeth", "none", "near"],
)  # fmt: skip
def test_what_does_not_fit_is_one_line(tmp_path, old, new, says):
    (tmp_path / "drive.toml").write_text(DRIVE)
    (tmp_path / "study.toml").write_text(swapped(STUDY, old, new))
    with pytest.raises(bj.FileError) as error:
        bj.optimize.load_study(tmp_path / "study.toml")
    assert re.search(says, str(error.value))


def test_radii_snap_to_whole_numbers_of_teeth(tmp_path):
    """5 mm once for each tooth: of 27 to 37 mm of radius the teeth are 34 to 46."""
    study = swapped(STUDY, "[[constraint]]", RADII + "[[constraint]]")
    study = swapped(study, '"25 mm"', '"27 mm"').replace('"40 mm"', '"37 mm"')
    study = swapped(study, 'snap = ["30 mm", "36 mm"]', 'snap = "teeth"')
    (tmp_path / "drive.toml").write_text(DRIVE)
    (tmp_path / "study.toml").write_text(study)
    (snap,) = bj.optimize.load_study(tmp_path / "study.toml").snaps
    np.testing.assert_allclose(snap.values, 0.005 * np.arange(34, 47) / (2 * np.pi), rtol=1e-14)


@pytest.mark.parametrize(
    ("listed", "values"),
    [("standard_lengths = [1.28, 1.31, 1.4]\n", [1.28, 1.31]), ("", 0.005 * np.arange(256, 265))],
    ids=["of a list", "of teeth"],
)
def test_a_belt_s_length_snaps_to_those_on_sale(tmp_path, listed, values):
    drive = swapped(DRIVE, "tension = 400.0", "belt_length = 1.3")
    (tmp_path / "drive.toml").write_text(
        swapped(drive, 'pitch = "5 mm"', listed + 'pitch = "5 mm"')
    )
    study = swapped(STUDY, "pulley.right.center.x", "installation.belt_length").split("[[tie]]")[0]
    study = swapped(study, '"70 mm"', '"1.28 m"').replace('"105 mm"', '"1.32 m"\nsnap = "standard"')
    (tmp_path / "study.toml").write_text(study)
    (snap,) = bj.optimize.load_study(tmp_path / "study.toml").snaps
    np.testing.assert_allclose(snap.values, values, rtol=1e-14)
