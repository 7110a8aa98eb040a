"""Variables that take a value on sale: the best of those next to the optimum, and the loss."""

import dataclasses
import itertools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from beltjax.analysis.steady import steady_state
from beltjax.drive.components import as_real
from beltjax.drive.numbers import value_of, with_values
from beltjax.drive.system import Drive
from beltjax.results import RESULTS

from .design import Design, Snapped, constraint_reports
from .problem import ProblemScales, run_measured, with_implied_constraints, with_tied
from .study import Limits, Snap, Study, Ties

Again = Callable[[Study, dict[str, float]], Design]


def snapped(study: Study, free: Design, again: Again) -> Design:
    """The best design whose snapped variables have values on sale, next to the optimum `free`.

    Each takes the next value below and above. For each combination `again` optimizes the other
    variables, from where they were.
    """
    sides = [neighbors(snap, free.values[snap.name]) for snap in study.snaps]
    found = []
    for values in itertools.product(*sides):
        taken = {snap.name: value for snap, value in zip(study.snaps, values, strict=True)}
        found.append((taken, _with_taken(study, free, taken, again)))
    taken, best = min(found, key=lambda one: _rank(one[1]))
    lost = None
    if best.success and best.final is not None and free.final is not None:
        lost = best.final - free.final
    return dataclasses.replace(
        best,
        before=free.before,
        initial=free.initial,
        snapped=Snapped(taken, free.values, free.final, lost),
    )


def _rank(design: Design) -> tuple[bool, float]:
    return not design.success, np.inf if design.final is None else design.final


def neighbors(snap: Snap, value: float) -> list[float]:
    """The values on sale next to one, the nearest first; that alone where it is on sale."""
    below = [one for one in snap.values if one <= value]
    above = [one for one in snap.values if one > value]
    near = sorted([*below[-1:], *above[:1]], key=lambda one: abs(one - value))
    return near[:1] if abs(near[0] - value) <= 1e-9 * abs(value) else near


def _with_taken(study: Study, free: Design, taken: dict[str, float], again: Again) -> Design:
    """The best design with these values, described as one of the whole study."""
    own = study.variables
    left = [i for i, name in enumerate(own.names) if name not in taken]
    fixed = with_tied(_of_variables(study.ties, [*taken]), taken)
    drive = with_values(study.drive, {name: as_real(value) for name, value in fixed.items()})
    if not left:
        return _measured(study, free, drive)
    places, names = np.array(left), tuple(own.names[i] for i in left)
    narrowed = dataclasses.replace(
        study,
        drive=drive,
        variables=Limits(names, own.lower[places], own.upper[places]),
        ties=_of_variables(study.ties, [*names]),
        snaps=(),
    )
    design = again(narrowed, free.values)
    every = {name: float(value) for name, value in fixed.items()} | design.values
    return dataclasses.replace(design, values={name: every[name] for name in free.values})


def _of_variables(ties: Ties | None, names: list[str]) -> Ties | None:
    """Those ties that follow from some of the variables."""
    kept = [] if ties is None else [i for i, to in enumerate(ties.to) if to in names]
    if ties is None or not kept:
        return None
    names_of, to = (tuple(words[i] for i in kept) for words in (ties.names, ties.to))
    return Ties(names_of, to, ties.factors[np.array(kept)], ties.offsets[np.array(kept)])


def _measured(study: Study, free: Design, drive: Drive) -> Design:
    """The design of a drive in which every variable is taken: nothing is left to search."""
    own = len(study.constraints.names)
    names = [*free.values]
    study = with_implied_constraints(study)
    shown = run_measured(study, drive)
    named = [free.scales[name] for name in study.constraints.names]
    scales = ProblemScales(jnp.asarray(free.scales["objective"]), jnp.asarray(named))
    drawn = None
    if study.scatter is not None:
        drawn = run_measured(dataclasses.replace(study, scatter=None), drive)
    constraints = constraint_reports(study, own, scales, (shown, drawn), None)
    good = bool(shown.found) and not any(one.violation for one in constraints)
    return dataclasses.replace(
        free,
        drive=drive,
        steady=jax.device_get(steady_state(drive, study.point, throw=False)),
        values={name: float(value_of(drive, name)) for name in names},
        final=float(shown.worst) if shown.found else None,
        as_drawn=None if drawn is None else float(drawn.worst),
        constraints=constraints,
        optima=(),
        optimality=None,
        bounds={},
        result=RESULTS.successful if good else RESULTS.constraints_infeasible,
    )
