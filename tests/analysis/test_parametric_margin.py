"""The margin over a range of speeds: stored tongues, derivatives, slack, failures."""

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
RPM = np.pi / 30
DRIVE, POINT = example("three_pulley")
CRANK, DAMPING = bj.Excitation(crank=np.radians(0.01)), bj.Damping(modal=0.01)
BASIS = bj.Legendre(16)


@pytest.fixture(scope="module")
def found():
    ends = 600 * RPM, 6000 * RPM
    return bj.parametric_margin(DRIVE, POINT, ends, CRANK, damping=DAMPING, count=8, basis=BASIS)


@pytest.mark.slow
def test_tongues_are_where_they_were_stored(found):
    of, pairs = found.tongues, found.tongues.modes.tolist()
    for one in CASES["A12_tongues_first_order"]["three_pulley.toml"]["tongues"]:
        place = pairs.index(one["pair"])
        assert bool(of.inside[place])
        # 16 functions a span in place of 20.
        assert of.driver_speed[place] / RPM == pytest.approx(one["rpm"], rel=5e-4)
        lin = bj.linearize(
            bj.steady_state(DRIVE, bj.OperatingPoint(driver_speed=of.driver_speed[place])), BASIS
        )
        alone = bj.parametric_pairs(lin, of.frequency[place], CRANK, damping=DAMPING)
        assert float(alone.detuning[place]) == pytest.approx(0.0, abs=1e-6)
        assert float(of.growth[place]) == pytest.approx(float(alone.growth[place]), rel=1e-7)
        critical = float(alone.critical_factor[place])
        assert float(of.critical_factor[place]) == pytest.approx(critical, rel=1e-6)
        assert float(of.slack_factor[place]) == pytest.approx(float(alone.slack_factor), rel=1e-6)


@pytest.mark.slow
def test_the_worst_tongue(found):
    assert found.modes.tolist() == [2, 6]
    assert float(found.margin) == pytest.approx(0.79, rel=0.01)  # 0.0079 degrees of 0.01
    assert not found.safe
    np.testing.assert_allclose(found.margin, found.least[0])
    counted = np.where(found.tongues.slack, np.inf, found.tongues.critical_factor)
    assert float(found.margin) == pytest.approx(counted.min())
    assert not bool(found.complete)  # at 6000 rpm modes 9 and 10 are near
    assert np.all(np.asarray(found.tongues.half_width >= 0))
    assert found.tongues.kind[int(found.worst)] == "sum"


@pytest.mark.slow
def test_what_is_not_in_the_range_stands_at_its_end(found):
    of = found.tongues
    outside = ~np.asarray(of.inside)
    assert outside.any()
    np.testing.assert_allclose(of.driver_speed[outside], 6000 * RPM)


@pytest.mark.slow
def test_twice_the_excitation_has_half_the_margin(found):
    ends = 600 * RPM, 6000 * RPM
    crank = bj.Excitation(crank=np.radians(0.02))
    twice = bj.parametric_margin(DRIVE, POINT, ends, crank, damping=DAMPING, count=8, basis=BASIS)
    assert float(twice.margin) == pytest.approx(float(found.margin) / 2, rel=1e-7)


@pytest.mark.slow
def test_failures():
    ends = 600 * RPM, 6000 * RPM
    options = {"count": 8, "basis": BASIS}
    bare = bj.parametric_margin(
        DRIVE, POINT, ends, CRANK, damping=bj.Damping(), throw=False, **options
    )
    assert bare.result == bj.RESULTS.no_damping
    limp = eqx.tree_at(lambda d: d.belt.bending_stiffness, DRIVE, jnp.asarray(0.0))
    string = bj.parametric_margin(limp, POINT, ends, CRANK, damping=DAMPING, throw=False, **options)
    assert string.result == bj.RESULTS.commensurate
    heavy = bj.OperatingPoint(belt_speed=20.0, torque={"accessory": -40.0})
    slack = bj.parametric_margin(DRIVE, heavy, ends, CRANK, damping=DAMPING, throw=False, **options)
    steady = bj.steady_state(DRIVE, heavy, throw=False)
    assert slack.result == steady.result != bj.RESULTS.successful
    for wrong in ((0.0, 100.0), (200.0, 100.0)):
        with pytest.raises(ValueError, match="driver_speeds"):
            bj.parametric_margin(DRIVE, POINT, wrong, CRANK, damping=DAMPING)
    with pytest.raises(ValueError, match="count"):
        bj.parametric_margin(DRIVE, POINT, ends, CRANK, damping=DAMPING, count=40)


