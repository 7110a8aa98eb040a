"""The work of `beltjax layout`: it turns the geometry of a drive file into a report."""

import math
import os
from typing import Any

import jax
import numpy as np
from rich.console import Group
from rich.markup import escape
from rich.table import Table

from beltjax.commands.reports.documents import Document, Maybe, Part, meaning, model_flags, plain
from beltjax.commands.reports.report import Report
from beltjax.commands.reports.tables import number, plain_table
from beltjax.commands.reports.units import TableUnits
from beltjax.drive.buildable import clearances, passes, pulley_pairs
from beltjax.drive.file_makers_data import pitch_offsets
from beltjax.drive.files import load_geometry
from beltjax.drive.fitting import StandardBelt, standard_belts
from beltjax.drive.layout import Layout, layout
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.shafts import transmission
from beltjax.drive.system import Drive
from beltjax.files.reading import read_toml

_NARROWEST = 6  # gaps shown; all are in the JSON


class DrawnPulleyPart(Part):
    """A pulley of the drawn layout."""

    name: str
    radius: float = meaning("m, to the belt's neutral axis")
    wrap_deg: Maybe
    arc_length: Maybe = meaning("m, of the neutral axis on the pulley")
    speed_ratio: float = meaning("of its rotation to the driver's; negative: the other sense")
    speed: Maybe = meaning("rad/s; null where the file gives no speed")


class DrawnSpanPart(Part):
    """A span of the drawn layout."""

    name: str
    length: Maybe = meaning("m, between the tangent points")


class DrawnBeltPart(Part):
    """A belt of the drawn layout."""

    name: str
    path_length: Maybe = meaning("m, of its neutral axis")
    effective_length: Maybe = meaning(
        "m, of the path along the effective line; null without a pitch_offset in the file"
    )
    teeth: Maybe = meaning("path over pitch, seldom a whole number; null without teeth")
    speed: Maybe = meaning("m/s; null where the file gives no speed")


class DrawnTensionerPart(Part):
    """A tensioner of the drawn layout."""

    name: str
    arm_length: Maybe = meaning("m, from pivot to the middle of its pulleys; null for a slide")
    path_per_move: Maybe = meaning("what moving it adds to the belts' paths: m per rad, or m per m")


class FitPart(Part):
    """Where one body alone, or one of two fixed pulleys, fits a belt that has no tension."""

    tensioner: str | None = meaning("null: the second pulley is moved away from the first")
    coordinate: float = meaning("rad or m, from the drawn position")
    center_distance: Maybe = meaning("m, of two fixed pulleys; else null")
    beyond_stops: bool


class StandardBeltPart(Part):
    """A standard belt next to a drawn path: the next shorter or equal one, or the next longer."""

    belt: str
    length: float = meaning("m, along the neutral axis")
    teeth: int | None
    fits: list[FitPart] = meaning("empty where no single body can fit it")


class GapPart(Part):
    """A gap, negative where things overlap."""

    between: list[str] = meaning("two pulleys, or a span and a pulley that it passes")
    gap: float = meaning("m, between rims, or between the belt's face and a rim")


class LayoutDocument(Document):
    """`beltjax layout`: the drawn layout."""

    drive: str
    success: bool
    spans: list[DrawnSpanPart]
    pulleys: list[DrawnPulleyPart]
    belts: list[DrawnBeltPart]
    tensioners: list[DrawnTensionerPart]
    standard_belts: list[StandardBeltPart]
    clearances: list[GapPart] = meaning("the narrowest first")


