"""The work of `beltjax layout`: it turns the geometry of a drive file into a report."""

import math
import os
from collections.abc import Iterable, Mapping
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
from beltjax.commands.reports.warnings import file_warnings, warning_lines
from beltjax.drive.buildable import clearances, passes, pulley_pairs
from beltjax.drive.files import Geometry, load_geometry
from beltjax.drive.fitting import fitted_belts, next_lengths
from beltjax.drive.installation import BELT_LENGTH
from beltjax.drive.layout import Layout, layout
from beltjax.drive.shafts import transmission
from beltjax.drive.system import Drive

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


class FittedBeltPart(Part):
    """A belt in a drawn path: that of the file, or a standard one next to the path.

    The standard ones are the next shorter or equal one, and the next longer.
    """

    belt: str
    length: float = meaning("m, along the neutral axis")
    effective_length: Maybe = meaning("m; null without a pitch_offset in the file")
    less_path: float = meaning("m, its length less that of the drawn path")
    teeth: int | None
    fits: list[FitPart] = meaning("empty where no single body can fit it")
    reason: str = meaning("why none can; else empty")


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
    given_belts: list[FittedBeltPart] = meaning("those whose `belt_length` the file gives")
    standard_belts: list[FittedBeltPart]
    clearances: list[GapPart] = meaning("the narrowest first")


def layout_report(
    path: str | os.PathLike[str], figure: str | None = None, si: bool = False
) -> Report:
    """The drawn layout of a file, as tables in its units or in SI, and as a picture.

    Raises `FileError` where the file describes no possible layout.
    """
    found = load_geometry(path)
    drive, at = found.drive, jax.device_get(layout(found.drive))
    document = layout_document(found, at)
    files: tuple[tuple[str, bytes], ...] = ()
    if figure:
        from beltjax.draw.layouts import layout_figure, picture_bytes  # slow to load

        files = ((figure, picture_bytes(layout_figure(drive, at), figure)),)
    return Report(document, layout_tables(document, TableUnits(drive, si)), "", files)


def layout_document(found: Geometry, at: Layout) -> dict[str, Any]:
    """The JSON document of a layout; speeds are those of the file if it has any."""
    drive, point, has_speed = found.drive, found.point, found.has_speed
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
        "warnings": file_warnings(drive),
        "spans": [
            {"name": name, "length": length}
            for name, length in zip(drive.span_names, plain(at.span_lengths), strict=True)
        ],
        "pulleys": [dict(zip(keys, row, strict=True)) for row in columns],
        "belts": [
            {
                "name": belt.name,
                "path_length": length,
                "effective_length": _effective(length, belt.name, found),
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
        "given_belts": _fitted(
            found, at, {name: [length] for name, length in found.belt_lengths.items()}
        ),
        "standard_belts": _fitted(
            found,
            at,
            {
                belt.name: next_lengths(belt, float(path))
                for belt, path in zip(drive.belts, at.path_lengths, strict=True)
            },
        ),
        "clearances": _gaps(drive, at),
    }


def _effective(length: float | None, belt: str, found: Geometry) -> float | None:
    """A length along the neutral axis [m], along the effective line; None without an offset."""
    if length is None or belt not in found.pitch_offsets:
        return None
    return length - 2 * math.pi * found.pitch_offsets[belt]


def _fitted(
    found: Geometry, at: Layout, lengths: Mapping[str, Iterable[float]]
) -> list[dict[str, Any]]:
    """What makes room for belts of these lengths [m], by the belts' names."""
    keys = "tensioner", "coordinate", "center_distance", "beyond_stops"
    return [
        {
            "belt": belt.name,
            "length": one.length,
            "effective_length": _effective(one.length, belt.name, found),
            "less_path": one.length - float(at.path_lengths[place]),
            "teeth": one.teeth,
            "fits": [dict(zip(keys, where, strict=True)) for where in one.places],
            "reason": one.reason,
        }
        for place, belt in enumerate(found.drive.belts)
        for one in fitted_belts(found.drive, place, lengths.get(belt.name, ()))
    ]


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
    titles = {
        "given_belts": "Belts of this file, without tension",
        "standard_belts": "Standard belts, without tension",
    }
    for key, title in titles.items():
        if document[key]:
            tables.append(_belt_table(title, document[key], document, units))
    return Group(*warning_lines(document), *tables, _gap_table(document, units))


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


def _belt_table(
    title: str, rows: list[dict[str, Any]], document: dict[str, Any], units: TableUnits
) -> Table:
    """Belts and what makes room for them; lengths are along the line along which a file has all."""
    effective = all(units.is_effective(row["belt"]) for row in rows)
    key, label = ("effective_length", "effective length") if effective else ("length", "length")
    heads = [units.head(words, "m", BELT_LENGTH) for words in (label, "less the path")]
    table = plain_table(title, "belt", *heads, "teeth", "fits with", "")
    for row in rows:
        teeth = "-" if row["teeth"] is None else str(row["teeth"])
        lengths = [units.text(row[k], "m", 2, BELT_LENGTH) for k in (key, "less_path")]
        first = escape(row["belt"]), *lengths, teeth
        for fit in row["fits"] or [None]:
            words = ("-", row["reason"]) if fit is None else _fit_words(fit, document, units)
            table.add_row(*first, *words)
            first = "", "", "", ""
    return table


def _fit_words(fit: dict[str, Any], document: dict[str, Any], units: TableUnits) -> tuple[str, str]:
    """What is moved for a belt, and where it stands then."""
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
