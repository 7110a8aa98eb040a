"""The tolerances of a study file, and what of their effect counts."""

import math
from typing import Annotated

from pydantic import Field

from beltjax.drive.numbers import unit_of
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.files.tables import Table

from ..operating_points import SiOrText, number_of, require_of_drive
from .distributions import Normal, Tolerance, Uniform
from .scatter import MeanPlus, Measure, Scatter, WorstQuantile

_SAMPLES = 256  # for a quantile, unless given


class ToleranceTable(Table):
    """[[tolerance]]: one of a half-width and a standard deviation."""

    name: str
    within: SiOrText | None = None
    deviation: SiOrText | None = None


class RobustTable(Table):
    """[robust]: how many standard deviations count, or which quantile."""

    factor: Annotated[float | int, Field(ge=0, allow_inf_nan=False)] | None = None
    quantile: Annotated[float, Field(gt=0.5, lt=1)] | None = None
    samples: Annotated[int, Field(ge=0, le=100_000)] | None = None


def read_scatter(
    tables: list[ToleranceTable], robust: RobustTable | None, drive: Drive, path: object
) -> Scatter | None:
    """The scatter that a study's tolerances cause; None where there are none.

    Raises `FileError` for numbers that are not the drive's, and for sizes that say too little or
    too much.
    """
    if not tables:
        if robust is not None:
            raise FileError(path, "robust", "needs tolerances; add [[tolerance]] for some numbers")
        return None
    tolerances: dict[str, Tolerance] = {}
    for table in tables:
        key = f"tolerance.{table.name}"
        require_of_drive(drive, table.name, path, key, others=tolerances)
        tolerances[table.name] = _tolerance(table, drive, path, key)
    measure, samples = _measure(robust or RobustTable(), path)
    return Scatter(tuple(tolerances), tuple(tolerances.values()), measure, samples)


def _tolerance(table: ToleranceTable, drive: Drive, path: object, key: str) -> Tolerance:
    given = {"within": table.within, "deviation": table.deviation}
    given = {name: size for name, size in given.items() if size is not None}
    if len(given) != 1:
        raise FileError(path, key, "give one of within (half-width) and deviation (standard)")
    [(kind, size)] = given.items()
    value = number_of(size, unit_of(drive, table.name), path, f"{key}.{kind}")
    if not value > 0:
        raise FileError(path, f"{key}.{kind}", f"found {size!r}; must be positive")
    return Uniform(value) if kind == "within" else Normal(value)


def _measure(robust: RobustTable, path: object) -> tuple[Measure, int]:
    """The measure, and the size of the sample that it is taken of; 0 stands for slopes."""
    if robust.quantile is None:
        factor = 3.0 if robust.factor is None else float(robust.factor)
        return MeanPlus(factor), robust.samples or 0
    if robust.factor is not None:
        raise FileError(path, "robust", "has factor and quantile; remove one")
    samples = _SAMPLES if robust.samples is None else robust.samples
    if samples * (1 - robust.quantile) < 1:
        least = math.ceil(1 / (1 - robust.quantile))
        found = f"found {samples}, which are too few for the quantile {robust.quantile:g}"
        raise FileError(path, "robust.samples", f"{found}; give {least} or more")
    return WorstQuantile(robust.quantile), samples
