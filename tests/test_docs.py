"""The code blocks of the documentation's pages run, and their assertions hold."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BLOCKS = {"bvp": 4, "contact": 5, "exploration": 4, "moving_beam": 4, "robust": 4, "vibration": 4}
WRITTEN = {"exploration": ["sample.zarr", "grid.zarr"], "vibration": ["sweep.nc"]}


@pytest.mark.slow  # up to a minute each, most of it compiling
@pytest.mark.parametrize("name", BLOCKS)
def test_code_blocks_run(name, tmp_path, monkeypatch):
    page = ROOT / "docs" / f"{name}.md"
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(), flags=re.DOTALL)
    assert len(blocks) == BLOCKS[name]
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for block in blocks:
        exec(compile(block, str(page), "exec"), names)
    assert all((tmp_path / file).exists() for file in WRITTEN.get(name, []))
