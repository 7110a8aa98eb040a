"""Printed numbers beside computed ones, and what to make of them."""

import csv
import io
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from beltjax.validation.printed.value import Value

AGREES, MISPRINT, FIGURE, DIFFERS = "agrees", "known misprint", "figure only", "differs"
COLUMNS = ("item", "quantity", "printed", "computed", "verdict", "argument")
_SAME = 1e-12  # of two formulas for one number


class Line(NamedTuple):
    """One printed quantity and its verdict; all but the verdict's argument are always there."""

    item: str
    quantity: str
    printed: str
    computed: str
    verdict: str
    argument: str = ""


def compared(item: str, quantity: str, printed: Value, computed: object) -> Line:
    """A printed number: it agrees if the computed one rounds to it, to its last digit."""
    number = float(np.asarray(computed))
    matches = printed.matches(number)
    if printed.misprint:
        verdict, why = (DIFFERS, "listed as a misprint, but agrees") if matches else (
            MISPRINT, printed.misprint)  # fmt: skip
    else:
        verdict, why = (AGREES if matches else DIFFERS), ""
    decimals = max(printed.decimals, 0) + 2
    return Line(item, quantity, printed.text, f"{_plain(number):.{decimals}f}", verdict, why)


def _plain(number: float) -> float:
    """Without what rounding errors leave of a zero, which is another on every machine."""
    return round(number, 10) + 0.0


def compared_formula(
    item: str, quantity: str, text: str, printed: complex, computed: complex, same_to: float = _SAME
) -> Line:
    """A formula at some numbers, against the same thing found without it, to so much of it."""
    same = abs(printed - computed) <= same_to * abs(computed)
    shown = f"{computed.real:.8g}"
    if isinstance(computed, complex):
        shown += f" {computed.imag:+.8g} i"
    return Line(item, quantity, text, shown, AGREES if same else DIFFERS)


def shown(item: str, quantity: str, computed: object) -> Line:
    """A number of a figure, which prints none."""
    return Line(item, quantity, "", f"{_plain(float(np.asarray(computed))):.6g}", FIGURE)


def csv_text(lines: Iterable[Line]) -> str:
    """The table for programs."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows(lines)
    return text.getvalue()


def markdown_text(lines: Iterable[Line]) -> str:
    """The table for people; an argument is said once, below."""
    notes: dict[str, int] = {}
    rows = []
    for line in lines:
        verdict = line.verdict
        if line.argument:
            note = notes.setdefault(line.argument, len(notes) + 1)
            verdict = f"{verdict} ({note})"
        cells = (line.item, line.quantity, line.printed or "-", line.computed, verdict)
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    head = ["| " + " | ".join(COLUMNS[:5]) + " |", "|---|---|---|---|---|"]
    tail = [f"{note}. {argument}" for argument, note in notes.items()]
    return "\n".join([*head, *rows, "", *tail]) + "\n"


def summary(lines: Iterable[Line]) -> str:
    """How many of each verdict, in one line."""
    verdicts = [line.verdict for line in lines]
    order = (AGREES, MISPRINT, FIGURE, DIFFERS)
    return ", ".join(f"{verdicts.count(verdict)} {verdict}" for verdict in order)
