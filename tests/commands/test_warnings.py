"""Warnings of commands that look at many states: the worst of those that were found counts."""

import dataclasses
import re
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from drives import example

import beltjax as bj
from beltjax.commands.reports.states import readings
from beltjax.commands.reports.warnings import (
    load_warnings,
    range_warnings,
    response_warnings,
    steady_warnings,
    sweep_warnings,
)

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


def test_speeds_outside_of_the_table_of_a_load_are_named():
    """At 20 m/s the accessory turns at 20/0.02697 rad/s, 7081 rpm."""
    drive, _ = example("three_pulley")
    table = bj.Load(power=[100.0, 900.0], speed=np.array([3000, 6000]) * np.pi / 30)
    points = [bj.OperatingPoint(belt_speed=v, load={"accessory": table}) for v in (12.0, 20.0)]
    assert load_warnings((drive, points[0])) == []
    [warned] = load_warnings(*((drive, point) for point in points))
    assert warned["code"] == "load_outside_table"
    assert "accessory turns at 7081 rpm (3000 to 6000 rpm)" in warned["text"]
    ratio = 0.0889 / 0.02697
    inside = np.array([3001, 5999]) * np.pi / 30 / ratio
    assert range_warnings(drive, points[0], inside) == []
    assert len(range_warnings(drive, points[0], np.array([0.9, 1.0]) * inside)) == 1


def warned_of(drive, point, steady, code):
    read = readings(drive, point, steady)
    return [one for one in steady_warnings(drive, point, steady, read) if one["code"] == code]


@pytest.mark.slow
def test_tensions_above_the_maker_s_limit_are_named():
    """Without torques all spans have 300 N at rest, and eta of 20 m/s takes some of it."""
    drive, point = example("three_pulley")
    steady = bj.steady_state(drive, point)
    most = float(np.max(steady.running_tensions))

    def limited(limit):
        belt = dataclasses.replace(drive.belt, allowable_tension=limit)
        return dataclasses.replace(drive, belts=(belt,))

    def above(drive):
        return warned_of(drive, point, steady, "tension_above_allowable")

    (one,) = above(limited(most - 1))
    assert re.search(rf"\S+-\S+ has {most:.4g} N of {most - 1:.4g} N", one["text"])
    assert above(limited(most + 1)) == above(drive) == []


@pytest.mark.parametrize(("part", "slips"), [(0.99, True), (1.01, False)])
def test_a_pulley_slips_where_the_capstan_holds_less_than_its_tensions_ask(part, slips):
    """Tensions less m v^2 hold as 1 to exp(friction times wrap), as Euler has it."""
    drive, _ = example("three_pulley")
    point = bj.OperatingPoint(belt_speed=20.0, torque={"accessory": 6.0})
    steady = bj.steady_state(drive, point)
    pull = float(drive.belt.mass_per_length) * 20.0**2
    slack, tight = sorted(np.asarray(steady.running_tensions)[[1, 2]] - pull)
    wrap = float(steady.reference.layout.wraps[2])
    friction = part * np.log(tight / slack) / wrap
    pulleys = (*drive.pulleys[:2], dataclasses.replace(drive.pulleys[2], friction=friction))
    drive = dataclasses.replace(drive, pulleys=pulleys)
    warned = warned_of(drive, point, steady, "belt_slips")
    assert [one["text"].startswith("the belt slips on accessory (-0.0") for one in warned] == (
        [True] * slips
    )


def test_large_speeds_have_no_power_of_ten():
    """At 40 m/s the accessory turns at 40/0.02697 rad/s, 14163 rpm."""
    drive, _ = example("three_pulley")
    table = bj.Load(power=[100.0, 900.0], speed=np.array([3000, 12000]) * np.pi / 30)
    point = bj.OperatingPoint(belt_speed=40.0, load={"accessory": table})
    [warned] = load_warnings((drive, point))
    assert "accessory turns at 14163 rpm (3000 to 12000 rpm)" in warned["text"]


def test_studies_know_what_is_left_of_the_limit():
    drive, point = example("three_pulley")
    with pytest.raises(KeyError, match="belt 'belt' has no allowable_tension"):
        bj.optimize.find_quantity("tension_reserve", drive)
    belt = dataclasses.replace(drive.belt, allowable_tension=500.0)
    drive = dataclasses.replace(drive, belts=(belt,))
    analyses = bj.optimize.DriveAnalyses(drive, point, bj.steady_state(drive, point))
    found = bj.optimize.find_quantity("tension_reserve", drive).measure(analyses)
    np.testing.assert_allclose(found[:3], 200.0, rtol=1e-9)
    np.testing.assert_allclose(found[3:], 500 - analyses.steady.running_tensions, rtol=1e-12)
