"""Study files: a TOML file and the study that it describes."""

import math
import os
from pathlib import Path
from typing import Annotated, Any

import jax
import jax.numpy as jnp
from pydantic import Field

from beltjax.drive.files import load_runs
from beltjax.drive.numbers import fact_of, shift_of, unit_of, variable_names
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.files.reading import read_toml
from beltjax.files.tables import Table, validated
from beltjax.files.units import to_si

from .operating_points import (
    PointTable,
    SiOrText,
    cases_of_duties,
    number_of,
    number_of_drive,
    read_cases,
    require_of_drive,
)
from .quantities import definition_of
from .robust.tolerance_tables import RobustTable, ToleranceTable, read_scatter
from .search.registry import DEFAULT, find_optimizer, optimizer_names
from .study import Choice, Limits, Option, Snap, Study, require_quantity, split_name
from .tie_tables import TieTable, read_snap, read_ties


class VariableTable(Table):
    """[[variable]]."""

    name: str
    lower: SiOrText
    upper: SiOrText
    snap: str | list[SiOrText] | None = None


class ConstraintTable(Table):
    """[[constraint]]."""

    quantity: str
    lower: SiOrText | None = None
    upper: SiOrText | None = None


class ObjectiveTable(Table):
    """[objective]."""

    minimize: str | dict[str, float | int]


class ChoiceTable(Table):
    """[[choice]]; an option is a label and numbers of the drive by their keys."""

    name: str
    option: Annotated[list[dict[str, SiOrText]], Field(min_length=1)]


class ParetoTable(Table):
    """[pareto]."""

    objectives: Annotated[list[str], Field(min_length=2, max_length=3)]
    points: Annotated[int, Field(ge=2, le=200)] = 11


class OptimizerTable(Table):
    """[optimizer]."""

    method: str = DEFAULT
    starts: Annotated[int, Field(ge=1, le=100_000)] = 32
    seed: Annotated[int, Field(ge=0)] = 0
    sharpness: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 50.0
    time_limit: SiOrText | None = None


class StudyTable(Table):
    """A study file."""

    drive: str
    objective: ObjectiveTable
    variable: Annotated[list[VariableTable], Field(min_length=1)]
    tie: Annotated[list[TieTable], Field(default_factory=list)]
    constraint: Annotated[list[ConstraintTable], Field(default_factory=list)]
    point: Annotated[list[PointTable], Field(default_factory=list)]
    choice: Annotated[list[ChoiceTable], Field(default_factory=list)]
    tolerance: Annotated[list[ToleranceTable], Field(default_factory=list)]
    robust: RobustTable | None = None
    pareto: ParetoTable | None = None
    optimizer: OptimizerTable = OptimizerTable()


def load_study(path: str | os.PathLike[str]) -> Study:
    """The study that a TOML file describes. docs/optimizing.md.

    Args:
        path: the study file; the path of the drive file in it is relative to it.

    Returns:
        The study, with its drive.

    Raises:
        FileError: a file or its content is wrong; one line names the file, the key and the remedy.

    Examples:
        >>> study = bj.optimize.load_study("examples/three_pulley_study.toml")
        >>> study.variables.names
    """
    content = read_toml(path)
    if "belt" in content and "drive" not in content:
        message = 'is the key of a drive file; give a study, whose `drive = "FILE"` names it'
        raise FileError(path, "belt", message)
    file = validated(StudyTable, content, path)
    drive_path = Path(path).parent / file.drive
    if not os.path.isfile(drive_path):
        raise FileError(path, "drive", f"there is no file {drive_path}; give its path from here")
    drive, runs = load_runs(drive_path)
    point = runs.point
    cases = (
        read_cases(file.point, drive, point, path)
        if file.point
        else cases_of_duties(runs.duties, drive_path)
    )
    known = cases.names if cases else ()
    objective = _objective(file, drive, point, known, path)
    variables = _variables(file, drive, path)
    return Study(
        drive=drive,
        point=jax.tree.map(lambda x: x[0], cases.points) if cases else point,
        variables=variables,
        ties=read_ties(file.tie, variables, drive, path),
        snaps=_snaps(file, variables, drive, path),
        constraints=_constraints(file, drive, point, known, path),
        weights=jnp.array(list(objective.values()), dtype=float),
        objective=tuple(objective),
        name=Path(path).stem,
        cases=cases,
        scatter=read_scatter(file.tolerance, file.robust, drive, path),
        time_limit=_time_limit(file, path),
        choices=tuple(_choice(table, drive, path) for table in file.choice),
        pareto=_front(file, drive, point, known, path),
        pareto_points=file.pareto.points if file.pareto else 11,
        method=_method(file, path),
        **file.optimizer.model_dump(exclude={"method", "time_limit"}),
    )


def _method(file: StudyTable, path: object) -> str:
    """The name of a registered optimizer."""
    name = file.optimizer.method
    try:
        find_optimizer(name)
    except KeyError as error:
        known = ", ".join(map(repr, optimizer_names()))
        raise FileError(path, "optimizer.method", f"found {name!r}; give one of {known}") from error
    return name


def _time_limit(file: StudyTable, path: object) -> float | None:
    given = file.optimizer.time_limit
    if given is None:
        return None
    seconds = number_of(given, "s", path, "optimizer.time_limit")
    if not seconds > 0:
        raise FileError(path, "optimizer.time_limit", f"found {given!r}; must be positive")
    return seconds


