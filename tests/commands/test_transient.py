"""`beltjax transient`: its document, its files, its statuses, and one line for what is wrong."""

import json
import re

import numpy as np
import pytest
import xarray
from drives import EXAMPLES

import beltjax as bj

DRIVE = EXAMPLES / "three_pulley.toml"
THREE = DRIVE.read_text()
PNG = b"\x89PNG\r\n\x1a\n"
SMALL = "--functions", 2


@pytest.mark.slow
def test_a_run_up_with_its_files(run, tmp_path):
    words = "--runup", "1000rpm:3000rpm:0.25s", "--crank", "0.05 deg", "--modal-damping", 0.03
    files = "--json", "t.json", "--netcdf", "t.nc", "--figure", "t.png", "--csv", "t.csv"
    status, out, err = run("transient", DRIVE, *words, *SMALL, *files)
    assert (status, err) == (0, "")
    assert "motion over 0.25 s, 1000 to 3000 rpm" in out
    document = json.loads((tmp_path / "t.json").read_text())
    drive, point = bj.load_drive(DRIVE)
    found = bj.transient(
        drive, point, profile=np.array([[0, 1000], [0.25, 3000]]) * [1, np.pi / 30],
        orders=bj.Orders({2: bj.Excitation(np.radians(0.05))}), damping=bj.Damping(modal=0.03),
        functions=2, advance=lambda *_: None,  # in parts, as the command does it
    )  # fmt: skip
    m, part = found.measures, document["transient"]
    for key, rows, values in (
        ("rotation_amplitude", part["pulleys"], m.rotation_amplitudes),
        ("tension_min", part["spans"], m.tension_min),
        ("peak_to_peak", part["coordinates"], m.travels),
    ):
        np.testing.assert_allclose([row[key] for row in rows], values, rtol=1e-9)
    np.testing.assert_allclose(document["profile"], [[0, 1000 * np.pi / 30], [0.25, 100 * np.pi]])
    assert document["orders"] == [2]
    speeds = part["peak_speeds"]["tensions"]
    np.testing.assert_allclose(speeds, found.peak_speeds.tensions, rtol=1e-9)
    assert part["reference_speed"] == pytest.approx(2000 * np.pi / 30)
    assert document["success"]
    data = xarray.open_dataset(tmp_path / "t.nc", engine="scipy")
    assert data["tension"].units == "N"
    np.testing.assert_allclose(
        data["tension"].min("time"), m.tension_min, rtol=1e-3
    )  # of the times kept
    assert data["driver_speed"].values[-1] == pytest.approx(100 * np.pi)
    assert list(data["span"].values) == list(drive.span_names)
    assert (tmp_path / "t.png").read_bytes().startswith(PNG)
    assert "greatest" in (tmp_path / "t.csv").read_text()


@pytest.mark.slow
def test_profile_of_the_file_and_signals_of_tables(run, tmp_path):
    table = '\n[excitation]\nprofile = [[0, "1000 rpm"], [0.25, "1000 rpm"]]\n'
    (tmp_path / "mine.toml").write_text(THREE + table)
    status, out, err = run("transient", "mine.toml", *SMALL, "--figure", "t.png", "--json", "-")
    assert (status, err) == (0, "")
    document = json.loads(out)
    assert document["transient"]["peak_speeds"] is None  # at a constant speed
    assert document["orders"] == []
    still = document["transient"]["coordinates"][0]["peak_to_peak"]
    assert still < 1e-9  # it begins in its steady state, and stays there
    times = np.linspace(0, 0.25, 400)
    speeds = 1000 * (1 + 0.002 * np.sin(2 * 2 * np.pi * 1000 / 60 * times))
    rows = "\n".join(f"{t:.9g},{s:.12g}" for t, s in zip(times, speeds, strict=True))
    (tmp_path / "crank.csv").write_text(f"time (s),speed (rpm)\n{rows}\n")
    words = "--crank-signal", "crank.csv", "--duration", "0.25 s"
    status, out, err = run("transient", DRIVE, *words, *SMALL, "--json", "-")
    assert (status, err) == (0, "")
    shaken = json.loads(out)["transient"]["coordinates"][0]["peak_to_peak"]
    assert shaken > 1e-4
    # The file is kept as it is read.
    drive, point = bj.load_drive(tmp_path / "mine.toml")
    bj.save_drive(tmp_path / "copy.toml", drive, point)
    again = bj.load_drive(tmp_path / "copy.toml")[1]
    np.testing.assert_allclose(again.excitation.profile, point.excitation.profile)


@pytest.mark.slow
def test_a_span_that_goes_slack_ends_with_2(run):
    words = "--duration", "0.05 s", "--crank", "8 deg"
    status, out, err = run("transient", DRIVE, *words, *SMALL, "--json", "-")
    document = json.loads(out)
    assert status == 2
    assert document["success"]
    assert not document["feasible"]
    assert "span_slack_in_motion" in {one["code"] for one in document["warnings"]}
    assert re.fullmatch(r"beltjax: .*a span goes slack or a pulley slips[^\n]*\n", err)


BAD = {
    "no end": ((), r"excitation.profile: the motion has no end; give --duration"),
    "no time": (("--duration", "0 s"), r"--duration: found '0 s'; give a time above 0"),
    "unit": (("--duration", "2 m"), r"--duration: "),
    "run-up": (("--runup", "600:3000"), r"--runup: found '600:3000'; give FROM:TO:TIME"),
    "negative": (("--runup", "-1:300:1"), r"--runup: .*a speed is not negative"),
    "two": (("--runup", "1:2:1", "--profile", "x.csv"), r"--runup: stands beside --profile"),
    "shorter": (
        ("--runup", "1:2:1", "--duration", "0.5 s"),
        r"--duration: is shorter than the profile, of 1 s",
    ),
    "no file": (("--profile", "x.csv"), r"x.csv: cannot be read"),
    "order": (("--duration", "1", "--order", "2"), r"--order: goes with --crank or --torque"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line_and_writes_nothing(run, tmp_path, name):
    words, message = BAD[name]
    status, out, err = run("transient", DRIVE, *words, "--json", "t.json")
    assert (status, out) == (1, "")
    assert re.search(message, err), err
    assert err.count("\n") == 1
    assert not (tmp_path / "t.json").exists()


@pytest.mark.parametrize(
    ("profile", "message"),
    [
        ('[[0, "600 rpm"]]', "found 1 times; give at least two, with speeds"),
        ('[[1, "600 rpm"], [0, 2]]', "found 0 s after 1 s; sort the times"),
        ('[[0, "600 kg"], [1, 2]]', "excitation.profile"),
        ("[[0, -1], [1, 2]]", "found -1; must not be less than 0"),
        ("[[0], [1, 2]]", r"give a time and a speed, such as \[1.5, "),
    ],
)
def test_a_wrong_profile_of_the_file_is_one_line(run, tmp_path, profile, message):
    (tmp_path / "mine.toml").write_text(f"{THREE}\n[excitation]\nprofile = {profile}\n")
    status, _, err = run("transient", "mine.toml")
    assert status == 1
    assert re.search(message, err), err
    assert err.count("\n") == 1
