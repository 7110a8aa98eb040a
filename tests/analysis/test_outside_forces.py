"""Preloads, constant forces and weights that tension a belt, against statics by hand."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies_cases import LEVER, load, swap
from drives import flat_numbers, three_ways
from small_drives import PRESSED, belt, pulley

import beltjax as bj
from beltjax.drive.bodies import bodies, outside_forces

# A motor hangs on a rocker to the left of a fan and below its pivot: its weight tightens the belt.
# The fan is called the driver: its motion is given, and the motor's torque is what it gives.
ROCKER = (
    "gravity = [0.0, -9.81]"
    + belt(EA="1e13")
    + pulley("motor", 0.0, 0.0, 0.05, more='housing = "arm"')
    + pulley("fan", 0.6, 0.1, 0.15, more="driver = true")
    + """
[[tensioner]]
name = "rocker"
pulley = "motor"
pivot = [-0.1, 0.25]
mass = 30.0
mass_center = [0.02, -0.03]
[operation]
belt_speed = 0.0
torque = { motor = -6.0 }
"""
)
# A conveyor's belt turns round a drum on a carriage, which a weight pulls away from the head.
TAKE_UP = (
    belt(EA="4e5", mass=6.0)
    + pulley("tail", 0.0, 0.0, 0.25, more="friction = 0.35")
    + pulley("head", 12.0, 0.0, 0.25, more="friction = 0.35\ndriver = true")
    + """
[[tensioner]]
name = "carriage"
kind = "linear"
pulley = "tail"
direction = "180 deg"
force = "9 kN"
[operation]
belt_speed = 1.6
torque = { tail = 150.0 }
"""
)
ARM = (
    PRESSED
    + """[tensioner]
pulley = "idler"
pivot = [0.08, 0.14]
stiffness = "20 N m/rad"
preload = "-12 N m"
[operation]
belt_speed = 20.0
"""
)


def tangents(first, second, r1, r2):
    """Tangent points on the first circle of both outer tangents, and the directions to the second.

    The upper one, left of the line of centers, comes first.
    """
    apart = np.subtract(second, first)
    d = np.hypot(*apart)
    along, left = apart / d, np.array([-apart[1], apart[0]]) / d
    sin = (r2 - r1) / d
    cos = np.sqrt(1 - sin**2)
    found = []
    for side in (1.0, -1.0):
        direction = cos * along + side * sin * left
        normal = side * cos * left - sin * along
        found.append((np.add(first, r1 * normal), direction))
    return found


def moment(arm, force):
    return arm[0] * force[1] - arm[1] * force[0]


def test_a_pivoted_motor_balances_its_weight_and_the_belt(tmp_path):
    """Moments about the pivot of motor, rocker and pulley as one free body, and T1 - T2 = M/r."""
    drive, point = load(tmp_path, ROCKER)
    pivot, center = np.array([-0.1, 0.25]), np.array([0.02, -0.03])
    (up, along_up), (low, along_low) = tangents([0, 0], [0.6, 0.1], 0.05, 0.15)
    weight = moment(center - pivot, [0.0, -30 * 9.81])
    # The belt runs counterclockwise: the motor, listed first, pulls the span that arrives, the
    # upper one, by 6 N m/r more than the one that leaves below.
    rows = np.array([[moment(up - pivot, along_up), moment(low - pivot, along_low)], [1.0, -1.0]])
    upper, lower = np.linalg.solve(rows, [-weight, 6.0 / 0.05])
    rest = bj.reference_state(drive, point)
    np.testing.assert_allclose(rest.tensions, [lower, upper], rtol=1e-9)
    assert abs(float(rest.coordinates[0])) < 1e-9
    bare = dataclasses.replace(point, torque={})
    alone = -weight / (rows[0] @ [1, 1])
    np.testing.assert_allclose(bj.reference_state(drive, bare).tensions, [alone] * 2, rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("given", ["", '[installation]\nbelt_length = "25.5 m"\n'])
def test_a_weight_on_the_take_up_pulls_two_strands(tmp_path, given):
    """The strands are parallel: together they carry the weight, whatever belt and torque."""
    text = swap(TAKE_UP, 'force = "9 kN"', "mass = 1000.0")
    text = swap(text, "[belt]", "gravity = [-9.0, -3.0]\n[belt]")
    for kind in (TAKE_UP, text):
        drive, point = load(tmp_path, swap(kind, "[operation]", given + "[operation]"))
        rest = bj.reference_state(drive, point)
        step = 150.0 / 0.25
        np.testing.assert_allclose(rest.tensions, [4500 + step / 2, 4500 - step / 2], rtol=1e-9)
        # Half the circle on each drum, and both strands of the length that is left.
        path = 25.5 * (1 + 4500 / 4e5) if given else 24 + np.pi / 2
        strand = (path - np.pi / 2) / 2
        bare = bj.reference_state(drive, dataclasses.replace(point, torque={}))
        np.testing.assert_allclose(12 + bare.coordinates, strand, rtol=1e-9)
        # Under way the belt's momentum takes its part of each strand's tension.
        runs = bj.steady_state(drive, point)
        flux = 6.0 * 1.6**2
        assert float(jnp.sum(runs.running_tensions) - 2 * flux) == pytest.approx(9000, rel=1e-9)


@pytest.mark.slow
def test_contact_finds_the_same_weight(tmp_path):
    """Each strand's pull on the drum is its tension less the momentum that it brings."""
    drive, point = load(tmp_path, TAKE_UP)
    found = bj.contact_state(drive, point)
    pulls = found.tensions[:, 1] - found.mass_flow * found.speeds[:, 0]
    assert float(jnp.sum(pulls)) == pytest.approx(9000, rel=1e-9)
    held = swap(ROCKER, "1e13", "1e7").replace(
        'face = "grooved"', 'face = "grooved"\nfriction = 0.8'
    )
    rocker, given = load(tmp_path, held)
    found, string = bj.contact_state(rocker, given), bj.reference_state(rocker, given)
    np.testing.assert_allclose(found.tensions[:, 1], string.tensions, rtol=1e-4)


