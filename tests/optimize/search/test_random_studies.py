"""Thirty random studies by sequential quadratic programming and by SciPy, start for start."""

import dataclasses

import equinox as eqx
import numpy as np
import pytest
from drives import EXAMPLES

import beltjax as bj

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]  # SLSQP takes one start at a time

BASES = ("three_pulley_study", "seven_pulley_study", "seven_pulley_two_arms_study")
OF_EACH, STARTS = 10, 12
# Where both end in the same optimum, objectives differ by what SLSQP stops at.
SAME = 1e-6


def varied(study, rng):
    """`study` with other bounds, within its own, and limits moved by up to a fifth."""
    low, high = np.asarray(study.variables.lower), np.asarray(study.variables.upper)
    width = high - low
    begin = low + width * rng.uniform(0.0, 0.35, low.shape)
    end = high - width * rng.uniform(0.0, 0.35, low.shape)
    sides = [
        np.asarray(side) * rng.uniform(0.8, 1.2, np.shape(side))
        for side in (study.constraints.lower, study.constraints.upper)
    ]
    return eqx.tree_at(
        lambda s: (
            s.variables.lower,
            s.variables.upper,
            s.constraints.lower,
            s.constraints.upper,
        ),
        study,
        (begin, end, np.minimum(*sides), np.maximum(*sides)),
    )


def solved(study, method):
    return bj.optimize.minimize(dataclasses.replace(study, method=method))


@pytest.mark.parametrize("base", BASES)
def test_no_random_study_ends_better_by_slsqp(base):
    loaded = bj.optimize.load_study(EXAMPLES / f"{base}.toml")
    loaded = dataclasses.replace(loaded, starts=STARTS)
    rng = np.random.default_rng(BASES.index(base))
    solvable = 0
    for number in range(OF_EACH):
        study = varied(loaded, rng)
        ours, other = solved(study, "sqp"), solved(study, "slsqp")
        if other.success:
            assert ours.success, f"study {number}: {ours.message}"
            assert ours.final <= other.final * (1 + SAME), f"study {number}"
        solvable += bool(ours.success)
    assert solvable >= OF_EACH // 2
