"""Pictures of drives."""

import io
import os

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from beltjax.analysis.modes import Modes
from beltjax.draw.labels import mode_labels
from beltjax.drive.bodies import bodies, moved_pulleys
from beltjax.drive.layout import Layout
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive

# Okabe and Ito's palette, which people with any color vision can tell apart.
BEFORE, AFTER, ARM = "#999999", "#0072B2", "#D55E00"
_REACH = 0.08  # of a mode's largest movement, in sizes of the drive


def belt_paths(drive: Drive, at: Layout) -> list[np.ndarray]:
    """Points [m] along each belt, closed: each span's two ends and the arc that follows it."""
    loops = drive.loops
    return [
        _belt_path(drive, at, range(start, start + size))
        for start, size in zip(loops.starts.tolist(), loops.sizes, strict=True)
    ]


def _belt_path(drive: Drive, at: Layout, spans: range) -> np.ndarray:
    starts, ends, centers = (np.asarray(x) for x in (at.starts, at.ends, at.centers))
    turn = np.asarray(drive.faces * drive.senses)
    pieces = []
    for i in spans:
        j = i + 1 if i + 1 in spans else spans[0]
        pieces.append(np.stack([starts[i], ends[i]]))
        arm = ends[i] - centers[j]
        angles = np.linspace(0.0, turn[j] * float(at.wraps[j]), 60)
        cos, sin = np.cos(angles), np.sin(angles)
        around = np.stack([cos * arm[0] - sin * arm[1], sin * arm[0] + cos * arm[1]], axis=-1)
        pieces.append(centers[j] + around)
    return np.concatenate([*pieces, starts[spans[0]][None]])


def draw_layout(
    axes: Axes,
    drive: Drive,
    at: Layout,
    color: str,
    label: str,
    style: str,
    width: float = 2.2,
) -> None:
    """Pulleys, arm and belt of one layout, in millimeters; the belt `width` points wide."""
    for pulley, center in zip(drive.pulleys, np.asarray(at.centers), strict=True):
        circle = np.linspace(0, 2 * np.pi, 181)
        x, y = center[:, None] + float(pulley.radius) * np.stack([np.cos(circle), np.sin(circle)])
        axes.plot(1e3 * x, 1e3 * y, style, color=color, linewidth=0.9)
    shade = ARM if style == "-" and color != BEFORE else color
    draw_bodies(axes, drive, np.asarray(at.coordinates), style, shade)
    for k, path in enumerate(belt_paths(drive, at)):
        line = 1e3 * path
        # Two belts that lie over each other differ by their width.
        wide, name = width / (1 + 0.4 * k), label if k == 0 else ""
        axes.plot(line[:, 0], line[:, 1], style, color=color, linewidth=wide, label=name)


def draw_bodies(axes: Axes, drive: Drive, coordinates: np.ndarray, style: str, color: str) -> None:
    """The tensioners: arms from pivot to pulleys, slides as short lines along their direction."""
    if not drive.tensioners:
        return
    of, centers = bodies(drive), np.asarray(drive.centers)
    at = jnp.asarray(coordinates)
    pulleys = moved_pulleys(drive, at)
    tips = 1e3 * np.stack([pulleys.x, pulleys.y], axis=-1)
    feet = 1e3 * np.asarray(pulleys.pivots)
    reach = 50 * np.ptp(centers, axis=0).max()
    for a, body in enumerate(drive.tensioners):
        for p in np.flatnonzero(np.asarray(of.carries[:, a])):
            if float(body.kind):
                line = np.stack([feet[a], tips[p]])
            else:
                along = np.array([float(pulleys.by_x[p, a]), float(pulleys.by_y[p, a])])
                line = tips[p] + reach * np.outer([-1.0, 1.0], along)
            axes.plot(*line.T, style, color=color, marker="o", markersize=4)


