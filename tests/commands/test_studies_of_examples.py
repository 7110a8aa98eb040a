"""The studies of examples/, by the command line, to a drive file that other commands confirm."""

import json
import os
import re

import numpy as np
import pytest
from browser import toured
from drives import EXAMPLES

import beltjax as bj

FIRING = 25.0  # Hz: order 2 at 750 rpm


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_frequencies_are_kept_off_the_firing_order(run, tmp_path):
    study = EXAMPLES / "seven_pulley_frequency_study.toml"
    status, _, err = run(
        "optimize", study, "--json", "o.json", "--out", "after.toml", "--report", "r.html"
    )
    assert (status, err) == (0, "")
    found = json.loads((tmp_path / "o.json").read_text())
    assert found["success"]
    assert found["optimality"]["residual"] < 1e-8
    assert found["objective"]["initial"] / found["objective"]["final"] > 1.5
    # Starts and design tell one objective, though the search minimizes a smooth one.
    best = min(start["final"] for start in found["starts"] if start["result"] == "optimal")
    assert best == pytest.approx(found["objective"]["final"], rel=1e-6)
    assert found["optima"][0]["objective"] == pytest.approx(found["objective"]["final"], rel=1e-9)

    # Gamma at both points, on the written drive file.
    drive, idle = bj.load_drive(tmp_path / "after.toml")
    cruise = bj.OperatingPoint(driver_speed=2500 * 2 * np.pi / 60, torque=dict(idle.torque))
    totals = [float(bj.steady_state(drive, p).coupling.sum()) for p in (idle, cruise)]
    assert max(totals) == pytest.approx(found["objective"]["final"], rel=1e-9)
    status, _, _ = run("analyze", "after.toml", "--json", "a.json")
    analyzed = json.loads((tmp_path / "a.json").read_text())
    assert status == 0
    assert analyzed["steady"]["coupling_total"] == pytest.approx(totals[0], rel=1e-9)
    # A study's frequencies are good to 0.1 %; these to 1e-6.
    assert min(abs(f / FIRING - 1) for f in analyzed["modes"]["hertz"]) > 0.2 - 2e-3

    over = "operation.driver_speed=740 rpm:760 rpm:3"
    status, _, _ = run("sweep", "after.toml", "--over", over, "--json", "s.json")
    swept = np.array(json.loads((tmp_path / "s.json").read_text())["hertz"])
    assert status == 0
    assert np.nanmin(np.abs(swept[1] / FIRING - 1)) > 0.2 - 2e-3

    page = (tmp_path / "r.html").read_text()
    assert "Every limit is met" in page
    assert page.count("<svg") == 3
    assert "http" not in page.replace("http://www.w3.org", "")  # names of XML, not addresses
    (tmp_path / "pages").mkdir()
    (tmp_path / "pages" / "r.html").write_text(page)
    server = toured(tmp_path / "pages")
    assert [one["screen"] for one in server.found] == ["phone", "desktop"]
    assert all(one["sideways"] == 0 and one["problems"] == [] for one in server.found)
    assert [one for one in server.missing if "favicon" not in one[1]] == []


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_three_pulley_drive_is_kept_off_both_firing_frequencies(run, tmp_path):
    study = EXAMPLES / "three_pulley_frequency_study.toml"
    status, _, err = run("optimize", study, "--json", "o.json", "--out", "after.toml")
    assert (status, err) == (0, "")
    found = json.loads((tmp_path / "o.json").read_text())
    drive, _ = bj.load_drive(tmp_path / "after.toml")
    totals = []
    for rpm, torque in ((750, 0.0), (2150, 2.0)):
        speed = rpm * 2 * np.pi / 60
        steady = bj.steady_state(
            drive, bj.OperatingPoint(driver_speed=speed, torque={"accessory": torque})
        )
        totals.append(float(steady.coupling.sum()))
        # Exact frequencies; a study's are good to 0.1 %.
        lowest = bj.modes(bj.linearize(steady, bj.Sine(8)), 8, exact=True).frequencies
        assert np.min(np.abs(np.asarray(lowest) / (2 * speed) - 1)) > 0.1 - 1.1e-3
    assert max(totals) == pytest.approx(found["objective"]["final"], rel=1e-9)
    assert found["objective"]["initial"] > 1.5 * found["objective"]["final"]


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_robust_study_is_confirmed_by_the_scatter_of_its_drive(run, tmp_path):
    study = EXAMPLES / "three_pulley_robust_study.toml"
    files = "--json", "o.json", "--out", "after.toml", "--report", "r.html"
    status, out, err = run("optimize", study, *files)
    assert (status, err) == (0, "")
    assert "mean and 3 standard deviations, of 256 drives" in out
    found = json.loads((tmp_path / "o.json").read_text())
    assert found["robust"]["numbers"][0] == "tensioner.angle"
    assert "As drawn the objective is 3.33" in (tmp_path / "r.html").read_text()

    scattered = "--deviation", "tensioner.angle=3 deg", "--within", "pulley.accessory.radius=0.1 mm"
    asked = "--quantity", "coupling", "--quantity", "tensioner_effectiveness"
    more = "--deviation", "pulley.accessory.center.y=2 mm", "--json", "s.json"
    status, _, _ = run("robust", "after.toml", *scattered, *asked, *more)
    assert status == 0
    gamma, eta = json.loads((tmp_path / "s.json").read_text())["quantities"]
    assert gamma["nominal"] == pytest.approx(found["robust"]["as_drawn"]["objective"], rel=1e-9)
    # 256 points and 4096: deviations that differ by a percent.
    promised = found["objective"]["final"] - gamma["mean"]
    assert promised == pytest.approx(3 * gamma["deviation"], rel=0.03)
    assert eta["mean"] - 3 * eta["deviation"] == pytest.approx(0.854, abs=3e-4)


