"""Drives and results print as short tables, whatever else they are."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
from drives import example

import beltjax as bj


def test_a_drive_prints_its_numbers_with_names_and_units():
    drive, point = example("three_pulley")
    lines = repr(drive).splitlines()
    assert lines[0] == "Drive"
    assert len(lines) < 12
    rows = dict(re.split("  +", line.strip(), maxsplit=1) for line in lines[1:])
    assert rows["belt"].startswith("axial_stiffness 120000 N, bending_stiffness 0.015 N m^2")
    assert rows["pulley crankshaft"].startswith(
        "center (0.5525, 0.0556) m, radius 0.0889 m, face grooved"
    )
    assert rows["pulley crankshaft"].endswith(", driver")
    assert "face back" in rows["pulley tensioner"]
    assert "stiffness 116.4 N m/rad" in rows["tensioner"]
    assert rows["sense"] == "counterclockwise"
    assert rows["name"] == "three-pulley prototype"
    assert "belt_speed        20      m/s" in repr(point)
    assert repr(drive.pulleys[1]).splitlines()[0] == "Pulley"


def test_a_result_prints_its_ending_and_names_what_it_holds():
    drive, _ = example("three_pulley")
    at = bj.layout(drive)
    rows = [line.split() for line in repr(at).splitlines()]
    assert rows[0] == ["Layout"]
    assert ["path_lengths", "(1.51409)", "m"] in rows
    assert ["centers", "3", "x", "2", "numbers"] in rows
    assert rows[-1] == ["result", "successful"]
    page = at._repr_html_()
    assert "<caption>Layout</caption>" in page
    assert "<td>path_lengths</td><td>(1.51409)</td><td>m</td>" in page
    assert "<td>a &lt;b&gt;</td>" in bj.Pulley("a <b>", [0, 0], 0.1)._repr_html_()


def test_traced_batched_or_abstract_numbers_print_as_equinox_has_them():
    drive, _ = example("three_pulley")
    seen = []
    jax.jit(lambda d: (seen.append(repr(d)), d.belt.axial_stiffness)[1])(drive)
    batch = jax.tree.map(lambda x: jnp.stack([x, x]), drive)
    shapes = jax.eval_shape(lambda d: d, drive)
    static = eqx.partition(drive, eqx.is_array)[1]
    for text in (*seen, repr(batch), repr(shapes), repr(static), batch._repr_html_()):
        assert "Drive(" in text
        assert "axial_stiffness=" in text
