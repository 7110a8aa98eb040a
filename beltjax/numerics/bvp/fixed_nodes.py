"""A two-point problem on a fixed number of nodes: solve, judge, move the mesh, solve again.

Everything here runs under `jit` and `vmap`. The derivative is taken at the converged equations,
with the mesh held, and never sees the iterations.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from beltjax.numerics.bvp.collocation import (
    Factor,
    Interval,
    Local,
    Mesh,
    Problem,
    Residual,
    Unknowns,
    remesh,
    residual,
    solve_factored,
)
from beltjax.numerics.bvp.compiled_parts import evaluated_apart, part, repeat
from beltjax.numerics.bvp.error_estimate import Estimate, estimate, finer
from beltjax.numerics.bvp.gauss import gauss
from beltjax.numerics.bvp.mesh import moved_mesh
from beltjax.numerics.bvp.newton import NewtonResult, newton, no_factor

SETTLED = 0.05  # a mesh whose nodes would move by less than this share of an interval stays


class Evidence(NamedTuple):
    """The evidence about a solution that the search collects."""

    mesh: Mesh
    factor: Factor
    estimate: Estimate
    converged: Bool[Array, ""]
    finite: Bool[Array, ""]
    regular: Bool[Array, ""]
    passes: Int[Array, ""]
    sweeps: Int[Array, ""]


class Start(NamedTuple):
    """Where the search begins."""

    mesh: Mesh
    z: Unknowns


def is_solved(evidence: Evidence) -> Bool[Array, ""]:
    """Whether the collocation equations were solved, to whatever accuracy."""
    return evidence.converged & evidence.finite & evidence.regular


class _Sweep(NamedTuple):
    z: Unknowns  # of the last solve, on the last mesh
    mesh: Mesh
    best: tuple[Unknowns, Evidence]
    going: Bool[Array, ""]


class _Onwards(NamedTuple):
    """Where the next solve begins, and whether there is nothing left to move."""

    mesh: Mesh
    guess: Unknowns
    settled: Bool[Array, ""]


def search(
    problem: Problem, start: Start, tol: Float[Array, ""], sweeps: int
) -> tuple[Unknowns, Evidence]:
    """Solution on as many nodes as `start` has, on the mesh that `sweeps` moves find best.

    Carries no derivative: see `with_derivative`.
    """
    problem, start, tol = _held((problem, start, tol))
    interval = problem.interval

    def body(state: _Sweep) -> _Sweep:
        onwards = _onwards(interval, state)
        root = newton(problem, onwards.mesh, onwards.guess, tol=equations_tol, skip=onwards.settled)
        cut, moved = _finer(interval, onwards.mesh, root)
        local = evaluated_apart(problem, cut, moved)
        return _swept(interval, state, onwards, root, cut, moved, local, tol, most)

    most, equations_tol = jnp.asarray(sweeps), _newton_tol(tol)
    state = repeat(lambda state: state.going, body, _first_sweep(start, most))
    return _usable_or_guess(start, *state.best)


@part
def _first_sweep(start: Start, most: Int[Array, ""]) -> _Sweep:
    inf, no, zero = jnp.array(jnp.inf), jnp.array(False), jnp.zeros((), int)
    estimate = Estimate(inf, inf, inf)
    evidence = Evidence(start.mesh, no_factor(start.z), estimate, no, no, no, zero, zero)
    return _Sweep(start.z, start.mesh, (start.z, evidence), most > 0)


@part
def _onwards(interval: Interval, state: _Sweep) -> _Onwards:
    first = state.best[1].sweeps == 0
    proposed = moved_mesh(interval, state.mesh, state.z)
    shift = jnp.max(jnp.abs(proposed - state.mesh)[1:] / jnp.diff(state.mesh))
    settled = (shift < SETTLED) & ~first
    mesh = jnp.where(first | settled, state.mesh, proposed)
    guess = remesh(interval, state.mesh, state.z, mesh, gauss(state.z.K.shape[0]))
    guess = jax.tree.map(lambda a, b: jnp.where(first, a, b), state.z, guess)
    return _Onwards(mesh, guess, settled)


@part
def _finer(interval: Interval, mesh: Mesh, root: NewtonResult) -> tuple[Mesh, Unknowns]:
    return finer(interval, mesh, root.z, root.factor.mean)


@part
def _swept(
    interval: Interval,
    state: _Sweep,
    onwards: _Onwards,
    root: NewtonResult,
    cut: Mesh,
    moved: Unknowns,
    local: Local,
    tol: Float[Array, ""],
    most: Int[Array, ""],
) -> _Sweep:
    """The state after a solve, with what the equations on the finer mesh say of it."""
    z0, best = state.best
    first, settled = best.sweeps == 0, onwards.settled
    known = estimate(interval, root.z, cut, moved, local)
    found = Evidence(
        onwards.mesh,
        root.factor,
        known,
        root.converged,
        root.finite,
        root.regular,
        root.passes,
        best.sweeps,
    )
    better = ~settled & (first | (root.converged & (known.error < best.estimate.error)))
    new_z, new = jax.tree.map(lambda a, b: jnp.where(better, a, b), (root.z, found), (z0, best))
    counted = new._replace(passes=best.passes + root.passes, sweeps=best.sweeps + 1)
    done = settled | ~root.converged | (known.error <= tol)
    return _Sweep(root.z, onwards.mesh, (new_z, counted), ~done & (counted.sweeps < most))


@part
def _usable_or_guess(start: Start, z: Unknowns, evidence: Evidence) -> tuple[Unknowns, Evidence]:
    good = is_solved(evidence)
    # A lane that failed holds its guess, and nothing that could turn a zero cotangent into nan.
    harmless = Start(start.mesh, jax.tree.map(jnp.nan_to_num, start.z))
    z = jax.tree.map(lambda a, b: jnp.where(good, a, b), z, harmless.z)
    mesh = jnp.where(good, evidence.mesh, harmless.mesh)
    return z, evidence._replace(mesh=mesh)


def _held(tree: Any) -> Any:
    arrays, rest = eqx.partition(tree, eqx.is_array)
    return eqx.combine(jax.lax.stop_gradient(arrays), rest)


@part
def _newton_tol(tol: Array) -> Array:
    # Two orders below the tolerance, and the last step is taken whole: the equations are
    # solved far better than the mesh resolves the solution.
    return jnp.clip(1e-3 * tol, 1e-12, 1e-8)


@eqx.filter_custom_jvp
def with_derivative(problem: Problem, z: Unknowns, evidence: Evidence) -> Unknowns:
    """`z`, a solution found by any means, as a differentiable function of `problem`."""
    return z


@with_derivative.def_jvp
def _with_derivative_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
    problem, z, evidence = primals
    t_problem, _, _ = tangents
    # Through itself, so that the solution in the equations below has derivatives in its turn.
    z = with_derivative(problem, z, evidence)
    good = is_solved(evidence)
    moving, held = _split(problem, t_problem, good)
    # In a lane that failed no derivative passes, in either direction: not even 0 times nan.
    t_problem = jax.tree.map(lambda t: jnp.where(good, t, 0.0), t_problem)

    def left(moving: Any, z: Unknowns) -> Residual:
        return residual(eqx.combine(moving, held), evidence.mesh, z)

    def linear(d: Unknowns) -> Residual:
        return jax.jvp(lambda z: left(moving, z), (z,), (d,))[1]

    _, change = jax.jvp(lambda m: left(m, z), (moving,), (t_problem,))
    factor = jax.tree.map(lambda a: jnp.where(good, a, 0.0), evidence.factor)
    dz = _implicit_step(linear, factor, jax.tree.map(jnp.negative, change), z)
    return z, jax.tree.map(lambda d: jnp.where(good, d, 0.0), dz)


def _split(problem: Problem, t_problem: Any, good: Bool[Array, ""]) -> tuple[Any, Any]:
    moves = jax.tree.map(lambda t: t is not None, t_problem, is_leaf=lambda t: t is None)
    moving, held = eqx.partition(problem, moves)
    barred = jax.tree.map(lambda a: jnp.where(good, a, jax.lax.stop_gradient(a)), moving)
    return barred, held


def _implicit_step(
    linear: Callable[[Unknowns], Residual], factor: Factor, right: Residual, z: Unknowns
) -> Unknowns:
    """J^-1 right with the factors at hand, differentiable through J alone."""
    flat_right, as_right = ravel_pytree(right)
    _, as_unknowns = ravel_pytree(z)

    def ravel(tree: Any) -> Array:
        return ravel_pytree(tree)[0]

    def quick(b: Array) -> Array:
        return ravel(solve_factored(factor, as_right(b)))

    def refined(solve: Callable[[Array], Array]) -> Callable:
        # The factors belong to the iterate before the last; one correction makes up for that.
        def both(matvec: Callable[[Array], Array], b: Array) -> Array:
            x = solve(b)
            return x + solve(b - matvec(x))

        return both

    def quick_transposed(c: Array) -> Array:
        return jax.linear_transpose(quick, flat_right)(c)[0]

    x = jax.lax.custom_linear_solve(
        lambda d: ravel(linear(as_unknowns(d))),
        flat_right,
        refined(quick),
        refined(quick_transposed),
    )
    return as_unknowns(x)
