"""All tables and figures in the order of the source, each computed once."""

from collections.abc import Callable, Iterator
from pathlib import Path

from beltjax.files.writing import write_whole
from beltjax.validation import (
    beam,
    contact,
    contact_plates,
    coupling,
    deflections,
    limits,
    shapes,
    spectra,
)
from beltjax.validation.plates import Plate
from beltjax.validation.verdicts import Line, csv_text, markdown_text, summary

TABLE = "verdicts"


def write_everything(folder: Path, advance: Callable[[str], None]) -> list[Line]:
    """Write every figure with its data, every table and all verdicts; return the verdicts.

    `advance(what)` is called with what comes next. Raises `OSError` where a file cannot be written.
    """
    lines: list[Line] = []
    for what, part in _parts():
        advance(what)
        for piece in part:
            if isinstance(piece, Plate):
                for name, content in piece.files().items():
                    write_whole(folder / name, content)
                lines += piece.lines
            else:
                lines.append(piece)
    for item in dict.fromkeys(line.item for line in lines if line.item.startswith("Table")):
        stem = item.lower().replace(" ", "_").replace(".", "_")
        own = [line for line in lines if line.item == item]
        write_whole(folder / f"{stem}.csv", csv_text(own).encode())
    write_whole(folder / f"{TABLE}.csv", csv_text(lines).encode())
    text = f"{summary(lines)}.\n\n{markdown_text(lines)}"
    write_whole(folder / f"{TABLE}.md", text.encode())
    return lines


def _parts() -> Iterator[tuple[str, Iterator[Plate | Line]]]:
    """Tables and figures of one chapter after the other, one at a time as they are taken."""
    yield "chapter 2", iter([*beam.tables(), *beam.plates()])
    yield "chapter 3, deflections", iter([*deflections.tables(), *deflections.plates()])
    yield "chapter 3, coupling", coupling.plates()
    yield "chapter 4, tables", iter(spectra.tables())
    over_eps = spectra.over_stiffness()
    yield "chapter 4, mode shapes", shapes.plates(over_eps)
    yield "chapter 4, spectra", spectra.plates(over_eps)
    regular, largest = contact.regular(), contact.largest()
    yield "chapter 5, tables", iter(contact.tables(regular))
    yield "chapter 5, figures", contact_plates.plates(regular, largest)
    yield "limits", iter(limits.lines(over_eps, regular, largest))
