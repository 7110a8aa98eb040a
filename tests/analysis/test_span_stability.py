"""A single span against Mathieu's functions, stored values, and its failures."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
import scipy.special
from compilations import TYPES, compilations
from drives import three_ways

import beltjax as bj

CASES = json.loads((Path(__file__).parents[1] / "data" / "parametric.json").read_text())


@pytest.mark.parametrize("p", [0.05, 0.3])
def test_a_string_at_rest_has_the_tongue_of_mathieu(p):
    # w'' + (n pi)^2 (1 + p cos Om t) w = 0 is Mathieu's with these a and q; its first tongue lies
    # between b1 and a1.
    def left(frequency, of):
        a, q = (2 * np.pi / frequency) ** 2, 2 * p * (np.pi / frequency) ** 2
        return of(1, q) - a

    exact = sorted(
        scipy.optimize.brentq(left, 2 * np.pi * (1 - p), 2 * np.pi * (1 + p), (of,), xtol=1e-13)
        for of in (scipy.special.mathieu_a, scipy.special.mathieu_b)
    )
    found = bj.span_stability(0.0, 0.0, p, 0.0, 2 * np.pi, modes=4, steps=256)
    np.testing.assert_allclose(found.edges, exact, rtol=2e-8)
    assert found.modes.tolist() == [1, 1]
    assert float(found.coupling) == pytest.approx(np.pi * p / 4, rel=1e-10)


@pytest.mark.parametrize(("p", "dv"), [(0.05, 0.0), (0.2, 0.0), (0.0, 0.01)])
def test_stored_tongues_of_a_moving_beam(p, dv):
    case = CASES[f"A4_beam_eps0.02_{f'p{p}' if p else f'dv{dv}'}"]
    found = bj.span_stability(
        case["v"], 0.02, p, dv, case["center"], acceleration="uniform", modes=14, steps=256
    )
    np.testing.assert_allclose(found.frequencies[:3], case["omega"], rtol=1e-9)
    stored = case["floquet_by_modes"]["14"]
    np.testing.assert_allclose(found.edges, stored["edges"], rtol=1e-6)
    assert float(found.growth) == pytest.approx(stored["growth"], abs=1e-8)
    first = found.center + 2 * found.coupling * np.array([-1, 1])
    np.testing.assert_allclose(first, case["first_order_edges"], rtol=1e-9)
    assert float(found.coupling) == pytest.approx(case["first_order_growth"], rel=1e-8)


def test_first_order_holds_to_second_order_of_the_fluctuation():
    growths = []
    for p in (0.05, 0.1):
        found = bj.span_stability(0.3, 0.1, p, 0.0, 5.9, modes=6)
        found = bj.span_stability(0.3, 0.1, p, 0.0, float(found.center), modes=6)
        growths.append(abs(float(found.growth / found.coupling) - 1))
    assert growths[1] / growths[0] == pytest.approx(4.0, rel=0.05)


def critical(numbers):
    case = CASES["A11_derivatives_and_integration"]["span_critical_derivative"]
    speed, bending = numbers
    found = bj.span_stability(
        speed, bending, 0.1, 0.0, case["Omega"], case["zeta"],
        modes=6, steps=64, critical=True, throw=False,
    )  # fmt: skip
    return 0.1 * found.critical_factor[None]


@pytest.mark.slow
def test_derivative_of_the_critical_tension():
    case = CASES["A11_derivatives_and_integration"]["span_critical_derivative"]
    at = jnp.array([case["v"], case["eps"]])
    slopes = three_ways(critical, at, 4e-4)
    np.testing.assert_allclose(slopes.forward, slopes.reverse, rtol=1e-9)
    np.testing.assert_allclose(slopes.forward, slopes.differences, rtol=1e-6)
    for k, name in enumerate(("dp_dv", "dp_deps")):
        # The stored second number is of differences, whose own error is some 1e-4.
        assert slopes.forward[0, k] == pytest.approx(case[name][0], rel=1e-4)
        assert slopes.forward[0, k] == pytest.approx(case[name][1], rel=3e-4)


def test_stored_critical_tension():
    case = CASES["A11_derivatives_and_integration"]["span_critical_derivative"]
    found = bj.span_stability(
        case["v"], case["eps"], 0.1, 0.0, case["Omega"], case["zeta"], critical=True
    )
    assert 0.1 * float(found.critical_factor) == pytest.approx(case["p_crit"], rel=1e-7)


@pytest.mark.parametrize(
    ("arguments", "options", "result"),
    [
        ((0.3, 0.0, 0.1, 0.0, 5.7), {}, "commensurate"),
        ((0.0, 0.0, 0.0, 0.1, 6.2), {}, "commensurate"),
        ((1.2, 0.1, 0.1, 0.0, 5.7), {}, "beyond_critical_speed"),
        ((0.3, -0.1, 0.1, 0.0, 5.7), {}, "beam_unusable"),
        ((0.3, 0.1, np.nan, 0.0, 5.7), {}, "beam_unusable"),
        ((0.3, 0.1, 0.1, 0.0, 5.7), {"critical": True}, "no_damping"),
    ],
)
def test_failures(arguments, options, result):
    options |= {"modes": 4, "steps": 16}
    found = bj.span_stability(*arguments, throw=False, **options)
    assert found.result == getattr(bj.RESULTS, result)
    with pytest.raises(bj.AnalysisError):
        bj.span_stability(*arguments, **options)


def test_what_is_wrong_whatever_the_numbers():
    with pytest.raises(ValueError, match="frequency"):
        bj.span_stability(0.3, 0.1, 0.1, 0.0, 0.0)
    with pytest.raises(ValueError, match="acceleration"):
        bj.span_stability(0.3, 0.1, 0.1, 0.0, 5.7, acceleration="none")
    with pytest.raises(ValueError, match="modes"):
        bj.span_stability(0.3, 0.1, 0.1, 0.0, 5.7, modes=0)


def test_a_bad_lane_leaves_the_others():
    def rate(speed):
        found = bj.span_stability(speed, 0.05, 0.1, 0.0, 5.7, modes=4, steps=32, throw=False)
        return found.growth

    speeds = jnp.array([0.3, 1.5, np.nan, 0.31])
    found = np.asarray(jax.jit(jax.vmap(rate))(speeds))
    alone = [float(rate(0.3)), float(rate(0.31))]
    np.testing.assert_allclose(found[[0, 3]], alone, rtol=1e-9)
    slopes = jax.jit(jax.vmap(jax.grad(rate)))(speeds)
    assert np.all(np.isfinite(slopes))
    assert np.all(np.asarray(slopes)[1:3] == 0)


def test_edges_have_no_derivatives():
    def edge(speed):
        return bj.span_stability(speed, 0.05, 0.1, 0.0, 5.7, modes=4, steps=32).edges[0]

    assert np.isnan(float(jax.grad(edge)(0.3)))


def test_another_span_compiles_nothing():
    bj.span_stability(0.3, 0.05, 0.1, 0.0, 5.7, modes=4, steps=32)
    for name, typed in TYPES.items():
        speed, frequency = typed(0), typed(6)
        with compilations() as count:
            bj.span_stability(speed, 0.06, 0.2, 0.0, frequency, 0.01, modes=4, steps=32)
        assert count == [0], name
