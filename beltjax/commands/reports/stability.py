"""The work of `beltjax stability`: it turns a drive file into a report."""

import os
from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import Field
from rich.console import Group
from rich.markup import escape

from beltjax.analysis.damping import Damping
from beltjax.analysis.orders import Orders
from beltjax.analysis.parametric_margin import (
    Margin,
    MarginAsked,
    margin_gradient,
    parametric_margin,
)
from beltjax.analysis.response import Excitation
from beltjax.commands.reports.analyze import plain_numbers
from beltjax.commands.reports.arguments import read_interval, read_option, titled
from beltjax.commands.reports.documents import (
    Maybe,
    Number,
    Part,
    PointDocument,
    Row,
    meaning,
    model_flags,
    plain,
)
from beltjax.commands.reports.excited import OrdersAsked, commanded_damping, excited_orders
from beltjax.commands.reports.report import Report
from beltjax.commands.reports.tables import number, plain_table
from beltjax.commands.reports.units import TableUnits
from beltjax.commands.reports.vibrating import RPM, vibrating
from beltjax.commands.reports.warnings import (
    file_warnings,
    range_warnings,
    slack_first,
    warning_lines,
)
from beltjax.commands.running import Advance
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.numerics.bases import Legendre
from beltjax.results import explanation

MODES, FUNCTIONS = 12, 16
_LISTED = 12  # tongues in the table

Pair = Annotated[list[int], Field(min_length=2, max_length=2)]


class StabilityExcitationPart(Part):
    """One order of what excites the drive."""

    order: float = meaning("per rotation of the driver")
    crank: float = meaning("rad, zero to peak")
    torque: dict[str, float] = meaning("N m, by pulley")


class WorstTonguePart(Part):
    """The tongue that is reached first."""

    driver_speed: float = meaning("rad/s")
    rpm: float
    hertz: float = meaning("Hz, of the excitation")
    modes: Pair = meaning("from 1 on")
    kind: str = meaning("`principal` of a mode with itself, or `sum` of two")
    growth: Maybe = meaning("1/s, of the pair under the excitation")
    critical_crank: Maybe = meaning("rad; null without crank motion")


class TonguePart(Part):
    """A pair of modes in resonance with the excitation."""

    order: float
    modes: Pair = meaning("from 1 on")
    kind: str
    driver_speed: float = meaning("rad/s")
    rpm: float
    hertz: float = meaning("Hz, of the excitation")
    half_width_hz: Maybe = meaning("of the unstable frequencies under the excitation; 0: none is")
    growth: Maybe = meaning("1/s, of the pair alone under the excitation")
    critical_factor: Maybe = meaning(
        "by which the excitation may grow, with the modes that are near; null: never unstable"
    )
    critical_factor_exact: Maybe = meaning("by Floquet's theory; null where it was not asked for")
    slack_factor: Maybe = meaning("at which a span goes slack there")
    tension_fluctuation: Row = meaning("N, of each span, under the excitation")
    slack: bool = meaning("whether a span goes slack before the tongue is reached")


class StabilitySlopesPart(Part):
    """Derivatives by every number of the file, by its key, SI."""

    parametric_margin: dict[str, Number]


class StabilityDocument(PointDocument):
    """`beltjax stability`."""

    success: bool = meaning("whether all speeds could be looked at")
    excitation: list[StabilityExcitationPart]
    driver_speeds_rpm: Annotated[list[float], Field(min_length=2, max_length=2)] = meaning("rpm")
    spans: list[str] = meaning("names of the columns of tension_fluctuation")
    margin: Maybe = meaning(
        "factor by which the excitation may grow before a speed of the range is unstable; null "
        "where a span goes slack first, or no tongue is in the range"
    )
    safe: bool = meaning("whether no speed of the range is unstable under the excitation")
    worst: WorstTonguePart | None
    tongues: list[TonguePart] = meaning("in the range, the first to be reached first")
    sensitivities: StabilitySlopesPart | None = meaning("null where the margin is")
    failure: str | None = meaning("why speeds could not be looked at")


class StabilityOptions(NamedTuple):
    """The options of `beltjax stability`, as text; None stands for the file's, or the usual one."""

    crank: str | None
    torques: Sequence[str]
    order: float | None
    orders: str | None
    speeds: str
    modal_damping: float | None
    belt_damping: str | None
    exact: bool
    duty: str | None = None
    slopes: bool = False  # of the margin, for the document


