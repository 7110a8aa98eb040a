"""The work of `beltjax transient`: it turns a drive file into a report."""

import os
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from rich.console import Group
from rich.markup import escape

from beltjax.analysis.driver_motion import CrankSignal
from beltjax.analysis.motion import driver_speed
from beltjax.analysis.orders import Orders
from beltjax.analysis.transient import Transient, transient
from beltjax.commands.reports.arguments import read_option, titled
from beltjax.commands.reports.documents import (
    Part,
    PointDocument,
    Row,
    meaning,
    model_flags,
    plain,
)
from beltjax.commands.reports.excited import OrdersAsked, commanded_damping, excited_orders
from beltjax.commands.reports.moved import MovedPart, moved_parts, moved_tables
from beltjax.commands.reports.report import Report
from beltjax.commands.reports.response import is_free
from beltjax.commands.reports.tables import plain_table
from beltjax.commands.reports.units import TableUnits
from beltjax.commands.reports.vibrating import RPM, vibrating
from beltjax.commands.reports.warnings import (
    file_warnings,
    joined_clutches,
    range_warnings,
    transient_warnings,
    warning_lines,
)
from beltjax.commands.running import Advance
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.files.signals import read_signal
from beltjax.files.units import si_of_text
from beltjax.numerics.cubic_spline import FEWEST
from beltjax.numerics.time_integration import require_diffrax
from beltjax.results import explanation, succeeded

_STEADY = 1e-6  # part by which a speed changes that is called constant


class PeakSpeedsPart(Part):
    """Speeds of the driver at which a motion is at its greatest: rad/s."""

    rotations: Row = meaning("of each pulley's hub, from its mean")
    tensions: Row = meaning("of each span")
    motions: Row = meaning("of each tensioner, from the steady state at reference_speed")
    hub_loads: Row = meaning("of each pulley")


class TransientPart(MovedPart):
    """The motion over all of its time."""

    peak_speeds: PeakSpeedsPart | None = meaning("null at a constant speed")
    reference_speed: float = meaning("rad/s, of the steady state from which motions are counted")
    steps: int = meaning("in time")


class TransientDocument(PointDocument):
    """`beltjax transient`."""

    success: bool = meaning("whether the motion was followed to its end")
    failure: str | None = meaning("why it was not")
    feasible: bool = meaning("whether all spans stay tight and no pulley slips")
    profile: list[list[float]] = meaning("s and rad/s: the driver's mean speed, joined by lines")
    orders: list[float] = meaning("of the excitation, per rotation of the driver; may be empty")
    functions: int = meaning("of each span")
    transient: TransientPart


class TransientOptions(NamedTuple):
    """The options of `beltjax transient`, as text; None stands for the file's, or the usual one."""

    duration: str | None
    runup: str | None
    profile: str | None
    crank_signal: str | None
    crank: str | None
    torques: Sequence[str]
    order: float | None
    orders: str | None
    modal_damping: float | None
    functions: int
    duty: str | None = None
    belt_damping: str | None = None


class _Course(NamedTuple):
    """What the driver does."""

    knots: np.ndarray  # [s], [rad/s]
    signal: CrankSignal | None


