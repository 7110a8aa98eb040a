"""From a study to a design."""

import os

from beltjax.compiling.quick import usual_promotion

from .checkpoint import Checkpoint
from .design import Design, report
from .problem import limited_rows, starting_points, with_implied_constraints
from .search.registry import find_optimizer
from .search.results import Advance, SearchTools, deadline_of, local_models
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

    Searches by `study.method` from `warm` designs (values of the variables, SI), from the study's
    own drive and from quasi-random designs; the augmented Lagrangian takes them as one batch. The
    best optima are then moved onto the exact conditions of an optimum, which are checked.
    `advance(stage, done, total)` is called as the work proceeds. With `checkpoint` the search's
    state is kept in that file, and the same study goes on from it.

    Never raises for a study without a solution: read `.result`, `.constraints` and `.conflicts`.
    Raises `ValueError` for a checkpoint of another study or a damaged one, and for `warm` designs
    that lack a variable or have one that is not finite.
    """
    progress = advance or (lambda stage, done, total: None)
    deadline = deadline_of(study)
    kept = Checkpoint(checkpoint) if checkpoint else None  # read before the work
    own = len(study.constraints.names)
    study = with_implied_constraints(study)
    progress("compiling", 0, None)
    begin = starting_points(study, warm)
    rows = limited_rows(study, begin.parts)
    model_at = local_models(study, begin.scales, rows)
    tools = SearchTools(model_at, progress, deadline, kept)
    found = find_optimizer(study.method).search(study, begin, tools)
    return report(study, own, begin, rows, model_at, found)