def test_the_search_of_another_study_is_refused(run, tmp_path):
    (tmp_path / "state.npz").write_bytes(b"not one")
    study = EXAMPLES / "three_pulley_study.toml"
    status, out, err = run("optimize", study, "--method", "slsqp", "--checkpoint", "state.npz")
    assert (status, out) == (1, "")
    assert "state.npz: is no checkpoint of this version of beltjax, or damaged; remove" in err


def test_a_warm_start_must_be_of_this_study(run, tmp_path):
    (tmp_path / "o.json").write_text('{"design": {"belt.mass": 3}}')
    status, _, err = run("optimize", EXAMPLES / "three_pulley_study.toml", "--warm", "o.json")
    assert status == 1
    assert "o.json: design: has no number for 'pulley.tensioner.radius'" in err


NAME = '"pulley.tensioner.radius"'
WARM = {
    "no JSON": ("nothing", r"is not JSON: Expecting value: line 1 column 1 .*; give the JSON of a run"),
    "other bytes": (b"\xff\xfe\x00", r"is not JSON: .*codec can't decode"),
    "nothing": ("", r"is not JSON: Expecting value"),
    "a list": ("[1, 2]", r"design: is missing; give the JSON of a run of this study"),
    "no design": ('{"design": 3}', r"design: is missing; give"),
    "nested": ("[" * 100_000, r"is nested too deep; give the JSON of a run"),
    "nested design": ('{"design": {' + f"{NAME}: " + "[" * 500 + "]" * 500 + "}}", r"design: found a list of 1 for 'pulley\.tensioner\.radius', no finite number"),
    "not a number": ('{"design": {' + f"{NAME}: NaN" + "}}", r"design: found nan for 'pulley\.tensioner\.radius', no finite number"),
    "infinite": ('{"design": {' + f"{NAME}: 1e999" + "}}", r"design: found inf for"),
    "text": ('{"design": {' + f'{NAME}: "0.03"' + "}}", r"design: found '0\.03' for"),
    "logical": ('{"design": {' + f"{NAME}: true" + "}}", r"design: found True for"),
    "400 digits": ('{"design": {' + f"{NAME}: {'9' * 400}" + "}}", r"design: found an integer of more than 30 digits for"),
    "5000 digits": ('{"design": {' + f"{NAME}: {'9' * 5000}" + "}}", r"is not JSON: Exceeds the limit"),
}  # fmt: skip


