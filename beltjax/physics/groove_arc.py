"""The arc of a belt in one groove by collocation: equations, start, mesh, and what it passes on.

The arc lies on [0, 1]; unknowns are y = (xi/0.01, chi, P) along it and p = (span, om, g), in the
letters of `physics.groove`. docs/theory/grooves.md, (W6), (W7) and (W10).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.numerics.bvp.collocation import (
    Mesh,
    Problem,
    Unknowns,
    evaluated,
    interval_lengths,
    remesh,
    residual,
    stage_values,
)
from beltjax.numerics.bvp.condensed import step_and_responses
from beltjax.numerics.bvp.gauss import gauss
from beltjax.numerics.bvp.mesh import equidistribute
from beltjax.physics.groove import Flanks, Sliding, sliding, slopes
from beltjax.physics.inclined_arcs import PRESCRIBED, Arc, ArcEnds, ArcStep, unit_interval

Scalar = Float[Array, ""]
STAGES = 3
DEEP = 0.01  # unit of xi, so that all unknowns are of order 0.1 to 1
FLOOR = 0.15  # share of the nodes that is spread evenly


class Passed(NamedTuple):
    """What the rest of a drive needs to know of an arc."""

    chi_in: Scalar
    chi_out: Scalar
    om: Scalar
    unstretched: Scalar  # length of the belt in contact


class Integrals(NamedTuple):
    """Integrals along an arc."""

    length: Scalar  # of the belt in contact
    unstretched: Scalar
    loss: Scalar  # power of sliding over V_ref
    moment: Scalar  # of the friction, taken from the belt


def arc_problem(of: Flanks, ends: ArcEnds) -> Problem:
    """The two-point problem of one arc."""
    unit = unit_interval()
    return Problem(_along, _conditions, unit, (of, ends), None)


def _along(_: Scalar, y: Array, p: Array, args: tuple[Flanks, ArcEnds]) -> Array:
    deep, chi, P = slopes(DEEP * y[0], y[1], y[2], p[1], p[2], args[0])
    return p[0] * jnp.stack([deep / DEEP, chi, P])


def _conditions(first: Array, last: Array, p: Array, args: tuple[Flanks, ArcEnds]) -> Array:
    ends = args[1]
    return jnp.stack(
        [
            first[0],
            last[0],
            first[2] - ends.P_in,
            last[2] - ends.P_out,
            p[0] - ends.turn - last[1] + first[1],
            p[2] - ends.g,
        ]
    )


def seating_stiffness(of: Flanks) -> Scalar:
    """Radial stiffness of a belt that is pressed in against limiting friction (W4)."""
    return 2 * of.K * jnp.tan(of.beta + jnp.arctan(of.mu))


def first_arc(of: Flanks, ends: ArcEnds, elements: int) -> Arc:
    """A start: the belt adheres but for layers at both ends, with the tension of a flat belt."""
    stiffness = seating_stiffness(of) * of.R**2
    rate = jnp.sqrt(stiffness / ends.P_in)

    def shape(s: Scalar) -> Array:
        phi, left = s * ends.turn, (1 - s) * ends.turn
        P = ends.P_in * (ends.P_out / ends.P_in) ** s
        start, end = -jnp.expm1(-rate * phi), -jnp.expm1(-rate * left)
        resting = P / stiffness
        chi = -resting * rate * (jnp.exp(-rate * phi) * end - start * jnp.exp(-rate * left))
        return jnp.stack([resting * start * end / DEEP, chi, P])

    even = jnp.linspace(0.0, 1.0, elements + 1)
    mesh = 0.5 * even + 0.25 * (1 - jnp.cos(jnp.pi * even))
    fractions = mesh[:-1] + gauss(STAGES).points[:, None] * jnp.diff(mesh)
    K = jax.vmap(jax.vmap(jax.jacfwd(shape), out_axes=1))(fractions)
    speed = (of.EA + ends.P_in) / (of.EA - ends.g) * (1 + ends.P_in / stiffness)
    p = jnp.stack([ends.turn, speed, ends.g])
    return Arc(mesh, Unknowns(jax.vmap(shape, out_axes=1)(mesh), K, p))


def states(y: Float[Array, "3 *at"], p: Float[Array, "3"], of: Flanks) -> Sliding:
    """Sliding and forces where the unknowns have these values."""
    return sliding(DEEP * y[0], y[1], y[2], p[1], p[2], of)


def moved_arc(arc: Arc, of: Flanks) -> Arc:
    """The same arc on a mesh that follows its layers and the turning of the friction (W10)."""
    y, at = arc.z.y, states(arc.z.y, arc.z.p, of)

    def steps(value: Array) -> Array:
        return jnp.abs(jnp.diff(value))

    parts = sum(steps(row) / jnp.max(jnp.abs(row)) for row in y)
    turning = steps(at.v_g / at.w) + steps(at.v_t / at.w)
    parts = parts + 3 * turning + 0.3 * steps(jnp.log(at.w))
    widths = jnp.diff(arc.mesh)
    density = parts / widths + FLOOR * jnp.sum(parts)
    mesh = equidistribute(arc.mesh, density)
    unit = unit_interval()
    return Arc(mesh, remesh(unit, arc.mesh, arc.z, mesh, gauss(STAGES)))


def groove_step(arc: Arc, of: Flanks, ends: ArcEnds) -> ArcStep:
    """One linearization of the arc."""
    problem = arc_problem(of, ends)
    left = residual(problem, arc.mesh, arc.z)
    local = evaluated(problem, arc.mesh, arc.z)
    # The ends enter the last four conditions, each with the factor -1.
    base, response = step_and_responses(
        problem.interval, arc.mesh, arc.z, local, left, jnp.eye(6)[-PRESCRIBED:]
    )
    size = jnp.maximum(jnp.max(jnp.abs(left.joints)), jnp.max(jnp.abs(left.stages)))
    return ArcStep(base, response, jnp.maximum(size, jnp.max(jnp.abs(left.conditions))))


def passed(z: Unknowns, mesh: Mesh, of: Flanks) -> Passed:
    """What the arc passes on."""
    found = integrals(z, mesh, of)
    return Passed(z.y[1, 0], z.y[1, -1], z.p[1], found.unstretched)


def integrals(z: Unknowns, mesh: Mesh, of: Flanks) -> Integrals:
    """Integrals along the arc, by the weights of the collocation."""
    unit, scheme = unit_interval(), gauss(STAGES)
    y = jnp.moveaxis(stage_values(unit, mesh, z), 1, 0)  # [3, stages, elements]
    at = states(y, z.p, of)
    radius = of.R * (1 - DEEP * y[0])
    weights = scheme.weights[:, None] * interval_lengths(unit, mesh)
    length = weights * z.p[0] * radius / jnp.cos(y[1])
    return Integrals(
        length=jnp.sum(length),
        unstretched=jnp.sum(length / at.stretch),
        loss=jnp.sum(length * at.loss),
        moment=-jnp.sum(length * radius * at.f),
    )
