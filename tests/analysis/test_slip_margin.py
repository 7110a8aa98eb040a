"""Margins against sliding, in steady running and in motion, and the angle of entry."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drives import example
from squealing import with_laws

import beltjax as bj
from beltjax.compiling.quick import quickly_compiled

BASIS = bj.Legendre(6)
DAMPING = bj.Damping(modal=0.02)
CRANK = bj.Excitation(crank=0.004)


@pytest.mark.slow
def test_static_margin_is_that_of_the_steady_state():
    drive, point = example("seven_pulley")
    steady = bj.steady_state(drive, point)
    found = bj.slip_margin(drive, point)
    assert found.dynamic is None
    friction = np.array([float(pulley.friction) for pulley in drive.pulleys])
    expected = friction * steady.reference.layout.wraps - steady.slip_exponents
    np.testing.assert_allclose(found.static, expected, rtol=1e-13)
    # What holds the belt is friction before it slides.
    held = bj.slip_margin(with_laws(drive), point).static
    expected = 0.6 * steady.reference.layout.wraps - steady.slip_exponents
    np.testing.assert_allclose(held, expected, rtol=1e-13)


def three_pulleys():
    drive, point = example("three_pulley")
    return with_laws(drive), point


def margin_over_time(drive, point, parts):
    """The least margin on a fine grid of times, from responses one by one."""
    steady = bj.steady_state(drive, point)
    lin = bj.linearize(steady, BASIS)
    speed = float(point.speed(drive)) / float(drive.drives @ drive.radii)
    base = min(parts)
    t = np.linspace(0, 2 * np.pi / (base * speed), 20001)
    Q = np.asarray(steady.effective_tensions * steady.scales.tension)[None]
    for order, excitation in parts.items():
        at = bj.frequency_response(lin, order * speed, excitation, damping=DAMPING)
        swing = np.asarray(at.tensions[0])
        Q = Q + (swing * np.exp(1j * order * speed * t)[:, None]).real
    use = np.abs(np.log(Q / np.roll(Q, 1, axis=1))).max(axis=0)
    friction = np.array([float(pulley.holding) for pulley in drive.pulleys])
    return friction * np.asarray(steady.reference.layout.wraps) - use


@pytest.mark.slow
def test_dynamic_margin_by_a_second_route():
    drive, point = three_pulleys()
    found = bj.slip_margin(drive, point, CRANK, order=3.0, damping=DAMPING, basis=BASIS)
    expected = margin_over_time(drive, point, {3.0: CRANK})
    np.testing.assert_allclose(found.dynamic, expected, atol=1e-7)
    assert np.all(np.asarray(found.dynamic) < np.asarray(found.static))
    several = bj.Orders({2: bj.Excitation(crank=0.003), 4: bj.Excitation(crank=0.001j)})
    found = bj.slip_margin(drive, point, several, damping=DAMPING, basis=BASIS)
    expected = margin_over_time(drive, point, several.excitations)
    np.testing.assert_allclose(found.dynamic, expected, atol=1e-7)


@pytest.mark.slow
def test_margin_of_a_small_periodic_motion_is_that_of_the_response():
    drive, point = three_pulleys()
    apart = []
    for crank in (1e-5, 1e-6):
        small = bj.Excitation(crank=crank)
        motion = bj.periodic_response(
            drive, point, bj.Orders({2: small}), harmonics=2, basis=BASIS, damping=DAMPING,
            stability=False,
        )  # fmt: skip
        found = bj.slip_margin(drive, point, motion=motion)
        linear = bj.slip_margin(drive, point, small, damping=DAMPING, basis=BASIS)
        gone = np.asarray(linear.static - linear.dynamic)
        apart.append(np.asarray(found.static - found.dynamic) / gone - 1)
    # What the response leaves out is of second order in the amplitude.
    assert np.abs(apart[0]).max() < 0.01
    np.testing.assert_allclose(apart[1], apart[0] / 10, atol=2e-5)
    use = 1 - np.asarray(found.dynamic) / np.asarray(found.static + bj.steady_state(
        drive, point).slip_exponents)  # fmt: skip
    np.testing.assert_allclose(use, motion.friction_use, rtol=1e-9)


def test_the_excitation_of_the_file_is_taken():
    drive, point = three_pulleys()
    given = dataclasses.replace(point, excitation=bj.ExcitationGiven(crank=0.004, order=3.0))
    own = bj.slip_margin(drive, given, damping=DAMPING, basis=BASIS)
    asked = bj.slip_margin(drive, point, CRANK, order=3.0, damping=DAMPING, basis=BASIS)
    np.testing.assert_array_equal(own.dynamic, asked.dynamic)


@pytest.fixture(scope="module")
def lanes():
    drive, point = three_pulleys()

    def at(x):
        moved = eqx.tree_at(
            lambda d: (d.installation.tension, d.pulleys[2].friction_static, d.pulleys[2].radius),
            drive, tuple(x[:3]),
        )  # fmt: skip
        found = bj.slip_margin(
            moved, point, bj.Excitation(crank=x[3]), damping=DAMPING, basis=BASIS, throw=False
        )
        return jnp.stack([found.static[2], found.dynamic[2]]), found.result

    x = jnp.array([300.0, 0.8, 0.027, 0.004])
    along = x * jnp.array([0.3, -1.0, 0.5, 0.8])

    def of_lane(x):
        value, forward, result = jax.jvp(at, (x,), (along,), has_aux=True)
        return value, forward, jax.jacrev(lambda x: at(x)[0])(x), result

    h = 1e-4 * np.asarray(x)
    steps = np.concatenate([c * np.diag(h) for c in (-2, -1, 1, 2)])
    bad = np.asarray(x) * np.array([[-1.0, 1, 1, 1], [1, 1, np.nan, 1]])
    found = quickly_compiled(jax.vmap(of_lane))(jnp.concatenate([x[None], x + steps, bad]))
    return h, along, found


@pytest.mark.slow
def test_derivatives_three_ways(lanes):
    h, along, (values, forward, reverse, _) = lanes
    np.testing.assert_allclose(forward[0], reverse[0] @ along, rtol=1e-9)
    m2, m1, p1, p2 = np.split(np.asarray(values[1:17]), 4)
    differences = ((m2 - p2) + 8 * (p1 - m1)).T / (12 * h)
    size = np.max(np.abs(reverse[0]) * h, axis=1, keepdims=True) / h
    assert np.max(np.abs(reverse[0] - differences) / size) < 1e-6


@pytest.mark.slow
def test_a_bad_lane_leaves_its_neighbors_alone(lanes):
    _, _, (values, forward, reverse, result) = lanes
    good = np.asarray(result == bj.RESULTS.successful)
    np.testing.assert_array_equal(good[[0, -2, -1]], [True, False, False])
    for part in (values, forward, reverse):
        assert np.all(np.isfinite(part))
        np.testing.assert_array_equal(np.asarray(part)[-2:], 0)


def test_a_pulley_without_friction_holds_for_ever():
    drive, point = three_pulleys()
    none = dict.fromkeys(("friction", "friction_static", "friction_speed"))
    bare = dataclasses.replace(drive.pulleys[1], **none)
    drive = dataclasses.replace(drive, pulleys=(drive.pulleys[0], bare, drive.pulleys[2]))
    assert np.isinf(bj.slip_margin(drive, point).static[1])


def test_entry_angle():
    drive, _ = three_pulleys()
    moved = dataclasses.replace(drive.pulleys[2], offset=0.002)
    there = dataclasses.replace(drive, pulleys=(*drive.pulleys[:2], moved))
    lengths = np.asarray(bj.layout(drive).span_lengths)
    expected = np.array([0.0, 0.002, 0.002]) / lengths
    np.testing.assert_allclose(bj.entry_angles(there), expected, rtol=1e-13)
    np.testing.assert_array_equal(bj.entry_angles(drive), 0.0)

    def angle(offset):
        other = eqx.tree_at(lambda d: d.pulleys[2].offset, there, offset)
        return bj.entry_angles(other, jnp.asarray(lengths))[1]

    assert float(jax.grad(angle)(jnp.asarray(-0.001))) == pytest.approx(-1 / lengths[1])
