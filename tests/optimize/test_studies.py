"""One study by several optimizers, stopped and gone on with, traded off, chosen for, coupled."""

import dataclasses
import importlib

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import openmdao.api as om
import pytest
from drives import EXAMPLES

import beltjax as bj
from beltjax.drive.numbers import number_value, with_number


@pytest.fixture(scope="module")
def study():
    """The three-pulley study, from few starts."""
    return dataclasses.replace(
        bj.optimize.load_study(EXAMPLES / "three_pulley_study.toml"), starts=4, method="slsqp"
    )


@pytest.fixture(scope="module")
def best(study):
    return bj.optimize.minimize(study)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["trust-constr", "ipopt"])
def test_other_optimizers_end_in_the_same_design(study, best, method):
    design = bj.optimize.minimize(dataclasses.replace(study, method=method))
    assert design.success
    assert design.final == pytest.approx(best.final, rel=1e-8)


def test_the_optimum_meets_its_conditions_and_planted_limits(study, best):
    assert best.optimality.residual < 1e-8
    # Both radii are planted: the ratio 2.5 of an 88.9 mm crankshaft, and the upper bound.
    assert best.values["pulley.accessory.radius"] == pytest.approx(0.0889 / 2.5, rel=1e-8)
    assert best.values["pulley.tensioner.radius"] == pytest.approx(0.06, rel=1e-8)
    assert set(best.bounds) == {"pulley.tensioner.radius upper"}
    assert best.optimality.curvature > 0
    assert sum(optimum.starts for optimum in best.optima) <= 4


@pytest.mark.parametrize("name", ["belt.bending_stiffness", "pulley.crankshaft.radius"])
def test_derivatives_of_the_optimum(study, best, name):
    found = bj.optimize.post_optimal(study, best, (name,))
    value = float(number_value(study.drive, study.point, name))
    h = 2e-3 * value

    def moved(value):
        drive, _ = with_number(study.drive, study.point, name, jnp.asarray(value, dtype=float))
        return bj.optimize.minimize(eqx.tree_at(lambda s: s.drive, study, drive))

    up, down = moved(value + h), moved(value - h)
    assert (up.final - down.final) / (2 * h) == pytest.approx(found.objective[0], rel=1e-4)
    slopes = [(up.values[k] - down.values[k]) / (2 * h) for k in best.values]
    np.testing.assert_allclose(slopes, found.variables[0], rtol=1e-4, atol=1e-7)


