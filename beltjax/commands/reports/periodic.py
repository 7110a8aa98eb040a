"""The work of `beltjax periodic`: it turns a drive file into a report."""

import dataclasses
import os
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from rich.console import Group
from rich.markup import escape
from rich.table import Table

from beltjax.analysis.damping import Damping
from beltjax.analysis.friction import lock_torque
from beltjax.analysis.motion import driver_speed
from beltjax.analysis.moving import law_with_modes
from beltjax.analysis.orders import Orders
from beltjax.analysis.periodic import PeriodicResponse, Resolution, periodic_response
from beltjax.analysis.periodic_branch import PeriodicBranch, periodic_branch
from beltjax.analysis.periodic_sensitivity import periodic_sensitivities
from beltjax.commands.reports.analyze import plain_numbers
from beltjax.commands.reports.arguments import (
    read_option,
    read_points,
    titled,
)
from beltjax.commands.reports.documents import (
    Maybe,
    Number,
    PointDocument,
    meaning,
    model_flags,
    plain,
)
from beltjax.commands.reports.excited import OrdersAsked, commanded_damping, excited_orders
from beltjax.commands.reports.moved import (
    COORDINATE_UNITS,
    MovedPart,
    moved_parts,
    moved_tables,
)
from beltjax.commands.reports.report import Report
from beltjax.commands.reports.tables import plain_table
from beltjax.commands.reports.units import TableUnits
from beltjax.commands.reports.vibrating import RPM, vibrating
from beltjax.commands.reports.warnings import (
    file_warnings,
    joined_clutches,
    periodic_warnings,
    range_warnings,
    warning_lines,
)
from beltjax.commands.running import Advance
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.results import explanation, succeeded

_POINTS = 50  # of a range of speeds that does not say


class MotionPart(MovedPart):
    """The periodic motion at one speed."""

    driver_speed: float = meaning("rad/s")
    mean_driver_torque: Maybe = meaning(
        "N m in the direction of travel, of a free driver beside its steady torque; else 0"
    )
    period: Maybe = meaning("s")
    stable: bool = meaning("whether small disturbances die out")
    multipliers: list[list[float]] = meaning("Floquet's, real and imaginary part, largest first")
    residual: Maybe = meaning("last correction over the size of the motion")
    harmonics_error: Maybe = meaning(
        "size of the last two harmonics over that of all; of a motion with events an estimate of "
        "what its steps miss"
    )
    conditioning: Maybe = meaning(
        "distance from a fold: 0 at one; of a motion with events how clearly they are met: 0 "
        "where one only touches"
    )
    feasible: bool = meaning("whether every span is tight and no pulley slips")
    success: bool = meaning("whether a motion was found")
    failure: str | None = meaning("why there is none")


class PeriodicDocument(PointDocument):
    """`beltjax periodic`."""

    success: bool = meaning(
        "whether a motion was found at every speed, or the branch was followed to an end"
    )
    feasible: bool = meaning("whether at every speed all spans stay tight and no pulley slips")
    orders: list[float] = meaning("of the excitation, per rotation of the driver")
    harmonics: int
    functions: int = meaning("of each span")
    periodic: list[MotionPart] = meaning("by speed, or along the branch")
    folds: list[float] = meaning("rad/s, driver's speeds at which the branch turns back")
    flips: list[float] = meaning("rad/s, at which the period doubles; both empty without --branch")
    sensitivities: dict[str, dict[str, Number]] | None = meaning(
        "derivatives of each measure of the motion, such as `tension_min:SPAN`, by every number of "
        "the file, by its key, SI; null for several speeds, and by --no-sensitivities"
    )


class PeriodicOptions(NamedTuple):
    """The options of `beltjax periodic`, as text; None stands for the file's, or the usual one."""

    crank: str | None
    torques: Sequence[str]
    order: float | None
    orders: str | None
    speeds: str | None
    modal_damping: float | None
    harmonics: int
    functions: int
    duty: str | None = None
    branch: str | None = None  # "up" or "down"
    belt_speed: Literal["constant", "varying"] = "constant"
    driver: str | None = None
    belt_damping: str | None = None
    slopes: bool = False  # of the motion at a single speed, for the document
    document: bool = False  # which has what no table shows