def layout_report(
    path: str | os.PathLike[str], figure: str | None = None, si: bool = False
) -> Report:
    """The drawn layout of a file, as tables in its units or in SI, and as a picture.

    Raises `FileError` where the file describes no possible layout.
    """
    drive, point, has_speed = load_geometry(path)
    at = jax.device_get(layout(drive))
    offsets = pitch_offsets(read_toml(path), path)
    document = layout_document(drive, point, at, has_speed, offsets)
    files: tuple[tuple[str, bytes], ...] = ()
    if figure:
        from beltjax.draw.layouts import layout_figure, picture_bytes  # slow to load

        files = ((figure, picture_bytes(layout_figure(drive, at), figure)),)
    return Report(document, layout_tables(document, TableUnits(drive, si)), "", files)


def layout_document(
    drive: Drive, point: OperatingPoint, at: Layout, has_speed: bool, offsets: dict[str, float]
) -> dict[str, Any]:
    """The JSON document of a layout; speeds are those of `point` if it has any.

    `offsets` [m] of belts by their names lead from the neutral axis to the effective line.
    """
    driven = jax.device_get(transmission(drive, point))
    speeds = np.asarray(driven.turning * driven.speeds / drive.radii)
    ratios = speeds / speeds[int(np.argmax(drive.drives))]
    starts = drive.loops.starts
    columns = zip(
        drive.pulley_names,
        plain(drive.radii),
        plain(np.degrees(at.wraps)),
        plain(at.arc_lengths),
        plain(ratios),
        plain(speeds) if has_speed else [None] * len(speeds),
        strict=True,
    )
    keys = "name", "radius", "wrap_deg", "arc_length", "speed_ratio", "speed"
    belts = zip(drive.belts, plain(at.path_lengths), plain(driven.speeds[starts]), strict=True)
    arms = np.sqrt(np.sum(np.asarray(at.arms) ** 2, axis=1))
    moves = np.sum(np.asarray(at.span_pulls), axis=0)
    return {
        "drive": drive.name,
        "model": model_flags(drive),
        "success": True,
        "spans": [
            {"name": name, "length": length}
            for name, length in zip(drive.span_names, plain(at.span_lengths), strict=True)
        ],
        "pulleys": [dict(zip(keys, row, strict=True)) for row in columns],
        "belts": [
            {
                "name": belt.name,
                "path_length": length,
                "effective_length": None
                if length is None or belt.name not in offsets
                else length - 2 * math.pi * offsets[belt.name],
                "teeth": None if belt.pitch is None or length is None else length / belt.pitch,
                "speed": speed if has_speed else None,
            }
            for belt, length, speed in belts
        ],
        "tensioners": [
            {
                "name": body.name,
                "arm_length": plain(arm) if float(body.kind) else None,
                "path_per_move": plain(move),
            }
            for body, arm, move in zip(drive.tensioners, arms, moves, strict=True)
        ],
        "standard_belts": [
            _standard_belt(belt.name, found)
            for place, belt in enumerate(drive.belts)
            for found in standard_belts(drive, place, float(at.path_lengths[place]))
        ],
        "clearances": _gaps(drive, at),
    }


def _standard_belt(belt: str, found: StandardBelt) -> dict[str, Any]:
    keys = "tensioner", "coordinate", "center_distance", "beyond_stops"
    fits = [dict(zip(keys, place, strict=True)) for place in found.places]
    return {"belt": belt, "length": found.length, "teeth": found.teeth, "fits": fits}


def _gaps(drive: Drive, at: Layout) -> list[dict[str, Any]]:
    """All gaps with the names of what they are between, the narrowest first."""
    found, sizes = clearances(drive, at), drive.loop_sizes
    names, spans = drive.pulley_names, drive.span_names
    rows = [
        {"between": [names[i], names[j]], "gap": gap}
        for (i, j), gap in zip(pulley_pairs(sizes), plain(found.rims), strict=True)
    ]
    rows += [
        {"between": [spans[i], names[j]], "gap": gap}
        for (i, j), gap in zip(passes(sizes), plain(found.belt), strict=True)
    ]
    return sorted(rows, key=lambda row: row["gap"])


