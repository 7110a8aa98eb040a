"""Pages opened in a browser as wide as a phone and a desktop: what they report of themselves."""

import functools
import http.server
import json
import re
import shutil
import subprocess
import tempfile
import threading
from pathlib import Path

import pytest

WIDTHS = {"phone": 390, "desktop": 1280}
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


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


def printed_pages(page, folder):
    """On how many sheets of paper a browser prints the page of that path."""
    if browser() is None:
        pytest.skip(f"no browser is installed ({', '.join(BROWSERS)})")
    paper = folder / "paper.pdf"
    words = ["--headless=new", "--no-sandbox", "--disable-gpu", "--no-pdf-header-footer"]
    words += [f"--user-data-dir={folder / 'profile'}", f"--print-to-pdf={paper}"]
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    subprocess.run([browser(), *words, page.as_uri()], **silent, check=True, timeout=120)
    return len(re.findall(rb"/Type /Page\b", paper.read_bytes()))
