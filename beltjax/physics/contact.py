"""Belts and pulleys of a whole drive in contact, along the belts' travel (chapter 5).

Pulleys are numbered belt after belt, in the order in which a belt meets them; span i runs from
pulley i to the next of its belt. Shafts and bodies couple the belts. In any consistent units:

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
from jaxtyping import Array, Bool, Float

from beltjax.numerics.loops import Loops
from beltjax.numerics.rigid_bodies import Bodies, Coordinates, OutsideForces, Placed, placed
from beltjax.physics.belt_law import AbstractBeltLaw
from beltjax.physics.elastica import Span, SpanData, separatrix, span_at, span_start

Scalar = Float[Array, ""]
Belts = Float[Array, " belts"]
Pulleys = Float[Array, " n"]
Spans = Float[Array, " n"]
Index = int | slice | tuple[slice, None]  # one, all, or all as a column


class BeltMotion(NamedTuple):
    """How the belts move; the numbers that are not None say which of them are given."""

    m0: Belts  # mass per unstretched length
    c: Scalar | None  # V_ref of the driver's belt
    v: Scalar | None  # speed of the driver's surface
    G: Scalar | None  # mass flow of a single belt, in place of m0


class ContactModel(NamedTuple):
    """A drive, along the travel of its belts."""

    EI: Belts
    EA: Belts
    law: AbstractBeltLaw
    loops: Loops
    x: Pulleys  # centers, as drawn
    y: Pulleys
    rho: Pulleys
    mu: Pulleys
    pull: Pulleys  # in balance on each belt
    driving: Pulleys  # 1 on the driver's shaft
    gives: Pulleys  # 1 for the pulley that turns its belt
    gearing: Float[Array, "belts n"]  # V of a belt there, per V at other pulleys of the shaft
    loaded: Pulleys  # 1 where there is torque, at rest or not
    bodies: Bodies
    housed: Pulleys  # 1 where the accessory is bolted to the body that carries its pulley
    K: Float[Array, "coordinates coordinates"]  # stiffness of the springs
    together: Float[Array, "coordinates coordinates"]  # bodies that float together
    floating: Coordinates
    first: Coordinates  # 1 for the first body of those that float together
    outside: OutsideForces
    motion: BeltMotion


class Unknown(NamedTuple):
    """The unknowns of the equations of contact."""

    w: Pulleys
    level: Belts  # log of the least C above what the pulleys' curvatures take
    q: Coordinates  # of the bodies, from where they are drawn
    scale: Scalar  # log of the factor on all torques
    shape: Float[Array, "n 2"]  # (z, phi) of each span, as `span_at` takes them


class Loop(NamedTuple):
    """All spans and pulleys for given unknowns; g and V_ref are those of the belt."""

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
    g: Spans
    V_ref: Spans
    unstretched: Spans  # lengths of the spans
    on_pulleys: Pulleys  # unstretched lengths
    push: Coordinates  # of the belt, of the accessories' reactions and from outside, on the bodies


def joined(unknown: Unknown, model: ContactModel) -> Loop:
    """The belts for given unknowns; `physics.contact_search` finds those that fit."""
    mod, preceding = model, model.loops.preceding
    kap = jnp.exp(jnp.minimum(unknown.w, 0.0) * (1 - mod.loaded)) / mod.rho
    data, across, up = _span_data(unknown, kap, model)
    C, d = data.C, data.d
    spans, unmet = jax.vmap(span_at)(unknown.shape, data)
    bent = data.EI * kap**2 / 2
    P_in, P_out = preceding(C) - bent, C - bent
    V_ref, g = motion(P_in, bent, model)
    g_of, V_of = mod.loops.spread(g), mod.loops.spread(V_ref)
    slip = jnp.abs(jnp.log(_positive(P_out) / _positive(P_in))) / mod.mu
    wrap = _wraps(spans, across, up, d, model)
    touching = jnp.maximum(unknown.w, jnp.where(mod.loaded > 0, unknown.w, 0.0))
    force_x = spans.F * (across * jnp.cos(spans.phi) - up * jnp.sin(spans.phi)) / d
    force_y = spans.F * (across * jnp.sin(spans.phi) + up * jnp.cos(spans.phi)) / d
    there = _placed(unknown.q, model)
    pull_x, pull_y = force_x - preceding(force_x), force_y - preceding(force_y)
    reaction = mod.housed * mod.pull * mod.rho * jnp.exp(unknown.scale)
    push = pull_x @ there.by_x + pull_y @ there.by_y + mod.outside.push(mod.bodies, unknown.q)
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
        g=g_of,
        V_ref=V_of,
        unstretched=jax.vmap(mod.law.span_length)(spans, data, g_of),
        on_pulleys=_on_pulleys(touching - slip, P_in, P_out, bent, g_of, data.EA, model),
        push=push + mod.bodies.rotary * (reaction @ mod.bodies.carried),
    )


def _positive(P: Array) -> Array:
    return jnp.maximum(P, 1e-12)


def _placed(q: Coordinates, model: ContactModel) -> Placed:
    return placed(model.bodies, model.x, model.y, model.bodies.carried, q)


def _span_data(
    unknown: Unknown, kap: Pulleys, model: ContactModel
) -> tuple[SpanData, Spans, Spans]:
    """The data of each span, and the components of its line of centers."""
    there, following = _placed(unknown.q, model), model.loops.following
    x, y = there.x, there.y
    across, up = following(x) - x, following(y) - y
    d = jnp.sqrt(across**2 + up**2)
    EI, EA = model.loops.spread(model.EI), model.loops.spread(model.EA)
    C = _tensions(unknown, kap, EI, model)
    data = SpanData(C, EI, EA, d, model.rho, following(model.rho), kap, following(kap))
    return data, across, up


def _tensions(unknown: Unknown, kap: Pulleys, EI: Spans, model: ContactModel) -> Spans:
    """C of each span: steps of M/R from one to the next, all above EI kappa^2/2 at both ends."""
    # The pulls of each belt add up to zero, so that the sums of the next belt start anew.
    offsets, loops = jnp.cumsum(model.pull) * jnp.exp(unknown.scale), model.loops
    taken = EI * jnp.maximum(kap**2, loops.following(kap) ** 2) / 2
    return loops.spread(loops.largest(taken - offsets) + jnp.exp(unknown.level)) + offsets


def motion(P_in: Pulleys, bent: Pulleys, model: ContactModel) -> tuple[Belts, Belts]:
    """V_ref and g = G V_ref of each belt.

    The surface of the pulley that turns a belt runs as fast as the belt that arrives there. The
    driver turns its own belt; shafts pass the speeds of that belt's pulleys on to further belts.
    """
    (m0, c, v, G), loops, law = model.motion, model.loops, model.law
    none = jnp.zeros_like(m0)
    flux = (m0, none) if G is None else (none, G[None])
    on_giving = loops.sums(model.gives * P_in), loops.sums(model.gives * bent)

    def flow(V_ref: Belts) -> Belts:
        return (flux[0] * V_ref + flux[1]) * V_ref

    if c is not None:
        of_driver = jnp.broadcast_to(c, m0.shape)
    else:
        assert v is not None  # one of the two speeds is given
        speeds = jnp.broadcast_to(v, m0.shape)
        of_driver = law.reference_speed(speeds, flux, *on_giving, model.EA)
    V_ref = of_driver
    for _ in m0[1:]:
        V = loops.spread(V_ref) * law.stretch(
            P_in, bent, loops.spread(flow(V_ref)), loops.spread(model.EA)
        )
        turned = law.reference_speed(model.gearing @ V, flux, *on_giving, model.EA)
        V_ref = jnp.where(_turned_by_driver(model), of_driver, turned)
    return V_ref, flow(V_ref)


def _turned_by_driver(model: ContactModel) -> Bool[Array, " belts"]:
    """Whether the driver itself turns the belt."""
    return jnp.sum(model.gearing, axis=1) == 0


def tension(
    P: Array, bent: Array, loop: Loop, model: ContactModel, of: Index = slice(None)
) -> Array:
    """T = P + G V of the spans or pulleys `of`, where `bent` is EI kappa^2/2."""
    g = loop.g[of]
    return P + g * model.law.stretch(P, bent, g, loop.data.EA[of])


def speed(P: Array, bent: Array, loop: Loop, model: ContactModel, of: Index = slice(None)) -> Array:
    """V of the stretched belt, as `tension`."""
    return loop.V_ref[of] * model.law.stretch(P, bent, loop.g[of], loop.data.EA[of])


def mass_flow(loop: Loop, model: ContactModel) -> Belts:
    """G of each belt, as it is given, or from the belt's mass and speed."""
    G = model.motion.G
    return model.motion.m0 * loop.V_ref[model.loops.starts] if G is None else G[None]


