"""Optimizers of other libraries, given exact derivatives: SciPy's and IPOPT."""

from typing import Any

import numpy as np
from scipy.optimize import Bounds, NonlinearConstraint
from scipy.optimize import minimize as scipy_minimize

from .one_by_one import AbstractLocalOptimizer, Ending, UnitBoxProblem, Vector
from .registry import optimizer


@optimizer("slsqp")
class Slsqp(AbstractLocalOptimizer):
    """SciPy's sequential quadratic programming."""

    def minimize(self, problem: UnitBoxProblem, x: Vector) -> Ending:
        """Go from x to a minimum, to 13 digits of the objective."""
        found = scipy_minimize(
            problem.objective,
            x,
            jac=problem.objective_gradient,
            bounds=Bounds(0.0, 1.0),
            constraints={
                "type": "ineq",
                "fun": lambda x: -problem.constraints(x),
                "jac": lambda x: -problem.constraint_gradients(x),
            },
            method="SLSQP",
            callback=problem.record_or_stop,
            options={"ftol": 1e-13, "maxiter": 300},
        )
        return Ending(found.x, bool(found.success), str(found.message))


@optimizer("trust-constr")
class TrustConstr(AbstractLocalOptimizer):
    """SciPy's interior trust-region method."""

    def minimize(self, problem: UnitBoxProblem, x: Vector) -> Ending:
        """Go from x to a minimum, inside of the box all the way."""
        rows = len(problem.constraints(x))
        # A callable, which SciPy's annotations leave out.
        slopes: Any = problem.constraint_gradients
        limits = NonlinearConstraint(
            problem.constraints, np.full(rows, -np.inf), np.zeros(rows), slopes
        )
        with np.errstate(all="ignore"):  # it divides by components that vanish, and copes
            found = scipy_minimize(
                problem.objective,
                x,
                jac=problem.objective_gradient,
                bounds=Bounds(0.0, 1.0, keep_feasible=True),
                constraints=[limits],
                method="trust-constr",
                callback=problem.record_or_stop,
                options={"gtol": 1e-9, "xtol": 1e-12, "barrier_tol": 1e-10, "maxiter": 1000},
            )
        return Ending(found.x, found.status in (1, 2), str(found.message))


@optimizer("ipopt")
class Ipopt(AbstractLocalOptimizer):
    """IPOPT by its binding `ipyopt`, an extra; its second derivatives are of limited memory."""

    def minimize(self, problem: UnitBoxProblem, x: Vector) -> Ending:
        """Go from x to a minimum; the iterations may leave the box by a little."""
        import ipyopt

        n, m = len(x), len(problem.constraints(x))
        dense = np.repeat(np.arange(m), n), np.tile(np.arange(n), m)

        def into(out: Vector, values: np.ndarray) -> None:
            out[()] = values.ravel()

        def watch(_mode: int, _step: int, f: float, violation: float, *_: Any) -> bool:
            return problem.record(f, violation)

        nlp = ipyopt.Problem(
            n,
            np.zeros(n),
            np.ones(n),
            m,
            np.full(m, -2e19),
            np.zeros(m),
            dense,
            (np.array([], int), np.array([], int)),
            problem.objective,
            lambda x, out: into(out, problem.objective_gradient(x)),
            lambda x, out: into(out, problem.constraints(x)),
            lambda x, out: into(out, problem.constraint_gradients(x)),
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
        return Ending(np.clip(found, 0.0, 1.0), status in (0, 1), message)
