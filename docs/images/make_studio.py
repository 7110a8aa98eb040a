"""Pictures of the page to design on, for docs/studio.md: python docs/images/make_studio.py."""

import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from devtools import Tab, chromium  # noqa: E402


def served(study):
    """`beltjax studio` of an example, and its address."""
    command = [sys.executable, "-m", "beltjax", "studio", str(ROOT / "examples" / study)]
    process = subprocess.Popen([*command, "--no-browser"], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    return process, process.stdout.readline().split()[1]


def main():
    """Drag, optimize and break a drive, and keep what the page shows."""
    process, address = served("seven_pulley_study.toml")
    try:
        with chromium() as at:
            with Tab(at, address, 1360, 1010) as tab:
                tab.until("globalThis.studio?.answer?.judged === 'true' && studio.curves", 400)
                tab.click("#show-start")
                tab.drag('[data-handle="center:3"]', (14, 10), steps=12, pause=0.05, drop=False)
                time.sleep(2)
                tab.picture(HERE / "studio_dragging.png")
                tab.drag('[data-handle="center:3"]', (0, 0), steps=1)
                tab.run("document.getElementById('show-contact').click()")
                tab.until("studio.contact", 300)
                tab.click("#show-bands")
                tab.until("studio.answer.bands")
                tab.run("document.getElementById('show-loads').click()")
                tab.run("document.getElementById('speeds').scrollIntoView()")
                time.sleep(2)
                tab.picture(HERE / "studio_speeds.png")
                tab.drag('[data-handle="center:3"]', (0, 160), steps=12, pause=0.05)
                tab.until("!document.getElementById('fault').hidden")
                time.sleep(1)
                tab.picture(HERE / "studio_impossible.png")
            with Tab(at, address, 1360, 1010) as tab:
                tab.until("globalThis.studio?.answer?.judged === 'true' && studio.curves", 400)
                tab.click("#optimize")
                ended = "document.getElementById('search-text')?.textContent.includes('optimum')"
                tab.until(ended, 300)
                tab.until("!studio.answer.moving")
                time.sleep(2)
                tab.picture(HERE / "studio_optimized.png")
            with Tab(at, address, 390, 844) as tab:
                tab.until("globalThis.studio?.answer?.judged === 'true' && studio.curves", 400)
                time.sleep(2)
                tab.picture(HERE / "studio_phone.png")
    finally:
        process.terminate()
        process.wait(20)


if __name__ == "__main__":
    main()
