"""Chapter 5 against print: contact of a bending-stiff belt on two pulleys, and on seven."""

import numpy as np
import published_contact as table
import pytest
from contact_drives import equal, largest, seven, state, unequal, variant
from published import assert_matches_print
from scipy.optimize import brentq

import beltjax as bj

DISTANCE = 0.05 * np.pi


@pytest.mark.parametrize("row", table.TABLE_5_2, ids=lambda row: f"EI={row.EI}")
def test_regular_moment_of_two_equal_pulleys(row):
    # Listed driver first, the belt leaves the driver slack; the tight span, 1, comes back to it.
    found = state(*equal(EI=row.EI))
    assert found.feasible
    assert np.degrees(found.slips) == pytest.approx([np.degrees(found.slips[0])] * 2, rel=1e-9)
    computed = (
        np.degrees(found.slips[0]),
        np.degrees(found.adhesions[0]),
        -np.degrees(found.angles[1, 1]),
        np.degrees(found.angles[0, 0]),
        found.span_lengths[1] / DISTANCE,
        found.span_lengths[0] / DISTANCE,
        found.tensions[1, 2],
    )
    for value, known in zip(computed, row[1:], strict=True):
        for one in known:
            assert_matches_print(value, one)


@pytest.mark.parametrize("EI", table.FIGURE_5_7)
def test_departure_angles_at_the_maximum_moment(EI):
    found = largest(*unequal(EI=EI))
    tight, slack = found.angles[1], found.angles[0]
    # th1(0), th1(L), -th2(0), -th2(L); the source counts towards the outside, from the driver.
    angles = np.degrees([-tight[1], tight[0], slack[0], slack[1]])
    for angle, known in zip(angles, table.FIGURE_5_7[EI], strict=True):
        for one in known:
            assert_matches_print(abs(angle), one)
    # It is the driver that slips all round, as the source takes it.
    assert found.adhesions[0] == pytest.approx(0.0, abs=1e-12)
    assert found.adhesions[1] > 1


@pytest.mark.parametrize(("EI", "speed"), table.FIGURE_5_8)
def test_maximum_moment_and_efficiency(EI, speed):
    moment, efficiency = table.FIGURE_5_8[EI, speed]
    found = largest(*unequal(EI=EI, c=speed * table.CRITICAL_SPEED))
    assert found.feasible
    assert_matches_print(found.moments[1] / (0.05 * 800), moment)
    assert_matches_print(found.efficiency, efficiency)


@pytest.mark.parametrize("EI", table.LARGEST_OF_EQUAL)
def test_bending_stiffness_need_not_lower_the_maximum_moment(EI):
    found = largest(*equal(EI=EI))
    assert_matches_print(found.driver_moment, table.LARGEST_OF_EQUAL[EI])
    assert found.torque_factor == pytest.approx(found.moments[1] / 2.0)


def test_adhesion_of_equal_pulleys_vanishes_at_a_stiffness():
    def adhesion(EI):
        return float(state(*equal(EI=EI)).adhesions[0])

    assert brentq(adhesion, 0.05, 0.07, xtol=1e-10) == pytest.approx(0.0650, abs=5e-5)
    beyond = state(*equal(EI=0.067))
    assert beyond.result == bj.RESULTS.gross_slip
    assert not beyond.feasible


def test_critical_speed_of_the_string():
    # T_ini = m0 c^2 (1 + T_ini/EA): the whole tension carries the belt round, and no pressure,
    # and so no moment, is left.
    critical = np.sqrt(800 / (0.0056 * (1 + 800 / 40e3)))
    assert_matches_print(critical, table.Value("374.24"))
    just_below = largest(*unequal(EI=0.0, c=critical * (1 - 1e-4)))
    assert 0 < just_below.moments[1] < 1e-3 * 0.05 * 800
    assert not largest(*unequal(EI=0.0, c=critical * (1 + 1e-4))).feasible


def test_the_drivers_wrap_vanishes_before_the_critical_speed():
    # A stiff belt needs more room than the small pulley has: at EI = 0.05 with no torque left the
    # wrap is gone at 0.84837 of the printed critical speed, 0.84783 of the exact one.
    def wrap(speed):
        point = unequal(EI=0.05, c=speed * table.CRITICAL_SPEED, M2=1e-9)
        return float(state(*point).wraps[0])

    vanishing = brentq(wrap, 0.8, 0.9, xtol=1e-9)
    assert vanishing == pytest.approx(0.84837, abs=5e-6)
    before, after = (
        unequal(EI=0.05, c=(vanishing + h) * table.CRITICAL_SPEED, M2=1e-9) for h in (-1e-3, 1e-3)
    )
    assert largest(*before).feasible
    assert largest(*before).driver_moment < 0.01
    assert state(*after).result == bj.RESULTS.wrap_vanished
    assert not largest(*after).feasible


def test_only_the_sources_law_gives_an_efficiency_above_one():
    def efficiency(speed, law="kong"):
        point = unequal(EI=0.05, c=speed * table.CRITICAL_SPEED)
        return float(largest(*point, law=law).efficiency)

    crossing = brentq(lambda speed: efficiency(speed) - 1, 0.4, 0.6, xtol=1e-9)
    assert_matches_print(crossing, table.Value("0.504"))
    speeds = np.linspace(0.0, 0.848, 9)
    assert max(efficiency(speed) for speed in speeds) > 1.005
    assert all(efficiency(speed, "hyperelastic") < 1 for speed in speeds)


def test_the_arm_keeps_the_seven_pulley_drive_from_slipping():
    drive, point = seven()
    found = state(drive, point)
    assert found.feasible
    turned = np.degrees(found.arm_angle - bj.layout(drive).arm_angle)
    assert_matches_print(turned, table.Value("1.98"))
    at_most = largest(drive, point)
    assert_matches_print(at_most.torque_factor, table.Value("1.251"))
    assert np.argmin(at_most.adhesions) == drive.pulley("crankshaft")
    assert at_most.adhesions[0] == pytest.approx(0, abs=1e-12)
    # A spring stiff as rock locks the arm.
    locked = state(*variant(drive, point, k_r=1e12))
    assert abs(float(locked.arm_angle - bj.layout(drive).arm_angle)) < 1e-9
    assert locked.result == bj.RESULTS.gross_slip
    slipping = np.flatnonzero(np.asarray(locked.adhesions) < 0)
    assert [drive.pulley_names[i] for i in slipping] == ["crankshaft", "alternator"]
