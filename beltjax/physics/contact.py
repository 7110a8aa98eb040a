"""Belt and pulleys of a whole drive in contact, along the belt's travel (chapter 5).

Pulleys are numbered in the order in which the belt meets them; span i runs from pulley i to i + 1.
In any consistent units:

    rho    signed radii, positive where the pulley turns the belt left;   kap   signed curvatures
    C      P + EI kappa^2/2 of each span;   pull   M/R that each pulley takes: C_i - C_{i-1}
    P_in, P_out   P = T - G V on a pulley where the belt arrives and leaves
    g      G V_ref, the momentum flux;   V_ref   speed of the unstretched belt
    law    how the belt stretches: `physics.belt_law`

The belt adheres from where it arrives and slips, over `slip`, up to where it leaves. A pulley
without torque whose wrap would be negative keeps touching at one point, where the belt is less
curved than the pulley: its unknown w is the wrap where positive, and else the logarithm of the
curvature over 1/R.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.numerics.rigid_bodies import Bodies, Coordinates, Loads, Placed, placed
from beltjax.physics.belt_law import AbstractBeltLaw
from beltjax.physics.elastica import Span, SpanData, separatrix, span_at, span_start

Scalar = Float[Array, ""]
Pulleys = Float[Array, " n"]
Spans = Float[Array, " n"]


class BeltMotion(NamedTuple):
    """How the belt moves; the numbers that are not None say which of them are given."""

    m0: Scalar  # mass per unstretched length
    c: Scalar | None  # V_ref
    v: Scalar | None  # speed of the driver's surface
    G: Scalar | None  # mass flow, in place of m0


class ContactModel(NamedTuple):
    """A drive, along the travel of its belt."""

    EI: Scalar
    EA: Scalar
    law: AbstractBeltLaw
    x: Pulleys  # centers, as drawn
    y: Pulleys
    rho: Pulleys
    mu: Pulleys
    pull: Pulleys  # the driver balances the others
    driver: Pulleys  # 1 for the driver
    loaded: Pulleys  # 1 where there is torque, at rest or not
    bodies: Bodies
    housed: Pulleys  # 1 where the accessory is bolted to the body that carries its pulley
    K: Float[Array, "coordinates coordinates"]  # stiffness of the springs
    together: Float[Array, "coordinates coordinates"]  # bodies that float together
    floating: Coordinates
    first: Coordinates  # 1 for the first body of those that float together
    loads: Loads
    motion: BeltMotion


class Unknown(NamedTuple):
    """The unknowns of the equations of contact."""

    w: Pulleys
    level: Scalar  # log of the least C above what the pulleys' curvatures take
    q: Coordinates  # of the bodies, from where they are drawn
    scale: Scalar  # log of the factor on all torques
    shape: Float[Array, "n 2"]  # (z, phi) of each span, as `span_at` takes them


class Loop(NamedTuple):
    """All spans and pulleys for given unknowns."""

    data: SpanData  # each leaf [n], as of `spans`
    spans: Span
    unmet: Float[Array, "n 2"]  # residuals of the spans' own equations
    x: Pulleys  # centers, the bodies moved
    y: Pulleys
    C: Spans
    kap: Pulleys
    wrap: Pulleys
    touching: Pulleys  # the wrap, by its unknown: zero where a pulley touches at one point
    slip: Pulleys
    P_in: Pulleys
    P_out: Pulleys
    g: Scalar
    V_ref: Scalar
    unstretched: Spans  # lengths of the spans
    on_pulleys: Pulleys  # unstretched lengths
    push: Coordinates  # of the belt, of the accessories' reactions and of loads on the bodies


def joined(unknown: Unknown, model: ContactModel) -> Loop:
    """The belt for given unknowns; `physics.contact_search` finds those that fit."""
    mod = model
    kap = jnp.exp(jnp.minimum(unknown.w, 0.0) * (1 - mod.loaded)) / mod.rho
    data, across, up = _span_data(unknown, kap, model)
    C, d = data.C, data.d
    spans, unmet = jax.vmap(span_at)(unknown.shape, data)
    bent = mod.EI * kap**2 / 2
    P_in, P_out = _preceding(C) - bent, C - bent
    V_ref, g = motion(P_in, bent, model)
    slip = jnp.abs(jnp.log(_positive(P_out) / _positive(P_in))) / mod.mu
    wrap = _wraps(spans, across, up, d, model)
    touching = jnp.maximum(unknown.w, jnp.where(mod.loaded > 0, unknown.w, 0.0))
    force_x = spans.F * (across * jnp.cos(spans.phi) - up * jnp.sin(spans.phi)) / d
    force_y = spans.F * (across * jnp.sin(spans.phi) + up * jnp.cos(spans.phi)) / d
    there = _placed(unknown.q, model)
    pull_x, pull_y = force_x - _preceding(force_x), force_y - _preceding(force_y)
    reaction = mod.housed * mod.pull * mod.rho * jnp.exp(unknown.scale)
    push = pull_x @ there.by_x + pull_y @ there.by_y + mod.loads.push(mod.bodies, unknown.q)
    return Loop(
        data=data,
        spans=spans,
        unmet=unmet,
        x=there.x,
        y=there.y,
        C=C,
        kap=kap,
        wrap=wrap,
        touching=touching,
        slip=slip,
        P_in=P_in,
        P_out=P_out,
        g=g,
        V_ref=V_ref,
        unstretched=jax.vmap(mod.law.span_length, (0, 0, None))(spans, data, g),
        on_pulleys=_on_pulleys(touching - slip, P_in, P_out, bent, g, model),
        push=push + mod.bodies.rotary * (reaction @ mod.bodies.carried),
    )


def _following(values: Array) -> Array:
    return jnp.roll(values, -1)


def _preceding(values: Array) -> Array:
    return jnp.roll(values, 1)


def _positive(P: Array) -> Array:
    return jnp.maximum(P, 1e-12)


def _placed(q: Coordinates, model: ContactModel) -> Placed:
    return placed(model.bodies, model.x, model.y, model.bodies.carried, q)


def _span_data(
    unknown: Unknown, kap: Pulleys, model: ContactModel
) -> tuple[SpanData, Spans, Spans]:
    """The data of each span, and the components of its line of centers."""
    there = _placed(unknown.q, model)
    x, y = there.x, there.y
    across, up = _following(x) - x, _following(y) - y
    d = jnp.sqrt(across**2 + up**2)
    EI, EA = model.EI * jnp.ones_like(d), model.EA * jnp.ones_like(d)
    C = _tensions(unknown, kap, model)
    data = SpanData(C, EI, EA, d, model.rho, _following(model.rho), kap, _following(kap))
    return data, across, up


def _tensions(unknown: Unknown, kap: Pulleys, model: ContactModel) -> Spans:
    """C of each span: steps of M/R from one to the next, all above EI kappa^2/2 at both ends."""
    offsets = jnp.cumsum(model.pull) * jnp.exp(unknown.scale)
    taken = model.EI * jnp.maximum(kap**2, _following(kap) ** 2) / 2
    return jnp.max(taken - offsets) + jnp.exp(unknown.level) + offsets


def motion(P_in: Pulleys, bent: Pulleys, model: ContactModel) -> tuple[Scalar, Scalar]:
    """V_ref and g = G V_ref; the driver's surface runs as fast as the belt that arrives there."""
    m0, c, v, G = model.motion
    if c is not None:
        return c, m0 * c**2
    assert v is not None  # one of the two speeds is given
    none = jnp.zeros_like(v)
    flux = (m0, none) if G is None else (none, G)
    on_driver = model.driver @ P_in, model.driver @ bent
    V_ref = model.law.reference_speed(v, flux, *on_driver, model.EA)
    return V_ref, (flux[0] * V_ref + flux[1]) * V_ref


