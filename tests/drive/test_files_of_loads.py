"""Loads as power and over speed, against statics by hand, and what a file may not say of them."""

import math
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies_cases import TWO_BELTS, load, swap
from compilations import compilations
from drives import EXAMPLES, example
from scipy.interpolate import PchipInterpolator

import beltjax as bj
from beltjax.drive.files import drive_content
from beltjax.drive.numbers import named_numbers, number_value, require_number, with_number
from beltjax.results import successes

THREE = (EXAMPLES / "three_pulley.toml").read_text()
TORQUE = THREE[THREE.index("[operation.torque]") :]
POWER = '[operation.load.accessory]\npower = "2 kW"\n'
TABLE = """[operation.load.accessory]
speed = ["3000 rpm", "6000 rpm", "9000 rpm", "15000 rpm"]
power = ["0.5 kW", "1.6 kW", "2.4 kW", "2.6 kW"]
drag = "0.05 N m"
"""
RADIUS, SPEED = 0.02697, 20.0
TURNS = SPEED / RADIUS  # rad/s, 7081 rpm


def with_load(text):
    """The three-pulley file with these tables in place of its torque."""
    return swap(THREE, TORQUE, text)


def table_torque(turns):
    """Torque of TABLE at a speed [rad/s], by SciPy."""
    speeds = np.array([3000, 6000, 9000, 15000]) * math.pi / 30
    power = PchipInterpolator(speeds, [500.0, 1600.0, 2400.0, 2600.0])
    return float(power(turns)) / turns + 0.05


def test_power_is_torque_times_speed(tmp_path):
    """The belt steps up by P/v over the accessory, at rest as well as running."""
    drive, point = load(tmp_path, with_load(POWER))
    torque = point.torques(drive)
    assert float(torque[2]) == pytest.approx(2000.0 * RADIUS / SPEED, rel=1e-15)
    assert float(torque[0]) == pytest.approx(-2000.0 * 0.0889 / SPEED, rel=1e-15)
    steady = bj.steady_state(drive, point)
    step = np.diff(np.asarray(steady.running_tensions))[1]
    assert abs(float(step)) == pytest.approx(2000.0 / SPEED, rel=1e-12)


def test_a_table_is_of_the_pulleys_own_speed(tmp_path):
    drive, point = load(tmp_path, with_load(TABLE))
    assert float(point.torques(drive)[2]) == pytest.approx(table_torque(TURNS), rel=1e-14)
    # In the other sense it takes the same.
    other = bj.OperatingPoint(belt_speed=SPEED, load=point.load, travel="opposite")
    assert float(other.torques(drive)[2]) == pytest.approx(table_torque(TURNS), rel=1e-14)
    # By the driver's speed, whose ratio to the accessory is that of the radii.
    driven = bj.OperatingPoint(driver_speed=200.0, load=point.load)
    turns = 200.0 * 0.0889 / RADIUS
    assert float(driven.torques(drive)[2]) == pytest.approx(table_torque(turns), rel=1e-14)


def test_a_torque_table_and_a_drag_on_the_tensioner(tmp_path):
    text = "[operation.load.accessory]\nspeed = [100, 900]\ntorque = [1, 3]\n"
    text += '[operation.load.tensioner]\ndrag = "0.04 N m"\n'
    drive, point = load(tmp_path, with_load(text))
    linear = 1 + 2 * (TURNS - 100) / 800
    np.testing.assert_allclose(point.torques(drive)[1:], [0.04, linear], rtol=1e-14)
    same = bj.OperatingPoint(belt_speed=SPEED, torque={"tensioner": 0.04, "accessory": linear})
    one, two = (bj.steady_state(drive, p).running_tensions for p in (point, same))
    np.testing.assert_allclose(one, two, rtol=1e-13)


def test_a_load_alone_and_its_torque_are_one_drive(tmp_path):
    """The states of a load are those of the torque that it comes to, and so is contact's power."""
    drive, point = load(tmp_path, with_load(TABLE))
    same = bj.OperatingPoint(belt_speed=SPEED, torque={"accessory": table_torque(TURNS)})
    one, two = (bj.steady_state(drive, p) for p in (point, same))
    np.testing.assert_allclose(one.running_tensions, two.running_tensions, rtol=1e-13)
    np.testing.assert_allclose(one.coupling, two.coupling, rtol=1e-10)


