"""The work of `beltjax response`: it turns a drive file into a report."""

import functools
import os
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from rich.console import Group
from rich.markup import escape

from beltjax.analysis.damping import Damping
from beltjax.analysis.orders import ORDER
from beltjax.analysis.response import Excitation, Response, speed_response
from beltjax.analysis.sweep import CHUNK
from beltjax.commands.reports.arguments import (
    read_amplitude,
    read_named,
    read_option,
    read_range,
    titled,
)
from beltjax.commands.reports.documents import (
    Part,
    PointDocument,
    Row,
    meaning,
    model_flags,
    plain,
)
from beltjax.commands.reports.report import Report
from beltjax.commands.reports.states import Kind, kind_of
from beltjax.commands.reports.tables import number, plain_table
from beltjax.commands.reports.units import TableUnits
from beltjax.commands.reports.vibrating import RPM, all_failed, vibrating
from beltjax.commands.reports.warnings import (
    file_warnings,
    range_warnings,
    response_warnings,
    warning_lines,
)
from beltjax.commands.running import Advance
from beltjax.compiling.quick import in_chunks, quickly_compiled
from beltjax.drive.bodies import single_arm
from beltjax.drive.canonical import canonical, canonical_name
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.results import explanations

MODAL_DAMPING = 0.02


class SwingPart(Part):
    """A complex amplitude over the speeds."""

    amplitude: Row | list[Row] = meaning("zero to peak")
    phase: Row | list[Row] = meaning("rad")


class PeakPart(Part):
    """An amplitude over the speeds."""

    amplitude: list[Row] = meaning("zero to peak")


class ResponseDocument(PointDocument):
    """`beltjax response`: rows by speed, columns by pulley or span."""

    success: bool = meaning("whether any speed succeeded")
    order: float = meaning("of the excitation, per rotation of the driver")
    driver_speed_rpm: list[float] = meaning("rpm")
    hertz: list[float] = meaning("Hz, of the excitation")
    pulleys: list[str] = meaning("names of the columns")
    spans: list[str] = meaning("names of the columns")
    pulley_rotation: SwingPart = meaning("rad")
    arm_rotation: SwingPart | None = meaning("rad; null unless one arm carries one pulley")
    coordinates: dict[str, SwingPart] = meaning("of each tensioner, by its name: rad, or m")
    coordinate_kinds: dict[str, Kind] = meaning("of each tensioner")
    span_peak: PeakPart = meaning("m, largest deflection of each span")
    tension: SwingPart = meaning("N, fluctuation of each span's tension")
    hub_load: PeakPart = meaning("N, on each pulley")
    slack_factor: Row = meaning(
        "part of the excitation from which on each span goes slack; null: none does"
    )
    failures: list[str | None] = meaning("why each speed failed")


class ResponseOptions(NamedTuple):
    """The options of `beltjax response`, as text; None stands for the file's, or the usual one."""

    crank: str | None
    torques: Sequence[str]
    order: float | None
    speeds: str
    modal_damping: float | None
    duty: str | None = None
    driver: str | None = None


def response_report(
    path: str | os.PathLike[str],
    given: ResponseOptions,
    figure: str | None,
    advance: Advance,
    si: bool = False,
) -> Report:
    """Force the drive of a file over a range of speeds.

    Raises `FileError` as `sweep_report` does.
    """
    drive, point, at = vibrating(path, given.duty)
    free = is_free(point, given.driver)
    excitation = _excitation(path, drive, point, given, free)
    order = _order(point, given)
    if not 0 < order < np.inf:
        raise FileError("--order", "", f"found {order:g}; give a positive order")
    speeds = read_option("--speeds", lambda: read_range(given.speeds, "rad/s"))
    if not speeds[0] > 0:
        raise FileError("--speeds", "", f"found {given.speeds!r}; begin above 0")
    ratio = MODAL_DAMPING if given.modal_damping is None else given.modal_damping
    damping = read_option("--modal-damping", lambda: Damping(modal=ratio))
    shaken = excitation, jnp.asarray(order), damping
    found = _responses(drive, point, speeds, *shaken, free, advance)
    document = response_document(drive, order, speeds, found)
    document["at"] = at
    document["warnings"] += [*file_warnings(drive), *range_warnings(drive, point, speeds)]
    units = TableUnits(drive, si)
    files: tuple[tuple[str, bytes], ...] = ()
    if figure:
        from beltjax.draw.curves import response_figure  # slow to load
        from beltjax.draw.layouts import picture_bytes

        title = f"{drive.name}: response to order {order:g}"
        rpm = np.array(document["driver_speed_rpm"])
        slack = np.min(np.asarray(found.slack_factors), axis=1) < 1
        picture = response_figure(title, rpm, response_curves(document, units), slack)
        files = ((figure, picture_bytes(picture, figure)),)
    failure = all_failed(path, "operation.driver_speed", explanations(found.result))
    return Report(document, response_tables(document, units), failure, files)


