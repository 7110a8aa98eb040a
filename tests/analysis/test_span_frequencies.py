"""Frequencies of a real drive's spans in hertz, against the string's formula and Legendre."""

import equinox as eqx
import jax
import jax.numpy as jnp
import legendre_beam
import numpy as np
import pytest
from drives import example
from moving_beams import compiled

import beltjax as bj

COUNT = 3
STEP = 1e-3  # of the mass per length, relative


def lanes():
    """The example; a string at rest; the example with more and less mass; one pushed."""
    drive, point = example("three_pulley")
    masses = drive.belt.mass_per_length * jnp.array([1.0, 1.0, 1 + STEP, 1 - STEP, 1.0])
    stiffnesses = drive.belt.bending_stiffness * jnp.array([1.0, 0.0, 1.0, 1.0, 1.0])
    speeds = jnp.array([20.0, 0.0, 20.0, 20.0, 20.0])
    tensions = jnp.array([300.0, 300.0, 300.0, 300.0, -5.0])
    return drive, point, (masses, stiffnesses, speeds, tensions)


@pytest.fixture(scope="module")
def answered():
    drive, point, numbers = lanes()

    def put(numbers):
        mass, stiffness, speed, tension = numbers
        changed = eqx.tree_at(
            lambda d: (d.belt.mass_per_length, d.belt.bending_stiffness, d.installation.tension),
            drive,
            (mass, stiffness, tension),
        )
        return changed, eqx.tree_at(lambda p: p.belt_speed, point, speed)

    def look(numbers):
        def hertz(mass):
            found = bj.span_frequencies(*put((mass, *numbers[1:])), count=COUNT, throw=False)
            return found.hertz, found

        slope, found = jax.jacfwd(hertz, has_aux=True)(numbers[0])
        return found, slope

    return drive, compiled(jax.vmap(look))(numbers)


def test_string_at_rest(answered):
    # f = n/(2 L) sqrt(P/m), by which tension meters work; the torque-free tension is the file's.
    drive, (found, _) = answered
    lengths = np.asarray(bj.layout(drive).span_lengths)
    np.testing.assert_allclose(found.tensions[1], 300.0, rtol=1e-9)
    string = np.arange(1, COUNT + 1) / (2 * lengths[:, None]) * np.sqrt(300 / 0.1029)
    np.testing.assert_allclose(found.hertz[1], string, rtol=1e-9)


def test_running_beam_by_its_own_numbers(answered):
    drive, (found, _) = answered
    lengths = np.asarray(bj.layout(drive).span_lengths)
    for i, (P, L) in enumerate(zip(np.asarray(found.tensions[0]), lengths, strict=True)):
        eps, v = np.sqrt(0.015 / P) / L, 20.0 * np.sqrt(0.1029 / P)
        omega = legendre_beam.frequencies(eps, v, ("simple", "simple"), COUNT, 80)
        hertz = omega * np.sqrt(P / 0.1029) / (2 * np.pi * L)
        np.testing.assert_allclose(found.hertz[0, i], hertz, rtol=1e-10)
        assert float(found.bending[0, i]) == pytest.approx(eps, rel=1e-12)
        assert float(found.speed[0, i]) == pytest.approx(v, rel=1e-12)


def test_derivative_with_respect_to_the_mass(answered):
    _, (found, slope) = answered
    difference = (found.hertz[2] - found.hertz[3]) / (2 * STEP * 0.1029)
    np.testing.assert_allclose(slope[0], difference, rtol=1e-5)


def test_bad_lane_is_reported_and_harmless(answered):
    _, (found, slope) = answered
    results = [jax.tree.map(lambda x, k=k: x[k], found.result) for k in (0, 4)]
    assert results[0] == bj.RESULTS.successful
    assert results[1] == bj.RESULTS.numbers_unusable
    assert np.all(found.hertz[4] == 0)
    assert np.all(slope[4] == 0)


def test_bad_input_is_named():
    drive, point = example("three_pulley")
    with pytest.raises(ValueError, match="ends: unknown support 'pinned'; give 'simple' or"):
        bj.span_frequencies(drive, point, ("pinned", "fixed"))
    with pytest.raises(ValueError, match="count: give a whole number of modes, 1 or more, not 0"):
        bj.span_frequencies(drive, point, count=0)