def test_a_load_on_another_belt_turns_with_its_own_pulley(tmp_path):
    """The second belt runs with the crankshaft's other pulley, 60 to 75 mm; the fan has 45 mm."""
    drive, _ = load(tmp_path, TWO_BELTS)
    loaded = bj.OperatingPoint(belt_speed=15.0, load={"fan": bj.Load(power=400.0)})
    torques = dict(zip(drive.pulley_names, np.asarray(loaded.torques(drive)), strict=True))
    turns = 15.0 / 0.075 * 0.060 / 0.045
    assert torques["fan"] == pytest.approx(400.0 / turns, rel=1e-14)
    # The crankshaft gives its second belt what that belt's pulleys take: the same power.
    assert torques["crank2"] * 15.0 / 0.075 == pytest.approx(-400.0, rel=1e-14)


@pytest.mark.slow
def test_contact_takes_the_torque_of_a_load():
    """The driven pulley turns with the belt, but for what the belt stretches: P/omega at rest."""
    drive, _ = example("two_pulley_table_5_1")
    speed, radius = 10.0, float(drive.pulleys[1].radius)
    name = drive.pulley_names[1]
    loaded = bj.OperatingPoint(belt_speed=speed, load={name: bj.Load(power=20.0)})
    same = bj.OperatingPoint(belt_speed=speed, torque={name: 20.0 * radius / speed})
    one, two = (bj.contact_state(drive, point) for point in (loaded, same))
    np.testing.assert_allclose(one.moments, two.moments, rtol=1e-13)
    assert abs(float(one.moments[1])) == pytest.approx(20.0 * radius / speed, rel=1e-12)


@pytest.mark.slow
def test_derivatives_are_total(tmp_path):
    """By speed, radius and the numbers of the table: the torque follows each of them."""
    drive, point = load(tmp_path, with_load(TABLE))

    def tension(drive, point):
        return bj.steady_state(drive, point).running_tensions[2]

    of_drive, of_point = jax.grad(tension, (0, 1))(drive, point)
    got = named_numbers(of_drive, of_point, (drive, of_point))

    def by_difference(name, size):
        value = number_value(drive, point, name)
        above, below = (
            tension(*with_number(drive, point, name, value + s * size)) for s in (1, -1)
        )
        return (above - below) / (2 * size)

    for name, size in (
        ("operation.belt_speed", 1e-4),
        ("pulley.accessory.radius", 1e-7),
        ("operation.load.accessory.drag", 1e-4),
    ):
        found = float(got[name])
        assert found == pytest.approx(float(by_difference(name, size)), rel=1e-6), name
    # The table is exact where its numbers all grow alike: the torque of the table grows as they do.
    power = point.load["accessory"].power
    by_torque = float(got["operation.load.accessory.drag"])
    whole = float(got["operation.load.accessory.power"] @ power)
    assert whole == pytest.approx(by_torque * (table_torque(TURNS) - 0.05), rel=1e-10)


def test_loads_follow_the_speed_of_a_sweep(tmp_path):
    drive, point = load(tmp_path, with_load(TABLE))
    speeds = np.array([12.0, 20.0, 30.0])
    batch = jax.vmap(
        lambda v: with_number(drive, point, "operation.belt_speed", v)[1].torques(drive)
    )
    expected = [table_torque(v / RADIUS) for v in speeds]
    np.testing.assert_allclose(batch(speeds)[:, 2], expected, rtol=1e-13)


def test_outside_of_its_table_the_end_is_held_and_warned_of(tmp_path):
    stiff = swap(with_load(TABLE), "bending_stiffness = 0.015", "bending_stiffness = 1e-4")
    drive, point = load(tmp_path, swap(stiff, "belt_speed = 20.0", "belt_speed = 5.0"))
    slowest = 3000 * math.pi / 30
    assert float(point.torques(drive)[2]) == pytest.approx(500 / slowest + 0.05, rel=1e-14)
    found = bj.steady_state(drive, point)
    assert found.result == bj.RESULTS.successful
    assert found.warning == bj.RESULTS.load_outside_table
    inside = bj.OperatingPoint(belt_speed=20.0, load=point.load)
    assert bj.steady_state(drive, inside).warning == bj.RESULTS.successful


