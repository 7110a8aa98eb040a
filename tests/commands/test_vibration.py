"""Sweeps and responses on the command line: files, tables, pictures, and one line for an error."""

import json
import re

import numpy as np
import pytest
import xarray
from drives import EXAMPLES

import beltjax as bj
import beltjax.commands.cli
from beltjax.drive.numbers import named_numbers

DRIVE = EXAMPLES / "three_pulley.toml"
THREE = DRIVE.read_text()
SHAKEN = THREE + '\n[excitation]\ncrank = "0.5 deg"\norder = 4\ntorque = { accessory = 1.5 }\n'
PNG = b"\x89PNG\r\n\x1a\n"


def test_sweep_writes_json_netcdf_and_a_picture_that_agree(run, tmp_path):
    over = "operation.driver_speed=0 rpm:6000 rpm:9"
    files = "--json", "s.json", "--netcdf", "s.nc", "--figure", "s.png"
    status, out, err = run("sweep", DRIVE, "--over", over, "--count", 4, *files)
    assert (status, err) == (0, "")
    assert re.search(r"over\s+operation\.driver_speed\s+at \(rpm\)\s+Gamma\s+1 ", out)
    assert re.search(r"^ +6000 ", out, flags=re.MULTILINE)
    document = json.loads((tmp_path / "s.json").read_text())
    assert document["values"][-1] == pytest.approx(200 * np.pi)
    assert {"hertz", "mac", "coupling", "veerings", "labels", "failures"} <= set(document)
    assert set(document["failures"]) == {None}
    with xarray.open_dataset(tmp_path / "s.nc", engine="scipy") as data:
        hertz = np.array(document["hertz"])
        np.testing.assert_allclose(data.frequency / (2 * np.pi), hertz, rtol=1e-12)
        assert data["value"].attrs["units"] == "rad/s"
    assert (tmp_path / "s.png").read_bytes().startswith(PNG)
    # 20 m/s, the file's own speed, lies between the rows; its modes are those of `modes`.
    drive, _ = bj.load_drive(DRIVE)
    speeds = np.array(document["values"]) * float(drive.pulleys[0].radius)
    assert speeds[0] < 20.0 < speeds[-1]
    assert hertz[0, 0] > np.interp(20.0, speeds, hertz[:, 0]) > hertz[-1, 0]


def test_sweep_past_the_slack_of_a_span_reports_the_points_that_failed(run):
    text = "operation.torque.accessory=-40:0:5"
    status, out, _ = run("sweep", DRIVE, "--over", text, "--count", 4, "--json", "-")
    assert status == 0
    document = json.loads(out)
    failures = document["failures"]
    assert failures[-1] is None
    assert "has lost its tension" in failures[0]
    assert document["hertz"][0] == [None] * len(document["labels"])


def test_sweep_of_nothing_that_runs_is_an_answer(run, tmp_path):
    text = "operation.torque.accessory=-60:-40:3"
    status, _, err = run("sweep", DRIVE, "--over", text, "--count", 4, "--json", "s.json")
    assert status == 2
    assert re.fullmatch(r"beltjax: .*operation\.torque\.accessory: no point succeeded: .*\n", err)
    assert json.loads((tmp_path / "s.json").read_text())["success"] is False


def test_response_is_that_of_speed_response(run, tmp_path):
    words = "--crank", "0.5 deg", "--speeds", "1000 rpm:3000 rpm:5", "--modal-damping", 0.05
    files = "--json", "r.json", "--figure", "r.png"
    status, out, err = run("response", DRIVE, *words, *files)
    assert (status, err) == (0, "")
    assert "hub load (N), tensioner" in out
    document = json.loads((tmp_path / "r.json").read_text())
    drive, point = bj.load_drive(DRIVE)
    speeds = np.linspace(1000, 3000, 5) * np.pi / 30
    found = bj.speed_response(
        drive, point, speeds, bj.Excitation(np.radians(0.5)), damping=bj.Damping(modal=0.05)
    )
    turned, tension = document["pulley_rotation"], document["tension"]
    np.testing.assert_allclose(turned["amplitude"], np.abs(found.rotations), rtol=1e-8)
    np.testing.assert_allclose(
        tension["amplitude"] * np.exp(1j * np.array(tension["phase"])), found.tensions, rtol=1e-7
    )
    np.testing.assert_allclose(document["hertz"], 2 * speeds / (2 * np.pi))
    assert (tmp_path / "r.png").read_bytes().startswith(PNG)