@pytest.mark.parametrize("case", WARM)
def test_a_damaged_warm_start_is_one_line(case, run, tmp_path):
    content, says = WARM[case]
    path = tmp_path / "o.json"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    status, out, err = run("optimize", EXAMPLES / "three_pulley_study.toml", "--warm", "o.json")
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert re.search(rf"^beltjax: o\.json: {says}", err)
    assert [path.name for path in tmp_path.iterdir()] == ["o.json"]


def test_a_warm_start_that_is_no_file_is_one_line(run, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path, says in (("pipe", "is no file"), ("/dev/zero", "is no file"), ("none", "cannot be")):
        status, _, err = run("optimize", EXAMPLES / "three_pulley_study.toml", "--warm", path)
        assert (status, err.count("\n")) == (1, 1)
        assert f"{path}: {says}" in err


def test_a_study_without_objectives_has_no_front(run):
    status, _, err = run("pareto", EXAMPLES / "three_pulley_study.toml")
    assert status == 1
    assert "pareto: is missing; give objectives" in err


def test_a_drive_file_is_no_study(run):
    status, _, err = run("optimize", EXAMPLES / "three_pulley.toml")
    assert status == 1
    assert "three_pulley.toml: belt: is the key of a drive file; give a study" in err


def test_a_folder_that_may_not_be_written_is_named_before_the_work(run, monkeypatch, tmp_path):
    monkeypatch.setattr("os.access", lambda folder, mode: False)
    status, out, err = run("optimize", EXAMPLES / "three_pulley_study.toml", "--json", "o.json")
    assert (status, out) == (1, "")
    assert "its folder may not be written; give another folder" in err
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_cannot_be_written_is_named_by_its_own_name(monkeypatch, tmp_path):
    def full(**_):
        raise OSError(28, "No space left on device", "a name of its own")

    monkeypatch.setattr("tempfile.mkstemp", full)
    with pytest.raises(OSError, match="No space left") as error:
        bj.files.writing.write_whole(tmp_path / "o.json", b"{}")
    assert error.value.filename == str(tmp_path / "o.json")


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_starter_generator_is_designed_for_charging_and_cranking(run, tmp_path):
    study = EXAMPLES / "starter_generator_study.toml"
    status, _, err = run("optimize", study, "--json", "o.json", "--out", "after.toml")
    assert status == 0
    assert "belt is stiff for generator" in err
    found = json.loads((tmp_path / "o.json").read_text())
    assert found["optimality"]["residual"] < 1e-8
    assert found["objective"]["final"] < 0.85 * found["objective"]["initial"]

    # Both points, on the written drive file: Gamma, the slack side and the generator's bearing.
    drive, charging = bj.load_drive(tmp_path / "after.toml")
    torque = {"air conditioner": 0.0, "generator": -40.0}
    cranking = bj.OperatingPoint(driver_speed=200 * 2 * np.pi / 60, torque=torque)
    states = [bj.steady_state(drive, point) for point in (charging, cranking)]
    totals = [float(state.coupling.sum()) for state in states]
    assert max(totals) == pytest.approx(found["objective"]["final"], rel=1e-9)
    assert min(float(state.effective_tensions.min()) for state in states) > 0.5
    # The slack side is on the one side of the generator, then on the other.
    slack = [int(np.argmin(state.running_tensions)) for state in states]
    assert slack == [0, 3] or slack == [0, 4]


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_seven_pulley_drive_is_kept_off_parametric_instability(run, tmp_path):
    study = EXAMPLES / "seven_pulley_stability_study.toml"
    status, _, err = run("optimize", study, "--json", "o.json", "--out", "after.toml")
    assert (status, err) == (0, "")
    found = json.loads((tmp_path / "o.json").read_text())
    assert found["success"]
    # Once more with a finer basis, and not by a study's own analyses.
    drive, point = bj.load_drive(tmp_path / "after.toml")
    ends = 600 * np.pi / 30, 6000 * np.pi / 30
    crank, damping = bj.Excitation(crank=np.radians(1.0)), bj.Damping(modal=0.02)
    margin = bj.parametric_margin(drive, point, ends, crank, damping=damping, count=8)
    assert np.min(margin.least) > 0.98 * 1.5
    before = bj.load_drive(EXAMPLES / "seven_pulley_shaken.toml")
    margin = bj.parametric_margin(*before, ends, crank, damping=damping, count=8)
    assert np.min(margin.least) < 1.5
