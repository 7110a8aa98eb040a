"""The code blocks of the documentation's pages run, and their assertions hold."""

import ast
import doctest
import re
import shutil
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies_cases import LEVER, load

import beltjax as bj
from beltjax.drive import file_reference
from beltjax.drive.files import load_geometry

ROOT = Path(__file__).parents[1]
BLOCKS = {
    "bvp": 4,
    "contact": 5,
    "cushion": 1,
    "derivatives": 7,
    "documents": 1,
    "drive_file": 1,
    "exploration": 6,
    "extending": 5,
    "first_drive": 2,
    "grooves": 4,
    "model": 1,
    "moving_beam": 4,
    "optimizing": 3,
    "periodic": 10,
    "reading": 3,
    "robust": 4,
    "several_tensioners": 11,
    "squeal": 4,
    "stability": 4,
    "studio": 2,
    "transient": 4,
    "troubleshooting": 1,
    "vibration": 4,
}
WRITTEN = {
    "vibration": ["sweep.nc"],
    "drive_file": ["copy.toml"],
    "studio": ["steady.svg"],
    "extending": ["study.toml"],
    "exploration": ["sample.zarr", "grid.zarr"],
    "several_tensioners": ["one_arm.toml", "chain.toml", "two_belts.toml"],
}


STUDY_TABLES = (
    bj.optimize.study_file.VariableTable,
    bj.optimize.study_file.TieTable,
    bj.optimize.study_file.ConstraintTable,
    bj.optimize.study_file.ObjectiveTable,
    bj.optimize.study_file.ChoiceTable,
    bj.optimize.study_file.ParetoTable,
    bj.optimize.study_file.OptimizerTable,
    bj.optimize.study_file.StudyTable,
)


def blocks_of(page, language):
    text = page.read_text()
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def test_no_page_with_code_is_left_out():
    pages = {page.stem: blocks_of(page, "python") for page in (ROOT / "docs").glob("*.md")}
    assert {name: len(blocks) for name, blocks in pages.items() if blocks} == BLOCKS


def test_the_first_drive_is_one(tmp_path):
    (drive_file,) = blocks_of(ROOT / "docs" / "first_drive.md", "toml")
    (tmp_path / "mine.toml").write_text(drive_file)
    drive, point = bj.load_drive(tmp_path / "mine.toml")
    rest = bj.reference_state(drive, point)
    # As the page says, the idler is on the slack side, behind the crankshaft.
    assert rest.tensions[1] == rest.tensions[2] < rest.tensions[0]


def test_the_study_of_the_page_is_one(tmp_path):
    study_file, points, _ = blocks_of(ROOT / "docs" / "optimizing.md", "toml")
    (tmp_path / "study.toml").write_text(study_file)
    for name in ("three_pulley", "seven_pulley"):
        shutil.copy(ROOT / "examples" / f"{name}.toml", tmp_path)
    assert len(bj.optimize.load_study(tmp_path / "study.toml").variables.names) == 2
    seven = study_file.replace("three_pulley", "seven_pulley").replace("accessory", "alternator")
    (tmp_path / "seven.toml").write_text(seven + points)
    assert bj.optimize.load_study(tmp_path / "seven.toml").cases.names == ("idle", *4 * ["driving"])


def keys_of(table):
    for name, field in table.model_fields.items():
        yield field.alias or name


def test_every_key_and_optimizer_of_a_study_is_on_its_page():
    page = (ROOT / "docs" / "optimizing.md").read_text()
    keys = {key for table in STUDY_TABLES for key in keys_of(table)}
    for key in keys:
        assert any(mark in page for mark in (f"`{key}`", f"`[{key}]`", f"`[[{key}]]`")) or (
            key == "option" and "[[choice.option]]" in page
        ), key
    for name in bj.optimize.optimizer_names():
        assert f'`"{name}"`' in page, name


def test_the_page_of_the_drive_file_says_what_stands_beside_its_keys():
    page = file_reference.PAGE.read_text()
    assert file_reference.with_tables(page) == page, "run python -m beltjax.drive.file_reference"


