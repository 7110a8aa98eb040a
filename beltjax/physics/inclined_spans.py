"""Strings that meet their pulleys at angles: straight spans, turns, moments, forces on bodies.

A belt that sinks into its pulley, because it wedges in a groove or presses a soft layer, comes and
leaves at an angle chi to the pulley's circle of radius R, so that its line is tangent to the circle
R cos chi. Pulleys are numbered as the belt meets them, span i runs from pulley i to the next of its
belt, in any consistent units:

    rho    signed radii, positive where the pulley turns the belt left
    chi    angle of the belt to the circle, positive outward along the travel: negative where the
           belt comes in, positive where it leaves
    P      T - G V of each span;   M   moments that pulleys take from the belt
    q      coordinates of the bodies that carry pulleys
    turn   angle by which a pulley turns the belt from one span to the next

docs/theory/grooves.md, (W8) and (W9).
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from beltjax.numerics.loops import Loops
from beltjax.numerics.rigid_bodies import Bodies, Coordinates, OutsideForces, Placed, placed

Pulleys = Float[Array, " n"]
Spans = Float[Array, " n"]


class Frame(NamedTuple):
    """Pulleys, and the bodies that carry some of them."""

    x: Pulleys  # centers, as drawn
    y: Pulleys
    rho: Pulleys
    loops: Loops
    bodies: Bodies
    housed: Pulleys  # 1 where the accessory is bolted to the body that carries its pulley
    K: Float[Array, "coordinates coordinates"]  # stiffness of the springs
    outside: OutsideForces


class InclinedSpans(NamedTuple):
    """The free spans between pulleys whose belt stands at given angles to them."""

    lengths: Spans  # of the free belt
    along_x: Spans  # unit vectors in the direction of travel
    along_y: Spans
    turns: Pulleys
    exists: Bool[Array, " n"]  # whether the circles have the tangent
    there: Placed  # the pulleys, the bodies moved


def inclined_spans(
    chi_in: Pulleys, chi_out: Pulleys, q: Coordinates, frame: Frame
) -> InclinedSpans:
    """The spans for given angles; lengths are measured from where the belt crosses the radii."""
    there = placed(frame.bodies, frame.x, frame.y, frame.bodies.carried, q)
    following = frame.loops.following
    across, up = following(there.x) - there.x, following(there.y) - there.y
    leaves, comes = frame.rho * jnp.cos(chi_out), following(frame.rho * jnp.cos(chi_in))
    square, rise = across**2 + up**2, leaves - comes
    exists = square > rise**2
    # Where there is no tangent, any one does: nothing downstream may be NaN.
    square = jnp.where(exists, square, 1.0 + rise**2)
    tangent = jnp.sqrt(square - rise**2)
    along_x = jnp.where(exists, (tangent * across - rise * up) / square, 1.0)
    along_y = jnp.where(exists, (tangent * up + rise * across) / square, 0.0)
    size = jnp.abs(frame.rho)
    covered = size * jnp.sin(chi_out) - following(size * jnp.sin(chi_in))
    turns = _turns(along_x, along_y, frame)
    return InclinedSpans(tangent - covered, along_x, along_y, turns, exists, there)


def _turns(along_x: Spans, along_y: Spans, frame: Frame) -> Pulleys:
    """Angles by which the pulleys turn the belt, taken in (-90, 270) degrees.

    A large pulley beside a small one may turn it by more than 270 degrees: the belt turns once in
    all. A crossed belt does not, and takes (0, 360) degrees of both its pulleys.
    """
    loops, side = frame.loops, jnp.sign(frame.rho)
    before_x, before_y = loops.preceding(along_x), loops.preceding(along_y)
    cross = before_x * along_y - before_y * along_x
    turn = side * jnp.arctan2(cross, before_x * along_x + before_y * along_y)
    crossed = loops.crossed(side)
    least = loops.spread(crossed - 1) * jnp.pi / 2
    turn = jnp.where(turn < least, turn + 2 * jnp.pi, turn)
    once = jnp.abs(loops.sums(side * turn)) > jnp.pi
    short = jnp.where(once | (crossed > 0), 0.0, 2 * jnp.pi)
    return turn + loops.at_smallest(turn) * loops.spread(short)


def moments(P: Spans, chi_in: Pulleys, chi_out: Pulleys, frame: Frame) -> Pulleys:
    """Moments about the pulleys' axes that the pulleys take from the belt (W8)."""
    P_in = frame.loops.preceding(P)
    return jnp.abs(frame.rho) * (P * jnp.cos(chi_out) - P_in * jnp.cos(chi_in))


def push(P: Spans, M: Pulleys, spans: InclinedSpans, q: Coordinates, frame: Frame) -> Coordinates:
    """Forces of belt, housed accessories' reactions and the outside on the bodies."""
    x, y, preceding = P * spans.along_x, P * spans.along_y, frame.loops.preceding
    by_belt = (x - preceding(x)) @ spans.there.by_x + (y - preceding(y)) @ spans.there.by_y
    reaction = frame.housed * M * jnp.sign(frame.rho)
    of = frame.bodies
    return by_belt + of.rotary * (reaction @ of.carried) + frame.outside.push(of, q)


def body_residuals(q: Coordinates, force: Coordinates, P: Spans, frame: Frame) -> Coordinates:
    """Zero where the `force` on each body balances, or where a stop holds the body against it.

    Locked bodies stand where they are drawn. Residuals are of order one, forces over the mean
    tension and, of arms, over their length.
    """
    of = frame.bodies
    apart = (frame.x[:, None] - of.pivots[:, 0]) ** 2 + (frame.y[:, None] - of.pivots[:, 1]) ** 2
    arm = jnp.sqrt(jnp.maximum(jnp.max(of.carried * apart, axis=0), 1e-12))
    size = jnp.mean(P) * jnp.where(of.rotary > 0, arm, 1.0)
    # A body that the balance would move beyond a stop stands at the stop.
    balance = jnp.clip(q + force / size, of.stops[:, 0], of.stops[:, 1]) - q
    return jnp.where(of.locked > 0, q, balance)
