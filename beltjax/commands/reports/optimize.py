"""The work of `beltjax optimize`: it turns a study file into a report."""

import dataclasses
import math
import os
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from rich.console import Group
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from beltjax import optimize
from beltjax.commands.reports.documents import (
    Document,
    Maybe,
    Part,
    Row,
    meaning,
    model_flags,
    plain,
)
from beltjax.commands.reports.report import Report
from beltjax.commands.reports.tables import number, plain_table
from beltjax.commands.reports.units import TableUnits
from beltjax.commands.reports.warnings import file_warnings, state_warnings, warning_lines
from beltjax.commands.running import Advance
from beltjax.drive.files import drive_bytes
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.files.reading import read_json
from beltjax.files.units import shown
from beltjax.results import RESULTS, explanation

_RUN = "give the JSON of a run of this study"
_FEW_OPTIMA = 4


class ObjectivePart(Part):
    """The objective before and after."""

    initial: Maybe = meaning("null where the study's own drive does not run")
    final: Maybe


class LimitPart(Part):
    """A limit and the quantity it holds, SI and rad."""

    quantity: str
    unit: str = meaning("SI; empty for a pure number")
    value: Maybe = meaning("the part closest to its limit")
    lower: Maybe
    upper: Maybe
    multiplier: Maybe = meaning("what the next unit of the limit would buy; null: no optimum")
    active: bool
    violation: Maybe


class StartPart(Part):
    """The end of one start."""

    final: Maybe
    result: str


class ConditionsPart(Part):
    """Conditions of an optimum at the design, checked numerically in the scaled problem."""

    residual: float = meaning("largest of the next three")
    stationarity: float
    violation: float
    complementarity: float
    curvature: Maybe = meaning("least, along the active limits: above 0 at a strict minimum")


class OptimumPart(Part):
    """A design in which starts ended."""

    values: dict[str, float] = meaning("of the variables, SI")
    objective: float
    starts: int = meaning("that ended there")
    residual: float


class IterationsPart(Part):
    """Every iteration of every start."""

    objective: list[Row]
    violation: list[Row]


class ChoicePart(Part):
    """The best design with one combination of choices."""

    labels: dict[str, str]
    numbers: dict[str, float]
    objective: Maybe
    design: dict[str, float]
    success: bool


class AsDrawnPart(Part):
    """Values without the tolerances."""

    objective: Maybe
    constraints: dict[str, Maybe]


class ScatterPart(Part):
    """The way in which a study counts its tolerances."""

    counted: str
    numbers: list[str]
    as_drawn: AsDrawnPart


class SnappedPart(Part):
    """Variables that took a value on sale, and what that costs."""

    values: dict[str, float] = meaning("of these variables, SI")
    before: dict[str, float] = meaning("the design before, SI")
    objective: Maybe = meaning("before")
    loss: Maybe = meaning("objective now less before; null where no such design meets all limits")


class OptimizeDocument(Document):
    """`beltjax optimize`."""

    design: dict[str, float] = meaning("of the variables and what is tied to them, SI")
    objective: ObjectivePart
    constraints: list[LimitPart] = meaning("those of the study")
    implied_constraints: list[LimitPart] = meaning("those of every drive that can be built")
    success: bool
    starts: list[StartPart]
    active_bounds: dict[str, float] = meaning("what the next unit of a variable's bound would buy")
    conflicts: list[str] = meaning("limits that cannot be met together")
    optimality: ConditionsPart | None = meaning("null where the design is no optimum")
    optima: list[OptimumPart] = meaning("the best first")
    scales: dict[str, float] = meaning("in which residuals are measured")
    history: IterationsPart
    choices: list[ChoicePart] = meaning("only of a study with choices", default=[])
    robust: ScatterPart | None = meaning("only of a study with tolerances", default=None)
    snapped: SnappedPart | None = meaning("only of a study that snaps variables", default=None)


class OptimizeOptions(NamedTuple):
    """The options of `beltjax optimize`; None stands for nothing, or for the study's own."""

    figure: str | None = None
    drive: str | None = None  # where to write the optimized drive
    page: str | None = None  # where to write the HTML report
    method: str | None = None
    time_limit: float | None = None  # [s]
    checkpoint: str | None = None
    warm: str | None = None  # the JSON of an earlier run
    si: bool = False  # tables in SI, not in the units of the drive's file


