"""Drives of many pulleys: what is found, in which time, and what is left out in so many words."""

import json
import math
import os
import re

import numpy as np
import pytest

import beltjax as bj
from beltjax.commands.reports.analyze import analyze_report


def ring(count):
    """A file of so many like pulleys on a circle."""
    lines = ['listed = "counterclockwise"\n[installation]\ntension = 300\n[operation]']
    lines += ["belt_speed = 5\n[belt]\naxial_stiffness = 1e5\nbending_stiffness = 0.01"]
    lines += ["mass_per_length = 0.1"]
    for i in range(count):
        x, y = (0.03 * count * f(2 * math.pi * i / count) for f in (math.cos, math.sin))
        lines.append(f'[[pulley]]\nname = "p{i}"\ncenter = [{x}, {y}]\nradius = 0.04')
        lines.append('face = "grooved"\ninertia = 0.001' + ("" if i else "\ndriver = true"))
    return "\n".join(lines)


@pytest.mark.parametrize(
    "words",
    [
        ("response", "--crank", "0.1 deg"),
        ("sweep", "--over", "belt.axial_stiffness=1e5:2e5:3"),
        ("analyze", "--figure", "modes.png"),
    ],
    ids=lambda words: words[0],
)
def test_modes_of_too_many_pulleys_are_refused_before_the_work(words, run, tmp_path):
    (tmp_path / "ring.toml").write_text(ring(41))
    status, out, err = run(words[0], "ring.toml", *words[1:])
    assert (status, out) == (1, "")
    assert re.search("ring.toml: pulley: found 41; .* are found for 40 at most", err)
    assert os.listdir(tmp_path) == ["ring.toml"]


@pytest.mark.slow
def test_a_hundred_pulleys_are_analyzed_without_modes(run, tmp_path):
    (tmp_path / "ring.toml").write_text(ring(100))
    status, out, _ = run("analyze", "ring.toml", "--json", "ring.json")
    assert status == 0
    assert "modes are left out: they are found for 40 pulleys at most, and there are 100" in out
    document = json.loads((tmp_path / "ring.json").read_text())
    assert document["success"]
    assert document["modes"] is None
    assert [one["code"] for one in document["warnings"]] == ["modes_left_out"]
    # Every span is like the others.
    np.testing.assert_allclose(document["steady"]["coupling"], document["steady"]["coupling"][0])


@pytest.mark.slow
def test_modes_of_many_pulleys_are_those_of_a_finer_basis(tmp_path):
    path = tmp_path / "ring.toml"
    path.write_text(ring(30))  # 16 functions a span
    drive, point = bj.load_drive(path)
    found = analyze_report(path).document["modes"]["dimensionless"]
    fine = bj.modes(bj.linearize(bj.steady_state(drive, point), bj.Legendre(24)), 8)
    np.testing.assert_allclose(found, fine.dimensionless, rtol=1e-5)
