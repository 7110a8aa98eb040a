"""`beltjax stability`: its document, its statuses, its picture, and what it refuses."""

import json

import numpy as np
import pytest
from drives import EXAMPLES

import beltjax as bj

DRIVE = EXAMPLES / "three_pulley.toml"
THREE = DRIVE.read_text()
NEAR = "--speeds", "2600 rpm:2640 rpm", "--modal-damping", 0.01
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.mark.slow
def test_document_is_that_of_the_margin(run, tmp_path):
    words = "--crank", "0.1 deg", *NEAR
    status, out, err = run("stability", DRIVE, *words, "--json", "s.json", "--figure", "t.png")
    assert status == 2
    assert "mode 1 becomes unstable near 2621 rpm" in err
    assert "parametric resonance" in out
    assert (tmp_path / "t.png").read_bytes().startswith(PNG)
    document = json.loads((tmp_path / "s.json").read_text())
    drive, point = bj.load_drive(DRIVE)
    ends = 2600 * np.pi / 30, 2640 * np.pi / 30
    torques = dict.fromkeys(drive.pulley_names, 0.0)
    found = bj.parametric_margin(
        drive, point, ends, bj.Excitation(np.radians(0.1), torques), damping=bj.Damping(modal=0.01)
    )
    assert document["margin"] == pytest.approx(float(found.margin), rel=1e-9)
    assert document["safe"] is False
    worst = document["worst"]
    assert worst["modes"] == [1, 1]
    assert worst["kind"] == "principal"
    assert worst["rpm"] == pytest.approx(2621.47, abs=0.1)
    assert worst["hertz"] == pytest.approx(worst["rpm"] / 30)
    assert worst["critical_crank"] == pytest.approx(np.radians(0.1) * document["margin"])
    (tongue,) = document["tongues"]
    assert tongue["critical_factor_exact"] is None
    assert not tongue["slack"]
    assert len(tongue["tension_fluctuation"]) == 3
    assert tongue["half_width_hz"] > 0

    # The excitation in the file, with the number of the derivative changed.
    slope = document["sensitivities"]["parametric_margin"]["tensioner.stiffness"]
    margins = []
    for stiffness in (116.0, 116.8):
        other = THREE.replace("stiffness = 116.4", f"stiffness = {stiffness}")
        (tmp_path / "other.toml").write_text(
            other + '\n[excitation]\ncrank = "0.1 deg"\norder = 2\n'
        )
        _, out, _ = run("stability", "other.toml", *NEAR)
        margins.append(float(out.split("by a factor of ")[1].split()[0]))
    # Printed with four digits.
    assert slope == pytest.approx((margins[1] - margins[0]) / 0.8, abs=2e-4)


def test_a_small_excitation_is_safe(run):
    status, out, err = run("stability", DRIVE, "--crank", "0.01 deg", *NEAR)
    assert (status, err) == (0, "")
    assert "may grow by a factor of 6.1" in out


def test_several_orders(run):
    words = "--orders", "2=0.01 deg,4=0.001 deg"
    status, out, _ = run("stability", DRIVE, *words, "--speeds", "1250 rpm:2640 rpm")
    assert status == 0
    orders = {line.split()[1] for line in out.splitlines() if "-" in line.split(" ", 3)[2]}
    assert orders == {"2", "4"}


def test_what_is_refused(run, tmp_path):
    for words, text in (
        ((), "is not excited"),
        (("--crank", "0.1 deg", "--speeds", "0:100"), "--speeds"),
        (("--crank", "0.1 deg", "--speeds", "100"), "--speeds"),
        (("--crank", "-1 deg"), "--crank"),
        (("--crank", "0.1 deg", "--modal-damping", -1), "--modal-damping"),
    ):
        status, _, err = run("stability", DRIVE, *words)
        assert status == 1
        assert text in err
    limp = THREE.replace("bending_stiffness = 0.015 ", "bending_stiffness = 0.0 ")
    (tmp_path / "limp.toml").write_text(limp)
    status, out, err = run("stability", "limp.toml", "--crank", "0.1 deg", *NEAR, "--json", "-")
    assert status == 2
    assert "bending stiffness" in err
    document = json.loads(out)
    assert document["margin"] is None
    assert not document["success"]
    free = THREE + '\n[excitation]\ndriver = "free"\ntorque = { accessory = 1.0 }\n'
    (tmp_path / "free.toml").write_text(free)
    status, _, err = run("stability", "free.toml")
    assert status == 1
    assert "free" in err
