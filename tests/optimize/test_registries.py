"""Quantities and optimizers of a user: named in study files like those of beltjax itself."""

import jax.numpy as jnp
import numpy as np
import pytest
from bodies_cases import TWO_BELTS, load
from drives import EXAMPLES, example
from scipy.optimize import minimize

import beltjax as bj

STUDY = """
drive = "three_pulley.toml"
[objective]
minimize = "belt_mass"
[[variable]]
name = "pulley.accessory.radius"
lower = "22 mm"
upper = "45 mm"
[[constraint]]
quantity = "hub_power:accessory"
lower = "-1 kW"
[optimizer]
method = "cobyla"
starts = 2
"""
MINE = '''
import beltjax as bj


@bj.optimize.quantity("belt_mass", unit="kg")
def belt_mass(analyses):
    """Mass of the belt."""
    return analyses.drive.belt.mass_per_length * analyses.steady.reference.unstretched_length
'''


@pytest.fixture
def extended(own_registries):
    @bj.optimize.quantity("belt_mass", unit="kg")
    def belt_mass(analyses):
        """Mass of the belt."""
        return analyses.drive.belt.mass_per_length * analyses.steady.reference.unstretched_length

    @bj.optimize.quantity("hub_power", unit="W", place="pulley")
    def hub_power(analyses, pulley):
        """Power that one pulley takes from the belt."""
        tensions = analyses.steady.running_tensions
        return (tensions[pulley - 1] - tensions[pulley]) * analyses.point.speed(analyses.drive)

    @bj.optimize.optimizer("cobyla")
    class Cobyla(bj.optimize.AbstractLocalOptimizer):
        """SciPy's COBYLA, without derivatives."""

        def minimize(self, problem, x):
            limits = {"type": "ineq", "fun": lambda x: -problem.constraints(x)}
            found = minimize(
                problem.objective, x, method="COBYLA", bounds=[(0, 1)] * len(x),
                constraints=limits, callback=problem.record_or_stop, tol=1e-8,
            )  # fmt: skip
            return bj.optimize.Ending(np.clip(found.x, 0, 1), bool(found.success), found.message)


def study_file(folder, text=STUDY):
    (folder / "three_pulley.toml").write_text((EXAMPLES / "three_pulley.toml").read_text())
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


@pytest.mark.slow
def test_a_study_file_names_them(extended, tmp_path):
    design = bj.optimize.minimize(bj.optimize.load_study(study_file(tmp_path)))
    assert design.success
    drive, point = design.drive, bj.load_drive(tmp_path / "three_pulley.toml")[1]
    length = bj.reference_state(drive, point).unstretched_length
    assert design.final == pytest.approx(float(drive.belt.mass_per_length * length), rel=1e-12)
    assert design.constraints[0].unit == "W"
    # A search over all starts at once ends in the same design.
    text = STUDY.replace("cobyla", "augmented-lagrangian")
    other = bj.optimize.minimize(bj.optimize.load_study(study_file(tmp_path, text)))
    assert other.final == pytest.approx(design.final, rel=1e-8)


@pytest.mark.slow
def test_explorations_and_tolerances_take_them(extended, tmp_path):
    drive, point = example("three_pulley")
    tolerances = {"belt.mass_per_length": bj.optimize.Uniform(0.01)}
    found = bj.optimize.robustness(drive, point, ["belt_mass"], tolerances, samples=16)
    spread = found.spreads["belt_mass"]
    assert spread.unit == "kg"
    ratio = spread.linear_deviation / spread.nominal
    assert ratio == pytest.approx(0.01 / np.sqrt(3) / float(drive.belt.mass_per_length), rel=1e-9)
    grid = bj.optimize.Grid({"belt.mass_per_length": jnp.array([0.05, 0.1])})
    data = bj.optimize.explore(drive, point, grid, ["belt_mass"], tmp_path / "store.zarr")
    first, second = data["belt_mass"].values
    assert second == pytest.approx(2 * first, rel=1e-3)


def test_the_message_for_a_misspelt_name_lists_them(extended, tmp_path):
    with pytest.raises(bj.FileError, match=r"no quantity 'belt_mas'; did you mean 'belt_mass'\?"):
        bj.optimize.load_study(study_file(tmp_path, STUDY.replace("belt_mass", "belt_mas")))
    with pytest.raises(bj.FileError, match=r"optimizer\.method: found 'x'; give one of .*'cobyla'"):
        bj.optimize.load_study(study_file(tmp_path, STUDY.replace("cobyla", "x")))


@pytest.mark.parametrize(
    ("name", "options", "says"),
    [
        ("coupling", {}, "there is a quantity 'coupling' already"),
        ("a:b", {}, "give one without ':'"),
        ("a", {"place": "belt"}, "found place 'belt'"),
        ("a", {"needs": "mass"}, "needs 'mass'"),
    ],
)
def test_what_cannot_be_registered_is_said(name, options, says):
    with pytest.raises(ValueError, match=says):
        bj.optimize.quantity(name, **options)


def test_an_optimizer_s_name_is_taken_once():
    with pytest.raises(ValueError, match="'slsqp'; give one that is not taken"):
        bj.optimize.optimizer("slsqp")


@pytest.mark.slow
def test_the_command_line_runs_a_file_first(own_registries, run, tmp_path):
    (tmp_path / "mine.py").write_text(MINE)
    status, out, err = run("--extend", "mine.py", "robust", "--quantities")
    assert (status, err) == (0, "")
    assert "Mass of the belt" in out
    text = STUDY.replace("cobyla", "slsqp")
    text = text.replace('"hub_power:accessory"\nlower = "-1 kW"', '"wraps"\nlower = 0.1')
    # The file is run once in a process: what it registered is still there.
    status, out, err = run("optimize", study_file(tmp_path, text))
    assert (status, err) == (0, ""), err
    status, out, err = run("optimize", "--methods")
    assert "slsqp" in out
    (tmp_path / "bad.py").write_text("1 / 0")
    status, out, err = run("--extend", "bad.py", "analyze", "x.toml")
    assert (status, out) == (1, "")
    assert err == "beltjax: bad.py: cannot be run (ZeroDivisionError: division by zero)\n"


def test_effectiveness_is_a_quantity_of_any_tensioners_on_one_belt(tmp_path):
    study = bj.optimize.load_study(EXAMPLES / "seven_pulley_two_arms_study.toml")
    assert len(study.drive.tensioners) == 2
    drive, _ = load(tmp_path, TWO_BELTS)
    with pytest.raises(KeyError, match="a number of a drive with one belt"):
        bj.optimize.find_quantity("tensioner_effectiveness", drive)
