"""Tolerances on the command line: the same numbers as in Python, and one line for an error."""

import json
import re

import numpy as np
import pytest
from drives import EXAMPLES, example

import beltjax as bj

DRIVE = EXAMPLES / "three_pulley.toml"


@pytest.mark.slow
def test_command_is_the_function(run, tmp_path):
    words = "--within", "installation.tension=30", "--deviation", "tensioner.angle=8 deg"
    words += "--quantity", "coupling", "--quantity", "hub_load:accessory", "--samples", 512
    status, out, err = run("robust", DRIVE, *words, "--indices", "--json", "r.json")
    assert (status, err) == (0, "")
    kinds = {
        "installation.tension": bj.optimize.Uniform(30.0),
        "tensioner.angle": bj.optimize.Normal(np.radians(8)),
    }
    names = ("coupling", "hub_load:accessory")
    found = bj.optimize.robustness(*example("three_pulley"), names, kinds, samples=512)
    document = json.loads((tmp_path / "r.json").read_text())
    for row in document["quantities"]:
        spread = found.spreads[row["name"]]
        assert {key: row[key] for key in spread._asdict()} == spread._asdict()
        assert row["indices"].keys() == kinds.keys()
    assert (document["failed"], document["samples"]) == (0, 512)
    assert re.search(r"coupling +[\d.]+ +[\d.]+", out)
    assert "Share of the variance, interactions included" in out


BAD = {
    "nothing": ([], r"--within: is missing; give at least one tolerance"),
    "no such number": (["--within", "noise=1"], r"--within: there is no number 'noise'"),
    "twice": (["--within", "installation.tension=1", "--deviation", "installation.tension=1"], r"--deviation: 'installation\.tension' is given twice"),
    "no size": (["--within", "installation.tension=0"], r"--within installation\.tension: found '0'; a tolerance is positive"),
    "wrong unit": (["--within", "installation.tension=1 mm"], r"found '1 mm', whose unit is not N"),
    "no equals sign": (["--within", "installation.tension"], r"--within: .* give NAME=SIZE"),
    "no such quantity": (["--within", "installation.tension=1", "--quantity", "noise"], r"there is no quantity 'noise'"),
    "quantile": (["--within", "installation.tension=1", "--quantile", "0.3"], r"quantile: found 0\.3; give more than 0\.5"),
    "seed": (["--within", "installation.tension=1", "--seed", "-2"], r"'--seed': -2 is not in the range x>=0"),
    "huge sample": (["--within", "installation.tension=1", "--samples", "100000000000000"], r"samples: found 10{14}, 8e\+05 GB for each copy of its numbers; give at most 2\^24"),
    "samples": (["--within", "installation.tension=1", "--samples", "1"], r"samples: found 1; give at least 2"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_question_is_one_line_and_writes_nothing(case, run, tmp_path):
    words, says = BAD[case]
    status, out, err = run("robust", DRIVE, *words, "--json", "r.json")
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert re.search(says, err)
    assert list(tmp_path.iterdir()) == []