TWO = """
[[belt]]
name = "first"
axial_stiffness = 2e5
bending_stiffness = 0.0
mass_per_length = 0.5
[[belt]]
name = "second"
axial_stiffness = 1e5
bending_stiffness = 0.0
mass_per_length = 0.3
[[pulley]]
name = "a"
belt = "first"
center = [0.0, 0.0]
radius = 0.2
face = "grooved"
[[pulley]]
name = "b"
belt = "first"
center = [2.0, 0.0]
radius = 0.2
face = "grooved"
driver = true
[[pulley]]
name = "c"
belt = "second"
shaft = "b"
center = [2.0, 0.0]
radius = 0.1
face = "grooved"
[[pulley]]
name = "d"
belt = "second"
center = [2.0, 1.5]
radius = 0.1
face = "grooved"
[[tensioner]]
name = "left"
kind = "linear"
pulley = "a"
direction = [-1, 0]
force = 700.0
[[tensioner]]
name = "up"
kind = "linear"
pulley = "d"
direction = [0, 1]
stiffness = "5 N/mm"
preload = 260.0
[operation]
belt_speed = 0.0
"""


def test_each_belt_has_the_tension_of_its_own_weight_or_spring(tmp_path):
    rest = bj.reference_state(*load(tmp_path, TWO))
    np.testing.assert_allclose(rest.tensions, [350, 350, 130, 130], rtol=1e-12)
    np.testing.assert_allclose(rest.base_tensions, [350, 130], rtol=1e-12)


