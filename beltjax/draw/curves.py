"""Pictures of curves: frequencies over a sweep, responses over the driver's speed."""

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from beltjax.analysis.sweep import Sweep
from beltjax.draw.spectra import Spectrogram
from beltjax.drive.numbers import SPEEDS
from beltjax.drive.system import Drive

RPM = 60 / (2 * np.pi)  # of 1 rad/s
_MANY = 10  # curves above which a legend would hide the picture


def driver_speeds(drive: Drive, found: Sweep) -> np.ndarray | None:
    """The driver's speed [rad/s] at each value of a sweep over a speed; None for other sweeps."""
    if found.name not in SPEEDS:
        return None
    radius = float(drive.drives @ drive.radii)
    return found.values if found.name == SPEEDS[1] else found.values / radius


def sweep_figure(
    drive: Drive, found: Sweep, labels: Sequence[str], orders: Sequence[float]
) -> Figure:
    """Frequencies over the swept number, one color per mode, with lines of excitation orders.

    The lines are drawn where the swept number is a speed: `order` times the driver's rotations
    per second, the frequency that a firing order excites.
    """
    figure, axes = _picture()
    speeds = driver_speeds(drive, found)
    by_rpm = found.unit == "rad/s"
    x = found.values * (RPM if by_rpm else 1.0)
    hertz = found.frequencies / (2 * np.pi)
    colors = matplotlib.colormaps["tab20" if hertz.shape[1] > _MANY else "tab10"].colors  # pyright: ignore[reportAttributeAccessIssue]
    for k, label in enumerate(labels):
        color = colors[k % len(colors)]
        axes.plot(x, hertz[:, k], color=color, linewidth=1.6, label=f"{k + 1}: {label}")
    top = 1.05 * np.nanmax(hertz) if np.isfinite(hertz).any() else 1.0
    if speeds is not None:
        _draw_orders(axes, x, speeds / (2 * np.pi), orders, top)
    places = [veering.value * (RPM if by_rpm else 1.0) for veering in found.veerings]
    middles = [
        np.mean([np.interp(veering.value, found.values, hertz[:, k]) for k in veering.modes])
        for veering in found.veerings
    ]
    if places:
        axes.plot(places, middles, "o", mfc="none", mec="black", markersize=11, label="veering")
    unit = "rpm" if by_rpm else found.unit
    axes.set_xlabel(f"{found.name} ({unit})" if unit else found.name, parse_math=False)
    axes.set_ylabel("natural frequency (Hz)")
    axes.set_ylim(0, top)
    axes.set_title(drive.name, fontsize=11, parse_math=False)
    _legend(axes)
    return figure


def _draw_orders(
    axes: Axes,
    x: np.ndarray,
    rotations: np.ndarray,
    orders: Sequence[float],
    top: float,
    color: str = "#555555",
    below: float = 0.0,
) -> None:
    """Lines of orders, and their names `below` their ends [points]."""
    for order in orders:
        axes.plot(x, order * rotations, "--", color=color, linewidth=0.9)
        inside = np.flatnonzero(order * rotations <= top)
        if len(inside):
            at = inside[-1]
            axes.annotate(
                f"order {order:g}", (x[at], order * rotations[at]), (0, -below),
                textcoords="offset points", fontsize=8, ha="right", va="top", color=color,
            )  # fmt: skip


Panels = dict[str, dict[str, np.ndarray]]  # curves by what they measure, and by part


def response_figure(
    title: str,
    rpm: np.ndarray,
    panels: Panels,
    doubtful: np.ndarray,
    why: str = "a span goes slack",
) -> Figure:
    """Amplitudes over the driver's speed: a panel for each kind, a curve for each part.

    Speeds that are `doubtful` are hatched; `why` says for what reason.
    """
    figure, rows = _panels(title, rpm, panels)
    for axes in rows:
        # A least tension may lie below zero.
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
        axes.fill_between(
            rpm, 0, 1, where=doubtful, step="mid", transform=axes.get_xaxis_transform(),
            facecolor="none", edgecolor="#b0b0b0", hatch="//", linewidth=0,
            label=why if doubtful.any() else "_",
        )  # fmt: skip
        _legend(axes)
    rows[-1].set_xlabel("driver speed (rpm)")
    return figure


