"""Studies under tolerances: a planted optimum, fresh drives, and what each file error says."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drives import EXAMPLES, example

import beltjax as bj
from beltjax.compiling.quick import quickly_compiled

HEAD = f'''drive = "{EXAMPLES / "three_pulley.toml"}"
objective.minimize = "speed_ratio:accessory"
[[variable]]
name = "pulley.accessory.radius"
lower = "22 mm"
upper = "45 mm"
[[constraint]]
quantity = "speed_ratio:accessory"
lower = 2.5
'''
TOLERANCE = '[[tolerance]]\nname = "pulley.crankshaft.radius"\ndeviation = "0.2 mm"\n'
CLOSE = 1e-8


def load(folder, text):
    path = folder / "study.toml"
    path.write_text(HEAD + text)
    return bj.optimize.load_study(path)


@pytest.mark.slow
@pytest.mark.parametrize("samples", [pytest.param(0, marks=pytest.mark.slow), 64])
def test_planted_optimum(samples, tmp_path):
    text = TOLERANCE + f"[robust]\nfactor = 2\nsamples = {samples}\n"
    text += '[optimizer]\nmethod = "slsqp"\nstarts = 2\n'
    study = load(tmp_path, text)
    design = bj.optimize.minimize(study)
    assert design.success
    # The ratio is linear in the radius that scatters; 64 points have a deviation of their own.
    drive, _ = example("three_pulley")
    driver, [kind] = float(drive.pulleys[0].radius), study.scatter.tolerances
    mean, deviation = driver, 2e-4
    if samples:
        points = bj.optimize.robust.distributions.sample_points(1, samples, 0)[:, 0]
        seen = driver + np.asarray(kind.at(points))
        mean, deviation = seen.mean(), seen.std(ddof=1)
        assert deviation == pytest.approx(2e-4, rel=0.05)
    radius = (mean - 2 * deviation) / 2.5
    assert design.values["pulley.accessory.radius"] == pytest.approx(radius, rel=CLOSE)
    assert design.final == pytest.approx((mean + 2 * deviation) / radius, rel=CLOSE)
    assert design.as_drawn == pytest.approx(driver / radius, rel=CLOSE)
    [limit] = [c for c in design.constraints if not c.implied]
    assert limit.active
    assert limit.value == pytest.approx(2.5, rel=CLOSE)
    assert limit.as_drawn == pytest.approx(driver / radius, rel=CLOSE)
    # d(objective)/d(limit): the ratio that counts above grows with the one that counts below.
    price = (mean + 2 * deviation) / (mean - 2 * deviation)
    assert limit.multiplier == pytest.approx(price, rel=1e-6)


@pytest.mark.slow
def test_a_quantile_holds_for_a_hundred_thousand_fresh_drives():
    study = bj.optimize.load_study(EXAMPLES / "three_pulley_robust_study.toml")
    kinds, names = study.scatter.tolerances, study.scatter.names
    counted = bj.optimize.Scatter(names, kinds, bj.optimize.WorstQuantile(0.95), 512)
    study = dataclasses.replace(study, scatter=counted, method="slsqp", starts=2)
    design = bj.optimize.minimize(study)
    assert design.success
    of = {constraint.quantity: constraint for constraint in design.constraints}
    ratio = of["speed_ratio:accessory"]
    assert ratio.active
    count, rng = 100_000, np.random.default_rng(5)
    nominal = np.array([bj.optimize.value_of(design.drive, name) for name in names])
    fresh = jnp.stack([kind.at(rng.uniform(size=count)) for kind in kinds], axis=1)
    asked = ("coupling", "tensioner_effectiveness", "speed_ratio:accessory")

    @quickly_compiled
    @jax.vmap
    def look(x):
        drive = bj.optimize.with_values(design.drive, dict(zip(names, x, strict=True)))
        answers = bj.optimize.DriveAnalyses(
            drive, study.point, bj.steady_state(drive, study.point, throw=False)
        )
        return jnp.concatenate(
            [bj.optimize.find_quantity(n, drive).measure(answers) for n in asked]
        )

    gamma, eta, turns = np.asarray(look(nominal + fresh)).T
    # 512 quasi-random points know a quantile of 5 % to some tenths of a percent.
    assert np.mean(gamma > design.final) == pytest.approx(0.05, abs=0.01)
    assert np.mean(turns < 2.5) == pytest.approx(0.05, abs=0.01)
    assert np.mean(eta < of["tensioner_effectiveness"].value) == pytest.approx(0.05, abs=0.01)


BAD = {
    "nothing scatters": ("[robust]\nfactor = 3\n", "robust: needs tolerances"),
    "no number": ('[[tolerance]]\nname = "ribs"\nwithin = 1\n', "tolerance.ribs: there is no"),
    "twice": (2 * TOLERANCE, "is given twice"),
    "no size": ('[[tolerance]]\nname = "belt.axial_stiffness"\n', "give one of within"),
    "two sizes": (TOLERANCE + "within = 1e-4\n", "give one of within"),
    "nothing": (TOLERANCE.replace("0.2", "0"), "must be positive"),
    "wrong unit": (TOLERANCE.replace("mm", "N"), "tolerance.pulley.crankshaft.radius.deviation"),
    "speed": (
        '[[tolerance]]\nname = "operation.belt_speed"\nwithin = 1\n',
        "is no part of the drive; use [[point]]",
    ),
    "both": (TOLERANCE + "[robust]\nfactor = 3\nquantile = 0.9\n", "robust: has factor and"),
    "too few": (TOLERANCE + "[robust]\nquantile = 0.99\nsamples = 64\n", "give 100 or more"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_tolerances_end_in_one_line(case, tmp_path):
    text, message = BAD[case]
    with pytest.raises(bj.FileError) as error:
        load(tmp_path, text)
    assert "\n" not in str(error.value)
    assert message in str(error.value)
