"""What a motion of finite amplitude does to the parts of a drive, in documents and tables."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from beltjax.analysis.orbit_measures import Measures
from beltjax.commands.reports.documents import Maybe, Part, meaning, plain
from beltjax.commands.reports.states import Kind, kind_of
from beltjax.commands.reports.tables import number, plain_table
from beltjax.commands.reports.units import TableUnits
from beltjax.drive.system import Drive


class MovedPulleyPart(Part):
    """A pulley in motion."""

    name: str
    rotation_amplitude: Maybe = meaning("rad, of the rim, half peak to peak")
    hub_rotation_amplitude: Maybe = meaning("rad, of the hub")
    hub_load_max: Maybe = meaning("N, of the tensions less m v^2")
    friction_use_max: Maybe = meaning(
        "logarithm of the tensions' ratio over friction times wrap, 1 where the belt slips; null "
        "without friction"
    )
    overrun_per_period: Maybe = meaning(
        "rad, by which a hub behind a decoupler or rigid clutch gains on its rim over the period "
        "or the motion; null without a joint"
    )


class MovedSpanPart(Part):
    """A span in motion."""

    name: str
    tension_min: Maybe = meaning("N")
    tension_max: Maybe = meaning("N")
    peak_deflection: Maybe = meaning("m, from the steady state")
    slope_max: Maybe = meaning("of the deflection; above 0.2 the equations are off")
    slack_fraction: Maybe = meaning("part of the time with a tension below 0")


class MovedCoordinatePart(Part):
    """A tensioner in motion: rad, or m of a linear one."""

    name: str
    kind: Kind
    peak_to_peak: Maybe
    mean: Maybe = meaning("from the steady state")
    friction_work: Maybe = meaning("J over the period or the motion, of dry friction")
    stuck_fraction: Maybe = meaning("part of the time in which dry friction holds it")
    lock_torque: Maybe = meaning(
        "N m, or N: dry friction above which it does not move, from the linear drive; null for "
        "several orders and in a transient motion"
    )


class MovedIsolatorPart(Part):
    """An isolator in motion."""

    name: str
    open_fraction: Maybe = meaning("part of the time in which a clutch is open; 0 of a spring")


class MovedPart(Part):
    """The parts of a drive in motion."""

    pulleys: list[MovedPulleyPart]
    spans: list[MovedSpanPart]
    coordinates: list[MovedCoordinatePart] = meaning("of each tensioner")
    isolators: list[MovedIsolatorPart]
    feasible: bool = meaning("whether every span is tight and no pulley slips")


def moved_parts(drive: Drive, m: Measures, friction_use: Any, good: bool) -> dict[str, Any]:
    """The parts of a drive in motion; of one that was not found all numbers are null."""

    def listed(names: Sequence[str], **columns: Any) -> list[dict[str, Any]]:
        values = {
            key: np.where(good, np.asarray(column), np.nan) for key, column in columns.items()
        }
        return [
            {"name": name} | {key: plain(column[k]) for key, column in values.items()}
            for k, name in enumerate(names)
        ]

    friction = [pulley.friction is not None for pulley in drive.pulleys]
    coordinates = listed(
        [body.name for body in drive.tensioners],
        peak_to_peak=m.travels,
        mean=m.mean_motions,
        friction_work=m.friction_work,
        stuck_fraction=m.stuck_fractions,
        lock_torque=np.full(len(drive.tensioners), np.nan),  # until it is asked for
    )
    for one, body in zip(coordinates, drive.tensioners, strict=True):
        one["kind"] = kind_of(body)
    # Without a clutch none is asked for.
    none = np.zeros(len(drive.isolators))
    opened = m.open_fractions if len(m.open_fractions) else none
    overrun = np.full(len(drive.pulleys), np.nan)
    gained = m.overrun_per_period if len(m.overrun_per_period) else none
    for part, angle in zip(drive.isolators, np.asarray(gained), strict=True):
        overrun[np.asarray(part.pulleys) > 0] = angle
    tight = good and bool(np.min(m.tension_min) >= 0)
    return {
        "pulleys": listed(
            drive.pulley_names,
            rotation_amplitude=m.rotation_amplitudes,
            hub_rotation_amplitude=m.hub_rotation_amplitudes,
            hub_load_max=m.hub_load_max,
            friction_use_max=np.where(friction, friction_use, np.nan),
            overrun_per_period=overrun,
        ),
        "spans": listed(
            drive.span_names,
            tension_min=m.tension_min,
            tension_max=m.tension_max,
            peak_deflection=m.span_peaks,
            slope_max=m.slope_max,
            slack_fraction=m.slack_fractions,
        ),
        "coordinates": coordinates,
        "isolators": listed([part.name for part in drive.isolators], open_fraction=opened),
        "feasible": tight and bool(np.max(friction_use) <= 1),
    }


def moved_tables(title: str, part: dict[str, Any], units: TableUnits) -> list[Table]:
    """Tables of the pulleys, the spans and the tensioners of `moved_parts`."""
    pulleys = plain_table(
        title, "pulley", units.head("rim, half p-p", "rad"), units.head("hub", "rad"),
        units.head("hub load", "N"), "friction used",
    )  # fmt: skip
    for one in part["pulleys"]:
        turned = (units.text(one[key], "rad", 4) for key in _ROTATIONS)
        load, use = units.text(one["hub_load_max"], "N", 1), number(one["friction_use_max"], 3)
        pulleys.add_row(escape(one["name"]), *turned, load, use)
    spans = plain_table(
        "", "span", units.head("least", "N"), units.head("greatest tension", "N"),
        units.head("deflection", "m"), "slack",
    )  # fmt: skip
    for one in part["spans"]:
        tensions = (units.text(one[key], "N", 1) for key in ("tension_min", "tension_max"))
        peak, slack = units.text(one["peak_deflection"], "m", 3), number(one["slack_fraction"], 3)
        spans.add_row(escape(one["name"]), *tensions, peak, slack)
    tables = [pulleys, spans]
    if part["coordinates"]:
        bodies = plain_table("", "tensioner", "peak to peak", "mean", "unit")
        for one in part["coordinates"]:
            unit = COORDINATE_UNITS[one["kind"]]
            motions = (units.text(one[key], unit, 4) for key in ("peak_to_peak", "mean"))
            bodies.add_row(escape(one["name"]), *motions, units.name(unit))
        tables.append(bodies)
    return tables


_ROTATIONS = "rotation_amplitude", "hub_rotation_amplitude"
COORDINATE_UNITS = {"rotary": "rad", "linear": "m"}