def test_table_of_excitation_is_the_default_and_the_command_goes_before(run, tmp_path):
    (tmp_path / "shaken.toml").write_text(SHAKEN)
    narrow = "--speeds", "1000 rpm:3000 rpm:5", "--json", "-"
    _, out, _ = run("response", "shaken.toml", *narrow)
    both = json.loads(out)
    assert both["order"] == 4.0
    _, out, _ = run("response", "shaken.toml", *narrow, "--crank", "0.5 deg")
    crank = json.loads(out)
    _, out, _ = run("response", DRIVE, *narrow, "--order", 4, "--torque", "accessory=1.5")
    torque = json.loads(out)

    def tensions(document):
        parts = document["tension"]
        return np.array(parts["amplitude"]) * np.exp(1j * np.array(parts["phase"]))

    # The response is linear: the file's excitation is the sum of its two parts.
    np.testing.assert_allclose(tensions(both), tensions(crank) + tensions(torque), rtol=1e-8)


def test_excitation_round_trips_and_moves_no_other_number(tmp_path):
    (tmp_path / "shaken.toml").write_text(SHAKEN)
    drive, point = bj.load_drive(tmp_path / "shaken.toml")
    bj.save_drive(tmp_path / "again.toml", drive, point)
    _, again = bj.load_drive(tmp_path / "again.toml")
    assert float(again.excitation.crank) == float(point.excitation.crank) == np.radians(0.5)
    assert float(again.excitation.order) == 4.0
    assert {name: float(x) for name, x in again.excitation.torque.items()} == {"accessory": 1.5}
    assert set(named_numbers(drive, point)) == set(named_numbers(*bj.load_drive(DRIVE)))


