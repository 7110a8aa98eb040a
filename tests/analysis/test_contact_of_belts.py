"""Contact of several belts at once: what shafts and bodies carry from belt to belt.

Drives of one belt, solved alone at the speed and torque of their shaft, are the second route where
belts share shafts; where a body moves two belts it is the running string's exact statics.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from closed_belt import balances
from contact_laws import data_of
from drives import three_ways
from scipy.optimize import fsolve

import beltjax as bj
from beltjax.drive.numbers import number_value, with_numbers

MAIN, SECOND = 0, 1
TORQUES = {"alternator": 6.0, "fan": 5.0}
ALONE = ("wraps", "slips", "tensions", "speeds", "span_lengths", "moments", "pulley_speeds")


def two_belts(bending=(0.02, 0.01), *, shared=False):
    """Four pulleys, one on an arm, and a second belt that the second pulley's shaft drives.

    With `shared` the arm moves the second belt, too.
    """
    on = [1.0]
    pulleys = [
        bj.Pulley("crank", (0.0, 0.0), 0.07, driver=True, belt="main", friction=0.8),
        bj.Pulley("jackshaft", (0.36, 0.05), 0.05, belt="main", friction=0.8),
        bj.Pulley("alternator", (0.16, 0.30), 0.03, belt="main", friction=0.8),
        bj.Pulley("tensioner", (0.03, 0.17), 0.03, face="back", belt="main", on=on, friction=0.8),
        bj.Pulley("sheave", (0.36, 0.05), 0.04, belt="second", shaft="jackshaft", friction=0.8),
        bj.Pulley("idler", (0.50, -0.16), 0.03, belt="second", friction=0.8),
        bj.Pulley("fan", (0.66, 0.10), 0.06, belt="second", friction=0.8),
    ]
    if shared:
        pulleys[5] = dataclasses.replace(pulleys[5], on=on)
    arm = bj.Tensioner(pivot=(0.02, 0.10), stiffness=60.0)
    belts = [
        bj.Belt(
            axial_stiffness=9e4, bending_stiffness=bending[0], mass_per_length=0.1, name="main"
        ),
        bj.Belt(
            axial_stiffness=6e4, bending_stiffness=bending[1], mass_per_length=0.07, name="second"
        ),
    ]
    rule = bj.TensionGiven([450.0, 300.0])
    return bj.Drive(belts, pulleys, rule, arm)


def one_of(drive, places, belt, tensions, moved=True):
    """The pulleys of one belt as a drive, the first of them driving."""
    pulleys = [
        dataclasses.replace(drive.pulleys[p], belt=None, shaft=None, driver=float(k == 0))
        for k, p in enumerate(places)
    ]
    if not moved:
        pulleys = [dataclasses.replace(p, on=np.zeros(0)) for p in pulleys]
    rule = bj.TensionGiven(tensions)
    return bj.Drive(drive.belts[belt], pulleys, rule, drive.tensioners if moved else ())


@pytest.fixture(scope="module")
def both():
    drive = two_belts()
    point = bj.OperatingPoint(driver_speed=150.0, torque=TORQUES)
    return drive, point, bj.contact_state(drive, point)


@pytest.mark.slow
def test_each_belt_runs_as_it_does_alone_on_its_shaft(both):
    drive, point, found = both
    passed = float(found.moments[1])
    assert passed == pytest.approx(-float(found.moments[4]), rel=1e-12)
    first = bj.contact_state(
        one_of(drive, range(4), MAIN, 450.0),
        dataclasses.replace(point, torque={"alternator": 6.0, "jackshaft": passed}),
    )
    at = bj.OperatingPoint(driver_speed=first.pulley_speeds[1], torque={"fan": 5.0})
    second = bj.contact_state(one_of(drive, range(4, 7), SECOND, 300.0, moved=False), at)
    for part, places in ((first, slice(0, 4)), (second, slice(4, 7))):
        for field in ALONE:
            expected = np.asarray(getattr(part, field))
            np.testing.assert_allclose(
                np.asarray(getattr(found, field))[places], expected, rtol=1e-10, err_msg=field
            )
    np.testing.assert_allclose(found.coordinates, first.coordinates, rtol=1e-9)
    lengths = [float(part.unstretched_length) for part in (first, second)]
    np.testing.assert_allclose(found.unstretched_length, lengths, rtol=1e-12)
    flows = [float(part.mass_flow) for part in (first, second)]
    np.testing.assert_allclose(found.mass_flow, flows, rtol=1e-11)
    # What the second belt loses is lost of what the first one passes on.
    power = [float(m * w) for m, w in zip(first.moments, first.pulley_speeds, strict=True)]
    given, taken = -power[0], power[2] + float(second.efficiency) * power[1]
    assert float(found.efficiency) == pytest.approx(taken / given, rel=1e-11)
    assert float(found.driver_moment) == pytest.approx(float(first.driver_moment), rel=1e-12)


def test_every_balance_of_both_belts_closes(both):
    found = both[-1]
    for belt in (MAIN, SECOND):
        left = balances(*data_of(found, belt=belt))
        for field in ("start", "end", "gap", "P", "moments", "friction_moments", "pulley_forces"):
            assert np.max(np.abs(getattr(left, field))) < 1e-10, field
        assert abs(left.unstretched_length) < 1e-12


def running_strings(drive, c, ratio):
    """Coordinate and tension P = T - G V of both belts without bending, friction at work or torque.

    Statics by SciPy, of belts with uniform tension: lengths, the moment on the arm, and the speed
    that the shaft gives to the second belt's surface, `ratio` times the first one's.
    """
    loops = drive.loops
    EA, mass = (
        np.array([float(getattr(belt, key)) for belt in drive.belts])
        for key in ("axial_stiffness", "mass_per_length")
    )
    rest, spring = np.array([450.0, 300.0]), float(drive.tensioners[0].stiffness)

    def path(q):
        at = bj.layout(drive, jnp.array([q]))
        return np.asarray(loops.sums(at.span_lengths + at.arc_lengths))

    def widening(q, step=1e-4):
        near, far = (path(q + k * step) - path(q - k * step) for k in (1, 2))
        return (8 * near - far) / (12 * step)

    lengths = path(0.0) / (1 + rest / EA)
    relaxed = widening(0.0) @ rest

    def unmet(unknown):
        q, P = unknown[0], unknown[1:]
        first = (EA[0] + P[0]) / (EA[0] - mass[0] * c**2)
        speed = fsolve(
            lambda V: V * (EA[1] + P[1]) / (EA[1] - mass[1] * V**2) - ratio * c * first, ratio * c
        )[0]
        g = mass * np.array([c, speed]) ** 2
        stretched = (EA + P) / (EA - g)
        moment = widening(q) @ P + spring * q - relaxed
        return np.concatenate([path(q) / stretched / lengths * 1e4 - 1e4, [moment]])

    return fsolve(unmet, [0.0, *(rest - mass * c**2)], xtol=1e-12)


@pytest.mark.slow
def test_an_arm_that_moves_two_belts_stands_where_the_exact_strings_hold_it():
    drive = two_belts((0.0, 0.0), shared=True)
    found = bj.contact_state(drive, bj.OperatingPoint(belt_speed=30.0))
    q, *P = running_strings(drive, 30.0, 0.04 / 0.05)
    assert abs(q) > 1e-3
    assert float(found.coordinates[0]) == pytest.approx(q, rel=1e-8)
    levels = np.asarray(found.solved.loop.C)[[0, 4]] * float(found.scales.tension)
    np.testing.assert_allclose(levels, P, rtol=1e-9)


@pytest.mark.slow
def test_derivatives_of_a_shared_body_three_ways():
    drive = two_belts(shared=True)
    point = bj.OperatingPoint(belt_speed=20.0, torque=TORQUES)
    places = (
        "tensioner.stiffness", "belt.second.bending_stiffness", "belt.main.axial_stiffness",
        "pulley.sheave.radius", "operation.torque.fan", "operation.belt_speed",
        "installation.tension.second",
    )  # fmt: skip
    own = jnp.stack([jnp.asarray(number_value(drive, point, place), float) for place in places])

    def answers(numbers):
        moved = with_numbers(drive, point, dict(zip(places, numbers, strict=True)))
        state = bj.contact_state(*moved, throw=False)
        parts = state.tensions.ravel(), state.wraps, state.coordinates, state.efficiency[None]
        return jnp.concatenate(parts)

    forward, reverse, differences, size = three_ways(answers, own, 1e-4)
    size = np.maximum(size, 1e-9)
    assert np.max(np.abs(forward - reverse) / np.maximum(np.abs(forward), 1e-6 * size)) < 1e-7
    assert np.max(np.abs(forward - differences) / np.maximum(np.abs(forward), 1e-3 * size)) < 1e-5


def test_belts_run_backwards_as_they_do_forwards_in_a_mirror():
    """Listed the other way round and driven against the list, every belt meets the same pulleys."""
    drive = two_belts()
    point = bj.OperatingPoint(driver_speed=150.0, torque=TORQUES)
    flipped = tuple(
        dataclasses.replace(p, center=p.center * jnp.array([-1.0, 1.0])) for p in drive.pulleys
    )
    pivot = drive.tensioners[0].pivot * jnp.array([-1.0, 1.0])
    mirrored = eqx.tree_at(
        lambda d: (d.pulleys, d.tensioners[0].pivot, d.sense), drive, (flipped, pivot, -drive.sense)
    )
    one, other = bj.contact_state(drive, point), bj.contact_state(mirrored, point)
    for field in ("wraps", "slips", "tensions", "moments", "pulley_speeds"):
        np.testing.assert_allclose(getattr(one, field), getattr(other, field), rtol=1e-9)
    np.testing.assert_allclose(one.coordinates, -np.asarray(other.coordinates), rtol=1e-8)
    against = dataclasses.replace(point, travel="opposite", torque={"fan": 5.0})
    back = bj.contact_state(drive, against)
    assert not np.any(back.forward)
    for belt in (MAIN, SECOND):
        left = balances(*data_of(back, belt=belt))
        assert np.max(np.abs(left.gap)) < 1e-10
        assert np.max(np.abs(left.friction_moments)) < 1e-10


def test_mass_flow_is_that_of_one_belt():
    point = bj.OperatingPoint(driver_speed=150.0, mass_flow=1.0, torque=TORQUES)
    with pytest.raises(ValueError, match="mass_flow is that of a single belt"):
        bj.contact_state(two_belts(), point)


def test_a_shaft_that_passes_torque_needs_friction():
    drive = two_belts()
    bare = dataclasses.replace(drive.pulleys[4], friction=None)
    drive = dataclasses.replace(drive, pulleys=(*drive.pulleys[:4], bare, *drive.pulleys[5:]))
    with pytest.raises(
        ValueError, match=r"pulley\.sheave\.friction is missing; this pulley has torque"
    ):
        bj.contact_state(drive, bj.OperatingPoint(driver_speed=150.0, torque=TORQUES))
