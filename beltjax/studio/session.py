"""The model of one page: a design, what was done to it, and what it answers.

It knows no browser and no server. All numbers are SI.
"""

import dataclasses
import operator
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from beltjax import optimize
from beltjax.analysis.linearization import has_inertias
from beltjax.commands.reports.diagnosis import diagnose
from beltjax.commands.reports.documents import plain
from beltjax.commands.reports.vibrating import MOST_VIBRATING
from beltjax.drive.canonical import canonical
from beltjax.drive.components import as_real
from beltjax.drive.numbers import (
    SPEEDS,
    canonical_key,
    full_key,
    number_value,
    require_numbers,
    unit_of,
    with_numbers,
    with_values,
)
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.numerics.bases import Legendre
from beltjax.studio import answers
from beltjax.studio.compiled import program
from beltjax.studio.handles import handles, page_names, turns
from beltjax.studio.judging import Judge
from beltjax.studio.opened import Opened
from beltjax.studio.programs import Answered, answered, over_speed

_SHOWN_SPEEDS = 16  # of the driver at which frequencies are shown
_COARSE = Legendre(6)  # of the curves over speed: to a pixel
_FASTEST = 1.2  # times the fastest operating point, up to which they run
_LEAST_RANGE = 6000 * np.pi / 30  # [rad/s]
_DEEPEST = 200  # steps that are kept for undoing

# Standard deviations of numbers of a study without tolerances: [m], [m], [rad], relative.
TOLERANCES = {"center": 1e-4, "radius": 5e-5, "angle": np.pi / 360, "tension": 0.03}


class UndoStep(NamedTuple):
    """A state to which undoing leads back."""

    study: optimize.Study
    what: str  # was done since, in words


