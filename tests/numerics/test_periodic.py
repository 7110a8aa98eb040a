"""Periodic orbits against integration in time, exact boundaries of stability, and derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.optimize
import scipy.special

from beltjax.compiling.quick import quickly_compiled
from beltjax.numerics.harmonic_balance import Oscillator, series
from beltjax.numerics.periodic import conditioning, monodromy, multipliers, periodic_orbit

ONE = jnp.ones((1, 1))


def duffing(args, load):
    """z'' + c z' + z + a z^3 = F cos(w t)."""
    c, a, F, w = args

    def force(z, rate, tau):
        return a * z**3 - load * F * jnp.cos(tau)

    return Oscillator(ONE, c * ONE, ONE, w, force)


def solved(args):
    orbit = periodic_orbit(duffing, args, 12, 96)
    return orbit, multipliers(duffing, args, orbit.coefficients)


def arguments(c=0.05, a=0.3, F=0.3, w=1.3):
    return tuple(map(jnp.asarray, (c, a, F, w)))


def test_orbit_and_multipliers_are_those_of_shooting():
    args = arguments()
    orbit, found = quickly_compiled(solved)(args)
    assert orbit.converged
    c, a, F, w = map(float, args)

    def run(state):
        def slope(t, x):
            tangent = np.array([[0, 1], [-1 - 3 * a * x[0] ** 2, -c]])
            rate = [x[1], F * np.cos(w * t) - c * x[1] - x[0] - a * x[0] ** 3]
            return np.concatenate([rate, (tangent @ x[2:].reshape(2, 2)).ravel()])

        start = np.concatenate([state, np.eye(2).ravel()])
        times = 0, 2 * np.pi / w
        end = scipy.integrate.solve_ivp(slope, times, start, "DOP853", rtol=1e-12, atol=1e-13)
        return end.y[:, -1]

    of = np.asarray(series(jnp.zeros(()), 12))
    order = np.repeat(np.arange(1, 13), 2) * w
    swapped = np.stack([orbit.coefficients[2::2, 0], -orbit.coefficients[1::2, 0]], 1).ravel()
    begin = np.array([of @ orbit.coefficients[:, 0], of[1:] @ (order * swapped)])
    root = scipy.optimize.fsolve(lambda state: run(state)[:2] - state, begin, xtol=1e-13)
    np.testing.assert_allclose(begin, root, atol=1e-9)
    expected = np.linalg.eigvals(run(root)[2:].reshape(2, 2))
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(expected), atol=1e-7)
    # The product of the multipliers is the loss of area over a period (Liouville).
    assert np.prod(found).real == pytest.approx(np.exp(-c * 2 * np.pi / w), rel=1e-8)


@pytest.mark.parametrize(("characteristic", "order"), [("mathieu_a", 0), ("mathieu_b", 2)])
def test_multipliers_at_the_edge_of_mathieu_s_equation(characteristic, order):
    # y'' + (a - 2 q cos 2t) y = 0 has a solution of the period pi at its characteristic values.
    q = 1.0
    a = getattr(scipy.special, characteristic)(order, q)

    def edge(z, rate, tau):
        return (a - 2 * q * jnp.cos(tau)) * z

    system = Oscillator(ONE, 0 * ONE, 0 * ONE, jnp.asarray(2.0), edge)
    whole = monodromy(system, jnp.zeros((3, 1)), 200)
    assert np.trace(whole) == pytest.approx(2.0, abs=1e-7)
    assert np.linalg.det(whole) == pytest.approx(1.0, abs=1e-12)


def test_derivatives_are_those_of_orbits_solved_again():
    args = arguments()

    def cosine(args):
        return periodic_orbit(duffing, args, 12, 96).coefficients[1, 0]

    reverse = quickly_compiled(jax.grad(cosine))(args)
    value = quickly_compiled(cosine)
    for place, slope in enumerate(reverse):
        unit = [float(place == k) for k in range(4)]

        def at(h, unit=unit):
            return value(tuple(x + h * u for x, u in zip(args, unit, strict=True)))

        difference = (8 * (at(1e-4) - at(-1e-4)) - (at(2e-4) - at(-2e-4))) / 12e-4
        assert slope == pytest.approx(float(difference), rel=1e-9)


def test_a_batch_follows_the_branch_from_rest_and_says_where_it_ends():
    speeds = jnp.linspace(0.7, 1.6, 7)
    batch = quickly_compiled(jax.vmap(solved, in_axes=((None, None, None, 0),)))
    orbits, found = batch((*arguments()[:3], speeds))
    # At 1.15 the branch from rest folds back before F = 0.3.
    np.testing.assert_array_equal(orbits.converged, np.arange(7) != 3)
    assert not np.any(orbits.coefficients[3])
    assert np.all(np.abs(found[:, 0]) < 1)
    alone, _ = quickly_compiled(solved)(arguments())
    np.testing.assert_allclose(orbits.coefficients[4], alone.coefficients, atol=1e-12)


@pytest.mark.slow
def test_conditioning_vanishes_at_a_fold():
    # Amplitude A of the primary resonance, one harmonic: F^2 = A^2 [(1 + 3/4 a A^2 - w^2)^2 + ..].
    c, a, w = 0.05, 0.3, 1.15
    A = np.linspace(0.05, 1.5, 20001)
    F = A * np.sqrt((1 + 0.75 * a * A**2 - w**2) ** 2 + (c * w) ** 2)
    fold = F[np.argmax(np.diff(F) < 0)]

    def at(F):
        args = arguments(F=F, w=w)
        orbit = periodic_orbit(duffing, args, 1, 16)
        return float(conditioning(duffing, args, orbit.coefficients, 16)), bool(orbit.converged)

    far, near, beyond = (at(fold * part) for part in (1 - 1e-3, 1 - 1e-5, 1 + 1e-5))
    assert far[1]
    assert near[1]
    assert not beyond[1]
    # As the root of the distance: the branch turns back as a parabola.
    assert near[0] / far[0] == pytest.approx(0.1, rel=0.05)
