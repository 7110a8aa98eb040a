"""Whole drives solved by SciPy satisfy every balance, and what is wrong is noticed."""

import numpy as np
import pytest
from closed_belt import BeltData, PulleyData, SpanData, balances, integrated_span

from beltjax.validation.peers.contact import (
    Arm,
    Chain,
    PeerDrive,
    contact_state,
    maximum_moment,
    replace,
)
from beltjax.validation.peers.span import bent_span

TIGHT = (1e-7, 1e-11)  # solve_bvp's and the root finders' tolerances
TWO_EQUAL = PeerDrive(  # Table 5.1
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
TWO_UNEQUAL = PeerDrive(  # Table 5.3
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
SERPENTINE = PeerDrive(  # clockwise, two on the back, an arm, a driver that is not first
    centers=np.array([[0.15, 0.2], [0.0, 0.0], [-0.12, 0.07], [-0.3, 0.05], [-0.06, 0.17]]),
    radii=np.array([-0.03, -0.07, 0.04, -0.05, 0.045]),
    moments=np.array([2.0, 0.0, 0.4, 3.0, 0.0]),
    friction=np.array([0.5, 0.5, 0.3, 0.5, 0.3]),
    bending_stiffness=0.0143,
    axial_stiffness=120e3,
    driver=1,
    tension=350.0,
    mass_per_length=0.1029,
    driver_speed=80.0,
    arm=Arm(pulley=4, pivot=(0.02, 0.24), stiffness=30.0),
)


def data_of(drive, state, hyperelastic=False):
    """The answer as `balances` takes it."""
    centers = Chain(drive, 1.0).centers(state.arm_angle)
    lines = np.roll(centers, -1, axis=0) - centers
    psi = np.arctan2(lines[:, 1], lines[:, 0])
    first = np.array([span.states[:, 0] for span in state.spans])
    L = first[:, 6]
    x, y = L * first[:, 4], L * first[:, 5]
    place = np.stack([x * np.cos(psi) - y * np.sin(psi), x * np.sin(psi) + y * np.cos(psi)], axis=1)
    EI, EA = drive.bending_stiffness, drive.axial_stiffness
    belt = BeltData(
        EI, EA, state.reference_speed, state.mass_flow, state.unstretched_length, hyperelastic
    )
    pulleys = PulleyData(
        centers, drive.radii, state.moments, drive.friction, state.adhesion, state.slip
    )
    P = np.array([span.start for span in state.spans])
    spans = SpanData(centers + place, psi + first[:, 3], first[:, 1] / L, first[:, 2] / L**2, P, L)
    return belt, pulleys, spans


def largest(residual):
    return float(np.max(np.abs(residual)))


def assert_balanced(b, force):
    """Residuals of a drive whose forces are about `force`, to eight digits or better."""
    assert largest(b.curvature) < 1e-9
    assert largest(b.curvature_slope) < 1e-8 * 1e4
    for length in (b.start, b.end, b.gap, b.unstretched_length):
        assert largest(length) < 1e-10
    for angle in (b.inclination, b.turning):
        assert largest(angle) < 1e-9
    for forces in (b.P, b.pulley_forces, b.span_forces):
        assert largest(forces) < 1e-8 * force
    for moments in (b.moments, b.friction_moments, b.span_moments):
        assert largest(moments) < 1e-9 * force


STATES = {
    "equal": (TWO_EQUAL, contact_state, 100.0),
    "thin layers": (replace(TWO_EQUAL, bending_stiffness=0.0015), contact_state, 100.0),
    "stiff": (replace(TWO_EQUAL, bending_stiffness=0.05), contact_state, 100.0),
    "full slip": (TWO_UNEQUAL, maximum_moment, 2000.0),
    "serpentine": (SERPENTINE, contact_state, 1000.0),
}


@pytest.fixture(scope="module")
def answers():
    return {name: solve(drive, *TIGHT) for name, (drive, solve, _) in STATES.items()}


@pytest.mark.parametrize("name", STATES)
def test_every_balance_closes(answers, name):
    drive, _, force = STATES[name]
    assert_balanced(balances(*data_of(drive, answers[name])), force)


@pytest.mark.parametrize("name", STATES)
def test_power_is_friction_and_the_flaw_of_the_law(answers, name):
    drive, state = STATES[name][0], answers[name]
    b = balances(*data_of(drive, state))
    assert b.pulley_speeds == pytest.approx(state.pulley_speeds, rel=1e-9)
    # dV/dP, and what EA e = T makes of bending at constant tension, pulley by pulley.
    softness = state.reference_speed / (
        drive.axial_stiffness - state.mass_flow * state.reference_speed
    )
    friction = softness / 2 * np.sum((state.moments / drive.radii) ** 2)
    flaw = softness * drive.bending_stiffness / 2 * np.sum(state.moments / np.abs(drive.radii) ** 3)
    assert b.friction_loss == pytest.approx(friction, rel=1e-8)
    assert b.power == pytest.approx(flaw, rel=1e-6, abs=1e-7 * friction)
    # The hyperelastic law has no flaw; the shapes are the same, for they do not know the law.
    assert abs(balances(*data_of(drive, state, hyperelastic=True)).power) < 1e-7 * friction


def test_the_arm_carries_what_its_pulley_does(answers):
    state, arm = answers["serpentine"], SERPENTINE.arm
    _, pulleys, _ = given = data_of(SERPENTINE, state)
    force = balances(*given).axle_forces[arm.pulley]
    lever = pulleys.centers[arm.pulley] - arm.pivot
    moment = lever[0] * force[1] - lever[1] * force[0]
    assert moment == pytest.approx(arm.stiffness * (state.arm_angle - state.free_angle), rel=1e-7)


@pytest.mark.parametrize(
    ("field", "residual"),
    [
        ("length", "end"),
        ("P", "friction_moments"),
        ("inclination", "inclination"),
        ("curvature_slope", "curvature_slope"),
        ("position", "start"),
    ],
)
def test_a_wrong_state_is_noticed(answers, field, residual):
    belt, pulleys, spans = data_of(TWO_EQUAL, answers["equal"])
    wrong = spans._replace(**{field: getattr(spans, field) * (1 + 1e-5)})
    right = largest(getattr(balances(belt, pulleys, spans), residual))
    assert largest(getattr(balances(belt, pulleys, wrong), residual)) > 100 * right


def test_a_wrong_slip_angle_is_noticed(answers):
    belt, pulleys, spans = data_of(TWO_EQUAL, answers["equal"])
    wrong = pulleys._replace(slip=pulleys.slip + 1e-6, adhesion=pulleys.adhesion - 1e-6)
    b = balances(belt, wrong, spans)
    assert largest(b.friction_moments) > 1e-7
    assert largest(b.P) > 1e-6
    assert largest(b.pulley_forces) > 1e-6
    assert largest(b.inclination) < 1e-9


@pytest.mark.parametrize("signs", [(1, 1), (1, -1)])
@pytest.mark.parametrize("EI", [1e-4, 0.1])
def test_long_and_short_spans_are_integrated_to_rounding(signs, EI):
    rho, d, P = np.array(signs) * (0.05, 0.08), 0.3, 100.0
    span = bent_span(P, EI, rho[0], rho[1], d, EA=1e4, tol=1e-7)
    shape = integrated_span(BeltData(EI, 1e4), P, *(1 / rho), span.angle_start, span.length)
    reach = np.array([d + rho[1] * np.sin(span.angle_end), -rho[1] * np.cos(span.angle_end)])
    start = rho[0] * np.array([np.sin(span.angle_start), -np.cos(span.angle_start)])
    assert shape.end == pytest.approx(reach - start, abs=1e-11)
    assert shape.turn == pytest.approx(span.angle_end - span.angle_start, abs=1e-10)
    assert shape.unstretched == pytest.approx(1e4 * span.compliance, rel=1e-10)
    assert shape.P_end == pytest.approx(span.end, rel=1e-10)
