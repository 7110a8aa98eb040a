"""Scattered numbers through functions whose moments, quantiles and indices are known."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import norm

import beltjax as bj

Normal, Uniform = bj.optimize.Normal, bj.optimize.Uniform
KINDS = [Normal(0.3), Uniform(0.6), Normal(0.0)]
STANDARD = np.array([0.3, 0.6 / np.sqrt(3), 0.0])


def sample(kinds, count=2**14):
    points = bj.optimize.robust.distributions.sample_points(len(kinds), count, 0)
    assert points.min() > 0
    assert points.max() < 1
    return np.asarray(bj.optimize.robust.distributions.scattered(kinds, points))


def test_linear_function_exactly():
    slopes, nominal = np.array([[2.0, -1.0, 5.0], [0.0, 0.0, 1.0]]), np.array([1.0, 2.0, 3.0])
    found = bj.optimize.linear_moments(lambda x: slopes @ x + 4.0, nominal, KINDS)
    np.testing.assert_array_equal(found.mean, slopes @ nominal + 4.0)
    np.testing.assert_allclose(found.parts, slopes * STANDARD, rtol=1e-15)
    np.testing.assert_allclose(found.deviation, np.hypot(0.6, 0.6 / np.sqrt(3)) * np.array([1, 0]))
    sampled = (nominal + sample(KINDS)) @ slopes[0] + 4.0
    # A hundred times closer than as many random points come.
    standard_error = sampled.std() / np.sqrt(len(sampled))
    assert sampled.mean() == pytest.approx(float(found.mean[0]), abs=standard_error / 100)
    assert sampled.std() == pytest.approx(float(found.deviation[0]), rel=1e-3)


def test_mean_shift_and_variance_of_a_quadratic():
    # x^2 of a normal number: mean m^2 + s^2, variance 4 m^2 s^2 + 2 s^4; of a uniform one with
    # half-width h: mean m^2 + h^2/3, variance 4 m^2 h^2/3 + 4 h^4/45. Slopes see the first terms.
    m, s, h = 0.7, 0.5, 0.9
    for kind, mean, variance in (
        (Normal(s), m**2 + s**2, 4 * m**2 * s**2 + 2 * s**4),
        (Uniform(h), m**2 + h**2 / 3, 4 * m**2 * h**2 / 3 + 4 * h**4 / 45),
    ):
        values = (m + sample([kind])[:, 0]) ** 2
        assert values.mean() == pytest.approx(mean, rel=1e-4)
        assert values.var() == pytest.approx(variance, rel=2e-3)
        linear = bj.optimize.linear_moments(lambda x: x[0] ** 2, jnp.array([m]), [kind])
        assert linear.mean == pytest.approx(m**2)
        assert linear.deviation == pytest.approx(2 * m * np.asarray(kind.standard))


def test_deviation_without_slopes_has_slope_zero():
    def deviation(x):
        return bj.optimize.linear_moments(lambda y: y[0] ** 2, x, [Normal(0.1)]).deviation

    assert deviation(jnp.zeros(1)) == 0.0
    assert jax.grad(deviation)(jnp.zeros(1)) == 0.0
    assert jax.grad(deviation)(jnp.ones(1)) == pytest.approx(0.2)  # of 2 x 0.1


@pytest.mark.parametrize("quantile", [0.05, 0.5, 0.95, 0.99])
def test_smooth_quantile_of_a_normal_sample(quantile):
    values, z = 3.0 + 2.0 * sample([Normal(1.0)])[:, 0], norm.ppf(quantile)
    sharp = bj.optimize.smooth_quantile(values, quantile, 200.0)
    assert sharp == pytest.approx(np.quantile(values, quantile), abs=2e-3)
    assert sharp == pytest.approx(3.0 + 2.0 * z, abs=2e-3)
    # The logistic function's variance, pi^2/3 of its width squared, adds to the sample's.
    blunt = bj.optimize.smooth_quantile(values, quantile, 20.0)
    assert blunt - 3.0 == pytest.approx(2.0 * z * (1 + np.pi**2 / 6 / 20.0**2), abs=2e-3)


def test_smooth_quantile_moves_with_the_sample():
    values = jnp.array([0.3, 2.0, -1.0, 0.7, 1.1, 5.0, -2.2])
    quantile, slopes = jax.value_and_grad(bj.optimize.smooth_quantile)(values, 0.8, 5.0)
    assert jnp.sum(slopes) == pytest.approx(1.0, abs=1e-12)  # all values moved by 1 move it by 1
    assert slopes @ values == pytest.approx(float(quantile), rel=1e-12)  # it scales with the values
    h = 1e-6 * jnp.eye(7)[3]
    ahead, behind = (bj.optimize.smooth_quantile(values + x, 0.8, 5.0) for x in (h, -h))
    assert slopes[3] == pytest.approx(float(ahead - behind) / 2e-6, rel=1e-7)
    same = jax.value_and_grad(bj.optimize.smooth_quantile)(jnp.full(4, 2.5), 0.9)
    assert same[0] == pytest.approx(2.5)
    assert jnp.isfinite(same[1]).all()


def test_indices_of_the_ishigami_function():
    # Ishigami and Homma (1990): sin x1 + a sin^2 x2 + b x3^4 sin x1, uniform within pi.
    a, b = 7.0, 0.1
    one = 0.5 * (1 + b * np.pi**4 / 5) ** 2
    two, both = a**2 / 8, b**2 * np.pi**8 * 8 / 225
    whole = one + two + both

    def evaluate(x):
        y = np.sin(x[:, 0]) + a * np.sin(x[:, 1]) ** 2 + b * x[:, 2] ** 4 * np.sin(x[:, 0])
        return np.stack([y, np.full_like(y, 3.0)], axis=1)

    kinds = {name: Uniform(np.pi) for name in ("x1", "x2", "x3")}
    found, constant = bj.optimize.sobol_indices(evaluate, np.zeros(3), kinds, count=2**13)
    np.testing.assert_allclose(found.first, np.array([one, two, 0]) / whole, atol=0.005)
    np.testing.assert_allclose(found.total, np.array([one + both, two, both]) / whole, atol=0.005)
    assert found.total_error.max() < 0.05
    np.testing.assert_array_equal(constant.first, 0.0)


def test_points_that_fail_are_counted():
    kinds = {"a": Normal(1.0), "b": Normal(1.0)}
    with pytest.raises(ValueError, match=r"of 32 points failed; narrow the tolerances"):
        bj.optimize.sobol_indices(lambda x: np.sqrt(x), np.ones(2), kinds, count=8)


def test_without_salib_the_remedy_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "SALib.sample.sobol", None)
    with pytest.raises(ValueError, match=r"SALib is not installed: pip install"):
        bj.optimize.sobol_indices(np.cos, np.zeros(1), {"a": Normal(1.0)})


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Normal(-1.0), r"Normal\.deviation: found -1\.0; give a size, 0 or more"),
        (lambda: Uniform(np.inf), r"Uniform\.half_width: found inf; give a size"),
        (lambda: bj.optimize.WorstQuantile(1.0), "found 1 and 20; give 0 < quantile < 1"),
        (lambda: bj.optimize.WorstQuantile(0.9, 0.0), "found 0.9 and 0; give"),
    ],
)
def test_sizes_that_are_none(make, says):
    with pytest.raises(ValueError, match=says):
        make()
