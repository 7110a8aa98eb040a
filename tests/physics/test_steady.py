"""Chapter 3 in pure numbers, against print, limits and an independent solver."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from published import (
    BETA_INEFFECTIVE,
    COUPLING,
    COUPLING_LEADING,
    FIGURE_3_10,
    PEAKS,
    Value,
    assert_matches_print,
    cases,
    model_of,
    prototype,
)

from beltjax.physics import steady
from beltjax.validation.peers.standard_form import solve_standard_form

exact, string, linear = (jax.jit(f) for f in (steady.exact, steady.string, steady.linear))
coupling = jax.jit(steady.coupling)
X = jnp.linspace(0.0, 1.0, 4001)


def peak(w):
    return float(w[jnp.argmax(jnp.abs(w))])


@cases
def test_tension_and_rotation_agree_with_print(case):
    full, leading = exact(model_of(case)), string(model_of(case))
    for value in case.T:
        assert_matches_print(full.T[0], value)
    for value in case.th:
        assert_matches_print(full.q[0], value)
    for value in case.T_leading:
        assert_matches_print(leading.T[0], value)
    for value in case.th_leading:
        assert_matches_print(leading.q[0], value)


@cases
def test_peak_deflections_agree_with_the_figures(case):
    m = model_of(case)
    full, leading, simple = exact(m), string(m), linear(m)
    for (method, i), value in PEAKS[case.id].items():
        w = {
            "exact": lambda i=i: steady.deflection(m, full.q, full.Q, i, X),
            "leading": lambda i=i: steady.leading_deflection(m, leading.q, leading.Q, i, X),
            "linear": lambda i=i: steady.deflection(m, simple.q, simple.Q, i, X),
        }[method]()
        assert_matches_print(peak(w), value)


@pytest.mark.parametrize("eps", COUPLING)
def test_coupling_converged(eps):
    model = prototype(eps, 0.0)
    total = jnp.sum(coupling(model, exact(model).Q))
    assert_matches_print(total, Value(COUPLING[eps]))


@pytest.mark.parametrize("eps", COUPLING_LEADING)
def test_leading_coupling(eps):
    model = prototype(eps, 0.0)
    total = jnp.sum(steady.leading_coupling(model, string(model).Q))
    assert_matches_print(total, Value(COUPLING_LEADING[eps]))


@pytest.mark.parametrize(("beta", "s", "printed"), FIGURE_3_10)
def test_coupling_against_speed(beta, s, printed):
    model = prototype(0.015, s, beta=beta)
    assert_matches_print(jnp.sum(coupling(model, exact(model).Q)), Value(printed))


def test_effectiveness_agrees_with_print_and_is_the_slope_of_tension():
    model = prototype(0.01, 0.0)
    eta = steady.effectiveness(model)[0, 0]
    assert_matches_print(eta, Value("0.7852"))
    assert float(steady.effectiveness(prototype(0.01, 0.0, beta=BETA_INEFFECTIVE))[0, 0]) < 1e-20

    def tension(s2):
        return exact(model._replace(eps=jnp.zeros(3), c2=s2 * jnp.ones(3))).T[0]

    # dT/d(s^2) of the string at rest, by its definition.
    assert float(tension(1e-6) / 1e-6) == pytest.approx(float(eta), rel=1e-5)


@pytest.mark.parametrize(
    ("beta", "critical"), [((135.79, 178.74), 2.3503), (BETA_INEFFECTIVE, 1.0)]
)
def test_string_runs_up_to_its_critical_speed(beta, critical):
    def runs(s):
        model = prototype(0.0, s, beta=beta)
        solved = exact(model)
        return bool(solved.converged & ~solved.slack)

    assert runs(critical - 1e-4)
    assert not runs(critical + 1e-4)


@pytest.mark.parametrize(
    "eps", [0.05, *(pytest.param(e, marks=pytest.mark.slow) for e in (0.01, 0.12))]
)
def test_exact_equals_an_independent_collocation(eps):
    model = prototype(eps, 0.3, (0.95, 0.95, 1.3))
    solved, peer = exact(model), solve_standard_form(model, tol=1e-9)
    assert peer.success
    assert float(solved.T[0]) == pytest.approx(peer.T, rel=1e-8)
    assert float(solved.q[0]) == pytest.approx(peer.th, rel=1e-8)
    np.testing.assert_allclose(coupling(model, solved.Q), peer.coupling, rtol=1e-8)


def test_coupling_vanishes_like_eps_in_the_string_limit():
    small, smaller = (prototype(eps, 0.5) for eps in (1e-6, 1e-8))
    totals = [float(jnp.sum(coupling(m, exact(m).Q))) for m in (small, smaller)]
    assert totals[0] / totals[1] == pytest.approx(100.0, rel=1e-5)
    limit = exact(prototype(0.0, 0.5))
    assert float(exact(smaller).T[0]) == pytest.approx(float(limit.T[0]), abs=1e-14)
    assert np.all(np.asarray(coupling(prototype(0.0, 0.5), limit.Q)) == 0.0)


def test_no_wrong_root_where_a_span_has_no_tension_left():
    # D = 0 and s = 1: a naive start lands on Q = 0, where the textbook formulas cancel.
    model = prototype(0.1, 1.0, beta=BETA_INEFFECTIVE)
    model = model._replace(S=model.S - jnp.sum(model.S) / 3)
    solved, peer = exact(model), solve_standard_form(model, tol=1e-9)
    assert float(solved.T[0]) == pytest.approx(peer.T, rel=1e-8)
    assert float(jnp.min(solved.Q)) > 0.1


def test_slack_is_reported_and_harmless():
    def total(s):
        model = prototype(0.0, s)
        solved = steady.exact(model)
        return solved.T[0] + jnp.sum(steady.coupling(model, solved.Q)), solved.slack

    look = jax.jit(jax.vmap(jax.value_and_grad(total, has_aux=True)))
    (values, slack), slopes = look(jnp.array([0.3, 3.0, 0.6]))
    assert slack.tolist() == [False, True, False]
    assert np.all(np.isfinite(values))
    assert slopes[1] == 0.0
    (same, _), slope = look(jnp.array([0.6, 0.6, 0.6]))
    assert (float(values[2]), float(slopes[2])) == pytest.approx(
        (float(same[0]), float(slope[0])), rel=1e-13
    )