@pytest.mark.slow
def test_power_at_standstill_is_a_failure_of_its_lane(tmp_path):
    drive, point = load(tmp_path, with_load(POWER))

    def state(speed):
        return bj.steady_state(
            *with_number(drive, point, "operation.belt_speed", speed), throw=False
        )

    found = jax.vmap(state)(jnp.array([0.0, 20.0]))
    assert successes(found.result).tolist() == [False, True]
    assert state(0.0).result == bj.RESULTS.numbers_unusable
    alone = bj.steady_state(drive, point)
    np.testing.assert_allclose(found.running_tensions[1], alone.running_tensions, rtol=1e-13)
    assert all(bool(jnp.isfinite(x).all()) for x in jax.tree.leaves(found.running_tensions))
    slope = jax.grad(lambda v: state(v).running_tensions.sum())(jnp.array(0.0))
    assert float(slope) == 0.0


def test_a_table_may_begin_at_standstill():
    """Power over speed tends to the slope of the power: 2 W per rad/s here."""
    begun = bj.Load(power=[0.0, 20.0, 40.0], speed=[0.0, 10.0, 20.0])
    assert float(begun.at(jnp.array(0.0)).torque) == 2.0
    assert float(begun.at(jnp.array(1e-9)).torque) == pytest.approx(2.0, rel=1e-14)


@pytest.mark.parametrize("text", [POWER, TABLE], ids=["power", "table"])
def test_round_trip(tmp_path, text):
    drive, point = load(tmp_path, with_load(text))
    bj.save_drive(tmp_path / "copy.toml", drive, point)
    again = bj.load_drive(tmp_path / "copy.toml")
    assert jax.tree.structure(again) == jax.tree.structure((drive, point))
    assert jax.tree.all(jax.tree.map(lambda a, b: bool((a == b).all()), (drive, point), again))
    assert drive_content(*again) == drive_content(drive, point)


def test_a_load_prints_its_numbers_and_keeps_its_units(tmp_path):
    drive, point = load(tmp_path, with_load(TABLE))
    assert "load accessory  power (500, 1600, 2400, 2600) W, speed (314.159, " in repr(point)
    assert drive.units["operation.load.accessory.power"] == "kW"
    assert drive.units["operation.load.accessory.speed"] == "rpm"


def test_a_sweep_may_set_power_and_drag():
    drive, point = example("three_pulley")
    require_number(drive, "operation.load.accessory.power")
    _, other = with_number(drive, point, "operation.load.accessory.power", jnp.array(500.0))
    assert float(other.torques(drive)[2]) == pytest.approx(500 * RADIUS / SPEED, rel=1e-15)
    with pytest.raises(ValueError, match=r"no number 'operation\.load\.crankshaft\.power'"):
        require_number(drive, "operation.load.crankshaft.power")


def test_new_numbers_of_a_load_compile_nothing(tmp_path):
    drive, point = load(tmp_path, with_load(TABLE))
    bj.steady_state(drive, point)
    of = bj.Load(power=[400.0, 900, 1800, 2000], speed=[100, 500, 900, 2000], drag=1)
    with compilations() as count:
        bj.steady_state(drive, bj.OperatingPoint(belt_speed=11, load={"accessory": of}))
    assert count == [0]


