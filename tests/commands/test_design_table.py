"""The table of a design shows each variable in the unit in which the drive's file gives it."""

import io

from bodies_cases import load, swap
from drives import EXAMPLES
from rich.console import Console

from beltjax.commands.reports.optimize import _design_table

DESIGN = {"pulley.accessory.radius": 0.03, "tensioner.angle": 0.2, "tensioner.stiffness": 100.0}
DOCUMENT = {"design": DESIGN, "objective": {"initial": 5.0, "final": 3.0}}


def test_variables_are_shown_in_the_units_of_the_file(tmp_path):
    three = (EXAMPLES / "three_pulley.toml").read_text()
    drive, _ = load(tmp_path, swap(three, "radius = 0.02697", 'radius = "26.97 mm"'))
    out = io.StringIO()
    Console(file=out, width=120).print(_design_table(DOCUMENT, drive))
    rows = [line.split() for line in out.getvalue().splitlines()]
    assert ["pulley.accessory.radius", "26.97", "30", "mm"] in rows
    assert ["tensioner.angle", "0", "0.2", "rad"] in rows
    assert ["tensioner.stiffness", "116.4", "100", "N", "m/rad"] in rows