class Session:
    """One page's design.

    `begin`, `move` and `end` are one drag, whose moves are all from where it began; `set_numbers`
    is a single step. `answer` says what is shown.
    """

    def __init__(self, opened: Opened):
        self.opened = opened
        self.study = self.first = opened.study
        self.case = 0
        self.before: optimize.Study | None = None  # a search
        self.tolerances: dict[str, float] | None = None  # deviations of numbers [SI], if shown
        self.past: list[UndoStep] = []
        self.future: list[UndoStep] = []
        self._dragged: optimize.Study | None = None
        self._programs: dict[Any, Any] = {}
        self._bare, self._parts = opened.study, []
        self.handles = handles(self.drive)
        wanted = [*opened.study.variables.names] if opened.is_study else []
        wanted += opened.study.scatter.names if opened.study.scatter else ()
        self.names = page_names(self.drive, self.point, wanted)
        self.judge = Judge(self.names)
        # What walks over the whole drive is done once: names do not change while it is dragged.
        self.units = {name: unit_of(self.drive, name) for name in self.names}
        self._canonical_names = tuple(canonical_key(self.drive, name) for name in self.names)
        if opened.kept:
            self._take_up(opened.kept)

    def _take_up(self, kept: Mapping[str, Any]) -> None:
        """Go on where the file of a page says; raises `ValueError` for what does not fit."""
        for case, values in enumerate(kept["operation"]):
            if values:
                self.show(case)
                self.study = self._changed(self.study, values)
        self.show(kept["case"])
        if kept["numbers"]:
            named = self._checked(kept["numbers"])
            drive = with_values(self.drive, jax.tree.map(jnp.asarray, named))
            self.study = eqx.tree_at(lambda s: s.drive, self.study, drive)

    @property
    def drive(self) -> Drive:
        """The drive as it stands."""
        return self.study.drive

    @property
    def cases(self) -> list[str]:
        """What the operating points are called."""
        names = self.study.operating.names
        return [
            (name or "operation")
            + (f" {names[: k + 1].count(name)}" if names.count(name) > 1 else "")
            for k, name in enumerate(names)
        ]

    @property
    def point(self) -> OperatingPoint:
        """The operating point that is shown."""
        return _point_of(self.study, self.case)

    def show(self, case: int) -> None:
        """Show another operating point; raises `ValueError` where there is none."""
        if not 0 <= case < len(self.cases):
            raise ValueError(f"there is no operating point {case}")
        self.case = case

    # What changes the design.

    def begin(self) -> None:
        """Begin a drag."""
        self._dragged = self.study

    def move(self, values: Mapping[str, float]) -> None:
        """Go on with a drag: these numbers [SI] in place of those where it began."""
        self.study = self._changed(self._dragged or self.study, values)

    def end(self, what: str = "dragged") -> None:
        """End a drag, which is one step for undoing."""
        if self._dragged is not None and self._dragged is not self.study:
            self._keep(UndoStep(self._dragged, what))
        self._dragged = None

    def set_numbers(self, values: Mapping[str, float], what: str = "") -> None:
        """Set numbers of the drive or of the point that is shown [SI], as one step.

        Raises `ValueError` for numbers that the drive does not have or cannot have.
        """
        changed = self._changed(self.study, values)
        self._keep(UndoStep(self.study, what or f"set {', '.join(values)}"))
        self.study = changed

    def take(self, drive: Drive, what: str) -> None:
        """Take another drive of the same parts, as one step."""
        self._keep(UndoStep(self.study, what))
        self.study = eqx.tree_at(lambda s: s.drive, self.study, drive)

    def undo(self) -> bool:
        """Go back one step; returns whether there was one."""
        return self._step(self.past, self.future)

    def redo(self) -> bool:
        """Go forward again; returns whether there was a step that was undone."""
        return self._step(self.future, self.past)

    def _step(self, source: list[UndoStep], target: list[UndoStep]) -> bool:
        self._dragged = None
        if not source:
            return False
        step = source.pop()
        target.append(UndoStep(self.study, step.what))
        self.study = step.study
        return True

    def _keep(self, step: UndoStep) -> None:
        self.past = [*self.past, step][-_DEEPEST:]
        self.future = []

    def _changed(self, study: optimize.Study, values: Mapping[str, float]) -> optimize.Study:
        """`study` with these numbers; angles are counted from the file's drive."""
        named = self._checked(values)
        turned = turns(study.drive, self.first.drive, self.handles)
        named |= _followers(study, named)
        steps = {name: value - turned.get(name, 0.0) for name, value in named.items()}
        point = _point_of(study, self.case)
        drive, after = with_numbers(study.drive, point, jax.tree.map(jnp.asarray, steps))
        study = eqx.tree_at(lambda s: s.drive, study, drive)
        if not any(name.startswith("operation.") for name in named):
            return study
        return _with_point(study, self.case, after)

    def _checked(self, values: Mapping[str, float]) -> dict[str, float]:
        found = {full_key(self.drive, name): float(value) for name, value in values.items()}
        if not found.keys() <= self.units.keys():
            require_numbers(self.drive, list(found))
        for own, other in (SPEEDS, SPEEDS[::-1]):
            if other in found and own in self.units:
                raise ValueError(f"{other}: the file gives {own}; change that one")
        bad = [name for name, value in found.items() if not np.isfinite(value)]
        if bad:
            raise ValueError(f"{bad[0]}: found {found[bad[0]]}; give a finite number")
        small = [n for n, x in found.items() if n.endswith(".radius") and x <= 0]
        if small:
            raise ValueError(f"{small[0]}: found {found[small[0]]:g}; must be positive")
        return found

    # What the design answers.

    @property
    def modes(self) -> int:
        """Number of natural frequencies that are shown."""
        few = len(self.drive.pulleys) <= MOST_VIBRATING
        return optimize.drive_analyses.MODES if few and has_inertias(self.drive) else 0

    def answered(self) -> Answered:
        """The state at the point that is shown, with all derivatives, on the host."""
        args = (
            *canonical(self.drive, self.point),
            self._canonical_names,
            self.modes,
            optimize.drive_analyses.BASIS,
        )
        return self._run(answered, *args)

    def canonical_study(self) -> optimize.Study:
        """`study.canonical`; all but the drive, which is dragged, is made once."""
        parts = jax.tree.leaves((self.study.cases, self.study.point))
        if len(parts) != len(self._parts) or any(map(operator.is_not, parts, self._parts)):
            self._bare, self._parts = self.study.canonical, parts
        drive = jax.tree.map(as_real, self.drive)
        return eqx.tree_at(lambda s: s.drive, self._bare, drive)

    def _run(self, function: Any, *args: Any) -> Any:
        """A program's answer; the program is looked for but once."""
        if function not in self._programs:
            self._programs[function] = program(function, *args)
        return jax.block_until_ready(self._programs[function](*args))

    def answer(self, moving: bool = False) -> dict[str, Any]:
        """Everything shown, as plain numbers and packed derivatives.

        Of a study whose limits take long, those of a design that is `moving` are by derivatives;
        "judged" says which they are: "true", "predicted" or, not compiled yet, "pending".
        """
        drive, point, found = self.drive, self.point, self.answered()
        by_name = np.asarray(found.numbers)
        judging = "true"
        measured = self.judge.known(by_name) if moving and self.judge.slow else None
        if measured is not None:
            judging = "predicted"
        else:
            measured = self.judge(self.canonical_study(), by_name)
        flat = np.asarray(found.flat)
        places = answers.fields(drive, flat, self.modes)
        shown = {name: flat[start : start + size] for name, (start, size) in places.items()}
        numbers = dict(zip(self.names, by_name.tolist(), strict=True))
        numbers |= turns(drive, self.first.drive, self.handles)
        fault = answers.fault(drive, found)
        objective, limits, known = np.zeros(len(self.names)), [], False
        if measured is None:
            judging = "pending"
        else:
            objective, known = np.asarray(measured.slopes.worst), bool(measured.values.found)
            limits = answers.lights(self.study, self.opened.own_constraints, measured)
        rows = [light.pop("row") for light in limits]
        derivatives = np.vstack([found.slopes, objective, *rows])
        downhill = answers.arrows(drive, self.handles, self.names, objective, shown)
        return {
            "fault": fault,
            "judged": judging,
            "fields": places,
            "values": plain(flat),
            "slopes": answers.packed(derivatives),
            "numbers": numbers,
            "objective": plain(measured.values.worst) if measured and known else None,
            "limits": limits,
            "movers": answers.movers(self.units, numbers, objective),
            "arrows": {} if fault else downhill,
            "bodies": answers.stops(drive, shown, np.asarray(found.steady.reference.coordinates)),
            "warnings": [] if fault else answers.worded_warnings(drive, point, found),
            "driver_speed": self.driver_speeds()[self.case],
            "bands": self._bands(derivatives),
            "undo": self.past[-1].what if self.past else "",
            "redo": self.future[-1].what if self.future else "",
        }

    def _bands(self, slopes: np.ndarray) -> list[float] | None:
        """Standard deviation of everything shown, by its derivatives; None: not wanted."""
        if self.tolerances is None:
            return None
        sizes = np.array([self.tolerances.get(name, 0.0) for name in self.names])
        return plain(np.sqrt(np.sum((slopes * sizes) ** 2, axis=1)))

    def show_bands(self, sizes: Mapping[str, float] | None) -> None:
        """Show what tolerances do, or with None stop it.

        They are the study's own where it has some; else those of centers and radii [m], angles
        [rad] and, relative, tensions, by the words of `TOLERANCES`, which `sizes` may change.

        Raises `ValueError` for a size that is not a number from 0 on, or that is of nothing.
        """
        if sizes is None:
            self.tolerances = None
            return
        chosen = TOLERANCES | {word: float(size) for word, size in sizes.items()}
        bad = [w for w, x in chosen.items() if w not in TOLERANCES or not 0 <= x < np.inf]
        if bad:
            known = ", ".join(TOLERANCES)
            raise ValueError(f"tolerance {bad[0]!r}: give a number from 0 on to one of {known}")
        scatter = self.first.scatter
        if scatter is not None:
            each = zip(scatter.names, scatter.tolerances, strict=True)
            self.tolerances = {full_key(self.drive, n): float(one.standard) for n, one in each}
            return
        self.tolerances = {}
        for name in self.names:
            if ".center." in name or ".pivot." in name:
                self.tolerances[name] = chosen["center"]
            elif name.endswith(".radius"):
                self.tolerances[name] = chosen["radius"]
            elif name.endswith(".angle"):
                self.tolerances[name] = chosen["angle"]
            elif name.startswith("installation.tension"):
                value = number_value(self.drive, self.point, name)
                self.tolerances[name] = chosen["tension"] * float(value)

    def fault(self) -> str:
        """Why the design cannot be built or does not run; empty where it is good."""
        found = answers.fault(self.drive, self.answered())
        return found["text"] if found else ""

    def diagnosis(self) -> str:
        """Why the drive does not run, with the key of its file and what to do; empty: it runs."""
        found = diagnose(self.drive, self.point, self.answered().steady)
        return f"{found.key}: {found.message}" if found else ""

    def over_speed(self, handle: str = "") -> dict[str, Any] | None:
        """Natural frequencies over the driver's speed; None without inertias.

        With derivatives by the numbers of a handle, at most two, or two zeros.
        """
        if not self.modes:
            return None
        directions = np.zeros((2, len(self.names)))
        for one in self.handles:
            if one.key == handle:
                for row, way in zip(directions, one.names, strict=False):
                    row[[self.names.index(name) for name in way]] = 1.0
        speeds = self.speeds()
        args = (*canonical(self.drive, self.point), self._canonical_names, jnp.asarray(directions),
                jnp.asarray(speeds), self.modes, _COARSE)  # fmt: skip
        found = self._run(over_speed, *args)
        hertz = np.asarray(found.hertz)
        good = np.isfinite(hertz) & (hertz > 0)
        return {
            "speeds": plain(speeds),
            "hertz": plain(np.where(good, hertz, np.nan)),
            "slopes": plain(found.slopes),
        }

    def speeds(self) -> np.ndarray:
        """The driver's speeds at which frequencies are shown [rad/s]."""
        fastest = max(self.driver_speeds()) * _FASTEST
        return np.linspace(0.0, max(fastest, _LEAST_RANGE), _SHOWN_SPEEDS + 1)[1:]

    def driver_speeds(self) -> list[float]:
        """The driver's speed at each operating point [rad/s]."""
        drive, points = self.drive, self.study.operating.points
        radius = float(drive.drives @ drive.radii)
        if points.driver_speed is not None:
            return np.asarray(points.driver_speed).ravel().tolist()
        return (np.asarray(points.belt_speed) / radius).ravel().tolist()


