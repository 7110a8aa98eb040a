"""Pictures of friction over the sliding speed, and of the stability of sliding."""

import jax.numpy as jnp
import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from beltjax.analysis.slip_stability import SlipStability, friction_curve, growth_over_speed
from beltjax.drive.system import Drive

_POINTS = 400


def friction_figure(drive: Drive, found: SlipStability) -> Figure:
    """Friction of the pulleys that have a law, and growth of squeal, over the sliding speed.

    `found` is the stability on all pulleys. A dot is the onset; a ring the fold, between which
    and the onset the belt may squeal after a knock.
    """
    figure = Figure(figsize=(8.0, 7.0), layout="constrained")
    FigureCanvasAgg(figure)
    above, below = figure.subplots(2, 1, sharex=True)
    falling = [k for k, p in enumerate(drive.pulleys) if p.friction_static is not None]
    falling = falling or [k for k, p in enumerate(drive.pulleys) if p.friction is not None]
    folds = np.asarray(found.fold_speed)[falling]
    onsets = np.asarray(found.onset_speed)[falling]
    scale = [float(p.friction_speed) for p in drive.pulleys if p.friction_speed is not None]
    known = [x for x in (*folds, *onsets) if np.isfinite(x)]
    v = np.linspace(0.0, 1.15 * max([*known, *(3 * x for x in scale), 1e-3]), _POINTS)
    growth = np.asarray(growth_over_speed(found.model, jnp.asarray(v)))
    colors = matplotlib.colormaps["tab10"].colors  # pyright: ignore[reportAttributeAccessIssue]
    drawn: dict[tuple[float, ...], list[str]] = {}
    for k in falling:
        law = tuple(float(x) for x in friction_curve(drive.pulleys[k]))
        drawn.setdefault(law, []).append(drive.pulleys[k].name)
    for place, (law, names) in enumerate(drawn.items()):
        k = drive.pulley_names.index(names[0])
        mu = np.asarray(friction_curve(drive.pulleys[k]).coefficient(jnp.asarray(v)))
        label = names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
        style = ("-", "--", ":", "-.")[place % 4]
        above.plot(v, mu, style, color="black", linewidth=1.6, label=label)
        above.plot(0.0, law[0], "o", color="black", markersize=4)
    for place, k in enumerate(falling):
        color = colors[place % len(colors)]
        below.plot(v, growth[k], color=color, linewidth=1.5, label=drive.pulleys[k].name)
        if np.isfinite(onsets[place]) and onsets[place] > 0:
            below.plot(onsets[place], 0.0, "o", color=color, markersize=6)
        if np.isfinite(folds[place]) and folds[place] > 0:
            below.plot(folds[place], 0.0, "o", color=color, markersize=7, mfc="white", zorder=3)
    below.axhline(0.0, color="#808080", linewidth=0.8)
    above.set_ylabel("friction")
    above.set_ylim(bottom=0.0)
    below.set_ylabel("growth (1/s)")
    below.set_xlabel("sliding speed (m/s)")
    above.set_title(drive.name, fontsize=11, parse_math=False)
    for axes in (above, below):
        axes.set_xlim(0.0, v[-1])
        axes.grid(color="#e0e0e0", linewidth=0.6)
        axes.legend(fontsize=8, frameon=False)
    below.set_title("dot: onset of squeal; ring: fold", fontsize=9, color="#505050", loc="left")
    return figure
