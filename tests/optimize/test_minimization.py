"""Studies of real drives: optima against SciPy, multipliers against moved limits, failures."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drives import EXAMPLES
from scipy.optimize import minimize as scipy_minimize

import beltjax as bj
from beltjax.compiling.quick import quickly_compiled

STUDIES = ["three_pulley_study", "seven_pulley_study"]
AGAINST_SLSQP = [STUDIES[0], pytest.param(STUDIES[1], marks=pytest.mark.slow)]


@pytest.fixture(scope="module")
def outcome():
    """Studies and their designs, each solved once."""
    solved = {}

    def get(name):
        if name not in solved:
            study = bj.optimize.load_study(EXAMPLES / f"{name}.toml")
            solved[name] = study, bj.optimize.minimize(study)
        return solved[name]

    return get


def problem(study):
    """Objective and limits of a study as SciPy takes them, with exact derivatives."""
    names, limits = study.variables.names, study.constraints

    def everything(x):
        drive = bj.optimize.with_values(study.drive, dict(zip(names, x, strict=True)))
        steady = bj.steady_state(drive, study.point, throw=False)
        answers = bj.optimize.DriveAnalyses(drive, study.point, steady)
        parts = [steady.coupling.sum()[None]]
        for name, low, high in zip(limits.names, limits.lower, limits.upper, strict=True):
            value = bj.optimize.find_quantity(name, drive).measure(answers)
            scale = jnp.maximum(1e-2, jnp.abs(jnp.where(jnp.isfinite(low), low, high)))
            parts += [(value - low) / scale, (high - value) / scale]
        return jnp.nan_to_num(jnp.concatenate(parts), posinf=1e3)

    return quickly_compiled(everything), quickly_compiled(jax.jacrev(everything))


@pytest.mark.parametrize("name", AGAINST_SLSQP)
def test_optimum_agrees_with_slsqp(name, outcome):
    study, design = outcome(name)
    assert design.success
    values, slopes = problem(study)
    lower, upper = np.asarray(study.variables.lower), np.asarray(study.variables.upper)
    size = upper - lower
    found = []
    for start in np.random.default_rng(1).uniform(0.2, 0.8, (4, len(size))):
        end = scipy_minimize(
            lambda u: float(values(lower + u * size)[0]),
            start,
            jac=lambda u: np.asarray(slopes(lower + u * size)[0]) * size,
            bounds=[(0, 1)] * len(size),
            constraints={
                "type": "ineq",
                "fun": lambda u: np.asarray(values(lower + u * size)[1:]),
                "jac": lambda u: np.asarray(slopes(lower + u * size)[1:]) * size,
            },
            method="SLSQP",
            options={"ftol": 1e-12, "maxiter": 200},
        )
        if end.success and np.min(values(lower + end.x * size)[1:]) > -1e-7:
            found.append((end.fun, *(lower + end.x * size)))
    best = min(found)
    assert design.final == pytest.approx(best[0], rel=1e-6)
    np.testing.assert_allclose(list(design.values.values()), best[1:], rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("name", AGAINST_SLSQP)
def test_reported_design_is_what_a_fresh_analysis_finds(name, outcome, tmp_path):
    study, design = outcome(name)
    bj.save_drive(tmp_path / "after.toml", design.drive, study.point)
    drive, point = bj.load_drive(tmp_path / "after.toml")
    assert float(bj.steady_state(drive, point).coupling.sum()) == pytest.approx(
        design.final, rel=1e-9
    )
    assert design.final < design.initial
    for c in design.constraints:
        assert c.lower is None or c.value >= c.lower - 1e-5 * max(1.0, abs(c.lower))
        assert c.upper is None or c.value <= c.upper + 1e-5 * max(1.0, abs(c.upper))
    assert len(design.starts) == study.starts
    assert sum(start.result == "optimal" for start in design.starts) >= 0.9 * study.starts


def test_multiplier_is_what_the_next_unit_of_a_limit_buys(outcome):
    study, design = outcome("three_pulley_study")
    i = study.constraints.names.index("speed_ratio:accessory")
    active = design.constraints[i]
    assert active.active
    h = 1e-3

    def moved(d):
        lower = study.constraints.lower.at[i].add(d)
        return bj.optimize.minimize(eqx.tree_at(lambda s: s.constraints.lower, study, lower)).final

    slope = (moved(h) - moved(-h)) / (2 * h)
    assert active.multiplier == pytest.approx(slope, rel=1e-3)
    inactive = [c for c in design.constraints if not c.active]
    assert all(abs(c.multiplier) < 1e-4 for c in inactive)


def test_infeasible_study_says_which_limit_is_missed_and_by_how_much(outcome):
    study, _ = outcome("three_pulley_study")
    # The smallest accessory pulley of 22 mm gives at most 88.9/22 = 4.0409.
    i = study.constraints.names.index("speed_ratio:accessory")
    lower = study.constraints.lower.at[i].set(4.5)
    design = bj.optimize.minimize(eqx.tree_at(lambda s: s.constraints.lower, study, lower))
    assert not design.success
    assert design.result == bj.RESULTS.constraints_infeasible
    missed = [c for c in design.constraints if c.violation]
    assert [c.quantity for c in missed] == ["speed_ratio:accessory"]
    assert missed[0].violation == pytest.approx(4.5 - 88.9 / 22, rel=1e-3)


def test_every_variable_and_quantity_changes_what_its_name_says():
    drive, point = bj.load_drive(EXAMPLES / "seven_pulley.toml")
    values = {name: bj.optimize.value_of(drive, name) for name in bj.optimize.variable_names(drive)}
    same = bj.optimize.with_values(drive, values)
    assert all(
        np.allclose(a, b, rtol=1e-14, atol=1e-16)
        for a, b in zip(jax.tree.leaves(drive), jax.tree.leaves(same), strict=True)
    )
    turned = bj.optimize.with_values(
        drive, {"tensioner.angle": jnp.pi / 2, "tensioner.arm_length": jnp.array(0.1)}
    )
    old, new = (np.asarray(bj.layout(d).arms[0]) for d in (drive, turned))
    np.testing.assert_allclose(new, 0.1 * np.array([-old[1], old[0]]) / np.hypot(*old), rtol=1e-12)

    steady = bj.steady_state(drive, point)
    answers = bj.optimize.DriveAnalyses(drive, point, steady)

    def measure(name):
        return np.asarray(bj.optimize.find_quantity(name, drive).measure(answers))

    # What turns the belt round, m v^2, does not reach the hub.
    pull = float(drive.belt.mass_per_length * point.speed(drive) ** 2)
    tight, slack = (float(steady.running_tensions[i]) - pull for i in (5, 4))
    wrap = float(steady.reference.layout.wraps[5])
    load = np.sqrt(tight**2 + slack**2 - 2 * tight * slack * np.cos(wrap))
    assert measure("hub_load:water pump")[0] == pytest.approx(load, rel=1e-12)
    assert measure("tension:idler-power steering")[0] == pytest.approx(
        float(steady.reference.tensions[3] + 350 * steady.tension_change), rel=1e-12
    )
    ratio = float(steady.effective_tensions[2] / steady.effective_tensions[1])
    margin = 0.5 * float(steady.reference.layout.wraps[2]) - abs(np.log(ratio))
    assert measure("slip_margin:alternator")[0] == pytest.approx(margin, rel=1e-12)
    assert measure("speed_ratio:alternator")[0] == pytest.approx(75 / 27, rel=1e-12)
    assert measure("clearance").shape == (21 + 35,)