def efficiency(loop: Loop, model: ContactModel) -> Scalar:
    """Power that the accessories take over the power of the driver; 1 where there is none.

    It is a ratio of moments weighted by the belts' relative speeds, so that it exists for belts
    that stand still.
    """
    loops = model.loops
    bent = loop.data.EI * loop.kap**2 / 2
    stretch = model.law.stretch(loop.P_in, bent, loop.g, loop.data.EA)
    ratios = jnp.ones(len(loops.sizes))
    for _ in loops.sizes[1:]:
        turned = model.gearing @ (loops.spread(ratios) * stretch)
        ratios = turned / loops.sums(model.gives * stretch)
        ratios = jnp.where(_turned_by_driver(model), 1.0, ratios)
    speeds = loops.spread(ratios) * stretch
    given = -model.driving @ (model.pull * speeds)
    taken = (1 - model.driving) @ (model.pull * speeds)
    return jnp.where(given == 0, 1.0, taken / jnp.where(given == 0, 1.0, given))


def inclinations(spans: Span, model: ContactModel) -> tuple[Spans, Spans]:
    """Directions of the belt at the spans' starts and ends, from the lines of centers."""
    turn = jnp.sign(model.rho)
    next_turn = model.loops.following(turn)
    return spans.phi - 2 * turn * spans.u_i, spans.phi + 2 * next_turn * spans.u_j