def _order(point: OperatingPoint, given: ResponseOptions) -> float:
    if given.order is not None:
        return given.order
    file = point.excitation
    return ORDER if file is None or file.order is None else float(file.order)


def _excitation(
    path: str | os.PathLike[str],
    drive: Drive,
    point: OperatingPoint,
    given: ResponseOptions,
    free: bool,
) -> Excitation:
    """The command's crank motion and torques; the file's where the command names neither."""
    file = point.excitation
    if given.crank is not None or given.torques:
        crank, torques = commanded(drive, given.crank, given.torques, free)
    elif file is not None:
        crank, torques = file.crank, file.torque
    else:
        crank, torques = None, {}
    crank = 0.0 if crank is None else crank
    if not (float(crank) or any(map(float, torques.values()))):
        message = "is not excited; give --crank, --torque NAME=AMPLITUDE or a table [excitation]"
        if file is not None and file.orders:
            message = "has excitation.orders, which are for `periodic`; give --crank or --torque"
        raise FileError(path, "", message)
    # A torque on every pulley, most of them zero, so that all excitations compile once.
    return Excitation(crank, {name: torques.get(name, 0.0) for name in drive.pulley_names})


def commanded(
    drive: Drive, crank_text: str | None, torque_texts: Sequence[str], free: bool
) -> tuple[float, dict[str, float]]:
    """Amplitudes of a command's crank motion [rad] and torques [N m]; raises `FileError`."""
    crank = read_option("--crank", lambda: read_amplitude(crank_text or "0", "rad"))
    torques = {}
    for text in torque_texts:
        name, size = read_option("--torque", lambda text=text: read_named(text, "NAME=AMPLITUDE"))
        if name in torques:
            raise FileError("--torque", "", f"names {name!r} twice; remove one of them")
        torques[name] = read_option("--torque", lambda size=size: read_amplitude(size, "N m"))
    read_option("--torque", lambda: Excitation(crank, torques).on(drive.pulley_names))
    driver = drive.pulley_names[int(np.argmax(drive.drives))]
    if driver in torques and not free:
        message = f"the motion of the driver {driver!r} is given; use --crank or --driver free"
        raise FileError("--torque", "", message)
    if crank and free:
        message = f"the driver is free; use --torque {driver}=AMPLITUDE or --driver prescribed"
        raise FileError("--crank", "", message)
    return crank, torques


def is_free(point: OperatingPoint, option: str | None) -> bool:
    """Whether the driver turns by its torque: as the option --driver says, else as the file."""
    file = point.excitation
    return (option or (file.driver if file is not None else "")) == "free"


def _responses(
    drive: Drive,
    point: OperatingPoint,
    speeds: np.ndarray,
    excitation: Excitation,
    order: Array,
    damping: Damping,
    free: bool,
    advance: Advance,
) -> Response:
    """Chunk by chunk, so that progress shows."""
    torques = excitation.on(drive.pulley_names)
    named = {canonical_name(i): torque for i, torque in enumerate(torques)}
    shaken = Excitation(excitation.crank, named)
    numbers = canonical(drive, point)

    def run(chunk: np.ndarray) -> Response:
        return quickly_compiled(_response)(
            *numbers, jnp.asarray(chunk), shaken, order, damping, free
        )

    return in_chunks(run, speeds, CHUNK, functools.partial(advance, "forcing"))


def _response(
    drive: Drive,
    point: OperatingPoint,
    speeds: Array,
    excitation: Excitation,
    order: Any,
    damping: Damping,
    free: bool,
) -> Response:
    return speed_response(
        drive, point, speeds, excitation, order=order, damping=damping, free=free, throw=False
    )


