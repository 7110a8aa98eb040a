"""Pictures of Pareto fronts."""

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from beltjax import optimize
from beltjax.draw.layouts import AFTER


def front_figure(front: optimize.Front) -> Figure:
    """Every pair of objectives against each other; for three, the third in color."""
    rows = np.array([point.objectives for point in front.points]).reshape(-1, len(front.names))
    labels = [f"{n.removeprefix('-')} ({u})" if u else n.removeprefix("-")
              for n, u in zip(front.names, front.units, strict=True)]  # fmt: skip
    pairs = [(0, 1)] if len(front.names) == 2 else [(0, 1), (0, 2), (1, 2)]
    figure = Figure(figsize=(1.5 + 4.5 * len(pairs), 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(pairs), squeeze=False)[0]
    for axes, (i, j) in zip(panels, pairs, strict=True):
        axes.plot(rows[:, i], rows[:, j], "o-" if len(pairs) == 1 else "o", color=AFTER)
        axes.set_xlabel(labels[i], parse_math=False)
        axes.set_ylabel(labels[j], parse_math=False)
        axes.grid(linewidth=0.3)
    return figure
