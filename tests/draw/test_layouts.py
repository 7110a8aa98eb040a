"""What pictures show is what was computed."""

import numpy as np
import pytest
from drives import example

import beltjax as bj
from beltjax.compiling.quick import quickly_compiled
from beltjax.draw.curves import response_figure, sweep_figure
from beltjax.draw.layouts import AFTER, ARM, mode_shapes, picture_bytes

BASIS = bj.Legendre(12)


def _modes(drive, point):
    return bj.modes(bj.linearize(bj.steady_state(drive, point), BASIS), 3, route="hermitian")


def lines(axes, color):
    return [np.array(line.get_data()).T for line in axes.get_lines() if line.get_color() == color]


def test_spans_on_the_arm_move_with_it():
    drive, point = example("three_pulley")
    found = quickly_compiled(_modes)(drive, point)
    figure = mode_shapes(drive, point, found, 3)
    at = found.linearization.steady.reference.layout
    arms = np.abs(np.asarray(found.arm_rotations))
    axes = figure.axes[int(np.argmax(arms))]
    rest, moved = lines(axes, "#999999"), lines(axes, ARM)[0]
    (tip,) = (line[1] for line in rest if len(line) == 2 and np.allclose(line[0], moved[0]))
    step = moved[1] - tip
    assert np.linalg.norm(step) > 1.0  # [mm]
    spans = [line for line in lines(axes, AFTER) if len(line) == 81]
    assert len(spans) == 3
    normals = np.asarray(at.normals)
    # Spans 0 and 1 end and start on the tensioner's pulley, up to the turn of a finite step.
    ends = [
        (spans[0][-1] - 1e3 * np.asarray(at.ends)[0]) @ normals[0],
        (spans[1][0] - 1e3 * np.asarray(at.starts)[1]) @ normals[1],
    ]
    np.testing.assert_allclose(ends, normals[:2] @ step, atol=0.15 * np.linalg.norm(step))
    # The ends on fixed pulleys stay.
    np.testing.assert_allclose(spans[2][[0, -1]], 1e3 * np.stack([at.starts[2], at.ends[2]]))


@pytest.fixture(scope="module")
def swept():
    drive, point = example("three_pulley")
    speeds = np.linspace(0.0, 600.0, 4)
    return drive, bj.sweep(drive, point, "operation.driver_speed", speeds, count=3, basis=BASIS)


def test_an_order_is_a_line_through_the_origin(swept):
    drive, found = swept
    (axes,) = sweep_figure(drive, found, found.labels, [2.0]).axes
    (line,) = lines(axes, "#555555")
    np.testing.assert_allclose(line[:, 1], 2.0 * line[:, 0] / 60)  # rpm to Hz
    first = np.array(axes.get_lines()[0].get_data())
    np.testing.assert_allclose(first[1], found.frequencies[:, 0] / (2 * np.pi))


def test_names_are_no_formulas():
    curves = {"hub load (N)": {"a$b_c": np.array([1.0, 2.0])}}
    figure = response_figure(
        "50 $ and $^", np.array([600.0, 700.0]), curves, np.array([False, True])
    )
    assert picture_bytes(figure, "x.svg").startswith(b"<?xml")
