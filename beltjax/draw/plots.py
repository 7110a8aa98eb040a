"""What `.plot()` draws of a drive or a result; found by its type."""

import functools
import io
import os
import re
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from beltjax import optimize
from beltjax.analysis.contact import ContactState
from beltjax.analysis.modes import Modes
from beltjax.analysis.moving_beam import SpanFrequencies
from beltjax.analysis.reference import ReferenceState
from beltjax.analysis.response import Response
from beltjax.analysis.steady import SteadyState
from beltjax.draw.contact import contact_figure
from beltjax.draw.layouts import (
    AFTER,
    before_and_after,
    draw_layout,
    layout_figure,
    picture_bytes,
)
from beltjax.drive.layout import Layout, layout
from beltjax.drive.system import Drive
from beltjax.files.writing import write_whole

_LOADS = 0.25  # length of the largest hub load, in sizes of the drive
_PURPLE = "#8A1C5B"


class Picture:
    """A figure that a notebook shows by itself; `figure` is Matplotlib's."""

    def __init__(self, figure: Figure):
        self.figure = figure

    def _repr_svg_(self) -> str:
        return svg_of(self.figure)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the picture; the name's ending says which kind it is."""
        write_whole(path, picture_bytes(self.figure, path))


def svg_of(figure: Figure) -> str:
    """A figure as an SVG element; one figure always gives one text."""
    content = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "beltjax"}):  # else names are drawn by chance
        figure.savefig(content, format="svg", metadata={"Date": None}, bbox_inches="tight")
    svg = content.getvalue()
    return re.sub("<metadata>.*?</metadata>", "", svg[svg.index("<svg") :], flags=re.DOTALL)


def plotted(result: Any, drive: Drive | None = None) -> Picture:
    """The picture of a drive or a result; `drive` gives names and outlines where it lacks them.

    Raises:
        TypeError: there is no picture of such an object.
        ValueError: its picture needs the drive.
    """
    return Picture(_figure(result, drive))


@functools.singledispatch
def _figure(result: Any, drive: Drive | None) -> Figure:
    kinds = sorted(kind.__name__ for kind in _figure.registry if kind is not object)
    raise TypeError(
        f"there is no picture of {type(result).__name__}; there are of {', '.join(kinds)}"
    )


def _needed(drive: Drive | None, result: Any) -> Drive:
    if drive is None:
        raise ValueError(f"a picture of {type(result).__name__} needs the drive: give .plot(drive)")
    return drive


@_figure.register
def _(result: Drive, drive: Drive | None) -> Figure:
    return layout_figure(result, layout(result, throw=False), 6.0)


@_figure.register
def _(result: Layout, drive: Drive | None) -> Figure:
    return layout_figure(_needed(drive, result), result, 6.0)


@_figure.register
def _(result: ReferenceState, drive: Drive | None) -> Figure:
    return layout_figure(_needed(drive, result), result.layout, 6.0)


@_figure.register
def _(result: SteadyState, drive: Drive | None) -> Figure:
    """Gamma and tension of each span; with the drive also the layout with its hub loads."""
    if drive is None:
        figure, (left, right) = _row(1, 2)
        names = [str(i) for i in range(len(result.coupling))]
    else:
        figure = Figure(figsize=(9.0, 8.5), layout="constrained")
        FigureCanvasAgg(figure)
        grid = figure.add_gridspec(2, 2, height_ratios=[2.4, 1.0])
        _draw_state(figure.add_subplot(grid[0, :]), drive, result)
        left, right = (figure.add_subplot(grid[1, k]) for k in (0, 1))
        names = list(drive.span_names)
    _bars(left, names, np.asarray(result.coupling), "coupling indicator Gamma")
    _bars(right, names, np.asarray(result.running_tensions), "running tension (N)")
    return figure