def optimize_report(
    path: str | os.PathLike[str],
    given: OptimizeOptions,
    advance: Advance,
) -> Report:
    """Run one study, with the files that its options name.

    Raises `FileError` for a study that cannot be posed; a study without a solution is a report
    whose `failure` says which limit is missed and by how much.
    """
    study = _changed(optimize.load_study(path), given)
    warm = () if given.warm is None else (_warm_start(given.warm, study.variables.names),)
    if study.choices:
        chosen = optimize.enumerated(study, advance)
        design, choices = chosen[0].design, chosen_document(chosen)
    else:
        design, choices = _minimized(study, advance, warm, given.checkpoint), {}
    document = optimize_document(study.point, design) | choices
    document["warnings"] = [*file_warnings(study.drive), *document["warnings"]]
    if study.scatter is not None:
        document |= robust_document(design, study.scatter)
    if design.snapped is not None:
        document["snapped"] = design.snapped._asdict()
    files = []
    if given.figure:
        from beltjax.draw.layouts import before_and_after, picture_bytes  # slow to load

        picture = before_and_after(
            (study.drive, design.before.reference.layout),
            (design.drive, design.steady.reference.layout),
            f"{study.drive.name}: objective {_text(design.initial)} to {_text(design.final)}",
        )
        files.append((given.figure, picture_bytes(picture, given.figure)))
    if given.drive and design.success:
        duties = study.cases.duties if study.cases else {}
        files.append((given.drive, drive_bytes(design.drive, study.point, duties)))
    if given.page:
        from beltjax.commands.reports.study_page import study_page  # slow to load

        before = {
            name: (float(optimize.value_of(study.drive, name)), optimize.unit_of(study.drive, name))
            for name in design.values
        }
        files.append((given.page, study_page(study, design, document, before)))
    failure = "" if design.success else str(FileError(path, *_missed(design)))
    return Report(document, optimize_tables(document, study.drive, given.si), failure, tuple(files))


def _minimized(
    study: optimize.Study,
    advance: Advance,
    warm: tuple[dict[str, float], ...],
    checkpoint: str | None,
) -> optimize.Design:
    try:
        return optimize.minimize(study, advance, warm=warm, checkpoint=checkpoint)
    except ValueError as error:
        raise FileError("--checkpoint", "", str(error)) from error


def _changed(study: optimize.Study, given: OptimizeOptions) -> optimize.Study:
    """`study` with the method and the time limit that the command names."""
    known = optimize.optimizer_names()
    if given.method is not None and given.method not in known:
        names = ", ".join(map(repr, known))
        raise FileError("--method", "", f"found {given.method!r}; give one of {names}")
    changes = {"method": given.method, "time_limit": given.time_limit}
    changes = {name: value for name, value in changes.items() if value is not None}
    return dataclasses.replace(study, **changes)


def _warm_start(path: str, names: tuple[str, ...]) -> dict[str, float]:
    """The design of an earlier run's JSON; raises `FileError` where there is none."""
    document = read_json(path, _RUN)
    design = document.get("design") if isinstance(document, dict) else None
    if not isinstance(design, dict):
        raise FileError(path, "design", f"is missing; {_RUN}")
    return {name: _finite(path, name, design.get(name)) for name in names}


def _finite(path: str, name: str, value: Any) -> float:
    try:
        number = float(value) if type(value) in (int, float) else math.nan
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        message = f"found {shown(value)} for {name!r}, no finite number; {_RUN}"
        if value is None:
            message = f"has no number for {name!r}; {_RUN}"
        raise FileError(path, "design", message)
    return number


def _text(objective: float | None) -> str:
    return "-" if objective is None else f"{objective:.4g}"


