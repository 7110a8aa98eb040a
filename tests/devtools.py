"""A real browser, driven by its own protocol: pointer and keys as a person's, and what it asks."""

import base64
import contextlib
import json
import subprocess
import tempfile
import time
import urllib.request
from pathlib import Path

import pytest
from browser import BROWSERS, browser


@contextlib.contextmanager
def chromium():
    """A headless browser; the address of its protocol."""
    if browser() is None:
        pytest.skip(f"no browser is installed ({', '.join(BROWSERS)})")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        words = ["--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0"]
        words += [f"--user-data-dir={profile}", "--no-first-run", "--disable-extensions"]
        words += ["--disable-background-networking", "--disable-component-update"]
        silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        process = subprocess.Popen([browser(), *words, "about:blank"], **silent)
        try:
            port = _waited(lambda: _port(Path(profile)), 60, "the browser did not start")
            yield f"http://127.0.0.1:{port}"
        finally:
            process.terminate()
            process.wait(20)


def _port(profile):
    named = profile / "DevToolsActivePort"
    return named.read_text().splitlines()[0] if named.is_file() and named.read_text() else None


def _waited(ask, limit, what):
    end = time.monotonic() + limit
    while time.monotonic() < end:
        found = ask()
        if found:
            return found
        time.sleep(0.03)
    raise AssertionError(what)


class Tab:
    """One page, of a screen of that size; `problems` and `requests` are what it told."""

    def __init__(self, at, address, width, height):
        from websockets.sync.client import connect

        ask = urllib.request.Request(f"{at}/json/new?about:blank", method="PUT")
        self._open = contextlib.ExitStack()
        with urllib.request.urlopen(ask) as answer:
            address_of_tab = json.load(answer)["webSocketDebuggerUrl"]
        self._socket = self._open.enter_context(
            connect(address_of_tab, max_size=2**27, ping_interval=None)
        )
        self._count, self.problems, self.requests, self.downloads = 0, [], [], []
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")
        phone = width < 600
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height,
                  deviceScaleFactor=1, mobile=phone)  # fmt: skip
        self.call("Page.navigate", url=address)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        with contextlib.suppress(Exception):
            self.call("Page.close")
        self._open.close()

    def call(self, method, **given):
        """The result of a method of the protocol."""
        self._count += 1
        self._socket.send(json.dumps({"id": self._count, "method": method, "params": given}))
        while True:
            message = json.loads(self._socket.recv(timeout=120))
            if message.get("id") == self._count:
                assert "error" not in message, message
                return message["result"]
            self._told(message)

    def _told(self, message):
        kind, of = message.get("method"), message.get("params", {})
        if kind == "Runtime.exceptionThrown":
            self.problems.append(of["exceptionDetails"].get("exception", {}).get("description"))
        elif kind == "Runtime.consoleAPICalled" and of["type"] in ("error", "warning"):
            self.problems.append(str(of["args"]))
        elif kind == "Log.entryAdded" and of["entry"]["level"] == "error":
            self.problems.append(of["entry"]["text"])
        elif kind in ("Network.requestWillBeSent", "Network.webSocketCreated"):
            self.requests.append(of["request"]["url"] if "request" in of else of["url"])

    def run(self, script):
        """The value of an expression on the page; promises are waited for."""
        found = self.call("Runtime.evaluate", expression=script, returnByValue=True,
                          awaitPromise=True)  # fmt: skip
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def until(self, script, limit=120):
        """The value of an expression as soon as it is true."""
        return _waited(lambda: self.run(script), limit, f"never: {script}")

    def middle(self, selector):
        """Where the middle of an element is on the screen, which is scrolled to."""
        return self.run(
            f"(() => {{ const e = document.querySelector({selector!r}); "
            "e.scrollIntoView({block: 'center', inline: 'nearest'}); "
            "const r = e.getBoundingClientRect(); "
            "return [r.x + r.width / 2, r.y + r.height / 2]; })()"
        )

    def pointer(self, kind, x, y, held=True):
        """A pointer's event: mousePressed, mouseMoved or mouseReleased."""
        button, buttons = "left" if held else "none", int(held and kind != "mouseReleased")
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button,
                  buttons=buttons, clickCount=1)  # fmt: skip

    def drag(self, selector, by, steps=8, pause=0.0, drop=True):
        """Drag an element by so many pixels, in steps."""
        x, y = self.middle(selector)
        self.pointer("mouseMoved", x, y, held=False)
        self.pointer("mousePressed", x, y)
        for k in range(1, steps + 1):
            self.pointer("mouseMoved", x + by[0] * k / steps, y + by[1] * k / steps)
            time.sleep(pause)
        if drop:
            self.pointer("mouseReleased", x + by[0], y + by[1])

    def click(self, selector):
        """Press and release in the middle of an element."""
        x, y = self.middle(selector)
        for kind in ("mousePressed", "mouseReleased"):
            self.pointer(kind, x, y)

    def key(self, key, shift=False, control=False):
        """Press a key and let it go."""
        modifiers = 8 * shift + 2 * control
        code = {"Tab": 9, "Enter": 13, "ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39,
                "ArrowDown": 40}.get(key, ord(key[0].upper()))  # fmt: skip
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, modifiers=modifiers,
                      windowsVirtualKeyCode=code)  # fmt: skip

    def picture(self, path):
        """What is on the screen, as PNG."""
        content = self.call("Page.captureScreenshot", format="png")["data"]
        Path(path).write_bytes(base64.b64decode(content))
