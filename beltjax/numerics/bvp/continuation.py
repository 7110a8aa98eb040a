"""Following a solution: along a path of arguments, or along a branch that may turn back."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

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
from beltjax.numerics.bvp.collocation import Interval, Problem, Residual, Unknowns, solve_factored
from beltjax.numerics.bvp.compiled_parts import kept_for_few, part, within_transformation
from beltjax.numerics.bvp.fixed_nodes import (
    Evidence,
    Start,
    is_solved,
    search,
    with_derivative,
)
from beltjax.numerics.bvp.solve import FIXED_NODES, BVPSolution, as_solution
from beltjax.results import raise_unless_successful

ON_THE_WAY = 1e-3  # error allowed to the solutions that only lead to the last


@usual_promotion
def continue_bvp(
    rhs: Callable,
    bc: Callable,
    interval: tuple,
    guess: Any,
    parameters: Any = None,
    path: Any = None,
    singular_term: Any = None,
    *,
    tol: float = 1e-6,
    nodes: int = FIXED_NODES,
    stages: int = 4,
    sweeps: int = 8,
    throw: bool = True,
) -> BVPSolution:
    """The solution for the last of a `path` of args, each solved from the one before it.

    As `solve_bvp` at a fixed number of nodes, with `path` in place of `args`: the same pytree,
    its leaves stacked along a leading axis from an easy problem to the one that is wanted.
    Solution and mesh are handed on; an instance that fails hands on what it was given. Only
    the last is judged and differentiated.
    """
    check_sizes(tol, nodes, nodes, stages)
    interval = checked_interval(interval)
    p = checked_parameters(parameters)
    x, y = checked_guess(guess, interval, points=nodes + 1)
    lengths = {jnp.shape(leaf)[:1] for leaf in jax.tree.leaves(path)}
    if len(lengths) != 1 or () in lengths:
        raise ValueError(f"path: its leaves must share one leading axis; found {sorted(lengths)}.")
    path = checked_args(jax.tree.map(jnp.asarray, path))
    first = jax.tree.map(lambda leaf: leaf[0], path)
    checked = checked_problem(rhs, bc, interval, first, singular_term, y.shape[0], p.shape[0])
    given = (interval, path, checked.singular, as_double(tol), x, y, p)
    run = _continue_compiled if within_transformation(checked, given) else _continue
    solution = run(rhs, bc, *given, nodes=nodes, stages=stages, sweeps=sweeps)
    return raise_unless_successful(solution, solution.result, throw)


def _continue(
    rhs: Callable,
    bc: Callable,
    interval: Interval,
    path: Any,
    S: Array | None,
    tol: Array,
    x: Array,
    y: Array,
    p: Array,
    *,
    nodes: int,
    stages: int,
    sweeps: int,
) -> BVPSolution:
    rungs = jax.device_get(path)

    def solved(k: int, start: Start, tol: Array) -> tuple[Unknowns, Evidence]:
        args = checked_args(jax.tree.map(lambda leaf: leaf[k], rungs))
        return search(Problem(rhs, bc, interval, args, S), start, tol, sweeps)

    start = first_start(interval, x, y, p, nodes, stages)
    for k in range(len(jax.tree.leaves(rungs)[0]) - 1):
        z, evidence = solved(k, start, _on_the_way(tol))
        start = Start(evidence.mesh, z)
    return as_solution(interval, *solved(-1, start, tol), tol)


@part
def _on_the_way(tol: Array) -> Array:
    return jnp.maximum(tol, ON_THE_WAY)


@kept_for_few
def _continue_compiled(
    rhs: Callable,
    bc: Callable,
    interval: Interval,
    path: Any,
    S: Array | None,
    tol: Array,
    x: Array,
    y: Array,
    p: Array,
    *,
    nodes: int,
    stages: int,
    sweeps: int,
) -> BVPSolution:
    last = jax.tree.map(lambda leaf: leaf[-1], path)
    problem = checked_problem(rhs, bc, interval, last, S, y.shape[0], p.shape[0])
    count = jax.tree.leaves(path)[0].shape[0]
    tols = _on_the_way(tol).repeat(count).at[-1].set(tol)

    def rung(carried: Any, given: Any) -> Any:
        start, _ = carried
        args, tol = given
        here = Problem(problem.rhs, problem.bc, interval, args, problem.singular)
        z, evidence = search(here, start, tol, sweeps)
        # A failed search returns its start, so this hands on the last solution there was.
        onwards = Start(evidence.mesh, z)
        return (onwards, evidence), None

    begin = first_start(interval, x, y, p, nodes, stages)
    shapes = jax.eval_shape(lambda: search(problem, begin, tol, sweeps)[1])
    nothing = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)
    path, begin = jax.lax.stop_gradient((path, begin))
    (found, evidence), _ = jax.lax.scan(rung, (begin, nothing), (path, tols))
    return as_solution(interval, with_derivative(problem, found.z, evidence), evidence, tol)


class Branch(eqx.Module):
    """Points along a branch of solutions, in order; every array has a leading axis of points."""

    solutions: BVPSolution
    parameters: Float[Array, "points k"]
    slope: Float[Array, " points"]  # d(last parameter)/d(arclength)
    arclength: Float[Array, " points"]
    solved: Bool[Array, " points"]  # a point that could not be reached repeats the one before

    @property
    def folds(self) -> Float[Array, " points-1"]:
        """The last parameter where it turns back between two points, else nan.

        From the cubic through both points with their slopes: its error falls as the fourth
        power of the step.
        """
        s, value, slope = self.arclength, self.parameters[:, -1], self.slope
        h, (v0, v1), (d0, d1) = jnp.diff(s), _pairs(value), _pairs(slope)
        turned = (d0 * d1 < 0) & (h > 0)
        h = jnp.where(turned, h, 1.0)
        # Derivative of the Hermite cubic at t: c0 + c1 t + c2 t^2, with its root in (0, 1).
        jump = (v1 - v0) / h
        c0, c1, c2 = d0, 6 * jump - 4 * d0 - 2 * d1, 3 * (d0 + d1) - 6 * jump
        root = jnp.sqrt(jnp.maximum(c1**2 - 4 * c0 * c2, 0.0))
        q = -0.5 * (c1 + jnp.where(c1 < 0, -root, root))
        t = c0 / jnp.where(q == 0, 1.0, q)
        t = jnp.where((t >= 0) & (t <= 1), t, q / jnp.where(c2 == 0, 1.0, c2))
        at = v0 + h * (c0 * t + c1 * t**2 / 2 + c2 * t**3 / 3)
        return jnp.where(turned, at, jnp.nan)


def _pairs(values: Array) -> tuple[Array, Array]:
    return values[:-1], values[1:]


class _Along(NamedTuple):
    """The numbers of the arclength condition, which join the args."""

    args: Any
    direction: Float[Array, " 2n+k"]
    origin: Float[Array, " 2n+k"]
    distance: Float[Array, ""]


class _Point(NamedTuple):
    start: Start
    tangent: Unknowns
    origin: Float[Array, " 2n+k"]
    direction: Float[Array, " 2n+k"]
    step: Float[Array, ""]  # signed
    arclength: Float[Array, ""]
    first: Bool[Array, ""]


@usual_promotion
def follow_branch(
    rhs: Callable,
    bc: Callable,
    interval: tuple,
    guess: Any,
    parameters: Any,
    args: Any = None,
    *,
    step: float,
    points: int,
    tol: float = 1e-6,
    nodes: int = FIXED_NODES,
    stages: int = 4,
    sweeps: int = 3,
) -> Branch:
    """Solutions as the last parameter varies, through folds, by pseudo-arclength continuation.

    `parameters` [k] ends with the one to vary, and `bc` returns n + k - 1 conditions: the
    missing one is that each solution lies `step` from the last along the branch's tangent
    (Keller, 1977), measured in y(a), y(b) and p. Initial values determine a solution, so no
    branch is stationary in these. Starts at the given value of the last parameter, in the
    direction of `step`'s sign; a step that fails is halved, one that succeeds grows back.
    """
    check_sizes(tol, nodes, nodes, stages)
    interval = checked_interval(interval)
    args = checked_args(args)
    p = checked_parameters(parameters)
    if not p.shape[0]:
        raise ValueError("parameters must hold the parameter to vary, last; found shape (0,).")
    x, y = checked_guess(guess, interval, points=nodes + 1)
    checked_problem(rhs, _with_one_more(bc), interval, args, None, y.shape[0], p.shape[0])
    given = (rhs, bc, interval, args, as_double(tol), x, y, p, as_double(step))
    return _follow(*given, points=points, nodes=nodes, stages=stages, sweeps=sweeps)


def _with_one_more(bc: Callable) -> Callable:
    return lambda ya, yb, p, args: jnp.concatenate([bc(ya, yb, p, args), p[-1:]])


@kept_for_few
def _follow(
    rhs: Callable,
    bc: Callable,
    interval: Interval,
    args: Any,
    tol: Array,
    x: Array,
    y: Array,
    p: Array,
    step: Array,
    *,
    points: int,
    nodes: int,
    stages: int,
    sweeps: int,
) -> Any:
    n, k = y.shape[0], p.shape[0]

    def closed(ya: Array, yb: Array, p: Array, along: _Along) -> Array:
        ends = jnp.concatenate([ya, yb, p])
        travelled = along.direction @ (ends - along.origin)
        return jnp.concatenate([bc(ya, yb, p, along.args), (travelled - along.distance)[None]])

    begin = first_start(interval, x, y, p, nodes, stages)
    upwards = jnp.zeros(2 * n + k).at[-1].set(1.0)
    first = _Point(
        begin,
        jax.tree.map(jnp.zeros_like, begin.z),
        _end_values(begin.z),
        upwards,
        step,
        jnp.zeros(()),
        jnp.array(True),
    )
    along = _Along(args, first.direction, first.origin, jnp.zeros(()))
    problem = checked_problem(
        lambda x, y, p, along: rhs(x, y, p, along.args), closed, interval, along, None, n, k
    )

    def advance(point: _Point, _: None) -> Any:
        distance = jnp.where(point.first, 0.0, point.step)
        along = _Along(args, point.direction, point.origin, distance)
        here = Problem(problem.rhs, problem.bc, interval, along, None)
        ahead = jax.tree.map(lambda a, d: a + distance * d, point.start.z, point.tangent)
        z, evidence = search(here, Start(point.start.mesh, ahead), tol, sweeps)
        good = is_solved(evidence)
        reached = _reached(point, z, evidence, distance, step)
        kept = point._replace(step=0.5 * point.step)
        point = jax.tree.map(lambda a, b: jnp.where(good, a, b), reached, kept)
        held = jax.tree.map(lambda a, b: jnp.where(good, a, b), z, point.start.z)
        solution = as_solution(interval, held, evidence, tol)
        return point, (solution, point.direction[-1], point.arclength, good)

    _, (solutions, slope, arclength, solved) = jax.lax.scan(advance, first, None, length=points)
    return Branch(solutions, solutions.parameters, slope, arclength, solved)


def _reached(
    point: _Point, z: Unknowns, evidence: Evidence, distance: Array, step: Array
) -> _Point:
    """The point just solved for, with the branch's tangent there."""
    right = Residual(*(jnp.zeros_like(x) for x in (z.K, z.K[0], _conditions(z))))
    right = right._replace(conditions=right.conditions.at[-1].set(1.0))
    tangent = solve_factored(evidence.factor, right)
    size = jnp.linalg.norm(_end_values(tangent))
    tangent = jax.tree.map(lambda d: d / jnp.where(size > 0, size, 1.0), tangent)
    longer = jnp.sign(step) * jnp.minimum(jnp.abs(step), 1.4 * jnp.abs(point.step))
    return _Point(
        Start(evidence.mesh, z),
        tangent,
        _end_values(z),
        _end_values(tangent),
        longer,
        point.arclength + jnp.abs(distance),
        jnp.array(False),
    )


def _conditions(z: Unknowns) -> Array:
    return jnp.concatenate([z.y[:, 0], z.p])


def _end_values(z: Unknowns) -> Float[Array, " 2n+k"]:
    return jnp.concatenate([z.y[:, 0], z.y[:, -1], z.p])
