"""The README's Python runs as it stands, and its table is what the command prints."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_readme_example_runs(tmp_path, monkeypatch, capsys):
    text = (ROOT / "README.md").read_text()
    (block,) = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(compile(block, "README.md", "exec"), names)
    assert names["design"].success
    assert (tmp_path / "after.toml").exists()
    shown = " ".join(repr(names["design"]).split())
    assert "values pulley.tensioner.radius 0.06 m" in shown
    assert shown.startswith("Design drive Drive")
    # What the README says of the study is what it finds.
    before, after = re.search(r"take Gamma from (\S+) to (\S+) with", text).groups()
    assert f"{names['design'].initial:.2f}" == before
    assert f"{names['design'].final:.2f}" == after
    assert "True" in capsys.readouterr().out