def response_document(
    drive: Drive, order: float, speeds: np.ndarray, found: Response
) -> dict[str, Any]:
    """Amplitudes (zero to peak) and phases over the driver's speed; null where it failed."""
    failures = [text or None for text in explanations(found.result)]
    good = np.array([text is None for text in failures])

    def kept(table: Any) -> np.ndarray:
        table = np.asarray(table)
        return np.where(good.reshape(-1, *[1] * (table.ndim - 1)), table, np.nan)

    def complex_of(table: Any) -> dict[str, Any]:
        table = kept(table)
        return {"amplitude": plain(np.abs(table)), "phase": plain(np.angle(table))}

    names = [body.name for body in drive.tensioners]
    motions = kept(found.tensioner_motions)
    return {
        "drive": drive.name,
        "model": model_flags(drive),
        "success": bool(good.any()),
        "warnings": response_warnings(drive, found),
        "order": order,
        "driver_speed_rpm": plain(speeds * RPM),
        "hertz": plain(order * speeds / (2 * np.pi)),
        "pulleys": list(drive.pulley_names),
        "spans": list(drive.span_names),
        "pulley_rotation": complex_of(found.rotations),
        "arm_rotation": complex_of(found.arm_rotation) if single_arm(drive) else None,
        "coordinate_kinds": {body.name: kind_of(body) for body in drive.tensioners},
        "coordinates": {name: complex_of(motions[:, k]) for k, name in enumerate(names)},
        "span_peak": {"amplitude": plain(kept(found.span_peaks))},
        "tension": complex_of(found.tensions),
        "hub_load": {"amplitude": plain(kept(found.hub_loads))},
        "slack_factor": plain(np.min(kept(found.slack_factors)[good], axis=0, initial=np.inf)),
        "failures": failures,
    }


def response_curves(
    document: dict[str, Any], units: TableUnits
) -> dict[str, dict[str, np.ndarray]]:
    """Amplitude curves by what they measure and by part, in the units of tables."""
    pulleys, spans = document["pulleys"], document["spans"]
    kinds = {
        "pulley rotation": ("pulley_rotation", pulleys, "rad"),
        "arm rotation": ("arm_rotation", ["arm"], "rad"),
        "span deflection": ("span_peak", spans, "m"),
        "tension fluctuation": ("tension", spans, "N"),
        "hub load": ("hub_load", pulleys, "N"),
    }
    curves: dict[str, dict[str, np.ndarray]] = {}

    def add(kind: str, unit: str, names: list[str], swing: dict[str, Any]) -> None:
        table = units.value(1.0, unit) * np.array(swing["amplitude"], dtype=float)
        columns = table.reshape(len(table), -1).T
        curves.setdefault(units.head(kind, unit), {}).update(zip(names, columns, strict=True))

    for kind, (key, names, unit) in kinds.items():
        if document[key] is not None:
            add(kind, unit, names, document[key])
    if document["arm_rotation"] is None:
        for name, swing in document["coordinates"].items():
            unit = "rad" if document["coordinate_kinds"][name] == "rotary" else "m"
            add("tensioner motion", unit, [name], swing)
    return curves


def response_tables(document: dict[str, Any], units: TableUnits) -> Group:
    """The largest amplitude of every part, and at which speed."""
    table = plain_table(
        escape(f"{titled(document)}: peaks of the response to order {document['order']:g}"),
        "of",
        "zero to peak",
        "at (rpm)",
        "at (Hz)",
    )
    for kind, curves in response_curves(document, units).items():
        for name, curve in curves.items():
            if np.isfinite(curve).any():
                at = int(np.nanargmax(curve))
                rpm, hertz = document["driver_speed_rpm"][at], document["hertz"][at]
                row = f"{curve[at]:.4g}", number(rpm, 0), number(hertz, 1)
                table.add_row(escape(f"{kind}, {name}"), *row)
    lines = warning_lines(document)
    failed = [text for text in document["failures"] if text]
    if not failed:
        return Group(*lines, table)
    count = len(document["failures"])
    return Group(*lines, table, f"{len(failed)} of {count} speeds failed; the first: {failed[0]}")
