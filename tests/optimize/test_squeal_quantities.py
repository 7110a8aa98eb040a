"""Quantities of squeal in studies: values, derivatives, and what they need."""

import dataclasses

import jax.numpy as jnp
import pytest
from drives import example
from quantities import measured
from squealing import with_laws

import beltjax as bj


def quiet_drive():
    drive, point = example("three_pulley")
    drive = with_laws(drive)
    belt = dataclasses.replace(drive.belt, longitudinal_damping=30.0)
    last = dataclasses.replace(drive.pulleys[2], offset=0.002)
    drive = dataclasses.replace(drive, belts=(belt,), pulleys=(*drive.pulleys[:2], last))
    return drive, dataclasses.replace(point, excitation=bj.ExcitationGiven(crank=0.004))


@pytest.mark.slow
def test_values():
    drive, point = quiet_drive()
    alone = bj.slip_stability(drive, point, "accessory")
    names = "squeal_speed", "critical_damping"
    values = alone.onset_speed, alone.critical_damping
    for name, value in zip(names, values, strict=True):
        assert measured(drive, point, f"{name}:accessory") == pytest.approx(float(value), rel=1e-12)
    length = bj.reference_state(drive, point).layout.span_lengths[2]
    angle = measured(drive, point, "entry_angle:accessory-crankshaft")
    assert angle == pytest.approx(0.002 / float(length), rel=1e-12)
    margin = measured(drive, point, "dynamic_slip_margin:accessory")
    found = bj.slip_margin(
        drive, point, damping=bj.Damping(modal=0.02), basis=bj.Legendre(12)
    ).dynamic
    assert margin == pytest.approx(float(found[2]), rel=1e-12)


@pytest.mark.parametrize(
    ("name", "changes", "text"),
    [
        ("squeal_speed:accessory", "law", "has no friction_static and friction_speed"),
        ("critical_damping:accessory", "damping", "has no longitudinal_damping"),
        ("dynamic_slip_margin:accessory", "excitation", "needs .excitation."),
        ("entry_angle:crankshaft-tensioner", "offset", "no pulley has an offset"),
        ("squeal_speed:pump", "", "no pulley 'pump'"),
    ],
)
def test_what_is_missing(name, changes, text):
    drive, point = quiet_drive()
    if changes == "law":
        drive = with_laws(drive, friction_static=None, friction_speed=None, friction_law=None)
    if changes == "damping":
        belt = dataclasses.replace(drive.belt, longitudinal_damping=None)
        drive = dataclasses.replace(drive, belts=(belt,))
    if changes == "offset":
        drive = with_laws(drive, offset=None)
    if changes == "excitation":
        point = dataclasses.replace(point, excitation=None)
    with pytest.raises(KeyError, match=text):
        bj.optimize.find_quantity(name, drive, point)


@pytest.mark.slow
def test_a_study_makes_a_belt_quiet(tmp_path):
    drive, point = quiet_drive()
    bj.save_drive(tmp_path / "drive.toml", drive, point)
    study = """
drive = "drive.toml"
[objective]
minimize = "span_length:crankshaft-tensioner"
[[variable]]
name = "installation.tension"
lower = 150
upper = 900
[[constraint]]
quantity = "squeal_speed:accessory"
upper = "0.8 m/s"
[optimizer]
starts = 1
"""
    (tmp_path / "study.toml").write_text(study)
    design = bj.optimize.minimize(bj.optimize.load_study(tmp_path / "study.toml"))
    found = bj.slip_stability(design.drive, point, "accessory")
    assert float(found.onset_speed) <= 0.8 + 1e-6
    assert jnp.isfinite(found.fold_speed)
