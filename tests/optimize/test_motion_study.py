"""The design that the study of seven pulleys in motion finds, by a finer route."""

import jax
import numpy as np
import pytest
from drives import EXAMPLES

import beltjax as bj
from beltjax.drive.numbers import with_values

# What `beltjax optimize` writes for the study, which takes too long for a test.
FOUND = {
    "tensioner.angle": np.radians(21.8502),
    "tensioner.stiffness": 15.0,
    "tensioner.friction_torque": 6.0,
    "installation.tension": 500.0,
}


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_design_of_the_study_of_motion_keeps_its_limits():
    study = bj.optimize.load_study(EXAMPLES / "seven_pulley_motion_study.toml")
    assert set(FOUND) == set(study.variables.names)
    drive = with_values(study.drive, FOUND)
    points = study.operating.points
    travels, least, gammas = [], [], []
    for k in range(len(study.operating.names)):
        point = jax.tree.map(lambda x, k=k: x[k], points)
        # 12 harmonics and 16 functions, where the study has 8 and 12.
        found = bj.periodic_response(
            drive, point, harmonics=12, functions=16, damping=bj.Damping(modal=0.02),
            stability=False,
        )  # fmt: skip
        travels.append(float(found.measures.travels[0]))
        least.append(float(found.measures.tension_min.min()))
        gammas.append(float(bj.steady_state(drive, point).coupling.sum()))
    # The study's harmonics and functions are 0.6 % off here, to the safe side.
    assert np.radians(3.95) < max(travels) <= np.radians(4.0)
    assert min(least) > 0
    own = [
        float(
            bj.steady_state(study.drive, jax.tree.map(lambda x, k=k: x[k], points)).coupling.sum()
        )
        for k in range(len(gammas))
    ]
    assert max(gammas) < 0.87 * max(own)
    # A little less friction and the arm travels too far: the limit is what holds the design.
    worst = int(np.argmax(travels))
    point = jax.tree.map(lambda x: x[worst], points)
    weaker = with_values(drive, {"tensioner.friction_torque": 5.0})
    moved = bj.periodic_response(
        weaker, point, harmonics=12, functions=16, damping=bj.Damping(modal=0.02), stability=False
    )
    assert float(moved.measures.travels[0]) > max(travels)
