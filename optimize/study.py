"""Design studies: what may change, what is wanted, what must hold; and the files that say so."""

import math
import os
from pathlib import Path
from typing import Annotated, Any, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float
from pydantic import Field

from beltjax.drive.components import Drive, OperatingPoint, as_real
from beltjax.drive.files import load_drive
from beltjax.drive.quantities import Table, read_toml, to_si, validated
from beltjax.drive.variables import unit_of, variable_names
from beltjax.errors import FileError

from .quantities import MANY, quantity

SiOrText = float | int | str


class VariableTable(Table):
    """[[variable]]."""

    name: str
    lower: SiOrText
    upper: SiOrText


class ConstraintTable(Table):
    """[[constraint]]."""

    quantity: str
    lower: SiOrText | None = None
    upper: SiOrText | None = None


class ObjectiveTable(Table):
    """[objective]."""

    minimize: str | dict[str, float | int]


class OptimizerTable(Table):
    """[optimizer]."""

    method: Literal["augmented-lagrangian"] = "augmented-lagrangian"
    starts: Annotated[int, Field(ge=1, le=100_000)] = 32
    seed: Annotated[int, Field(ge=0)] = 0


class StudyTable(Table):
    """A study file."""

    drive: str
    objective: ObjectiveTable
    variable: Annotated[list[VariableTable], Field(min_length=1)]
    constraint: Annotated[list[ConstraintTable], Field(default_factory=list)]
    optimizer: OptimizerTable = OptimizerTable()


class Limits(eqx.Module):
    """Numbers with a name each and bounds (SI); a bound that is not there is infinite."""

    names: tuple[str, ...] = eqx.field(static=True)
    lower: Float[Array, " names"] = eqx.field(converter=as_real)
    upper: Float[Array, " names"] = eqx.field(converter=as_real)


class Study(eqx.Module):
    """A design study.

    `objective` is a weighted sum of quantities. Variables have finite bounds; constraints at
    least one. Raises `ValueError` for variables and quantities that do not exist.
    """

    drive: Drive
    point: OperatingPoint
    variables: Limits
    constraints: Limits
    weights: Float[Array, " terms"] = eqx.field(converter=as_real)
    objective: tuple[str, ...] = eqx.field(static=True, default=("coupling",))
    starts: int = eqx.field(static=True, default=32)
    seed: int = eqx.field(static=True, default=0)
    name: str = eqx.field(static=True, default="study")

    def __check_init__(self):
        unknown = set(self.variables.names) - set(variable_names(self.drive))
        if unknown:
            raise ValueError(f"Study: no variables of this drive: {', '.join(sorted(unknown))}.")
        for name in (*self.objective, *self.constraints.names):
            try:
                quantity(name, self.drive)
            except KeyError as error:
                raise ValueError(f"Study: {error.args[0]}.") from error


def load_study(path: str | os.PathLike[str]) -> Study:
    """The study that a TOML file describes; its drive file is found beside it.

    Raises `FileError`, one line that names the file, the key and the remedy.
    """
    file = validated(StudyTable, read_toml(path), path)
    drive_path = Path(path).parent / file.drive
    if not drive_path.is_file():
        raise FileError(path, "drive", f"there is no file {drive_path}; give its path from here")
    drive, point = load_drive(drive_path)
    objective = _objective(file, drive, path)
    return Study(
        drive=drive,
        point=point,
        variables=_variables(file, drive, path),
        constraints=_constraints(file, drive, path),
        weights=jnp.array(list(objective.values()), dtype=float),
        objective=tuple(objective),
        starts=file.optimizer.starts,
        seed=file.optimizer.seed,
        name=Path(path).stem,
    )


def _objective(file: StudyTable, drive: Drive, path: object) -> dict[str, float]:
    wanted = file.objective.minimize
    weights = {wanted: 1.0} if isinstance(wanted, str) else dict(wanted)
    if not weights:
        raise FileError(path, "objective.minimize", "is empty; give at least one weight")
    terms = {}
    for name, weight in weights.items():
        # A table of weights may name the spans alone.
        full = f"coupling:{name}" if name in drive.span_names else name
        _require_quantity(full, drive, path, "objective.minimize")
        try:
            terms[full] = to_si(weight, "")
        except ValueError as error:
            raise FileError(path, f"objective.minimize.{name}", str(error)) from error
        if full in MANY:
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
        bounds = _bounds(variable, unit_of(variable.name), path, key)
        if bounds[0] >= bounds[1]:
            found = f"found lower {variable.lower!r}, upper {variable.upper!r}"
            raise FileError(path, key, f"{found}; lower must be less than upper")
        if variable.name.endswith((".radius", "stiffness", "tension", "length")) and bounds[0] <= 0:
            raise FileError(path, f"{key}.lower", f"found {variable.lower!r}; must be positive")
        names.append(variable.name)
        lower.append(bounds[0])
        upper.append(bounds[1])
    return Limits(tuple(names), jnp.array(lower), jnp.array(upper))


def _no_such_variable(name: str, drive: Drive, known: list[str]) -> str:
    words = name.split(".")
    if words[0] == "pulley" and len(words) > 1 and words[1] not in drive.pulley_names:
        return f"there is no pulley {words[1]!r}; give one of {', '.join(drive.pulley_names)}"
    kinds = [known_name for known_name in known if not known_name.startswith("pulley.")]
    kinds += [f"pulley.NAME.{end}" for end in ("radius", "center.x", "center.y")]
    return f"is not a variable of this drive; give one of {', '.join(kinds)}"


def _constraints(file: StudyTable, drive: Drive, path: object) -> Limits:
    names, lower, upper = [], [], []
    for constraint in file.constraint:
        key = f"constraint.{constraint.quantity}"
        unit = _require_quantity(constraint.quantity, drive, path, key)
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


def _require_quantity(name: str, drive: Drive, path: object, key: str) -> str:
    """Unit of a quantity that exists; raises `FileError` where it does not."""
    try:
        return quantity(name, drive).unit
    except KeyError as error:
        raise FileError(path, key, str(error.args[0])) from error


def _bounds(table: Any, unit: str, path: object, key: str) -> tuple[float, float]:
    bounds = {"lower": -math.inf, "upper": math.inf}
    for side in bounds:
        value = getattr(table, side)
        if value is not None:
            try:
                bounds[side] = to_si(value, unit)
            except ValueError as error:
                raise FileError(path, f"{key}.{side}", str(error)) from error
    return bounds["lower"], bounds["upper"]
