"""From a study to a design."""

import os

from beltjax.compiling.quick import usual_promotion

from .checkpoint import Checkpoint
from .design import Design, report
from .problem import limited_rows, starting_points, with_implied_constraints
from .search.registry import find_optimizer
from .search.results import Advance, SearchTools, deadline_of, local_models
from .snapping import snapped
from .study import Study


@usual_promotion
def minimize(
    study: Study,
    advance: Advance | None = None,
    *,
    warm: tuple[dict[str, float], ...] = (),
    checkpoint: str | os.PathLike[str] | None = None,
) -> Design:
    """The design that minimizes a study's objective within its bounds and constraints.

    The search by `study.method` starts from the `warm` designs, from the study's own drive and from
    quasi-random designs, many at once unless `method` takes one by one. The best optima are then
    moved onto the exact conditions of an optimum, which are checked. A study without a solution
    raises nothing: read `.result`, `.constraints` and `.conflicts`. Variables that the study snaps
    then take the values on sale next to their optimum, for each of which the others are optimized
    again; `.snapped` says what that costs. docs/optimizing.md.

    Args:
        study: the study.
        advance: function that is called as `advance(stage, done, total)` as the work proceeds.
        warm: designs to start from, each as values of all variables by name [SI].
        checkpoint: file in which the state of the search is kept, and from which the same study
            continues.

    Returns:
        The best design, with its constraints, its multipliers and all starts.

    Raises:
        ValueError: a checkpoint is damaged or of another study, or a `warm` design lacks a variable
            or has one that is not finite.

    Examples:
        >>> study = bj.optimize.load_study("examples/three_pulley_study.toml")
        >>> design = bj.optimize.minimize(study)
        >>> design.final, design.values
    """
    progress = advance or (lambda stage, done, total: None)
    kept = Checkpoint(checkpoint) if checkpoint else None  # read before the work
    free = _minimized(study, progress, warm, kept)
    if not study.snaps or not free.success:
        return free
    return snapped(study, free, lambda one, begin: _minimized(one, progress, (begin,), None))


def _minimized(
    study: Study,
    progress: Advance,
    warm: tuple[dict[str, float], ...],
    kept: Checkpoint | None,
) -> Design:
    """The best design, whatever is sold."""
    deadline = deadline_of(study)
    own = len(study.constraints.names)
    study = with_implied_constraints(study)
    progress("compiling", 0, None)
    begin = starting_points(study, warm)
    rows = limited_rows(study, begin.parts)
    model_at = local_models(study, begin.scales, rows)
    tools = SearchTools(model_at, progress, deadline, kept)
    found = find_optimizer(study.method).search(study, begin, tools)
    return report(study, own, begin, rows, model_at, found)
