"""Parametric resonance of one span: closed forms of the moving string, Hill, damping."""

import functools
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from beltjax.numerics.bases import Legendre
from beltjax.numerics.floquet import growth, monodromy
from beltjax.numerics.gyroscopic import hermitian_modes
from beltjax.numerics.parametric import (
    critical_square,
    modal_basis,
    modal_generator,
    modulation,
    pair_growth,
    pair_terms,
    pairs_of,
)
from beltjax.physics.span_parametric import span_matrices, span_modulation

CASES = json.loads((Path(__file__).parents[1] / "data" / "parametric.json").read_text())
BASIS = Legendre(24)


def string_pair_coupling(r, s, v, p):
    """sqrt(Lam) of two modes of a moving string: docs/theory/parametric.md, (P19)."""
    waves = abs((-1.0) ** (r + s) * np.exp(-1j * np.pi * (r + s) * v) - 1)
    below = abs((r - s) ** 2 - ((r + s) * v) ** 2)
    shared = 2 * np.pi * (r * s) ** 2 * v * waves / ((r + s) * below)
    return p / 2 * shared / (np.pi * np.sqrt(r * s))


@functools.partial(jax.jit, static_argnums=2)
def modes_of(v, eps, count, damping=(0.0, 0.0)):
    """Modes of a span with the damping a M + b N."""
    M, G, K = span_matrices(BASIS, v, eps)
    C = damping[0] * M + damping[1] * jnp.eye(BASIS.size)
    found, _ = hermitian_modes(M, G, K, BASIS.size)
    return modal_basis(M, G, K, C, found, count), C


@functools.partial(jax.jit, static_argnames=("uniform",))
def waves_of(v, p, dv, frequency, uniform=False):
    return span_modulation(BASIS, v, p, dv, frequency, uniform)


def couplings(v, p, dv, eps=0.0, uniform=False, count=4):
    """Modes, and sqrt(Lam) of each pair in its resonance."""
    basis, _ = modes_of(v, eps, count)
    found = {}
    for r, s in pairs_of(count).tolist():
        center = basis.frequencies[r] + basis.frequencies[s]
        of = modulation(basis, *waves_of(v, p, dv, center, uniform=uniform))
        terms = pair_terms(basis, of, center, np.array([[r, s]]))
        found[r + 1, s + 1] = float(np.sqrt(max(float(terms.product[0]), 0.0)))
    return basis, found


@pytest.mark.parametrize("v", [0.3, 0.5, 0.6, 1 / 3])
def test_moving_string_under_fluctuating_tension(v):
    # Mockensturm, Perkins and Ulsoy (1996); Parker and Lin (2001)
    basis, found = couplings(v, 0.1, 0.0)
    np.testing.assert_allclose(basis.frequencies, np.arange(1, 5) * np.pi * (1 - v**2), rtol=1e-9)
    for (r, s), value in found.items():
        if np.isclose(abs(r - s), (r + s) * v):
            continue  # there the closed form is 0/0
        assert value == pytest.approx(string_pair_coupling(r, s, v, 0.1), abs=2e-9)
        if r == s:
            edge = 0.1 * abs(np.sin(r * np.pi * v)) / (2 * v)
            assert 2 * value == pytest.approx(edge, abs=2e-9)


@pytest.mark.parametrize(("n", "k"), [(2, 1), (3, 1), (3, 2), (4, 1), (4, 3)])
def test_principal_tongues_of_a_string_vanish_at_speeds_k_over_n(n, k):
    _, found = couplings(k / n, 0.1, 0.0)
    assert found[n, n] < 1e-9
    assert found[1, 1] > 0.01


def test_stored_couplings_of_the_moving_string():
    for name, case in CASES["A2_string_tension_first_order"]["values"].items():
        given = dict(part.split("=") for part in name.split(","))
        r, s, v = int(given["r"]), int(given["s"]), float(given["v"])
        if v == 0:  # Mathieu's: Om = 2 om (1 +- p/4)
            _, found = couplings(0.0, 0.1, 0.0)
            assert found[1, 1] == pytest.approx(np.pi * 0.1 / 4, abs=1e-9)
            continue
        v = 1 / 3 if given["v"] == "0.3333" else v
        assert string_pair_coupling(r, s, v, 0.1) == pytest.approx(case["sqrtLambda"], abs=1e-12)


