"""The code blocks of the page on vibration run, and their assertions hold."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.slow  # a quarter of a minute, most of it compiling
def test_code_blocks_run(tmp_path, monkeypatch):
    page = ROOT / "docs" / "vibration.md"
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(), flags=re.DOTALL)
    assert len(blocks) == 4
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for block in blocks:
        exec(compile(block, str(page), "exec"), names)
    assert (tmp_path / "sweep.nc").exists()
