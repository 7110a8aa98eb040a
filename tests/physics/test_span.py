"""The stiff span in closed form, against quadrature, series and exact limits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from beltjax.physics import span


def layer_integrals(k):
    """The four integrals by adaptive quadrature of the functions themselves."""

    def bend(x):
        return np.exp(-k * (1 - x)) * -np.expm1(-2 * k * x) / -np.expm1(-2 * k)

    def slope(x):
        return (k * np.exp(-k * (1 - x)) * (1 + np.exp(-2 * k * x)) / -np.expm1(-2 * k) - 1) / k**2

    def integral(f):
        return quad(f, 0, 1, points=[min(0.5, 3 / k), max(0.5, 1 - 3 / k)], epsabs=0, epsrel=1e-13)[
            0
        ]

    return (
        integral(lambda x: bend(x) ** 2),
        integral(lambda x: bend(x) * bend(1 - x)),
        integral(lambda x: slope(x) ** 2),
        integral(lambda x: -slope(x) * slope(1 - x)),
    )


@pytest.mark.parametrize("k", [1.5, 1.7, 1.74, 3.0, 10.0, 40.0])
def test_layer_integrals_against_quadrature(k):
    computed = span.layers(*span.layer_width(jnp.array(1.0), jnp.array(1.0), jnp.array(k**2)))
    np.testing.assert_allclose(computed, layer_integrals(k), rtol=2e-11)


def test_thick_layers_approach_the_cubic():
    computed = span.layers(*span.layer_width(jnp.array(1.0), jnp.array(1.0), jnp.array(0.0)))
    np.testing.assert_allclose(computed, (1 / 3, 1 / 6, 1 / 45, 7 / 360), rtol=1e-15)


def test_thick_layers_follow_their_series():
    # The next coefficient of each integral in z = k^2, by expanding sinh.
    z = 1e-4
    computed = span.layers(*span.layer_width(jnp.array(1.0), jnp.array(1.0), jnp.array(z)))
    series = (1 / 3 - 2 * z / 45, 1 / 6 - 7 * z / 180)
    np.testing.assert_allclose(computed[:2], series, rtol=1e-8)


def test_no_cancellation_near_zero_tension():
    # eps = 0.1, Q = 1e-8: the textbook formulas give I = -39.
    layers = span.layers(*span.layer_width(jnp.array(0.1), jnp.array(1.0), jnp.array(1e-8)))
    straight = span.stretch(jnp.array(1.0), jnp.array(1.0), jnp.array(0.0), layers)
    assert float(straight) == pytest.approx((1 / 45 + 7 / 360), rel=1e-5)


def test_derivatives_agree_where_the_two_forms_meet():
    def bend(Q):
        one = jnp.ones(())
        return span.stretch(one, 0.7 * one, 0 * one, span.layers(*span.layer_width(one, one, Q)))

    below, above = (jax.grad(bend)(jnp.array(3.0 + d)) for d in (-1e-9, 1e-9))
    assert float(below) == pytest.approx(float(above), rel=1e-8)


@pytest.mark.parametrize("k", [0.3, 1.6, 2.5, 60.0])
def test_deflection_solves_the_span_equation(k):
    u, z = span.layer_width(jnp.array(1.0), jnp.array(1.0), jnp.array(k**2))

    def shape(x):
        return span.bump(x, u, z)

    second = jax.vmap(jax.grad(jax.grad(shape)))
    x = jnp.linspace(0.0, 1.0, 21)
    np.testing.assert_allclose(second(x), np.sinh(k * x) / np.sinh(k), rtol=1e-7, atol=1e-11)
    assert abs(float(shape(0.0))) < 1e-17
    assert abs(float(shape(1.0))) < 1e-14


@pytest.mark.parametrize(("eps", "Q"), [(0.0, 1.0), (1e-9, 1.0), (0.05, 0.0), (0.05, 1e-12)])
def test_limits_are_finite_with_their_derivatives(eps, Q):
    def total(eps, Q):
        layers = span.layers(*span.layer_width(eps, jnp.array(1.0), Q))
        return span.stretch(1.0, -2.0, 0.1, layers) + span.bending(1.0, -2.0, layers)

    value, slopes = jax.value_and_grad(total, argnums=(0, 1))(jnp.array(eps), jnp.array(Q))
    assert np.isfinite(value)
    assert np.all(np.isfinite(slopes))
