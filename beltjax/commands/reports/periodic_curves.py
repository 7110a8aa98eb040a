"""Pictures of periodic motions: over a period at one speed, extremes over a range of speeds."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from beltjax.analysis.periodic import PeriodicResponse
from beltjax.commands.reports.states import kind_of
from beltjax.commands.reports.units import TableUnits
from beltjax.commands.reports.vibrating import RPM
from beltjax.draw.curves import Panels, period_figure, response_figure
from beltjax.draw.layouts import picture_bytes
from beltjax.drive.system import Drive
from beltjax.results import succeeded

_TIMES = 400


def periodic_picture(
    path: str,
    drive: Drive,
    units: TableUnits,
    speeds: np.ndarray,
    found: Sequence[PeriodicResponse],
) -> bytes:
    """The picture, in the format that the path names."""
    if len(speeds) == 1:
        turns, panels = _over_a_period(drive, units, float(speeds[0]), found[0])
        title = f"{drive.name}: one period at {speeds[0] * RPM:.5g} rpm"
        return picture_bytes(period_figure(title, turns, panels), path)
    good = np.array([bool(succeeded(one.result)) for one in found])
    unstable = good & np.array([not bool(one.stable) for one in found])

    def table(of: Callable[[PeriodicResponse], object]) -> np.ndarray:
        rows = np.array([np.asarray(of(one)) for one in found])
        return np.where(good[:, None], rows, np.nan)

    motions = table(lambda one: one.measures.travels)
    panels = {
        **_rotations(drive, units, table(lambda one: one.measures.rotation_amplitudes)),
        **_bodies(drive, units, motions, " p-p"),
        units.head("least tension", "N"): _named(
            drive.span_names, units.value(1.0, "N") * table(lambda one: one.measures.tension_min)
        ),
        units.head("deflection", "m"): _named(
            drive.span_names, units.value(1.0, "m") * table(lambda one: one.measures.span_peaks)
        ),
    }
    title = f"{drive.name}: periodic motion"
    rpm = speeds * RPM
    return picture_bytes(response_figure(title, rpm, panels, unstable, "unstable"), path)


def _over_a_period(
    drive: Drive, units: TableUnits, speed: float, found: PeriodicResponse
) -> tuple[np.ndarray, Panels]:
    """Rotations of the driver, and the curves over them."""
    times = np.linspace(0.0, float(found.period), _TIMES)
    panels = moved_panels(
        drive,
        units,
        found.rotations(times),
        found.tensioner_motions(times),
        found.tensions(times),
    )
    return speed * times / (2 * np.pi), panels


def moved_panels(
    drive: Drive, units: TableUnits, rotations: Any, motions: Any, tensions: Any
) -> Panels:
    """Rotations of pulleys, motions of tensioners and tensions of spans, all by time."""
    return {
        **_rotations(drive, units, np.asarray(rotations)),
        **_bodies(drive, units, np.asarray(motions), ""),
        units.head("tension", "N"): _named(
            drive.span_names, units.value(1.0, "N") * np.asarray(tensions)
        ),
    }


def _named(names: Sequence[str], table: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip(names, table.T, strict=True))


def _rotations(drive: Drive, units: TableUnits, table: np.ndarray) -> Panels:
    scaled = units.value(1.0, "rad") * table
    return {units.head("rotation", "rad"): _named(drive.pulley_names, scaled)}


def _bodies(drive: Drive, units: TableUnits, table: np.ndarray, what: str) -> Panels:
    panels: Panels = {}
    for k, body in enumerate(drive.tensioners):
        unit = "rad" if kind_of(body) == "rotary" else "m"
        curves = panels.setdefault(units.head(f"tensioner{what}", unit), {})
        curves[body.name] = units.value(1.0, unit) * table[:, k]
    return panels