SPEED = "operation.belt_speed"
BAD_SWEEPS = {
    "no such number": (["--over", "operation.belt_sped=0:60:3"], r"--over: there is no number 'operation\.belt_sped' to vary; give for instance operation\.belt_speed"),
    "no number at all": (["--over", "noise=0:60:3"], r"no number 'noise' to vary; give for instance .*belt\.bending_stiffness"),
    "no equals sign": (["--over", "0:60:3"], r"--over: found '0:60:3'; give NAME=FROM:TO:POINTS"),
    "empty range": (["--over", f"{SPEED}=20:20:3"], r"--over: found '20:20:3'; give a range that ends above"),
    "reversed range": (["--over", f"{SPEED}=60:0:3"], r"ends above where it begins"),
    "one point": (["--over", f"{SPEED}=0:60:1"], r"--over: found 1 points"),
    "no points": (["--over", f"{SPEED}=0:60"], r"FROM:TO:POINTS"),
    "half a point": (["--over", f"{SPEED}=0:60:2.5"], r"whole number"),
    "wrong unit": (["--over", f"{SPEED}=0 N:60 N:3"], r"--over: found '0 N', whose unit is not m/s"),
    "not a number": (["--over", f"{SPEED}=zero:60:3"], r"--over: found 'zero'"),
    "not finite": (["--over", f"{SPEED}=0:inf:3"], r"not finite"),
    "no modes": (["--over", f"{SPEED}=0:60:3", "--count", "0"], r"--count: .*found 0; give 1 to"),
    "bad orders": (["--over", f"{SPEED}=0:60:3", "--orders", "2,-4"], r"--orders: found '2,-4'"),
    "no picture": (["--over", f"{SPEED}=0:60:3", "--figure", "s.txt"], r"s\.txt: is no picture"),
    "no folder": (["--over", f"{SPEED}=0:60:3", "--netcdf", "no/s.nc"], r"cannot be written"),
}  # fmt: skip
BAD_RESPONSES = {
    "nothing shakes": ([], r"three_pulley\.toml: is not excited; give --crank"),
    "unknown pulley": (["--torque", "accesory=1"], r"--torque: .*no pulley 'accesory'; give one of crankshaft, tensioner, accessory"),
    "driver's torque": (["--torque", "crankshaft=1"], r"--torque: the motion of the driver 'crankshaft' is given"),
    "torque in meters": (["--torque", "accessory=1 m"], r"--torque: found '1 m'"),
    "torque twice": (["--torque", "accessory=1", "--torque", "accessory=2"], r"--torque: names 'accessory' twice"),
    "negative crank": (["--crank", "-1 deg"], r"--crank: found '-1 deg'; an amplitude is not negative"),
    "empty speeds": (["--crank", "0.01", "--speeds", "600 rpm:600 rpm:5"], r"--speeds: found .* ends above"),
    "speeds from rest": (["--crank", "0.01", "--speeds", "0 rpm:600 rpm:5"], r"--speeds: .* begin above 0"),
    "negative damping": (["--crank", "0.01", "--modal-damping", "-0.1"], r"--modal-damping: .*must not be negative"),
    "no order": (["--crank", "0.01", "--order", "0"], r"--order: found 0; give a positive order"),
}  # fmt: skip
CASES = [("sweep", *case) for case in BAD_SWEEPS.values()]
CASES += [("response", *case) for case in BAD_RESPONSES.values()]


@pytest.mark.parametrize(("command", "words", "says"), CASES, ids=[*BAD_SWEEPS, *BAD_RESPONSES])
def test_bad_question_is_one_line_and_writes_nothing(command, words, says, run, tmp_path):
    status, out, err = run(command, DRIVE, *words, "--json", "out.json")
    assert (status, out) == (1, "")
    assert err.count("\n") == 1
    assert re.search(says, err), err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("accessory = 1.5", "accesory = 1.5", r"excitation\.torque\.accesory: there is no pulley"),
        ("accessory = 1.5", "crankshaft = 1.5", r"excitation\.torque\.crankshaft: the driver's"),
        ('"0.5 deg"', '"0.5 mm"', r"excitation\.crank: found '0\.5 mm'"),
        ("order = 4", "order = 0", r"excitation\.order: found 0"),
        ("order = 4", "ordr = 4", r"excitation\.ordr: is not a known key; did you mean 'order'"),
    ],
)
def test_bad_table_of_excitation(old, new, says, tmp_path):
    (tmp_path / "shaken.toml").write_text(SHAKEN.replace(old, new))
    with pytest.raises(bj.FileError, match=says):
        bj.load_drive(tmp_path / "shaken.toml")


def test_missing_inertia_is_named(run, tmp_path):
    (tmp_path / "light.toml").write_text(THREE.replace("inertia = 0.07248", ""))
    status, _, err = run("sweep", "light.toml", "--over", f"{SPEED}=0:60:3")
    assert status == 1
    assert "inertia: is missing" in err


def test_interrupt_in_the_middle_leaves_no_file(run, tmp_path, monkeypatch):
    from beltjax.analysis.sweep import _Evaluation

    whole = _Evaluation.__call__

    def half(self, stage, values):
        whole(self, stage, values[:2])
        raise KeyboardInterrupt

    monkeypatch.setattr(_Evaluation, "__call__", half)
    files = "--json", "s.json", "--netcdf", "s.nc", "--figure", "s.png"
    status, _, err = run("sweep", DRIVE, "--over", f"{SPEED}=0:60:3", "--count", 4, *files)
    assert status == 130
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
