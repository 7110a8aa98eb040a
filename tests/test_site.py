"""The documentation as a site: it builds strictly, and pages need no network and do not overflow."""

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
    assert words("> " + bj.RESULTS[getattr(bj.RESULTS, name)]) in words(section)
    assert len(section.split("\n\n")) > 2, "the page adds what the text cannot say"


def test_every_public_name_has_its_place_on_the_api_page():
    page = (ROOT / "docs" / "api.md").read_text()
    listed = re.findall(r"^::: beltjax\.(\w+)$", page, flags=re.MULTILINE)
    public = re.findall(r" as (\w+)$", (ROOT / "beltjax/__init__.py").read_text(), re.MULTILINE)
    assert sorted([*listed, "RESULTS"]) == sorted(public)


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


# What a page finds out about itself; the answer is read from its title.
PROBE = """
<script>
window.problems = [];
addEventListener("error", e => problems.push(String(e.message || (e.target.src || e.target.href))), true);
const said = console.error; console.error = (...x) => {problems.push(x.join(" ")); said(...x)};
addEventListener("load", () => setTimeout(() => {
  const over = document.documentElement.scrollWidth - document.documentElement.clientWidth;
  const outside = performance.getEntriesByType("resource").map(e => e.name)
    .filter(name => !name.startsWith(location.origin) && !name.startsWith("data:")
                    && !name.startsWith("blob:"));
  const wide = [...document.querySelectorAll("article *")].filter(
    e => e.getBoundingClientRect().right > innerWidth + 1).slice(0, 3).map(e => e.outerHTML.slice(0, 80));
  const found = document.createElement("pre"); found.id = "probe";
  found.textContent = JSON.stringify({over, outside, problems, width: innerWidth, wide: over > 0 ? wide : []});
  document.body.append(found);
}, 500));
</script>
"""


class Probed(http.server.SimpleHTTPRequestHandler):
    """Serves the site with a probe put into every page."""

    def do_GET(self):
        path = Path(self.translate_path(self.path))
        if path.suffix == ".html" and path.is_file():
            content = path.read_text().replace("<head>", f"<head>{PROBE}", 1).encode()
            self.send_response(200)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)
        else:
            super().do_GET()

    def log_message(self, *_):
        pass


@pytest.fixture(scope="module")
def served(site):
    handler = functools.partial(Probed, directory=str(site))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
