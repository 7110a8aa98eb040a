"""Readable tables of results, for a terminal or a file."""

import math
import re
from collections.abc import Iterable, Iterator
from typing import Any

from rich.console import Group
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from beltjax.commands.warnings import warning_lines

_LARGEST_SENSITIVITIES = 8
_FEW_OPTIMA = 4


def analysis_tables(document: dict[str, Any], sizes: dict[str, Any]) -> Group:
    """The tables of `beltjax analyze`, from its JSON document and the numbers of the drive."""
    parts = [*warning_lines(document), _span_table(document)]
    parts += [_pulley_table(document), _summary_table(document)]
    if document["modes"]:
        parts.append(_mode_table(document["modes"]))
    if document["sensitivities"]:
        slopes = _gamma_table(document["sensitivities"]["coupling_total"], sizes)
        parts.append(slopes if slopes.row_count else Text(_gamma_is_zero(sizes)))
    return Group(*parts)


def plain_table(title: str, *columns: str) -> Table:
    """A table whose first column is words and the others numbers."""
    table = Table(title=title, title_justify="left", title_style="bold", box=None, padding=(0, 2))
    for i, column in enumerate(columns):
        table.add_column(column, justify="left" if i == 0 else "right", no_wrap=True)
    return table


def _span_table(document: dict[str, Any]) -> Table:
    # Both tensions are under the operating torques.
    headers = "span", "length (mm)", "standing (N)", "running (N)", "coupling Gamma_i"
    table = plain_table(escape(document["drive"]), *headers)
    spans, steady = document["layout"]["spans"], document["steady"] or {}
    unknown = [None] * len(spans)
    standing = (document["reference"] or {}).get("tensions", unknown)
    columns = standing, steady.get("tensions", unknown), steady.get("coupling", unknown)
    for span, still, running, gamma in zip(spans, *columns, strict=True):
        length = number(1e3 * span["length"], 1)
        tensions = number(still, 1), number(running, 1)
        table.add_row(escape(span["name"]), length, *tensions, number(gamma, 4))
    return table


def _pulley_table(document: dict[str, Any]) -> Table:
    table = plain_table("", "pulley", "wrap (deg)")
    wraps = document["layout"]["wraps_deg"]
    for name, wrap in zip(document["pulleys"], wraps, strict=True):
        table.add_row(escape(name), number(wrap, 1))
    return table


def _summary_table(document: dict[str, Any]) -> Table:
    table = plain_table("", "quantity", "value", "unit")
    layout, reference = document["layout"], document["reference"] or {}
    groups, steady = document["groups"] or {}, document["steady"] or {}
    # A drive without a tensioner has no arm that could turn.
    has_arm = reference.get("arm_turn") is not None
    running = steady.get("arm_rotation") if has_arm else None
    rows = [
        ("coupling Gamma, all spans", steady.get("coupling_total"), 4, ""),
        ("tensioner effectiveness eta", reference.get("tensioner_effectiveness"), 4, ""),
        ("tension change T", steady.get("tension_change"), 6, "P0"),
        ("arm's turn, drawn to rest", reference.get("arm_turn"), 6, "rad"),
        ("arm rotation theta_t, rest to running", running, 6, "rad"),
        ("belt length, unstretched", reference.get("unstretched_length"), 6, "m"),
        ("path length", layout["path_length"], 6, "m"),
        ("bending eps", groups.get("bending"), 5, ""),
        ("speed s", groups.get("speed"), 5, ""),
        ("stretch gamma", groups.get("stretch"), 2, ""),
    ]
    for label, value, digits, unit in rows:
        if value is not None:
            table.add_row(label, number(value, digits), unit)
    return table


def _mode_table(modes: dict[str, Any]) -> Table:
    table = plain_table("Natural modes", "moves most", "Hz", "dimensionless")
    for label, hertz, omega in zip(
        modes["labels"], modes["hertz"], modes["dimensionless"], strict=True
    ):
        table.add_row(escape(label), number(hertz, 2), number(omega, 4))
    return table


def _gamma_table(slopes: dict[str, Any], sizes: dict[str, Any]) -> Table:
    table = plain_table(
        "What moves Gamma most, per 1 % of each number",
        "number",
        "change of Gamma",
        "d Gamma/d number (SI)",
    )
    parts = (p for name in slopes for p in _components(name, sizes[name], slopes[name]))
    for name, change, slope in largest_changes(parts)[:_LARGEST_SENSITIVITIES]:
        table.add_row(escape(name), f"{change:+.3e}", f"{slope:+.4g}")
    return table


def _gamma_is_zero(sizes: dict[str, Any]) -> str:
    """Why nothing moves Gamma."""
    if sizes["belt.bending_stiffness"] == 0:
        return (
            "Nothing moves Gamma: the spans of a belt without bending stiffness are straight, and "
            "it is zero (belt.bending_stiffness = 0)."
        )
    return "Nothing moves Gamma: all its derivatives are zero."


def largest_changes(parts: Iterable[tuple[str, float, float]]) -> list[tuple[str, float, float]]:
    """Of names, sizes and slopes: name, change per 1 % of the size, slope; the largest first."""
    rows = [(name, 0.01 * size * slope, slope) for name, size, slope in parts if size and slope]
    return sorted(rows, key=lambda row: -abs(row[1]))


def _components(name: str, size: Any, slope: Any) -> list[tuple[str, float, float]]:
    if not isinstance(slope, list):
        return [(name, size, slope)]
    indices = [f"[{i}]" for i in range(len(slope))]
    labels = [".x", ".y"] if name.endswith(("center", "pivot")) else indices
    return [(name + label, *part) for label, *part in zip(labels, size, slope, strict=True)]


