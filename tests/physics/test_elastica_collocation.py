"""A span by the library's collocation against SciPy's, for every pattern of senses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import beltjax as bj
from beltjax.physics.elastica import SpanData, elastica
from beltjax.physics.elastica_collocation import span_by_collocation, tangent_contact
from beltjax.validation.peers.span import bent_span

STEP = 1e-4  # relative, of a difference
SIGNS = [(1, 1), (1, -1), (-1, 1), (-1, -1)]

pytestmark = pytest.mark.slow  # a minute, most of it compiling


def numbers_of_spans():
    """(C, EI, rho_start, rho_end, d) [5, spans]: layers of 0.01 to 0.6 of the length, in SI."""
    C, d, rows = 80.0, 0.16, []
    for k, layer in enumerate((0.01, 0.03, 0.1, 0.2, 0.35, 0.5)):
        least = 0.76 * layer * d  # below it P(0) would be less than a tenth of C
        for start, end in SIGNS:
            small, large = max(0.03, least), max(0.06 - 0.004 * k, least)
            apart = max(d, 1.1 * (small + large))
            rows.append((C, C * (layer * d) ** 2, start * small, end * large, apart))
    return np.array(rows).T


@jax.jit
def solved_with_slopes(numbers, off):
    """Every span from a guess that is off, and the derivative of all with respect to log EI."""

    def solve(numbers):
        guess = jax.vmap(tangent_contact)(*numbers)
        guess = guess._replace(length=guess.length * off)
        spans = jax.vmap(span_by_collocation)(*numbers, guess)
        return jnp.stack(spans[:4]), (spans.error, spans.result)

    along = jnp.zeros_like(numbers).at[1].set(numbers[1])
    return jax.jvp(solve, (numbers,), (along,), has_aux=True)


@pytest.fixture(scope="module")
def ours():
    numbers = numbers_of_spans()
    values, slopes, evidence = solved_with_slopes(jnp.asarray(numbers), 1.03)
    return np.asarray(values), np.asarray(slopes), evidence


def by_scipy(C, EI, rho_start, rho_end, d):
    tension = C - EI / (2 * rho_start**2)
    span = bent_span(tension, EI, rho_start, rho_end, d, tol=1e-7)
    return np.array([span.length, span.angle_start, span.angle_end, span.middle])


def test_spans_agree_with_scipy(ours):
    values, _, (error, result) = ours
    assert np.all(np.asarray(result == bj.RESULTS.successful))
    assert float(error.max()) < 1e-10
    expected = np.array([by_scipy(*row) for row in numbers_of_spans().T]).T
    scale = np.array([0.16, 1.0, 1.0, 80.0])[:, None]
    assert np.max(np.abs(values - expected) / scale) < 1e-10


def closed_form(numbers):
    """Length, end angles and tension at mid-arc, and their derivative with respect to log EI."""

    def solve(numbers):
        C, EI, rho_i, rho_j, d = numbers
        data = SpanData(C, EI, jnp.full_like(C, 1e5), d, rho_i, rho_j, 1 / rho_i, 1 / rho_j)
        span = jax.vmap(elastica)(data)
        start, end = -2 * jnp.sign(rho_i) * span.u_i, 2 * jnp.sign(rho_j) * span.u_j
        return jnp.stack([span.L, span.phi + start, span.phi + end, span.P_mid]), span.converged

    along = jnp.zeros_like(numbers).at[1].set(numbers[1])
    return jax.jvp(solve, (numbers,), (along,), has_aux=True)


def test_the_elasticas_closed_form_is_the_span_by_collocation(ours):
    values, slopes, _ = ours
    closed, closed_slopes, converged = jax.jit(closed_form)(jnp.asarray(numbers_of_spans()))
    assert np.all(converged)
    scale = np.array([0.16, 1.0, 1.0, 80.0])[:, None]
    assert np.max(np.abs(values - closed) / scale) < 1e-9
    assert np.max(np.abs(slopes - closed_slopes) / scale) < 1e-8


@pytest.mark.slow  # SciPy's differences
def test_derivatives_are_differences_of_scipys(ours):
    _, slopes, _ = ours
    for k in (2, 9, 15, 18):  # one of each pattern of senses, of four layers
        row = numbers_of_spans().T[k]
        ends = [by_scipy(row[0], row[1] * (1 + h), *row[2:]) for h in (STEP, -STEP)]
        difference = (ends[0] - ends[1]) / (2 * STEP)
        assert slopes[:, k] == pytest.approx(difference, rel=1e-5, abs=1e-7)


def test_both_senses_turned_mirror_the_span(ours):
    length, start, end, P = ours[0].reshape(4, 6, 4)
    for k, (first, second) in enumerate(SIGNS):
        mirrored = SIGNS.index((-first, -second))
        assert length[:, k] == pytest.approx(length[:, mirrored], rel=1e-12)
        assert start[:, k] == pytest.approx(-start[:, mirrored], rel=1e-10)
        assert end[:, k] == pytest.approx(-end[:, mirrored], rel=1e-10)
        assert P[:, k] == pytest.approx(P[:, mirrored], rel=1e-11)
