"""What `beltjax sweep` and `beltjax response` do, from a drive file to a report."""

import functools
import importlib
import os
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from beltjax.analysis.damping import Damping
from beltjax.analysis.response import Excitation, Response, speed_response
from beltjax.analysis.sweep import CHUNK, Sweep, require_count, sweep
from beltjax.drive.canonical import canonical, canonical_name
from beltjax.drive.files import load_drive
from beltjax.drive.numbers import require_number, unit_of
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.errors import FileError
from beltjax.numerics.compilation import in_chunks, quickly_compiled
from beltjax.report.jobs import Report, require_few_pulleys, require_inertias
from beltjax.report.requests import asked, read_amplitude, read_named, read_orders, read_range
from beltjax.report.vibration import (
    response_curves,
    response_document,
    response_tables,
    sweep_document,
    sweep_tables,
)
from beltjax.results import explanations

Advance = Callable[[str, int, int | None], None]
_MODAL_DAMPING = 0.02
_ORDER = 2.0  # of a four-cylinder engine's firing


def sweep_job(
    path: str | os.PathLike[str],
    over: str,
    count: int,
    orders: str,
    netcdf: str | None,
    figure: str | None,
    advance: Advance,
) -> Report:
    """Sweep one number of a drive file. Raises `FileError` for what cannot be asked."""
    drive, point = _vibrating(path)
    name, text = asked("--over", lambda: read_named(over, "NAME=FROM:TO:POINTS"))
    asked("--over", lambda: require_number(drive, name))
    values = asked("--over", lambda: read_range(text, unit_of(drive, name)))
    lines = asked("--orders", lambda: read_orders(orders))
    asked("--count", lambda: require_count(drive, count))
    found = sweep(drive, point, name, values, count=count, advance=advance)
    document = sweep_document(drive, found)
    files = []
    if netcdf:
        files.append((netcdf, _netcdf(found)))
    if figure:
        curves = importlib.import_module("beltjax.report.curves")  # slow to load
        picture = curves.sweep_figure(drive, found, document["labels"], lines)
        files.append((figure, _picture(picture, figure)))
    failure = _all_failed(path, name, found.outcomes)
    return Report(document, sweep_tables(document), failure, tuple(files))


class Forcing(NamedTuple):
    """What `beltjax response` was given, as text; None: the file's, or the usual."""

    crank: str | None
    torques: Sequence[str]
    order: float | None
    speeds: str
    modal_damping: float | None


def response_job(
    path: str | os.PathLike[str], given: Forcing, figure: str | None, advance: Advance
) -> Report:
    """Force the drive of a file over a range of speeds. Raises `FileError` as `sweep_job` does."""
    drive, point = _vibrating(path)
    excitation = _excitation(path, drive, point, given)
    order = _order(point, given)
    if not 0 < order < np.inf:
        raise FileError("--order", "", f"found {order:g}; give a positive order")
    speeds = asked("--speeds", lambda: read_range(given.speeds, "rad/s"))
    if not speeds[0] > 0:
        raise FileError("--speeds", "", f"found {given.speeds!r}; begin above 0")
    ratio = _MODAL_DAMPING if given.modal_damping is None else given.modal_damping
    damping = asked("--modal-damping", lambda: Damping(modal=ratio))
    found = _responses(drive, point, speeds, excitation, jnp.asarray(order), damping, advance)
    document = response_document(drive, order, speeds, found)
    files: tuple[tuple[str, bytes], ...] = ()
    if figure:
        curves = importlib.import_module("beltjax.report.curves")
        title = f"{drive.name}: response to order {order:g}"
        rpm = np.array(document["driver_speed_rpm"])
        slack = np.min(np.asarray(found.slack_factors), axis=1) < 1
        picture = curves.response_figure(title, rpm, response_curves(document), slack)
        files = ((figure, _picture(picture, figure)),)
    failure = _all_failed(path, "operation.driver_speed", explanations(found.result))
    return Report(document, response_tables(document), failure, files)


def _order(point: OperatingPoint, given: Forcing) -> float:
    if given.order is not None:
        return given.order
    file = point.excitation
    return _ORDER if file is None or file.order is None else float(file.order)


def _excitation(path, drive: Drive, point: OperatingPoint, given: Forcing) -> Excitation:
    """The command's crank motion and torques; the file's where the command names neither."""
    file = point.excitation
    if given.crank is not None or given.torques:
        crank, torques = _commanded(drive, given)
    elif file is not None:
        crank, torques = file.crank, file.torque
    else:
        crank, torques = None, {}
    crank = 0.0 if crank is None else crank
    if not (float(crank) or any(map(float, torques.values()))):
        message = "is not excited; give --crank, --torque NAME=AMPLITUDE or a table [excitation]"
        raise FileError(path, "", message)
    # A torque on every pulley, most of them zero, so that all excitations compile once.
    return Excitation(crank, {name: torques.get(name, 0.0) for name in drive.pulley_names})


def _commanded(drive: Drive, given: Forcing) -> tuple[float, dict[str, float]]:
    """Amplitudes of the command's crank motion [rad] and torques [N m]."""
    crank = asked("--crank", lambda: read_amplitude(given.crank or "0", "rad"))
    torques = {}
    for text in given.torques:
        name, size = asked("--torque", lambda text=text: read_named(text, "NAME=AMPLITUDE"))
        if name in torques:
            raise FileError("--torque", "", f"names {name!r} twice; remove one of them")
        torques[name] = asked("--torque", lambda size=size: read_amplitude(size, "N m"))
    asked("--torque", lambda: Excitation(crank, torques).on(drive.pulley_names))
    driver = drive.pulley_names[int(np.argmax(drive.drives))]
    if driver in torques:
        message = f"the motion of the driver {driver!r} is given; use --crank"
        raise FileError("--torque", "", message)
    return crank, torques


def _responses(
    drive, point, speeds: np.ndarray, excitation, order, damping, advance: Advance
) -> Response:
    """Chunk by chunk, so that progress shows."""
    torques = excitation.on(drive.pulley_names)
    named = {canonical_name(i): torque for i, torque in enumerate(torques)}
    shaken = Excitation(excitation.crank, named)
    numbers = canonical(drive, point)

    def run(chunk):
        return quickly_compiled(_response)(*numbers, jnp.asarray(chunk), shaken, order, damping)

    return in_chunks(run, speeds, CHUNK, functools.partial(advance, "forcing"))


def _response(drive, point, speeds, excitation, order, damping) -> Response:
    return speed_response(
        drive, point, speeds, excitation, order=order, damping=damping, throw=False
    )


def _vibrating(path: str | os.PathLike[str]) -> tuple[Drive, OperatingPoint]:
    drive, point = load_drive(path)
    require_inertias(drive, path, "vibration needs")
    require_few_pulleys(drive, path, "modes and responses")
    return drive, point


def _all_failed(path, key: str, outcomes: Sequence[str]) -> str:
    return str(FileError(path, key, f"no point succeeded: {outcomes[0]}")) if all(outcomes) else ""


def _netcdf(found: Sweep) -> bytes:
    data: Any = found.to_xarray().to_netcdf(engine="scipy")
    return bytes(data)


def _picture(picture: Any, path: str) -> bytes:
    return importlib.import_module("beltjax.report.figures").picture_bytes(picture, path)
