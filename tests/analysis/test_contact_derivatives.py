"""Derivatives of a belt in contact three ways; bad drives in a batch, and what each is called."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from contact_drives import equal, largest, seven, state, unequal
from drives import flat_numbers, three_ways

import beltjax as bj
from beltjax.analysis.contact import contact_solution
from beltjax.physics.belt_law import find_belt_law

slow = pytest.mark.slow
KONG = find_belt_law("kong")


def answers(drive, point, maximum):
    """Tensions, wraps, adhesions, efficiency, unstretched length, torque factor, arm angle."""
    found = contact_solution(drive, point, KONG, maximum)
    scalars = [found.efficiency, found.unstretched_length, found.torque_factor]
    if found.arm_angle is not None:
        scalars.append(found.arm_angle)
    parts = [found.tensions.ravel(), found.wraps, found.adhesions, jnp.stack(scalars)]
    return jnp.concatenate(parts), found


@slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", ["unequal", "seven"])
def test_forward_reverse_and_differences_agree(name):
    drive, point = {"unequal": lambda: unequal(M2=20.0), "seven": seven}[name]()
    names, values, put = flat_numbers(drive, point)
    # One program for both questions: the maximum is data, and its derivative zero.
    for maximum in (jnp.zeros(()), jnp.ones(())):

        def at(numbers, maximum=maximum):
            return answers(*put(numbers), maximum)[0]

        forward, reverse, differences, size = three_ways(at, values, 5e-5)
        assert np.all(np.isfinite(forward))
        size = np.maximum(size, 1e-9)  # a factor that is given moves with nothing
        # Beside rounding of the whole system: neither an adhesion that stays zero nor a number
        # that moves nothing (y of two pulleys on the x axis) has a size of its own.
        rounding = 1e-14 * np.max(size, axis=0)
        scale = np.maximum(np.abs(forward), 1e-6 * size)
        assert np.all(np.abs(forward - reverse) <= 1e-8 * scale + rounding)
        scale = np.maximum(np.abs(forward), 1e-3 * size)
        worst = np.abs(forward - differences) / scale
        # Under the largest torque one arc of adhesion is nothing, whatever the numbers.
        held = np.abs(np.asarray(at(values))) < 1e-12
        assert np.sum(held) == int(maximum)
        assert np.all(np.abs(forward[held]) <= 10 * rounding)
        worst[held] = 0.0
        # An idler's arc of slip, |ln(P_out/P_in)|/mu, has a kink where it takes no torque.
        torques = np.array([name.startswith("operation.torque") for name in names])
        kinks = torques & (np.asarray(values) == 0)
        worst = np.where(kinks, 0.0, worst)
        where = np.unravel_index(np.argmax(worst), worst.shape)
        assert worst.max() < 1e-5, f"d answer[{where[0]}]/d {names[where[1]]}"


def bad(drive, place, value):
    return eqx.tree_at(place, drive, jnp.asarray(value, dtype=float))


@slow
@pytest.mark.timeout(900)
def test_a_bad_drive_in_a_batch_is_its_own_affair():
    drive, point = unequal(M2=20.0)
    fast = unequal(EI=0.015, c=500.0, M2=20.0)[1]
    lanes = [
        ("successful", drive, point),
        ("numbers_unusable", bad(drive, lambda d: d.pulleys[0].radius, -0.01), point),
        ("numbers_unusable", bad(drive, lambda d: d.pulleys[1].radius, np.nan), point),
        ("numbers_unusable", bad(drive, lambda d: d.belt.bending_stiffness, np.inf), point),
        ("no_tangent", bad(drive, lambda d: d.pulleys[1].center, [0.01, 0.0]), point),
        ("belt_too_stiff", bad(drive, lambda d: d.belt.bending_stiffness, 0.2), point),
        ("contact_pressure_lost", drive, fast),
        ("successful", *unequal(EI=0.0, M2=20.0)),
        ("successful", drive, point),
    ]
    drives, points = zip(*[lane[1:] for lane in lanes], strict=True)
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), *zip(drives, points, strict=True))

    def look(drive, point):
        values, found = answers(drive, point, jnp.zeros(()))
        gradient = jax.grad(lambda d: jnp.sum(answers(d, point, jnp.zeros(()))[0]))(drive)
        return values, found.result, gradient

    values, results, gradients = jax.jit(jax.vmap(look))(*batch)
    alone = state(drive, point)
    for i, (name, _, _) in enumerate(lanes):
        result = jax.tree.map(lambda x, i=i: x[i], results)
        assert result == getattr(bj.RESULTS, name), f"lane {i}: {bj.RESULTS[result]}"
    for leaf in jax.tree.leaves((values, gradients)):
        assert np.all(np.isfinite(leaf))
    for leaf in map(np.asarray, jax.tree.leaves(gradients)):
        assert np.all(leaf[1:7] == 0.0)
        np.testing.assert_array_equal(leaf[0], leaf[-1])
    np.testing.assert_array_equal(values[0], values[-1])
    assert np.asarray(values[0, 6:8]) == pytest.approx(np.asarray(alone.wraps), rel=1e-12)


# What each result says, reached by a drive of which it is true.


def test_too_stiff_a_belt_cannot_be_bent_round_at_rest():
    # EI/(2 R^2) is the tension, 800 N, at EI = 0.16.
    assert state(*unequal(EI=0.15, c=0.0)).result != bj.RESULTS.belt_too_stiff
    assert state(*unequal(EI=0.2, c=0.0)).result == bj.RESULTS.belt_too_stiff


def test_gross_slip_beyond_the_largest_torque():
    at_most = float(largest(*equal()).driver_moment)
    assert state(*equal(M2=0.999 * at_most)).feasible
    beyond = state(*equal(M2=1.001 * at_most))
    assert beyond.result == bj.RESULTS.gross_slip
    assert np.min(beyond.adhesions) < 0


@pytest.mark.parametrize("solve", [state, largest])
def test_pressure_is_lost_above_the_critical_speed(solve):
    # Whatever the torque the belt of Table 5.3 would stand off its pulleys above 374.24 m/s.
    assert solve(*unequal(EI=0.0, c=373.9, M2=1e-3)).feasible
    assert solve(*unequal(EI=0.0, c=374.6, M2=1e-3)).result == bj.RESULTS.contact_pressure_lost


def test_pressure_is_lost_where_the_running_belt_cannot_be_bent_round():
    # At rest 800 N bend it round the driver, EI/(2 R^2) = 750 N; at 187 m/s G V takes 196 N.
    assert state(*unequal(EI=0.15)).result == bj.RESULTS.contact_pressure_lost


@pytest.mark.parametrize("speed", [0.85, 0.9, 1.0])
def test_a_stiff_belt_has_no_wrap_left_on_a_small_pulley(speed):
    # From 0.84837 of the critical speed not even a torque of nothing leaves the driver an arc.
    point = unequal(EI=0.05, c=speed * 374, M2=1e-6)
    found = state(*point)
    assert found.result == bj.RESULTS.wrap_vanished
    assert found.wraps[0] < 0
    assert largest(*point).result == bj.RESULTS.wrap_vanished


def test_nothing_to_scale():
    assert largest(*seven(torque=(0,) * 6)).result == bj.RESULTS.no_torque_to_scale
