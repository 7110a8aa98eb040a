"""Bring docs/validation.md up to date: python docs/images/make_validation.py DIR.

DIR is what `python -m beltjax.validation --out DIR` wrote.
"""

import csv
import shutil
import sys
from pathlib import Path

from beltjax.validation.verdicts import FIGURE, Line, markdown_text, summary

HERE = Path(__file__).parent
PAGE = HERE.parent / "validation.md"
SHOWN = ("figure_2_03", "figure_3_10", "figure_3_12", "figure_4_05", "figure_4_02", "figure_5_07")
BEGIN, END = "<!-- verdicts: written by docs/images/make_validation.py -->", "<!-- end -->"


def main(folder: Path) -> None:
    """Copy the pictures and replace the table."""
    with (folder / "verdicts.csv").open() as file:
        lines = [Line(*row) for row in csv.reader(file)][1:]
    printed = [line for line in lines if line.verdict != FIGURE]
    text = PAGE.read_text()
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    table = f"{summary(lines)}.\n\n{markdown_text(printed)}"
    PAGE.write_text(f"{before}{BEGIN}\n\n{table}\n{END}{after}")
    for stem in SHOWN:
        shutil.copyfile(folder / f"{stem}.svg", HERE / f"{stem}.svg")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
