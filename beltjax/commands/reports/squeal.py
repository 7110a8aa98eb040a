"""The work of `beltjax squeal`: it turns a drive file into a report."""

import os
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from rich.console import Group
from rich.markup import escape
from rich.table import Table

from beltjax.analysis.entry_angles import GUIDELINE, entry_angles
from beltjax.analysis.linearization import has_inertias
from beltjax.analysis.orders import Orders
from beltjax.analysis.slip_onset import SlipOnset, onset_of
from beltjax.analysis.slip_stability import SlipStability, with_damping
from beltjax.analysis.squeal import Squeal, squeal, squeal_asked, squeal_slopes
from beltjax.commands.reports.analyze import plain_numbers
from beltjax.commands.reports.arguments import read_drive, read_option, titled
from beltjax.commands.reports.diagnosis import diagnose
from beltjax.commands.reports.documents import (
    Maybe,
    Number,
    Part,
    PointDocument,
    meaning,
    model_flags,
    plain,
)
from beltjax.commands.reports.excited import OrdersAsked, commanded_damping, excited_orders
from beltjax.commands.reports.report import Report
from beltjax.commands.reports.tables import number, plain_table
from beltjax.commands.reports.units import TableUnits
from beltjax.commands.reports.vibrating import require_few_pulleys
from beltjax.commands.reports.warnings import file_warnings, warning_lines
from beltjax.commands.running import Advance
from beltjax.drive.components import as_real
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.files.units import si_of_text
from beltjax.results import RESULTS, code, explanation, succeeded

_HERTZ = 1 / (2 * np.pi)


class SquealPulleyPart(Part):
    """The belt on one pulley; its numbers are null where the pulley has no friction."""

    name: str
    slip_margin: Maybe = meaning("static friction times wrap, less the logarithm of the tensions")
    dynamic_slip_margin: Maybe = meaning("least over a period; null without an excitation")
    slides: bool = meaning("whether the smaller margin is below 0")
    onset_speed: Maybe = meaning(
        "m/s, sliding speed above which the belt is quiet; 0: at any; null: at none"
    )
    fold_speed: Maybe = meaning(
        "m/s, above which it stays quiet after a knock; null: at no speed it does"
    )
    drive_onset_speed: Maybe = meaning("m/s, the onset of the whole drive; null without inertias")
    squeal_hz: Maybe = meaning("Hz, at the sliding speed")
    growth: Maybe = meaning("1/s, of the oscillation at the sliding speed; negative: it dies out")
    critical_damping: Maybe = meaning(
        "N s/m, of the belt, above which it is quiet: at --sliding, else at any speed"
    )
    runaway_rate: Maybe = meaning(
        "1/s, at which the pulley would run away at a constant torque; no squeal"
    )
    entry_angle_deg: Maybe = meaning("of the belt that arrives; null where no pulley has an offset")
    squeals: bool = meaning("whether it slides at or below its onset speed")
    reason: str = meaning("why it does not squeal, or empty")


class SquealDocument(PointDocument):
    """`beltjax squeal`."""

    success: bool = meaning("whether the running drive was found")
    sliding_speed: Maybe = meaning("m/s, as --sliding gives it; null: each at its onset")
    pulleys: list[SquealPulleyPart] | None
    slides: bool = meaning("whether the belt slides on the whole arc of a pulley")
    squeals: bool = meaning("whether it slides on one at or below its onset speed")
    verdict: str = meaning("the answer in words")
    sensitivities: dict[str, dict[str, Number]] | None = meaning(
        "derivatives by every number of the file, by its key, SI: of `squeal_speed:PULLEY`, "
        "`critical_damping:PULLEY` (at any speed), `slip_margin:PULLEY`, "
        "`dynamic_slip_margin:PULLEY` and `drive_squeal_speed:PULLEY`; null by --no-sensitivities"
    )


class SquealOptions(NamedTuple):
    """The options of `beltjax squeal`, as text; None stands for the file's, or the usual one."""

    sliding: str | None = None
    damping: str | None = None
    crank: str | None = None
    torques: Sequence[str] = ()
    order: float | None = None
    orders: str | None = None
    modal_damping: float | None = None
    duty: str | None = None
    slopes: bool = False  # for the document


class SquealFound(NamedTuple):
    """What is known of a drive."""

    numbers: Squeal
    whole: dict[str, SlipOnset]  # by pulley