def period_figure(
    title: str, at: np.ndarray, panels: Panels, over: str = "rotations of the driver"
) -> Figure:
    """A motion over rotations or time: a panel for each kind, a curve for each part."""
    figure, rows = _panels(title, at, panels)
    for axes in rows:
        _legend(axes)
    rows[-1].set_xlabel(over)
    return figure


def run_up_figure(
    title: str,
    rpm: np.ndarray,
    panels: Panels,
    spectrum: Spectrogram,
    what: str,
    orders: Sequence[float],
) -> Figure:
    """A spectrogram over the driver's speed with the lines of orders, and curves below it."""
    figure = Figure(figsize=(9.0, 2.3 * len(panels) + 5.0), layout="constrained")
    FigureCanvasAgg(figure)
    rows = figure.subplots(
        1 + len(panels), 1, sharex=True, height_ratios=[1.8, *([1.0] * len(panels))]
    )
    top = rows[0]
    # Amplitudes differ by powers of ten between orders.
    largest = max(float(spectrum.amplitudes.max()), 1e-12)
    shown = np.maximum(spectrum.amplitudes, _FLOOR * largest)
    mesh = top.pcolormesh(
        spectrum.at, spectrum.hertz, shown, norm="log", cmap="magma", shading="auto",
        rasterized=True,
    )  # fmt: skip
    bar = figure.colorbar(mesh, ax=top, location="top", aspect=60, pad=0.01)
    bar.set_label(what, fontsize=9, parse_math=False)
    ends = np.array([min(rpm[0], rpm[-1]), max(rpm[0], rpm[-1])])
    inside = np.linspace(ends[0], ends[1], 20)[:-1]  # the names of orders stay in the picture
    _draw_orders(top, inside, inside / RPM / (2 * np.pi), orders, spectrum.hertz[-1], "#dfdfdf", 12)
    top.set_ylim(0, spectrum.hertz[-1])
    top.set_facecolor("black")  # beside the first and the last window
    top.set_ylabel("frequency (Hz)", fontsize=9)
    figure.suptitle(title, fontsize=11, parse_math=False)
    for axes, (kind, curves) in zip(rows[1:], panels.items(), strict=True):
        _draw_curves(axes, rpm, kind, curves, 0.6)
        _legend(axes)
    rows[-1].set_xlim(*ends)
    rows[-1].set_xlabel("driver speed (rpm)")
    return figure


_FLOOR = 1e-3  # of the largest amplitude; what is below is as dark


def _panels(title: str, x: np.ndarray, panels: Panels) -> tuple[Figure, np.ndarray]:
    figure = Figure(figsize=(9.0, 2.3 * len(panels) + 0.8), layout="constrained")
    FigureCanvasAgg(figure)
    rows = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (kind, curves) in zip(rows, panels.items(), strict=True):
        _draw_curves(axes, x, kind, curves, 1.4)
    rows[0].set_title(title, fontsize=11, parse_math=False)
    return figure, rows


def _draw_curves(
    axes: Axes, x: np.ndarray, kind: str, curves: dict[str, np.ndarray], width: float
) -> None:
    for name, curve in curves.items():
        axes.plot(x, curve, linewidth=width, label=name)
    axes.set_ylabel(kind, fontsize=9)
    axes.grid(linewidth=0.3)


def _picture() -> tuple[Figure, Axes]:
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.grid(linewidth=0.3)
    return figure, axes


def _legend(axes: Axes) -> None:
    """Beside the curves, so that it hides none; names are not formulas."""
    legend = axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=8)
    for text in legend.get_texts():
        text.set_parse_math(False)
