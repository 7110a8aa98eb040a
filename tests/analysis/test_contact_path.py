"""The belt as a curve: it closes, and it is as long, as tight and as fast as the state says."""

import numpy as np
import pytest
from drives import example

import beltjax as bj

SEVEN = pytest.param("seven_pulley", marks=pytest.mark.slow)


@pytest.mark.parametrize("name", ["two_pulley_table_5_1", SEVEN])
def test_pieces_join_and_measure_what_the_state_says(name):
    drive, point = example(name)
    state = bj.contact_state(drive, point)
    pieces = bj.belt_pieces(state, 2001)
    for before, after in zip(pieces, (*pieces[1:], pieces[0]), strict=True):
        np.testing.assert_allclose(before.positions[-1], after.positions[0], atol=3e-10)
        assert before.tension[-1] == pytest.approx(after.tension[0], rel=1e-12)
        assert before.speed[-1] == pytest.approx(after.speed[0], rel=1e-12)
    spans = {piece.place: piece for piece in pieces if piece.zone == "span"}
    lengths = [np.ptp(spans[i].arc_length) for i in range(len(spans))]
    np.testing.assert_allclose(lengths, state.span_lengths, rtol=1e-12)
    for piece in pieces:
        if piece.zone != "span":
            center = np.asarray(drive.pulleys[piece.place].center)
            if drive.tensioner is None:  # else the arm has moved its pulley
                away = np.linalg.norm(piece.positions - center, axis=1)
                np.testing.assert_allclose(away, drive.pulleys[piece.place].radius, rtol=1e-12)
    # Unstretched length, by quadrature of ds/(1 + T/EA).
    stretch = [1 + piece.tension / float(drive.belt.axial_stiffness) for piece in pieces]
    total = sum(
        np.trapezoid(1 / s, piece.arc_length) for s, piece in zip(stretch, pieces, strict=True)
    )
    assert total == pytest.approx(float(state.unstretched_length), rel=1e-9)


def test_spans_of_two_pulleys_bulge_outwards_alike_in_every_reading():
    drive, point = example("two_pulley_table_5_1")
    x, w = bj.span_deflection(bj.contact_state(drive, point), 0)
    # The middle stands out by R cos(th) - R + ..., about 4.8 mm; the ends lie on the pulleys.
    assert w.min() == pytest.approx(-4.83e-3, abs=1e-5)
    assert x[0] < 0 < w[0]
    radius = float(drive.pulleys[0].radius)
    assert np.hypot(x[0], radius - w[0]) == pytest.approx(radius, rel=1e-9)
    # Run the other way, the tight span is the other one, mirrored.
    turned = bj.OperatingPoint(
        driver_speed=point.driver_speed,
        mass_flow=point.mass_flow,
        torque=point.torque,
        travel="opposite",
    )
    x_turned, w_turned = bj.span_deflection(bj.contact_state(drive, turned), 1)
    np.testing.assert_allclose(w_turned[::-1], w, atol=1e-11)
    np.testing.assert_allclose(0.15707963267948966 - x_turned[::-1], x, atol=1e-11)
