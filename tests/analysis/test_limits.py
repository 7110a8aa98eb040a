"""What the source leaves out, by exact geometry: docs/theory/limits.md, (L1) to (L3)."""

import jax.numpy as jnp
import numpy as np
import pytest
from drives import example

import beltjax as bj

# Moment per radian [N m] that the source keeps and leaves out; effectiveness by the source, with
# the arm's curvature, and with the belt stretching on the pulleys, too.
SIZES = {
    "three_pulley": ((17.59, -8.25), (0.7855, 0.7960, 0.731)),
    "seven_pulley": ((15.28, -0.632), (0.9741, 0.9744, 0.955)),
}


@pytest.mark.parametrize(
    "name", ["three_pulley", pytest.param("seven_pulley", marks=pytest.mark.slow)]
)
def test_the_arm_s_own_curvature_and_the_stretching_arcs(name):
    drive, point = example(name)
    rest = bj.reference_state(drive, point)
    at, arm = rest.layout, drive.tensioner
    turned = rest.coordinates[0]
    slope = np.asarray(at.span_turns[:, 0] / at.span_lengths)  # a_i
    turning = np.asarray(at.span_lengths) * slope**2
    curvature = np.asarray(at.curvatures[:, 0, 0])  # H_i
    step = 1e-3
    paths = [float(bj.layout(drive, turned + k * step).path_length) for k in (-1, 0, 1)]
    whole = (paths[0] - 2 * paths[1] + paths[2]) / step**2
    assert whole == pytest.approx(np.sum(turning + curvature), rel=1e-5)

    (kept, left_out), printed = SIZES[name]
    tensions = np.asarray(rest.tensions)
    assert tensions @ turning == pytest.approx(kept, abs=5e-3)
    assert tensions @ curvature == pytest.approx(left_out, abs=5e-3)

    take_up = float(jnp.sum(at.span_pulls)) ** 2  # (r_t D)^2
    bare = float(arm.stiffness) + tensions @ turning
    spans, path = float(jnp.sum(at.span_lengths)), float(at.path_length)
    cases = (bare, spans), (bare + tensions @ curvature, spans), (bare + tensions @ curvature, path)
    etas = [
        gain / (gain + length / float(drive.belt.axial_stiffness))
        for gain, length in ((take_up / moment, length) for moment, length in cases)
    ]
    assert [
        round(eta, len(str(text)) - 2) for eta, text in zip(etas, printed, strict=True)
    ] == list(printed)