def design_tables(document: dict[str, Any], before: dict[str, tuple[float, str]]) -> Group:
    """The tables of `beltjax optimize`: the design, its constraints, and how the starts ended.

    `before` holds each variable's value in the study's own drive, and its unit.
    """
    shown = [_design_table(document, before), _constraint_table(document), _start_table(document)]
    if len(document["optima"]) > 1:
        shown.append(_optima_table(document))
    if "choices" in document:
        shown.insert(0, _choice_table(document["choices"]))
    return Group(*warning_lines(document), *shown, *map(Text, _optimality_lines(document)))


def _choice_table(choices: list[dict[str, Any]]) -> Table:
    """Every combination of choices; what follows is the design of the first."""
    names = list(choices[0]["labels"])
    table = plain_table("Choices, the best first", *map(escape, names), "objective", "")
    for one in choices:
        ending = "" if one["success"] else "not met"
        labels = [escape(one["labels"][name]) for name in names]
        table.add_row(*labels, number(one["objective"], 5), ending)
    return table


def front_table(document: dict[str, Any]) -> Table:
    """The table of `beltjax pareto`: objectives and variables of every design of the front."""
    names = document["objectives"]
    points = document["points"]
    variables = list(points[0]["design"]) if points else []
    # A header takes as many lines as its name has parts, so that the columns stay narrow.
    headers = [re.sub("(?<=[.:])", "\n", name) for name in (*names, *variables)]
    table = plain_table("Pareto front (SI, rad)", *map(escape, headers))
    for point in points:
        values = [*point["objectives"].values(), *point["design"].values()]
        table.add_row(*(f"{value:.6g}" for value in values))
    return table


def _optima_table(document: dict[str, Any]) -> Table:
    """The best designs in which starts ended: what differs between them."""
    best = document["optima"][:_FEW_OPTIMA]
    table = plain_table("Optima (SI, rad)", "variable", *(str(i + 1) for i in range(len(best))))
    for name in best[0]["values"]:
        table.add_row(escape(name), *(f"{optimum['values'][name]:.6g}" for optimum in best))
    table.add_row("starts", *(str(optimum["starts"]) for optimum in best))
    table.add_row("objective", *(f"{o['objective']:.6g}" for o in best), style="bold")
    return table


def _optimality_lines(document: dict[str, Any]) -> Iterator[str]:
    shown = document["optimality"]
    for name, price in document["active_bounds"].items():
        yield f"at its bound: {name} (price {price:+.4g})"
    if document["conflicts"]:
        yield f"cannot be met together: {'; '.join(document['conflicts'])}"
    if shown is not None:
        bent = shown["curvature"]
        second = (
            "; the active limits leave no direction free"
            if bent is None
            else f"; least curvature {bent:.2g}"
        )
        yield f"optimality: residual {shown['residual']:.1e} of the scaled conditions{second}"


def _design_table(document: dict[str, Any], before: dict[str, tuple[float, str]]) -> Table:
    table = plain_table("Design", "variable", "before", "after", "unit")
    for name, value in document["design"].items():
        was, unit = before[name]
        table.add_row(escape(name), f"{was:.6g}", f"{value:.6g}", unit)
    objective = document["objective"]
    initial = "-" if objective["initial"] is None else f"{objective['initial']:.6g}"
    final = "-" if objective["final"] is None else f"{objective['final']:.6g}"
    table.add_row("objective", initial, final, style="bold")
    if "robust" in document:
        drawn = document["robust"]["as_drawn"]["objective"]
        table.add_row("objective as drawn", "", f"{drawn:.6g}")
    return table


def _constraint_table(document: dict[str, Any]) -> Table:
    # The price of a limit is d(objective)/d(limit): what its next unit would buy.
    headers = ["quantity", "value", "lower", "upper", "", "price of limit"]
    title, drawn = "Constraints (SI, rad)", {}
    if "robust" in document:
        title += f": {document['robust']['counted']}"
        headers, drawn = [*headers, "as drawn"], document["robust"]["as_drawn"]["constraints"]
    table = plain_table(title, *headers)
    active_implied = [c for c in document["implied_constraints"] if c["active"] or c["violation"]]
    for constraint in document["constraints"] + active_implied:
        state = "not met" if constraint["violation"] else "active" if constraint["active"] else ""
        bounds = [
            "-" if constraint[k] is None else f"{constraint[k]:.6g}" for k in ("lower", "upper")
        ]
        price = ""
        if constraint["active"] and constraint["multiplier"] is not None:
            price = f"{constraint['multiplier']:+.4g}"
        name = constraint["quantity"]
        row = [escape(name), f"{constraint['value']:.6g}", *bounds, state, price]
        table.add_row(*row, *([f"{drawn[name]:.6g}"] if name in drawn else []))
    return table


def _start_table(document: dict[str, Any]) -> Table:
    table = plain_table("Starts", "ended", "how many", "best objective")
    endings: dict[str, list[float]] = {}
    for start in document["starts"]:
        values = endings.setdefault(start["result"], [])
        values.append(math.inf if start["final"] is None else start["final"])
    for ending, values in endings.items():
        best = min(values)
        table.add_row(ending, str(len(values)), "-" if math.isinf(best) else f"{best:.6g}")
    return table


def number(value: float | None, digits: int) -> str:
    """`value` with fixed digits, or a dash."""
    return "-" if value is None else f"{value:.{digits}f}"
