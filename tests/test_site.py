"""The documentation as a site: it builds strictly, its pages need no network and fit a phone."""

import functools
import http.server
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import optimistix as optx
import pytest

import beltjax as bj

ROOT = Path(__file__).parents[1]
WIDTHS = {"phone": 390, "desktop": 1280}
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
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
    public = re.findall(r" as (\w+)$", (ROOT / "beltjax/__init__.py").read_text(), re.MULTILINE)
    assert sorted([*listed, "RESULTS"]) == sorted(public)
    listed = re.findall(r"^::: optimize\.(\w+)$", page, flags=re.MULTILINE)
    public = re.findall(r" as (\w+)$", (ROOT / "optimize/__init__.py").read_text(), re.MULTILINE)
    assert sorted([*listed, "lagrangian"]) == sorted(public)


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
    pages = sorted(site.glob("*.html"))
    sources = {path.stem for path in (ROOT / "docs").glob("*.md")}
    assert sources <= {page.stem for page in pages}
    for page in pages:
        text = page.read_text()
        # Links lead elsewhere; what a page is made of must not come from there.
        made_of = re.findall(r"<(?:script|img|iframe)[^>]*\ssrc=\"(https?:)?//", text)
        made_of += re.findall(r"<link[^>]*rel=\"(?:stylesheet|preconnect)\"[^>]*href=\"http", text)
        assert made_of == [], page
    assert "<math" in (site / "model.html").read_text()
    assert "$$" not in (site / "model.html").read_text()


@functools.cache
def browser():
    return next(filter(None, map(shutil.which, BROWSERS)), None)


# What each page finds out about itself. The policy below names every request to elsewhere.
POLICY = "default-src 'self' 'unsafe-inline' data: blob:"
PROBE = """<script>
window.problems = [];
const tell = what => problems.push(String(what));
addEventListener("error", e => tell(e.message || e.target.src || e.target.href), true);
addEventListener("unhandledrejection", e => tell(e.reason));
addEventListener("securitypolicyviolation", e => tell("request to " + e.blockedURI));
console.error = (...words) => tell(words.join(" "));
</script>"""
# Opens page after page in a frame as wide as the screen in question, and reports.
TOUR = """<!doctype html><body><script>
(async () => {
  const found = [];
  for (const page of PAGES) for (const [screen, width] of Object.entries(WIDTHS)) {
    const frame = document.createElement("iframe");
    frame.style = `width: ${width}px; height: 800px; border: 0`;
    frame.src = page;
    await new Promise(done => { frame.onload = done; document.body.append(frame); });
    await new Promise(done => setTimeout(done, 300));
    const root = frame.contentDocument.documentElement;
    found.push({page, screen, width: frame.contentWindow.innerWidth,
      sideways: root.scrollWidth - root.clientWidth, problems: frame.contentWindow.problems});
    frame.remove();
  }
  fetch("/__found", {method: "POST", body: JSON.stringify(found)});
})();
</script></body>"""


class Tour(http.server.ThreadingHTTPServer):
    """Serves the site with the probe in every page, and keeps what the tour reports."""

    def __init__(self, site):
        super().__init__(("127.0.0.1", 0), functools.partial(Page, directory=str(site)))
        self.pages = [f"/{page.name}" for page in sorted(site.glob("*.html"))]
        self.missing, self.found, self.done = [], [], threading.Event()


class Page(http.server.SimpleHTTPRequestHandler):
    """One request of the tour."""

    server: Tour  # pyright: ignore[reportIncompatibleVariableOverride]

    def do_GET(self):
        path = Path(self.translate_path(self.path))
        if self.path == "/__tour":
            tour = TOUR.replace("PAGES", json.dumps(self.server.pages))
            self.answer(tour.replace("WIDTHS", json.dumps(WIDTHS)))
        elif path.suffix == ".html" and path.is_file():
            self.answer(path.read_text().replace("<head>", f"<head>{PROBE}", 1), POLICY)
        else:
            super().do_GET()

    def answer(self, text, policy=None):
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        if policy:
            self.send_header("Content-Security-Policy", policy)
        self.end_headers()
        self.wfile.write(text.encode())

    def do_POST(self):
        self.server.found = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        self.send_response(204)
        self.end_headers()
        self.server.done.set()

    def send_error(self, code, *rest, **more):
        self.server.missing.append((code, self.path))
        super().send_error(code, *rest, **more)

    def log_message(self, format, *args):
        pass


def toured(site):
    """The server after a browser has been to every page of the folder."""
    if browser() is None:
        pytest.skip(f"no browser is installed ({', '.join(BROWSERS)})")
    with Tour(site) as server, tempfile.TemporaryDirectory() as profile:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        words = ["--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1400,900"]
        words += [f"--user-data-dir={profile}", "--no-first-run", "--disable-extensions"]
        address = f"http://127.0.0.1:{server.server_port}/__tour"
        silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        process = subprocess.Popen([browser(), *words, address], **silent)
        try:
            assert server.done.wait(180), "the browser did not come back from its tour"
        finally:
            process.terminate()
            process.wait(20)
            server.shutdown()
    return server


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