def tension(P: Array, bent: Array, loop: Loop, model: ContactModel) -> Array:
    """T = P + G V where `bent` is EI kappa^2/2; rows are spans."""
    return P + loop.g * model.law.stretch(P, bent, loop.g, model.EA)


def speed(P: Array, bent: Array, loop: Loop, model: ContactModel) -> Array:
    """V of the stretched belt."""
    return loop.V_ref * model.law.stretch(P, bent, loop.g, model.EA)


def mass_flow(loop: Loop, model: ContactModel) -> Scalar:
    """G, as it is given, or from the belt's mass and speed."""
    return model.motion.m0 * loop.V_ref if model.motion.G is None else model.motion.G


def efficiency(loop: Loop, model: ContactModel) -> Scalar:
    """Power that the accessories take over the power of the driver; 1 where there is none.

    It is a ratio of moments weighted by the belt's stretches, so that it exists for a belt that
    stands still.
    """
    bent = model.EI * loop.kap**2 / 2
    stretch = model.law.stretch(loop.P_in, bent, loop.g, model.EA)
    given = -model.driver @ (model.pull * stretch)
    taken = (1 - model.driver) @ (model.pull * stretch)
    return jnp.where(given == 0, 1.0, taken / jnp.where(given == 0, 1.0, given))


