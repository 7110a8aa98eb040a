"""Floquet's theory of whole drives: stored values, the nonlinear equations, derivatives."""

import json
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drives import example

import beltjax as bj

CASES = json.loads((Path(__file__).parents[1] / "data" / "parametric.json").read_text())
CASE = CASES["A8_three_11"]
DAMPING = bj.Damping(modal=CASE["modal_damping"])
SPEED = CASE["driver_speed_rad_s"]
DRIVE, POINT = example("three_pulley")


def found_at(degrees, functions=12, speed=SPEED, **options):
    at = bj.OperatingPoint(driver_speed=speed)
    lin = bj.linearize(bj.steady_state(DRIVE, at), bj.Legendre(functions))
    crank = bj.Excitation(crank=np.radians(degrees))
    return bj.floquet(lin, 2 * speed, crank, damping=DAMPING, **options)


@pytest.mark.parametrize(
    ("level", "stored"),
    [
        ("response", "rank_one"),
        pytest.param("orbit", "orbit", marks=pytest.mark.slow),
    ],
)
def test_stored_growth(level, stored):
    found = found_at(CASE["crank_deg"], level=level, critical=False)
    exact = CASE["floquet_growth_1_s"]["N=12,m=24,steps=64"][stored]
    assert float(found.growth) == pytest.approx(exact, rel=1e-8)
    largest = found.multipliers[0]
    rate = np.log(abs(largest)) * SPEED * 2 / (2 * np.pi)
    assert float(found.growth) == pytest.approx(rate, abs=1e-9)
    assert largest.real < -1  # the period doubles
    assert 0 < float(found.error) < 0.02 * float(found.growth)


def test_stored_critical_crank_by_the_response():
    found = found_at(CASE["crank_deg"])
    exact = CASES["A14_critical_crank_by_level"]["three_11 N=12,m=24,level=2"]
    assert float(found.critical_amplitude) * CASE["crank_deg"] == pytest.approx(exact, rel=1e-8)


@pytest.mark.slow
def test_stored_critical_crank_by_the_orbit():
    exact = CASES["A14_critical_crank_by_level"]
    found = found_at(CASE["crank_deg"], level="orbit")
    critical = float(found.critical_amplitude) * CASE["crank_deg"]
    assert critical == pytest.approx(exact["three_11 N=12,m=24,level=3"], rel=1e-7)
    found = found_at(CASE["crank_deg"], 16, level="orbit", modes=40)
    critical = float(found.critical_amplitude) * CASE["crank_deg"]
    assert critical == pytest.approx(exact["three_11 N=16,m=40,level=3"], rel=1e-6)


@pytest.mark.slow
def test_all_modes_and_the_error():
    stored = CASE["floquet_growth_1_s"]["N=20,m=None,steps=128"]
    found = found_at(CASE["crank_deg"], 20, modes=99, steps=128, critical=False)
    assert float(found.growth) == pytest.approx(stored["rank_one"], rel=1e-7)
    few = found_at(CASE["crank_deg"], 20, modes=40, steps=128, critical=False)
    assert abs(float(few.growth) - stored["rank_one"]) < 2 * float(few.error)


@pytest.mark.slow
def test_the_orbit_s_growth_is_that_of_nonlinear_equations():
    # A second route: harmonic balance of the drive, and Gauss's method in all coordinates.
    basis = bj.Legendre(6)
    at = bj.OperatingPoint(driver_speed=SPEED)
    orders = bj.Orders({2: bj.Excitation(crank=np.radians(0.12))})
    motion = bj.periodic_response(
        DRIVE, at, orders, basis=basis, damping=DAMPING, harmonics=5, samples=40
    )
    found = found_at(0.12, 6, level="orbit", modes=99, critical=False)
    exact = np.log(abs(motion.multipliers[0])) / motion.period
    assert float(found.growth) == pytest.approx(float(exact), rel=2e-5)


@pytest.mark.slow
def test_stored_growth_of_nonlinear_time_integration():
    case = CASES["A11_derivatives_and_integration"]["nonlinear_time_integration"]
    found = found_at(case["crank_deg"], case["N"], level="orbit", modes=99, critical=False)
    assert float(found.growth) == pytest.approx(case["orbit_exponent"], rel=1e-5)
    assert float(found.growth) == pytest.approx(case["measured"], rel=1e-4)


@pytest.mark.slow
def test_small_motions_give_the_pair_s_critical_amplitude():
    # The closed form is the limit of weak damping, where the critical amplitude is small.
    drive, speed = DRIVE, SPEED
    at = bj.OperatingPoint(driver_speed=speed)
    lin = bj.linearize(bj.steady_state(drive, at), bj.Legendre(8))
    apart = []
    for modal in (0.002, 0.001):
        damping, crank = bj.Damping(modal=modal), bj.Excitation(crank=1e-3)
        pairs = bj.parametric_pairs(
            lin, 2 * speed, crank, damping=damping, terms=("tension", "shape")
        )
        # In its resonance, which the speed above meets to 1 part in 1000.
        frequency = float(pairs.center[0])
        pairs = bj.parametric_pairs(
            lin, frequency, crank, damping=damping, terms=("tension", "shape")
        )
        found = bj.floquet(lin, frequency, crank, damping=damping, modes=99)
        apart.append(float(found.critical_amplitude * jnp.sqrt(pairs.ratio[0])) - 1)
    assert abs(apart[1]) < 2e-3
    assert abs(apart[1]) < 0.6 * abs(apart[0])


