"""`method = "sqp"`: batches that refill, checkpoints, the time limit, and the shipped studies."""

import dataclasses

import numpy as np
import pytest
from drives import EXAMPLES

import beltjax as bj

pytestmark = pytest.mark.slow  # what a study compiles
WIDTH = bj.optimize.search.batched_sqp.WIDTH


def shipped(name, **changes):
    loaded = bj.optimize.load_study(EXAMPLES / f"{name}.toml")
    return dataclasses.replace(loaded, method="sqp", **changes)


@pytest.fixture(scope="module")
def study():
    """The three-pulley study, from more starts than a batch has lanes."""
    return shipped("three_pulley_study", starts=WIDTH + 16)


@pytest.fixture(scope="module")
def best(study):
    return bj.optimize.minimize(study)


def test_all_starts_end_in_the_optimum_with_its_planted_limits(study, best):
    assert best.success
    assert best.optimality.residual < 1e-9
    # Both radii are planted: the ratio 2.5 of an 88.9 mm crankshaft, and the upper bound.
    assert best.values["pulley.accessory.radius"] == pytest.approx(0.0889 / 2.5, rel=1e-8)
    assert best.values["pulley.tensioner.radius"] == pytest.approx(0.06, rel=1e-8)
    assert best.optima[0].starts == study.starts


def test_the_history_has_every_start_s_own_iterations(study, best):
    objective, violation = best.history
    assert objective.shape == violation.shape
    assert objective.shape[1] == study.starts
    known = np.isfinite(objective)
    # Iterations follow each other without a gap, and differ in number.
    assert np.all(known[:-1] | ~known[1:])
    assert len(set(known.sum(axis=0).tolist())) > 1
    for start, steps in enumerate(known.sum(axis=0)):
        if best.starts[start].result == "optimal":
            assert violation[steps - 1, start] <= 1e-9


def test_a_search_stopped_in_the_middle_goes_on_as_if_it_had_not(study, best, tmp_path):
    path, told = tmp_path / "state", []

    def stop(stage, done, total):
        told.append(done)
        if len(told) == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        bj.optimize.minimize(study, stop, checkpoint=path)
    before = [done for done in told if done > 0]
    resumed = []
    again = bj.optimize.minimize(study, lambda *a: resumed.append(a[1]), checkpoint=path)
    assert max(resumed[:2]) >= before[-1] > 0  # not from the first iteration
    assert again.values == best.values
    np.testing.assert_array_equal(again.history.objective, best.history.objective)
    with pytest.raises(ValueError, match="is of another study"):
        bj.optimize.minimize(dataclasses.replace(study, seed=1), checkpoint=path)


def test_no_time_is_a_result(study):
    design = bj.optimize.minimize(dataclasses.replace(study, time_limit=1e-9))
    assert design.result == bj.RESULTS.time_limit_reached
    assert design.starts[0].result == "out of time"


def test_a_warm_start_ends_where_it_began(study, best):
    design = bj.optimize.minimize(study, warm=(best.values,))
    assert design.starts[0].final == pytest.approx(best.final, rel=1e-9)
    assert np.sum(np.isfinite(design.history.objective[:, 0])) <= 6


@pytest.mark.parametrize("name", ["seven_pulley_study", "starter_generator_study"])
def test_shipped_studies_end_where_slsqp_does(name):
    design = bj.optimize.minimize(shipped(name))
    other = bj.optimize.minimize(dataclasses.replace(shipped(name, starts=4), method="slsqp"))
    assert design.success
    assert design.final <= other.final * (1 + 1e-8)
