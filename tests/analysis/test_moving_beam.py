"""Modes of the moving beam: by a second route, at exact limits, and in what they must satisfy."""

import functools

import jax
import jax.numpy as jnp
import legendre_beam
import numpy as np
import pytest
from moving_beams import BENDINGS, COUNT, GRID, SPEEDS, fast, solved

import beltjax as bj

PAIRS = [("simple", "simple"), ("fixed", "simple"), ("fixed", "fixed")]
pairs = pytest.mark.parametrize("ends", PAIRS, ids="-".join)
N = np.arange(1, COUNT + 1)


@pairs
def test_exact_frequencies_against_legendre(ends):
    for eps, v in GRID:
        if eps < 1e-3 and v not in (0.0, 0.95):
            continue  # layers this thin take 360 polynomials: two speeds will do
        size = 360 if eps < 1e-3 else 80
        route = legendre_beam.frequencies(eps, v, ends, COUNT, size)
        np.testing.assert_allclose(solved(ends)[eps, v].frequencies, route, rtol=1e-10)


@pairs
def test_faster_than_the_string_against_legendre(ends):
    # Close to buckling a rounding of the speed alone is worth 1e-16/(0.01 eps^2).
    for eps, v in fast(ends):
        route = legendre_beam.frequencies(eps, v, ends, COUNT, 60)
        np.testing.assert_allclose(solved(ends)[eps, v].frequencies, route, rtol=1e-9)


def test_resting_beam_on_simple_supports():
    for eps in BENDINGS:
        exact = np.pi * N * np.sqrt(1 + (eps * np.pi * N) ** 2)
        found = solved(("simple", "simple"))[eps, 0.0]
        np.testing.assert_allclose(found.frequencies, exact, rtol=3e-16 * N[-1])
        x = jnp.linspace(0, 1, 9)
        np.testing.assert_allclose(found.shapes(x), np.sin(np.pi * N[:, None] * x), atol=1e-13)


@pytest.mark.parametrize(
    ("ends", "roots"),
    [
        (("simple", "simple"), (np.pi, 2 * np.pi)),
        (("fixed", "simple"), (3.926602312047919, 7.068582745628732)),  # tan b = tanh b
        (("fixed", "fixed"), (4.730040744862704, 7.853204624095838)),  # cos b cosh b = 1
    ],
)
def test_without_tension_the_beam_is_the_textbooks(ends, roots):
    # omega = eps b^2, less by tension's share of order 1/eps^2.
    found = solved(ends)[1e3, 0.0].frequencies[:2] / 1e3
    np.testing.assert_allclose(found, np.square(roots), rtol=1e-6)


@pairs
@pytest.mark.parametrize("v", [0.0, 0.6, -0.6])
def test_without_stiffness_the_beam_is_a_string(ends, v):
    string = solved(ends)[0.0, v]
    np.testing.assert_allclose(string.frequencies, N * np.pi * (1 - v**2), rtol=1e-15)
    x = jnp.linspace(0, 1, 7)
    exact = np.sin(np.pi * N[:, None] * x) * np.exp(-1j * np.pi * N[:, None] * v * x)
    np.testing.assert_allclose(string.shapes(x), exact, atol=2e-14)


@pairs
def test_opposite_travel_conjugates_the_modes(ends):
    there, back = (solved(ends)[0.05, v] for v in (0.6, -0.6))
    np.testing.assert_allclose(there.frequencies, back.frequencies, rtol=1e-14)
    x = jnp.linspace(0, 1, 7)
    a, b = there.shapes(x), jnp.conj(back.shapes(x))
    ratio = jnp.sum(a * jnp.conj(b), axis=1) / jnp.sum(jnp.abs(b) ** 2, axis=1)
    np.testing.assert_allclose(a, ratio[:, None] * b, atol=1e-12)


def test_bending_and_fixing_only_raise_frequencies():
    simple, mixed, fixed = (solved(ends) for ends in PAIRS)
    for v in SPEEDS:
        rising = np.array([simple[eps, v].frequencies for eps in BENDINGS])
        assert np.all(np.diff(rising, axis=0) > 0)
        for eps in BENDINGS:
            assert np.all(simple[eps, v].frequencies < mixed[eps, v].frequencies)
            assert np.all(mixed[eps, v].frequencies < fixed[eps, v].frequencies)


@functools.cache
def three_ways(ends):
    """Answers of twelve beams (bending, speed) at a time, with both derivatives."""

    def answers(numbers):
        modes = bj.moving_beam_modes(*numbers, ends, 3, throw=False)
        moved = jnp.abs(modes.shapes(jnp.array([0.01, 0.3, 0.7]))) ** 2
        return jnp.concatenate([modes.frequencies, jnp.sum(moved, axis=1)]), modes.result

    @jax.jit
    @jax.vmap
    def look(numbers):
        value, push, result = jax.linearize(answers, numbers, has_aux=True)
        pull = jax.linear_transpose(push, numbers)
        forward = jax.vmap(push, out_axes=-1)(jnp.eye(2))
        reverse = jax.vmap(lambda cotangent: pull(cotangent)[0])(jnp.eye(value.size))
        return value, forward, reverse, result

    return look