def squeal_report(
    path: str | os.PathLike[str],
    given: SquealOptions,
    figure: str | None,
    advance: Advance,
    si: bool = False,
) -> Report:
    """Judge the drive of a file.

    Raises `FileError` for a file or an option that cannot be used.
    """
    drive, point, where = read_drive(path, given.duty)
    require_few_pulleys(drive, path, "squeal and responses")
    sliding = _positive("--sliding", given.sliding, "m/s")
    damping = _positive("--damping", given.damping, "N s/m")
    drive = with_damping(drive, damping)
    _require_numbers(drive, path)
    orders = _orders(path, drive, point, given)
    asked = squeal_asked(drive, point, orders, commanded_damping(given.modal_damping, None))
    advance("sliding", 0, None)
    numbers = jax.device_get(
        squeal(drive, point, asked, None if sliding is None else as_real(sliding))
    )
    steady = numbers.stability.steady
    why = diagnose(drive, point, steady)
    success = why is None and bool(succeeded(numbers.margins.result))
    failure, whole = "", {}
    if why is not None:
        failure = str(FileError(path, why.key, why.message))
    elif not success:
        failure = str(FileError(path, "excitation", explanation(numbers.margins.result)))
    else:
        whole = _whole_drive(drive, point, numbers.stability, given.slopes)
    document = squeal_document(drive, SquealFound(numbers, whole), sliding, success)
    document |= {"at": where, "warnings": [*file_warnings(drive)], "sensitivities": None}
    if given.slopes and success:
        advance("differentiating", 0, None)
        document["sensitivities"] = _sensitivities(drive, point, asked, whole)
    units = TableUnits(drive, si)
    files: tuple[tuple[str, bytes], ...] = ()
    if figure:
        from beltjax.draw.friction import friction_figure  # slow to load
        from beltjax.draw.layouts import picture_bytes

        picture = friction_figure(drive, numbers.stability)
        files = ((figure, picture_bytes(picture, figure)),)
    if success and document["squeals"]:
        failure = str(FileError(path, _key_of(document), document["verdict"]))
    return Report(document, squeal_tables(document, units), failure, files)


def _key_of(document: dict[str, Any]) -> str:
    name = next(one["name"] for one in document["pulleys"] if one["squeals"])
    return f"pulley.{name}"


def _positive(option: str, text: str | None, unit: str) -> float | None:
    if text is None:
        return None
    value = read_option(option, lambda: si_of_text(text, unit))
    if not 0 < value < np.inf:
        raise FileError(option, "", f"found {text!r}; give a positive number, such as 50")
    return value


def _require_numbers(drive: Drive, path: str | os.PathLike[str]) -> None:
    for belt in drive.belts:
        key = "belt" if len(drive.belts) == 1 else f"belt.{belt.name}"
        if belt.longitudinal_damping is None:
            message = "is missing; give it, or --damping, such as 50 N s/m"
            raise FileError(path, f"{key}.longitudinal_damping", message)
        if not float(belt.longitudinal_damping) > 0:
            message = "found 0; squeal needs damping above 0, or give --damping"
            raise FileError(path, f"{key}.longitudinal_damping", message)
    if all(pulley.friction is None for pulley in drive.pulleys):
        message = "is missing on all pulleys; give friction, friction_static and friction_speed"
        raise FileError(path, "pulley.friction", message)


def _orders(
    path: str | os.PathLike[str], drive: Drive, point: OperatingPoint, given: SquealOptions
) -> Orders | None:
    """The command's excitation, or the file's; None where neither excites the drive."""
    named = given.crank is not None or given.torques or given.orders is not None
    file = point.excitation
    if not named and (file is None or not file.excites):
        return None
    if not has_inertias(drive):
        if not named:
            return None
        raise FileError(path, "pulley.inertia", "is missing; vibration needs all of them")
    asked = OrdersAsked(given.crank, given.torques, given.order, given.orders)
    return excited_orders(path, drive, point, asked)


def _whole_drive(
    drive: Drive,
    point: OperatingPoint,
    found: SlipStability,
    slopes: bool,
) -> dict[str, SlipOnset]:
    """The onset of the whole drive on each pulley that has a law of friction."""
    if not has_inertias(drive):
        return {}
    whole = {}
    for place, pulley in enumerate(drive.pulleys):
        if pulley.friction_static is not None:
            one = found.of_place(place)
            whole[pulley.name] = onset_of(one, drive, point, pulley.name, slopes)
    return whole


def _sensitivities(
    drive: Drive, point: OperatingPoint, asked: Any, whole: dict[str, SlipOnset]
) -> dict[str, Any]:
    bare = {pulley.name for pulley in drive.pulleys if pulley.friction is None}
    gradients = {
        f"{measure}:{name}": gradient
        for (measure, name), gradient in squeal_slopes(drive, point, asked).items()
        if name not in bare
    }
    for name, onset in whole.items():
        if onset.gradient is not None:
            gradients[f"drive_squeal_speed:{name}"] = onset.gradient
    return {
        name: plain_numbers(*gradient, of=(drive, gradient[1]))
        for name, gradient in gradients.items()
    }


def squeal_document(
    drive: Drive, found: SquealFound, sliding: float | None, success: bool
) -> dict[str, Any]:
    """The judgement of each pulley; numbers are null where the running drive was not found."""
    pulleys = _pulleys(drive, found, sliding) if success else None
    slides = pulleys is not None and any(one["slides"] for one in pulleys)
    squeals = pulleys is not None and any(one["squeals"] for one in pulleys)
    return {
        "drive": drive.name,
        "model": model_flags(drive),
        "success": success,
        "sliding_speed": sliding,
        "pulleys": pulleys,
        "slides": slides,
        "squeals": squeals,
        "verdict": _verdict(pulleys, sliding) if pulleys is not None else "",
    }