def layout_tables(document: dict[str, Any], units: TableUnits) -> Group:
    """The tables of `beltjax layout`, from its JSON document."""
    tables = [_pulley_table(document, units), _span_table(document, units)]
    if document["tensioners"]:
        tables.append(_tensioner_table(document, units))
    if document["standard_belts"]:
        tables.append(_standard_table(document, units))
    return Group(*tables, _gap_table(document, units))


def _pulley_table(document: dict[str, Any], units: TableUnits) -> Table:
    heads = units.head("wrap", "rad"), units.head("arc", "m"), "speed ratio"
    columns = "pulley", *heads, units.head("speed", "rad/s")
    table = plain_table(escape(document["drive"]), *columns)
    for row in document["pulleys"]:
        table.add_row(
            escape(row["name"]),
            units.text(math.radians(row["wrap_deg"]), "rad", 2),
            units.text(row["arc_length"], "m", 2),
            number(row["speed_ratio"], 4),
            units.text(row["speed"], "rad/s", 1),
        )
    return table


def _span_table(document: dict[str, Any], units: TableUnits) -> Table:
    table = plain_table("", "span", units.head("length", "m"))
    for row in document["spans"]:
        table.add_row(escape(row["name"]), units.text(row["length"], "m", 2))
    for row in document["belts"]:
        several = f" of {row['name']}" if len(document["belts"]) > 1 else ""
        length = units.text(row["path_length"], "m", 2)
        table.add_row(escape(f"whole path{several}"), length, style="bold")
        if row["effective_length"] is not None:
            effective = units.text(row["effective_length"], "m", 2)
            table.add_row(escape(f"along the effective line{several}"), effective, style="bold")
        if row["teeth"] is not None:
            table.add_row(escape(f"in teeth{several}"), number(row["teeth"], 3), style="bold")
    return table


def _standard_table(document: dict[str, Any], units: TableUnits) -> Table:
    heads = units.head("length", "m"), "teeth", "fits with", ""
    table = plain_table("Standard belts, without tension", "belt", *heads)
    for row in document["standard_belts"]:
        teeth = "-" if row["teeth"] is None else str(row["teeth"])
        first = escape(row["belt"]), units.text(row["length"], "m", 2), teeth
        for fit in row["fits"] or [None]:
            table.add_row(*first, *_fit_words(fit, document, units))
            first = "", "", ""
    return table


def _fit_words(
    fit: dict[str, Any] | None, document: dict[str, Any], units: TableUnits
) -> tuple[str, str]:
    """What is moved for a standard belt, and where it stands then."""
    if fit is None:
        return "-", ""
    if fit["tensioner"] is None:
        return "center distance", units.text(fit["center_distance"], "m", 2) + f" {units.name('m')}"
    body = next(part for part in document["tensioners"] if part["name"] == fit["tensioner"])
    unit = "m" if body["arm_length"] is None else "rad"
    place = f"{units.text(fit['coordinate'], unit, 2)} {units.name(unit)}"
    return escape(body["name"]), place + (", beyond its stops" if fit["beyond_stops"] else "")


def _tensioner_table(document: dict[str, Any], units: TableUnits) -> Table:
    length, angle = units.name("m"), units.name("rad")
    table = plain_table("", "tensioner", units.head("arm", "m"), "path per move", "")
    for row in document["tensioners"]:
        turns = row["arm_length"] is not None
        move = units.value(row["path_per_move"], "m") / units.value(1.0, "rad" if turns else "m")
        unit = f"{length}/{angle if turns else length}"
        table.add_row(
            escape(row["name"]), units.text(row["arm_length"], "m", 2), f"{move:.4g}", unit
        )
    return table


def _gap_table(document: dict[str, Any], units: TableUnits) -> Table:
    table = plain_table("Narrowest gaps", "between", units.head("gap", "m"))
    for row in document["clearances"][:_NARROWEST]:
        table.add_row(escape(" and ".join(row["between"])), units.text(row["gap"], "m", 2))
    return table