def periodic_report(
    path: str | os.PathLike[str],
    given: PeriodicOptions,
    figure: str | None,
    advance: Advance,
    si: bool = False,
) -> Report:
    """Find the periodic motion of the drive of a file at one speed or over a range of speeds.

    Raises `FileError` as `sweep_report` does.
    """
    drive, point, where = vibrating(path, given.duty)
    orders = excited_orders(
        path,
        drive,
        point,
        OrdersAsked(given.crank, given.torques, given.order, given.orders, given.driver),
    )
    speeds = _speeds(path, drive, point, given.speeds)
    damping = commanded_damping(given.modal_damping, given.belt_damping)
    # Before the first of many motions: whether there are enough harmonics.
    read_option("--harmonics", lambda: orders.forcing(drive.pulley_names, given.harmonics))
    if given.branch is not None:
        if len(speeds) < 2:
            raise FileError("--branch", "", "goes with a range of speeds; give --speeds FROM:TO")
        followed = _followed(drive, point, orders, speeds, given, damping, advance)
        speeds, found = followed.values, list(followed.responses)
        folds, flips, whole = plain(followed.folds), plain(followed.flips), followed.complete
    else:
        found = _at_each(drive, point, orders, speeds, given, damping, advance)
        folds, flips, whole = [], [], True
    document = periodic_document(drive, given, orders, speeds, found)
    document |= {"at": where, "folds": folds, "flips": flips, "sensitivities": None}
    if given.document:
        _add_lock_torques(document, drive, orders, damping, found)
    if given.slopes and len(found) == 1 and bool(succeeded(found[0].result)):
        advance("differentiating", 0, None)
        at = dataclasses.replace(point, belt_speed=None, driver_speed=speeds[0])
        document["sensitivities"] = _sensitivities(drive, at, orders, given, damping)
    document["success"] = document["success"] and whole
    document["warnings"] += [
        *joined_clutches(drive, damping),
        *file_warnings(drive),
        *range_warnings(drive, point, speeds),
    ]
    units = TableUnits(drive, si)
    files: tuple[tuple[str, bytes], ...] = ()
    if figure:
        from beltjax.commands.reports.periodic_curves import periodic_picture  # slow to load

        files = ((figure, periodic_picture(figure, drive, units, speeds, found)),)
    return Report(document, periodic_tables(document, units), _failure(path, document), files)


def _add_lock_torques(
    document: dict[str, Any],
    drive: Drive,
    orders: Orders,
    damping: Damping,
    found: Sequence[PeriodicResponse],
) -> None:
    """What would hold each tensioner still, at every speed; of a single order."""
    if len(orders.excitations) > 1 or not drive.tensioners:
        return
    [(order, excitation)] = orders.excitations.items()
    for part, one in zip(document["periodic"], found, strict=True):
        if part["success"]:
            frequency, names = order * part["driver_speed"], drive.pulley_names
            lin = one.linearization
            locking = lock_torque(lin, frequency, excitation, names, damping=damping)
            for row, value in zip(part["coordinates"], plain(locking[0]), strict=True):
                row["lock_torque"] = value


def _sensitivities(
    drive: Drive, point: OperatingPoint, orders: Orders, given: PeriodicOptions, damping: Damping
) -> dict[str, Any]:
    how = Resolution(given.harmonics, None, given.functions, None)
    found = periodic_sensitivities(drive, point, orders, how, damping, given.belt_speed)
    return {
        name: plain_numbers(*gradient, of=(drive, gradient[1]))
        for name, gradient in zip(found.names, found.gradients, strict=True)
    }


def _at_each(
    drive: Drive,
    point: OperatingPoint,
    orders: Orders,
    speeds: np.ndarray,
    given: PeriodicOptions,
    damping: Damping,
    advance: Advance,
) -> list[PeriodicResponse]:
    """The motion that grows from rest at each speed."""
    found = []
    for k, speed in enumerate(speeds):
        advance("moving", k, len(speeds))
        at = dataclasses.replace(point, belt_speed=None, driver_speed=speed)
        found.append(
            periodic_response(
                drive, at, orders, harmonics=given.harmonics, functions=given.functions,
                damping=damping, belt_speed=given.belt_speed, throw=False,
            )
        )  # fmt: skip
    advance("moving", len(speeds), len(speeds))
    return found


def _followed(
    drive: Drive,
    point: OperatingPoint,
    orders: Orders,
    speeds: np.ndarray,
    given: PeriodicOptions,
    damping: Damping,
    advance: Advance,
) -> PeriodicBranch:
    """The branch over the range of the speeds; raises `FileError` where it does not begin."""
    advance("following the branch", 0, None)
    ends = (speeds[0], speeds[-1]) if given.branch == "up" else (speeds[-1], speeds[0])
    law = law_with_modes(drive)
    if law is not None:
        message = f"follows motions without events, and {law} has them; leave --branch out"
        raise FileError("--branch", "", message)
    branch = periodic_branch(
        drive, point, orders, *map(float, ends), harmonics=given.harmonics,
        functions=given.functions, damping=damping, belt_speed=given.belt_speed, throw=False,
    )  # fmt: skip
    if not branch.responses:
        rpm = ends[0] * RPM
        message = f"no motion was found at {rpm:g} rpm, where the branch begins; begin elsewhere"
        raise FileError("--branch", "", message)
    return branch


