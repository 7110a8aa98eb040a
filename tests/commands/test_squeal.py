"""`beltjax squeal`: its document, its statuses, its words, and the keys of a drive file."""

import json
import re

import numpy as np
import pytest
from drives import EXAMPLES

import beltjax as bj

THREE = (EXAMPLES / "three_pulley.toml").read_text()
PNG = b"\x89PNG\r\n\x1a\n"
LAW = "friction = 0.15\nfriction_static = {static}\nfriction_speed = 0.3\n"
PLAIN = "--no-sensitivities", "--damping", 30


def written(tmp_path, static=0.6, more=""):
    """The three pulleys with a law of friction, and a torque on the accessory."""
    text = THREE.replace("[[pulley]]\n", "[[pulley]]\n" + LAW.format(static=static) + more)
    text = text.replace("accessory = 0.0", "accessory = 7.0")
    (tmp_path / "mine.toml").write_text(text)
    return "mine.toml"


def pulley_of(document, name):
    return next(one for one in document["pulleys"] if one["name"] == name)


@pytest.mark.slow
def test_nothing_slides(run, tmp_path):
    path = written(tmp_path, 0.7)
    status, out, err = run("squeal", path, *PLAIN, "--json", "s.json", "--figure", "s.png")
    assert (status, err) == (0, "")
    assert "no pulley slides on its whole arc" in out
    document = json.loads((tmp_path / "s.json").read_text())
    assert document["slides"] is document["squeals"] is False
    assert document["sensitivities"] is None
    drive, point = bj.load_drive(tmp_path / path)
    found = bj.slip_stability(drive, point, "accessory", damping=30.0)
    one = pulley_of(document, "accessory")
    for key in ("onset_speed", "fold_speed", "critical_damping"):
        assert one[key] == pytest.approx(float(getattr(found, key)), rel=1e-10), key
    hertz = float(found.squeal_frequency) / (2 * np.pi)
    assert one["squeal_hz"] == pytest.approx(hertz, rel=1e-10)
    whole = bj.slip_onset(drive, point, "accessory", damping=30.0, slopes=False)
    assert one["drive_onset_speed"] == pytest.approx(whole.speed, rel=1e-10)
    assert one["runaway_rate"] == pytest.approx(whole.runaway_rate, rel=1e-8)
    margin = bj.slip_margin(drive, point).static[2]
    assert one["slip_margin"] == pytest.approx(float(margin), rel=1e-12)
    assert one["dynamic_slip_margin"] is one["entry_angle_deg"] is None
    assert one["reason"] == "it does not slide on the whole arc"
    assert (tmp_path / "s.png").read_bytes().startswith(PNG)


def test_a_belt_that_slides_squeals_below_its_onset_alone(run, tmp_path):
    path = written(tmp_path, 0.2)
    status, out, err = run("squeal", path, *PLAIN, "--json", "-")
    document = json.loads(out)
    one = pulley_of(document, "accessory")
    assert status == 2
    assert one["slides"]
    assert one["squeals"]
    assert "pulley.accessory: the belt slides on accessory, and passes the onset of squeal" in err
    onset = one["onset_speed"]
    below, above = (f"{factor * onset} m/s" for factor in (0.9, 1.1))
    status, out, err = run("squeal", path, *PLAIN, "--sliding", below, "--json", "-")
    assert status == 2
    assert pulley_of(json.loads(out), "accessory")["growth"] > 0
    assert "at or below the onset" in err
    status, out, _ = run("squeal", path, *PLAIN, "--sliding", above, "--json", "-")
    found = json.loads(out)
    assert status == 0
    assert found["slides"]
    assert found["verdict"] == (
        "the belt slides on accessory, and is quiet: it slides faster than the onset speed"
    )
    assert pulley_of(found, "accessory")["growth"] < 0


@pytest.mark.slow
def test_vibration_makes_a_belt_slide(run, tmp_path):
    path = written(tmp_path, 0.5, 'offset = "1 mm"\n')
    text = (tmp_path / path).read_text().replace('offset = "1 mm"\n', "", 2)
    (tmp_path / path).write_text(text + '\n[excitation]\ncrank = "0.05 rad"\norder = 2\n')
    status, out, _ = run("squeal", path, *PLAIN, "--json", "-")
    document = json.loads(out)
    one = pulley_of(document, "accessory")
    assert one["dynamic_slip_margin"] < 0 < one["slip_margin"]
    assert one["slides"]
    assert status == 2
    drive, point = bj.load_drive(tmp_path / path)
    lengths = bj.reference_state(drive, point).layout.span_lengths
    angles = np.degrees(bj.entry_angles(drive, lengths))
    assert one["entry_angle_deg"] == pytest.approx(angles[1], rel=1e-12)
    _, out, _ = run("squeal", path, *PLAIN, "--crank", "1e-6 rad")
    assert "no pulley slides" in out


