"""Pictures of drives."""

import io
import os

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from beltjax.drive.components import Drive
from beltjax.drive.layout import Layout
from beltjax.writing import write_whole

# Okabe and Ito's palette, which people with any color vision can tell apart.
BEFORE, AFTER, ARM = "#999999", "#0072B2", "#D55E00"


def belt_path(drive: Drive, at: Layout) -> np.ndarray:
    """Points [m] along the belt, closed: each span's two ends and the arc that follows it."""
    starts, ends, centers = (np.asarray(x) for x in (at.starts, at.ends, at.centers))
    turn = np.asarray(drive.faces * drive.sense)
    pieces = []
    for i in range(len(starts)):
        j = (i + 1) % len(starts)
        pieces.append(np.stack([starts[i], ends[i]]))
        arm = ends[i] - centers[j]
        angles = np.linspace(0.0, turn[j] * float(at.wraps[j]), 60)
        cos, sin = np.cos(angles), np.sin(angles)
        around = np.stack([cos * arm[0] - sin * arm[1], sin * arm[0] + cos * arm[1]], axis=-1)
        pieces.append(centers[j] + around)
    return np.concatenate([*pieces, starts[:1]])


def draw_layout(axes: Axes, drive: Drive, at: Layout, color: str, label: str, style: str) -> None:
    """Pulleys, arm and belt of one layout, in millimeters."""
    for pulley, center in zip(drive.pulleys, np.asarray(at.centers), strict=True):
        circle = np.linspace(0, 2 * np.pi, 181)
        x, y = center[:, None] + float(pulley.radius) * np.stack([np.cos(circle), np.sin(circle)])
        axes.plot(1e3 * x, 1e3 * y, style, color=color, linewidth=0.9)
    if drive.tensioner is not None:
        pivot = np.asarray(drive.tensioner.pivot)
        tip = np.asarray(drive.carried @ at.centers)
        line = 1e3 * np.stack([pivot, tip])
        shade = ARM if style == "-" else color
        axes.plot(line[:, 0], line[:, 1], style, color=shade, marker="o", markersize=4)
    path = 1e3 * belt_path(drive, at)
    axes.plot(path[:, 0], path[:, 1], style, color=color, linewidth=2.2, label=label)


def before_and_after(
    before: tuple[Drive, Layout], after: tuple[Drive, Layout], title: str
) -> Figure:
    """The layout of a drive before and after a design study, drawn over each other."""
    figure = Figure(figsize=(9.0, 9.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    draw_layout(axes, *before, color=BEFORE, label="before", style="--")
    draw_layout(axes, *after, color=AFTER, label="after", style="-")
    drive, at = after
    for pulley, center in zip(drive.pulleys, np.asarray(at.centers), strict=True):
        top = 1e3 * (center + np.array([0.0, float(pulley.radius)]))
        axes.annotate(
            pulley.name,
            tuple(top),
            (0, 4),
            textcoords="offset points",
            ha="center",
            fontsize=10,
            parse_math=False,
        )
    axes.set_aspect("equal")
    axes.set_xlabel("x [mm]")
    axes.set_ylabel("y [mm]")
    axes.set_title(title, fontsize=11, parse_math=False)
    axes.margins(y=0.12)
    axes.legend(loc="best", frameon=False)
    axes.grid(linewidth=0.3)
    return figure


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a picture in one move: the file is complete or absent."""
    content = io.BytesIO()
    kind = os.path.splitext(os.fspath(path))[1].lstrip(".") or "png"
    figure.savefig(content, format=kind, dpi=150, bbox_inches="tight")
    write_whole(path, content.getvalue())
