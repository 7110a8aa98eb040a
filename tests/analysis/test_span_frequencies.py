"""Frequencies of a real drive's spans in hertz, against the string's formula and Legendre."""

import equinox as eqx
import jax
import legendre_beam
import numpy as np
import pytest
from drives import example

import beltjax as bj

EXAMPLE = example("three_pulley")
COUNT = 3


def drive_with(numbers):
    """The three-pulley example with other mass per length, stiffness, speed and tension."""
    mass, stiffness, speed, tension = numbers
    drive, point = EXAMPLE
    changed = eqx.tree_at(
        lambda d: (d.belt.mass_per_length, d.belt.bending_stiffness, d.installation.tension),
        drive,
        (mass, stiffness, tension),
    )
    return changed, eqx.tree_at(lambda p: p.belt_speed, point, speed)


def look(numbers):
    return bj.span_frequencies(*drive_with(numbers), count=COUNT, throw=False)


RUNNING = np.array([0.1029, 0.015, 20.0, 300.0])
BATCH = np.array([RUNNING, (0.1029, 0.0, 0.0, 300.0), (0.1029, 0.015, 20.0, -5.0)])


@pytest.fixture(scope="module")
def answered():
    """The example, a string at rest, and a drive that cannot be."""
    return EXAMPLE[0], jax.jit(jax.vmap(look))(BATCH)


def test_string_at_rest(answered):
    # f = n/(2 L) sqrt(P/m), by which tension meters work; the torque-free tension is the file's.
    drive, found = answered
    lengths = np.asarray(bj.layout(drive).span_lengths)
    np.testing.assert_allclose(found.tensions[1], 300.0, rtol=1e-9)
    string = np.arange(1, COUNT + 1) / (2 * lengths[:, None]) * np.sqrt(300 / 0.1029)
    np.testing.assert_allclose(found.hertz[1], string, rtol=1e-9)


def test_running_beam_by_its_own_numbers(answered):
    drive, found = answered
    lengths = np.asarray(bj.layout(drive).span_lengths)
    for i, (P, L) in enumerate(zip(np.asarray(found.tensions[0]), lengths, strict=True)):
        eps, v = np.sqrt(0.015 / P) / L, 20.0 * np.sqrt(0.1029 / P)
        omega = legendre_beam.frequencies(eps, v, ("simple", "simple"), COUNT, 80)
        hertz = omega * np.sqrt(P / 0.1029) / (2 * np.pi * L)
        np.testing.assert_allclose(found.hertz[0, i], hertz, rtol=1e-10)
        assert float(found.bending[0, i]) == pytest.approx(eps, rel=1e-12)
        assert float(found.speed[0, i]) == pytest.approx(v, rel=1e-12)


def test_bad_lane_is_reported_and_harmless(answered):
    _, found = answered
    results = [jax.tree.map(lambda x, k=k: x[k], found.result) for k in range(3)]
    assert results[0] == results[1] == bj.RESULTS.successful
    assert results[2] == bj.RESULTS.numbers_unusable
    assert np.all(found.hertz[2] == 0)


@pytest.mark.slow  # compiles the steady state and its derivative
def test_derivatives_with_respect_to_the_drive():
    @jax.jit
    @jax.vmap
    def both(numbers):
        return jax.jacrev(lambda numbers: look(numbers).hertz)(numbers), look(numbers).hertz

    slopes, _ = both(BATCH)
    assert np.all(slopes[2] == 0)
    for k in range(4):
        step = 1e-4 * RUNNING[k] * np.eye(4)[k]
        hertz = both(np.array([RUNNING - step, RUNNING, RUNNING + step]))[1]
        difference = (hertz[2] - hertz[0]) / (2 * step[k])
        np.testing.assert_allclose(slopes[0, ..., k], difference, rtol=1e-6)


def test_bad_input_is_named():
    drive, point = EXAMPLE
    with pytest.raises(ValueError, match="ends: unknown support 'pinned'; give 'simple' or"):
        bj.span_frequencies(drive, point, ("pinned", "fixed"))
    with pytest.raises(ValueError, match="count: give a whole number of modes, 1 or more, not 0"):
        bj.span_frequencies(drive, point, count=0)
