"""The SciPy route of chapter 5 against print, converged values and its own consistency."""

import numpy as np
import pytest

from beltjax.validation.peers import contact as peer

TWO_EQUAL = peer.PeerDrive(  # Table 5.1
    centers=np.array([[0.0, 0.0], [np.pi * 0.05, 0.0]]),
    radii=np.array([0.05, 0.05]),
    moments=np.array([0.0, 2.0]),
    friction=np.array([0.6, 0.6]),
    bending_stiffness=0.015,
    axial_stiffness=25e3,
    tension=50.0,
    mass_flow=0.5,
    driver_speed=500.0,
)
TWO_UNEQUAL = peer.PeerDrive(  # Table 5.3, c = c_cr/2
    centers=np.array([[0.0, 0.0], [0.1, 0.0]]),
    radii=np.array([0.01, 0.05]),
    moments=np.array([0.0, 40.0]),
    friction=np.array([1.0, 1.0]),
    bending_stiffness=0.015,
    axial_stiffness=40e3,
    tension=800.0,
    mass_per_length=0.0056,
    belt_speed=187.0,
)
SERPENTINE = peer.PeerDrive(  # three pulleys, one on the back and carried by an arm
    centers=np.array([[0.5525, 0.0556], [0.3477, 0.05715], [0.0, 0.0]]),
    radii=np.array([0.0889, -0.0452, 0.02697]),
    moments=np.array([0.0, 0.0, 1.0]),
    friction=np.array([0.5, 0.5, 0.5]),
    bending_stiffness=0.015,
    axial_stiffness=120e3,
    tension=300.0,
    mass_per_length=0.1029,
    belt_speed=20.0,
    arm=peer.Arm(pulley=1, pivot=(0.2508, 0.0635), stiffness=116.4),
)


def variant(drive, **changes):
    return peer.replace(drive, **changes)


# EI; converged slip, adhesion, th1(0), -th2(0) [deg], L1/d, L2/d, T1(0) [N]
TABLE_5_2 = [
    (0.0, 109.379, 70.621, 0.0, 0.0, 1.0, 1.0, 71.16),
    (0.0015, 105.851, 58.483, 5.732, 9.935, 1.0637, 1.1107, 72.207),
    (0.015, 87.451, 49.704, 16.873, 25.973, 1.1888, 1.2934, 79.189),
    (0.05, 90.420, 15.692, 29.839, 44.049, 1.3388, 1.5112, 77.854),
]


@pytest.mark.parametrize("row", TABLE_5_2, ids=lambda row: f"EI={row[0]}")
def test_regular_moment_of_two_equal_pulleys(row):
    EI, slip, adhesion, tight, slack, L1, L2, T1 = row
    # The belt leaves the driver slack, and its second span, the tight one, ends on the driver.
    state = peer.contact_state(variant(TWO_EQUAL, bending_stiffness=EI), 1e-6, 1e-8)
    assert np.degrees(state.slip) == pytest.approx([slip, slip], abs=6e-4)
    assert np.degrees(state.adhesion) == pytest.approx([adhesion, adhesion], abs=6e-4)
    assert np.degrees(state.angle_end) == pytest.approx([slack, tight], abs=6e-4)
    assert np.degrees(state.angle_start) == pytest.approx([-slack, -tight], abs=6e-4)
    assert state.lengths / (np.pi * 0.05) == pytest.approx([L2, L1], abs=6e-5)
    assert state.tension_end[1] == pytest.approx(T1, abs=6e-3 if EI == 0 else 6e-4)
    assert abs(state.closure) < 1e-7


# EI: angles on the driver and the driven pulley, of the slack and the tight span [deg]
FIGURE_5_7 = {
    0.0015: (38.833, 20.320, 29.451, 22.372),
    0.015: (60.034, 15.181, 43.962, 19.136),
    0.05: (77.919, 10.475, 68.580, 12.959),
}


@pytest.mark.parametrize("EI", FIGURE_5_7)
def test_departure_angles_at_the_maximum_moment(EI):
    state = peer.maximum_moment(variant(TWO_UNEQUAL, bending_stiffness=EI), 1e-5, 1e-7)
    slack_driver, slack_driven, tight_driver, tight_driven = FIGURE_5_7[EI]
    assert -np.degrees(state.angle_start[0]) == pytest.approx(slack_driver, abs=6e-4)
    assert -np.degrees(state.angle_end[0]) == pytest.approx(slack_driven, abs=6e-4)
    assert np.degrees(state.angle_end[1]) == pytest.approx(tight_driver, abs=6e-4)
    assert np.degrees(state.angle_start[1]) == pytest.approx(tight_driven, abs=6e-4)
    assert abs(state.adhesion[0]) < 1e-6
    assert state.adhesion[1] > 1


# EI, c/c_cr: M2/(R2 T_ini), efficiency
FIGURE_5_8 = {
    (0.0, 0.0): (2.280, 0.9566),
    (0.0, 0.5): (1.703, 0.9672),
    (0.0, 0.8): (0.814, 0.9840),
    (0.015, 0.0): (1.460, 0.9736),
    (0.05, 0.5): (0.305, 0.9999),
    (0.05, 0.8): (0.024, 1.0055),
}
MORE_OF_FIGURE_5_8 = {
    (0.0015, 0.0): (2.056, 0.9609),
    (0.0015, 0.5): (1.510, 0.9710),
    (0.0015, 0.8): (0.683, 0.9867),
    (0.015, 0.5): (0.997, 0.9823),
    (0.015, 0.8): (0.358, 0.9947),
    (0.05, 0.0): (0.606, 0.9940),
}


