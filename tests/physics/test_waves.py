"""The four waves of a moving beam: exact residuals, exact limits, derivatives."""

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from beltjax.physics.waves import wave_numbers, waves

# stiffness, tension, transport, inertia, omega: from a string to a beam without tension
STIFFNESS = [1e-16, 1e-8, 1e-4, 0.04, 3.0, 1e4]
TENSION = [1e-6, 0.0975, 1.0, 40.0]
TRANSPORT = [-0.95, 0.0, 1e-9, 0.3, 0.999, 5.0]
OMEGA = [1e-3, 1.0, 30.0, 1e4]
GRID = np.array([x.ravel() for x in np.meshgrid(STIFFNESS, TENSION, TRANSPORT, [1.0, 0.2], OMEGA)])
# Beams in compression: faster than the string's waves, but not so fast that they buckle.
PRESSED = np.array(
    [
        (eps**2, -share * np.pi**2 * eps**2, np.sqrt(1 + share * np.pi**2 * eps**2), 1.0, omega)
        for eps in (0.05, 1.0)
        for share in (0.0, 0.1, 0.9)
        for omega in (0.5 * eps**2, 10 * eps**2, 30 * eps)
    ]
).T


def exact_step(coefficients, root):
    """Newton's step at `root` in rational arithmetic: the error of the root, to first order."""
    B, Q, c, m, omega = map(Fraction, map(float, coefficients))
    r = (Fraction(float(root.real)), Fraction(float(root.imag)))

    def times(a, b):
        return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]

    square = times(r, r)
    cube = times(square, r)
    fourth = times(square, square)
    value = complex(
        B * fourth[0] + Q * square[0] + 2 * c * omega * r[0] - m * omega**2,
        B * fourth[1] + Q * square[1] + 2 * c * omega * r[1],
    )
    slope = complex(4 * B * cube[0] + 2 * Q * r[0] + 2 * c * omega, 4 * B * cube[1] + 2 * Q * r[1])
    return value / slope


def errors(numbers, roots):
    """Relative errors of r1, r2, r3 and r4 in each lane."""
    lanes = range(len(roots[0]))
    return np.array(
        [[abs(exact_step(numbers[:, k], r[k])) / abs(r[k]) for k in lanes] for r in roots]
    )


@pytest.fixture(scope="module")
def roots():
    """The four roots of GRID and, behind them, of PRESSED and of a string."""
    string = np.array([[0.0, 0.64, 0.6, 1.0, 2.0]]).T
    found = jax.jit(wave_numbers)(*np.concatenate([GRID, PRESSED, string], axis=1))
    return np.array([np.asarray(r, dtype=complex) for r in found])


def test_roots_to_rounding_by_exact_arithmetic(roots):
    r1, r2, r3, r4 = tense = roots[:, : GRID.shape[1]]
    assert np.all(np.isfinite(roots))
    assert np.all(r1 > 0)
    assert np.all(r2 < 0)
    assert np.all(r3.imag > 0)
    np.testing.assert_array_equal(r4, r3.conj())
    assert np.max(errors(GRID, tense)) < 1e-15  # five roundings


def test_roots_of_a_pressed_beam(roots):
    pressed = roots[:, GRID.shape[1] : -1]
    r1, r2, r3, _ = pressed
    assert np.all((r1 > 0) & (r2 < 0))
    assert np.any(r3.imag == 0)  # all four waves travel
    assert np.any(r3.imag > 0)
    # What roundings of the coefficients alone would change in each root.
    B, Q, c, m, omega = PRESSED
    for r, error in zip(pressed, errors(PRESSED, pressed), strict=True):
        sizes = (B * r**4, Q * r**2, 2 * c * omega * r, m * omega**2)
        slope = 4 * B * r**4 + 2 * Q * r**2 + 2 * c * omega * r
        condition = sum(np.abs(size) for size in sizes) / np.abs(slope)
        assert np.max(error / condition) < 1e-14


LANES = jnp.array(
    [
        (0.01, 0.64, 0.6, 1.0, 3.0),
        (1e-6, 0.1, -0.9, 0.3, 8.0),
        (0.0, 0.64, 0.6, 1.0, 2.0),
        (0.0, 1.0, 0.0, 1.0, 2.0),
        (0.01, 1.0, 1e-13, 1.0, 2.0),
    ]
)


@jax.jit
@jax.vmap
def parts_with_slopes(numbers):
    def parts(numbers):
        return jnp.stack(waves(*numbers))

    return parts(numbers), jax.jacfwd(parts)(numbers), jax.jacrev(parts)(numbers)


def test_without_stiffness_the_waves_are_those_of_a_string():
    found, slopes, _ = parts_with_slopes(LANES)
    for lane, v in ((2, 0.6), (3, 0.0)):
        string = (2 / (1 + v), -2 / (1 - v), 2 * v / (1 - v**2), 1 - v**2)
        np.testing.assert_allclose(found[lane], string, rtol=1e-15)
        # (2.15): r1 = omega/(1+v) - B omega^3/(2 (1+v)^4), and r2 likewise with 1 - v.
        expected = (-4 / (1 + v) ** 4, 4 / (1 - v) ** 4)
        np.testing.assert_allclose(slopes[lane, :2, 0], expected, rtol=1e-14)
    assert np.all(np.isfinite(slopes))


def test_slow_transport_keeps_the_digits_of_the_drift():
    # For c -> 0 the waves r1 and r2 = -r1 cancel; drift/c has the limit omega/(Q + 2 B r1^2).
    found, _, _ = parts_with_slopes(LANES)
    square = (-1 + np.sqrt(1 + 4 * 0.01 * 4)) / 0.02
    assert float(found[4, 2]) / 1e-13 == pytest.approx(2 / (1 + 0.02 * square), rel=1e-14)


def test_derivatives_forward_reverse_and_differences():
    _, forward, reverse = parts_with_slopes(LANES)
    np.testing.assert_allclose(forward, reverse, rtol=1e-12, atol=1e-13)
    lanes = np.asarray(LANES[:2])
    for k in range(5):
        step = 1e-4 * np.abs(lanes[:, k : k + 1]) * np.eye(5)[k]
        shifted = [np.concatenate([lanes + n * step, lanes - n * step, lanes[:1]]) for n in (2, 1)]
        wide, narrow = (np.asarray(parts_with_slopes(jnp.asarray(s))[0]) for s in shifted)
        wide, narrow = wide[:2] - wide[2:4], narrow[:2] - narrow[2:4]
        difference = (8 * narrow - wide) / (12 * step[:, k : k + 1])
        size = np.max(np.abs(forward[:2, :, k]), axis=1, keepdims=True)
        assert np.max(np.abs(forward[:2, :, k] - difference) / size) < 1e-9


def test_second_derivatives_nest():
    @jax.jit
    def slope_and_curvature(v):
        def slope(v):
            return jax.grad(lambda v: waves(0.01, 1 - v**2, v, 1.0, 3.0).r2)(v)

        return slope(v), jax.jvp(slope, (v,), (jnp.ones_like(v),))[1]

    h = 1e-5
    difference = slope_and_curvature(0.6 + h)[0] - slope_and_curvature(0.6 - h)[0]
    curvature = float(slope_and_curvature(0.6)[1])
    assert curvature == pytest.approx(float(difference) / (2 * h), rel=1e-8)