@pytest.mark.slow
def test_sensitivities(run, tmp_path):
    path = written(tmp_path, 0.7)
    status, out, _ = run("squeal", path, "--damping", 30, "--json", "-")
    found = json.loads(out)["sensitivities"]
    assert status == 0
    kinds = {name.partition(":")[0] for name in found}
    assert kinds == {"squeal_speed", "critical_damping", "slip_margin", "drive_squeal_speed"}
    drive, point = bj.load_drive(tmp_path / path)
    h = 1e-4
    onsets = [
        bj.slip_stability(drive, point, "accessory", damping=30.0 * (1 + c * h)).onset_speed
        for c in (-1, 1)
    ]
    slope = float(onsets[1] - onsets[0]) / (60.0 * h)
    for kind in ("squeal_speed", "drive_squeal_speed"):
        own = found[f"{kind}:accessory"]["belt.longitudinal_damping"]
        assert own == pytest.approx(slope, rel=1e-5 if kind == "squeal_speed" else 0.05)


@pytest.mark.parametrize(
    ("change", "words", "message"),
    [
        ("", ("--damping", 0), "--damping: found '0'; give a positive number"),
        ("", ("--damping", "5 m"), "--damping: "),
        ("", ("--sliding", "fast"), "--sliding: "),
        ("", (), "belt.longitudinal_damping: is missing; give it, or --damping"),
        (
            "friction_speed = 0.3\n",
            PLAIN,
            r"pulley.\w+.friction_speed: is missing; friction_static",
        ),
        ("friction_static = 0.6\n", PLAIN, "friction_speed: belongs beside friction_static"),
        ("friction = 0.15\n", PLAIN, r"pulley.\w+.friction: is missing; friction_static needs"),
    ],
)
def test_one_line_for_what_is_wrong(run, tmp_path, change, words, message):
    path = written(tmp_path)
    (tmp_path / path).write_text((tmp_path / path).read_text().replace(change, "", 1))
    status, out, err = run("squeal", path, *words)
    assert (status, out) == (1, "")
    assert re.search(message, err), err
    assert err.count("\n") == 1


def test_numbers_out_of_order(run, tmp_path):
    status, _, err = run("squeal", written(tmp_path, 0.1), *PLAIN)
    assert status == 1
    assert "friction_static: found 0.1, below friction, 0.15; exchange them" in err


def test_a_drive_that_does_not_run(run, tmp_path):
    path = written(tmp_path)
    text = (tmp_path / path).read_text().replace("accessory = 7.0", "accessory = 800.0")
    (tmp_path / path).write_text(text)
    status, out, err = run("squeal", path, *PLAIN, "--json", "-")
    document = json.loads(out)
    assert status == 2
    assert document["success"] is document["slides"] is False
    assert document["pulleys"] is None
    assert "mine.toml" in err


def test_files_keep_the_law(tmp_path):
    more = 'friction_law = "cubic"\noffset = "-1.5 mm"\n'
    drive, point = bj.load_drive(tmp_path / written(tmp_path, 0.6, more))
    assert float(drive.pulleys[0].offset) == pytest.approx(-0.0015)
    bj.save_drive(tmp_path / "again.toml", drive, point)
    again, _ = bj.load_drive(tmp_path / "again.toml")
    for one, other in zip(drive.pulleys, again.pulleys, strict=True):
        assert float(one.friction_law) == float(other.friction_law) == 1
        for name in ("friction", "friction_static", "friction_speed", "offset"):
            assert float(getattr(one, name)) == float(getattr(other, name)), name
    assert float(drive.pulleys[0].holding) == 0.6
    names = bj.optimize.value_of(drive, "pulley.accessory.friction_static")
    assert float(names) == 0.6


def test_friction_between_flanks(tmp_path):
    law = LAW.format(static=0.6)
    text = (tmp_path / written(tmp_path)).read_text()
    (tmp_path / "v.toml").write_text(text.replace(law, law + 'groove_angle = "60 deg"\n', 1))
    drive, _ = bj.load_drive(tmp_path / "v.toml")
    assert float(drive.pulleys[0].friction_static) == pytest.approx(1.2)
    assert float(drive.pulleys[0].friction) == pytest.approx(0.3)
