"""A study made in Python says what is wrong with it; new numbers compile nothing."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import pytest
from compilations import compilations
from drives import EXAMPLES

import beltjax as bj

BAD = {
    "method": ({"method": "ipotp"}, "method 'ipotp' is not one of 'sqp', 'augmented-lagrangian'"),
    "starts": ({"starts": 0}, "starts is a whole number from 1, not 0"),
    "seed": ({"seed": -1}, "seed is a whole number from 0, not -1"),
    "sharpness": ({"sharpness": 0.0}, r"sharpness is positive, not 0\.0"),
    "time limit": ({"time_limit": -3.0}, r"time_limit is positive, not -3\.0"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_wrong_is_said(case):
    changes, message = BAD[case]
    study = bj.optimize.load_study(EXAMPLES / "three_pulley_study.toml")
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(study, **changes)


@pytest.mark.slow
def test_new_numbers_compile_nothing():
    study = dataclasses.replace(
        bj.optimize.load_study(EXAMPLES / "three_pulley_study.toml"), starts=4
    )
    bj.optimize.minimize(study)
    other = eqx.tree_at(
        lambda s: (s.drive.tensioner.stiffness, s.point.belt_speed, s.sharpness),
        study,
        (100, jnp.asarray(15.0), 30.0),
    )
    with compilations() as count:
        found = bj.optimize.minimize(other)
    assert found.success
    assert count == [0]