class OrderFound(NamedTuple):
    """One order of an excitation, and the margin under it alone."""

    order: float
    excitation: Excitation
    margin: Margin


def stability_report(
    path: str | os.PathLike[str],
    given: StabilityOptions,
    figure: str | None,
    advance: Advance,
    si: bool = False,
) -> Report:
    """Look for parametric resonances of the drive of a file over a range of speeds.

    Raises `FileError` as `sweep_report` does.
    """
    drive, point, where = vibrating(path, given.duty)
    orders = excited_orders(
        path, drive, point, OrdersAsked(given.crank, given.torques, given.order, given.orders)
    )
    if orders.driver == "free":
        message = 'is "free"; parametric resonance is looked for with a given motion of the driver'
        raise FileError(path, "excitation.driver", message)
    ends = read_option("--speeds", lambda: read_interval(given.speeds, "rad/s"))
    if not ends[0] > 0:
        raise FileError("--speeds", "", f"found {given.speeds!r}; begin above 0")
    damping = commanded_damping(given.modal_damping, given.belt_damping)
    found = _margins(drive, point, orders, ends, damping, given.exact, advance)
    document = stability_document(drive, ends, found)
    document["at"] = where
    worst = _worst(found)
    if given.slopes and document["margin"] is not None:
        advance("differentiating", 0, None)
        asked = MarginAsked(MODES, given.exact, Legendre(FUNCTIONS))
        slopes = margin_gradient(
            drive, point, worst.excitation, damping, worst.order, asked, worst.margin
        )
        numbers = plain_numbers(*slopes, of=(drive, slopes[1]))
        document["sensitivities"] = {"parametric_margin": numbers}
    document["warnings"] += [*file_warnings(drive), *range_warnings(drive, point, np.array(ends))]
    units = TableUnits(drive, si)
    files: tuple[tuple[str, bytes], ...] = ()
    if figure and document["success"]:
        from beltjax.draw.layouts import picture_bytes  # slow to load
        from beltjax.draw.tongues import tongue_figure

        size = float(abs(worst.excitation.crank))
        picture = tongue_figure(drive.name, ends, worst.order, size, worst.margin)
        files = ((figure, picture_bytes(picture, figure)),)
    return Report(document, stability_tables(document, units), _failure(path, document), files)


def _margins(
    drive: Drive,
    point: OperatingPoint,
    orders: Orders,
    ends: tuple[float, float],
    damping: Damping,
    exact: bool,
    advance: Advance,
) -> list[OrderFound]:
    """The margin under each order."""
    found = []
    for k, (order, excitation) in enumerate(sorted(orders.excitations.items())):
        advance("seeking tongues", k, len(orders.excitations))
        # A torque on every pulley, most of them zero, so that all excitations compile once.
        torques = {name: excitation.torques.get(name, 0.0) for name in drive.pulley_names}
        whole = Excitation(excitation.crank, torques)
        margin = parametric_margin(
            drive, point, ends, whole, order=order, damping=damping, exact=exact, count=MODES,
            basis=Legendre(FUNCTIONS), throw=False,
        )  # fmt: skip
        found.append(OrderFound(order, whole, margin))
    return found


def _worst(found: Sequence[OrderFound]) -> OrderFound:
    return min(found, key=lambda one: float(one.margin.margin))


def stability_document(
    drive: Drive, ends: tuple[float, float], found: Sequence[OrderFound]
) -> dict[str, Any]:
    """The margin, the tongue that is reached first, and all others in the range."""
    failures = [text for one in found if (text := explanation(one.margin.result))]
    good, worst = not failures, _worst(found)
    tongues = [part for one in found for part in _tongues(one)] if good else []
    tongues.sort(key=lambda part: np.inf if (best := _best(part)) is None else best)
    margin = plain(worst.margin.margin) if good else None
    slack = good and margin is None and any(part["slack"] for part in tongues)
    complete = all(bool(one.margin.complete) for one in found)
    return {
        "drive": drive.name,
        "model": model_flags(drive),
        "success": good,
        "warnings": slack_first(tongues, slack, good and not complete),
        "excitation": [
            {
                "order": one.order,
                "crank": float(abs(one.excitation.crank)),
                "torque": {
                    name: float(abs(size)) for name, size in one.excitation.torques.items() if size
                },
            }
            for one in found
        ],
        "driver_speeds_rpm": [end * RPM for end in ends],
        "spans": list(drive.span_names),
        "margin": margin,
        "safe": good and (margin is None or margin >= 1),
        "worst": _worst_part(worst) if margin is not None else None,
        "tongues": tongues,
        "sensitivities": None,
        "failure": failures[0] if failures else None,
    }


