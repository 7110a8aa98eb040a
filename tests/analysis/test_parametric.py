"""Pairs of modes under a shaking crank: stored values, derivatives, limits, failures."""

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
BASIS = bj.Legendre(20)
TENSION, SHAPE = ("tension",), ("tension", "shape")


def running(name, rpm, basis=BASIS):
    """The drive of an example at a speed of its driver, linearized."""
    drive, point = example(name)
    at = bj.OperatingPoint(driver_speed=rpm * np.pi / 30, torque=point.torque)
    return bj.linearize(bj.steady_state(drive, at), basis)


def pairs_at(name, rpm, degrees, modal, basis=BASIS, **options):
    crank = bj.Excitation(crank=np.radians(degrees))
    frequency = 2 * rpm * np.pi / 30
    return bj.parametric_pairs(
        running(name, rpm, basis), frequency, crank, damping=bj.Damping(modal=modal), **options
    )


def place_of(pairs, r, s):
    return pairs.modes.tolist().index([r, s])


@pytest.mark.parametrize("k", range(12))
def test_stored_tongues_of_three_pulleys(k):
    case = CASES["A12_tongues_first_order"]["three_pulley.toml"]
    one = case["tongues"][k]
    # The stored numbers leave out the gradient of tension that accelerates the belt.
    found = pairs_at("three_pulley", one["rpm"], 1.0, 0.01, acceleration="uniform")
    place = place_of(found, *one["pair"])
    assert float(found.detuning[place]) == pytest.approx(0.0, abs=3.0)
    assert found.center[place] / (2 * np.pi) == pytest.approx(one["hz"], rel=1e-8)
    critical = 1 / np.sqrt(float(found.ratio[place]))
    assert critical == pytest.approx(one["crank_crit_deg_all"], rel=1e-8)
    slack = one["crank_crit_deg_all"] / one["max_tension_fluctuation_over_P"]
    assert float(found.slack_factor) == pytest.approx(slack, rel=1e-8)
    alone = pairs_at("three_pulley", one["rpm"], 1.0, 0.01, terms=TENSION)
    critical = 1 / np.sqrt(float(alone.ratio[place]))
    assert critical == pytest.approx(one["crank_crit_deg_tension"], rel=1e-8)


