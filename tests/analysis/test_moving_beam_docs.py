"""The code blocks of the page on the moving beam run, and their assertions hold."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow  # most of it compiling
def test_code_blocks_run(monkeypatch):
    page = ROOT / "docs" / "moving_beam.md"
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(), flags=re.DOTALL)
    assert len(blocks) == 4
    monkeypatch.chdir(ROOT)
    names: dict = {}
    for block in blocks:
        exec(compile(block, str(page), "exec"), names)
