"""Warnings of commands that look at many states: the worst of those that were found counts."""

from types import SimpleNamespace

import jax
import numpy as np
import pytest
from drives import example

import beltjax as bj
from beltjax.commands.reports.warnings import response_warnings, sweep_warnings

RATIOS = np.array([[0.05, 0.1, 0.14], [0.05, 0.1, 0.2], [0.3, np.nan, np.nan]])


@pytest.mark.parametrize(("good", "stiff"), [([1, 0, 0], []), ([1, 1, 0], ["accessory (0.2)"])])
def test_a_sweep_warns_of_the_belt_that_is_stiff_at_one_of_its_values(good, stiff):
    drive, point = example("three_pulley")
    found = SimpleNamespace(stiffness_ratios=RATIOS, good=np.array(good, bool))
    warned = sweep_warnings(drive, point, found)
    assert [one["code"] for one in warned] == ["belt_stiff_on_pulley"] * len(stiff)
    for name in stiff:
        assert f"stiff for {name}: sqrt(EI/T)/radius is above 0.15" in warned[0]["text"]


def test_a_response_warns_of_stiff_belts_and_of_slack_spans():
    drive, _ = example("three_pulley")

    def ending(good):
        return bj.RESULTS.where(good, bj.RESULTS.successful, bj.RESULTS.no_tangent)

    found = SimpleNamespace(
        result=jax.vmap(ending)(np.array([True, True])),
        stiffness_ratios=RATIOS[:2],
        slack_factors=np.array([[3.0, 0.26, 5.0], [2.0, 0.5, 4.0]]),
    )
    codes = [one["code"] for one in response_warnings(drive, found)]
    assert codes == ["belt_stiff_on_pulley", "span_slackens"]