def transient_report(
    path: str | os.PathLike[str],
    given: TransientOptions,
    outputs: tuple[str | None, str | None],
    advance: Advance,
    si: bool = False,
) -> Report:
    """Follow the drive of a file in time; `outputs` name a NetCDF file and a picture.

    Raises `FileError` for options that cannot be used.
    """
    read_option("beltjax transient", require_diffrax)
    drive, point, where = vibrating(path, given.duty)
    if is_free(point, None):
        message = 'is "free"; a transient is of a driver whose motion is given: remove it'
        raise FileError(path, "excitation.driver", message)
    orders = _orders(path, drive, point, given)
    course = _course(path, drive, point, given)
    damping = commanded_damping(given.modal_damping, given.belt_damping)
    found = transient(
        drive, point, profile=course.knots, orders=orders, crank=course.signal,
        functions=given.functions, damping=damping, advance=advance, throw=False,
    )  # fmt: skip
    document = transient_document(drive, given, orders, course.knots, found)
    speeds = np.sort(course.knots[:, 1])
    document["at"] = where
    document["warnings"] += [
        *joined_clutches(drive, damping),
        *file_warnings(drive),
        *range_warnings(drive, point, speeds),
    ]
    units, (netcdf, figure) = TableUnits(drive, si), outputs
    files = []
    if netcdf:
        data: Any = found.to_xarray(drive).to_netcdf(engine="scipy")
        files.append((netcdf, bytes(data)))
    if figure:
        from beltjax.commands.reports.transient_curves import transient_picture  # slow to load

        files.append((figure, transient_picture(figure, drive, units, found, document["orders"])))
    failure = _failure(path, document)
    return Report(document, transient_tables(document, units), failure, tuple(files))


def _orders(
    path: str | os.PathLike[str], drive: Drive, point: OperatingPoint, given: TransientOptions
) -> Orders | None:
    """The command's excitation, or the file's; there may be none."""
    asked = OrdersAsked(given.crank, given.torques, given.order, given.orders)
    file = point.excitation
    named = given.crank is not None or bool(given.torques) or given.orders is not None
    if not named and (file is None or not file.excites):
        if given.order is not None:
            raise FileError("--order", "", "goes with --crank or --torque; give one, or none")
        return None
    return excited_orders(path, drive, point, asked)


def _course(
    path: str | os.PathLike[str], drive: Drive, point: OperatingPoint, given: TransientOptions
) -> _Course:
    """The driver's mean speed over time, and its signal."""
    signal = None if given.crank_signal is None else _signal(given.crank_signal)
    knots = _knots(point, given)
    lasts = None
    if given.duration is not None:
        text = given.duration
        lasts = read_option("--duration", lambda: _time(text))
    if knots is not None:
        return _Course(_lengthened(knots, lasts), signal)
    if lasts is None and signal is None:
        message = "the motion has no end; give --duration, --runup or --profile"
        raise FileError(path, "excitation.profile", message)
    start, speed = 0.0, float(driver_speed(drive, point))
    if signal is not None:
        start, whole = float(signal.times[0]), float(signal.times[-1] - signal.times[0])
        lasts = whole if lasts is None else lasts
        if signal.speeds is not None:
            # The mean speed is that of the signal, over which its rotation is counted.
            speed = float(np.trapezoid(signal.speeds, signal.times)) / whole
        if lasts > whole:
            raise FileError(given.crank_signal, "", f"lasts {whole:g} s; lower --duration to that")
    assert lasts is not None
    return _Course(np.array([[start, speed], [start + lasts, speed]]), signal)


def _knots(point: OperatingPoint, given: TransientOptions) -> np.ndarray | None:
    """Times and speeds of the command, or of the file."""
    if given.runup is not None and given.profile is not None:
        raise FileError("--runup", "", "stands beside --profile; give one of them")
    if given.runup is not None:
        text = given.runup
        return read_option("--runup", lambda: _run_up(text))
    if given.profile is not None:
        read = read_signal(given.profile, {"speed": "rad/s"}, 2)
        if np.any(read.values < 0):
            raise FileError(given.profile, "", "a speed is below 0; the driver turns one way")
        return np.stack([read.times, read.values], axis=1)
    file = None if point.excitation is None else point.excitation.profile
    return None if file is None else np.asarray(file)


def _lengthened(knots: np.ndarray, lasts: float | None) -> np.ndarray:
    """A profile that goes on at its last speed until it has lasted so long."""
    if lasts is None:
        return knots
    whole = float(np.ptp(knots[:, 0]))
    if lasts < whole:
        raise FileError("--duration", "", f"is shorter than the profile, of {whole:g} s")
    return (
        knots if lasts == whole else np.append(knots, [[knots[0, 0] + lasts, knots[-1, 1]]], axis=0)
    )


