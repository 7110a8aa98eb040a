"""The report of `beltjax analyze`: its numbers are the document's, and it prints on two sheets."""

import html
import json
import math
import re

import pytest
from browser import printed_pages, toured
from drives import EXAMPLES

SEVEN = EXAMPLES / "seven_pulley_duties.toml"


def reported(run, tmp_path, drive):
    status, _, err = run("analyze", drive, "--report", "r.html", "--json", "o.json")
    document = json.loads((tmp_path / "o.json").read_text())
    return status, err, document, (tmp_path / "r.html").read_text()


def tables_of(page):
    """Rows of cells of each table, by its caption, or the head of its first column."""
    found = {}
    for table in re.findall(r"<table>(.*?)</table>", page, re.DOTALL):
        caption = re.search(r"<caption>(.*?)</caption>", table)
        rows = [
            [html.unescape(cell) for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row)]
            for row in re.findall(r"<tr>(.*?)</tr>", table, re.DOTALL)
        ]
        found[caption[1] if caption else rows[0][0]] = rows
    return found


@pytest.mark.slow
def test_a_report_of_duties_shows_them_side_by_side(run, tmp_path):
    status, err, document, page = reported(run, tmp_path, SEVEN)
    assert (status, err) == (0, "")
    assert "http" not in page.replace("http://www.w3.org", "")  # names of XML, not addresses
    assert page.count("<svg") == 3
    tables = tables_of(page)
    names = [duty["name"] for duty in document["duties"]]
    assert names == ["parking", "cruise", "top speed"]
    heads, *rows = tables["Hub load (N)"]
    assert heads == ["pulley", *names]
    for k, row in enumerate(rows):
        loads = [math.hypot(*duty["pulleys"][k]["hub_load"]) for duty in document["duties"]]
        assert row == [document["pulleys"][k]["name"], *(f"{load:.0f}" for load in loads)]
    # By hand: parking has the greatest torques, and takes nearly all of the crankshaft's friction.
    worst = {row[0]: row for row in tables["Worst of the duties"]}
    assert worst["greatest running tension"][3:] == ["air conditioner-crankshaft", "parking"]
    assert worst["least slip margin"][3:] == ["crankshaft", "parking"]
    # One percent of a number, in percent of the result: its logarithmic derivative.
    heads, *moves = tables["number"]
    first, hertz = moves[0], document["modes"]["hertz"]
    assert heads[1:] == ["Gamma", *(f"mode {k} ({hertz[k - 1]:.1f} Hz)" for k in (1, 2, 3))]
    radius = next(row for row in moves if row[0] == "pulley.alternator.radius")
    slopes = document["sensitivities"]
    key = "pulley.alternator.radius"
    gamma = slopes["coupling_total"][key] * 0.027 / document["steady"]["coupling_total"]
    lowest = slopes["frequencies"][key][0] * 0.027 / (2 * math.pi * hertz[0])
    assert radius[1:3] == [f"{gamma:+.3f}", f"{lowest:+.3f}"]
    assert max(map(abs, map(float, first[1:]))) >= abs(float(radius[1]))


def test_a_report_of_one_operation_has_the_printed_tables(run, tmp_path):
    status, _, document, page = reported(run, tmp_path, EXAMPLES / "three_pulley.toml")
    assert status == 0
    tables = tables_of(page)
    tension = document["spans"][0]["tension"]
    assert tables["span"][1][3] == f"{tension:.1f}"
    total = document["steady"]["coupling_total"]
    assert tables["quantity"][1][:2] == ["coupling Gamma, all spans", f"{total:.4f}"]
    assert "Duties" not in page


def test_a_report_of_a_drive_that_does_not_run_says_so(run, tmp_path):
    text = (EXAMPLES / "three_pulley.toml").read_text()
    (tmp_path / "slack.toml").write_text(text.replace("accessory = 0.0", "accessory = -40.0"))
    status, err, _, page = reported(run, tmp_path, "slack.toml")
    assert status == 2
    assert "is slack at rest" in err
    assert html.escape("is slack at rest") in page
    assert page.count("<svg") == 1  # the layout


@pytest.mark.slow
@pytest.mark.parametrize("name", ["three_pulley", "seven_pulley", "seven_pulley_duties"])
def test_a_report_fits_two_sheets_and_a_phone(run, tmp_path, name):
    *_, page = reported(run, tmp_path, EXAMPLES / f"{name}.toml")
    (tmp_path / "pages").mkdir()
    (tmp_path / "pages" / "r.html").write_text(page)
    assert printed_pages(tmp_path / "pages" / "r.html", tmp_path) == 2
    server = toured(tmp_path / "pages")
    assert [one["screen"] for one in server.found] == ["phone", "desktop"]
    assert all(one["sideways"] == 0 and one["problems"] == [] for one in server.found)
