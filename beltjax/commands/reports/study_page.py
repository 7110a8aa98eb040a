"""The report of a design study: one HTML file that needs nothing beside it."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from beltjax import optimize
from beltjax.analysis.linearization import has_inertias
from beltjax.analysis.sweep import sweep
from beltjax.commands.reports.optimize import snapped_line
from beltjax.commands.reports.pages import inline_svg, rendered
from beltjax.commands.reports.tables import largest_changes
from beltjax.commands.reports.units import TableUnits
from beltjax.draw.curves import sweep_figure
from beltjax.draw.labels import span_label
from beltjax.draw.layouts import before_and_after
from beltjax.drive.numbers import number_value
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive

_ORDERS = (2.0, 4.0)
_SPEEDS = np.linspace(600, 6000, 61) * 2 * np.pi / 60  # of the driver [rad/s]
_LARGEST = 12  # sensitivities shown


def study_page(
    study: optimize.Study,
    design: optimize.Design,
    document: dict[str, Any],
    before: dict[str, tuple[float, str]],
) -> bytes:
    """A page that opens without a network: design, limits, convergence, prices, frequencies.

    `document` is the JSON, `before` each variable's value in the study's own drive, with unit.
    """
    layouts = before_and_after(
        (study.drive, design.before.reference.layout),
        (design.drive, design.steady.reference.layout),
        "",
    )
    frequencies = None
    if design.success and has_inertias(design.drive):
        frequencies = inline_svg(_frequencies(design.drive, study.point))
    return rendered(
        "study_page.html",
        study=study,
        document=document,
        before=before,
        bounds=_bounds(study),
        success=design.success,
        snapped=snapped_line(document["snapped"], TableUnits(study.drive, si=True))
        if "snapped" in document
        else "",
        layout=inline_svg(layouts),
        convergence=inline_svg(_convergence(document["history"])),
        frequencies=frequencies,
        sensitivities=_sensitivities(study, design),
    )


def _bounds(study: optimize.Study) -> dict[str, tuple[float, float]]:
    limits = study.variables
    ends = zip(np.asarray(limits.lower), np.asarray(limits.upper), strict=True)
    return dict(zip(limits.names, ((float(a), float(b)) for a, b in ends), strict=True))


def _convergence(history: dict[str, Any]) -> Figure:
    """Objective and violation of every start over its iterations."""
    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    FigureCanvasAgg(figure)
    upper, lower = figure.subplots(2, 1, sharex=True)
    objective = np.array(history["objective"], dtype=float)
    violation = np.array(history["violation"], dtype=float)
    steps = np.arange(1, len(objective) + 1)
    _lines(upper, steps, objective, "objective")
    _lines(lower, steps, np.maximum(violation, 1e-12), "violation (scaled)")
    lower.set_yscale("log")
    lower.set_xlabel("iteration")
    return figure


def _lines(axes: Axes, steps: np.ndarray, values: np.ndarray, label: str) -> None:
    axes.plot(steps, values, color="#0072B2", linewidth=0.8, alpha=0.6)
    axes.set_ylabel(label)
    axes.grid(linewidth=0.3)


def _frequencies(drive: Drive, point: OperatingPoint) -> Figure:
    found = sweep(drive, point, "operation.driver_speed", _SPEEDS, count=6)
    labels = [span_label(drive, label) for label in found.labels]
    return sweep_figure(drive, found, labels, _ORDERS)


def _sensitivities(
    study: optimize.Study, design: optimize.Design
) -> list[tuple[str, float, float]]:
    """Find how 1 % of each fixed number changes the optimum: name, change, derivative (SI)."""
    if not design.success:
        return []
    try:
        found = optimize.post_optimal(study, design)
    except ValueError:  # no strict optimum: nothing to differentiate
        return []
    sizes = [float(number_value(study.drive, study.point, name)) for name in found.names]
    return largest_changes(zip(found.names, sizes, found.objective.tolist(), strict=True))[
        :_LARGEST
    ]
