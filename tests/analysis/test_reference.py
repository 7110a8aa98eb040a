"""Reference states against the source's numbers, balances of force, and impossible belts."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from drives import example, held_by_belt
from published import Value, assert_matches_print

import beltjax as bj


def with_belt_length(drive, factor):
    rule = drive.installation
    return eqx.tree_at(lambda d: d.installation.belt_length, drive, factor * rule.belt_length)


def test_prototype():
    state = bj.reference_state(*example("three_pulley"))
    assert_matches_print(state.unstretched_length, Value("1.510316"))
    # With the arm's true length and stiffness: docs/theory/reference_state.md, (R4).
    assert_matches_print(state.arm_angle - state.free_angle, Value("0.169017"))


def test_locked_centers_share_the_fall_of_tension():
    # Table 5.1's drive, torque 2: the tensions differ by M/R and keep the length of the belt.
    drive, point = example("two_pulley_table_5_1")
    state = bj.reference_state(drive, point)
    slack, tight = sorted(map(float, state.tensions))
    assert tight - slack == pytest.approx(2.0 / 0.05, rel=1e-14)
    EA, pi = 25e3, np.pi
    span, arcs = 0.05 * pi, 2 * 0.05 * pi
    length = sum(span / (1 + P / EA) for P in (slack, tight)) + arcs / (
        1 + (slack + tight) / 2 / EA
    )
    assert length == pytest.approx((2 * span + arcs) / (1 + 50 / EA), rel=1e-14)


@pytest.mark.parametrize("rule", ["tension", "belt"])
def test_torques_balance_on_every_pulley_and_on_the_arm(rule):
    drive, point = example("seven_pulley")
    if rule == "belt":
        drive = held_by_belt(drive, point)
    state = bj.reference_state(drive, point)
    P, radii = np.asarray(state.tensions), np.asarray(drive.radii)
    moments = (P - np.roll(P, 1)) * radii
    expected = [0.0, 0.0, 7.0, 0.0, 5.0, 0.4, 11.0]
    np.testing.assert_allclose(moments[1:], expected[1:], atol=1e-9)
    # The belt's pull on the tensioner's pulley and the spring, about the pivot.
    at, j = state.layout, drive.pulley("tensioner")
    pull = P[j] * np.asarray(at.directions[j]) - P[j - 1] * np.asarray(at.directions[j - 1])
    arm = np.asarray(at.centers[j]) - np.asarray(drive.tensioner.pivot)
    moment = arm[0] * pull[1] - arm[1] * pull[0]
    spring = -float(drive.tensioner.stiffness * (state.arm_angle - state.free_angle))
    assert moment + spring == pytest.approx(0.0, abs=1e-9 * abs(spring))


def test_opposite_travel_puts_the_load_on_the_other_side():
    drive, point = example("two_pulley_table_5_1")
    here = bj.reference_state(drive, point).tensions
    there = eqx.tree_at(lambda p: p.travel, point, -point.travel)
    # The belt's length fixes tensions to rounding times EA/P, here 1e-13.
    np.testing.assert_allclose(bj.reference_state(drive, there).tensions, here[::-1], rtol=1e-12)


@pytest.mark.parametrize("name", ["three_pulley", "seven_pulley"])
def test_both_rules_describe_one_drive(name):
    drive, point = example(name)
    given, held = bj.steady_state(drive, point), bj.steady_state(held_by_belt(drive, point), point)
    np.testing.assert_allclose(held.coupling, given.coupling, rtol=1e-9)
    assert float(held.reference.base_tension) == pytest.approx(
        float(drive.installation.tension), rel=1e-9
    )


def test_named_span_tensions_keep_the_drawn_layout():
    drive, point = example("three_pulley")
    named = [281.85, 281.85, 461.85]
    drive = eqx.tree_at(lambda d: d.installation, drive, bj.TensionGiven(300.0, named))
    state = bj.reference_state(drive, point)
    assert state.tensions.tolist() == named
    assert float(state.arm_angle) == float(bj.layout(drive).arm_angle)


@pytest.mark.parametrize(
    ("factor", "results"),
    [
        (0.8, ("belt_too_short", "belt_does_not_fit")),
        (1.3, ("belt_too_long", "belt_does_not_fit", "contact_lost", "no_tangent")),
    ],
)
def test_belts_that_do_not_fit(factor, results):
    drive, point = example("three_pulley")
    drive = with_belt_length(held_by_belt(drive, point), factor)
    state = bj.reference_state(drive, point, throw=False)
    assert any(state.result == getattr(bj.RESULTS, name) for name in results)
    with pytest.raises(Exception, match=r"belt|layout"):
        bj.reference_state(drive, point)


def test_slack_span_is_named():
    drive, point = example("seven_pulley")
    heavy = eqx.tree_at(lambda p: p.torque["air conditioner"], point, jnp.array(60.0))
    heavy = eqx.tree_at(lambda p: p.travel, heavy, -heavy.travel)
    assert bj.steady_state(drive, heavy, throw=False).result == bj.RESULTS.span_slack


def test_an_arm_comes_to_rest_at_its_stop():
    """Beyond it the belt would turn it: the stop carries what is left of the balance."""
    drive, point = example("seven_pulley")
    free = bj.reference_state(drive, point)
    turn = float(free.coordinates[0])
    assert turn > 0.02
    place = turn - 0.01
    stopped = eqx.tree_at(lambda d: d.tensioner.stops, drive, jnp.array([-1.0, place]))
    state = bj.reference_state(stopped, point)
    assert float(state.coordinates[0]) == place
    assert state.at_stop.tolist() == [1]
    pull = float(jnp.sum(state.tensions[:, None] * state.layout.span_pulls))
    spring = float(drive.tensioner.stiffness) * (place - float(state.free[0]))
    assert float(state.stop_reactions[0]) == pytest.approx(pull + spring, rel=1e-12)
    assert float(state.stop_reactions[0]) < 0
    assert float(state.unstretched_length) == pytest.approx(float(free.unstretched_length))
