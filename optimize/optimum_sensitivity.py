"""Derivatives of an optimum with respect to numbers that the study holds fixed."""

from typing import NamedTuple

import equinox as eqx
import numpy as np

from beltjax.compiling.quick import usual_promotion
from beltjax.drive.components import as_real
from beltjax.drive.numbers import (
    SPEEDS,
    TORQUE,
    full_key,
    is_relative,
    moved_with,
    number_names,
    number_value,
    with_number,
)

from .design import Design
from .optimality import LocalModel, optimality, response_to
from .problem import (
    ProblemScales,
    in_box,
    limited_rows,
    part_counts,
    with_implied_constraints,
)
from .search.results import local_models
from .study import Study

_STEP = 1e-5  # relative, of the differences of exact gradients


class PostOptimal(NamedTuple):
    """Derivatives of an optimum with respect to fixed numbers of the drive, SI."""

    names: tuple[str, ...]  # [numbers], keys of the drive file
    objective: np.ndarray  # [numbers], total
    variables: np.ndarray  # [numbers, variables]; nan where the active set leaves them open


def fixed_numbers(study: Study) -> list[str]:
    """The drive's numbers that the study does not vary.

    Speeds, torques and the relative numbers of arms (angle and length) are not among them.

    Args:
        study: the study.

    Returns:
        Keys of the drive file.
    """
    tied = () if study.ties is None else study.ties.names
    moved = {full_key(study.drive, name) for name in (*study.variables.names, *tied)}
    for name in filter(is_relative, tuple(moved)):
        moved |= moved_with(name)
    names = [n for n in number_names(study.drive) if n not in moved and n not in SPEEDS]
    return [n for n in names if not n.startswith(TORQUE) and not is_relative(n)]


@usual_promotion
def post_optimal(
    study: Study, design: Design, numbers: tuple[str, ...] | None = None
) -> PostOptimal:
    """Derivatives of an optimal design with respect to numbers that the study holds fixed.

    They follow from the implicit function theorem at the conditions of the optimum (A. V. Fiacco,
    Introduction to Sensitivity and Stability Analysis in Nonlinear Programming, 1983), with the
    active set held. Second derivatives are central differences of exact gradients.

    Args:
        study: the study.
        design: the design that `minimize` found for it.
        numbers: keys of the drive file, `fixed_numbers(study)` unless given.

    Returns:
        Derivatives [SI] of the objective, of shape [numbers], and of the variables, of shape
        [numbers, variables].

    Raises:
        ValueError: the design is no strict optimum, or no drive exists beside it for a changed
            number.
    """
    if not design.success:
        raise ValueError("post_optimal: the design is no optimum; read design.result.")
    if design.snapped is not None:
        raise ValueError("post_optimal: snapped variables are no optimum; study the others alone.")
    names = tuple(fixed_numbers(study)) if numbers is None else numbers
    study = with_implied_constraints(study)
    rows = limited_rows(study, part_counts(study))
    scaled = [design.scales[name] for name in study.constraints.names]
    scales = ProblemScales(as_real(design.scales["objective"]), as_real(scaled))
    model_at = local_models(study, scales, rows)
    at = model_at(in_box(study, design.values))
    assert at is not None  # as the design succeeded
    shown = optimality(at, model_at)
    sides = [_difference(study, scales, rows, at, name) for name in names]
    mixed = np.stack([s.df + shown.multipliers @ s.dc for s in sides], axis=1)
    moved = np.stack([s.c for s in sides], axis=1)
    span = np.asarray(study.variables.upper - study.variables.lower)
    slopes = response_to(at, shown, model_at, mixed, moved).T * span
    total = np.array([s.f for s in sides]) + shown.multipliers @ moved
    return PostOptimal(names, total * design.scales["objective"], slopes)


def _difference(
    study: Study, scales: ProblemScales, rows: np.ndarray, at: LocalModel, name: str
) -> LocalModel:
    """Derivatives of a problem's values and first derivatives with respect to one number."""
    value = float(number_value(study.drive, study.point, name))
    h = _STEP * max(abs(value), 1e-3)
    ends = []
    for side in (value + h, value - h):
        drive, _ = with_number(study.drive, study.point, name, as_real(side))
        moved = local_models(eqx.tree_at(lambda s: s.drive, study, drive), scales, rows)(at.x)
        if moved is None:
            raise ValueError(f"post_optimal: there is no drive for {name} = {side:g}.")
        ends.append(moved)
    up, down = ends
    return LocalModel(
        at.x, *((np.asarray(a) - b) / (2 * h) for a, b in zip(up[1:], down[1:], strict=True))
    )