def _missed(design: optimize.Design) -> tuple[str, str]:
    """Key and message of what keeps a design from being a success."""
    missed = [constraint for constraint in design.constraints if constraint.violation]
    if design.result == RESULTS.no_starting_design:
        return "variable", explanation(design.result)
    if design.result == RESULTS.time_limit_reached:
        return "optimizer.time_limit", explanation(design.result)
    if design.result != RESULTS.constraints_infeasible or not missed:
        return "optimizer.starts", explanation(design.result)
    parts = []
    for constraint in missed:
        low = constraint.lower is not None and constraint.value < constraint.lower
        limit = constraint.lower if low else constraint.upper
        side = "at least" if low else "at most"
        parts.append(
            f"{constraint.quantity} must be {side} {limit:.6g} and gets to {constraint.value:.6g}, "
            f"missed by {constraint.violation:.3g} {constraint.unit}".rstrip()
        )
    key = f"constraint.{missed[0].quantity}"
    return key, f"cannot be met: {'; '.join(parts)}; relax a limit or widen the bounds"


def optimize_document(point: OperatingPoint, design: optimize.Design) -> dict[str, Any]:
    """The outcome of a `beltjax.optimize.Design`; `point` is the study's first."""
    own = [constraint for constraint in design.constraints if not constraint.implied]
    implied = [constraint for constraint in design.constraints if constraint.implied]
    return {
        "model": model_flags(design.drive),
        "warnings": state_warnings(design.drive, point),
        "design": dict(design.values),
        "objective": {"initial": design.initial, "final": design.final},  # None: nothing runs
        "constraints": [_constraint(constraint) for constraint in own],
        "implied_constraints": [_constraint(constraint) for constraint in implied],
        "success": design.success,
        "starts": [{"final": start.final, "result": start.result} for start in design.starts],
        "active_bounds": design.bounds,
        "conflicts": list(design.conflicts),
        "optimality": _optimality(design.optimality),
        "optima": [optimum._asdict() for optimum in design.optima],
        "scales": design.scales,
        "history": {name: plain(path) for name, path in design.history._asdict().items()},
    }


def chosen_document(chosen: Sequence[optimize.Chosen]) -> dict[str, Any]:
    """The best design of every combination of a study's choices, the best first."""
    rows = [
        {
            "labels": one.labels,
            "numbers": one.numbers,
            "objective": one.design.final,
            "design": dict(one.design.values),
            "success": one.design.success,
        }
        for one in chosen
    ]
    return {"choices": rows}


def robust_document(design: optimize.Design, scatter: optimize.Scatter) -> dict[str, Any]:
    """The keys of a study's tolerances: how they count, and the design's values without them."""
    shown = [constraint for constraint in design.constraints if not constraint.implied]
    drawn = {
        "objective": design.as_drawn,
        "constraints": {constraint.quantity: constraint.as_drawn for constraint in shown},
    }
    return {"robust": {"counted": str(scatter), "numbers": list(scatter.names), "as_drawn": drawn}}


def _optimality(shown: optimize.Optimality | None) -> dict[str, Any] | None:
    """The keys that show how well the conditions of an optimum hold in the scaled problem."""
    if shown is None:
        return None
    keys = ("residual", "stationarity", "violation", "complementarity", "curvature")
    return {key: getattr(shown, key) for key in keys}


def _constraint(constraint: optimize.ConstraintReport) -> dict[str, Any]:
    keys = ("quantity", "unit", "value", "lower", "upper", "multiplier", "active", "violation")
    return {key: getattr(constraint, key) for key in keys}


def optimize_tables(document: dict[str, Any], drive: Drive, si: bool = False) -> Group:
    """The tables of `beltjax optimize`: the design, its constraints, and how the starts ended.

    `drive` is the study's own, in whose file's units they are unless in SI.
    """
    units = TableUnits(drive, si)
    shown = [_design_table(document, drive, units)]
    shown += [_constraint_table(document, units), _start_table(document)]
    if len(document["optima"]) > 1:
        shown.append(_optima_table(document, units))
    if "choices" in document:
        shown.insert(0, _choice_table(document["choices"]))
    return Group(*warning_lines(document), *shown, *map(Text, _optimality_lines(document, units)))


