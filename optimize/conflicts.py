"""Limits in conflict: which ones no design meets together."""

from typing import Any

import numpy as np
from scipy.optimize import minimize as scipy_minimize
from scipy.optimize import nnls

from .optimality import CLOSE, LocalModel, ModelAt

_FAR = 1e6  # stands for the violation of a design without a drive


def least_violated(at: LocalModel, model_at: ModelAt) -> LocalModel:
    """The design nearest to `at` whose violations, squared and summed, are a minimum."""
    best = at

    def violation(x: np.ndarray) -> tuple[Any, np.ndarray]:
        nonlocal best
        found = model_at(np.clip(x, 0.0, 1.0))
        if found is None:
            return _FAR, np.zeros_like(x)
        if _violated(found) < _violated(best):
            best = found
        over = np.maximum(found.c, 0.0)
        return over @ over / 2, over @ found.dc

    scipy_minimize(
        violation,
        at.x,
        jac=True,
        bounds=[(0.0, 1.0)] * len(at.x),
        method="L-BFGS-B",
        options={"ftol": 1e-15, "gtol": 1e-10},
    )
    return best


def _violated(at: LocalModel) -> float:
    over = np.maximum(at.c, 0.0)
    return float(over @ over)


def conflicting(at: LocalModel, names: list[str]) -> tuple[str, ...]:
    """Limits missed at the least violated design, and those met that keep it from moving on.

    There the violations' gradient is balanced by the gradients of active limits (Farkas): the
    limits that take part cannot be met together, to first order.
    """
    over = np.where(at.c > CLOSE, at.c, 0.0)
    active = np.flatnonzero(np.abs(at.c) <= CLOSE)
    taking = list(np.flatnonzero(over))
    if len(active):
        shares = nnls(at.dc[active].T, -(over @ at.dc))[0]
        taking += list(active[shares > 1e-3 * np.max(over, initial=1e-12)])
    return tuple(dict.fromkeys(names[i] for i in taking))
