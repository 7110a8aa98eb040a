"""Pictures of contact: the belt on its pulleys, and its tension and speed along its length."""

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from beltjax.analysis.contact import ContactState
from beltjax.analysis.contact_path import BeltPiece, belt_pieces, span_deflection
from beltjax.analysis.steady import SteadyState
from beltjax.draw.layouts import AFTER, ARM, BEFORE, draw_bodies
from beltjax.drive.system import Drive

COLORS = {"span": AFTER, "adhesion": "#009E73", "slip": ARM}
_WORDS = {"span": "free span", "adhesion": "adhesion", "slip": "slip"}


def contact_figure(drive: Drive, state: ContactState) -> Figure:
    """Above: the belts as they lie on their pulleys. Below: tension and speed along each belt."""
    pieces = belt_pieces(state)
    points = np.concatenate([piece.positions for piece in pieces])
    wide, high = np.ptp(points, axis=0)
    figure = Figure(figsize=(9.0, 5.2 + min(9.0, 8.0 * high / wide)), layout="constrained")
    FigureCanvasAgg(figure)
    ratios = [min(9.0, 8.0 * high / wide) + 0.6, 2.2, 2.2]
    grid = figure.add_gridspec(3, len(drive.belts), height_ratios=ratios)
    whole = figure.add_subplot(grid[0, :])
    draw_contact(whole, drive, state, pieces)
    for column, belt in enumerate(drive.belts):
        own = tuple(piece for piece in pieces if drive.belt_of_span[piece.place] == column)
        tension, speed = (figure.add_subplot(grid[row, column]) for row in (1, 2))
        _draw_along(tension, own, "tension", "tension (N)")
        _draw_along(speed, own, "speed", "belt speed (m/s)")
        _name_places(tension, drive, own)
        name = "the belt" if len(drive.belts) == 1 else belt.name
        label = f"along {name}, in its direction of travel (m)"
        speed.set_xlabel(label, parse_math=False)
    feasible = "" if bool(state.feasible) else ": not physical"
    whole.set_title(f"{drive.name}{feasible}", fontsize=11, parse_math=False)
    return figure


def draw_contact(
    axes: Axes, drive: Drive, state: ContactState, pieces: tuple[BeltPiece, ...]
) -> None:
    """Pulleys, and the belt on them: its spans, and its arcs of adhesion and of slip."""
    _draw_pulleys(axes, drive, state)
    _draw_belt(axes, pieces)


def _draw_pulleys(axes: Axes, drive: Drive, state: ContactState) -> None:
    loop, model = state.solved.loop, state.model
    length, count = float(state.scales.length), len(drive.pulleys)
    names = {shaft[0]: [drive.pulley_names[place] for place in shaft] for shaft in drive.shafts}
    circle = np.linspace(0, 2 * np.pi, 181)
    for k in range(count):
        place = int(state.order.pulleys[k])
        center = 1e3 * length * np.array([float(loop.x[k]), float(loop.y[k])])
        radius = 1e3 * length * abs(float(model.rho[k]))
        axes.fill(
            center[0] + radius * np.cos(circle),
            center[1] + radius * np.sin(circle),
            facecolor="#F2F2F2",
            edgecolor=BEFORE,
            linewidth=0.8,
        )
        label = "\n".join(names.get(place, []))
        axes.annotate(label, tuple(center), ha="center", va="center", fontsize=8, parse_math=False)
    draw_bodies(axes, drive, np.asarray(state.coordinates), "-", "black")


def _draw_belt(axes: Axes, pieces: tuple[BeltPiece, ...]) -> None:
    for piece in pieces:
        path, wide = 1e3 * piece.positions, 1.8 if piece.zone == "span" else 3.6
        axes.plot(*path.T, color=COLORS[piece.zone], linewidth=wide, solid_capstyle="butt")
    for zone, color in COLORS.items():
        axes.plot([], [], color=color, linewidth=3, label=_WORDS[zone])
    # Each belt begins with arc length 0; its first span shows the direction of travel.
    starts = [place for place, piece in enumerate(pieces) if piece.arc_length[0] == 0.0]
    for start in starts:
        first = next(piece for piece in pieces[start:] if piece.zone == "span")
        middle = len(first.positions) // 2
        axes.annotate(
            "",
            xy=tuple(1e3 * first.positions[middle + 6]),
            xytext=tuple(1e3 * first.positions[middle - 6]),
            arrowprops={"arrowstyle": "-|>", "color": "black"},
        )
    axes.set_aspect("equal")
    axes.set_xlabel("x (mm)")
    axes.set_ylabel("y (mm)")
    axes.grid(linewidth=0.3)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=9)


def _draw_along(axes: Axes, pieces: tuple[BeltPiece, ...], what: str, label: str) -> None:
    for piece in pieces:
        values = getattr(piece, what)
        axes.plot(piece.arc_length, values, color=COLORS[piece.zone], linewidth=1.8)
    axes.set_ylabel(label)
    axes.grid(linewidth=0.3)
    axes.margins(x=0.0)


def _name_places(axes: Axes, drive: Drive, pieces: tuple[BeltPiece, ...]) -> None:
    """Each pulley's name above its arc of contact."""
    for place, name in enumerate(drive.pulley_names):
        arcs = [piece for piece in pieces if piece.zone != "span" and piece.place == place]
        if arcs:
            middle = (arcs[0].arc_length[0] + arcs[-1].arc_length[-1]) / 2
            axes.annotate(
                name,
                (middle, 1.02),
                xycoords=("data", "axes fraction"),
                ha="center",
                fontsize=8,
                parse_math=False,
                rotation=0 if len(drive.pulleys) < 4 else 30,
            )


def two_models_figure(drive: Drive, states: list[tuple[str, ContactState, SteadyState]]) -> Figure:
    """Each span by both models, one color per state: contact points free, and fixed at a string's.

    Deflections from the straight tangent, enlarged by what the axes' scales say.
    """
    spans = len(drive.pulleys)
    figure = Figure(figsize=(10.0, 2.8 * spans), layout="constrained")
    FigureCanvasAgg(figure)
    rows = figure.subplots(spans, 2, squeeze=False, sharey="row")
    colors = (AFTER, "#009E73", ARM, "#CC79A7", "#56B4E9")
    x = np.linspace(0.0, 1.0, 201)
    for i, (free, fixed) in enumerate(rows):
        for (label, contact, steady), color in zip(states, colors, strict=False):
            along, w = span_deflection(contact, i)
            free.plot(1e3 * along, 1e3 * w, color=color, linewidth=1.6, label=label)
            ends = 1e3 * along[[0, -1]], 1e3 * w[[0, -1]]
            free.plot(*ends, "o", color=color, markersize=5)
            length = 1e3 * float(steady.reference.layout.span_lengths[i])
            shape = length * np.asarray(steady.deflection(i, jnp.asarray(x)))
            fixed.plot(length * x, shape, color=color, linewidth=1.6, label=label)
        free.set_ylabel("inward (mm)")
        free.set_title(f"{drive.span_names[i]}: contact points free", fontsize=10, parse_math=False)
        fixed.set_title("contact points of a string", fontsize=10)
        for axes in (free, fixed):
            axes.grid(linewidth=0.3)
            axes.set_xlabel("along the span (mm)")
    if len(states) > 1:
        rows[0, 1].legend(frameon=False, fontsize=8)
    return figure