def test_the_tensioners_of_the_page_are_some(tmp_path):
    blocks = blocks_of(ROOT / "docs" / "drive_file.md", "toml")
    (tensioners,) = (block for block in blocks if block.startswith("[[tensioner]]"))
    before, after = LEVER.split("[[tensioner]]", 1)[0], LEVER[LEVER.index("[installation]") :]
    drive, _ = load(tmp_path, before + tensioners + after)
    assert [body.name for body in drive.tensioners] == ["housing", "lever"]


def test_the_loads_and_duties_of_the_page_are_some(tmp_path):
    blocks = blocks_of(ROOT / "docs" / "drive_file.md", "toml")
    loads, duties = (block for block in blocks if block.startswith("[operation.load."))
    drive_file = (ROOT / "examples" / "seven_pulley.toml").read_text().replace("water pump", "pump")
    before = drive_file[: drive_file.index("[operation]")]
    drive, point = load(tmp_path, before + '[operation]\ndriver_speed = "750 rpm"\n' + loads)
    # The alternator turns 75/27 times as fast, between the first two speeds of its table.
    taken = dict(zip(drive.pulley_names, point.torques(drive).tolist(), strict=True))
    assert 800 < taken["alternator"] * 25 * np.pi * 75 / 27 < 2100
    assert taken["tensioner"] == pytest.approx(0.05)
    load(tmp_path, before + duties)
    _, named = bj.load_duties(tmp_path / "drive.toml")
    assert list(named) == ["idle", "full load"]
    assert float(named["full load"].load["alternator"].power) == 3000.0


def test_the_drives_of_the_page_are_read(tmp_path):
    blocks = blocks_of(ROOT / "docs" / "drive_file.md", "toml")
    drives = [block for block in blocks if "[[pulley]]" in block]
    for block in drives:
        read = load if "[operation]" in block else geometry
        read(tmp_path, block)
    assert len(drives) >= 2


def geometry(folder, text):
    (folder / "sheet.toml").write_text(text)
    return load_geometry(folder / "sheet.toml")


def examples_of(function):
    return doctest.DocTestParser().get_examples(function.__doc__ or "")


PUBLIC = {name: getattr(home, name) for home in (bj, bj.optimize) for name in dir(home)}
WITH_EXAMPLES = sorted(name for name, thing in PUBLIC.items() if examples_of(thing))


@pytest.mark.slow
@pytest.mark.timeout(900)  # one runs a study
@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples_of_docstrings_run(name, monkeypatch, own_registries):
    monkeypatch.chdir(ROOT)
    names: dict = {"bj": bj, "jax": jax, "jnp": jnp}
    shown: list = []
    monkeypatch.setattr(sys, "displayhook", shown.append)
    examples = examples_of(PUBLIC[name])
    for example in examples:
        exec(compile(example.source, name, "single"), names)
    last = ast.parse(examples[-1].source).body[-1]
    if not isinstance(last, ast.Expr):  # what it defines is what it is about
        assert isinstance(last, ast.FunctionDef | ast.ClassDef)
        assert last.name in names
        return
    results = shown[-1] if isinstance(shown[-1], tuple) else (shown[-1],)
    assert not any(result is None for result in results)
    for result in results:
        if isinstance(result, float | np.ndarray | jax.Array):
            assert np.isfinite(result).all(), examples[-1].source


@pytest.mark.slow  # up to a minute each, most of it compiling
@pytest.mark.parametrize("name", BLOCKS)
def test_code_blocks_run(name, tmp_path, monkeypatch, own_registries):
    page = ROOT / "docs" / f"{name}.md"
    if name == "first_drive":
        (drive_file,) = blocks_of(page, "toml")
        (tmp_path / "mine.toml").write_text(drive_file)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for block in blocks_of(page, "python"):
        exec(compile(block, str(page), "exec"), names)
    assert all((tmp_path / file).exists() for file in WRITTEN.get(name, []))
