"""Branches of periodic orbits past their folds."""

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from beltjax.compiling.quick import quickly_compiled
from beltjax.numerics.harmonic_balance import Oscillator
from beltjax.numerics.periodic import periodic_orbit
from beltjax.numerics.periodic_branch import Units, corrected, start_of, walked

ONE = jnp.ones((1, 1))
C, A, F = 0.05, 0.3, 0.3


def duffing(args, w):
    """The hardening oscillator at a frequency."""

    def force(z, rate, tau):
        return A * z**3 - args * F * jnp.cos(tau)

    return Oscillator(ONE, C * ONE, ONE, w, force)


def test_folds_are_those_of_one_harmonic():
    # With one harmonic: F^2 = a^2 [(1 + 3/4 A a^2 - w^2)^2 + (C w)^2], of which w^2 is a quadratic.
    harmonics, samples, shape = 1, 16, (3, 1)
    units = Units(jnp.asarray(1.0), jnp.asarray(0.1))
    low = jnp.asarray(0.6)
    orbit = quickly_compiled(
        lambda w: periodic_orbit(lambda w, part: duffing(part, w), w, harmonics, samples)
    )(low)
    correct = quickly_compiled(
        lambda guess, along: corrected(duffing, jnp.ones(()), units, samples, shape, guess, along)
    )
    start = start_of(orbit.coefficients, low, units)
    along = jnp.zeros(4).at[-1].set(1.0)
    first = correct(start, along)
    assert first.converged
    walk = walked(correct, first.point, 0.2, (6.0, 30.0), 400)
    assert walk.complete
    w = np.array([float(point.place[-1]) * 0.1 for point in walk.points])
    size = np.array([np.linalg.norm(point.place[1:3]) for point in walk.points])
    stiff = 1 + 0.75 * A * size**2
    expected = size**2 * ((stiff - w**2) ** 2 + (C * w) ** 2)
    np.testing.assert_allclose(expected, F**2, rtol=1e-9)
    assert len(walk.folds) == 2

    def fold(unknowns):
        s, W = unknowns  # squares of amplitude and frequency
        k = 0.75 * A
        apart = 1 + k * s - W
        return s * (apart**2 + C**2 * W) - F**2, apart**2 + C**2 * W + 2 * k * s * apart

    for place in walk.folds:
        near = 1.01 * size[place] ** 2, 0.99 * w[place] ** 2
        square = scipy.optimize.fsolve(fold, near, xtol=1e-13)
        assert w[place] == pytest.approx(np.sqrt(square[1]), rel=1e-9)
        assert size[place] == pytest.approx(np.sqrt(square[0]), rel=1e-4)
    # Up to the peak, back below the start of the fold, and on.
    assert w[walk.folds[0]] > w[walk.folds[1]] > 1
