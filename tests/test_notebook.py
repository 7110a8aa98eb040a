"""The notebook of the examples runs from top to bottom, and what it shows is rich."""

import ast
import json
import re

import jax
import pytest
from drives import EXAMPLES

NOTEBOOK = EXAMPLES / "notebook.ipynb"


def shown(cell, names):
    """What a notebook shows of a cell: the value of its last line, if that is an expression."""
    tree = ast.parse("".join(cell["source"]))
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, str(NOTEBOOK), "exec"), names)
    return (
        None if last is None else eval(compile(ast.Expression(last.value), "cell", "eval"), names)
    )


def test_the_notebook_runs_and_shows_tables_and_pictures(monkeypatch, capsys):
    monkeypatch.chdir(EXAMPLES)
    jax.config.update("jax_enable_x64", True)
    cells = json.loads(NOTEBOOK.read_text())["cells"]
    names = {}
    values = [shown(cell, names) for cell in cells if cell["cell_type"] == "code"]
    drive, steady, state, heard, slopes, better = values
    assert "<svg" in drive._repr_html_()
    assert "<caption>SteadyState</caption>" in steady._repr_html_()
    assert all(one._repr_svg_().startswith("<svg") for one in (state, heard, better))
    # Wider pulleys bend the belt less: README.md, "What moves Gamma most".
    assert slopes["accessory"] < slopes["tensioner"] < 0
    before, after = map(float, re.findall(r"[\d.]+(?= before| after)", capsys.readouterr().out))
    assert before == pytest.approx(5.598, abs=5e-4)  # README.md prints 5.59785
    assert after < before


def test_the_notebook_is_kept_without_what_it_showed():
    """Outputs would go stale; a notebook shows them when it is opened."""
    for cell in json.loads(NOTEBOOK.read_text())["cells"]:
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None
