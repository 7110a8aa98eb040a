"""Design studies: what may change, what is wanted, what must hold, and where it must hold."""

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from beltjax.drive.canonical import strongly_typed
from beltjax.drive.components import as_real, concrete
from beltjax.drive.numbers import full_key, require_numbers, variable_names
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive

from .quantities import Quantity, find_quantity
from .robust.scatter import Scatter
from .search.registry import DEFAULT, find_optimizer


class Cases(eqx.Module):
    """Operating points that a design is measured at; a range of speeds is many of one name."""

    points: OperatingPoint  # every leaf [cases]
    names: tuple[str, ...] = eqx.field(static=True)  # of each case
    are_duties: bool = eqx.field(static=True, default=False)  # of the drive file

    @property
    def duties(self) -> dict[str, OperatingPoint]:
        """The cases by their names where they are duties of the drive file; else none."""
        if not self.are_duties:
            return {}
        points = self.points
        return {n: jax.tree.map(lambda x, k=k: x[k], points) for k, n in enumerate(self.names)}

    def places(self, name: str) -> list[int]:
        """Places of the cases of that name; of all of them for ""."""
        return [i for i, own in enumerate(self.names) if name in ("", own)]


def split_name(name: str) -> tuple[str, str]:
    """A quantity's own name and that of the operating point after its last "@", or ""."""
    base, at, where = name.rpartition("@")
    return (base, where) if at else (name, "")


class Limits(eqx.Module):
    """Numbers with a name each and bounds (SI); a bound that is not there is infinite."""

    names: tuple[str, ...] = eqx.field(static=True)
    lower: Float[Array, " names"] = eqx.field(converter=as_real)
    upper: Float[Array, " names"] = eqx.field(converter=as_real)


class Ties(eqx.Module):
    """Numbers of the drive that follow from variables: factor times the variable, plus offset."""

    names: tuple[str, ...] = eqx.field(static=True)  # of the numbers that follow
    to: tuple[str, ...] = eqx.field(static=True)  # the variable of each
    factors: Float[Array, " names"] = eqx.field(converter=as_real)
    offsets: Float[Array, " names"] = eqx.field(converter=as_real)  # SI


class Snap(NamedTuple):
    """Values that a variable may have in the end: sizes, lengths or numbers of teeth on sale."""

    name: str
    values: tuple[float, ...]  # SI, rising


class Option(NamedTuple):
    """One way to choose: a label, and the drive's numbers that go with it (SI)."""

    label: str
    numbers: tuple[tuple[str, float], ...]


class Choice(NamedTuple):
    """Options of which a design takes one: belts of a catalog, numbers of ribs."""

    name: str
    options: tuple[Option, ...]


class Study(eqx.Module):
    """A design study.

    `objective` is a weighted sum of quantities. Variables have finite bounds; constraints at
    least one. A quantity is measured at every one of `cases` (at `point` where there are none),
    or by "NAME@CASE" at that one: limits hold at each, and each term of the objective is a soft
    maximum over them. With `scatter` limits and objective see what its tolerances make of them.
    Numbers under `ties` follow the variables; `snaps` are what variables may be in the end.
    Raises `ValueError` for variables, quantities, numbers, cases and methods that do not exist.
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
    cases: Cases | None = None
    scatter: Scatter | None = None
    method: str = eqx.field(static=True, default=DEFAULT)  # a registered optimizer
    sharpness: Float[Array, ""] = eqx.field(converter=as_real, default=50.0)  # of the soft maximum
    time_limit: float | None = eqx.field(static=True, default=None)  # [s]
    choices: tuple[Choice, ...] = eqx.field(static=True, default=())
    pareto: tuple[str, ...] = eqx.field(static=True, default=())  # objectives of a front
    pareto_points: int = eqx.field(static=True, default=11)
    ties: Ties | None = None
    snaps: tuple[Snap, ...] = eqx.field(static=True, default=())

    @property
    def operating(self) -> Cases:
        """The operating points that the design is measured at."""
        return self.cases or Cases(jax.tree.map(lambda x: x[None], self.point), ("",))

    @property
    def canonical(self) -> "Study":
        """The study as compiled programs take it: searches of all kinds compile it once.

        Without what only a search needs, and with strongly typed arrays for all numbers.
        """
        search: dict[str, Any] = {"starts": 1, "seed": 0, "method": DEFAULT, "time_limit": None}
        search |= {"name": "", "choices": (), "snaps": (), "pareto": (), "pareto_points": 0}
        bare = dataclasses.replace(self, **search)
        physical = jax.tree.map(as_real, (bare.drive, bare.point, bare.cases))
        return strongly_typed(
            eqx.tree_at(
                lambda s: (s.drive, s.point, s.cases), bare, physical, is_leaf=lambda x: x is None
            )
        )

    def __check_init__(self):
        self._check_search()
        unknown = set(self.variables.names) - set(variable_names(self.drive))
        if unknown:
            raise ValueError(f"Study: no variables of this drive: {', '.join(sorted(unknown))}.")
        if self.ties is not None:
            self._check_ties(self.ties)
        if self.scatter is not None:
            require_numbers(self.drive, self.scatter.names)
            if any(name.startswith("operation.") for name in self.scatter.names):
                raise ValueError("Study: tolerances are of the drive; give operating points.")
        known = self.cases.names if self.cases else ()
        fronts = (name.removeprefix("-") for name in self.pareto)
        for name in (*self.objective, *self.constraints.names, *fronts):
            try:
                require_quantity(name, self.drive, self.point, known)
            except KeyError as error:
                raise ValueError(f"Study: {error.args[0]}.") from error

    def _check_ties(self, ties: Ties) -> None:
        varied = {full_key(self.drive, name) for name in self.variables.names}
        followers = [full_key(self.drive, name) for name in ties.names]
        unknown = {*ties.names} - set(variable_names(self.drive))
        unknown |= {*ties.to} - set(self.variables.names)
        if unknown:
            raise ValueError(f"Study: ties name no variables: {', '.join(sorted(unknown))}.")
        if len(set(followers)) < len(followers) or varied & set(followers):
            raise ValueError("Study: a tied number is tied once and is no variable.")

    def _check_search(self) -> None:
        try:
            find_optimizer(self.method)
        except KeyError as error:
            raise ValueError(f"Study: {error.args[0]}.") from error
        for name, least in (("starts", 1), ("seed", 0)):
            number = getattr(self, name)
            if not isinstance(number, int) or number < least:
                raise ValueError(f"Study: {name} is a whole number from {least}, not {number!r}.")
        sharpness = concrete(self.sharpness)
        if sharpness is not None and not np.all(sharpness > 0):
            raise ValueError(f"Study: sharpness is positive, not {sharpness}.")
        if self.time_limit is not None and not self.time_limit > 0:
            raise ValueError(f"Study: time_limit is positive, not {self.time_limit!r}.")


def require_quantity(
    name: str, drive: Drive, point: OperatingPoint, cases: tuple[str, ...]
) -> Quantity:
    """The quantity of "NAME" or "NAME@CASE"; raises `KeyError` with a text for what is missing."""
    base, where = split_name(name)
    if where and where not in cases:
        known = ", ".join(dict.fromkeys(cases)) or "none; add [[point]]"
        raise KeyError(f"there is no operating point {where!r}; there are {known}")
    return find_quantity(base, drive, point)
