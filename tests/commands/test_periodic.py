"""`beltjax periodic`: its document, its statuses, and one line for what is wrong."""

import json
import re

import equinox as eqx
import numpy as np
import pytest
from drives import EXAMPLES

import beltjax as bj

DRIVE = EXAMPLES / "three_pulley.toml"
THREE = DRIVE.read_text()
PNG = b"\x89PNG\r\n\x1a\n"
SMALL = "--functions", 2, "--harmonics", 4


@pytest.mark.slow
def test_document_is_that_of_periodic_response(run, tmp_path):
    words = "--speeds", "2000 rpm", "--crank", "0.1 deg", "--order", 2, "--modal-damping", 0.03
    status, out, err = run(
        "periodic", DRIVE, *words, *SMALL, "--json", "p.json", "--figure", "p.png"
    )
    assert (status, err) == (0, "")
    assert re.search(r"stable: the largest Floquet multiplier is 0\.\d{4}", out)
    document = json.loads((tmp_path / "p.json").read_text())
    (part,) = document["periodic"]
    drive, _ = bj.load_drive(DRIVE)
    found = bj.periodic_response(
        drive,
        bj.OperatingPoint(driver_speed=2000 * np.pi / 30),
        bj.Orders({2: bj.Excitation(np.radians(0.1))}),
        damping=bj.Damping(modal=0.03),
        functions=2,
        harmonics=4,
    )
    m = found.measures
    for key, rows, values in (
        ("rotation_amplitude", part["pulleys"], m.rotation_amplitudes),
        ("hub_load_max", part["pulleys"], m.hub_load_max),
        ("tension_min", part["spans"], m.tension_min),
        ("peak_deflection", part["spans"], m.span_peaks),
        ("peak_to_peak", part["coordinates"], m.travels),
        ("mean", part["coordinates"], m.mean_motions),
    ):
        np.testing.assert_allclose([row[key] for row in rows], values, rtol=1e-9)
    np.testing.assert_allclose(
        np.array(part["multipliers"])[:, 0], np.asarray(found.multipliers).real, atol=1e-9
    )
    assert part["period"] == pytest.approx(30 / 2000)
    assert part["pulleys"][0]["friction_use_max"] is None
    assert part["success"]
    assert part["feasible"]
    # In proportion to the excitation: 0.706 N m by 0.1 degrees, of the converged drive.
    assert part["coordinates"][0]["lock_torque"] == pytest.approx(0.706, rel=0.02)
    # Slopes against the motion solved again by numbers next to the file's.
    slopes = document["sensitivities"]
    stiffness, h = float(drive.tensioner.stiffness), 1e-4

    def at(part):
        moved = eqx.tree_at(lambda d: d.tensioner.stiffness, drive, stiffness * (1 + part * h))
        point = bj.OperatingPoint(driver_speed=2000 * np.pi / 30)
        orders = bj.Orders({2: bj.Excitation(np.radians(0.1))})
        found = bj.periodic_response(
            moved, point, orders, damping=bj.Damping(modal=0.03), functions=2, harmonics=4
        ).measures
        return np.array([found.travels[0], found.tension_min[1]])

    difference = (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * h * stiffness)
    names = "travel:tensioner", "tension_min:tensioner-accessory"
    found = [slopes[name]["tensioner.stiffness"] for name in names]
    np.testing.assert_allclose(found, difference, rtol=1e-6)
    assert set(slopes["travel:tensioner"]) >= {"belt.bending_stiffness", "pulley.accessory.radius"}
    assert (tmp_path / "p.png").read_bytes().startswith(PNG)


def test_orders_of_the_file_are_those_of_the_command(run, tmp_path):
    table = (
        '\n[excitation]\norders = [{ order = 2, crank = "0.1 deg" }, '
        '{ order = 4, crank = "0.05 deg", phase = "1 rad" }]\n'
    )
    (tmp_path / "shaken.toml").write_text(THREE + table)
    speeds = "--speeds", "1500 rpm:2500 rpm:2", *SMALL, "--json", "-"
    _, out, _ = run("periodic", "shaken.toml", *speeds)
    file = json.loads(out)
    _, out, _ = run("periodic", DRIVE, *speeds, "--orders", "2=0.1 deg, 4=0.05 deg@1 rad")
    command = json.loads(out)
    assert file == command
    assert [part["driver_speed"] for part in file["periodic"]] == pytest.approx(
        [50 * np.pi, 2500 * np.pi / 30]
    )
    assert file["orders"] == [2.0, 4.0]
    drive, point = bj.load_drive(tmp_path / "shaken.toml")
    bj.save_drive(tmp_path / "again.toml", drive, point)
    _, again = bj.load_drive(tmp_path / "again.toml")
    assert [float(one.phase) for one in again.excitation.orders] == [0.0, 1.0]


@pytest.mark.slow
def test_a_pulley_that_slips_and_a_motion_that_is_not_found_end_with_2(run):
    seven = EXAMPLES / "seven_pulley.toml"
    words = "--speeds", "900 rpm", *SMALL, "--json", "-", "--modal-damping", 0.03
    status, out, err = run("periodic", seven, *words, "--crank", "0.5 deg")
    assert status == 2
    assert re.fullmatch(r"beltjax: .*at 900 rpm: a span goes slack or a pulley slips.*\n", err)
    document = json.loads(out)
    assert (document["success"], document["feasible"]) == (True, False)
    (warning,) = (w for w in document["warnings"] if w["code"] == "belt_slips_in_motion")
    assert "crankshaft" in warning["text"]
    assert document["periodic"][0]["pulleys"][0]["friction_use_max"] > 1
    words = "--speeds", "2000 rpm", *SMALL, "--json", "-"
    status, out, err = run("periodic", DRIVE, *words, "--crank", "40 deg")
    assert status == 2
    assert re.fullmatch(r"beltjax: .*at 2000 rpm: No periodic motion was found.*\n", err)
    document = json.loads(out)
    assert (document["success"], document["feasible"]) == (False, False)
    assert document["periodic"][0]["spans"][0]["tension_min"] is None