def _pulleys(drive: Drive, found: SquealFound, sliding: float | None) -> list[dict[str, Any]]:
    stability, margins = found.numbers
    rows = []
    angles = _entry_angles(drive, stability)
    dynamic = margins.static if margins.dynamic is None else margins.dynamic
    least = np.minimum(margins.static, dynamic)
    results = np.asarray(code(stability.result))
    reasons = {
        int(code(RESULTS.no_negative_slope)): "friction does not fall with the sliding speed",
        int(code(RESULTS.onset_beyond_stick)): "the belt's damping is above the critical one",
    }
    for k, pulley in enumerate(drive.pulleys):
        bare = pulley.friction is None
        onset = float(stability.onset_speed[k])
        slides = bool(least[k] < 0)
        squeals = slides and onset > 0 and (sliding is None or sliding <= onset)
        reason = reasons.get(int(results[k]), "")
        if not reason and not slides:
            reason = "it does not slide on the whole arc"
        elif not reason and not squeals:
            reason = "it slides faster than the onset speed"
        whole = found.whole.get(pulley.name)
        runaway = stability.runaway_rate[k] if whole is None else whole.runaway_rate
        numbers = {
            "slip_margin": margins.static[k],
            "dynamic_slip_margin": np.nan if margins.dynamic is None else margins.dynamic[k],
            "onset_speed": onset,
            "fold_speed": stability.fold_speed[k],
            "drive_onset_speed": np.nan if whole is None else whole.speed,
            "squeal_hz": stability.squeal_frequency[k] * _HERTZ,
            "growth": stability.growth[k],
            "critical_damping": stability.critical_damping[k],
            "runaway_rate": max(0.0, float(runaway)),
        }
        shown = {key: None if bare else plain(value) for key, value in numbers.items()}
        part = {"name": pulley.name} | shown | {"entry_angle_deg": angles[k]}
        rows.append(part | {"slides": slides, "squeals": squeals, "reason": reason})
    return rows


def _entry_angles(drive: Drive, stability: SlipStability) -> list[float | None]:
    """Angle of the span that arrives at each pulley [deg]."""
    if all(pulley.offset is None for pulley in drive.pulleys):
        return [None] * len(drive.pulleys)
    lengths = stability.steady.reference.layout.span_lengths
    angles = entry_angles(drive, lengths)
    listed = np.asarray(stability.steady.groups.travel) > 0
    return plain(np.degrees(np.where(listed, drive.loops.preceding(angles), angles)))


def _verdict(pulleys: list[dict[str, Any]], sliding: float | None) -> str:
    """The answer in words."""
    squealing = [one for one in pulleys if one["squeals"]]
    sliders = [one for one in pulleys if one["slides"]]
    if squealing:
        first = squealing[0]
        names = ", ".join(one["name"] for one in squealing)
        at = "slides" if sliding is None else f"slides at {sliding:g} m/s"
        whether = "and passes" if sliding is None else "at or below"
        return (
            f"the belt {at} on {names}, {whether} the onset of squeal, {first['onset_speed']:.3g} "
            f"m/s at {first['squeal_hz']:.0f} Hz; raise the tension, the wrap or the friction that "
            "holds it, or the belt's damping"
        )
    if sliders:
        names = ", ".join(one["name"] for one in sliders)
        return f"the belt slides on {names}, and is quiet: {sliders[0]['reason']}"
    return (
        "no pulley slides on its whole arc: the belt creeps and adheres, and there is no squeal by "
        "this mechanism. Onset and frequency say what would be if one did"
    )


def squeal_tables(document: dict[str, Any], units: TableUnits) -> Group:
    """The tables of `beltjax squeal`, from its JSON document."""
    if document["pulleys"] is None:
        return Group(escape(f"{titled(document)}: the running drive was not found"))
    lines = [*warning_lines(document), _table(document, units), document["verdict"]]
    steep = [
        f"{one['name']} ({one['entry_angle_deg']:.2f})"
        for one in document["pulleys"]
        if one["entry_angle_deg"] is not None and one["entry_angle_deg"] > GUIDELINE
    ]
    if steep:
        lines.append(
            f"the belt enters {', '.join(steep)} at more than {GUIDELINE:g} deg, a guideline for "
            "chirp by misalignment"
        )
    return Group(*lines)


def _table(document: dict[str, Any], units: TableUnits) -> Table:
    speed = units.name("m/s")
    table = plain_table(
        escape(f"{titled(document)}: squeal of the belt where it slides"),
        "pulley",
        "slip margin",
        "dynamic",
        f"onset ({speed})",
        f"fold ({speed})",
        "squeal (Hz)",
        "growth (1/s)",
        "critical damping (N s/m)",
        "runaway (1/s)",
    )
    for one in document["pulleys"]:
        table.add_row(
            escape(one["name"]),
            number(one["slip_margin"], 3),
            number(one["dynamic_slip_margin"], 3),
            units.text(one["onset_speed"], "m/s", 3),
            units.text(one["fold_speed"], "m/s", 3),
            number(one["squeal_hz"], 0),
            number(one["growth"], 1),
            number(one["critical_damping"], 1),
            number(one["runaway_rate"], 1),
        )
    return table