def _objective(
    file: StudyTable, drive: Drive, point: OperatingPoint, cases: tuple[str, ...], path: object
) -> dict[str, float]:
    wanted = file.objective.minimize
    weights = {wanted: 1.0} if isinstance(wanted, str) else dict(wanted)
    if not weights:
        raise FileError(path, "objective.minimize", "is empty; give at least one weight")
    terms = {}
    for name, weight in weights.items():
        # A table of weights may name the spans alone.
        full = f"coupling:{name}" if name in drive.span_names else name
        _require_quantity(full, drive, point, cases, path, "objective.minimize")
        try:
            terms[full] = to_si(weight, "")
        except ValueError as error:
            raise FileError(path, f"objective.minimize.{name}", str(error)) from error
        if definition_of(split_name(full)[0]).many:
            raise FileError(path, "objective.minimize", f"{full!r} is many numbers; constrain it")
    return terms


def _variables(file: StudyTable, drive: Drive, path: object) -> Limits:
    known, names, lower, upper = variable_names(drive), [], [], []
    for variable in file.variable:
        key = f"variable.{variable.name}"
        if variable.name not in known:
            raise FileError(path, key, _no_such_variable(variable.name, drive, known))
        if variable.name in names:
            raise FileError(path, key, "is given twice; remove one")
        shift = shift_of(drive, variable.name)
        bounds = [
            bound - shift for bound in _bounds(variable, unit_of(drive, variable.name), path, key)
        ]
        if bounds[0] >= bounds[1]:
            found = f"found lower {variable.lower!r}, upper {variable.upper!r}"
            raise FileError(path, key, f"{found}; lower must be less than upper")
        fact, _ = fact_of(drive, variable.name)
        if 0 in (fact.above, fact.at_least) and bounds[0] <= 0:
            raise FileError(path, f"{key}.lower", f"found {variable.lower!r}; must be positive")
        names.append(variable.name)
        lower.append(bounds[0])
        upper.append(bounds[1])
    return Limits(tuple(names), jnp.array(lower), jnp.array(upper))


def _snaps(file: StudyTable, variables: Limits, drive: Drive, path: object) -> tuple[Snap, ...]:
    """What the variables may be in the end; raises `FileError`."""
    tables = [table for table in file.variable if table.snap is not None]
    if tables and (file.choice or file.pareto):
        other = "[[choice]]" if file.choice else "[pareto]"
        message = f"does not go with {other}; remove one of them"
        raise FileError(path, f"variable.{tables[0].name}.snap", message)
    return tuple(read_snap(table.name, table.snap, variables, drive, path) for table in tables)


def _no_such_variable(name: str, drive: Drive, known: list[str]) -> str:
    words = name.split(".")
    if words[0] == "pulley" and len(words) > 1 and words[1] not in drive.pulley_names:
        return f"there is no pulley {words[1]!r}; give one of {', '.join(drive.pulley_names)}"
    kinds = [known_name for known_name in known if not known_name.startswith("pulley.")]
    kinds += [f"pulley.NAME.{end}" for end in ("radius", "center.x", "center.y")]
    return f"is not a variable of this drive; give one of {', '.join(kinds)}"


def _constraints(
    file: StudyTable, drive: Drive, point: OperatingPoint, cases: tuple[str, ...], path: object
) -> Limits:
    names, lower, upper = [], [], []
    for constraint in file.constraint:
        key = f"constraint.{constraint.quantity}"
        unit = _require_quantity(constraint.quantity, drive, point, cases, path, key)
        if constraint.lower is None and constraint.upper is None:
            raise FileError(path, key, "has no limit; give lower, upper or both")
        low, high = _bounds(constraint, unit, path, key)
        if low > high:
            found = f"found lower {constraint.lower!r} above upper {constraint.upper!r}"
            raise FileError(path, key, f"{found}; no design can meet both")
        names.append(constraint.quantity)
        lower.append(low)
        upper.append(high)
    return Limits(tuple(names), jnp.array(lower), jnp.array(upper))


def _choice(table: ChoiceTable, drive: Drive, path: object) -> Choice:
    key, options = f"choice.{table.name}", []
    for place, given in enumerate(table.option, start=1):
        numbers = {name: value for name, value in given.items() if name != "label"}
        if not numbers:
            raise FileError(path, key, f"option {place} has no numbers; give some by their keys")
        for name in numbers:
            require_of_drive(drive, name, path, key)
        si = {k: number_of_drive(drive, k, v, path, f"{key}.{k}") for k, v in numbers.items()}
        options.append(Option(str(given.get("label", place)), tuple(si.items())))
    return Choice(table.name, tuple(options))


def _front(
    file: StudyTable, drive: Drive, point: OperatingPoint, cases: tuple[str, ...], path: object
) -> tuple[str, ...]:
    if file.pareto is None:
        return ()
    key = "pareto.objectives"
    for name in file.pareto.objectives:
        bare = name.removeprefix("-")
        _require_quantity(bare, drive, point, cases, path, key)
        if definition_of(split_name(bare)[0]).many:
            raise FileError(path, key, f"{bare!r} is many numbers; constrain it")
    return tuple(file.pareto.objectives)


def _require_quantity(
    name: str,
    drive: Drive,
    point: OperatingPoint,
    cases: tuple[str, ...],
    path: object,
    key: str,
) -> str:
    """Unit of a quantity that exists; raises `FileError` where it does not."""
    try:
        return require_quantity(name, drive, point, cases).unit
    except KeyError as error:
        raise FileError(path, key, str(error.args[0])) from error


def _bounds(table: Any, unit: str, path: object, key: str) -> tuple[float, float]:
    bounds = {"lower": -math.inf, "upper": math.inf}
    for side in bounds:
        value = getattr(table, side)
        if value is not None:
            bounds[side] = number_of(value, unit, path, f"{key}.{side}")
    return bounds["lower"], bounds["upper"]