@pytest.mark.slow
def test_a_branch_goes_through_the_range(run):
    words = "--crank", "0.1 deg", "--speeds", "2200 rpm:2250 rpm", "--branch", "down"
    status, out, _ = run(
        "periodic", DRIVE, *words, "--functions", 1, "--harmonics", 2, "--json", "-"
    )
    document = json.loads(out)
    assert status == 0
    assert document["success"]
    speeds = [part["driver_speed"] for part in document["periodic"]]
    assert speeds[0] == pytest.approx(2250 * np.pi / 30)
    assert speeds[-1] < 2200 * np.pi / 30
    assert document["folds"] == []
    assert all(part["success"] for part in document["periodic"])


BAD = {
    "one speed": (["--crank", "1 deg", "--branch", "up"], r"--branch: goes with a range of speeds"),
    "nothing": ([], r"three_pulley\.toml: is not excited; give --crank, --orders"),
    "zero": (["--crank", "0"], r"--crank: nothing is excited"),
    "both": (["--orders", "2=1 deg", "--crank", "1 deg"], r"--orders: stands beside --crank"),
    "no order": (["--orders", "1 deg"], r"--orders: found '1 deg'; give ORDER=AMPLITUDE"),
    "twice": (["--orders", "2=1 deg,2=2 deg"], r"--orders: found order 2 twice"),
    "unit": (["--orders", "2=1 mm"], r"--orders: .*mm"),
    "phase": (["--orders", "2=1 deg@3 N"], r"--orders: .*N"),
    "odd": (["--crank", "1 deg", "--order", "2.71828"], r"--order: .*positive fraction"),
    "high": (["--crank", "1 deg", "--order", "2", "--harmonics", "0"], r"--harmonics"),
    "speed": (["--crank", "1 deg", "--speeds", "0 rpm"], r"--speeds: found '0 rpm'; begin above 0"),
    "range": (["--crank", "1 deg", "--speeds", "9 rpm:3 rpm"], r"--speeds: .*ends above"),
    "pulley": (["--torque", "fan=1"], r"--torque: .*'fan'"),
    "damping": (["--crank", "1 deg", "--modal-damping", "-1"], r"--modal-damping: .*negative"),
    "far orders": (["--orders", "0.5=1 deg,20=1 deg"], r"--harmonics: .*give at least 40"),
}  # fmt: skip


@pytest.mark.parametrize(("words", "message"), BAD.values(), ids=BAD)
def test_bad_input_is_one_line_and_writes_nothing(run, tmp_path, words, message):
    status, _, err = run("periodic", DRIVE, *words, "--json", "p.json")
    assert status == 1
    assert err.count("\n") == 1
    assert re.search(message, err)
    assert not (tmp_path / "p.json").exists()


@pytest.mark.slow
def test_one_order_goes_with_the_file_and_several_do_not(run, tmp_path):
    (tmp_path / "one.toml").write_text(THREE + '\n[excitation]\ncrank = "0.1 deg"\norder = 3\n')
    _, out, _ = run("periodic", "one.toml", *SMALL, "--json", "-")
    assert json.loads(out)["orders"] == [3.0]
    _, out, _ = run("periodic", "one.toml", *SMALL, "--json", "-", "--order", 2)
    assert json.loads(out)["orders"] == [2.0]
    several = THREE + '\n[excitation]\norders = [{ order = 2, crank = "1 deg" }]\n'
    (tmp_path / "several.toml").write_text(several)
    status, _, err = run("periodic", "several.toml", "--order", 2)
    assert status == 1
    assert "excitation.orders are several" in err
    status, _, err = run("response", "several.toml")
    assert status == 1
    assert "has excitation.orders, which are for `periodic`" in err
    (tmp_path / "both.toml").write_text(several + 'crank = "1 deg"\n')
    status, _, err = run("periodic", "both.toml")
    assert status == 1
    assert re.search(r"excitation\.crank: stands beside orders", err)


BAD_TABLES = {
    "no order": ('[{ crank = "1 deg" }]', r"excitation\.orders.*order"),
    "key": ('[{ order = 2, crnk = "1 deg" }]', r"excitation\.orders.*crnk"),
    "negative": ("[{ order = -2 }]", r"excitation\.orders.*order"),
    "pulley": ("[{ order = 2, torque = { fan = 1 } }]", r"excitation\.orders\.1\.torque\.fan"),
    "driver": ("[{ order = 2, torque = { crankshaft = 1 } }]", r"orders\.1\.torque\.crankshaft.*use crank"),
    "no fraction": ('[{ order = 2.71828, crank = "1 deg" }]', r"excitation: .*positive fraction"),
}  # fmt: skip


@pytest.mark.parametrize(("table", "message"), BAD_TABLES.values(), ids=BAD_TABLES)
def test_bad_orders_of_a_file(run, tmp_path, table, message):
    (tmp_path / "bad.toml").write_text(f"{THREE}\n[excitation]\norders = {table}\n")
    status, _, err = run("periodic", "bad.toml")
    assert status == 1
    assert re.search(message, err), err