@_figure.register
def _(result: Modes, drive: Drive | None) -> Figure:
    """The frequencies, and whose kinetic energy each mode has."""
    figure, (axes,) = _row(1, 1)
    hertz = np.asarray(result.frequencies) / (2 * np.pi)
    shares = {
        "spans": np.sum(np.asarray(result.span_shares), axis=1),
        "pulleys": np.sum(np.asarray(result.rotor_shares), axis=1),
        "tensioners": np.asarray(result.tensioner_shares),
    }
    start, places = np.zeros(len(hertz)), np.arange(len(hertz))
    for (label, share), color in zip(shares.items(), (AFTER, "#E69F00", "#D55E00"), strict=True):
        axes.barh(places, share, left=start, color=color, label=label)
        start = start + share
    axes.set_yticks(places, [f"{k + 1}: {f:.1f} Hz" for k, f in enumerate(hertz)])
    axes.invert_yaxis()
    axes.set_xlabel("share of the kinetic energy")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    return figure


@_figure.register
def _(result: SpanFrequencies, drive: Drive | None) -> Figure:
    figure, (axes,) = _row(1, 1)
    hertz = np.asarray(result.hertz)
    names = [str(i) for i in range(len(hertz))] if drive is None else list(drive.span_names)
    _bars(axes, names, hertz[:, 0], "lowest frequency of the span taken alone (Hz)")
    return figure


@_figure.register
def _(result: Response, drive: Drive | None) -> Figure:
    """The largest deflection of each span over the frequency."""
    figure, (axes,) = _row(1, 1)
    hertz = np.asarray(result.frequencies) / (2 * np.pi)
    peaks = 1e3 * np.asarray(result.span_peaks)
    names = [str(i) for i in range(peaks.shape[1])] if drive is None else drive.span_names
    for name, one in zip(names, peaks.T, strict=True):
        axes.plot(hertz, one, marker="o" if len(hertz) < 3 else None, label=name)
    axes.set_xlabel("frequency (Hz)")
    axes.set_ylabel("largest deflection of the span (mm)")
    axes.grid(linewidth=0.3)
    legend = axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    for text in legend.get_texts():
        text.set_parse_math(False)
    return figure


@_figure.register
def _(result: ContactState, drive: Drive | None) -> Figure:
    return contact_figure(_needed(drive, result), result)


@_figure.register
def _(result: optimize.Design, drive: Drive | None) -> Figure:
    """The design; with the drive that the study is of, before and after."""
    after = result.drive, result.steady.reference.layout
    if drive is None:
        return layout_figure(*after, 6.0)
    ends = ("-" if x is None else f"{x:.4g}" for x in (result.initial, result.final))
    before = drive, result.before.reference.layout
    return before_and_after(before, after, f"objective {' to '.join(ends)}")


def _row(rows: int, columns: int) -> tuple[Figure, np.ndarray]:
    figure = Figure(figsize=(4.6 * columns + 2.0, 3.2 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False).ravel()


def _bars(axes: Axes, names: list[str], values: np.ndarray, label: str) -> None:
    axes.barh(np.arange(len(names)), values, color=AFTER)
    axes.set_yticks(np.arange(len(names)), names, parse_math=False)
    axes.invert_yaxis()
    axes.set_xlabel(label)
    axes.grid(axis="x", linewidth=0.3)


def _draw_state(axes: Axes, drive: Drive, state: SteadyState) -> None:
    """The layout at rest with the force of the belt on each hub."""
    at = state.reference.layout
    draw_layout(axes, drive, at, AFTER, "", "-")
    centers, loads = 1e3 * np.asarray(at.centers), np.asarray(state.hub_loads)
    sizes = np.linalg.norm(loads, axis=1)
    far = _LOADS * float(np.ptp(centers, axis=0).max()) / max(sizes.max(), 1e-12)
    for name, center, load, size in zip(drive.pulley_names, centers, loads, sizes, strict=True):
        style = {"arrowstyle": "-|>", "color": _PURPLE}
        axes.annotate("", xy=tuple(center + far * load), xytext=tuple(center), arrowprops=style)
        axes.annotate(f"{name}\n{size:.0f} N", tuple(center), (0, -4), textcoords="offset points",
                      ha="center", va="top", fontsize=8, parse_math=False)  # fmt: skip
    axes.set_aspect("equal")
    axes.set_xlabel("x (mm)")
    axes.set_ylabel("y (mm)")
    axes.set_title(f"{drive.name}: hub loads", fontsize=11, parse_math=False)
    axes.grid(linewidth=0.3)