@eqx.filter_jit
def measured(scaled):
    """The margin about the first tongue and the least factors, by factors of some numbers."""
    tension, bending, stiffness = scaled
    drive = eqx.tree_at(
        lambda d: (d.installation.tension, d.belt.bending_stiffness, d.tensioner.stiffness),
        DRIVE,
        (tension * 300.0, bending * 0.015, stiffness * 116.4),
    )
    found = bj.parametric_margin(
        drive, POINT, (2300 * RPM, 4000 * RPM), CRANK, damping=DAMPING, count=3,
        basis=bj.Legendre(8), throw=False,
    )  # fmt: skip
    return jnp.concatenate([found.margin[None], found.least])


@pytest.mark.slow
def test_derivatives():
    at = jnp.ones(3)
    reverse = np.asarray(jax.jit(jax.jacrev(measured))(at))
    h = 1e-4
    offsets = np.concatenate([c * h * np.eye(3) for c in (-2, -1, 1, 2)])
    lanes = np.asarray(jax.jit(jax.vmap(measured))(1 + np.concatenate([offsets, [[-2.0, 0, 0]]])))
    m2, m1, p1, p2 = np.split(lanes[:12], 4)
    differences = ((m2 - p2) + 8 * (p1 - m1)).T / (12 * h)
    assert np.abs(reverse).max() > 0.1
    size = np.abs(reverse).max(axis=1, keepdims=True)
    np.testing.assert_allclose(reverse / size, differences / size, atol=1e-5)
    along = jnp.array([1.0, -0.5, 0.25])
    forward = np.asarray(jax.jit(lambda x: jax.jvp(measured, (x,), (along,))[1])(at))
    np.testing.assert_allclose(forward / size[:, 0], reverse @ along / size[:, 0], atol=1e-8)


@pytest.mark.slow
def test_the_tip_of_the_first_tongue_by_floquet_s_theory():
    crank = bj.Excitation(crank=np.radians(0.06))
    ends = 2605 * RPM, 2635 * RPM
    found = bj.parametric_margin(DRIVE, POINT, ends, crank, damping=DAMPING, count=2, exact=True)
    exact = CASES["A14_critical_crank_by_level"]["three_11 N=16,m=40,level=2"]
    # Stored at the resonance of the pair: the least amplitude of all speeds near is below that.
    assert found.modes.tolist() == [1, 1]
    assert 0.97 * exact < 0.06 * float(found.margin) < exact
    steady = bj.steady_state(DRIVE, bj.OperatingPoint(driver_speed=found.speed))
    there = bj.floquet(bj.linearize(steady, BASIS), 2 * found.speed, crank, damping=DAMPING)
    assert float(found.margin) == pytest.approx(float(there.critical_amplitude), rel=1e-7)


@pytest.mark.slow
def test_seven_pulleys_go_slack_first():
    drive, point = example("seven_pulley")
    found = bj.parametric_margin(
        drive, point, (1000 * RPM, 4000 * RPM), bj.Excitation(crank=np.radians(1.0)),
        damping=bj.Damping(modal=0.02), count=4,
    )  # fmt: skip
    assert found.warning == bj.RESULTS.span_slackens
    assert float(found.margin) == np.inf
    case = CASES["A12_tongues_first_order"]["seven_pulley.toml"]["tongues"][1]
    place = found.tongues.modes.tolist().index(case["pair"])
    assert found.tongues.driver_speed[place] / RPM == pytest.approx(case["rpm"], rel=1e-4)
    critical = case["crank_crit_deg_all"]
    assert float(found.tongues.critical_factor[place]) == pytest.approx(critical, rel=1e-3)
    slack = critical / case["max_tension_fluctuation_over_P"]
    assert float(found.tongues.slack_factor[place]) == pytest.approx(slack, rel=1e-2)
    assert bool(found.tongues.slack[place])