def _best(part: dict[str, Any]) -> float | None:
    exact = part["critical_factor_exact"]
    return part["critical_factor"] if exact is None else exact


def _tongues(one: OrderFound) -> list[dict[str, Any]]:
    of = one.margin.tongues
    kinds, slack = of.kind, np.asarray(of.slack)
    columns = {
        "half_width_hz": np.asarray(of.half_width) / (2 * np.pi),
        "growth": of.growth,
        "critical_factor": of.critical_factor,
        "critical_factor_exact": of.exact_factor,
        "slack_factor": of.slack_factor,
        "tension_fluctuation": np.abs(of.tension_fluctuation),
    }
    columns = {key: np.asarray(column) for key, column in columns.items()}
    speeds = np.asarray(of.driver_speed)
    return [
        {
            "order": one.order,
            "modes": np.asarray(of.modes[k]).tolist(),
            "kind": kinds[k],
            "driver_speed": float(speeds[k]),
            "rpm": float(speeds[k]) * RPM,
            "hertz": one.order * float(speeds[k]) / (2 * np.pi),
            "slack": bool(slack[k]),
            **{key: plain(column[k]) for key, column in columns.items()},
        }
        for k in np.flatnonzero(np.asarray(of.inside))
    ]


def _worst_part(one: OrderFound) -> dict[str, Any]:
    found, crank = one.margin, float(abs(one.excitation.crank))
    place, speed = int(found.worst), float(found.speed)
    return {
        "driver_speed": speed,
        "rpm": speed * RPM,
        "hertz": one.order * speed / (2 * np.pi),
        "modes": np.asarray(found.modes).tolist(),
        "kind": found.tongues.kind[place],
        "growth": plain(found.tongues.growth[place]),
        "critical_crank": crank * float(found.margin) if crank else None,
    }


def _failure(path: str | os.PathLike[str], document: dict[str, Any]) -> str:
    """Why the answer is not one to build on; empty where it is."""
    if not document["success"]:
        return str(FileError(path, "", document["failure"]))
    if document["safe"]:
        return ""
    worst = document["worst"]
    r, s = worst["modes"]
    what = f"mode {r} becomes" if r == s else f"modes {r} and {s} become"
    message = (
        f"{what} unstable near {worst['rpm']:.0f} rpm: the excitation is "
        f"{1 / document['margin']:.3g} times the critical one"
    )
    return str(FileError(path, "", message))


def stability_tables(document: dict[str, Any], units: TableUnits) -> Group:
    """The tongues that are reached first."""
    lines = warning_lines(document)
    if not document["success"]:
        return Group(*lines, document["failure"])
    table = plain_table(
        escape(f"{titled(document)}: parametric resonance"),
        "modes", "order", "rpm", "excitation (Hz)", "growth (1/s)", "critical factor", "exact",
        "slack at", units.head("tension swings by", "N"),
    )  # fmt: skip
    for part in document["tongues"][:_LISTED]:
        table.add_row(
            "-".join(map(str, part["modes"])),
            f"{part['order']:g}",
            number(part["rpm"], 1),
            number(part["hertz"], 2),
            number(part["growth"], 3),
            _factor(part["critical_factor"], part["slack"]),
            _factor(part["critical_factor_exact"], part["slack"]),
            _factor(part["slack_factor"], False),
            units.text(max(part["tension_fluctuation"]), "N", 2),
        )
    margin = document["margin"]
    last = (
        f"the excitation may grow by a factor of {margin:.4g}"
        if margin is not None
        else "no tongue is reached before a span goes slack"
    )
    return Group(*lines, table, last)


def _factor(value: float | None, slack: bool) -> str:
    return "-" if value is None else f"{value:.4g}{' (slack first)' if slack else ''}"