def test_where_the_second_mode_is_stable_in_spite_of_its_pair():
    # `pairs` alone says unstable from 0.060 degrees; the ninth mode is near.
    found = found_at(0.1, speed=3720 * np.pi / 30, critical=False)
    assert float(found.growth) < -1.0


def test_without_excitation_the_least_decay_is_left():
    found = found_at(1e-9, critical=False)
    pairs_lin = bj.linearize(
        bj.steady_state(DRIVE, bj.OperatingPoint(driver_speed=SPEED)), bj.Legendre(12)
    )
    modes = bj.modes(pairs_lin, 8, damping=DAMPING)
    assert float(found.growth) == pytest.approx(float(modes.growth_rates.max()), rel=1e-6)


@eqx.filter_jit
def measured(scaled):
    """Growth and critical amplitude, by factors of some numbers of the drive."""
    tension, bending, stiffness = scaled
    drive = eqx.tree_at(
        lambda d: (d.installation.tension, d.belt.bending_stiffness, d.tensioner.stiffness),
        DRIVE,
        (tension * 300.0, bending * 0.015, stiffness * 116.4),
    )
    steady = bj.steady_state(drive, bj.OperatingPoint(driver_speed=SPEED), throw=False)
    lin = bj.linearize(steady, bj.Legendre(6), throw=False)
    found = bj.floquet(
        lin, 2 * SPEED, bj.Excitation(crank=0.002), damping=DAMPING, modes=12, steps=32, throw=False
    )
    return jnp.stack([found.growth, found.critical_amplitude])


@pytest.mark.slow
def test_derivatives():
    at = jnp.ones(3)
    forward = np.asarray(jax.jit(jax.jacfwd(measured))(at))
    reverse = np.asarray(jax.jit(jax.jacrev(measured))(at))
    np.testing.assert_allclose(forward, reverse, rtol=1e-7)
    h = 1e-3
    offsets = np.concatenate([c * h * np.eye(3) for c in (-2, -1, 1, 2)])
    lanes = np.asarray(
        jax.jit(jax.vmap(measured))(1 + np.concatenate([offsets, [[0] * 3, [-2, 0, 0]]]))
    )
    m2, m1, p1, p2 = np.split(lanes[:12], 4)
    differences = ((m2 - p2) + 8 * (p1 - m1)).T / (12 * h)
    size = np.abs(forward).max(axis=1, keepdims=True)
    np.testing.assert_allclose(forward / size, differences / size, atol=1e-5)
    # The last lane is no drive; it leaves the others, and is finite itself.
    np.testing.assert_allclose(lanes[12], measured(at), rtol=1e-9)
    assert np.all(np.isfinite(lanes[:13]))


@pytest.mark.slow
def test_several_orders_have_a_common_period():
    at = bj.OperatingPoint(driver_speed=SPEED)
    lin = bj.linearize(bj.steady_state(DRIVE, at), bj.Legendre(6))
    crank = bj.Excitation(crank=0.002)
    alone = bj.floquet(lin, 2 * SPEED, crank, damping=DAMPING, critical=False)
    beside = bj.Orders({2: crank, 4: bj.Excitation(crank=1e-12)})
    found = bj.floquet(lin, 2 * SPEED, beside, damping=DAMPING, critical=False)
    assert float(found.growth) == pytest.approx(float(alone.growth), rel=1e-8)
    longer = bj.Orders({2: crank, 3: bj.Excitation(crank=1e-12)})
    found = bj.floquet(lin, SPEED, longer, damping=DAMPING, critical=False, steps=128)
    assert float(found.growth) == pytest.approx(float(alone.growth), rel=1e-8)


def test_failures():
    lin = bj.linearize(bj.steady_state(DRIVE, POINT), bj.Legendre(6))
    crank = bj.Excitation(crank=0.002)
    for change, match in (
        ({"level": "linear"}, "level"),
        ({"modes": 0}, "modes"),
        ({"steps": 2}, "steps"),
    ):
        with pytest.raises(ValueError, match=match):
            bj.floquet(lin, 500.0, crank, damping=DAMPING, **change)
    with pytest.raises(ValueError, match="frequency"):
        bj.floquet(lin, -1.0, crank, damping=DAMPING)
    with pytest.raises(bj.AnalysisError, match="no damping"):
        bj.floquet(lin, 500.0, crank, damping=bj.Damping())
    limp = eqx.tree_at(lambda d: d.belt.bending_stiffness, DRIVE, jnp.asarray(0.0))
    string = bj.linearize(bj.steady_state(limp, POINT), bj.Legendre(6))
    found = bj.floquet(string, 500.0, crank, damping=DAMPING, critical=False, throw=False)
    assert found.result == bj.RESULTS.commensurate
