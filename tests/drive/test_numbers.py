"""Every number of a drive by its key: its unit, its value, and what is set and moved with it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies_cases import TWIN, TWO_ARMS, load, swap, text_of
from compilations import compilations
from drives import EXAMPLES, example

import beltjax as bj
from beltjax.drive.canonical import canonical, canonical_drive
from beltjax.drive.numbers import (
    canonical_key,
    named_numbers,
    number_names,
    number_value,
    require_number,
    require_numbers,
    unit_of,
    variable_names,
    with_number,
    with_numbers,
)

THREE = (EXAMPLES / "three_pulley.toml").read_text()


def case(tmp_path, number):
    return load(tmp_path, text_of(number))


@pytest.mark.parametrize("number", ["03", "08", "10", "12", "16", "18", "24"])
def test_numbers_set_to_what_they_are_change_nothing(number, tmp_path):
    drive, point = case(tmp_path, number)
    names = number_names(drive)
    assert len(set(names)) == len(names)
    for name in names:
        same = with_number(drive, point, name, number_value(drive, point, name))
        for a, b in zip(jax.tree.leaves(drive), jax.tree.leaves(same[0]), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-14, atol=1e-16)
        assert float(point.speed(drive)) == pytest.approx(float(same[1].speed(drive)), rel=1e-14)


@pytest.mark.parametrize("number", ["03", "10", "16", "18", "24"])
def test_each_number_moves_the_same_leaf_in_the_canonical_drive(number, tmp_path):
    drive, point = case(tmp_path, number)
    there = canonical(drive, point)
    assert len({canonical_key(drive, name) for name in number_names(drive)}) == len(
        number_names(drive)
    )
    for name in number_names(drive):
        key, value = canonical_key(drive, name), number_value(drive, point, name) + 0.125
        own = canonical(*with_number(drive, point, name, value))
        for a, b in zip(
            jax.tree.leaves(own), jax.tree.leaves(with_number(*there, key, value)), strict=True
        ):
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    ("number", "name", "unit"),
    [
        ("03", "tensioner.stiffness", "N m/rad"),
        ("03", "tensioner.tensioner.pivot.x", "m"),
        ("03", "tensioner.angle", "rad"),
        ("03", "belt.belt.bending_stiffness", "N m^2"),
        ("03", "pulley.power steering.friction", ""),
        ("08", "tensioner.slide.stiffness", "N/m"),
        ("08", "tensioner.stiffness", "N/m"),
        ("08", "tensioner.slide.inertia", "kg"),
        ("08", "tensioner.slide.damping", "N s/m"),
        ("10", "arm_spring.twin.stiffness", "N m/rad"),
        ("10", "tensioner.twin.1.inertia", "kg m^2"),
        ("12", "tensioner.lever.mass_center.y", "m"),
        ("16", "isolator.alternator.stiffness", "N m/rad"),
        ("16", "damper.crankshaft.inertia", "kg m^2"),
        ("18", "installation.tension.second", "N"),
        ("18", "belt.second.mass_per_length", "kg/m"),
        ("18", "isolator.crankshaft.rim_inertia", "kg m^2"),
        ("24", "installation.free.arm", "rad"),
        ("24", "installation.until", "rad"),
        ("24", "installation.belt_length", "m"),
        ("24", "operation.torque.cam", "N m"),
        ("24", "operation.driver_speed", "rad/s"),
    ],
)
def test_numbers_have_the_units_of_their_owners(number, name, unit, tmp_path):
    drive, _ = case(tmp_path, number)
    require_number(drive, name)
    assert unit_of(drive, name) == unit


def test_a_spring_between_slides_has_the_units_of_slides(tmp_path):
    slides = TWO_ARMS.replace('pulley = "tensioner"\n', 'kind = "linear"\npulley = "tensioner"\n')
    slides = slides.replace('pulley = "idler"\n', 'kind = "linear"\npulley = "idler"\n')
    slides = slides.replace("pivot = [-0.088, 0.239529869]", 'direction = "10 deg"')
    slides = slides.replace("pivot = [-0.11, 0.36]", 'direction = "70 deg"')
    spring = '[[arm_spring]]\nname = "s"\nbetween = ["t1", "t2"]\nstiffness = "2 N/mm"\n'
    rule = 'tension = 350.0\nfree = {s = "2 mm"}'
    drive, _ = load(tmp_path, swap(slides, "tension = 350.0", rule) + spring)
    assert float(drive.arm_springs[0].stiffness) == 2000.0
    assert unit_of(drive, "arm_spring.s.stiffness") == "N/m"
    assert unit_of(drive, "installation.free.s") == "m"
    assert "stiffness 2000 N/m" in repr(drive)


def test_names_that_are_none_are_led_on():
    drive, _ = example("three_pulley")
    with pytest.raises(ValueError, match=r"no number 'tensioner.stifness' .* tensioner.stiffness"):
        require_number(drive, "tensioner.stifness")
    with pytest.raises(ValueError, match="given twice"):
        require_numbers(drive, ["tensioner.stiffness", "tensioner.tensioner.stiffness"])
    with pytest.raises(ValueError, match="one speed"):
        require_numbers(drive, ["operation.belt_speed", "operation.driver_speed"])
    for name in ("tensioner.direction.x", "operation.torque.crankshaft", "pulley.accessory.face"):
        with pytest.raises(ValueError, match="there is no number"):
            require_number(drive, name)
    # A number that the file leaves out may be set all the same.
    require_number(drive, "tensioner.damping")
    assert "tensioner.damping" not in number_names(drive)


def test_variables_are_the_numbers_that_a_designer_chooses(tmp_path):
    drive, _ = case(tmp_path, "18")
    names = variable_names(drive)
    assert {"tensioner.t1.angle", "tensioner.second arm.arm_length"} <= set(names)
    assert {"belt.second.axial_stiffness", "installation.tension.main"} <= set(names)
    assert not {"tensioner.t1.inertia", "pulley.fan.inertia"} & set(names)
    slide, _ = case(tmp_path, "08")
    assert not [name for name in variable_names(slide) if name.endswith("angle")]


def test_each_arm_turns_about_its_own_pulleys(tmp_path):
    drive, point = case(tmp_path, "06")
    turn = {"tensioner.t1.angle": 0.2, "tensioner.alternator arm.arm_length": jnp.array(0.11)}
    moved, _ = with_numbers(drive, point, {name: jnp.asarray(x) for name, x in turn.items()})
    before, after = bj.layout(drive).arms, bj.layout(moved).arms
    a, b = (complex(*np.asarray(arms[0])) for arms in (before, after))
    assert b / a == pytest.approx(np.exp(0.2j))
    old, new = np.asarray(before[1]), np.asarray(after[1])
    np.testing.assert_allclose(new, 0.11 * old / np.hypot(*old), rtol=1e-14)
    np.testing.assert_array_equal(drive.centers, moved.centers)


def test_the_mass_of_an_arm_turns_with_it(tmp_path):
    drive, point = case(tmp_path, "12")
    moved, _ = with_number(drive, point, "tensioner.lever.angle", jnp.array(0.3))
    body, other = drive.tensioners[1], moved.tensioners[1]
    before = complex(*np.asarray(body.mass_center - body.pivot))
    after = complex(*np.asarray(other.mass_center - other.pivot))
    assert after / before == pytest.approx(np.exp(0.3j))
    assert (moved.tensioners[0].mass_center == 0).all()


def test_a_free_angle_turns_with_its_arm_and_is_not_wound_by_the_cut(tmp_path):
    rule = 'belt_length = 1.51\nfree_angle = "-30 deg"'
    drive, point = load(tmp_path, swap(THREE, "tension = 300.0", rule))
    drawn = np.arctan2(*np.asarray(bj.layout(drive).arms[0])[::-1])
    for turn in (0.1, -3.1, 3.0):
        moved, _ = with_number(drive, point, "tensioner.angle", jnp.array(turn))
        now = np.arctan2(*np.asarray(bj.layout(moved).arms[0])[::-1])
        wound = float(moved.installation.free_angle) - now
        assert wound == pytest.approx(-np.pi / 6 - drawn, abs=1e-12)


def test_a_rim_keeps_its_distance_unless_it_is_set(tmp_path):
    text = swap(THREE, "radius = 0.02697", "radius = 0.02697\nrim_radius = 0.025")
    drive, point = load(tmp_path, text)
    radius = {"pulley.accessory.radius": jnp.array(0.03)}
    moved, _ = with_numbers(drive, point, radius)
    assert float(moved.pulleys[2].rim_radius) == pytest.approx(0.025 + 0.03 - 0.02697)
    both = {"pulley.accessory.rim_radius": jnp.array(0.02)} | radius
    assert float(with_numbers(drive, point, both)[0].pulleys[2].rim_radius) == 0.02


def test_gradients_are_named_like_their_drive(tmp_path):
    drive, point = case(tmp_path, "10")

    def path(d):
        return bj.layout(d).path_length

    gradient = jax.grad(path)(drive)
    named = named_numbers(gradient, point, (drive, point))
    assert named.keys() == named_numbers(drive, point).keys()
    assert named["pulley.right.center"].shape == (2,)
    h = 1e-6
    for name in ("pulley.right.center.x", "pulley.bsg.radius"):
        sides = [
            with_number(drive, point, name, number_value(drive, point, name) + s) for s in (h, -h)
        ]
        slope = (path(sides[0][0]) - path(sides[1][0])) / (2 * h)
        field = name.removesuffix(".x")
        assert float(np.ravel(named[field])[0]) == pytest.approx(float(slope), rel=1e-6)


def test_units_of_the_file_are_kept_for_tables_and_compile_nothing(tmp_path):
    text = swap(THREE, "radius = 0.0889", 'radius = "88.9 mm"')
    text = swap(text, "center = [0.0, 0.0]", 'center = ["0 cm", 0]')
    text = swap(text, "tension = 300.0", 'tension = "0.3 kN"')
    text = swap(text, "belt_speed = 20.0", 'driver_speed = "750 rpm"')
    text = swap(text, "accessory = 0.0", 'accessory = "2 lbf in"')
    plain, _ = load(tmp_path, THREE)
    path = jax.jit(lambda d: bj.layout(d).path_length)
    path(plain)
    bj.layout(plain)
    drive, _ = load(tmp_path, text)
    with compilations() as seen:
        path(drive)
        bj.layout(drive)
    assert seen == [0]
    assert jax.tree.structure(plain) == jax.tree.structure(drive)
    assert not canonical_drive(drive).units
    assert dict(drive.units) == {
        "pulley.crankshaft.radius": "mm",
        "pulley.accessory.center.x": "cm",
        "installation.tension": "kN",
        "operation.driver_speed": "rpm",
        "operation.torque.accessory": "lbf in",
    }


def test_units_of_a_twin_arm_go_to_its_arms_and_its_spring(tmp_path):
    text = swap(TWIN, "inertia = [0.0024, 0.0024]", 'inertia = ["24 kg cm^2", 0.0024]')
    text = swap(text, "stiffness = 60", 'stiffness = "60 N m/rad"')
    text = swap(text, "pivot = [0.05, 0.3]", 'pivot = ["50 mm", 0.3]')
    drive, _ = load(tmp_path, text)
    assert dict(drive.units) == {
        "tensioner.twin.0.inertia": "kg cm^2",
        "arm_spring.twin.stiffness": "N m/rad",
        "tensioner.twin.0.pivot.x": "mm",
        "tensioner.twin.1.pivot.x": "mm",
    }
