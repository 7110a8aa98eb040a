"""Discrete choices: the continuous problem solved for every combination, all in one batch."""

import dataclasses
import itertools
from typing import NamedTuple

import jax
import jax.numpy as jnp

from beltjax.compiling.quick import quickly_compiled, thoroughly_compiled, usual_promotion
from beltjax.drive.components import as_real
from beltjax.drive.numbers import with_numbers

from .design import Design, report
from .problem import ProblemScales, Starts, limited_rows, starting_points, with_implied_constraints
from .search.augmented_lagrangian import Iterate
from .search.batched import FEW, batch_step, first_states, iterated, result_of
from .search.results import Advance, deadline_of, local_models
from .study import Study


class Chosen(NamedTuple):
    """One combination of options and the best design with it."""

    labels: dict[str, str]  # by name of choice
    numbers: dict[str, float]  # of the drive, SI
    design: Design


@usual_promotion
def enumerated(study: Study, advance: Advance | None = None) -> list[Chosen]:
    """The best design of every combination of a study's choices, the best first.

    The augmented Lagrangian takes all starts of all combinations as one batch. A combination
    without a design that meets all limits comes after those that have one. The study's time limit
    holds for all of them together. docs/optimizing.md.

    Args:
        study: a study with choices.
        advance: function that is called as `advance(stage, done, total)` as the work proceeds.

    Returns:
        One entry per combination, with its labels, its numbers [SI] and its best design.

    Raises:
        ValueError: the study has no choices.
    """
    if not study.choices:
        raise ValueError("enumerated: the study has no choices; use `minimize`.")
    progress = advance or (lambda stage, done, total: None)
    deadline = deadline_of(study)
    own = len(study.constraints.names)
    combinations = list(itertools.product(*(choice.options for choice in study.choices)))
    progress("compiling", 0, None)
    numbers = [dict(pair for o in options for pair in o.numbers) for options in combinations]
    studies = [with_implied_constraints(_with(study, values)) for values in numbers]
    begins = [starting_points(one) for one in studies]
    states, timely = _searched(studies, begins, progress, deadline)
    found = []
    columns = combinations, numbers, studies, begins, states
    for options, values, one, begin, end in zip(*columns, strict=True):
        rows = limited_rows(one, begin.parts)
        model_at = local_models(one, begin.scales, rows)
        searched = result_of(end)._replace(in_time=timely)
        design = report(one, own, begin, rows, model_at, searched)
        labels = {c.name: o.label for c, o in zip(study.choices, options, strict=True)}
        found.append(Chosen(labels, values, design))
    return sorted(found, key=lambda c: (not c.design.success, c.design.final or 0.0))


def _with(study: Study, numbers: dict[str, float]) -> Study:
    real = {name: as_real(value) for name, value in numbers.items()}
    drive, _ = with_numbers(study.drive, study.point, real)
    return dataclasses.replace(study, drive=drive, choices=())


def _searched(
    studies: list[Study], begins: list[Starts], progress: Advance, deadline: float | None
) -> tuple[list[Iterate], bool]:
    """States of all combinations after the search, one by one, and whether time sufficed."""
    stacked, scales, states = (
        jax.tree.map(lambda *leaves: jnp.stack(leaves), *parts)
        for parts in (
            [one.canonical for one in studies],
            [b.scales for b in begins],
            [first_states(b) for b in begins],
        )
    )
    lanes = len(studies) * studies[0].starts
    step = quickly_compiled(_step) if lanes <= FEW else thoroughly_compiled(_step)
    states, timely = iterated(lambda s: step(stacked, scales, s), states, progress, deadline)
    ended = [jax.tree.map(lambda x, k=k: x[k], states) for k in range(len(studies))]
    return ended, timely


def _step(studies: Study, scales: ProblemScales, states: Iterate) -> Iterate:
    return jax.vmap(batch_step)(studies, scales, states)
