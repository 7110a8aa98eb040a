"""What misleads is said: warnings beside numbers, whole turns kept, one rule for failures."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drives import example

import beltjax as bj


def small_pulleys(radius):
    """Two equal pulleys 100 mm apart, whose belt would be a string of 10 N."""
    pulleys = [
        bj.Pulley("driver", (0.0, 0.0), radius, driver=1.0),
        bj.Pulley("driven", (0.1, 0.0), radius),
    ]
    drive = bj.Drive(bj.Belt(6000.0, 1e-4, 0.01), pulleys, bj.TensionGiven(10.0))
    return drive, bj.OperatingPoint(belt_speed=0.0)


def test_a_stiff_belt_on_small_pulleys_carries_a_warning():
    steady = bj.steady_state(*small_pulleys(5.093e-3))
    tension = float(steady.running_tensions[0])
    expected = np.sqrt(1e-4 / tension) / 5.093e-3
    np.testing.assert_allclose(steady.stiffness_ratios, expected, rtol=1e-12)
    assert expected > 0.15
    assert steady.result == bj.RESULTS.successful
    assert steady.warning == bj.RESULTS.belt_stiff_on_pulley
    # sqrt(1e-4/10)/0.025 = 0.126
    assert bj.steady_state(*small_pulleys(0.025)).warning == bj.RESULTS.successful


def test_a_spring_keeps_its_whole_turns():
    """A soft spring is wound by more than half a turn: 4.0001 rad on the three-pulley drive."""
    drive, point = example("three_pulley")
    soft = eqx.tree_at(lambda d: d.tensioner.stiffness, drive, 5.0)
    given = bj.reference_state(soft, point)
    assert float(given.free_angle) == pytest.approx(-4.0001, abs=1e-4)
    rule = bj.BeltGiven(given.unstretched_length, given.free_angle)
    held = bj.reference_state(eqx.tree_at(lambda d: d.installation, soft, rule), point)
    assert float(held.base_tension) == pytest.approx(300.0, rel=1e-9)
    assert float(held.free_angle) == float(given.free_angle)


def test_a_turn_past_the_cut_of_the_arm_s_direction_winds_no_spring():
    """From just below to just above 180 degrees the tension changes by little, not by a turn."""
    drive, point = example("three_pulley")
    state = bj.reference_state(drive, point)
    rule = bj.BeltGiven(state.unstretched_length, state.free_angle)
    drive = eqx.tree_at(lambda d: d.installation, drive, rule)
    cut = np.pi - float(bj.layout(drive).arm_angle)
    free = []
    for angle in (cut - 1e-6, cut + 1e-6):
        turned = bj.optimize.with_values(drive, {"tensioner.angle": angle})
        at = bj.layout(turned, throw=False)
        free.append(float(turned.installation.free_angle - at.arm_angle))
    assert free[0] == pytest.approx(free[1], abs=1e-9)
    assert free[0] == pytest.approx(float(state.free_angle - state.arm_angle), abs=1e-9)


def test_spans_have_names_of_their_own():
    pulleys = [
        bj.Pulley("a", (0.0, 0.0), 0.02, driver=1.0),
        bj.Pulley("b-a", (0.2, 0.0), 0.02),
        bj.Pulley("a-b", (0.1, 0.2), 0.02),
    ]
    belt, rule = bj.Belt(1e5, 0.01, 0.1), bj.TensionGiven(100.0)
    with pytest.raises(ValueError, match="Two spans would be called 'a-b-a': rename a pulley"):
        bj.Drive(belt, (pulleys[0], pulleys[1], pulleys[2]), rule)


def test_slack_factors_say_where_linear_amplitudes_end():
    """At the amplitude times its factor the fluctuation reaches the running tension."""
    drive, point = example("seven_pulley")
    steady = bj.steady_state(drive, point)
    lin = bj.linearize(steady, bj.Legendre(8))
    at = [200.0]
    found = bj.frequency_response(lin, at, bj.Excitation(crank=0.05))
    assert found.warning == bj.RESULTS.span_slackens
    span = int(jnp.argmin(found.slack_factors[0]))
    amplitude = 0.05 * float(found.slack_factors[0, span])
    limit = bj.frequency_response(lin, at, bj.Excitation(crank=amplitude))
    swing = float(jnp.abs(limit.tensions[0, span]))
    assert swing == pytest.approx(float(steady.running_tensions[span]), rel=1e-9)
    assert float(jnp.min(limit.slack_factors)) == pytest.approx(1.0, rel=1e-9)
    small = bj.frequency_response(lin, at, bj.Excitation(crank=0.9 * amplitude))
    assert small.warning == bj.RESULTS.successful


def test_what_has_no_finite_answer_is_a_failure():
    drive, point = example("three_pulley")
    lin = bj.linearize(bj.steady_state(drive, point), bj.Legendre(6))
    for frequency, crank in ((1e300, 0.01), (100.0, 1e300)):
        found = bj.frequency_response(lin, [frequency], bj.Excitation(crank=crank), throw=False)
        assert found.result == bj.RESULTS.response_not_finite
        assert np.all(np.isfinite(found.span_peaks))
    with pytest.raises(ValueError, match="must be finite"):
        bj.Damping(modal=jnp.inf)


NAMES = (
    "layout", "reference_state", "steady_state", "span_frequencies", "moving_beam_modes",
    "linearize", "modes", "frequency_response", "speed_response",
)  # fmt: skip


@functools.cache
def failing():
    """A drive that every analysis fails for, and what each is asked."""
    drive, _ = example("three_pulley")
    point = bj.OperatingPoint(belt_speed=500.0)
    crossed = eqx.tree_at(lambda d: d.sense, drive, -drive.sense)
    steady = bj.steady_state(drive, point, throw=False)
    basis = bj.Legendre(6)
    lin = bj.linearize(steady, basis, throw=False)
    crank = bj.Excitation(crank=0.01)
    return {
        "layout": lambda **how: bj.layout(crossed, **how),
        "reference_state": lambda **how: bj.reference_state(crossed, point, **how),
        "steady_state": lambda **how: bj.steady_state(drive, point, **how),
        "span_frequencies": lambda **how: bj.span_frequencies(drive, point, **how),
        "moving_beam_modes": lambda **how: bj.moving_beam_modes(0.02, 1.5, **how),
        "linearize": lambda **how: bj.linearize(steady, basis, **how),
        "modes": lambda **how: bj.modes(lin, 2, **how),
        "frequency_response": lambda **how: bj.frequency_response(lin, [9.0], crank, **how),
        "speed_response": lambda **how: bj.speed_response(
            drive, point, [4000.0], crank, basis=basis, **how
        ),
    }


@pytest.mark.parametrize("name", NAMES)
def test_every_analysis_raises_one_line_unless_told_not_to(name):
    analysis = failing()[name]
    result = analysis(throw=False).result
    assert not np.any(result == bj.RESULTS.successful)
    with pytest.raises(bj.AnalysisError) as error:
        analysis()
    text = str(error.value)
    assert "\n" not in text
    assert text == next(filter(None, bj.results.explanations(result)))


def test_results_print_what_they_are():
    drive, point = example("three_pulley")
    steady = bj.steady_state(drive, point)
    assert "successful" in repr(steady.result)
    assert "lost its tension" in repr(bj.RESULTS.span_slack)
    assert jax.tree.structure(steady)  # still a pytree