def _failure(path: str | os.PathLike[str], document: dict[str, Any]) -> str:
    """Why the answer is not one to build on; empty where it is."""
    parts = document["periodic"]
    failed = [part for part in parts if not part["success"]]
    loose = [part for part in parts if part["success"] and not part["feasible"]]
    key = "operation.driver_speed"
    if not failed and not loose:
        gave_up = "the branch could not be followed to an end of the range; the points found remain"
        return "" if document["success"] else str(FileError(path, key, gave_up))
    first = (failed or loose)[0]
    rpm = first["driver_speed"] * RPM
    count = "" if len(parts) == 1 else f" ({len(failed or loose)} of {len(parts)} speeds)"
    reason = first["failure"] or (
        "a span goes slack or a pulley slips during the motion; the warnings say which"
    )
    return str(FileError(path, key, f"at {rpm:g} rpm{count}: {reason}"))


def _speeds(
    path: str | os.PathLike[str], drive: Drive, point: OperatingPoint, text: str | None
) -> np.ndarray:
    if text is None:
        speeds = np.array([float(driver_speed(drive, point))])
        if not speeds[0] > 0:
            raise FileError(path, "operation", "the drive stands still; give --speeds")
        return speeds
    speeds = read_option("--speeds", lambda: read_points(text, "rad/s", _POINTS))
    if not speeds[0] > 0:
        raise FileError("--speeds", "", f"found {text!r}; begin above 0")
    return speeds


def periodic_document(
    drive: Drive,
    given: PeriodicOptions,
    orders: Orders,
    speeds: np.ndarray,
    found: Sequence[PeriodicResponse],
) -> dict[str, Any]:
    """The motions, by speed; numbers of a motion that was not found are null."""
    parts = [_motion(drive, float(speed), one) for speed, one in zip(speeds, found, strict=True)]
    return {
        "drive": drive.name,
        "model": model_flags(drive),
        "success": all(part["success"] for part in parts),
        "feasible": all(part["feasible"] for part in parts),
        "warnings": periodic_warnings(drive, speeds, found),
        "orders": sorted(orders.excitations),
        "harmonics": given.harmonics,
        "functions": given.functions,
        "periodic": parts,
    }


def _motion(drive: Drive, speed: float, found: PeriodicResponse) -> dict[str, Any]:
    good = bool(succeeded(found.result))
    floquet = np.asarray(found.multipliers).tolist() if good else []
    moved = moved_parts(drive, found.measures, found.friction_use, good)
    return moved | {
        "driver_speed": speed,
        "mean_driver_torque": plain(found.mean_driver_torque) if good else None,
        "period": plain(found.period),
        "stable": good and bool(found.stable),
        "multipliers": [[complex(one).real, complex(one).imag] for one in floquet],
        "residual": plain(found.stats["residual"]) if good else None,
        "harmonics_error": plain(found.error) if good else None,
        "conditioning": plain(found.conditioning) if good else None,
        "success": good,
        "failure": explanation(found.result) or None,
    }


def periodic_tables(document: dict[str, Any], units: TableUnits) -> Group:
    """Every part at one speed; over a range the worst of all parts at each speed."""
    parts = document["periodic"]
    lines = warning_lines(document)
    if len(parts) > 1:
        turns = [
            f"{what} at {', '.join(f'{speed * RPM:.1f}' for speed in document[key])} rpm"
            for what, key in (("folds", "folds"), ("period doubles", "flips"))
            if document[key]
        ]
        return Group(*lines, _over_speeds(document, units), *turns)
    return Group(*lines, *_at_one_speed(titled(document), parts[0], units))


def _at_one_speed(what: str, part: dict[str, Any], units: TableUnits) -> list[Table | str]:
    if not part["success"]:
        return [part["failure"]]
    title = escape(f"{what}: periodic motion at {part['driver_speed'] * RPM:.5g} rpm")
    largest = np.hypot(*part["multipliers"][0])
    word = "stable" if part["stable"] else "unstable"
    return [
        *moved_tables(title, part, units),
        f"{word}: the largest Floquet multiplier is {largest:.4f}",
    ]


def _over_speeds(document: dict[str, Any], units: TableUnits) -> Table:
    bodies = document["periodic"][0]["coordinates"]
    moved = [units.head(f"{one['name']} p-p", COORDINATE_UNITS[one["kind"]]) for one in bodies]
    table = plain_table(
        escape(f"{titled(document)}: periodic motion over the driver's speed"),
        "rpm", *map(escape, moved), units.head("least tension", "N"),
        units.head("greatest", "N"), units.head("deflection", "m"), "multiplier",
    )  # fmt: skip
    for part in document["periodic"]:
        rpm = f"{part['driver_speed'] * RPM:.1f}"
        if not part["success"]:
            table.add_row(rpm, *["-"] * (len(moved) + 4))
            continue
        spans = part["spans"]
        table.add_row(
            rpm,
            *(
                units.text(one["peak_to_peak"], COORDINATE_UNITS[one["kind"]], 4)
                for one in part["coordinates"]
            ),
            units.text(min(one["tension_min"] for one in spans), "N", 1),
            units.text(max(one["tension_max"] for one in spans), "N", 1),
            units.text(max(one["peak_deflection"] for one in spans), "m", 3),
            f"{np.hypot(*part['multipliers'][0]):.4f}",
        )
    return table
