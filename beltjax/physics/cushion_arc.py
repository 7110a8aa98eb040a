"""A string on an elastic layer around its pulley, with the exact geometry, by collocation.

The letters are those of `physics.cushion`. On one arc, over the angle phi about the axis, with
ds = r dphi/cos chi, r = R - x, N = k_r x/(1 + T/EA) and f = k_s zeta/(1 + T/EA),

    dx/dphi = -r tan chi
    dchi/dphi = 1 - (N cos chi + f sin chi) r/(P cos chi)
    dP/dphi = (f cos chi - N sin chi) r/cos chi
    dzeta/dphi = (cos chi - om r/(R (1 + T/EA)) - u/(blur R)) r/cos chi
    x = 0, P = P_in, zeta = 0 at the entry;    x = 0, P = P_out at the exit

over span = turn + chi_out - chi_in, with span and om as unknown parameters; u is the shear beyond
what friction holds. docs/theory/cushion.md, (U1) and
(U2).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.numerics.bvp.collocation import (
    Problem,
    Unknowns,
    interpolate,
    interval_lengths,
    remesh,
    stage_values,
)
from beltjax.numerics.bvp.gauss import gauss
from beltjax.numerics.bvp.mesh import moved_mesh
from beltjax.physics import cushion as thin
from beltjax.physics.cushion import Layer, Met, Scalar, decay, strained
from beltjax.physics.inclined_arcs import Arc, ArcEnds, unit_interval

STAGES = 3
DEEP, SHEARED = 0.01, 0.001  # units of x/R and zeta/R, so that all unknowns are of order 0.1 to 1
CROWDED = 3.0  # nodes in the end layers, over those that an even mesh would have


def arc_problem(of: Layer, ends: ArcEnds) -> Problem:
    """The two-point problem of one arc, on [0, 1]."""
    return Problem(_along, _conditions, unit_interval(), (of, ends), None)


def _shear_force(y: Array, of: Layer, long: Array) -> Array:
    """Force of the shear on the belt."""
    return of.k_s * of.R * SHEARED * y[3] / long


def _unheld(y: Array, of: Layer) -> Array:
    """Shear over R that friction cannot hold."""
    held = of.mu * of.k_r / of.k_s * DEEP * jnp.maximum(y[0], 0.0)
    zeta, width = SHEARED * y[3], of.blur * y[2] / (of.k_s * of.R**2)
    above, below = zeta - held, zeta + held
    # What is above `held`, and below its negative, with corners of this width.
    unheld = (above + jnp.hypot(above, width) + below - jnp.hypot(below, width)) / 2
    return jnp.where(of.sticks > 0, 0.0, unheld)


def _along(_: Scalar, y: Array, p: Array, args: tuple[Layer, ArcEnds]) -> Array:
    of = args[0]
    span, om, g = p
    chi, P = y[1], y[2]
    long = strained(P, of.EA, g)
    r, tan, cos = 1 - DEEP * y[0], jnp.tan(chi), jnp.cos(chi)
    N, f = of.k_r * of.R * DEEP * y[0] / long, _shear_force(y, of, long)
    slopes = [
        -r * tan / DEEP,
        1 - (N + f * tan) * r * of.R / P,
        (f - N * tan) * r * of.R,
        (1 - om * r / (long * cos) - _unheld(y, of) / (of.blur * cos)) * r / SHEARED,
    ]
    return span * jnp.stack(slopes)


def _conditions(first: Array, last: Array, p: Array, args: tuple[Layer, ArcEnds]) -> Array:
    ends = args[1]
    return jnp.stack(
        [
            first[0],
            last[0],
            first[3],
            first[2] - ends.P_in,
            last[2] - ends.P_out,
            p[0] - last[1] + first[1] - ends.turn,
            p[2] - ends.g,
        ]
    )


def first_arc(of: Layer, ends: ArcEnds, elements: int) -> Arc:
    """A start: thin layers."""
    met = thin.on_cushion(ends, of)
    u = 1 / (decay((ends.P_in + ends.P_out) / 2, of) * met.length)
    t = jnp.linspace(-1.0, 1.0, elements + 1)
    bend = jnp.log(jnp.maximum(CROWDED / u, 3.0)) / 2
    mesh = (1 + jnp.tanh(bend * t) / jnp.tanh(bend)) / 2
    span = ends.turn + met.chi_out - met.chi_in

    def shape(share: Scalar) -> Array:
        x, chi, P, zeta = thin.profile(ends, of, share)
        return jnp.stack([x / (of.R * DEEP), chi, P, zeta / (of.R * SHEARED)])

    fractions = mesh[:-1] + gauss(STAGES).points[:, None] * jnp.diff(mesh)
    K = jax.vmap(jax.vmap(jax.jacfwd(shape), out_axes=1))(fractions)
    p = jnp.stack([span, met.om, ends.g])
    return Arc(mesh, Unknowns(jax.vmap(shape, out_axes=1)(mesh), K, p))


def moved_arc(arc: Arc) -> Arc:
    """The same arc on a mesh that follows its layers."""
    mesh = moved_mesh(unit_interval(), arc.mesh, arc.z)
    return Arc(mesh, remesh(unit_interval(), arc.mesh, arc.z, mesh, gauss(STAGES)))


def met_of(z: Unknowns, mesh: Array, of: Layer) -> Met:
    """How the belt lies on the pulley."""
    y = jnp.moveaxis(stage_values(unit_interval(), mesh, z), 1, 0)  # [4, stages, elements]
    weights = gauss(STAGES).weights[:, None] * interval_lengths(unit_interval(), mesh)
    length = weights * z.p[0] * of.R * (1 - DEEP * y[0]) / jnp.cos(y[1])
    long = strained(y[2], of.EA, z.p[2])
    held = of.mu * of.k_r / of.k_s * DEEP * jnp.maximum(y[0], 0.0)
    slides = (jnp.abs(SHEARED * y[3]) > held) & (of.sticks == 0)
    return Met(
        chi_in=z.y[1, 0],
        chi_out=z.y[1, -1],
        length=jnp.sum(length),
        unstretched=jnp.sum(length / long),
        om=z.p[1],
        zeta_out=SHEARED * of.R * z.y[3, -1],
        sliding=jnp.sum(jnp.where(slides, weights, 0.0)) * z.p[0],
        deepest=DEEP * of.R * jnp.max(z.y[0]),
    )


def lacking_moment(z: Unknowns, mesh: Array, of: Layer) -> Scalar:
    """The moment of the layer's forces less that of the tensions at the ends, over R P."""
    y = jnp.moveaxis(stage_values(unit_interval(), mesh, z), 1, 0)
    weights = gauss(STAGES).weights[:, None] * interval_lengths(unit_interval(), mesh)
    r = 1 - DEEP * y[0]
    force = _shear_force(y, of, strained(y[2], of.EA, z.p[2]))
    sheared = jnp.sum(weights * z.p[0] * of.R * r**2 / jnp.cos(y[1]) * force)
    pulled = z.y[2] * jnp.cos(z.y[1])
    return jnp.abs(sheared - pulled[-1] + pulled[0]) / jnp.max(z.y[2])


def profile(arc: Arc, of: Layer, share: Float[Array, " m"]) -> tuple[Array, Array]:
    """Give x and shear zeta at shares of the angle of contact."""
    y, _ = interpolate(unit_interval(), arc.mesh, arc.z, share)
    return DEEP * of.R * y[0], SHEARED * of.R * y[3]
