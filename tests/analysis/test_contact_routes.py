"""Second routes to a belt in contact: SciPy's, another installation rule, another listing."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from contact_drives import (
    equal,
    largest,
    mirrored,
    peer_of,
    relisted,
    seven,
    state,
    unequal,
    variant,
)
from drives import example

import beltjax as bj
from beltjax.validation.peers import contact as peer

TIGHT = (1e-6, 1e-9)  # the peer's tolerances: it is then good to a few 1e-10
slow = pytest.mark.slow

DRIVES = {
    "equal": equal,
    "equal, thin layers": lambda: equal(EI=0.0015),
    "unequal": lambda: unequal(M2=20.0),
    "seven": seven,
    "seven, opposite travel": lambda: seven(torque=(0, 2, 0, 1, 0.1, 2), travel="opposite"),
    "three": lambda: three(torque=1.0),
}


def three(torque):
    drive, point = example("three_pulley")
    friction = [p.friction for p in drive.pulleys]
    assert friction == [None] * 3
    drive = eqx.tree_at(
        lambda d: [p.friction for p in d.pulleys],
        drive,
        [jnp.asarray(0.5)] * 3,
        is_leaf=lambda x: x is None,
    )
    return drive, bj.OperatingPoint(belt_speed=point.belt_speed, torque={"accessory": torque})


def assert_like_the_peer(found, other, order, spans, rel):
    """Every number of both, in the peer's order."""
    assert found.feasible
    forward = np.all(order == np.arange(len(order)))
    ends = slice(None) if forward else slice(None, None, -1)
    tensions = np.asarray(found.tensions)[spans][:, ends]
    peers = np.stack([other.tension_start, other.tension_middle, other.tension_end], axis=1)
    assert tensions == pytest.approx(peers, rel=rel)
    assert np.asarray(found.span_lengths)[spans] == pytest.approx(other.lengths, rel=rel)
    unstretched = np.asarray(found.unstretched_span_lengths)[spans]
    assert unstretched == pytest.approx(other.unstretched_lengths, rel=rel)
    for ours, theirs in (("wraps", "wraps"), ("slips", "slip"), ("adhesions", "adhesion")):
        expected = getattr(other, theirs)
        assert np.asarray(getattr(found, ours))[order] == pytest.approx(expected, abs=rel), ours
    assert np.asarray(found.moments)[order] == pytest.approx(other.moments, rel=rel, abs=1e-9)
    assert np.asarray(found.pulley_speeds)[order] == pytest.approx(other.pulley_speeds, rel=rel)
    numbers = ("efficiency", "unstretched_length", "mass_flow")
    for name in numbers:
        assert float(getattr(found, name)) == pytest.approx(getattr(other, name), rel=rel), name
    assert float(found.unstretched_speed) == pytest.approx(other.reference_speed, rel=rel)
    if other.arm_angle is not None:
        assert float(found.arm_angle) == pytest.approx(other.arm_angle, abs=rel)
        assert float(found.free_angle) == pytest.approx(other.free_angle, abs=rel)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=slow if name == "three" else ()) for name in DRIVES]
)
def test_scipy_finds_the_same_belt(name):
    drive, point = DRIVES[name]()
    theirs, order, spans = peer_of(drive, point)
    other = peer.contact_state(theirs, *TIGHT)
    assert_like_the_peer(state(drive, point), other, order, spans, 1e-8)


@pytest.mark.parametrize("name", ["equal", "unequal", pytest.param("seven", marks=slow)])
def test_scipy_finds_the_same_largest_torques(name):
    drive, point = DRIVES[name]()
    theirs, order, spans = peer_of(drive, point)
    other = peer.maximum_moment(theirs, *TIGHT)
    found = largest(drive, point)
    assert float(found.torque_factor) == pytest.approx(other.factor, rel=1e-8)
    assert_like_the_peer(found, other, order, spans, 1e-7)


@slow
@pytest.mark.parametrize("name", ["equal", "unequal", "seven"])
def test_a_belt_of_that_length_is_the_same_belt(name):
    drive, point = DRIVES[name]()
    first = state(drive, point)
    rule = bj.BeltGiven(first.unstretched_length, first.free_angle)
    held = eqx.tree_at(lambda d: d.installation, drive, rule)
    for solve in (state, largest):
        given, found = solve(drive, point), solve(held, point)
        assert found.feasible
        for field in ("wraps", "adhesions", "tensions", "speeds", "angles", "efficiency"):
            expected = np.asarray(getattr(given, field))
            assert np.asarray(getattr(found, field)) == pytest.approx(expected, rel=1e-9), field


def test_the_rules_for_the_speed_agree():
    # Table 5.1's mass flow and driver speed, as a belt of the mass and speed that they make.
    given = state(*equal())
    mass = float(given.mass_flow / given.unstretched_speed)
    drive, _ = unequal()
    like, point = equal()
    places = [lambda d: d.belt.axial_stiffness, lambda d: d.belt.bending_stiffness]
    places += [lambda d: d.installation.tension]
    places += [lambda d, k=k: d.pulleys[k].center for k in (0, 1)]
    places += [lambda d, k=k: d.pulleys[k].radius for k in (0, 1)]
    places += [lambda d, k=k: d.pulleys[k].friction for k in (0, 1)]
    for place in places:
        drive = eqx.tree_at(place, drive, place(like))
    point = unequal(M2=2.0, c=given.unstretched_speed)[1]
    found = state(*variant(drive, point, m0=mass))
    for field in ("wraps", "adhesions", "tensions", "pulley_speeds", "unstretched_length"):
        expected = np.asarray(getattr(given, field))
        assert np.asarray(getattr(found, field)) == pytest.approx(expected, rel=1e-10), field
    assert float(found.mass_flow) == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize("name", ["equal", "unequal", "seven", "seven, opposite travel"])
def test_neither_the_side_one_looks_from_nor_the_order_of_the_list_matters(name):
    drive, point = DRIVES[name]()
    found, behind = state(drive, point), state(*mirrored(drive, point))
    listed = state(*relisted(drive, point))
    n = len(drive.pulleys)
    order = -np.arange(n) % n
    spans = (order - 1) % n
    for field in ("wraps", "slips", "adhesions", "moments", "tensions", "speeds", "angles"):
        value = np.asarray(getattr(found, field))
        assert np.asarray(getattr(behind, field)) == pytest.approx(value, rel=1e-9, abs=1e-12)
        other = np.asarray(getattr(listed, field))
        # Start and end of a span change places when it is listed the other way.
        other = other[spans][:, ::-1] if value.ndim == 2 else other[order]
        other = -other if field == "angles" else other
        assert other == pytest.approx(value, rel=1e-9, abs=1e-12), field
    assert float(behind.unstretched_length) == pytest.approx(float(found.unstretched_length))


def test_a_belt_that_runs_the_other_way_has_its_tight_span_on_the_other_side():
    drive, point = equal()
    there = state(drive, point)
    back = state(drive, eqx.tree_at(lambda p: p.travel, point, -point.travel))
    # The drive is symmetric about the line of its centers.
    assert np.asarray(back.tensions)[::-1] == pytest.approx(np.asarray(there.tensions), rel=1e-12)
    assert np.asarray(back.wraps) == pytest.approx(np.asarray(there.wraps), rel=1e-12)
    assert there.tensions[1, 1] > there.tensions[0, 1]
