"""Bare numbers that are hardly meant in SI: a question with the remedy, and none about usual ones."""

import json
import re

import pytest
from bodies_cases import CASES, load, swap
from drives import EXAMPLES

THREE = (EXAMPLES / "three_pulley.toml").read_text()
DRIVES = [path for path in sorted(EXAMPLES.glob("*.toml")) if "[[pulley]]" in path.read_text()]
SPEED = ("belt_speed = 20.0", "driver_speed = 750")
RPM = (
    "operation.driver_speed = 750 has no unit and is read in rad/s, which is 7161.97 rpm: write "
    '"750 rpm" if that is meant, or "750 rad/s"'
)


@pytest.mark.parametrize("text", [p.read_text() for p in DRIVES], ids=[p.stem for p in DRIVES])
def test_no_example_is_doubted(tmp_path, text):
    assert load(tmp_path, text)[0].units.doubts == ()


@pytest.mark.parametrize("case", list(CASES), ids=[name[:2] for name in CASES])
def test_no_stored_drive_is_doubted(tmp_path, case):
    assert load(tmp_path, CASES[case]["file"])[0].units.doubts == ()


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (*SPEED, re.escape(RPM)),
        ("belt_speed = 20.0", "belt_speed = 1200", r'belt_speed = 1200 .* m/s: write "1200 m/min"'),
        ("stiffness = 116.4", "stiffness = 116.4\nstops = [-40, 42]", r'stops\.0 = -40 .* rad, which is -2291\.83 deg: write "-40 deg" if that is meant, or "-40 rad"'),
        ("stiffness = 116.4", "stiffness = 0.35", r'stiffness = 0\.35 .* N m/rad: write "0\.35 N m/deg"'),
        ("axial_stiffness = 120e3", "axial_stiffness = 120", r'axial_stiffness = 120 .* in N: write "120 kN"'),
        ("bending_stiffness = 0.015", "bending_stiffness = 15000", r'write "15000 N mm\^2"'),
        ("mass_per_length = 0.1029", "mass_per_length = 102.9", r'mass_per_length = 102\.9 .* kg/m: write "102\.9 g/m"'),
        ("tension = 300.0", "tension = 0.3", r'installation\.tension = 0\.3 .* in N: write "0\.3 kN"'),
        ("accessory = 0.0", "accessory = 14000", r'torque\.accessory = 14000 .* N m: write "14000 N mm"'),
        ("inertia = 0.000293", "inertia = 293", r'pulley\.tensioner\.inertia = 293 .* kg m\^2: write "293 kg mm\^2"'),
        ("[operation.torque]", "[operation.load.tensioner]\npower = 1.2\n[operation.torque]", r'load\.tensioner\.power = 1\.2 .* W: write "1\.2 kW"'),
        ("[operation.torque]", "[operation.load.tensioner]\npower = [100, 200]\nspeed = [1000, 6000]\n[operation.torque]", r"load\.tensioner\.speed\.1 = 6000 .* 57295\.8 rpm"),
        ("[belt]", "[belt]\nthickness = 4.5", r'belt\.thickness = 4\.5 .* in m: write "4\.5 mm"'),
        ("[belt]", "[belt]\npitch_offset = 1.6", r'belt\.pitch_offset = 1\.6 .* write "1\.6 mm"'),
        ("center = [0.5525, 0.0556]", "center = [552.5, 0.0556]", r'pulley centers .* lie 552\.5 m apart, beside a radius of 0\.02697 m: write "\.\.\. mm"'),
    ],
    ids=lambda text: text[:24] if "=" in text else "",
)  # fmt: skip
def test_what_is_hardly_meant_in_si_is_asked(tmp_path, old, new, says):
    doubt, *others = load(tmp_path, swap(THREE, old, new))[0].units.doubts
    assert re.search(says, doubt)
    assert len(others) == ("[-40, 42]" in new)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("belt_speed = 20.0", 'driver_speed = "750 rad/s"'),
        ("belt_speed = 20.0", "driver_speed = 628.3185"),  # 6000 rpm
        ("center = [0.5525, 0.0556]", 'center = ["552.5 m", 0.0556]'),
    ],
)
def test_a_unit_or_a_usual_number_is_not_asked_about(tmp_path, old, new):
    drive, _ = load(tmp_path, swap(THREE, old, new))
    assert [text for text in drive.units.doubts if "driver_speed" in text] == []


@pytest.mark.slow
def test_the_question_stands_in_every_answer(run, tmp_path):
    (tmp_path / "fast.toml").write_text(swap(THREE, *SPEED))
    for command in ("layout", "analyze"):
        status, out, _ = run(command, "fast.toml", "--json", f"{command}.json")
        assert status == 0
        document = json.loads((tmp_path / f"{command}.json").read_text())
        assert {"code": "number_without_unit", "text": RPM} in document["warnings"]
        assert 'write "750 rpm" if that is meant' in " ".join(out.split())
