"""Arcs of a belt on its pulleys by collocation, solved together with the drive that they are in.

An arc is a two-point problem on [0, 1] whose last four conditions are linear in what the drive
prescribes, P_in, P_out, turn and g, each with the factor -1. Its response to them is known with its
linearization, so that a step of Newton's method eliminates the arcs and solves for the rest.
docs/theory/grooves.md, (W10).
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.numerics.bvp.collocation import (
    Interval,
    Mesh,
    Problem,
    Residual,
    Unknowns,
    evaluated,
    factored,
    residual,
    solve_factored,
)
from beltjax.numerics.roots import solve_dense

Scalar = Float[Array, ""]
# The two-point problem of one arc, from the pulley and what the drive prescribes.
ProblemOf = Callable[[Any, "ArcEnds"], Problem]

PRESCRIBED = 4  # the conditions in which the drive enters


class ArcEnds(NamedTuple):
    """What spans and belt prescribe at the ends of an arc."""

    P_in: Scalar
    P_out: Scalar
    turn: Scalar
    g: Scalar


class OnRim(NamedTuple):
    """A string on a smooth pulley, which it meets without an angle."""

    om: Scalar  # speed of the pulley's circle over V_ref
    unstretched: Scalar  # length of the belt in contact
    slip: Scalar  # angle over which the belt slips


class Arc(NamedTuple):
    """The belt along one pulley, on its mesh."""

    mesh: Mesh
    z: Unknowns


class ArcStep(NamedTuple):
    """What a Newton step takes off for ends held as they are, and the response to each of them."""

    base: Unknowns
    response: Unknowns  # leading axis: P_in, P_out, turn, g
    residual: Scalar


class Move(NamedTuple):
    """A step of Newton's method of the drive and its arcs."""

    x: Float[Array, " unknowns"]
    z: Unknowns  # each leaf [n]
    residual: Scalar  # of the drive's equations


def unit_interval() -> Interval:
    """[0, 1], on which every arc lies."""
    return Interval(jnp.zeros(()), jnp.ones(()))


def on_rim(ends: ArcEnds, R: Array, mu: Array, EA: Array) -> OnRim:
    """The belt adheres where it comes in, and slips at the end.

    The sign of the change of tension stands in place of absolute values, so that derivatives
    exist without torque.
    """
    low, high, turn, g = ends
    first = (EA + low) / (EA - g)
    side = jnp.where(high > low, 1.0, jnp.where(high < low, -1.0, 0.0)) / mu
    ratio, creep = jnp.log(high / low), jnp.log((EA + high) / (EA + low))
    slipping = side * ((EA - g) / EA * (ratio - creep) - ratio / first)
    return OnRim(first, R * (turn / first + slipping), side * ratio)


def arc_step(problem: Problem, arc: Arc) -> ArcStep:
    """One linearization of the arc."""
    left, factor = factored(problem.interval, arc.mesh, arc.z, evaluated(problem, arc.mesh, arc.z))
    nothing = jax.tree.map(jnp.zeros_like, left)
    rows = jnp.eye(left.conditions.size)[-PRESCRIBED:]
    moved = jax.vmap(lambda row: nothing._replace(conditions=row))(rows)
    right = jax.tree.map(lambda a, b: jnp.concatenate([a, b[None]]), moved, left)
    solved = jax.vmap(lambda one: solve_factored(factor, one))(right)
    size = jnp.max(jnp.stack([jnp.max(jnp.abs(part)) for part in left]))
    response, base = (jax.tree.map(lambda x, k=k: x[k], solved) for k in (slice(4), 4))
    return ArcStep(base, response, size)


def joint_step(
    x: Float[Array, " unknowns"],
    arcs: Arc,
    steps: ArcStep,
    ends_of: Callable[[Array], ArcEnds],
    equations: Callable[[Array, Unknowns], Array],
) -> Move:
    """A step for unknowns x, whose `equations` depend on the arcs' unknowns, too.

    `steps` are those of the arcs, each leaf [n], and `ends_of` what x prescribes to them.
    """

    def following(row: Array) -> Unknowns:
        """Change of the arcs while x changes by `row`."""
        _, ends = jax.jvp(ends_of, (x,), (row,))
        stacked = jnp.stack(ends)
        return jax.tree.map(lambda r: jnp.einsum("kn,nk...->n...", stacked, r), steps.response)

    def column(row: Array) -> Array:
        return jax.jvp(equations, (x, arcs.z), (row, following(row)))[1]

    back = jax.tree.map(jnp.negative, steps.base)
    value, shift = jax.jvp(lambda z: equations(x, z), (arcs.z,), (back,))
    slopes = jax.vmap(column, out_axes=-1)(jnp.eye(len(x)))
    move = -solve_dense(slopes, value + shift)
    dz = jax.tree.map(jnp.subtract, following(move), steps.base)
    return Move(move, dz, jnp.max(jnp.abs(value)))


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def solved_arc(problem_of: ProblemOf, numbers: tuple[Any, ArcEnds], arc: Arc) -> Unknowns:
    """The unknowns of a converged arc, as functions of pulley and ends on a mesh that is held.

    The slopes by each of the numbers are taken once, from the equations; a second derivative is
    not that of the equations.
    """
    return arc.z


@solved_arc.defjvp
def _solved_arc_jvp(
    problem_of: ProblemOf, primals: tuple[Any, ...], tangents: tuple[Any, ...]
) -> tuple[Any, Any]:
    (numbers, arc), (moved, _) = primals, tangents
    flat, structure = jax.tree.flatten(numbers)
    values = jnp.stack(flat)

    def left(values: Array) -> Residual:
        of, ends = jax.tree.unflatten(structure, list(values))
        return residual(problem_of(of, ends), arc.mesh, arc.z)

    problem = problem_of(*numbers)
    _, factor = factored(problem.interval, arc.mesh, arc.z, evaluated(problem, arc.mesh, arc.z))

    def response(row: Array) -> Unknowns:
        _, change = jax.jvp(left, (values,), (row,))
        return solve_factored(factor, jax.tree.map(jnp.negative, change))

    by_each = jax.vmap(response)(jnp.eye(len(flat)))
    by = jnp.stack([jnp.asarray(x) for x in jax.tree.leaves(moved)])
    return arc.z, jax.tree.map(lambda x: jnp.tensordot(by, x, 1), by_each)
