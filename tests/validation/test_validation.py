"""The validation against the source: no printed number is left out, and none differs."""

import csv
import itertools
import sys
from collections import Counter
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest
import xarray

import beltjax as bj
from beltjax.validation import __main__ as command
from beltjax.validation import beam, deflections, spectra
from beltjax.validation.drives import as_printed
from beltjax.validation.plates import PICTURES
from beltjax.validation.printed import beam as printed_beam
from beltjax.validation.printed import contact as printed_contact
from beltjax.validation.printed import steady as printed_steady
from beltjax.validation.printed.value import Value
from beltjax.validation.verdicts import (
    AGREES,
    DIFFERS,
    MISPRINT,
    Line,
    compared,
    markdown_text,
    shown,
    summary,
)

# Numbers that the tables give as results; what they give as inputs is not compared.
NUMBERS = {"Table 2.1": 36, "Table 2.2": 8, "Table 3.2": 7, "Table 3.3": 8, "Table 4.1": 6}
OF_CONTACT = {"Table 5.1": 1, "Table 5.2": 24, "Table 5.3": 2}
FIGURES = [f"figure_2_{k:02d}" for k in (2, 3)]
FIGURES += [f"figure_3_{k:02d}" for k in range(3, 14)]
FIGURES += [f"figure_4_{k:02d}" for k in range(2, 11)]
FIGURES += [f"figure_5_{k:02d}" for k in range(4, 9)]


@pytest.fixture(scope="module")
def tables():
    return [*beam.tables(), *deflections.tables(), *spectra.tables()]


def test_no_printed_number_of_the_tables_differs(tables):
    assert [line for line in tables if line.verdict not in (AGREES, MISPRINT)] == []
    assert all(line.argument for line in tables if line.verdict == MISPRINT)


def test_every_printed_number_of_the_tables_is_compared(tables):
    counts = Counter(line.item for line in tables)
    assert {name: counts[name] for name in NUMBERS} == NUMBERS

    def compared_in(item):
        return Counter(line.printed for line in tables if line.item == item)

    waves = Counter(
        value.text
        for case in printed_beam.TABLE_2_1
        for row in (case.exact, case.leading)
        for value in (*row, *row[2:])  # r4 is printed as the conjugate of r3
    )
    assert compared_in("Table 2.1") == waves
    states = Counter(row[0].text for case in printed_steady.TABLE_3_3 for row in case[4:])
    assert compared_in("Table 3.3") == states


def test_a_verdict_allows_half_a_digit_and_no_more():
    assert compared("x", "y", Value("0.282"), 0.28249).verdict == AGREES
    assert compared("x", "y", Value("0.282"), 0.28251).verdict == DIFFERS
    listed = Value("0.282", "truncated")
    assert compared("x", "y", listed, 0.2829).verdict == MISPRINT
    # A misprint that is none must not hide in the list.
    assert compared("x", "y", listed, 0.2821).verdict == DIFFERS


def test_the_table_says_each_argument_once():
    lines = [compared("Fig. 1", "|w|", Value("1.0", "cut"), 1.2) for _ in range(2)]
    text = markdown_text([*lines, shown("Fig. 2", "T", 3.0)])
    assert text.count("cut") == 1
    assert text.count("known misprint (1)") == 2
    assert "| Fig. 1 | \\|w\\| | 1.0 | 1.200 |" in text
    assert summary(lines) == "0 agrees, 2 known misprint, 0 figure only, 0 differs"


def test_the_printed_angle_lies_within_the_rounding_of_the_printed_pivot():
    # The argument about beta_1 of Tables 3.2 and 4.1: half a digit of the pivot's y is 50 um.
    def angles(shift):
        moved = jax.numpy.array([0.0, shift])
        drive = eqx.tree_at(lambda d: d.tensioner.pivot, as_printed(), replace_fn=moved.__add__)
        return np.degrees(bj.alignment_angles(drive, bj.layout(drive))[0])

    one, two = sorted((angles(-50e-6)[0], angles(50e-6)[0]))
    assert one < printed_steady.ALIGNMENT[0].number < two


def test_the_printed_loaded_tensions_follow_from_held_angles():
    # The argument about P1 in Fig. 3.9. The belt on the pulleys unstretched and the angles held,
    # P3 - P1 = d gives P1 = 1 - l3 d/(sum l + gamma r_t D^2/k_s).
    p = printed_steady
    lengths = np.array([value.number for value in p.SPAN_LENGTHS])
    one, two = np.sin(np.radians(p.BETA))
    arm = p.STRETCH * p.ARM * (one - two) ** 2 / p.SPRING

    def least(d):
        return 1 - lengths[2] * d / (lengths.sum() + arm)

    assert Value(str(p.LOADED[0])).matches(least(p.LOADED[2] - p.LOADED[0]))
    largest = p.LARGEST_TORQUE / (p.RADII[0] * p.TENSION)
    assert Value("0.8589").matches(least(largest))


@pytest.mark.parametrize("words", [["--out", "there/file"], ["--out", "/proc/no"], [], ["--our"]])
def test_bad_arguments_end_in_one_line(words, tmp_path, monkeypatch, capsys):
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "file").write_text("kept")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["validation", *words])
    with pytest.raises(SystemExit) as end:
        command.run()
    assert end.value.code == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1
    assert [path.name for path in tmp_path.rglob("*")] == ["there", "file"]


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_whole_command(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["validation", "--out", str(tmp_path / "new" / "folder")])
    with pytest.raises(SystemExit) as end:
        command.run()
    assert end.value.code == 0
    folder = tmp_path / "new" / "folder"
    expected = {f"{name}.{kind}" for name in FIGURES for kind in (*PICTURES, "nc")}
    expected |= {f"table_{name[6]}_{name[8]}.csv" for name in NUMBERS | OF_CONTACT}
    assert {path.name for path in folder.iterdir()} == expected | {"verdicts.csv", "verdicts.md"}
    for name in FIGURES:
        assert all((folder / f"{name}.{kind}").stat().st_size > 5000 for kind in PICTURES)
        with xarray.open_dataset(folder / f"{name}.nc", engine="scipy") as data:
            for variable in data.data_vars.values():
                if variable.dtype.kind == "f":
                    assert np.isfinite(variable).mean() > 0.3, (name, variable.name)
                    assert "units" in variable.attrs
    with (folder / "verdicts.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["verdict"] for row in rows} == {AGREES, MISPRINT, "figure only"}
    counts = Counter(row["item"] for row in rows)
    wanted = NUMBERS | OF_CONTACT
    assert {name: counts[name] for name in wanted} == wanted
    angles = itertools.chain.from_iterable(printed_contact.FIGURE_5_7.values())
    texts = Counter(known[0].text for known in angles)
    assert texts <= Counter(row["printed"] for row in rows if row["item"] == "Fig. 5.7")
    page = (Path(__file__).parents[2] / "docs" / "validation.md").read_text()
    table = markdown_text(Line(**row) for row in rows if row["verdict"] != "figure only")
    assert table in page, "bring the page up to date: docs/images/make_validation.py"
    drawn = {row["item"].removeprefix("Fig. ") for row in rows if row["item"].startswith("Fig. ")}
    assert {f"figure_{c}_{int(k):02d}" for c, k in (one.split(".") for one in drawn)} == set(
        FIGURES
    )