@pytest.mark.slow
def test_terms_of_the_first_mode():
    case, stored = CASES["A8_three_11"], CASES["A13"]
    rpm = 274.51926150563725 * 30 / np.pi  # the tongue with 20 functions a span
    critical = {
        name: 1 / np.sqrt(float(pairs_at("three_pulley", rpm, 1.0, 0.01, **options).ratio[0]))
        for name, options in {
            "tension+shape": {"terms": SHAPE},
            "tension+shape+speed": {"acceleration": "uniform"},
            "tension+shape+speed+newton": {},
        }.items()
    }
    for name, value in critical.items():
        assert value == pytest.approx(stored[f"crank_crit_deg {name}"], rel=1e-6)
    # With 24 functions a span, at the tongue of that basis.
    rpm = case["rpm"]
    for name, terms in (("tension", TENSION), ("tension+shape", SHAPE)):
        found = pairs_at("three_pulley", rpm, case["crank_deg"], 0.01, bj.Legendre(24), terms=terms)
        one = case["first_order"][name]
        assert float(found.coupling[0]) == pytest.approx(one["sqrtLambda_rad_s"], rel=1e-6)
        assert float(found.growth[0]) == pytest.approx(one["growth_1_s"], rel=1e-6)
    hertz = np.asarray(found.frequencies) / (2 * np.pi)
    np.testing.assert_allclose(hertz, case["omega_hz"], rtol=1e-6)
    np.testing.assert_allclose(found.decay_r[:1], case["decay_1_s"][:1], rtol=1e-6)
    swing = np.abs(found.tension_fluctuation)
    np.testing.assert_allclose(swing, case["tension_fluctuation_N"], rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("k", [0, 1])
def test_stored_tongues_of_seven_pulleys(k):
    one = CASES["A12_tongues_first_order"]["seven_pulley.toml"]["tongues"][k]
    basis = bj.Legendre(16)
    found = pairs_at("seven_pulley", one["rpm"], 1.0, 0.02, basis, acceleration="uniform", count=4)
    place = place_of(found, *one["pair"])
    critical = 1 / np.sqrt(float(found.ratio[place]))
    # Its own basis was coarser.
    assert critical == pytest.approx(one["crank_crit_deg_all"], rel=2e-3)
    alone = pairs_at("seven_pulley", one["rpm"], 1.0, 0.02, basis, terms=TENSION, count=4)
    critical_alone = 1 / np.sqrt(float(alone.ratio[place]))
    assert critical_alone == pytest.approx(one["crank_crit_deg_tension"], rel=2e-3)
    assert critical_alone > 2.9 * critical  # the turning of the spans is most of it


def test_a_mode_that_is_near_detunes_the_second_one():
    case = CASES["A15_cluster"]
    for rpm, pair, cluster in zip(
        case["rpm"], case["pair_formula"], case["cluster_2_9"], strict=True
    ):
        found = pairs_at("three_pulley", rpm, 0.08, 0.01, bj.Legendre(12), terms=SHAPE, count=10)
        place = place_of(found, 2, 2)
        assert float(found.growth[place]) == pytest.approx(pair, abs=0.13)
        assert found.cluster[place].tolist() == [9, 9]
        # Away from resonance what is left out, of second order, shifts the answer.
        assert float(found.cluster_growth[place]) == pytest.approx(cluster, rel=0.25)
        assert found.critical_factor[place] > 2.5  # stable up to 0.2 degrees and beyond
        if rpm == case["rpm"][0]:
            assert float(found.cluster_growth[place]) == pytest.approx(cluster, abs=1e-3)


def test_without_other_modes_near_the_cluster_is_the_pair():
    found = pairs_at("three_pulley", 4955.143811173889, 0.005, 0.01)
    place = place_of(found, 2, 6)
    assert found.cluster[place].tolist() == [0, 0]
    assert float(found.cluster_growth[place]) == pytest.approx(float(found.growth[place]), rel=1e-9)
    critical = 1 / np.sqrt(float(found.ratio[place]))
    assert float(found.critical_factor[place]) == pytest.approx(critical, rel=1e-8)
    assert found.kind[place] == "sum"
    assert found.kind[0] == "principal"


def test_coupling_goes_with_the_amplitude():
    one = pairs_at("three_pulley", 2600.0, 0.1, 0.01)
    two = pairs_at("three_pulley", 2600.0, 0.2, 0.01)
    np.testing.assert_allclose(two.coupling, 2 * one.coupling, rtol=1e-9)
    np.testing.assert_allclose(two.ratio, 4 * one.ratio, rtol=1e-9)
    np.testing.assert_allclose(one.critical_factor, 2 * two.critical_factor, rtol=1e-7)
    assert one.warning == bj.RESULTS.successful
    beyond = pairs_at("three_pulley", 4950.0, 0.2, 0.01)
    assert beyond.warning == bj.RESULTS.span_slackens
    assert float(beyond.slack_factor) < 1


DRIVE, POINT = example("three_pulley")
SMALL = bj.Legendre(8)


@eqx.filter_jit
def measured(scaled):
    """Numbers of the first pair and of its cluster, by factors of some numbers of the drive."""
    tension, bending, stiffness, speed = scaled
    drive = eqx.tree_at(
        lambda d: (d.installation.tension, d.belt.bending_stiffness, d.tensioner.stiffness),
        DRIVE,
        (tension * 300.0, bending * 0.015, stiffness * 116.4),
    )
    at = bj.OperatingPoint(driver_speed=speed * 274.6)
    lin = bj.linearize(bj.steady_state(drive, at, throw=False), SMALL, throw=False)
    crank, damping = bj.Excitation(crank=0.002), bj.Damping(modal=0.01)
    found = bj.parametric_pairs(
        lin, 2 * speed * 274.6, crank, damping=damping, count=4, throw=False
    )
    parts = found.growth, found.ratio, found.critical_factor, found.coupling, found.cluster_growth
    return jnp.stack([part[0] for part in parts])


@pytest.mark.slow
def test_derivatives():
    at = jnp.ones(4)
    forward = np.asarray(jax.jit(jax.jacfwd(measured))(at))
    reverse = np.asarray(jax.jit(jax.jacrev(measured))(at))
    np.testing.assert_allclose(forward, reverse, rtol=1e-7, atol=1e-9)
    h = 1e-4
    offsets = np.concatenate([c * h * np.eye(4) for c in (-2, -1, 1, 2)])
    m2, m1, p1, p2 = np.split(np.asarray(jax.jit(jax.vmap(measured))(1 + offsets)), 4)
    differences = ((m2 - p2) + 8 * (p1 - m1)).T / (12 * h)
    size = np.abs(forward).max(axis=1, keepdims=True)
    np.testing.assert_allclose(forward / size, differences / size, atol=2e-6)


@pytest.mark.slow
def test_a_bad_lane_leaves_the_others():
    scaled = np.ones((3, 4))
    scaled[1, 0], scaled[2, 1] = -1.0, 1.1
    found = np.asarray(jax.jit(jax.vmap(measured))(scaled))
    assert np.all(np.isfinite(found[[0, 2]]))
    np.testing.assert_allclose(found[0], measured(jnp.ones(4)), rtol=1e-8)


def test_failures():
    lin = running("three_pulley", 2600.0, SMALL)
    crank, damping = bj.Excitation(crank=0.002), bj.Damping(modal=0.01)
    for change, match in (
        ({"terms": ("force",)}, "terms"),
        ({"count": 0}, "count"),
        ({"count": 999}, "count"),
        ({"acceleration": "none"}, "acceleration"),
    ):
        with pytest.raises(ValueError, match=match):
            bj.parametric_pairs(lin, 500.0, crank, damping=damping, **change)
    with pytest.raises(ValueError, match="frequency"):
        bj.parametric_pairs(lin, 0.0, crank, damping=damping)
    torque = bj.Excitation(torques={"fan": 1.0})
    with pytest.raises(ValueError, match="no pulley"):
        bj.parametric_pairs(lin, 500.0, torque, DRIVE.pulley_names, damping=damping)
    limp = eqx.tree_at(lambda d: d.belt.bending_stiffness, DRIVE, jnp.asarray(0.0))
    string = bj.linearize(bj.steady_state(limp, POINT), SMALL)
    with pytest.raises(bj.AnalysisError, match="bending stiffness"):
        bj.parametric_pairs(string, 500.0, crank, damping=damping)
    still = bj.linearize(bj.steady_state(limp, bj.OperatingPoint(belt_speed=0.0)), SMALL)
    bj.parametric_pairs(still, 500.0, crank, damping=damping)
