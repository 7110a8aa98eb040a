"""Pictures of tongues: where a shaking crank makes a drive unstable."""

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from beltjax.analysis.parametric_margin import Margin, Tongues
from beltjax.draw.curves import RPM

_SPEEDS, _SIZES = 900, 300  # of the shaded growth
_NAMED = 8  # tongues


def tongue_figure(
    name: str, ends: tuple[float, float], order: float, crank: float, found: Margin
) -> Figure:
    """Driver speed against the crank's angle, tongues shaded by their growth.

    Without crank motion the other axis is the factor of the excitation.
    """
    of = found.tongues
    inside = np.flatnonzero(np.asarray(of.inside) & np.isfinite(np.asarray(of.best_factor)))
    factors = np.asarray(of.best_factor)[inside]
    order_of = inside[np.argsort(factors)]
    unit = np.degrees(crank) if crank else 1.0
    top = max(2.5, 1.6 * factors.min()) if len(inside) else 2.5
    speeds, sizes = np.linspace(*ends, _SPEEDS), np.linspace(0.0, top, _SIZES)
    growth = _growth(of, order_of, speeds, sizes)
    figure = Figure(figsize=(9.0, 5.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    shown = np.ma.masked_less_equal(growth, 0.0)
    mesh = axes.pcolormesh(
        speeds * RPM, sizes * unit, shown, cmap="YlOrRd", shading="auto", vmin=0.0,
        rasterized=True,
    )  # fmt: skip
    bar = figure.colorbar(mesh, ax=axes, pad=0.01)
    bar.set_label("growth of pairs of modes (1/s)", fontsize=9)
    at, slack = np.asarray(of.driver_speed)[inside], np.asarray(of.slack_factor)[inside]
    below = slack < top
    label = "a span goes slack" if below.any() else "_"
    axes.plot(at[below] * RPM, slack[below] * unit, "x", color="#3060a0", label=label)
    axes.axhline(unit, color="black", linewidth=0.9, linestyle="--", label="the excitation")
    tips = np.asarray(of.driver_speed)[order_of] * RPM, np.asarray(of.best_factor)[order_of] * unit
    seen = tips[1] < top * unit
    axes.plot(
        tips[0][seen], tips[1][seen], "k.", markersize=5, label="critical, modes near counted"
    )
    for k, x, y in list(zip(order_of[seen], tips[0][seen], tips[1][seen], strict=True))[:_NAMED]:
        r, s = np.asarray(of.modes[k]).tolist()
        axes.annotate(
            f"{r}-{s}", (x, y), (0, -4), textcoords="offset points", fontsize=8, ha="center",
            va="top",
        )  # fmt: skip
    axes.set_xlim(ends[0] * RPM, ends[1] * RPM)
    axes.set_ylim(0.0, top * unit)
    axes.set_xlabel("driver speed (rpm)")
    axes.set_ylabel("crank angle (deg)" if crank else "factor of the excitation")
    hertz = axes.secondary_xaxis(
        "top",
        functions=(
            lambda rpm: order * np.asarray(rpm) / 60,
            lambda hertz: 60 * np.asarray(hertz) / order,
        ),
    )
    hertz.set_xlabel(f"excitation by engine order {order:g} (Hz)", fontsize=9)
    axes.set_title(f"{name}: parametric resonance", fontsize=11, parse_math=False)
    axes.legend(loc="upper left", fontsize=8, framealpha=0.9)
    return figure


def _growth(of: Tongues, kept: np.ndarray, speeds: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Largest growth of the pairs over speed and size of the excitation: [sizes, speeds]."""
    most = np.full((len(sizes), len(speeds)), -np.inf)
    for k in kept:
        coupling, (one, other) = float(of.coupling[k]), np.asarray(of.decays[k])
        detuning = float(of.sweep[k]) * (speeds - float(of.driver_speed[k]))
        square = (one - other + 1j * detuning) ** 2 + 4 * (coupling * sizes[:, None]) ** 2
        most = np.maximum(most, (np.sqrt(square).real - one - other) / 2)
    return most
