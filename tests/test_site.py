"""The documentation as a site: it builds strictly, its pages need no network and fit a phone."""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import optimistix as optx
import pytest
from browser import WIDTHS, toured

import beltjax as bj

ROOT = Path(__file__).parents[1]
NAMES = sorted(set(bj.RESULTS._name_to_item) - set(optx.RESULTS._name_to_item))


def words(text):
    return " ".join(text.replace("\n>", " ").split())


@pytest.mark.parametrize("name", NAMES)
def test_every_result_is_explained_by_its_own_text(name):
    page = (ROOT / "docs" / "troubleshooting.md").read_text()
    section = page.split(f"\n### `{name}`\n")[1].split("\n##")[0]
    assert words(bj.RESULTS[getattr(bj.RESULTS, name)]) in words(section)
    assert len(section.strip().split("\n\n")) == 2, "the text, and what it cannot say"


def test_every_public_name_has_its_place_on_the_api_page():
    page = (ROOT / "docs" / "api.md").read_text()
    listed = re.findall(r"^::: beltjax\.(\w+)$", page, flags=re.MULTILINE)
    public = re.findall(r" as (\w+)$", (ROOT / "beltjax/__init__.pyi").read_text(), re.MULTILINE)
    assert sorted([*listed, "RESULTS", "optimize"]) == sorted(public)
    listed = re.findall(r"^::: optimize\.(\w+)$", page, flags=re.MULTILINE)
    public = re.findall(r" as (\w+)$", (ROOT / "optimize/__init__.py").read_text(), re.MULTILINE)
    assert sorted([*listed, "augmented_lagrangian"]) == sorted(public)


@pytest.fixture(scope="module")
def site():
    pytest.importorskip("mkdocs", reason="the site needs pip install -e '.[docs]'")
    with tempfile.TemporaryDirectory() as folder:
        words = ["-m", "mkdocs", "build", "--strict", "--site-dir", folder]
        environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
        built = subprocess.run(
            [sys.executable, *words], cwd=ROOT, env=environment, capture_output=True, text=True
        )
        assert built.returncode == 0, built.stderr
        yield Path(folder)


@pytest.mark.slow
def test_the_site_builds_strictly_and_asks_nothing_of_the_network(site):
    pages = sorted(site.rglob("*.html"))
    sources = {path.relative_to(ROOT / "docs") for path in (ROOT / "docs").rglob("*.md")}
    assert {str(path.with_suffix(".html")) for path in sources} <= {
        str(page.relative_to(site)) for page in pages
    }
    for page in pages:
        text = page.read_text()
        # Links lead elsewhere; what a page is made of must not come from there.
        made_of = re.findall(r"<(?:script|img|iframe)[^>]*\ssrc=\"(https?:)?//", text)
        made_of += re.findall(r"<link[^>]*rel=\"(?:stylesheet|preconnect)\"[^>]*href=\"http", text)
        assert made_of == [], page
        # A command of LaTeX that the converter does not know is shown as it stands.
        assert re.findall(r"<m[ion][^>]*>\\[a-zA-Z]+", text) == [], page
    assert "<math" in (site / "model.html").read_text()
    assert "$$" not in (site / "model.html").read_text()


@pytest.fixture(scope="module")
def tour(site):
    return toured(site)


@pytest.mark.slow
@pytest.mark.parametrize("screen", WIDTHS)
def test_pages_fit_the_screen_and_run_without_errors(tour, screen):
    found = [one for one in tour.found if one["screen"] == screen]
    assert len(found) == len(tour.pages) > 15
    assert {one["width"] for one in found} == {WIDTHS[screen]}
    assert [one for one in found if one["sideways"] > 0] == []
    assert [one for one in found if one["problems"]] == []


@pytest.mark.slow
def test_pages_find_all_their_parts(tour):
    assert [one for one in tour.missing if "favicon" not in one[1]] == []


@pytest.mark.slow
def test_the_tour_sees_what_is_wrong_with_a_page(tmp_path):
    bad = (
        '<img src="http://example.com/x.png"><img src="gone.png"><div style="width: 3000px">x</div>'
    )
    bad += '<script>console.error("said"); throw new Error("thrown")</script>'
    (tmp_path / "bad.html").write_text(f"<html><head></head><body>{bad}</body></html>")
    server = toured(tmp_path)
    for found in server.found:
        assert found["sideways"] > 1000
        problems = " ".join(found["problems"])
        for what in ("said", "thrown", "request to http://example.com/x.png"):
            assert what in problems
    assert {path for _, path in server.missing} >= {"/gone.png"}
