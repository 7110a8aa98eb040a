"""Stored drives with several tensioners, springs, isolators and belts, as text and loaded."""

import json
from pathlib import Path

import beltjax as bj

CASES = json.loads((Path(__file__).parent / "data" / "bodies.json").read_text())["cases"]


def text_of(number):
    """The drive file of the case whose name begins so."""
    return next(case["file"] for name, case in CASES.items() if name.startswith(number))


TWO_ARMS, SLIDE, TWIN, LEVER = (text_of(number) for number in ("04", "08", "10", "12"))
ISOLATORS, TWO_BELTS, ECCENTRIC = (text_of(number) for number in ("16", "18", "24"))


def load(folder, text):
    """The drive and the point of a file with this text."""
    path = folder / "drive.toml"
    path.write_text(text)
    return bj.load_drive(path)


def swap(text, old, new):
    """`text` with the first `old`, which must be there, replaced."""
    assert old in text
    return text.replace(old, new, 1)
