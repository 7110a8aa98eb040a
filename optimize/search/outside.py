"""Optimizers from other libraries behind one call, given exact derivatives: SciPy's and IPOPT."""

import importlib
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import Bounds, NonlinearConstraint
from scipy.optimize import minimize as scipy_minimize

from ..optimality import Local, Look

Vector = np.ndarray
_LOST = 1e3  # objective and violation of a design that cannot be evaluated


class Ended(NamedTuple):
    """Where an optimizer stopped, and why."""

    x: Vector
    converged: bool
    message: str
    path: tuple[tuple[float, float], ...]  # objective and violation of every iteration


def in_time(deadline: float | None) -> bool:
    """Whether it is before a `deadline` of `time.monotonic`; None is never."""
    return deadline is None or time.monotonic() < deadline


class _Problem:
    """What a solver asks at a point; box bounds kept apart."""

    def __init__(self, look: Look, start: Local, deadline: float | None):
        self._look, self._deadline = look, deadline
        self.last = start  # that could be evaluated
        self.path: list[tuple[float, float]] = []

    def at(self, x: Vector) -> Local:
        """The problem at x; where nothing runs, values to turn away from."""
        inside = np.clip(x, 0.0, 1.0)
        found = self._look(inside)
        if found is None:
            return self.last._replace(x=inside, f=_LOST, c=np.full_like(self.last.c, _LOST))
        self.last = found
        return found

    def limits(self, x: Vector) -> Vector:
        """Constraints without the 2n bounds, which come last."""
        return self.at(x).c[: -2 * len(x)]

    def limit_slopes(self, x: Vector) -> np.ndarray:
        """Their derivatives."""
        return self.at(x).dc[: -2 * len(x)]

    def note(self, f: float, violation: float) -> bool:
        """Keep an iteration; whether there is time for the next."""
        self.path.append((float(f), float(violation)))
        return in_time(self._deadline)

    def watch(self, x: Vector, *_: Any) -> None:
        """The same for SciPy, which ends a search by an exception."""
        at = self.at(x)
        if not self.note(at.f, np.max(np.maximum(at.c, 0.0), initial=0.0)):
            raise StopIteration


def slsqp(problem: _Problem, x: Vector) -> Ended:
    """SciPy's sequential quadratic programming."""
    found = scipy_minimize(
        lambda x: problem.at(x).f,
        x,
        jac=lambda x: problem.at(x).df,
        bounds=Bounds(0.0, 1.0),
        constraints={
            "type": "ineq",
            "fun": lambda x: -problem.limits(x),
            "jac": lambda x: -problem.limit_slopes(x),
        },
        method="SLSQP",
        callback=problem.watch,
        options={"ftol": 1e-13, "maxiter": 300},
    )
    return Ended(found.x, bool(found.success), str(found.message), tuple(problem.path))


def trust_constr(problem: _Problem, x: Vector) -> Ended:
    """SciPy's interior trust-region method."""
    rows = len(problem.limits(x))
    slopes: Any = problem.limit_slopes  # a callable, which SciPy's annotations leave out
    limits = NonlinearConstraint(problem.limits, np.full(rows, -np.inf), np.zeros(rows), slopes)
    with np.errstate(all="ignore"):  # it divides by components that vanish, and copes
        found = scipy_minimize(
            lambda x: problem.at(x).f,
            x,
            jac=lambda x: problem.at(x).df,
            bounds=Bounds(0.0, 1.0, keep_feasible=True),
            constraints=[limits],
            method="trust-constr",
            callback=problem.watch,
            options={"gtol": 1e-9, "xtol": 1e-12, "barrier_tol": 1e-10, "maxiter": 1000},
        )
    return Ended(found.x, found.status in (1, 2), str(found.message), tuple(problem.path))


def ipopt(problem: _Problem, x: Vector) -> Ended:
    """IPOPT by its binding `ipyopt`; its second derivatives are of limited memory."""
    ipyopt = importlib.import_module("ipyopt")  # an extra
    n, m = len(x), len(problem.limits(x))
    dense = np.repeat(np.arange(m), n), np.tile(np.arange(n), m)

    def into(out: Vector, values: np.ndarray) -> None:
        out[()] = values.ravel()

    def watch(_mode: int, _step: int, f: float, violation: float, *_: Any) -> bool:
        return problem.note(f, violation)

    nlp = ipyopt.Problem(
        n,
        np.zeros(n),
        np.ones(n),
        m,
        np.full(m, -2e19),
        np.zeros(m),
        dense,
        (np.array([], int), np.array([], int)),
        lambda x: problem.at(x).f,
        lambda x, out: into(out, problem.at(x).df),
        lambda x, out: into(out, problem.limits(x)),
        lambda x, out: into(out, problem.limit_slopes(x)),
        intermediate_callback=watch,
        ipopt_options={
            "hessian_approximation": "limited-memory",
            "print_level": 0,
            "sb": "yes",
            "tol": 1e-9,
            "max_iter": 500,
        },
    )
    found, _, status = nlp.solve(np.array(x, float))
    message = "solved" if status == 0 else f"IPOPT's status {status}"
    return Ended(np.clip(found, 0.0, 1.0), status in (0, 1), message, tuple(problem.path))


SOLVERS: dict[str, Callable[[_Problem, Vector], Ended]] = {
    "slsqp": slsqp,
    "trust-constr": trust_constr,
    "ipopt": ipopt,
}


def solve(method: str, look: Look, start: Local, deadline: float | None = None) -> Ended:
    """Run one of `SOLVERS` from a design that runs, until its end or a `deadline` (monotonic)."""
    problem = _Problem(look, start, deadline)
    try:
        return SOLVERS[method](problem, start.x.copy())
    except StopIteration:  # what SLSQP lets through
        return Ended(problem.last.x, False, "out of time", tuple(problem.path))
