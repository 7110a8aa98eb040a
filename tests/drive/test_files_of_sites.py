"""A drive in the coordinates of its site is the drive in its own, to the last digits."""

import re
from decimal import Decimal

import jax
import numpy as np
import pytest
from bodies_cases import load
from drives import EXAMPLES

import beltjax as bj
from beltjax.commands.reports.units import TableUnits
from beltjax.drive.files import drive_content, load_geometry

SITE = ("481250.25", "5340120.5")
THREE = (EXAMPLES / "three_pulley.toml").read_text()


def moved(text, unit=None):
    """The points of a file moved to the site, by decimals as a surveyor writes them."""

    def point(match):
        parts = [Decimal(part.strip()) for part in match[2].split(",")]
        sums = [part + Decimal(shift) for part, shift in zip(parts, SITE, strict=True)]
        if unit == "mm":
            sums = [f'"{1000 * part} mm"' for part in sums]
        return f"{match[1]} = [{', '.join(map(str, sums))}]"

    return re.sub(r"(center|pivot) = \[([^\]]*)\]", point, text)


@pytest.mark.parametrize("unit", [None, "mm"])
def test_no_result_loses_a_digit(tmp_path, unit):
    near, point = load(tmp_path, THREE)
    far, same = load(tmp_path, moved(THREE, unit))
    assert far.origin == (481250.0, 5340120.0)
    # The site is (0.25, 0.5) further than the origin: both are exact in a double.
    np.testing.assert_allclose(far.centers - near.centers, [[0.25, 0.5]] * 3, rtol=0, atol=2e-16)
    state, other = bj.steady_state(near, point), bj.steady_state(far, same)
    for name in ("coupling", "running_tensions", "hub_loads", "coordinate_change", "effectiveness"):
        np.testing.assert_allclose(
            getattr(other, name), getattr(state, name), rtol=1e-11, atol=1e-13, err_msg=name
        )
    for name in ("tensions", "unstretched_lengths", "arm_angle", "free_angle"):
        found = getattr(other.reference, name)
        np.testing.assert_allclose(found, getattr(state.reference, name), rtol=1e-12)


def test_of_a_given_belt_too(tmp_path):
    """A strain of a thousandth, of which a nanometer would be a millionth."""
    near, point = load(tmp_path, THREE)
    rest = bj.reference_state(near, point)
    rule = (
        f"belt_length = {float(rest.unstretched_length)!r}\nfree_angle = {float(rest.free_angle)!r}"
    )
    held = re.sub(r"\[installation\]\n(?:#.*\n)?[^\[]*", f"[installation]\n{rule}\n\n", THREE)
    far = bj.reference_state(*load(tmp_path, moved(held)))
    np.testing.assert_allclose(far.tensions, rest.tensions, rtol=1e-10)


def test_a_saved_file_has_the_same_drive(tmp_path):
    drive, point = load(tmp_path, moved(THREE))
    bj.save_drive(tmp_path / "saved.toml", drive, point)
    again, same = bj.load_drive(tmp_path / "saved.toml")
    assert again.origin == drive.origin
    assert drive_content(again, same) == drive_content(drive, point)
    assert jax.tree.all(jax.tree.map(lambda a, b: (a == b).all(), drive, again))


def test_geometry_alone_is_moved_too(tmp_path):
    (tmp_path / "sheet.toml").write_text(moved(THREE))
    drive, *_ = load_geometry(tmp_path / "sheet.toml")
    assert drive.origin == (481250.0, 5340120.0)
    assert float(np.abs(drive.centers).max()) < 2


STUDY = """
drive = "drive.toml"
[objective]
minimize = "path_length"
[[variable]]
name = "pulley.accessory.center.x"
lower = {lower}
upper = "{upper} m"
snap = [{snap}]
[[variable]]
name = "pulley.tensioner.center.y"
lower = {y_lower}
upper = {y_upper}
[[tie]]
name = "pulley.crankshaft.center.y"
to = "pulley.tensioner.center.y"
mirror = {mirror}
"""


def study_of(folder, text, shift):
    """Bounds, values on sale and a tie in the coordinates of the file, by decimals."""
    (folder / "drive.toml").write_text(text)
    x, y = map(Decimal, shift)
    numbers = {
        "lower": x - Decimal("0.02"),
        "upper": x + Decimal("0.03"),
        "snap": x + Decimal("0.01"),
        "y_lower": y + Decimal("0.05"),
        "y_upper": y + Decimal("0.06"),
        "mirror": y + (Decimal("0.0556") + Decimal("0.05715")) / 2,
    }
    (folder / "study.toml").write_text(STUDY.format(**numbers))
    return bj.optimize.load_study(folder / "study.toml")


def test_a_study_counts_from_where_the_drive_file_does(tmp_path):
    near = study_of(tmp_path, THREE, ("0", "0"))
    far = study_of(tmp_path, moved(THREE), SITE)
    # Of both drives the same numbers: the site's coordinates less an origin at whole meters.
    for of, by in ((far.variables.lower, near.variables.lower), (far.snaps[0].values, (0.01,))):
        np.testing.assert_allclose(np.asarray(of)[:1] - np.asarray(by)[:1], 0.25, atol=1e-9)
    np.testing.assert_allclose(far.variables.upper - near.variables.upper, [0.25, 0.5], atol=1e-9)
    np.testing.assert_allclose(far.ties.offsets - near.ties.offsets, 2 * 0.5, atol=1e-9)
    units = TableUnits(far.drive)
    assert units.of_number("pulley.accessory.center.x", 0.2625) == ("481250262.5", "mm")
    saved = tmp_path / "saved.toml"
    bj.save_drive(saved, far.drive, far.point)
    assert not bj.load_drive(saved)[0].units.shifts  # it counts from the origin that it states


@pytest.mark.parametrize(
    ("origin", "says"),
    [
        ("[0]", r"origin: found 1 items; give 2"),
        ('["1 N", 0]', r"origin.*found '1 N', whose unit is not m"),
    ],
)
def test_what_is_no_point_is_one_line(tmp_path, origin, says):
    with pytest.raises(bj.FileError) as error:
        load(tmp_path, f"origin = {origin}\n" + THREE)
    assert re.search(says, str(error.value))