def _run_up(text: str) -> np.ndarray:
    """Knots of "600 rpm:6000 rpm:5 s"."""
    parts = text.split(":")
    if len(parts) != 3:
        raise ValueError(f'found {text!r}; give FROM:TO:TIME, such as "600 rpm:6000 rpm:5 s"')
    speeds = [si_of_text(part, "rad/s") for part in parts[:2]]
    if min(speeds) < 0:
        raise ValueError(f"found {text!r}; a speed is not negative")
    return np.array([[0.0, speeds[0]], [_time(parts[2]), speeds[1]]])


def _time(text: str) -> float:
    found = si_of_text(text, "s")
    if not found > 0:
        raise ValueError(f"found {text!r}; give a time above 0")
    return found


def _signal(path: str) -> CrankSignal:
    read = read_signal(path, {"angle": "rad", "speed": "rad/s"}, FEWEST)
    return CrankSignal(read.times, **{f"{read.name}s": read.values})


def _failure(path: str | os.PathLike[str], document: dict[str, Any]) -> str:
    """Why the answer is not one to build on; empty where it is."""
    if document["failure"]:
        return str(FileError(path, "", document["failure"]))
    if document["feasible"]:
        return ""
    message = "a span goes slack or a pulley slips during the motion; the warnings say which"
    return str(FileError(path, "", message))


def transient_document(
    drive: Drive,
    given: TransientOptions,
    orders: Orders | None,
    knots: np.ndarray,
    found: Transient,
) -> dict[str, Any]:
    """The motion; its numbers are null where it was not followed to its end."""
    good = bool(succeeded(found.result))
    moved = moved_parts(drive, found.measures, found.friction_use, good)
    peaks = None
    if good and np.ptp(knots[:, 1]) > _STEADY * np.max(knots[:, 1]):
        names = PeakSpeedsPart.model_fields
        peaks = {name: plain(getattr(found.peak_speeds, name)) for name in names}
    return {
        "drive": drive.name,
        "model": model_flags(drive),
        "success": good,
        "failure": explanation(found.result) or None,
        "feasible": moved["feasible"],
        "warnings": transient_warnings(drive, found),
        "profile": plain(knots),
        "orders": sorted(orders.excitations) if orders is not None else [],
        "functions": given.functions,
        "transient": moved
        | {
            "peak_speeds": peaks,
            "reference_speed": plain(found.reference_speed),
            "steps": int(found.stats["steps"]),
        },
    }


def transient_tables(document: dict[str, Any], units: TableUnits) -> Group:
    """Every part, and in a run-up at which speeds it is at its greatest."""
    lines = warning_lines(document)
    if not document["success"]:
        return Group(*lines, document["failure"])
    part, knots = document["transient"], np.array(document["profile"])
    ends = knots[[0, -1], 1]
    if ends[0] == ends[1]:
        ends = np.array([knots[:, 1].min(), knots[:, 1].max()])
    speeds = " to ".join(f"{speed * RPM:.5g}" for speed in dict.fromkeys(ends))
    title = f"{titled(document)}: motion over {np.ptp(knots[:, 0]):.5g} s, {speeds} rpm"
    tables = moved_tables(escape(title), part, units)
    if part["peak_speeds"]:
        table = plain_table("", "greatest", "of", units.head("at", "rad/s"))
        for kind, what, rows in (
            ("tensions", "tension", part["spans"]),
            ("rotations", "rotation", part["pulleys"]),
            ("motions", "motion", part["coordinates"]),
            ("hub_loads", "hub load", part["pulleys"]),
        ):
            for one, speed in zip(rows, part["peak_speeds"][kind], strict=True):
                table.add_row(what, escape(one["name"]), units.text(speed, "rad/s", 1))
        tables.append(table)
    return Group(*lines, *tables)
