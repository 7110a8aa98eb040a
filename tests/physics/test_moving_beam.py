"""Supports, phases and expansions of the moving beam: printed values, exact facts, orders."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from moving_beams import SMALL, solved
from published import assert_matches_print
from scipy.optimize import brentq

from beltjax.physics import moving_beam as beam
from beltjax.physics import moving_beam_expansion as expansion
from beltjax.physics import moving_beam_shapes as shapes
from beltjax.physics.waves import wave_numbers
from beltjax.validation.printed.beam import TABLE_2_1

PAIRS = [("simple", "simple"), ("fixed", "simple"), ("fixed", "fixed")]
pairs = pytest.mark.parametrize("ends", PAIRS, ids="-".join)
waves_of = jax.jit(beam.beam_waves)


def roots_of(eps, v, omega):
    return wave_numbers(*(jnp.asarray(x, dtype=float) for x in (eps**2, 1 - v**2, v, 1.0, omega)))


def parts(roots):
    return roots.r1, roots.r2, roots.r3.real, roots.r3.imag


@pytest.mark.parametrize("case", TABLE_2_1, ids=lambda c: f"eps={c.eps}")
def test_table_2_1(case):
    numbers = case.eps, case.v, case.omega
    for printed, roots in (
        (case.exact, roots_of(*numbers)),
        (case.leading, expansion.leading_wave_numbers(*numbers)),
    ):
        for value, root in zip(printed, parts(roots), strict=True):
            assert_matches_print(root, value)


def test_a_simple_support_turns_the_phase_by_order_eps_cubed():
    # Fig. 2.2: arg R_A = pi + 8 eps^3 v^2 omega^3/(1-v^2)^(9/2), with a remainder of order eps^5.
    v, omega = 0.4, 2.0
    remainders = []
    for eps in (0.004, 0.008):
        phi = beam.reflection_phase("simple", eps, waves_of(eps, v, omega))
        leading = 8 * eps**3 * v**2 * omega**3 / (1 - v**2) ** 4.5
        remainders.append(float(phi) / leading - 1)
    assert abs(remainders[0]) < 5e-3
    assert np.log2(remainders[1] / remainders[0]) == pytest.approx(2, abs=0.05)


@pytest.mark.parametrize("support", beam.SUPPORTS)
@pytest.mark.parametrize("v", [-0.7, 0.0, 0.3, 0.95])
def test_phases_are_those_of_the_reflection_coefficients(support, v):
    eps, omega = 0.15, 3.0
    phi = beam.reflection_phase(support, eps, waves_of(eps, v, omega))
    sent = shapes.reflection(support, roots_of(eps, v, omega))
    for R in (sent.R_A, sent.R_B):
        assert np.exp(1j * (np.pi + phi)) == pytest.approx(complex(R / abs(R)), abs=1e-14)
    assert abs(sent.R_A * sent.R_B) == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize("support", beam.SUPPORTS)
def test_reflected_waves_meet_the_support(support):
    q = 2 if support == "simple" else 1
    r1, r2, r3, r4 = (complex(r) for r in roots_of(0.08, 0.5, 4.0))
    sent = shapes.reflection(support, roots_of(0.08, 0.5, 4.0))
    for arriving, R, leaving, layer, r in (
        (r2, sent.R_A, r1, sent.Rbar_A, r3),
        (r1, sent.R_B, r2, sent.Rbar_B, r4),
    ):
        assert abs(1 + R + layer) < 1e-14
        assert abs(arriving**q + R * leaving**q + layer * r**q) < 1e-13 * abs(r**q)


@pytest.mark.parametrize("ends", [*PAIRS, ("simple", "fixed")], ids="-".join)
@pytest.mark.parametrize("numbers", [(0.2, 0.95), (0.05, 0.3), (1e-4, 0.0)])
def test_exact_modes_meet_all_four_conditions(ends, numbers):
    # Also the one at x = 1 that the amplitudes were not made from.
    same = ends if ends in PAIRS else ends[::-1]
    omega = solved(same)[numbers].frequencies
    roots = roots_of(*numbers, omega)
    r, c = jnp.stack([*roots]), jnp.stack(shapes.exact_amplitudes(roots, ends))
    x = jnp.array([0.0, 1.0])[:, None, None]
    for end, support in enumerate(ends):
        q = 2 if support == "simple" else 1
        waves = c * jnp.exp(1j * r * (x[end] - jnp.array([0, 0, 0, 1])[:, None]))
        assert np.max(np.abs(jnp.sum(waves, axis=0))) < 1e-13
        # A layer's amplitude is known to a rounding of the travelling waves'.
        size = jnp.max(jnp.abs(r**q * waves), axis=0) + 1e-3 * jnp.abs(r[2]) ** q
        assert np.max(np.abs(jnp.sum(r**q * waves, axis=0)) / size) < 1e-11


def test_only_a_moving_beam_has_layers_at_simple_supports():
    resting, moving = (solved(("simple", "simple"))[0.05, v].amplitudes for v in (0.0, 0.6))
    assert np.max(np.abs(resting[:, 2:])) < 1e-14
    assert np.min(np.abs(moving[:, 2:])) > 1e-2
    roots = expansion.leading_wave_numbers(0.05, 0.0, np.pi)
    layers = shapes.leading_amplitudes(roots, ("simple", "simple"))[2:]
    np.testing.assert_array_equal(jnp.stack(layers), 0.0)


def order(errors):
    return float(np.log2(np.abs(errors[1] / errors[0])))


@pytest.mark.parametrize(
    ("ends", "v", "printed", "refined"),
    [
        (("simple", "simple"), 0.0, 4, 4),  # no odd powers at rest
        (("simple", "simple"), 0.6, 3, 4),
        (("fixed", "simple"), 0.0, 2, 3),
        (("fixed", "simple"), 0.6, 2, 3),
        (("fixed", "fixed"), 0.0, 2, 3),
        (("fixed", "fixed"), 0.6, 2, 3),
    ],
)
def test_orders_of_the_frequencies(ends, v, printed, refined):
    stop = expansion.PRINTED_ORDER[ends.count("fixed")]
    errors = []
    for eps in SMALL:
        exact = float(solved(ends)[eps, v].frequencies[0])
        terms = expansion.frequency_terms(eps, v, 1, ends)
        errors.append((sum(terms[: stop + 1]) - exact, sum(terms) - exact))
    first, second = np.transpose(errors)
    assert order(first) == pytest.approx(printed, abs=0.15)
    assert order(second) == pytest.approx(refined, abs=0.15)


@pytest.mark.parametrize("v", [0.3, 0.6, 0.9])
def test_what_2_28_leaves_out(v):
    # The next term, -8 eps^3 (n pi)^3 v^2/sqrt(1-v^2), for the speeds of Fig. 2.3.
    eps = 0.003 * (1 - v**2)
    ends = ("simple", "simple")
    exact = brentq(
        lambda w: float(jitted_closure(w, eps, v)), *(np.pi * (1 - v**2) * np.array([0.9, 1.2])),
        xtol=1e-15, rtol=1e-15,
    )  # fmt: skip
    terms = expansion.frequency_terms(eps, v, 1, ends)
    assert (exact - float(sum(terms[:3]))) / float(terms[3]) == pytest.approx(1.0, abs=0.05)


@jax.jit
def jitted_closure(omega, eps, v):
    ends = ("simple", "simple")
    return beam.closure_phase(ends, eps, beam.beam_waves(eps, v, omega)) - jnp.pi


def test_figure_2_3():
    # The curves start at the string's frequency and rise; the approximation lies above, the more
    # so the stiffer and the faster the beam.
    ends = ("simple", "simple")
    bendings, gaps = (0.01, 0.05, 0.12), []
    for v in (0.0, 0.3, 0.6, 0.9):
        exact = np.array([solved(ends)[eps, v].frequencies[0] for eps in bendings])
        assert exact[0] == pytest.approx(np.pi * (1 - v**2), rel=0.02)
        printed = [sum(expansion.frequency_terms(eps, v, 1, ends)[:3]) for eps in bendings]
        gaps.append(np.array(printed) / exact - 1)
    assert np.all(np.array(gaps) > 0)
    assert np.all(np.diff(gaps, axis=0) > 0)
    assert np.all(np.diff(gaps, axis=1) > 0)


@pairs
def test_modes_by_expansion(ends):
    # (2.34) is as good as its frequency: of order eps^4 for simple supports, else eps^3.
    x, errors = jnp.linspace(0, 1, 41), []
    for eps in SMALL:
        exact = solved(ends)[eps, 0.6].shapes(x)[0]
        omega = sum(expansion.frequency_terms(eps, 0.6, 1, ends))
        roots = expansion.leading_wave_numbers(eps, 0.6, omega)
        c = jnp.stack(shapes.leading_amplitudes(roots, ends))
        errors.append(jnp.max(jnp.abs(shapes.shape(jnp.stack([*roots]), c, x) - exact)))
    assert order(errors) == pytest.approx(3 if "fixed" in ends else 4, abs=0.2)


@pytest.mark.parametrize("n", [1, 2])
def test_omalley_with_its_sign_corrected(n):
    x, errors = jnp.linspace(0, 1, 401), []
    for eps in SMALL:
        assert abs(shapes.omalley_shape(eps, n, jnp.array(1.0))) < 1e-15
        exact = solved(("fixed", "fixed"))[eps, 0.0].shapes(x)[n - 1]
        approximate = shapes.omalley_shape(eps, n, x)
        scale = jnp.vdot(exact, approximate) / jnp.vdot(exact, exact)
        errors.append(jnp.max(jnp.abs(scale * exact - approximate)))
    assert order(errors) == pytest.approx(2, abs=0.2)


def test_fixed_ends_at_rest_to_the_order_of_omalley():
    # (2.39): n pi (1 + 2 eps).
    terms = expansion.frequency_terms(0.01, 0.0, 3, ("fixed", "fixed"))
    assert float(terms[0] + terms[1]) == pytest.approx(3 * np.pi * 1.02, rel=1e-15)


@pytest.mark.parametrize("eps", [0.03, 0.05, 0.12])
def test_where_the_closure_alone_is_not_enough(eps):
    # (2.17) with exact roots neglects e^{-k}, k = Im r3: for fixed ends a share of
    # 4 (d/k) e^{-k} cos(2 Re r3)/(n pi) of the frequency, from 1e-16 to 1e-5 here.
    ends, v = ("fixed", "fixed"), 0.3
    exact = float(solved(ends)[eps, v].frequencies[0])
    phase = jax.jit(lambda w: beam.closure_phase(ends, eps, beam.beam_waves(eps, v, w)))
    bracket = 0.5 * exact, 1.5 * exact
    root = brentq(lambda w: float(phase(w)) - np.pi, *bracket, xtol=1e-15, rtol=1e-15)
    r = np.roots([eps**2, 0, 1 - v**2, 2 * v * exact, -(exact**2)])
    r3, (r2, r1) = r[np.argmax(r.imag)], np.sort(r[np.abs(r.imag) < 1e-9].real)
    neglected = 2 * (r1 - r2) / r3.imag * np.exp(-r3.imag) * np.cos(2 * r3.real) / np.pi
    assert abs(root / exact - 1) == pytest.approx(abs(neglected), rel=0.2, abs=1e-14)