def inclinations(spans: Span, model: ContactModel) -> tuple[Spans, Spans]:
    """Directions of the belt at the spans' starts and ends, from the lines of centers."""
    turn = jnp.sign(model.rho)
    return spans.phi - 2 * turn * spans.u_i, spans.phi + 2 * _following(turn) * spans.u_j


def _wraps(spans: Span, across: Spans, up: Spans, d: Spans, model: ContactModel) -> Pulleys:
    """Angles by which the pulleys turn the belt; negative where it would have to bend back.

    The angles of a string, which are taken in (-90, 270) degrees, decide about full turns. A large
    pulley beside a small one may take more than 270 degrees: the belt turns once in all.
    """
    cos, sin = across / d, up / d
    rise = jnp.clip((model.rho - _following(model.rho)) / d, -1.0, 1.0)
    run = jnp.sqrt(jnp.maximum(1 - rise**2, 1e-12))
    along_x, along_y = cos * run - sin * rise, sin * run + cos * rise
    before_x, before_y = _preceding(along_x), _preceding(along_y)
    turn = jnp.sign(model.rho)
    straight = turn * jnp.arctan2(
        before_x * along_y - before_y * along_x, before_x * along_x + before_y * along_y
    )
    straight = jnp.where(straight < -jnp.pi / 2, straight + 2 * jnp.pi, straight)
    once = jnp.abs(jnp.sum(turn * straight)) > jnp.pi
    least = jnp.arange(len(turn)) == jnp.argmin(straight)
    straight = jnp.where(least & ~once, straight + 2 * jnp.pi, straight)
    string = jnp.arctan2(rise, run)
    start, end = inclinations(spans, model)
    return straight + turn * ((start - string) - _preceding(end - string))


def _on_pulleys(
    adhesion: Pulleys, P_in: Pulleys, P_out: Pulleys, bent: Pulleys, g: Scalar, model: ContactModel
) -> Pulleys:
    """Unstretched lengths of the arcs of adhesion and of slip (5.26)."""
    high = _positive(jnp.maximum(P_in, P_out))
    low = _positive(jnp.minimum(P_in, P_out))
    adhering = adhesion / model.law.stretch(P_in, bent, g, model.EA)
    slipping = model.law.slip_length(low, high, model.mu, bent, g, model.EA)
    return jnp.abs(model.rho) * (adhering + slipping)


def long_spans(unknown: Unknown, model: ContactModel) -> tuple[Pulleys, Float[Array, "n 2"]]:
    """Wraps and starts for the spans, as if they were long beside their bent ends."""
    data, across, up = _span_data(unknown, 1 / model.rho, model)
    wraps = _wraps(jax.vmap(separatrix)(data), across, up, data.d, model)
    return wraps, jax.vmap(span_start)(data)
