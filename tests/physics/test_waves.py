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
GRID = [x.ravel() for x in np.meshgrid(STIFFNESS, TENSION, TRANSPORT, [1.0, 0.2], OMEGA)]


def exact_step(coefficients, root):
    """Newton's step at `root` in rational arithmetic: the error of the root, to first order."""
    B, Q, c, m, omega = map(Fraction, coefficients)
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


def test_roots_to_rounding_by_exact_arithmetic():
    roots = jax.jit(wave_numbers)(*GRID)
    r1, r2, r3, r4 = (np.asarray(r) for r in roots)
    assert np.all(r1 > 0)
    assert np.all(r2 < 0)
    assert np.all(r3.imag > 0)
    np.testing.assert_array_equal(r4, r3.conj())
    worst = 0.0
    for k in range(len(r1)):
        coefficients = [float(x[k]) for x in GRID]
        for r in (r1[k], r2[k], r3[k]):
            worst = max(worst, abs(exact_step(coefficients, r)) / abs(r))
    assert worst < 1e-15  # five roundings


def test_slow_transport_keeps_the_digits_of_the_drift():
    # For c -> 0 the waves r1 and r2 = -r1 cancel; drift/c has the limit omega/(Q + 2 B r1^2).
    B, Q, omega = 0.01, 1.0, 2.0
    found = waves(B, Q, 1e-13, 1.0, omega)
    square = (-Q + np.sqrt(Q**2 + 4 * B * omega**2)) / (2 * B)
    assert float(found.drift) / 1e-13 == pytest.approx(omega / (Q + 2 * B * square), rel=1e-14)


@pytest.mark.parametrize("v", [0.0, 0.6])
def test_without_stiffness_the_waves_are_those_of_a_string(v):
    found = waves(0.0, 1 - v**2, v, 1.0, 2.0)
    np.testing.assert_allclose(found[:3], (2 / (1 + v), -2 / (1 - v), 2 * v / (1 - v**2)), 1e-15)
    assert float(found.steep) == pytest.approx(np.sqrt(1 - v**2), rel=1e-15)
    assert np.all(np.isfinite(jnp.stack(wave_numbers(0.0, 1 - v**2, v, 1.0, 2.0))))


def test_first_derivative_in_the_stiffness_of_a_string():
    # (2.15): r1 = omega/(1+v) - B omega^3/(2 (1+v)^4), and r2 likewise with 1 - v.
    v, omega = 0.6, 2.0
    slopes = jax.jacrev(lambda B: jnp.stack(waves(B, 1 - v**2, v, 1.0, omega)))(0.0)
    expected = (-(omega**3) / (2 * (1 + v) ** 4), omega**3 / (2 * (1 - v) ** 4))
    np.testing.assert_allclose(slopes[:2], expected, rtol=1e-14)
    assert np.all(np.isfinite(slopes))


def parts(numbers):
    r1, r2, r3, _ = wave_numbers(*numbers)
    return jnp.stack([r1, r2, r3.real, r3.imag])


def test_derivatives_forward_reverse_and_differences():
    lanes = jnp.array([(0.01, 0.64, 0.6, 1.0, 3.0), (1e-6, 0.1, -0.9, 0.3, 8.0)])
    forward = jax.jit(jax.vmap(jax.jacfwd(parts)))(lanes)
    reverse = jax.jit(jax.vmap(jax.jacrev(parts)))(lanes)
    np.testing.assert_allclose(forward, reverse, rtol=1e-12, atol=1e-13)
    value = jax.jit(jax.vmap(parts))
    for k in range(5):
        step = 1e-4 * np.abs(lanes[:, k : k + 1]) * np.eye(5)[k]
        wide, narrow = (value(lanes + n * step) - value(lanes - n * step) for n in (2, 1))
        difference = (8 * narrow - wide) / (12 * step[:, k : k + 1])
        size = np.max(np.abs(forward[:, :, k]), axis=1, keepdims=True)
        assert np.max(np.abs(forward[:, :, k] - difference) / size) < 1e-9


def test_second_derivatives_nest():
    def r2(v):
        return waves(0.01, 1 - v**2, v, 1.0, 3.0).r2

    h = 1e-5
    difference = (jax.grad(r2)(0.6 + h) - jax.grad(r2)(0.6 - h)) / (2 * h)
    assert float(jax.grad(jax.grad(r2))(0.6)) == pytest.approx(float(difference), rel=1e-8)