WRONG = {
    "power of a torque": ("[operation.torque]\naccessory = '2 kW'\n", r"operation\.torque\.accessory: found '2 kW', whose unit is not N m; that is a power; what a pulley takes is power in \[operation\.load\.NAME\]"),
    "torque of a power": ("[operation.load.accessory]\npower = '2 N m'\n", r"operation\.load\.accessory\.power: found '2 N m', whose unit is not W; that is a torque; what holds at any speed is operation\.torque\.NAME"),
    "power of the drive": ("power = 3\n", r"operation\.power: is not a key of this table; give it in \[operation\.load\.NAME\]"),
    "hertz": ("[operation.load.accessory]\npower = [1, 2]\nspeed = ['10 rpm', '9 Hz']\n", r"load\.accessory\.speed: item 2: found '9 Hz', whose unit is no angle; for that many turns write \"540 rpm\""),
    "no speed": ("[operation.load.accessory]\npower = [1, 2]\n", r"load\.accessory\.power: is a list without speed"),
    "torque without speed": ("[operation.load.accessory]\ntorque = 2\n", r"load\.accessory\.torque: goes with a list speed; a torque for any speed is operation\.torque\.NAME"),
    "lengths": ("[operation.load.accessory]\npower = [1, 2, 3]\nspeed = [1, 2]\n", r"load\.accessory\.power: found 3 for 2 speeds; give one for each"),
    "falling": ("[operation.load.accessory]\npower = [1, 2]\nspeed = [2, 1]\n", r"load\.accessory\.speed: must increase"),
    "one speed": ("[operation.load.accessory]\npower = [1]\nspeed = [2]\n", r"load\.accessory\.speed: a table has at least two speeds; give more, or, for any speed, power alone, or operation\.torque\.NAME"),
    "speeds alone": ("[operation.load.accessory]\nspeed = [1, 2]\n", r"load\.accessory\.speed: is given without power or torque"),
    "both": ("[operation.load.accessory]\nspeed = [1, 2]\npower = [1, 2]\ntorque = [1, 2]\n", r"load\.accessory\.power: is given beside torque; give one of them"),
    "empty": ("[operation.load.accessory]\n", r"load\.accessory\.power: is missing"),
    "power at zero": ("[operation.load.accessory]\nspeed = [0, 2]\npower = [1, 2]\n", r"load\.accessory\.power: is not 0 at speed 0"),
    "no pulley": ("[operation.load.pump]\npower = 1\n", r"operation\.load\.pump: there is no pulley 'pump'; give one of crankshaft"),
    "driver": ("[operation.load.crankshaft]\npower = 1\n", r"operation\.load\.crankshaft: the driver balances"),
    "twice": ("[operation.torque]\naccessory = 1\n" + POWER, r"operation\.load\.accessory: stands beside torque\.accessory; remove one of them"),
    "no name": ("[operation.load]\npower = 1\n", r"operation\.load: found a table of 1 without a pulley's name; write \[operation\.load\.NAME\]"),
    "top level": (POWER + "[load.accessory]\npower = 1\n", r"load: is not a key of this table; it belongs in \[\[duty\]\] or \[operation\]"),
    "rpm": ("[operation.load.accessory]\nrpm = [1, 2]\npower = [1, 2]\n", r'load\.accessory\.rpm: is not a known key; .*speed = \["\.\.\. rpm", \.\.\.\] of a load'),
    "unknown": ("[operation.load.accessory]\npowr = 1\n", r"operation\.load\.accessory\.powr: is not a known key; did you mean 'power'"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_what_a_file_may_not_say_is_one_line(case, tmp_path):
    text, says = WRONG[case]
    with pytest.raises(bj.FileError) as error:
        load(tmp_path, with_load(text))
    assert "\n" not in str(error.value)
    assert re.search(says, str(error.value))


def test_power_needs_a_drive_that_turns(tmp_path):
    still = swap(with_load(POWER), "belt_speed = 20.0", "belt_speed = 0")
    with pytest.raises(
        bj.FileError,
        match=r"load\.accessory\.power: nothing turns, since belt_speed is 0; give operation\.torque\.accessory",
    ):
        load(tmp_path, still)


def test_loads_that_do_not_go_together_are_refused():
    with pytest.raises(ValueError, match=r"Load\.speed: must increase"):
        bj.Load(power=[1.0, 2.0], speed=[2.0, 2.0])
    drive, _ = example("three_pulley")
    point = bj.OperatingPoint(belt_speed=1.0, load={"pump": bj.Load(power=1.0)})
    with pytest.raises(KeyError, match="no pulley 'pump'"):
        point.torques(drive)
