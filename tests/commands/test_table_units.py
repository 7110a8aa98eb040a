"""Tables show numbers in the units of the drive's file, results in those of their kind, or in SI."""

import io
import math

import equinox as eqx
import jax.numpy as jnp
import pytest
from bodies_cases import load, swap
from drives import EXAMPLES
from rich.console import Console

import beltjax as bj
from beltjax.commands.reports.analyze_tables import components, state_tables
from beltjax.commands.reports.optimize import _design_table
from beltjax.commands.reports.units import TableUnits
from beltjax.drive.installation import BELT_LENGTH

DESIGN = {"pulley.accessory.radius": 0.03, "tensioner.angle": 0.2, "tensioner.stiffness": 100.0}
DOCUMENT = {"design": DESIGN, "objective": {"initial": 5.0, "final": 3.0}}
THREE = (EXAMPLES / "three_pulley.toml").read_text()


def rows_of(table):
    out = io.StringIO()
    Console(file=out, width=120).print(table)
    return [line.split() for line in out.getvalue().splitlines()]


@pytest.fixture
def drive(tmp_path):
    """Two lengths in inches and one in centimeters, a force in kN, a torque in lbf in."""
    text = swap(THREE, "radius = 0.0889", 'radius = "3.5 in"')
    text = swap(text, "radius = 0.02697", 'radius = "1 in"')
    text = swap(text, "center = [0.0, 0.0]", 'center = ["0 cm", 0]')
    text = swap(text, "tension = 300.0", 'tension = "0.3 kN"')
    text = swap(text, "belt_speed = 20.0", 'driver_speed = "750 rpm"')
    text = swap(text, "accessory = 0.0", 'accessory = "2 lbf in"')
    return load(tmp_path, text)[0]


def test_variables_are_shown_in_the_units_of_the_file(drive):
    rows = rows_of(_design_table(DOCUMENT, drive, TableUnits(drive)))
    assert ["pulley.accessory.radius", "1", "1.1811", "in"] in rows
    assert ["tensioner.angle", "0", "11.4592", "deg"] in rows
    assert ["tensioner.stiffness", "116.4", "100", "N", "m/rad"] in rows
    rows = rows_of(_design_table(DOCUMENT, drive, TableUnits(drive, si=True)))
    assert ["pulley.accessory.radius", "0.0254", "0.03", "m"] in rows
    assert ["tensioner.angle", "0", "0.2", "rad"] in rows


@pytest.mark.parametrize(
    ("name", "value", "shown"),
    [
        ("pulley.crankshaft.radius", 0.0889, ("3.5", "in")),
        ("pulley.accessory.center.x", 0.1, ("10", "cm")),
        ("pulley.tensioner.radius", 0.0508, ("2", "in")),  # the file's usual length
        ("operation.driver_speed", 25 * math.pi, ("750", "rpm")),
        ("operation.torque.accessory", 0.226, ("2.00027", "lbf in")),
    ],
)
def test_a_number_has_the_unit_that_it_has_in_the_file(drive, name, value, shown):
    assert TableUnits(drive).of_number(name, value) == shown


def test_a_result_has_the_usual_unit_of_its_kind_and_as_many_digits_as_that_needs(drive):
    units, plain = TableUnits(drive), TableUnits(drive, si=True)
    assert units.head("length", "m") == "length (in)"
    assert units.text(0.1, "m", 1) == "3.94"  # an inch is 25 mm: one digit more than in mm
    assert units.text(1234.0, "N", 0) == "1.234"
    assert (units.head("load", "N"), plain.head("load", "N")) == ("load (kN)", "load (N)")
    assert plain.text(0.1, "m", 1) == "0.1000"
    assert plain.text(math.pi, "rad/s", 0) == "3.1"
    assert units.text(math.pi / 2, "rad", 1) == "90.0"  # the file gives no angle
    assert units.text(None, "N", 1) == "-"


@pytest.mark.parametrize(
    ("tension", "unit"),
    [("tension = 300.0", "N"), ('tension = "30 daN"', "daN"), ('tension = "67 lbf"', "lbf")],
)
def test_tensions_have_the_unit_of_tensions_and_not_that_of_a_stiffness(tmp_path, tension, unit):
    text = swap(THREE, "axial_stiffness = 120e3", 'axial_stiffness = "120 kN"')
    text = swap(text, "tension = 300.0", tension)
    units = TableUnits(load(tmp_path, text)[0])
    assert units.name("N") == unit
    assert units.unit_of_number("belt.axial_stiffness") == (pytest.approx(1e-3), "kN")


def test_a_belt_length_has_the_unit_of_belt_lengths(tmp_path):
    """A file in millimeters whose belt is in inches, as its maker prints it."""
    text = (EXAMPLES / "v_belt_slide.toml").read_text()
    plain = TableUnits(load(tmp_path, text)[0])
    units = TableUnits(load(tmp_path, swap(text, 'pitch = "1782 mm"', 'pitch = "70.16 in"'))[0])
    assert (units.name("m"), units.name("m", BELT_LENGTH)) == ("mm", "in")
    assert plain.name("m", BELT_LENGTH) == "mm"


def test_without_a_tension_forces_have_the_unit_of_the_preload(tmp_path):
    text = (EXAMPLES / "conveyor.toml").read_text()
    assert TableUnits(load(tmp_path, swap(text, '"24 kN"', '"5400 lbf"'))[0]).name("N") == "lbf"


def test_frequencies_are_in_hertz(drive):
    assert TableUnits(drive).of_quantity(2 * math.pi, "rad/s") == (pytest.approx(1.0), "Hz")
    assert TableUnits(drive, si=True).of_quantity(3.0, "rad/s") == (3.0, "rad/s")
    assert TableUnits(drive).of_quantity(3.0, "") == (3.0, "")


def test_the_two_numbers_of_gravity_have_keys_and_a_unit_of_their_own():
    drive, _ = bj.load_drive(EXAMPLES / "conveyor.toml")
    heavy = eqx.tree_at(lambda d: d.gravity, drive, jnp.array([0.0, -9.81]), is_leaf=_is_none)
    parts = components("gravity", [0.0, -9.81], [1.0, 2.0])
    assert parts == [("gravity.x", 0.0, 1.0), ("gravity.y", -9.81, 2.0)]
    assert TableUnits(heavy).of_number(parts[1][0], -9.81) == ("-9.81", "m/s^2")


def _is_none(part):
    return part is None


def test_a_drive_that_does_not_come_to_rest_has_no_table_of_its_tensioners(drive):
    spans, pulleys = state_tables(
        "no rest", {"spans": [], "pulleys": [], "coordinates": None}, None, TableUnits(drive)
    )
    assert (spans.row_count, pulleys.row_count) == (0, 0)