def assert_matches_figure_5_8(EI, C, moment, efficiency):
    drive = variant(TWO_UNEQUAL, bending_stiffness=EI, belt_speed=C * 374.0)
    state = peer.maximum_moment(drive, 1e-5, 1e-6)
    assert state.moments[1] / (0.05 * 800) == pytest.approx(moment, abs=6e-4)
    assert state.efficiency == pytest.approx(efficiency, abs=6e-5)


@pytest.mark.parametrize(("EI", "C"), FIGURE_5_8)
def test_maximum_moment_and_efficiency(EI, C):
    assert_matches_figure_5_8(EI, C, *FIGURE_5_8[EI, C])


@pytest.mark.slow
@pytest.mark.parametrize(("EI", "C"), MORE_OF_FIGURE_5_8)
def test_more_maximum_moments_and_efficiencies(EI, C):
    assert_matches_figure_5_8(EI, C, *MORE_OF_FIGURE_5_8[EI, C])


@pytest.mark.parametrize(
    ("EI", "moment"), [(0.0, 3.104), (0.0015, 3.043), (0.015, 3.468), (0.05, 2.456)]
)
def test_maximum_moment_need_not_fall_with_stiffness(EI, moment):
    state = peer.maximum_moment(variant(TWO_EQUAL, bending_stiffness=EI), 1e-5, 1e-6, first=1.5)
    assert state.moments[1] == pytest.approx(moment, abs=6e-4)
    assert state.factor == pytest.approx(state.moments[1] / 2)


def test_the_rules_for_the_speed_and_for_the_belt_agree():
    drive = variant(TWO_UNEQUAL, moments=np.array([0.0, 20.0]))
    state = peer.contact_state(drive, 1e-6, 1e-9)
    driven = variant(drive, belt_speed=None, driver_speed=state.pulley_speeds[0])
    others = [
        driven,
        variant(driven, mass_per_length=None, mass_flow=state.mass_flow),
        variant(drive, tension=None, unstretched_length=state.unstretched_length),
    ]
    for other in others:
        found = peer.contact_state(other, 1e-6, 1e-9)
        assert found.tension_middle == pytest.approx(state.tension_middle, rel=1e-7)
        assert found.reference_speed == pytest.approx(state.reference_speed, rel=1e-9)
        assert found.mass_flow == pytest.approx(state.mass_flow, rel=1e-9)


def test_a_looser_tolerance_finds_the_same_to_that_tolerance():
    tight = peer.contact_state(TWO_EQUAL, 1e-7, 1e-11)
    for tol, expected in ((1e-6, 1e-6), (1e-4, 1e-4)):
        loose = peer.contact_state(TWO_EQUAL, tol, tol)
        assert loose.tension_middle == pytest.approx(tight.tension_middle, rel=expected)
        assert loose.lengths == pytest.approx(tight.lengths, rel=expected)


def test_an_arm_is_in_balance_with_the_force_on_its_pulley():
    state = peer.contact_state(SERPENTINE, 1e-6, 1e-9)
    arm, pull, before, after = SERPENTINE.arm, [], state.spans[0], state.spans[1]
    x = arm.pivot[0] + np.hypot(0.3477 - 0.2508, 0.05715 - 0.0635) * np.cos(state.arm_angle)
    y = arm.pivot[1] + np.hypot(0.3477 - 0.2508, 0.05715 - 0.0635) * np.sin(state.arm_angle)
    for span, along in (
        (after, np.array([0.0 - x, 0.0 - y])),
        (before, np.array([x - 0.5525, y - 0.0556])),
    ):
        ex = along / np.linalg.norm(along)
        pull.append(span.force[0] * ex + span.force[1] * np.array([-ex[1], ex[0]]))
    force = pull[0] - pull[1]
    moment = (x - arm.pivot[0]) * force[1] - (y - arm.pivot[1]) * force[0]
    turn = arm.stiffness * (state.arm_angle - state.free_angle)
    assert moment == pytest.approx(turn, rel=1e-6)
    # The same from Euler and the torque: the idler takes none.
    assert state.spans[0].end == pytest.approx(state.spans[1].start, rel=1e-9)
    assert state.wraps.min() > 0


def test_a_small_stiffness_is_the_string():
    states = [
        peer.contact_state(variant(SERPENTINE, bending_stiffness=EI), 1e-6, 1e-8)
        for EI in (0.0, 1e-4)
    ]
    assert states[1].tension_middle == pytest.approx(states[0].tension_middle, rel=1e-4)
    # Wraps change by the square root: twice asin(sqrt(EI/C)/2R) at each end of a span.
    C = 300.0
    assert states[0].wraps - states[1].wraps == pytest.approx(
        2 * np.sqrt(1e-4 / C) / np.abs(SERPENTINE.radii), rel=0.1
    )
