"""Pictures of transients: over the driver's speed with orders, or over time."""

from collections.abc import Sequence

import numpy as np

from beltjax.analysis.transient import Transient
from beltjax.commands.reports.periodic_curves import moved_panels
from beltjax.commands.reports.units import TableUnits
from beltjax.commands.reports.vibrating import RPM
from beltjax.draw.curves import period_figure, run_up_figure
from beltjax.draw.layouts import picture_bytes
from beltjax.draw.spectra import Spectrogram, spectrogram
from beltjax.drive.system import Drive

_MOST = 2**14  # times of a curve
_ORDERS = (1.0, 2.0, 4.0)  # drawn where nothing excites
_ABOVE = 1.5  # how far above the highest order a spectrogram reaches
_LOWEST = 200.0  # [Hz], and at least so far


def transient_picture(
    path: str, drive: Drive, units: TableUnits, found: Transient, orders: Sequence[float]
) -> bytes:
    """The picture, in the format that the path names."""
    times, speeds = np.asarray(found.times), np.asarray(found.driver_speeds)
    step = -(-len(times) // (_MOST + 1))
    kept = times[::step]
    panels = moved_panels(
        drive, units, found.rotations(kept), found.tensioner_motions(kept), found.tensions(kept)
    )
    one_way = np.all(np.diff(speeds) > 0) or np.all(np.diff(speeds) < 0)
    if not (one_way and _evenly(times)):
        title = f"{drive.name}: motion over time"
        return picture_bytes(period_figure(title, kept, panels, "time (s)"), path)
    drawn = [float(order) for order in orders] or list(_ORDERS)
    title = f"{drive.name}: run-up" if speeds[-1] > speeds[0] else f"{drive.name}: run-down"
    span, spectrum = _tension_spectrum(drive, units, found, max(drawn))
    return picture_bytes(
        run_up_figure(
            title, speeds[::step] * RPM, panels, spectrum, f"tension of {span}, {units.name('N')}",
            drawn,
        ),
        path,
    )  # fmt: skip


def _evenly(times: np.ndarray) -> bool:
    steps = np.diff(times)
    return bool(np.ptp(steps) < 1e-6 * steps[0])


def _tension_spectrum(
    drive: Drive, units: TableUnits, found: Transient, highest: float
) -> tuple[str, Spectrogram]:
    """The spectrogram of the tension that swings most, and its span."""
    times, speeds = np.asarray(found.times), np.asarray(found.driver_speeds)
    tensions = np.asarray(found.tensions(times)) * units.value(1.0, "N")
    worst = int(np.argmax(np.ptp(tensions, axis=0)))
    top = max(_ABOVE * highest * speeds.max() / (2 * np.pi), _LOWEST)
    spectrum = spectrogram(times, tensions[:, worst], top)
    at = np.interp(spectrum.at, times, speeds) * RPM
    return drive.span_names[worst], spectrum._replace(at=at)