def _choice_table(choices: list[dict[str, Any]]) -> Table:
    """Every combination of choices; what follows is the design of the first."""
    names = list(choices[0]["labels"])
    table = plain_table("Choices, the best first", *map(escape, names), "objective", "")
    for one in choices:
        ending = "" if one["success"] else "not met"
        labels = [escape(one["labels"][name]) for name in names]
        table.add_row(*labels, number(one["objective"], 5), ending)
    return table


def _optima_table(document: dict[str, Any], units: TableUnits) -> Table:
    """The best designs in which starts ended: what differs between them."""
    best = document["optima"][:_FEW_OPTIMA]
    table = plain_table("Optima", "variable", *(str(i + 1) for i in range(len(best))), "unit")
    for name in best[0]["values"]:
        values = [units.of_number(name, optimum["values"][name])[0] for optimum in best]
        table.add_row(escape(name), *values, units.unit_of_number(name)[1])
    table.add_row("starts", *(str(optimum["starts"]) for optimum in best))
    table.add_row("objective", *(f"{o['objective']:.6g}" for o in best), style="bold")
    return table


def _optimality_lines(document: dict[str, Any], units: TableUnits) -> Iterator[str]:
    if "snapped" in document:
        yield snapped_line(document["snapped"], units)
    shown = document["optimality"]
    for name, price in document["active_bounds"].items():
        one, unit = units.unit_of_number(name.rpartition(" ")[0])
        yield f"at its bound: {name} (price {price / one:+.4g}{unit and f' per {unit}'})"
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


def snapped_line(snapped: dict[str, Any], units: TableUnits) -> str:
    """What variables took values on sale, and the loss."""
    parts = []
    for name, value in snapped["values"].items():
        (now, unit), (was, _) = (units.of_number(name, x) for x in (value, snapped["before"][name]))
        parts.append(f"{name} from {was} to {now}{unit and f' {unit}'}")
    lost = "no design then meets all limits"
    if snapped["loss"] is not None:
        lost = f"the objective goes from {snapped['objective']:.6g} by {snapped['loss']:+.3g}"
    return f"snapped: {', '.join(parts)}; {lost}"


def _design_table(document: dict[str, Any], drive: Drive, units: TableUnits) -> Table:
    table = plain_table("Design", "variable", "before", "after", "unit")
    for name, value in document["design"].items():
        own = float(optimize.value_of(drive, name))
        (was, unit), (now, _) = (units.of_number(name, x) for x in (own, value))
        table.add_row(escape(name), was, now, unit)
    objective = document["objective"]
    initial = "-" if objective["initial"] is None else f"{objective['initial']:.6g}"
    final = "-" if objective["final"] is None else f"{objective['final']:.6g}"
    table.add_row("objective", initial, final, style="bold")
    if "robust" in document:
        drawn = document["robust"]["as_drawn"]["objective"]
        table.add_row("objective as drawn", "", f"{drawn:.6g}")
    return table


def _constraint_table(document: dict[str, Any], units: TableUnits) -> Table:
    # The price of a limit is d(objective)/d(limit): what its next unit would buy.
    headers = ["quantity", "value", "lower", "upper", "unit", "", "price of limit"]
    title, drawn = "Constraints", {}
    if "robust" in document:
        title += f": {document['robust']['counted']}"
        headers, drawn = [*headers, "as drawn"], document["robust"]["as_drawn"]["constraints"]
    table = plain_table(title, *headers)
    active_implied = [c for c in document["implied_constraints"] if c["active"] or c["violation"]]
    for constraint in document["constraints"] + active_implied:
        state = "not met" if constraint["violation"] else "active" if constraint["active"] else ""
        factor, unit = units.of_quantity(1.0, constraint["unit"])
        bounds = [
            "-" if constraint[k] is None else f"{factor * constraint[k]:.6g}"
            for k in ("lower", "upper")
        ]
        price = ""
        if constraint["active"] and constraint["multiplier"] is not None:
            price = f"{constraint['multiplier'] / factor:+.4g}"
        name = constraint["quantity"]
        row = [escape(name), f"{factor * constraint['value']:.6g}", *bounds, unit, state, price]
        table.add_row(*row, *([f"{factor * drawn[name]:.6g}"] if name in drawn else []))
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