def _wraps(spans: Span, across: Spans, up: Spans, d: Spans, model: ContactModel) -> Pulleys:
    """Angles by which the pulleys turn the belt; negative where it would have to bend back.

    The angles of a string, which are taken in (-90, 270) degrees, decide about full turns. A large
    pulley beside a small one may take more than 270 degrees: the belt turns once in all. A crossed
    belt does not, and takes (0, 360) degrees of both its pulleys.
    """
    cos, sin, loops = across / d, up / d, model.loops
    rise = jnp.clip((model.rho - loops.following(model.rho)) / d, -1.0, 1.0)
    run = jnp.sqrt(jnp.maximum(1 - rise**2, 1e-12))
    along_x, along_y = cos * run - sin * rise, sin * run + cos * rise
    before_x, before_y = loops.preceding(along_x), loops.preceding(along_y)
    turn = jnp.sign(model.rho)
    straight = turn * jnp.arctan2(
        before_x * along_y - before_y * along_x, before_x * along_x + before_y * along_y
    )
    crossed = loops.crossed(turn)
    least = loops.spread(crossed - 1) * jnp.pi / 2
    straight = jnp.where(straight < least, straight + 2 * jnp.pi, straight)
    once = jnp.abs(loops.sums(turn * straight)) > jnp.pi
    short = jnp.where(once | (crossed > 0), 0.0, 2 * jnp.pi)
    straight = straight + loops.at_smallest(straight) * loops.spread(short)
    string = jnp.arctan2(rise, run)
    start, end = inclinations(spans, model)
    return straight + turn * ((start - string) - loops.preceding(end - string))


def _on_pulleys(
    adhesion: Pulleys,
    P_in: Pulleys,
    P_out: Pulleys,
    bent: Pulleys,
    g: Pulleys,
    EA: Pulleys,
    model: ContactModel,
) -> Pulleys:
    """Unstretched lengths of the arcs of adhesion and of slip (5.26)."""
    high = _positive(jnp.maximum(P_in, P_out))
    low = _positive(jnp.minimum(P_in, P_out))
    adhering = adhesion / model.law.stretch(P_in, bent, g, EA)
    slipping = model.law.slip_length(low, high, model.mu, bent, g, EA)
    return jnp.abs(model.rho) * (adhering + slipping)


def long_spans(unknown: Unknown, model: ContactModel) -> tuple[Pulleys, Float[Array, "n 2"]]:
    """Wraps and starts for the spans, as if they were long beside their bent ends."""
    data, across, up = _span_data(unknown, 1 / model.rho, model)
    wraps = _wraps(jax.vmap(separatrix)(data), across, up, data.d, model)
    return wraps, jax.vmap(span_start)(data)
