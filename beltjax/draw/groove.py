"""Pictures of a belt in grooves: how deep it lies, and where friction points, along each arc."""

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from beltjax.analysis.groove import GrooveState
from beltjax.draw.layouts import AFTER, ARM, BEFORE
from beltjax.drive.system import Drive

POINTS, ARROWS = 601, 25
COLORS = {"seating": "#56B4E9", "adhesion": "#009E73", "sliding": ARM, "unseating": "#CC79A7"}


def groove_figure(drive: Drive, state: GrooveState) -> Figure:
    """For each grooved pulley, over the angle from where the belt comes in.

    Above: penetration, over the zones of the arc. Below: the unrolled flank, with arrows in the
    direction of the friction on the belt, along the groove and along the flank.
    """
    wedged = [i for i in range(len(drive.pulleys)) if float(state.penetrations[i]) > 0]
    figure = Figure(figsize=(max(4.6 * len(wedged), 6.0), 6.0), layout="constrained")
    FigureCanvasAgg(figure)
    if not wedged:
        figure.suptitle(f"{drive.name}: no pulley has a groove", parse_math=False)
        return figure
    rows = figure.subplots(2, len(wedged), squeeze=False, sharex="col")
    for column, i in enumerate(wedged):
        depth, flank = rows[0, column], rows[1, column]
        _draw_zones(depth, state, i)
        _draw_zones(flank, state, i)
        _draw_depth(depth, state, i)
        _draw_friction(flank, state, i)
        depth.set_title(drive.pulley_names[i], fontsize=11, parse_math=False)
        flank.set_xlabel("angle from where the belt comes in (deg)")
    rows[0, 0].set_ylabel("penetration (mm)")
    rows[1, 0].set_ylabel("friction on the belt:\nalong the flank, outwards")
    for zone, color in COLORS.items():
        rows[0, 0].fill([], [], color=color, alpha=0.25, label=zone)
    rows[0, 0].legend(fontsize=8, frameon=False, loc="lower center")
    feasible = "" if bool(state.feasible) else ": not physical"
    figure.suptitle(f"{drive.name}{feasible}", fontsize=11, parse_math=False)
    return figure


def _draw_zones(axes: Axes, state: GrooveState, i: int) -> None:
    """Colored spans of the zones; adhesion lies where sliding is slowest, after seating."""
    ends = np.degrees(np.concatenate([[0.0], np.cumsum(np.asarray(state.zones[i]))]))
    for (color, left), right in zip(
        zip(COLORS.values(), ends[:-1], strict=True), ends[1:], strict=True
    ):
        axes.axvspan(left, right, color=color, alpha=0.25, linewidth=0)
    axes.set_xlim(0.0, ends[-1])


def _draw_depth(axes: Axes, state: GrooveState, i: int) -> None:
    s = np.linspace(0.0, 1.0, POINTS)
    angle = s * np.degrees(float(state.wraps[i]))
    axes.plot(
        angle, 1e3 * np.asarray(state.penetration(i, jnp.asarray(s))), color=AFTER, linewidth=1.8
    )
    axes.set_ylim(bottom=0.0)
    axes.grid(linewidth=0.3)


def _draw_friction(axes: Axes, state: GrooveState, i: int) -> None:
    """Arrows of one length against the sliding: to the right along the travel, up outwards."""
    s = (np.arange(ARROWS) + 0.5) / ARROWS
    angle = s * np.degrees(float(state.wraps[i]))
    slides = np.asarray(state.sliding_angle(i, jnp.asarray(s)))
    # The belt slides by sin along the travel and by -cos outwards; friction is against that.
    axes.quiver(
        angle, 0 * angle, -np.sin(slides), np.cos(slides), color=AFTER, scale=ARROWS / 1.6,
        width=0.006, pivot="middle",
    )  # fmt: skip
    axes.axhline(0.0, color=BEFORE, linewidth=0.6, zorder=0)
    axes.set_ylim(-1.0, 1.0)
    axes.set_yticks([])