@pytest.mark.parametrize(
    "preload",
    [
        '"-12 N m"',
        f'{-12 - 20 * np.radians(5)}\nat_angle = "{np.degrees(np.arctan2(-0.09, 0.12)) + 5} deg"',
    ],
    ids=["drawn", "at an angle"],
)
def test_a_preload_presses_the_idler_into_the_belt(tmp_path, preload):
    """Its moment about the pivot against that of two equal tensions on the idler."""
    drive, point = load(tmp_path, swap(ARM, '"-12 N m"', preload))
    _, (_, along) = tangents([0.2, 0.05], [0.4, 0.0], 0.03, -0.08)
    pull = [0.0, 2 * along[1]]  # the other span is its mirror image
    tension = 12 / moment([0.12, -0.09], pull)
    np.testing.assert_allclose(bj.reference_state(drive, point).tensions, tension, rtol=1e-9)
    # With the belt that this is, the same spring stands in the same place.
    length = float(bj.reference_state(drive, point).unstretched_length)
    text = swap(ARM, '"-12 N m"', preload).replace(
        "[operation]", f"[installation]\nbelt_length = {length!r}\n[operation]"
    )
    again = bj.reference_state(*load(tmp_path, text))
    np.testing.assert_allclose(again.tensions, tension, rtol=1e-9)
    assert abs(float(again.coordinates[0])) < 1e-11


def test_weights_resist_with_the_slope_of_their_moments(tmp_path):
    """On a chain of two bodies, against automatic derivatives of the forces."""
    drive, _ = load(tmp_path, LEVER)
    drive = dataclasses.replace(drive, gravity=np.array([1.3, -9.81]))
    of, given, at = bodies(drive), outside_forces(drive), jnp.array([0.2, -0.3])
    slope = jax.jacfwd(lambda q: given.push(of, q))(at)
    np.testing.assert_allclose(given.stiffness(of, at), -slope, rtol=1e-12, atol=1e-12)
    assert np.abs(slope).max() > 0.1


def test_a_hanging_body_resists_like_a_pendulum(tmp_path):
    """m g times the depth of its center below the pivot, beside a constant moment of its size."""
    text = ROCKER.replace('face = "grooved"', 'face = "grooved"\ninertia = 0.01')
    text = swap(swap(text, "1e13", "1e5"), "torque = { motor = -6.0 }", "")
    hanging, point = load(tmp_path, swap(text, "mass = 30.0", "inertia_center = 0.2\nmass = 30.0"))
    weight = 30 * 9.81
    pushed = dataclasses.replace(
        hanging,
        gravity=None,
        tensioners=(dataclasses.replace(hanging.tensioners[0], force=-weight * 0.12),),
    )
    stiffness = []
    for drive in (hanging, pushed):
        found = bj.linearize(bj.steady_state(drive, point), basis=bj.Sine(2))
        stiffness.append(float(found.stiffness[-1, -1] * found.scales.energy))
    assert stiffness[0] - stiffness[1] == pytest.approx(weight * 0.28, rel=1e-9)


@pytest.mark.slow
def test_derivatives_by_weights_and_forces(tmp_path):
    """Forward, reverse and by differences, of tensions and the arm, by every number of the file."""
    text = swap(swap(ROCKER, "1e13", "1e5"), "mass = 30.0", 'mass = 30.0\nforce = "2 N m"')
    text = swap(text, "bending_stiffness = 0.0", "bending_stiffness = 0.02")
    text = swap(text, "belt_speed = 0.0", "belt_speed = 10.0")
    drive, point = load(tmp_path, text)
    names, values, put = flat_numbers(drive, point)

    def at(numbers):
        steady = bj.steady_state(*put(numbers), throw=False)
        rest = steady.reference
        return jnp.concatenate([rest.tensions, rest.coordinates, steady.running_tensions])

    slopes = three_ways(at, values, 1e-3)
    assert np.all(np.abs(slopes.forward - slopes.reverse) <= 1e-9 * slopes.size)
    # There is no spring whose stiffness is below 0, so that this one has no difference.
    others = [place for place, name in enumerate(names) if not name.endswith("rocker.stiffness")]
    apart = np.abs(slopes.forward - slopes.differences) / slopes.size
    assert apart[:, others].max() <= 1e-6
    for name in ("gravity[1]", "tensioner.rocker.mass", "tensioner.rocker.force"):
        assert np.abs(slopes.forward[:, names.index(name)]).max() > 1e-3
