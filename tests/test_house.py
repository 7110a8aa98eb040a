"""The house keeps its plan: who may import whom, and every folder of code is installed."""

import ast
import collections
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# A package may import those that stand in its own row. A row of a folder inside another one
# holds for that folder alone.
ALLOWED = {
    "files": {"files"},
    "compiling": {"files", "compiling"},
    "numerics": {"compiling", "numerics", "results"},
    "physics": {"compiling", "numerics", "physics", "results"},
    "drive": {"files", "compiling", "numerics", "drive", "results"},
    "analysis": {"files", "compiling", "numerics", "physics", "drive", "analysis", "results"},
    "optimize": {"files", "compiling", "numerics", "drive", "analysis", "results"},
    "draw": {"files", "drive", "analysis", "optimize", "draw"},
    "commands": {
        "files",
        "compiling",
        "numerics",
        "drive",
        "analysis",
        "optimize",
        "draw",
        "commands",
        "studio",
        "results",
    },
    # One command, with the reports of the others; nothing else knows it.
    "studio": {
        "files",
        "compiling",
        "numerics",
        "drive",
        "analysis",
        "optimize",
        "draw",
        "commands",
        "studio",
        "results",
    },
    # It compares the models themselves with print.
    "validation": {"files", "compiling", "numerics", "physics", "analysis", "draw", "validation"},
    # A second route shares no method with the first: it takes the model's numbers alone.
    "validation/peers": {"physics", "validation"},
}


def imported(path):
    """Packages of beltjax that a module imports, at the top or anywhere inside."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level == 0:
            names = [node.module or ""]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        for name in names:
            words = name.split(".")
            if words[0] == "beltjax" and len(words) > 1:
                yield words[1]


@pytest.mark.parametrize("package", ALLOWED)
def test_imports_point_one_way(package):
    folder = ROOT / "optimize" if package == "optimize" else ROOT / "beltjax" / package
    rows = [ROOT / "beltjax" / other for other in ALLOWED if other.startswith(f"{package}/")]
    for path in folder.rglob("*.py"):
        if not any(path.is_relative_to(row) for row in rows):
            assert set(imported(path)) <= ALLOWED[package], path


def test_every_folder_of_code_is_installed():
    config = tomllib.loads((ROOT / "pyproject.toml").read_text())
    listed = set(config["tool"]["setuptools"]["packages"])
    found = {
        ".".join(path.parent.relative_to(ROOT).parts)
        for path in (ROOT / "beltjax").rglob("__init__.py")
    }
    found |= {
        ".".join(("beltjax", *path.parent.relative_to(ROOT).parts))
        for path in (ROOT / "optimize").rglob("__init__.py")
    }
    assert listed == found


def modules():
    """Path and syntax tree of every module of the package."""
    for folder in ("beltjax", "optimize"):
        for path in (ROOT / folder).rglob("*.py"):
            yield path, ast.parse(path.read_text())


def test_no_two_classes_have_one_name():
    homes = collections.defaultdict(set)
    for path, tree in modules():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                homes[node.name].add(path)
    twice = {name for name, paths in homes.items() if len(paths) > 1}
    assert twice == set()


def test_every_function_is_annotated():
    for path, tree in modules():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef):
                given = node.args
                listed = [*given.posonlyargs, *given.args, *given.kwonlyargs]
                listed += [one for one in (given.vararg, given.kwarg) if one is not None]
                bare = [one.arg for one in listed if one.annotation is None]
                assert set(bare) <= {"self", "cls"}, (path, node.name)
                special = node.name.startswith("__") and node.name.endswith("__")
                assert special or node.returns is not None, (path, node.name)


def test_tests_do_not_import_from_the_benchmarks():
    benchmarks = {path.stem for path in (ROOT / "benchmarks").glob("*.py")}
    for path in (ROOT / "tests").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.level == 0:
                assert (node.module or "").split(".")[0] not in benchmarks, path
            elif isinstance(node, ast.Import):
                assert not benchmarks & {alias.name.split(".")[0] for alias in node.names}, path


def test_no_file_is_too_long():
    for folder in ("beltjax", "optimize", "tests", "benchmarks"):
        for path in (ROOT / folder).rglob("*.py"):
            assert len(path.read_text().splitlines()) < 600, path
