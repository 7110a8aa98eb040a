"""Conditions of an optimum: multipliers, the active set, first and second order.

In the scaled problem of `problem.py`, box bounds among the constraints:

    minimize f(x) subject to c(x) <= 0;   L = f + mu . c,   mu >= 0,   mu c = 0.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import nnls

CLOSE = 1e-6  # of a limit, in its scale: may be active
SETTLED = 1e-6  # residual of the conditions below which a design counts as an optimum
BINDING = 1e-7  # multiplier above which an active limit holds the optimum back
_NEAR = 1e-3  # of a limit, in its scale: may hold the optimum back
_BROKEN = 1e-9  # what a linear step may leave a limit missed by
_STEP = 1e-5  # of the differences of exact gradients that make second derivatives

Vector = np.ndarray


class LocalModel(NamedTuple):
    """A design with the problem's values and first derivatives there, bounds included."""

    x: Vector  # [n]
    f: float
    c: Vector  # [m]
    df: Vector  # [n]
    dc: np.ndarray  # [m, n]


ModelAt = Callable[[Vector], LocalModel | None]  # None where there is no drive to evaluate


class Optimality(NamedTuple):
    """The evidence, in the scaled problem."""

    stationarity: float  # largest component of the Lagrangian's gradient
    violation: float
    complementarity: float  # largest multiplier times distance from its limit
    curvature: float | None  # least of the Lagrangian along directions that keep the active limits
    multipliers: Vector  # [m]
    active: np.ndarray  # [m]

    @property
    def residual(self) -> float:
        """The largest residual of the Karush-Kuhn-Tucker conditions."""
        return max(self.stationarity, self.violation, self.complementarity)


def optimality(at: LocalModel, model_at: ModelAt, second: bool = True) -> Optimality:
    """Check the conditions of an optimum at a design; `second` costs 2n more evaluations."""
    active = at.c >= -CLOSE
    multipliers = _multipliers(at)
    gradient = at.df + multipliers @ at.dc
    curvature = None
    if second:
        bent = curvature_matrix(at, multipliers, model_at)
        curvature = None if bent is None else _least(bent, at.dc[active & (multipliers > BINDING)])
    return Optimality(
        stationarity=float(np.max(np.abs(gradient))),
        violation=float(np.max(np.maximum(at.c, 0.0), initial=0.0)),
        complementarity=float(np.max(np.abs(multipliers * at.c), initial=0.0)),
        curvature=curvature,
        multipliers=multipliers,
        active=active,
    )


def _multipliers(at: LocalModel) -> Vector:
    """The multipliers that leave the least of stationarity and complementarity together."""
    near = at.c > -_NEAR
    if not near.any():
        return np.zeros(len(at.c))
    slack = np.diag(np.minimum(at.c[near], 0.0))
    found = nnls(np.concatenate([at.dc[near].T, slack]), np.append(-at.df, np.zeros(len(slack))))[0]
    every = np.zeros(len(at.c))
    every[near] = found
    return every


def curvature_matrix(at: LocalModel, multipliers: Vector, model_at: ModelAt) -> np.ndarray | None:
    """Second derivatives of the Lagrangian, by central differences of its exact gradient."""
    rows = []
    for direction in np.eye(len(at.x)) * _STEP:
        sides = [model_at(at.x + direction), model_at(at.x - direction)]
        if any(side is None for side in sides):
            return None
        up, down = (side.df + multipliers @ side.dc for side in sides if side is not None)
        rows.append((up - down) / (2 * _STEP))
    found = np.array(rows)
    return (found + found.T) / 2


def _least(bent: np.ndarray, fixed: np.ndarray) -> float | None:
    """Least curvature along what the rows `fixed` leave free; None where that is nothing."""
    free = null_space(fixed) if len(fixed) else np.eye(len(bent))
    if not free.shape[1]:
        return None
    return float(np.linalg.eigvalsh(free.T @ bent @ free)[0])


def polished(
    at: LocalModel, model_at: ModelAt, *, tol: float = 1e-11, max_steps: int = 12
) -> LocalModel:
    """A design close to an optimum, moved onto it by Newton's method on its active limits.

    Steps that do not lower the residual of the optimality conditions are halved, then given up;
    the design returned is never worse by that measure than the one given.
    """
    best, now = at, optimality(at, model_at, second=False)
    for _ in range(max_steps):
        if now.residual <= tol:
            break
        step = _newton_step(best, now, model_at)
        moved = _shortened(best, step, now.residual, model_at) if step is not None else None
        if moved is None:
            break
        best, now = moved, optimality(moved, model_at, second=False)
    return best


def _newton_step(at: LocalModel, now: Optimality, model_at: ModelAt) -> Vector | None:
    bent = curvature_matrix(at, now.multipliers, model_at)
    if bent is None:
        return None
    held = now.multipliers > BINDING
    violated = at.c > 0
    for _ in range(len(at.c)):
        rows = np.flatnonzero(held | violated)
        step, prices = _equality_step(at, bent, rows)
        # A limit that pushes the wrong way is let go; one that the step would break is taken in.
        wrong = rows[prices < -BINDING]
        ahead = at.c + at.dc @ step
        broken = np.flatnonzero((ahead > _BROKEN) & ~held & ~violated)
        if len(broken):
            held[broken[np.argmax(ahead[broken])]] = True
        elif len(wrong) and held[rows[np.argmin(prices)]]:
            held[rows[np.argmin(prices)]] = False
        else:
            return step
    return None


def _equality_step(at: LocalModel, bent: np.ndarray, rows: Vector) -> tuple[Vector, Vector]:
    """Newton's step with the limits `rows` met, and their multipliers.

    By least squares, since several limits may say the same.
    """
    return _saddle_solution(bent, at.dc[rows], -at.df, -at.c[rows])


def _saddle_solution(
    bent: np.ndarray, a: np.ndarray, first: np.ndarray, second: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Step and multipliers of bent x + a^T mu = first, a x = second; right sides may be columns."""
    system = np.block([[bent, a.T], [a, np.zeros((len(a), len(a)))]])
    found = np.linalg.lstsq(system, np.concatenate([first, second]), rcond=1e-13)[0]
    return found[: len(bent)], found[len(bent) :]


def _shortened(
    at: LocalModel, step: Vector, residual: float, model_at: ModelAt
) -> LocalModel | None:
    size = min(1.0, 0.1 / max(float(np.max(np.abs(step))), 1e-30))
    for _ in range(6):
        moved = model_at(at.x + size * step)
        if moved is not None and optimality(moved, model_at, second=False).residual < residual:
            return moved
        size /= 2
    return None


def response_to(
    at: LocalModel, shown: Optimality, model_at: ModelAt, mixed: np.ndarray, moved: np.ndarray
) -> np.ndarray:
    """Derivatives of an optimum [n, p] with respect to p numbers, by the implicit function theorem.

    `mixed` [n, p] are the derivatives of the Lagrangian's gradient and `moved` [m, p] of the
    constraints with respect to those numbers, the design held. Valid where the active set stays.
    Raises `ValueError` where the optimum is not strict.
    """
    bent = curvature_matrix(at, shown.multipliers, model_at)
    if bent is None or (shown.curvature is not None and shown.curvature <= 0):
        raise ValueError("the optimum is not strict: it has no derivative")
    rows = np.flatnonzero(shown.active & (shown.multipliers > BINDING))
    return _saddle_solution(bent, at.dc[rows], -mixed, -moved[rows])[0]