def _followers(study: optimize.Study, named: Mapping[str, float]) -> dict[str, float]:
    """The numbers that a study ties to those that are set."""
    ties, drive = study.ties, study.drive
    if ties is None:
        return {}
    numbers = zip(
        *(np.asarray(part).tolist() for part in (ties.factors, ties.offsets)), strict=True
    )
    return {
        full_key(drive, name): factor * named[full_key(drive, to)] + offset
        for name, to, (factor, offset) in zip(ties.names, ties.to, numbers, strict=True)
        if full_key(drive, to) in named
    }


def _point_of(study: optimize.Study, case: int) -> OperatingPoint:
    """One of the operating points of a study."""
    points = study.operating.points
    # By NumPy: entries of JAX's arrays are taken by programs of their own, which is slow.
    return jax.tree.map(lambda x: jnp.asarray(np.asarray(x)[case]), points)


def _with_point(study: optimize.Study, case: int, point: OperatingPoint) -> optimize.Study:
    """`study` with another operating point in that place.

    Raises `ValueError` where it is of another kind than the other points.
    """
    if study.cases is None:
        return dataclasses.replace(study, point=point)
    before = study.cases.points
    if jax.tree.structure(before) != jax.tree.structure(point):
        raise ValueError("the operating points of a study are of one kind; give what it gives")
    points = jax.tree.map(lambda x, y: x.at[case].set(y), before, point)
    study = eqx.tree_at(lambda s: s.cases.points, study, points)
    first = jax.tree.map(lambda x: x[0], points)
    return dataclasses.replace(study, point=first)