def before_and_after(
    before: tuple[Drive, Layout], after: tuple[Drive, Layout], title: str
) -> Figure:
    """The layout of a drive before and after a design study, drawn over each other."""
    figure = Figure(figsize=(9.0, 9.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    draw_layout(axes, *before, color=BEFORE, label="before", style="--")
    draw_layout(axes, *after, color=AFTER, label="after", style="-")
    _finish(axes, *after, title)
    axes.legend(loc="best", frameon=False)
    return figure


def layout_figure(drive: Drive, at: Layout, size: float = 9.0) -> Figure:
    """One layout: pulleys with their names, tensioners and belts; `size` in inches."""
    figure = Figure(figsize=(size, size), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    draw_layout(axes, drive, at, color=AFTER, label="", style="-")
    _finish(axes, drive, at, drive.name)
    return figure


def _finish(axes: Axes, drive: Drive, at: Layout, title: str) -> None:
    """Names, scales and a title for a drawn layout."""
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
    for label, name, start in zip(
        (axes.set_xlabel, axes.set_ylabel), "xy", drive.origin, strict=True
    ):
        label(f"{name} from {start:.12g} m [mm]" if start else f"{name} [mm]")
    axes.set_title(title, fontsize=11, parse_math=False)
    axes.margins(y=0.12)
    axes.grid(linewidth=0.3)


def mode_shapes(drive: Drive, point: OperatingPoint, modes: Modes, shown: int = 6) -> Figure:
    """The first modes on the layout: spans deflected along their normals, pulleys turned, arm.

    All parts of a mode are drawn to one scale, a span's deflection beside a rim's travel, at the
    moment when the part with the largest kinetic energy is farthest out. Thin lines: at rest.
    """
    count = min(shown, len(modes.frequencies))
    rows = -(-count // 2)
    labels = mode_labels(drive, modes)
    paths = belt_paths(drive, modes.linearization.steady.reference.layout)
    wide, high = np.ptp(np.concatenate(paths), axis=0)
    figure = Figure(figsize=(12.0, rows * (1.0 + 5.5 * high / wide)), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, 2, squeeze=False).ravel()
    for axes in panels[count:]:
        axes.set_axis_off()
    for k, axes in enumerate(panels[:count]):
        draw_mode(axes, drive, float(point.travel), modes, k)
        hertz = float(modes.frequencies[k]) / (2 * np.pi)
        axes.set_title(f"{k + 1}: {hertz:.1f} Hz, {labels[k]}", fontsize=10, parse_math=False)
    figure.suptitle(drive.name, fontsize=11, parse_math=False)
    return figure


def draw_mode(
    axes: Axes, drive: Drive, travel: float, modes: Modes, k: int, enlarged: float = 0.0
) -> None:
    """Mode k on the layout, without axes; about the steady deflections, so much enlarged."""
    at = modes.linearization.steady.reference.layout
    x = np.linspace(0.0, 1.0, 81)
    spans = [np.real(modes.deflection(k, i, jnp.asarray(x))) for i in range(len(drive.pulleys))]
    radii, centers = np.asarray(drive.radii), np.asarray(at.centers)
    # Rotations are in the direction of travel: counterclockwise inside a counterclockwise loop.
    turn = travel * np.asarray(drive.faces * drive.senses)
    rotations = turn * np.real(modes.rotations[k])
    moved = np.real(np.asarray(modes.tensioner_motions[k]))
    reach = [np.max(np.abs(spans)), np.max(np.abs(radii * rotations))]
    there = moved_pulleys(drive, at.coordinates)
    travel_of = np.hypot(np.asarray(there.by_x @ moved), np.asarray(there.by_y @ moved))
    reach.append(np.max(travel_of, initial=0.0))
    scale = _REACH * float(np.ptp(np.asarray(at.starts), axis=0).max()) / max(reach)
    draw_layout(axes, drive, at, color=BEFORE, label="", style="-", width=0.8)
    steady = modes.linearization.steady
    for i, w in enumerate(spans):
        start, end, normal = (np.asarray(part[i]) for part in (at.starts, at.ends, at.normals))
        line = start + x[:, None] * (end - start)
        if enlarged:
            rest = np.asarray(steady.deflection(i, jnp.asarray(x))) * float(at.span_lengths[i])
            line = line + enlarged * rest[:, None] * normal
            axes.plot(*(1e3 * line.T), "--", color="black", linewidth=1.2)
        axes.plot(*(1e3 * (line + scale * w[:, None] * normal).T), color=AFTER, linewidth=1.8)
    for center, radius, angle in zip(centers, radii, scale * rotations, strict=True):
        _draw_turn(axes, center, float(radius), float(angle))
    draw_bodies(axes, drive, np.asarray(at.coordinates) + scale * moved, "-", ARM)
    axes.set_aspect("equal")
    axes.set_axis_off()


def _draw_turn(axes: Axes, center: np.ndarray, radius: float, angle: float) -> None:
    """A spoke that stands upright at rest, turned, and the arc that its end has run through."""
    angles = np.pi / 2 + np.linspace(0.0, angle, 40)
    arc = center + 0.9 * radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    axes.plot(*(1e3 * np.stack([center, arc[0]]).T), color=BEFORE, linewidth=0.8)
    axes.plot(*(1e3 * np.stack([center, arc[-1]]).T), color=AFTER, linewidth=1.4)
    axes.plot(*(1e3 * arc.T), color=AFTER, linewidth=1.0)


def picture_bytes(figure: Figure, path: str | os.PathLike[str]) -> bytes:
    """A picture as the file of that name would hold it; the name's ending says which kind."""
    content = io.BytesIO()
    kind = os.path.splitext(os.fspath(path))[1].lstrip(".") or "png"
    figure.savefig(content, format=kind, dpi=150, bbox_inches="tight")
    return content.getvalue()
