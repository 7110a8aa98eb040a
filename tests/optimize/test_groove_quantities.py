"""Quantities of belts in grooves in studies."""

import dataclasses

import pytest
from drives import example
from quantities import measured

import beltjax as bj


def test_values_are_those_of_the_state():
    drive, point = example("two_pulley_groove")
    drive = dataclasses.replace(drive, contact=drive.contact._replace(model="thin"))
    state = bj.groove_state(drive, point, bj.ThinGroove())
    for name, value in (
        ("groove_efficiency", state.efficiency),
        ("slip:driven", state.slip[1]),
        ("penetration:driver", state.penetrations[0]),
    ):
        assert measured(drive, point, name) == pytest.approx(float(value), rel=1e-12)


def test_a_belt_without_grooves_has_none():
    drive, point = example("three_pulley")
    for name in ("groove_efficiency", "slip:accessory", "penetration:accessory"):
        with pytest.raises(KeyError, match="is of a belt in grooves"):
            bj.optimize.find_quantity(name, drive, point)