@pytest.mark.parametrize("v", [0.2, 0.3, 0.5])
def test_moving_string_under_fluctuating_speed(v):
    # Pakdemirli and Ulsoy (1997), with uniform tension
    dv = 0.01
    _, found = couplings(v, 0.0, dv, uniform=True)
    for n in (1, 2, 3):
        assert 2 * found[n, n] == pytest.approx(dv * abs(np.sin(n * np.pi * v)), abs=2e-9)


def test_the_tension_that_accelerates_a_belt_is_of_the_same_order():
    _, printed = couplings(0.3, 0.0, 0.01, uniform=True)
    _, whole = couplings(0.3, 0.0, 0.01)
    assert whole[1, 1] / printed[1, 1] == pytest.approx(0.594, abs=5e-4)


def test_a_string_of_fluctuating_speed_has_twice_the_tongue_of_its_first_mode():
    # Exactly, by characteristics: a wave runs to and fro between the pulleys at v(t) + 1 and
    # 1 - v(t). Where the time of a round can be two periods, rounds repeat and waves steepen.
    case = CASES["A3_string_speed"]
    v, dv = case["v0"], case["dv"]

    def round_trip(start, frequency):
        def moved(sense, begin, end):
            swing = dv * (np.sin(frequency * end) - np.sin(frequency * begin)) / frequency
            return (1 + sense * v) * (end - begin) + sense * swing - 1

        to = scipy.optimize.brentq(lambda t: moved(1, start, t), start, start + 5, xtol=1e-14)
        fro = scipy.optimize.brentq(lambda t: moved(-1, to, t), to, to + 5, xtol=1e-14)
        return fro - start

    def extreme(frequency, sense):
        starts = np.linspace(0, 2 * np.pi / frequency, 40, endpoint=False)
        rounds = [sense * round_trip(t, frequency) for t in starts]
        k = int(np.argmax(rounds))
        step = starts[1] - starts[0]
        found = scipy.optimize.minimize_scalar(
            lambda t: -sense * round_trip(t, frequency),
            bounds=(starts[k] - step, starts[k] + step), method="bounded",
            options={"xatol": 1e-10},
        )  # fmt: skip
        return -sense * found.fun

    edges = [
        scipy.optimize.brentq(
            lambda f, sense=sense: extreme(f, sense) - 4 * np.pi / f, 5.6, 5.85, xtol=1e-10
        )
        for sense in (1, -1)
    ]
    np.testing.assert_allclose(sorted(edges), case["exact_edges_characteristics"], rtol=1e-6)
    _, found = couplings(v, 0.0, dv, uniform=True)
    assert abs(edges[1] - edges[0]) / (4 * found[1, 1]) == pytest.approx(2.0, abs=2e-4)


def floquet_growth(v, eps, p, frequency, count, damping=(0.0, 0.0), steps=128):
    return float(_growth(v, eps, p, frequency, count, damping, steps))


@functools.partial(jax.jit, static_argnums=(4, 6))
def _growth(v, eps, p, frequency, count, damping, steps):
    basis, C = modes_of(v, eps, count, damping)
    still, waves = modal_generator(basis, C, *waves_of(v, p, 0.0, frequency))

    def at(part):
        angle = 2 * jnp.pi * part
        return still + jnp.cos(angle) * waves[0] + jnp.sin(angle) * waves[1]

    period = 2 * jnp.pi / frequency
    return growth(monodromy(at, period, steps), period)


def test_modal_truncation_of_a_moving_string_does_not_converge():
    frequency = 2 * np.pi * (1 - 0.49)

    def ratio(p, count):
        found = floquet_growth(0.7, 0.0, p, frequency, count)
        return found / string_pair_coupling(1, 1, 0.7, p)

    few = [ratio(0.01, count) for count in (1, 2, 4)]
    np.testing.assert_allclose(few, [1.0, 1.0, 0.5], atol=1e-3)
    many = [ratio(0.05, count) for count in (4, 8, 12)]
    assert min(abs(many[0] - many[1]), abs(many[1] - many[2])) > 0.02


def test_resonance_of_difference_type_does_not_grow():
    basis, _ = modes_of(0.3, 0.05, 8)
    frequency = float(basis.frequencies[1] - basis.frequencies[0])
    assert frequency == pytest.approx(CASES["A6_difference_type"]["Omega"], rel=1e-9)
    assert abs(floquet_growth(0.3, 0.05, 0.2, frequency, 8, steps=256)) < 1e-11


