"""Two-point boundary value problems by collocation: jits, batches, adapts, differentiates."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from beltjax.compiling.quick import usual_promotion
from beltjax.numerics.bvp.arguments import (
    as_double,
    check_sizes,
    checked_args,
    checked_guess,
    checked_interval,
    checked_parameters,
    checked_problem,
    first_start,
)
from beltjax.numerics.bvp.collocation import Interval, Problem, Unknowns, interpolate
from beltjax.numerics.bvp.compiled_parts import is_traced, kept_for_few, part, within_transformation
from beltjax.numerics.bvp.error_estimate import ROUNDING, SINGULAR
from beltjax.numerics.bvp.fixed_nodes import (
    Evidence,
    Start,
    is_solved,
    search,
    with_derivative,
)
from beltjax.numerics.bvp.growing_interval import start_from_shorter
from beltjax.results import RESULTS, first_failure, raise_unless_successful

FIRST_NODES = 32  # where growing begins
RETRY = 4  # times the nodes, once, where no solution was reached
FIXED_NODES = 64  # under a transformation, where the number cannot depend on the numbers


class BVPSolution(eqx.Module):
    """A solution and how far it can be trusted.

    Calling it evaluates the collocation polynomial itself: `solution(x)` is y [n] for one x
    and [n, m] for x [m], differentiable with respect to x and to whatever the problem depended on.
    """

    x: Float[Array, " nodes"]
    y: Float[Array, "n nodes"]
    parameters: Float[Array, " k"]
    error: Float[Array, ""]  # estimated, relative to 1 + max |y_j| (1 + |p_j|), nodes or not
    defect: Float[Array, ""]  # largest |u' - f(x, u)|/(1 + |u'|) found
    condition: Float[Array, ""]  # response found to jumps of y and changes of bc of their sizes
    result: RESULTS
    stats: dict[str, Array]  # newton_steps, mesh_sweeps
    interval: tuple[Float[Array, ""], Float[Array, ""]]
    mesh: Float[Array, " nodes"]
    slopes: Float[Array, "stages n nodes-1"]  # y' at the collocation points

    @property
    def nodes(self) -> int:
        """How many nodes the mesh has."""
        return self.mesh.shape[-1]

    def __call__(self, x: ArrayLike) -> Array:
        """y(x): [n] for a number, [n, m] for x [m]."""
        x = as_double(x)
        z = Unknowns(self.y, self.slopes, self.parameters)
        y = _evaluated_at(Interval(*self.interval), self.mesh, z, jnp.atleast_1d(x))
        return y[:, 0] if x.ndim == 0 else y


@part
def _evaluated_at(interval: Interval, mesh: Array, z: Unknowns, x: Array) -> Array:
    return interpolate(interval, mesh, z, (x - interval.a) / interval.length)[0]


@usual_promotion
def solve_bvp(
    rhs: Callable,
    bc: Callable,
    interval: tuple,
    guess: Any,
    parameters: Any = None,
    args: Any = None,
    singular_term: Any = None,
    *,
    tol: float = 1e-6,
    max_nodes: int = 2048,
    nodes: int | None = None,
    stages: int = 4,
    sweeps: int = 8,
    throw: bool = True,
) -> BVPSolution:
    """Solution of y' = rhs(x, y, p, args) + S y/(x - a) with bc(y(a), y(b), p, args) = 0.

    `rhs` takes scalar x, y [n], p [k] and returns [n]; `bc` returns [n + k], and its conditions
    need not separate. `guess` is (x [m], y [n, m]) or a callable x -> y [n]; where its points
    crowd, so do the first nodes. `parameters` is the guess for p. `singular_term` is S [n, n].

    Gauss collocation (`stages` points an interval) on a mesh that moves to where the solution
    needs it, `sweeps` times at most. Called with concrete numbers, the number of nodes doubles
    from 32 up to `max_nodes` until the *estimated error*, relative to 1 + max |y_j|, is below
    `tol`, and a guess from which Newton's method fails is tried on a growing interval; `nodes=64`
    holds it fixed, as it is (at 64 unless given) under any transformation. Numbers in `args` become
    arrays: new ones compile nothing, where `rhs` and `bc` are the same functions.
    With `throw=False` read `.result`: `mesh_exhausted` (best solution returned), `newton_failed`,
    `singular_system`, `equations_nonfinite`; the last three hold the guess, and zero derivatives.

    Derivatives with respect to `args`, the interval, S and whatever `rhs` and `bc` close over
    come from the collocation equations with the mesh held, forward and reverse and nested.

    Bratu's problem, y'' = -e^y with y(0) = y(1) = 0, and how its peak moves with a factor:

        >>> def rhs(x, y, p, factor):
        ...     return jnp.stack([y[1], -factor * jnp.exp(y[0])])
        >>> def bc(ya, yb, p, factor):
        ...     return jnp.stack([ya[0], yb[0]])
        >>> def peak(factor):
        ...     flat = (jnp.array([0.0, 1.0]), jnp.zeros((2, 2)))
        ...     return bj.solve_bvp(rhs, bc, (0.0, 1.0), flat, args=factor)(0.5)[0]
        >>> float(peak(1.0)), float(jax.grad(peak)(1.0))  # 0.140539, 0.159203

    Ascher, Mattheij and Russell (1995), chapters 5, 8 and 9; Wright (1992) for the elimination.
    """
    check_sizes(tol, nodes, max_nodes, stages)
    interval = checked_interval(interval)
    p = checked_parameters(parameters)
    x, y = checked_guess(guess, interval, points=max(nodes or 0, FIXED_NODES) + 1)
    n, k = y.shape[0], p.shape[0]
    args = checked_args(args)
    checked = checked_problem(rhs, bc, interval, args, singular_term, n, k)
    wanted = as_double(tol)
    options = {"stages": stages, "sweeps": sweeps}

    if within_transformation(checked, x, y, p, wanted):
        fixed = min(FIXED_NODES, max_nodes) if nodes is None else nodes
        solution = _solve_compiled(
            rhs, bc, interval, args, singular_term, wanted, x, y, p, nodes=fixed, **options
        )
    else:
        # As given, not as checked: a function that comes again is known by its identity.
        problem = Problem(rhs, bc, interval, args, checked.singular)
        most = max_nodes if nodes is None else nodes
        solution = _adapted(problem, wanted, (x, y, p), nodes or FIRST_NODES, most, options)
    return raise_unless_successful(solution, solution.result, throw)


def _adapted(
    problem: Problem,
    tol: Array,
    guess: tuple[Array, Array, Array],
    nodes: int,
    most: int,
    options: dict[str, int],
) -> BVPSolution:
    """The solution on 1, 2, 4 ... times `nodes`, until its estimated error will do."""
    solution = best = _reached(problem, tol, guess, min(nodes, most), options)
    retried = False
    while solution.result != RESULTS.successful:
        onwards = solution.result == RESULTS.mesh_exhausted
        nodes = 2 * solution.nodes if onwards else min(RETRY * solution.nodes, most)
        if not solution.nodes < nodes <= most or solution.result == RESULTS.equations_nonfinite:
            break
        if onwards:
            begin = (solution.mesh, solution.y, solution.parameters)
            solution = _solve(problem, tol, *begin, nodes=nodes, **options)
        elif retried:
            break
        else:
            solution, retried = _reached(problem, tol, guess, nodes, options), True
        if bool(solution.error < best.error) or not bool(jnp.isfinite(best.error)):
            best = solution
    return best


def _reached(
    problem: Problem,
    tol: Array,
    guess: tuple[Array, Array, Array],
    nodes: int,
    options: dict[str, int],
) -> BVPSolution:
    """The solution from the guess or, where that leads nowhere, by a growing interval."""
    solution = _solve(problem, tol, *guess, nodes=nodes, **options)
    if solution.result == RESULTS.equations_nonfinite or bool(jnp.isfinite(solution.error)):
        return solution
    start = start_from_shorter(problem, *guess, nodes=nodes, stages=options["stages"])
    if start is None:
        return solution
    grown = _judged(problem, start, tol, options["sweeps"])
    return grown if bool(jnp.isfinite(grown.error)) else solution


def _solve(
    problem: Problem,
    tol: Array,
    x: Array,
    y: Array,
    p: Array,
    *,
    nodes: int,
    stages: int,
    sweeps: int,
) -> BVPSolution:
    start = first_start(problem.interval, x, y, p, nodes, stages)
    return _judged(problem, start, tol, sweeps)


def _judged(problem: Problem, start: Start, tol: Array, sweeps: int) -> BVPSolution:
    z, evidence = search(problem, start, tol, sweeps)
    z = with_derivative(problem, z, evidence) if is_traced(z) else z
    return as_solution(problem.interval, z, evidence, tol)


@kept_for_few
def _solve_compiled(
    rhs: Callable,
    bc: Callable,
    interval: Interval,
    args: Any,
    S: Array | None,
    tol: Array,
    x: Array,
    y: Array,
    p: Array,
    **options: int,
) -> BVPSolution:
    problem = checked_problem(rhs, bc, interval, args, S, y.shape[0], p.shape[0])
    return _solve(problem, tol, x, y, p, **options)


@part
def as_solution(
    interval: Interval, z: Unknowns, evidence: Evidence, tol: Float[Array, ""]
) -> BVPSolution:
    """The solution that the search found, with the verdict on it."""
    good = is_solved(evidence)
    known = evidence.estimate
    # Nothing better can be had in double precision, on whatever mesh.
    hopeless = (ROUNDING * known.condition > tol) | (known.condition > SINGULAR)
    singular = ~evidence.regular | hopeless
    result = first_failure(
        (~evidence.finite, RESULTS.equations_nonfinite),
        (singular, RESULTS.singular_system),
        (~evidence.converged, RESULTS.newton_failed),
        (known.error > tol, RESULTS.mesh_exhausted),
    )
    return BVPSolution(
        x=interval.a + interval.length * evidence.mesh,
        y=z.y,
        parameters=z.p,
        error=jnp.where(good, known.error, jnp.inf),
        defect=jnp.where(good, known.defect, jnp.inf),
        condition=known.condition,
        result=result,
        stats={"newton_steps": evidence.passes, "mesh_sweeps": evidence.sweeps},
        interval=(interval.a, interval.b),
        mesh=evidence.mesh,
        slopes=z.K,
    )