def test_a_search_stopped_in_the_middle_goes_on_as_if_it_had_not(study, best, tmp_path):
    path = tmp_path / "state.npz"

    def stop(stage, done, total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        bj.optimize.minimize(study, stop, checkpoint=path)
    began = []
    again = bj.optimize.minimize(study, lambda *a: began.append(a[1]), checkpoint=path)
    assert began == [0, 3, 4]  # not from the first start
    assert again.values == best.values
    np.testing.assert_array_equal(again.history.objective, best.history.objective)
    other = dataclasses.replace(study, seed=1)
    with pytest.raises(ValueError, match="is of another study"):
        bj.optimize.minimize(other, checkpoint=path)


def test_a_warm_start_comes_first(study, best):
    design = bj.optimize.minimize(study, warm=(best.values,))
    steps = np.sum(np.isfinite(design.history.objective), axis=0)
    assert steps[0] <= 3 < steps[1]
    assert design.starts[0].final == pytest.approx(best.final, rel=1e-9)


def test_no_time_is_a_result(study):
    design = bj.optimize.minimize(dataclasses.replace(study, time_limit=1e-9))
    assert design.result == bj.RESULTS.time_limit_reached


def test_limits_that_cannot_be_met_together_are_named(study):
    i = study.constraints.names.index("speed_ratio:accessory")
    limits = study.constraints
    impossible = eqx.tree_at(lambda c: c.lower, limits, limits.lower.at[i].set(4.5))
    design = bj.optimize.minimize(eqx.tree_at(lambda s: s.constraints, study, impossible))
    assert design.result == bj.RESULTS.constraints_infeasible
    # 88.9 mm over 4.5 is below the radius's lower bound of 22 mm.
    assert set(design.conflicts) == {
        "speed_ratio:accessory lower",
        "pulley.accessory.radius lower",
    }


@pytest.mark.slow
def test_openmdao_checks_the_derivatives_and_finds_the_design(study, best):
    component = importlib.import_module("beltjax.optimize.openmdao")
    variable_name = component.variable_name
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("drive", component.DriveComponent(study=study), promotes=["*"])
    limits = study.variables
    for name, low, high in zip(limits.names, limits.lower, limits.upper, strict=True):
        problem.model.add_design_var(variable_name(name), float(low), float(high))
    problem.model.add_objective("objective")
    for name, low in zip(study.constraints.names, study.constraints.lower, strict=True):
        problem.model.add_constraint(variable_name(name), lower=float(low))
    problem.driver = om.ScipyOptimizeDriver(optimizer="SLSQP", tol=1e-12, disp=False)
    problem.setup()
    problem.run_model()
    with pytest.warns(om.DerivativesWarning, match="zero derivatives"):  # a ratio of an angle
        checked = problem.check_partials(out_stream=None, form="central", step=1e-6)["drive"]
    for entry in checked.values():
        slope = np.asarray(entry["J_fwd"])
        assert np.max(np.abs(slope - entry["J_fd"])) <= 1e-6 * max(1.0, np.max(np.abs(slope)))
    problem.run_driver()
    assert problem.get_val("objective")[0] == pytest.approx(best.final, rel=1e-8)


@pytest.mark.slow
def test_a_front_is_made_of_optima_that_its_multipliers_lead_along():
    posed = bj.optimize.load_study(EXAMPLES / "three_pulley_pareto.toml")
    front = bj.optimize.pareto(dataclasses.replace(posed, method="slsqp", starts=4), points=8)
    assert front.success
    rows = np.array([point.objectives for point in front.points])
    assert len(rows) >= 7
    assert np.all(np.diff(rows[:, 0]) > 0)
    assert np.all(np.diff(rows[:, 1]) < 0)
    for objectives, point in zip(rows[1:-1], front.points[1:-1], strict=True):
        # The same problem as a study of its own, from its own starts.
        given = posed.constraints
        limits = bj.optimize.Limits(
            (*given.names, "hub_load:tensioner"),
            jnp.append(given.lower, -jnp.inf),
            jnp.append(given.upper, objectives[1]),
        )
        alone = dataclasses.replace(posed, constraints=limits, method="ipopt", starts=4)
        assert bj.optimize.minimize(alone).final == pytest.approx(objectives[0], rel=1e-6)
        assert point.residual < 1e-6


@pytest.mark.slow
def test_choices_are_each_the_best_of_their_own_study():
    posed = bj.optimize.load_study(EXAMPLES / "three_pulley_ribs.toml")
    late = bj.optimize.enumerated(dataclasses.replace(posed, time_limit=1e-9))
    assert all(one.design.result == bj.RESULTS.time_limit_reached for one in late)
    assert late[0].design.starts[0].result == "out of time"
    found = bj.optimize.enumerated(posed)
    assert [one.labels["belt"] for one in found] == ["3 ribs", "4 ribs", "6 ribs"]
    for one in found:
        drive = posed.drive
        for name, value in one.numbers.items():
            drive, _ = with_number(drive, posed.point, name, jnp.asarray(value, dtype=float))
        alone = dataclasses.replace(posed, drive=drive, choices=(), method="slsqp", starts=4)
        assert bj.optimize.minimize(alone).final == pytest.approx(one.design.final, rel=1e-8)


CROSSING = """schema = 1
name = "pressed belt"
listed = "counterclockwise"
[belt]
axial_stiffness = 1e5
bending_stiffness = 0.01
mass_per_length = 0.1
[[pulley]]
name = "left"
center = [0, 0]
radius = 0.05
face = "grooved"
driver = true
[[pulley]]
name = "right"
center = [0.4, 0]
radius = 0.05
face = "grooved"
[[pulley]]
name = "presser"
center = [0.2, 0.06]
radius = 0.02
face = "back"
[installation]
tension = 500
[operation]
belt_speed = 5
"""
PRESSED = """drive = "drive.toml"
objective.minimize = { path_length = -1.0 }
variable = [{ name = "pulley.presser.center.y", lower = -0.3, upper = 0.06 }]
optimizer = { method = "slsqp", starts = 8 }
"""


@pytest.mark.slow
def test_a_belt_that_crosses_itself_is_no_optimum(tmp_path):
    # Through the lower span, too, the presser lengthens the belt: but then that one crosses.
    (tmp_path / "drive.toml").write_text(CROSSING)
    (tmp_path / "study.toml").write_text(PRESSED)
    design = bj.optimize.minimize(bj.optimize.load_study(tmp_path / "study.toml"))
    assert design.success
    # Down to where the presser touches the lower span.
    assert design.values["pulley.presser.center.y"] == pytest.approx(-0.03, abs=1e-6)
