"""What is told of a drive with grooves: powers, balances, and the zones of each arc.

Letters as in `physics.groove` and `physics.groove_drive`. docs/theory/grooves.md, (W8) to (W13).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.numerics.bvp.collocation import interpolate, stage_values
from beltjax.numerics.bvp.gauss import gauss
from beltjax.physics.groove import Flanks
from beltjax.physics.groove_arc import DEEP, STAGES, integrals, states
from beltjax.physics.groove_drive import GrooveLoop, GrooveModel, GrooveUnknown, slow
from beltjax.physics.inclined_arcs import Arc, unit_interval

Scalar = Float[Array, ""]
Pulleys = Float[Array, " n"]
RESTS = 0.05  # part by which the radial force differs from P/r where the belt seats or unseats


class GrooveMeasures(NamedTuple):
    """Numbers of a drive, along its travel; powers are over V_ref, so that they exist at rest."""

    P: Pulleys  # of each span
    T: Pulleys
    speed: Pulleys  # of the belt in each span
    omega: Pulleys
    M: Pulleys
    loss: Pulleys
    slip: Pulleys
    wraps: Pulleys  # angles over which the belt touches
    chi: Float[Array, "n 2"]
    deepest: Pulleys  # penetration, over R
    zones: Float[Array, "n 4"]  # seating, adhesion, sliding, unseating [rad]
    given: Scalar  # power of the driver
    taken: Scalar  # power of the accessories
    efficiency: Scalar
    energy: Scalar  # power that the balance of energy lacks
    moment: Pulleys  # what the balance of moments lacks


def measures(
    unknown: GrooveUnknown, loop: GrooveLoop, arcs: Arc, grooves: Flanks, model: GrooveModel
) -> GrooveMeasures:
    """The numbers of a drive."""
    along = jax.vmap(integrals)(arcs.z, arcs.mesh, grooves)
    of_arcs = along.loss, along.moment, jax.vmap(deepest)(arcs), jax.vmap(arc_zones)(arcs, grooves)
    return told(unknown, loop, model, of_arcs)


def told(
    unknown: GrooveUnknown,
    loop: GrooveLoop,
    model: GrooveModel,
    of_arcs: tuple[Pulleys, Pulleys, Pulleys, Float[Array, "n 4"]],
) -> GrooveMeasures:
    """The numbers of a drive, from losses, moments of friction, depths and zones in its grooves."""
    own_loss, own_moment, depths, own_zones = of_arcs
    EA, g, P = model.EA, unknown.g, unknown.P
    before, R, flat = model.frame.loops.preceding(P), jnp.abs(model.frame.rho), model.flat > 0
    creep = (P - before) ** 2 / (2 * (EA - g))
    loss, turning = jnp.where(flat, creep, own_loss), loop.at.om / R
    power = loop.moments * turning
    given = -model.driving @ power
    taken = (1 - model.driving) @ power
    wraps = unknown.turn + loop.at.chi_out - loop.at.chi_in
    none = given == 0
    missing = given - taken - jnp.sum(loss)
    apart = own_moment - loop.moments
    slipping = _flat_slip(P, before, model)
    smooth = jnp.stack([0 * wraps, wraps - slipping, slipping, 0 * wraps], axis=-1)
    zones = jnp.where(flat[:, None], smooth, own_zones)
    return GrooveMeasures(
        P=P,
        T=P + g * loop.stretch,
        speed=loop.V_ref * loop.stretch,
        omega=turning * loop.V_ref,
        M=loop.moments,
        loss=loss,
        slip=loop.slip,
        wraps=wraps,
        chi=jnp.stack([loop.at.chi_in, loop.at.chi_out], axis=-1),
        deepest=jnp.where(flat, 0.0, depths),
        zones=zones,
        given=given,
        taken=taken,
        efficiency=jnp.where(none, 1.0, taken / jnp.where(none, 1.0, given)),
        energy=missing,
        moment=jnp.where(flat, 0.0, apart),
    )


def _flat_slip(P: Pulleys, before: Pulleys, model: GrooveModel) -> Pulleys:
    """Arcs of slip on smooth pulleys, without absolute values at equal tensions."""
    side = jnp.where(before < P, 1.0, -1.0)
    return side * jnp.log(P / before) / model.mu


def arc_zones(arc: Arc, of: Flanks) -> Float[Array, "4"]:
    """Seating, adhesion, sliding and unseating of one arc [rad], by definition (W13)."""
    places, y = dense(arc)
    phi, at = arc.z.p[0] * places, states(y, arc.z.p, of)
    off = jnp.abs(at.N * of.R * (1 - DEEP * y[0]) / y[2] - 1) - RESTS
    inside = off < 0
    some = jnp.any(inside)

    def crossing(k: Array, other: Array) -> Scalar:
        """Where the force is off by the limit, near the points k inside and its `other`."""
        width = off[other] - off[k]
        part = -off[k] / jnp.where(width == 0, 1.0, width)
        place = jax.lax.stop_gradient(places[k] + part * (places[other] - places[k]))
        for _ in range(3):
            value, slope = jax.jvp(lambda x: _unsettled(x, arc, of), (place,), (jnp.ones(()),))
            slope = jax.lax.stop_gradient(slope)
            step = value / jnp.where(slope == 0, 1.0, slope)
            # Only the last step counts for derivatives: the others end where it begins.
            place = jax.lax.stop_gradient(place) - jnp.where(k == other, 0.0, step)
        return arc.z.p[0] * place

    last = len(phi) - 1
    first_in = jnp.argmax(inside)
    last_in = last - jnp.argmax(inside[::-1])
    start = crossing(first_in, jnp.maximum(first_in - 1, 0))
    end = crossing(last_in, jnp.minimum(last_in + 1, last))
    start, end = jnp.where(some, start, phi[-1]), jnp.where(some, end, phi[-1])
    above = jnp.log(at.w / slow(of.eps))
    low, high = above[:-1], above[1:]
    size = jnp.abs(low) + jnp.abs(high)
    part = (jnp.maximum(-low, 0) + jnp.maximum(-high, 0)) / jnp.where(size == 0, 1.0, size)
    overlap = jnp.minimum(phi[1:], end) - jnp.maximum(phi[:-1], start)
    adheres = jnp.sum(part * jnp.maximum(overlap, 0.0))
    return jnp.stack([start, adheres, end - start - adheres, phi[-1] - end])


def deepest(arc: Arc) -> Scalar:
    """The greatest penetration over R, where it does not rise any more."""
    places, y = dense(arc)
    unit, k = unit_interval(), jnp.argmax(y[0])

    def rise(place: Scalar) -> tuple[Scalar, Scalar]:
        found, slope = interpolate(unit, arc.mesh, arc.z, place[None])
        return slope[0, 0], found[0, 0]

    low = places[jnp.maximum(k - 1, 0)]
    high = places[jnp.minimum(k + 1, len(places) - 1)]

    # The slope falls from positive to negative between the neighbors; halved, it is met.
    def halved(_: Any, ends: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
        middle = (ends[0] + ends[1]) / 2
        up = rise(middle)[0] > 0
        return jnp.where(up, middle, ends[0]), jnp.where(up, ends[1], middle)

    low, high = jax.lax.fori_loop(0, 24, halved, jax.lax.stop_gradient((low, high)))
    return DEEP * rise(jax.lax.stop_gradient((low + high) / 2))[1]


def _unsettled(place: Scalar, arc: Arc, of: Flanks) -> Scalar:
    """How far the radial force is off, less the limit, at a place on [0, 1]."""
    y, _ = interpolate(unit_interval(), arc.mesh, arc.z, place[None])
    at = states(y[:, 0], arc.z.p, of)
    return jnp.abs(at.N * of.R * (1 - DEEP * y[0, 0]) / y[2, 0] - 1) - RESTS


def dense(arc: Arc) -> tuple[Float[Array, " points"], Float[Array, "3 points"]]:
    """Places on [0, 1], and the unknowns there: at the nodes and at the collocation points."""
    unit, points = unit_interval(), gauss(STAGES).points
    inside = arc.mesh[:-1] + points[:, None] * jnp.diff(arc.mesh)
    places = jnp.concatenate([arc.mesh[None, :-1], inside]).T.ravel()
    between = jnp.moveaxis(stage_values(unit, arc.mesh, arc.z), 0, -1)  # [3, elements, stages]
    y = jnp.concatenate([arc.z.y[:, :-1, None], between], axis=2).reshape(3, -1)
    last = arc.z.y[:, -1:]
    return jnp.concatenate([places, arc.mesh[-1:]]), jnp.concatenate([y, last], axis=1)
