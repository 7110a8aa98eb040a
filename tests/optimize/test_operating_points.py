"""Studies over several operating points, frequencies and forced vibration: what is measured."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drives import EXAMPLES

import beltjax as bj
from beltjax.compiling.quick import quickly_compiled

problem = bj.optimize.problem

HEAD = """
drive = "three_pulley.toml"
[objective]
minimize = "coupling"
[[variable]]
name = "pulley.accessory.radius"
lower = "22 mm"
upper = "45 mm"
"""
POINTS = """
[[point]]
name = "idle"
belt_speed = 5
[[point]]
name = "fast"
belt_speed = { from = 20, to = 40, points = 3 }
torque = { accessory = 4 }
"""


def load(tmp_path, text, more=""):
    """The study of that text, beside the three-pulley drive, to whose file `more` is added."""
    drive = (EXAMPLES / "three_pulley.toml").read_text() + more
    (tmp_path / "three_pulley.toml").write_text(drive)
    path = tmp_path / "study.toml"
    path.write_text(text)
    return bj.optimize.load_study(path)


def limit(quantity, side="lower = 0"):
    return f'[[constraint]]\nquantity = "{quantity}"\n{side}\n'


def test_every_point_counts_and_a_named_one_alone(tmp_path):
    names = ["coupling", "coupling@idle", "hub_load:accessory@fast", "frequency:1@idle"]
    names += ["order_margin:2@idle"]
    study = load(tmp_path, HEAD + POINTS + "".join(map(limit, names)))
    assert study.cases.names == ("idle", "fast", "fast", "fast")
    found = jax.jit(lambda d: problem.measured(study, d))(study.drive)
    values = dict(zip(names, map(np.asarray, found.greatest), strict=True))
    assert [len(values[name]) for name in names[:4]] == [4, 1, 3, 1]

    torque = {"accessory": 4.0}
    points = [bj.OperatingPoint(belt_speed=5.0)]
    points += [bj.OperatingPoint(belt_speed=v, torque=torque) for v in (20.0, 30.0, 40.0)]
    steady = [bj.steady_state(study.drive, point) for point in points]
    totals = [float(one.coupling.sum()) for one in steady]
    np.testing.assert_allclose(values["coupling"], totals, rtol=1e-10)
    assert float(found.worst) == pytest.approx(max(totals), rel=1e-12)
    assert max(totals) < float(found.objective) < max(totals) * (1 + np.log(4) / study.sharpness)

    # A second route to the lowest frequency: exact, against a basis good to 0.1 %.
    lowest = bj.modes(bj.linearize(steady[0], bj.Sine(8)), 2, exact=True).frequencies
    assert values["frequency:1@idle"][0] == pytest.approx(float(lowest[0]), rel=1e-3)
    speed = 5.0 / float(study.drive.pulleys[0].radius)
    margin = abs(float(lowest[1]) / (2 * speed) - 1)
    assert values["order_margin:2@idle"][1] == pytest.approx(margin, abs=1e-3 * (1 + margin))


def test_soft_maximum_is_close_from_above_and_smooth():
    values = jnp.array([1.0, 0.99, -3.0])
    size = float(jnp.sqrt(jnp.mean(values**2)))
    for sharpness in (10.0, 100.0, 1000.0):
        excess = float(problem.soft_maximum(values, sharpness)) - 1.0
        assert 0 < excess <= size * np.log(3) / sharpness
    assert float(jax.grad(lambda v: problem.soft_maximum(v, 50.0))(values).sum()) > 0.9
    assert float(problem.soft_maximum(jnp.array([2.5]), 50.0)) == 2.5


def test_forced_vibration_needs_an_excitation(tmp_path):
    with pytest.raises(bj.FileError, match=r"needs \[excitation\]"):
        load(tmp_path, HEAD + limit("span_amplitude:crankshaft-tensioner", "upper = 1e-3"))


def test_a_point_may_have_its_own_irregularity(tmp_path):
    points = POINTS.replace("belt_speed = 5", 'belt_speed = 5\ncrank = "1 deg"')
    shaken = '[excitation]\ncrank = "0.1 deg"\norder = 2\n'
    excitation = load(tmp_path, HEAD + points, shaken).cases.points.excitation
    np.testing.assert_allclose(np.degrees(excitation.crank), [1.0, 0.1, 0.1, 0.1], rtol=1e-12)
    np.testing.assert_allclose(excitation.order, 2.0)
    with pytest.raises(bj.FileError, match=r"point\.idle\.crank: goes with a table \[excitation\]"):
        load(tmp_path, HEAD + points)
    with pytest.raises(bj.FileError, match=r"point\.idle\.crank: found -1; must not be negative"):
        load(tmp_path, HEAD + points.replace('"1 deg"', "-1"), shaken)


SHAKEN = """
[excitation]
orders = [{ order = 2, crank = "0.1 deg" }, { order = 4, crank = "0.02 deg" }]
"""


@pytest.mark.slow
def test_periodic_motion_is_measured_and_has_slopes(tmp_path):
    span = "accessory-crankshaft"
    names = ["arm_travel", f"tension_min:{span}", f"tension_max:{span}", "rotation:accessory"]
    names += [f"span_deflection:{span}", "hub_load_max:tensioner", "friction_use:accessory"]
    names += ["tension_min"]
    study = load(tmp_path, HEAD + "".join(map(limit, names)), SHAKEN)
    assert np.ndim(study.point.excitation.orders[0].crank) == 0

    def all_of(drive):
        return jnp.concatenate([jnp.ravel(x) for x in problem.measured(study, drive).greatest])

    both = quickly_compiled(lambda d: (all_of(d), jax.jacrev(all_of)(d)))
    values, slopes = both(study.drive)
    found = bj.periodic_response(
        study.drive, study.point, damping=bj.Damping(modal=0.02), functions=12, harmonics=8
    )
    m = found.measures
    expected = [
        m.travels[0], m.tension_min[2], m.tension_max[2], m.rotation_amplitudes[2],
        m.span_peaks[2], m.hub_load_max[1], 0.0, *m.tension_min,
    ]  # fmt: skip
    np.testing.assert_allclose(values, expected, rtol=1e-8)
    by_spring = np.asarray(slopes.tensioner.stiffness)
    assert np.all(np.isfinite(by_spring))
    assert np.count_nonzero(by_spring) == 9


def test_a_design_is_where_its_values_say(tmp_path):
    study = load(tmp_path, HEAD)
    x = problem.in_box(study, {"pulley.accessory.radius": 0.0335})
    np.testing.assert_allclose(x, [0.5])
    assert float(problem.drive_at(study, jnp.asarray(x)).pulleys[2].radius) == pytest.approx(0.0335)
    assert problem.own_values(study) == {"pulley.accessory.radius": 0.02697}


LOADED = """
[[point]]
name = "as the drive"
belt_speed = 10
[[point]]
name = "by torque"
belt_speed = 10
torque = { accessory = 1.5 }
"""


def test_the_torque_of_a_point_takes_the_place_of_its_pulleys_load(tmp_path):
    text = (EXAMPLES / "three_pulley.toml").read_text()
    text = text[: text.index("[operation.torque]")] + "[operation.load.accessory]\npower = 600\n"
    (tmp_path / "three_pulley.toml").write_text(text)
    (tmp_path / "study.toml").write_text(HEAD + LOADED)
    study = bj.optimize.load_study(tmp_path / "study.toml")
    torques = jax.vmap(lambda point: point.torques(study.drive))(study.cases.points)
    np.testing.assert_allclose(torques[:, 2], [600 * 0.02697 / 10, 1.5], rtol=1e-15)


BAD = {
    "unknown point": (limit("coupling@top"), "no operating point 'top'; there are idle, fast"),
    "no such mode": (limit("frequency:9"), "no mode '9'; give one of 1 to 8"),
    "no order": (limit("order_margin:two"), "'two' is no order"),
    "same name": ('[[point]]\nname = "idle"\n', "point.idle: needs a name of its own"),
    "two speeds": (
        '[[point]]\nname = "a"\nbelt_speed = 1\ndriver_speed = 2\n',
        "has belt_speed and driver_speed",
    ),
    "mixed speeds": ('[[point]]\nname = "a"\ndriver_speed = "600 rpm"\n', "some give belt_speed"),
    "backwards": (
        '[[point]]\nname = "a"\nbelt_speed = { from = 9, to = 3, points = 2 }\n',
        "from low to high",
    ),
    "no pulley": ('[[point]]\nname = "a"\ntorque = { pump = 3 }\n', "there is no pulley 'pump'"),
    "driver": ('[[point]]\nname = "a"\ntorque = { crankshaft = 3 }\n', "balances the others"),
    "wrong unit": ('[[point]]\nname = "a"\nbelt_speed = "3 kg"\n', "point.a.belt_speed"),
    "no time": ('[optimizer]\ntime_limit = "0 s"\n', "optimizer.time_limit"),
    "unknown choice": (
        '[[choice]]\nname = "b"\n[[choice.option]]\n"belt.ribs" = 3\n',
        "choice.b: there is no number 'belt.ribs'",
    ),
    "empty choice": (
        '[[choice]]\nname = "b"\n[[choice.option]]\nlabel = "x"\n',
        "option 1 has no numbers",
    ),
    "one objective": ('[pareto]\nobjectives = ["coupling"]\n', "pareto.objectives"),
    "many numbers": ('[pareto]\nobjectives = ["coupling", "wraps"]\n', "'wraps' is many numbers"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_studies_end_in_one_line(case, tmp_path):
    text, message = BAD[case]
    with pytest.raises(bj.FileError) as error:
        load(tmp_path, HEAD + POINTS + text)
    assert "\n" not in str(error.value)
    assert message in str(error.value)
