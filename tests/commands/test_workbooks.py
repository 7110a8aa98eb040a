"""Tables as a workbook: what is printed, with numbers that a spreadsheet can sum."""

import importlib.util
import math

import openpyxl
import pytest
from rich.console import Group

from beltjax.commands.reports.tables import plain_table, xlsx_bytes

OPEN = """
name = "open belt"
[[pulley]]
name = "1e3"
center = [0, 0]
radius = "50 mm"
face = "grooved"
driver = true
[[pulley]]
name = "fan [left]"
center = ["400 mm", 0]
radius = "125 mm"
face = "grooved"
"""


def test_a_workbook_holds_what_is_printed(run, tmp_path):
    (tmp_path / "sheet.toml").write_text(OPEN)
    status, out, err = run("layout", "sheet.toml", "--xlsx", "out.xlsx", "--csv", "out.csv")
    assert (status, err) == (0, "")
    assert "wrote out.csv, out.xlsx" in out
    book = openpyxl.load_workbook(tmp_path / "out.xlsx")
    rows = [row for sheet in book for row in sheet.iter_rows(values_only=True)]
    span = next(row for row in rows if row[0] == "1e3-fan [left]")
    assert 400 * math.sqrt(1 - (75 / 400) ** 2) == pytest.approx(span[1], abs=0.005)
    pulleys = [row for row in rows if row[0] in ("1e3", "fan [left]")]
    assert len(pulleys) == 2  # names are text, whatever they look like
    assert sum(row[1] for row in pulleys) == pytest.approx(360.0, abs=0.02)  # both wraps


def test_titles_that_no_sheet_may_have_are_changed(tmp_path):
    tables = [plain_table("a/b: [c] " + 40 * "x", "=1", "n") for _ in range(2)]
    tables[0].add_row("=1", "-1.50e-03")
    (tmp_path / "out.xlsx").write_bytes(xlsx_bytes(Group(*tables)))
    book = openpyxl.load_workbook(tmp_path / "out.xlsx")
    assert [len(name) for name in book.sheetnames] == [31, 31]
    assert len(set(book.sheetnames)) == 2
    cells = next(iter(book.worksheets[0].iter_rows(min_row=2)))
    assert [cell.value for cell in cells] == ["=1", -0.0015]
    assert cells[0].data_type == "s"


def test_without_the_library_there_is_one_line(run, tmp_path, monkeypatch):
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "openpyxl" else found(name)
    )
    (tmp_path / "sheet.toml").write_text(OPEN)
    status, out, err = run("layout", "sheet.toml", "--xlsx", "out.xlsx")
    assert (status, out) == (1, "")
    assert "--xlsx: openpyxl is not installed: pip install 'beltjax[xlsx]'" in err
    assert err.count("\n") == 1
    assert not (tmp_path / "out.xlsx").exists()
