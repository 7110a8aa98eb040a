"""Pictures of the spans of a running drive."""

import jax.numpy as jnp
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from beltjax.analysis.steady import SteadyState
from beltjax.drive.system import Drive

_POINTS = 201  # of a span; layers of bending are a few hundredths of it thick


def span_shapes(drive: Drive, steady: SteadyState) -> Figure:
    """The steady deflection of each span, in millimeters, over its own length.

    It is positive towards the inside of the loop, and counted from the straight line between the
    points at which a string would touch.
    """
    figure = Figure(figsize=(6.5, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    x = np.linspace(0.0, 1.0, _POINTS)
    for i, name in enumerate(drive.span_names):
        length = 1e3 * float(steady.reference.layout.span_lengths[i])
        w = length * np.asarray(steady.deflection(i, jnp.asarray(x)))
        axes.plot(length * x, w, linewidth=1.4, label=name)
    axes.axhline(0.0, color="#999999", linewidth=0.6)
    axes.set_xlabel("from the span's first pulley [mm]")
    axes.set_ylabel("deflection towards the inside [mm]")
    axes.grid(linewidth=0.3)
    below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.14), "ncols": 2}
    legend = axes.legend(**below, frameon=False, fontsize=9)
    for text in legend.get_texts():
        text.set_parse_math(False)
    return figure
