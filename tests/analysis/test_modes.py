"""Natural modes against print, SciPy, and between two routes that share no discretization."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from drives import at_groups, example, vibrating, with_inertias
from published import ARM, RADII, Value, assert_matches_print
from vibration import (
    companion_frequencies,
    frequencies_at_rest,
    held,
    linearized,
    matrices,
    solver,
    source_frequencies,
    source_model,
)

import beltjax as bj
from beltjax.physics.exact_vibration import characteristic, span_response
from beltjax.validation.printed import vibration as printed

DRIVES = ["three_pulley", "four_pulley", "seven_pulley"]
# Figs. 4.2-4.4, string at rest: what the captions misprint, by sine, Legendre and the exact route
# (docs/theory/corrections.md).
CONVERGED = {"span 3": "1.9955", "span 2": "2.9936", "rotational": "3.5074"}
CAPTIONS = dict(printed.STRING.values())
STRING = {name: (Value(text), CAPTIONS[name]) for name, text in CONVERGED.items()}


@pytest.mark.parametrize("basis", [bj.Sine(60), bj.Legendre(40)], ids=["sine", "legendre"])
def test_string_limit_of_table_4_1(basis):
    found, _ = source_frequencies(0.0, 0.0, basis)
    for frequency, (converged, caption) in zip(found, STRING.values(), strict=False):
        assert_matches_print(frequency, converged)
        assert_matches_print(frequency, caption)


def test_string_limit_by_the_exact_route():
    model, others = source_model(0.0, 0.0), jnp.array([1, 2])
    below = jax.jit(lambda w: characteristic(model, others, w).below)
    for number, (converged, _) in enumerate(STRING.values(), start=1):
        assert below(converged.number - converged.half_digit) == number - 1
        assert below(converged.number + converged.half_digit) == number


def test_captions_follow_from_a_slip_in_the_inertia():
    # To the digits to which the print's rounded inputs fix them.
    model = source_model(0.0, 0.0)
    slipped = model._replace(M_r=model.M_r * (RADII / ARM))
    M, _, K = held(matrices(slipped, bj.Legendre(40)), 3)
    found = frequencies_at_rest(M, K)[:4]
    assert found[1] == pytest.approx(3.0951, abs=1.5e-4)
    assert found[3] == pytest.approx(4.1249, abs=1.5e-4)


def sine_frequencies(matrices, terms, largest, spans):
    """First eight at rest with fewer sine terms: the bases are nested."""
    own = np.concatenate([np.arange(i * largest, i * largest + terms) for i in range(spans)])
    rest = np.arange(spans * largest, len(matrices[0]))
    at = np.ix_(*2 * [np.concatenate([own, rest])])
    M, _, K = (np.asarray(m)[at] for m in matrices)
    return frequencies_at_rest(M, K)[:8]


# docs/theory/vibration.md: sine terms a span for 3 %, 0.1 % and 1e-6 in the first eight modes.
COUNTS = {0.1: (5, 15, 63), 0.04: (7, 24, 105), 0.01: (4, 28, 201)}


@pytest.mark.parametrize("eps", COUNTS)
def test_sine_terms_for_an_accuracy(eps):
    model = source_model(eps, 0.0)
    M, _, K = held(matrices(model, bj.Legendre(64)), 3)
    converged = frequencies_at_rest(M, K)[:8]
    sine = held(matrices(model, bj.Sine(202)), 3)

    def worst(terms):
        found = sine_frequencies(sine, terms, 202, 3)
        # At rest the Rayleigh-Ritz bound holds: from above.
        assert np.all(found >= converged * (1 - 1e-12))
        return np.max(found / converged - 1)

    for count, tolerance in zip(COUNTS[eps], (3e-2, 1e-3, 1e-6), strict=True):
        assert worst(count) <= tolerance < worst(count - 1)


@pytest.mark.parametrize("eps", [0.01, 0.04, 0.1])
def test_legendre_converges_exponentially(eps):
    coarse, _ = source_frequencies(eps, 0.5, bj.Legendre(48))
    fine, _ = source_frequencies(eps, 0.5, bj.Legendre(72))
    np.testing.assert_allclose(coarse[:16], fine[:16], rtol=1e-10)


@pytest.mark.parametrize(
    "name", [DRIVES[0], *(pytest.param(name, marks=pytest.mark.slow) for name in DRIVES[1:])]
)
def test_exact_route_finds_every_frequency(name):
    drive = vibrating(name)
    for eps in (0.005, 0.04, 0.15):
        for s in (0.0, 0.5, 1.2):
            running, point = at_groups(drive, eps, s)
            exact = solver(bj.Sine(8), 16, True)(running, point)
            if exact.result == bj.RESULTS.span_slack:
                continue
            assert exact.result == bj.RESULTS.successful
            converged = solver(bj.Legendre(64), 16)(running, point).dimensionless
            # One by one: none is missing, none double.
            np.testing.assert_allclose(exact.dimensionless, converged, rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("s", [0.0, 0.5, 1.2])
def test_dynamic_stiffness_is_hermitian(s):
    lin = linearized("seven_pulley", 0.04, s, bj.Sine(1))
    for omega in (0.7, 3.3, 9.1):
        forces = np.asarray(jax.jit(span_response)(lin.model, jnp.asarray(omega)).forces)
        adjoint = np.conj(np.swapaxes(forces, 1, 2))
        assert np.abs(forces - adjoint).max() < 1e-13 * np.abs(forces).max()


def test_counts_between_frequencies():
    lin = linearized("three_pulley", 0.04, 0.5, bj.Legendre(40))
    reference, _ = companion_frequencies(lin.mass, lin.gyroscopic, lin.stiffness)
    between = (reference[:20] + reference[1:21]) / 2
    count = jax.jit(jax.vmap(lambda w: characteristic(lin.model, lin.rotors, w).below))
    np.testing.assert_array_equal(count(jnp.asarray(between)), np.arange(1, 21))


@pytest.mark.parametrize("name", DRIVES)
def test_hermitian_route_equals_scipy(name):
    lin = linearized(name, 0.04, 0.6, bj.Legendre(12))
    found = bj.modes(lin, 16)
    reference, _ = companion_frequencies(lin.mass, lin.gyroscopic, lin.stiffness)
    np.testing.assert_allclose(found.dimensionless, reference[:16], rtol=1e-10)
    np.testing.assert_array_equal(found.growth_rates, 0.0)
    general = bj.modes(lin, 16, route="general")
    np.testing.assert_allclose(general.dimensionless, reference[:16], rtol=1e-10)
    assert general.result == found.result == bj.RESULTS.successful


def test_shapes_satisfy_the_equations_and_are_orthogonal():
    lin = linearized("three_pulley", 0.04, 0.6, bj.Legendre(12))
    found = bj.modes(lin, 6)
    M, G, K = (np.asarray(m) for m in (lin.mass, lin.gyroscopic, lin.stiffness))
    v, omega = np.asarray(found.coordinates), np.asarray(found.dimensionless)
    for shape, w in zip(v, omega, strict=True):
        residual = (K + 1j * w * G - w**2 * M) @ shape
        assert np.abs(residual).max() < 1e-10 * np.abs(K @ shape).max()
    energy = np.outer(omega, omega) * (v.conj() @ M @ v.T) + v.conj() @ K @ v.T
    # 1 joule: a quarter of the Hermitian form, in P0 l.
    joule = float(lin.scales.energy)
    np.testing.assert_allclose(energy / 4 * joule, np.eye(6), atol=1e-9)
    shares = found.span_shares.sum(1) + found.rotor_shares.sum(1) + found.tensioner_shares
    np.testing.assert_allclose(shares, 1.0, rtol=1e-12)


def test_uncoupled_modes_get_their_names():
    # String at rest: 1.9955 is span 3 alone, 3.5074 turns the pulleys.
    drive, point = at_groups(vibrating("three_pulley"), 0.0, 0.0)
    found = bj.modes(bj.linearize(bj.steady_state(drive, point), bj.Sine(12)), 3)
    assert found.labels[0] == "span 2"
    assert found.labels[2] == "rotational"
    assert float(found.span_shares[0, 2]) == pytest.approx(1.0, abs=1e-12)
    x = jnp.linspace(0, 1, 21)
    shape = found.deflection(0, 2, x)
    np.testing.assert_allclose(shape / shape[10], jnp.sin(jnp.pi * x), atol=1e-12)


def test_divergence_of_the_string_at_its_critical_speed():
    # docs/theory/steady_state.md, (S14), for the source's rounded numbers.
    def lowest_stiffness(s):
        model = source_model(0.0, s)
        K = np.asarray(matrices(model, bj.Sine(40))[2])
        K = np.delete(np.delete(K, 120, 0), 120, 1)
        return np.linalg.eigvalsh(K)[0]

    speeds = np.linspace(2.30, 2.3502, 12)
    values = [lowest_stiffness(s) for s in speeds]
    # The steady state ends there with Q -> 0; K's lowest eigenvalue goes to zero linearly.
    slope, offset = np.polyfit(speeds[-4:], values[-4:], 1)
    assert -offset / slope == pytest.approx(2.3503, abs=1e-3)


def with_stiffness(lin, change):
    return dataclasses.replace(lin, stiffness=lin.stiffness + change)


def test_a_divergent_drive_is_a_result():
    lin = linearized("three_pulley", 0.04, 0.0, bj.Legendre(8))
    M, K = np.asarray(lin.mass), np.asarray(lin.stiffness)
    lowest = scipy.linalg.eigh(K, M, eigvals_only=True)[0]
    soft = with_stiffness(lin, -1.5 * lowest * lin.mass)
    found = bj.modes(soft, 4, throw=False)
    assert found.result == bj.RESULTS.drive_diverges
    # omega^2 = lowest - 1.5 lowest at rest: growth by its root.
    growth = np.sqrt(0.5 * lowest) / float(lin.scales.time)
    assert float(found.growth_rates[0]) == pytest.approx(growth, rel=1e-9)
    assert float(found.frequencies[0]) == 0.0
    unsolved = bj.modes(soft, 4, route="hermitian", throw=False)
    assert unsolved.result == bj.RESULTS.drive_diverges
    with pytest.raises(bj.AnalysisError, match=r"^The running drive is unstable without oscill"):
        bj.modes(soft, 4)


def test_flutter_is_a_result():
    lin = linearized("three_pulley", 0.04, 0.0, bj.Legendre(4))
    size = len(lin.mass)
    follower = np.zeros((size, size))
    follower[0, 1], follower[1, 0] = 400.0, -400.0  # a circulatory force: not from an energy
    found = bj.modes(with_stiffness(lin, jnp.asarray(follower)), size, route="general", throw=False)
    assert found.result == bj.RESULTS.drive_flutters
    assert float(jnp.max(found.growth_rates)) > 0


def test_damping_ratio_of_all_modes():
    lin = linearized("three_pulley", 0.04, 0.0, bj.Legendre(8))
    free = bj.modes(lin, 6)
    damped = bj.modes(lin, 6, damping=bj.Damping(modal=0.03, arm=False))
    size = jnp.hypot(damped.frequencies, damped.growth_rates)
    np.testing.assert_allclose(-damped.growth_rates / size, 0.03, rtol=1e-9)
    np.testing.assert_allclose(size, free.frequencies, rtol=1e-9)
    assert damped.result == bj.RESULTS.successful


@pytest.mark.slow
def test_a_free_drive_leaves_its_rotation_out():
    held = linearized("three_pulley", 0.04, 0.4, bj.Legendre(10))
    free = linearized("three_pulley", 0.04, 0.4, bj.Legendre(10), free=True)
    found = bj.modes(free, 8)
    reference, _ = companion_frequencies(free.mass, free.gyroscopic, free.stiffness)
    np.testing.assert_allclose(found.dimensionless, reference[reference > 1e-4][:8], rtol=1e-9)
    assert bj.modes(free, 8, exact=True).result == bj.RESULTS.successful
    # A driver of endless inertia is held.
    heavy, point = at_groups(vibrating("three_pulley"), 0.04, 0.4)
    heavy = eqx.tree_at(lambda d: d.pulleys[0].inertia, heavy, jnp.asarray(1e9))
    heavy = bj.linearize(bj.steady_state(heavy, point), bj.Legendre(10), free=True)
    np.testing.assert_allclose(
        bj.modes(heavy, 8).frequencies, bj.modes(held, 8).frequencies, rtol=1e-7
    )


def test_locked_centers_have_no_arm():
    drive, point = example("three_pulley")
    pulleys = tuple(eqx.tree_at(lambda p: p.on, p, jnp.zeros(0)) for p in drive.pulleys)
    locked = dataclasses.replace(drive, pulleys=pulleys, tensioners=())
    lin = bj.linearize(bj.steady_state(locked, point), bj.Legendre(10))
    assert len(lin.mass) == 3 * 10 + 2
    stiff = eqx.tree_at(lambda d: d.tensioner.stiffness, drive, jnp.asarray(1e12))
    arm = bj.linearize(bj.steady_state(stiff, point), bj.Legendre(10))
    np.testing.assert_allclose(
        bj.modes(lin, 6).frequencies, bj.modes(arm, 6).frequencies, rtol=1e-6
    )


@pytest.mark.slow
@pytest.mark.parametrize("travel", [pytest.param("listed", marks=pytest.mark.slow), "opposite"])
def test_direction_of_travel_changes_no_frequency(travel):
    drive, point = at_groups(vibrating("seven_pulley"), 0.03, 0.6)
    turned = dataclasses.replace(point, travel=travel)
    found = solver(bj.Sine(8), 16, True)(drive, turned)
    np.testing.assert_allclose(
        found.frequencies, solver(bj.Sine(8), 16, True)(drive, point).frequencies, rtol=1e-11
    )


def test_missing_inertia_is_named():
    drive, point = at_groups(vibrating("three_pulley"), 0.04, 0.4)
    steady = bj.steady_state(drive, point)
    bare = eqx.tree_at(lambda d: d.tensioner.inertia, drive, None)
    with pytest.raises(ValueError, match="inertia: missing; vibration needs it for every"):
        bj.linearize(bj.steady_state(bare, point))
    bare = eqx.tree_at(lambda d: d.pulleys[1].inertia, with_inertias(drive), None)
    with pytest.raises(ValueError, match="missing for a pulley"):
        bj.linearize(bj.steady_state(bare, point))
    with pytest.raises(ValueError, match=r"give Sine\(n\) or Legendre\(n\)"):
        bj.linearize(steady, "sine")
    lin = bj.linearize(steady, bj.Sine(2))
    with pytest.raises(ValueError, match="count: found 10; give 1 to 9"):
        bj.modes(lin, 10)
    with pytest.raises(ValueError, match="exact: applies to undamped"):
        bj.modes(lin, 2, exact=True, damping=bj.Damping())
    with pytest.raises(ValueError, match="modal must not be negative"):
        bj.Damping(modal=-0.1)


def test_failed_steady_state_travels():
    drive, _ = example("three_pulley")
    steady = bj.steady_state(drive, bj.OperatingPoint(belt_speed=500.0), throw=False)
    found = bj.modes(bj.linearize(steady, bj.Sine(2), throw=False), 4, throw=False)
    assert found.result == steady.result != bj.RESULTS.successful
    assert np.all(np.isfinite(found.frequencies))
