"""Cushions in drive files, and in what `beltjax analyze` says."""

import json

import numpy as np
import pytest
from drives import EXAMPLES

import beltjax as bj

TABLE = (EXAMPLES / "two_pulley_table_5_1.toml").read_text()
KEY = 'cushion = { radial = "20 N/mm^2", shear = 1.5e7 }'


def with_cushion(text, key=KEY):
    return text.replace("[belt]", f"[belt]\n{key}", 1)


def test_a_cushion_is_read_and_saved(tmp_path):
    path, copy = tmp_path / "soft.toml", tmp_path / "copy.toml"
    path.write_text(
        with_cushion(TABLE).replace('name = "driven"', 'name = "driven"\ncushion = false')
    )
    drive, point = bj.load_drive(path)
    assert float(drive.belt.cushion_radial) == 2e7
    assert float(drive.belt.cushion_shear) == 1.5e7
    assert [float(pulley.cushion) for pulley in drive.pulleys] == [1.0, 0.0]
    bj.save_drive(copy, drive, point)
    again, _ = bj.load_drive(copy)
    assert repr(again.belt) == repr(drive.belt)
    assert float(again.pulleys[1].cushion) == 0.0


@pytest.mark.parametrize(
    ("key", "where", "says"),
    [
        ("cushion = { radial = 2e7 }", "belt.cushion", "give cushion = { radial"),
        ("cushion = { radial = 2e7, sheer = 2e7 }", "belt.cushion.sheer", "radial, shear"),
        ("cushion = { radial = 0, shear = 2e7 }", "belt.cushion_radial", "greater than 0"),
        ('cushion = { radial = "20 N/mm", shear = 2e7 }', "belt.cushion_radial", "N/m"),
        ("cushion = 2e7", "belt.cushion", ""),
        (
            f'{KEY}\ngroove = {{ angle = "40 deg", wedge_stiffness = 6e6 }}',
            "belt.cushion",
            "beside groove",
        ),
    ],
)
def test_a_wrong_cushion_is_one_line(key, where, says, tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text(with_cushion(TABLE, key))
    with pytest.raises(bj.FileError) as caught:
        bj.load_drive(path)
    message = str(caught.value)
    assert caught.value.key == where, message
    assert says in message
    assert "\n" not in message


@pytest.mark.slow
def test_analyze_shows_both_models(run, tmp_path):
    three = with_cushion((EXAMPLES / "three_pulley.toml").read_text())
    (tmp_path / "soft.toml").write_text(three)
    status, out, err = run("analyze", "soft.toml", "--json", "soft.json")
    assert (status, err) == (0, "")
    assert "On the cushion" in out
    part = json.loads((tmp_path / "soft.json").read_text())["cushion"]
    drive, point = bj.load_drive(tmp_path / "soft.toml")
    state = bj.cushion_state(drive, point)
    found = bj.modes(bj.linearize(state), 8).frequencies / (2 * np.pi)
    assert part["hertz"] == pytest.approx(found.tolist(), rel=1e-9)
    tensions = [span["tension"] for span in part["spans"]]
    assert tensions == pytest.approx(state.tensions.tolist(), rel=1e-9)
    assert part["coupling_total"] == pytest.approx(float(state.coupling.sum()), rel=1e-9)
    assert part["efficiency"] is None
    # What cannot be counted is said, and everything else is as without it.
    (tmp_path / "weak.toml").write_text(three.replace('"20 N/mm^2"', '"0.2 N/mm^2"'))
    status, out, err = run("analyze", "weak.toml", "--json", "weak.json")
    weak = json.loads((tmp_path / "weak.json").read_text())
    assert weak["cushion"] is None
    assert weak["warnings"][-1]["code"] == "cushion_left_out"
    assert "sinks through its cushion" in weak["warnings"][-1]["text"]