@pytest.mark.slow
@pytest.mark.parametrize(
    "ends",
    [
        ("fixed", "simple"),
        pytest.param(("simple", "simple"), marks=pytest.mark.slow),  # each compiles anew
        pytest.param(("fixed", "fixed"), marks=pytest.mark.slow),
        pytest.param(("simple", "fixed"), marks=pytest.mark.slow),
    ],
    ids="-".join,
)
def test_derivatives_three_ways(ends):
    look = three_ways(ends)
    beams = [(1e-3, 0.4), (0.05, 0.0), (0.05, 0.9), (0.2, 1.0), (0.2, 1.05), (2.0, 0.5)]
    beams = np.array(beams * 2)
    _, forward, reverse, _ = look(beams)
    np.testing.assert_allclose(forward, reverse, rtol=1e-9, atol=1e-9)
    for k in range(2):
        step = 2e-4 * np.maximum(beams[:, k : k + 1], 1e-3) * np.eye(2)[k]
        at = [np.asarray(look(beams + m * step)[0]) for m in (-2, -1, 1, 2)]
        difference = (at[0] - at[3] + 8 * (at[2] - at[1])) / (12 * np.sum(step, 1, keepdims=True))
        np.testing.assert_allclose(forward[:, :, k], difference, rtol=1e-6, atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("ends", [("fixed", "simple")])
def test_frequency_slopes_of_a_string(ends):
    # d omega/d eps = n pi sqrt(1-v^2) for each fixed end, by (2.37) and (2.38).
    beams = np.array([(0.0, 0.0), (0.0, 0.6)] * 6)
    _, forward, reverse, _ = three_ways(ends)(beams)
    for lane, v in ((0, 0.0), (1, 0.6)):
        slope = ends.count("fixed") * np.sqrt(1 - v**2)
        exact = np.pi * N[:3, None] * np.array([[slope, -2 * v]])
        np.testing.assert_allclose(forward[lane, :3], exact, rtol=1e-14, atol=1e-14)
        np.testing.assert_allclose(reverse[lane, :3], exact, rtol=1e-14, atol=1e-14)
    assert np.all(np.isfinite(forward))


def test_bad_lanes_are_reported_and_harmless():
    critical = float(np.sqrt(1 + (4.493409457909064 * 0.1) ** 2))
    lanes = [
        ((0.1, 0.5), "successful"),
        ((0.1, 1.0), "successful"),
        ((0.1, critical * 0.999), "successful"),
        ((0.1, critical * 1.001), "beyond_critical_speed"),
        ((0.1, -5.0), "beyond_critical_speed"),
        ((0.0, 1.0), "beyond_critical_speed"),
        ((-0.1, 0.5), "beam_unusable"),
        ((np.nan, 0.5), "beam_unusable"),
        ((0.1, np.inf), "beam_unusable"),
        ((1e-7, 0.5), "successful"),
        ((30.0, 0.5), "successful"),
        ((0.1, 0.5), "successful"),
    ]
    batch = np.array([numbers for numbers, _ in lanes])
    values, forward, reverse, results = three_ways(("fixed", "simple"))(batch)
    for k, (numbers, name) in enumerate(lanes):
        result = jax.tree.map(lambda x, k=k: x[k], results)
        assert result == getattr(bj.RESULTS, name), numbers
        if name == "successful":
            assert np.all(values[k] > 0)
            assert np.any(forward[k] != 0)
        else:
            assert np.all(values[k] == 0)
            assert np.all(forward[k] == 0)
            assert np.all(reverse[k] == 0)
    assert np.all(np.isfinite(forward))
    assert np.all(np.isfinite(reverse))
    for answer in (values, forward, reverse):
        np.testing.assert_array_equal(answer[0], answer[-1])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((-0.1, 0.5), "bending: found -0.1, .* Give 0 for a string"),
        ((np.nan, 0.5), "bending: found nan; give a finite number"),
        ((0.1, np.inf), "speed: found inf; give a finite number"),
        (([0.1, 0.2], 0.5), r"bending: give one number, not an array of shape \(2,\); jax.vmap"),
        ((0.1, 0.5, ("simple", "clamped")), "ends: unknown support 'clamped'; give 'simple' or"),
        ((0.1, 0.5, "simple"), "ends: give a pair such as .* not 'simple'"),
        ((0.1, 0.5, ("simple",) * 3), "ends: give a pair"),
        ((0.1, 0.5, ("simple", "fixed"), 0), "count: give a whole number of modes, 1 or more"),
        ((0.1, 0.5, ("simple", "fixed"), 2.5), "count: .* not 2.5"),
        ((0.1, 0.5, ("simple", "fixed"), 2, "guess"), "method: 'guess' is not one of 'exact', 'p"),
    ],
)
def test_bad_input_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        bj.moving_beam_modes(*arguments)