def test_hill_s_determinant_gives_the_same_growth():
    v, eps, p, count, harmonics = 0.3, 0.05, 0.2, 4, 6
    basis, C = modes_of(v, eps, count, (0.002, 2e-4))
    om, shapes = np.asarray(basis.frequencies), np.asarray(basis.shapes)
    frequency = om[0] + om[1]
    # In complex amplitudes a and conj(a), from the matrices themselves.
    K = p * np.eye(BASIS.size)
    signed = np.concatenate([shapes, shapes.conj()])
    sigma, sign = np.concatenate([om, -om]), np.repeat([1.0, -1.0], count)[:, None]
    of_motion = 1j * sign * (signed.conj() @ np.asarray(C) @ (1j * sigma[:, None] * signed).T)
    still = np.diag(1j * sigma) + of_motion
    wave = 1j * sign * (signed.conj() @ K @ signed.T) / 2
    size = 2 * count
    whole = np.zeros(((2 * harmonics + 1) * size,) * 2, complex)
    for h in range(2 * harmonics + 1):
        at = slice(h * size, (h + 1) * size)
        whole[at, at] = still - 1j * (h - harmonics) * frequency * np.eye(size)
        for other in (h - 1, h + 1):
            if 0 <= other <= 2 * harmonics:
                whole[at, other * size : (other + 1) * size] = wave
    values, vectors = np.linalg.eig(whole)
    blocks = np.abs(vectors.reshape(2 * harmonics + 1, size, -1)) ** 2
    center = np.einsum("h,hsk->k", np.arange(-harmonics, harmonics + 1), blocks)
    centered = np.abs(center / blocks.sum(axis=(0, 1))) < 0.6
    exact = values[centered].real.max()
    found = floquet_growth(v, eps, p, frequency, count, (0.002, 2e-4), steps=512)
    assert exact > 0.05
    assert found == pytest.approx(exact, abs=1e-9)


def test_unequal_damping_of_a_combination():
    case, damping = CASES["A5_combination_unequal_damping"], (0.002, 2e-4)
    v, eps = case["v"], case["eps"]
    basis, _ = modes_of(v, eps, 2, damping)
    np.testing.assert_allclose(basis.frequencies, case["omega"], rtol=1e-9)
    np.testing.assert_allclose(basis.decays, case["decay"], rtol=1e-9)
    for name, one in case["thresholds"].items():
        detuning = 0.0 if "0.000000" in name else case["sqrtLambda_at_p0_2"] / 2
        frequency = float(jnp.sum(basis.frequencies)) + detuning
        of = modulation(basis, *waves_of(v, 1.0, 0.0, frequency))
        terms = pair_terms(basis, of, frequency, np.array([[0, 1]]))
        critical = float(np.sqrt(critical_square(terms)[0]))
        assert critical == pytest.approx(one["first_order_p_crit"], rel=1e-7)
        at_limit = terms._replace(product=critical**2 * terms.product)
        assert float(pair_growth(at_limit)[0]) == pytest.approx(0.0, abs=1e-12)
        # With six modes by Floquet's theory, at its own threshold.
        limit = one["floquet_p_crit"]["6"]
        rates = [
            floquet_growth(v, eps, limit * (1 + part), frequency, 6, damping)
            for part in (-1e-4, 1e-4)
        ]
        assert rates[0] < 0 < rates[1]
        middle = floquet_growth(v, eps, limit, frequency, 6, damping)
        assert abs(middle) < 1e-4 * max(map(abs, rates)) + 1e-9
    apart = case["thresholds"]["sigma=0.044302"]
    least, mean = min(case["decay"]), np.mean(case["decay"])
    unit = case["sqrtLambda_at_p0_2"] / 0.2
    half = case["sqrtLambda_at_p0_2"] / 4
    # The rules of equal damping are off the true limit by a factor.
    for decay in (least, mean):
        assert np.hypot(decay, half) / unit > 1.05 * apart["first_order_p_crit"]


def test_undamped_limit_is_smooth():
    basis, _ = modes_of(0.3, 0.05, 2)
    frequency = 2 * float(basis.frequencies[0]) + 0.02
    of = modulation(basis, *waves_of(0.3, 0.1, 0.0, frequency))
    terms = pair_terms(basis, of, frequency, np.array([[0, 0]]))
    exact = 0.02 / (2 * float(np.sqrt(terms.product[0])))
    assert float(np.sqrt(critical_square(terms)[0])) == pytest.approx(exact, rel=1e-6)
