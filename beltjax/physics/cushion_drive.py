"""A whole drive of strings that ride on cushions: what the pulleys, spans and bodies share.

Pulleys are numbered as the belt meets them, span i runs from pulley i to the next. For each pulley

    M_i = R_i (P_out cos chi_out - P_in cos chi_in)      given, but for the driver
    turn_i = the angle between the spans before and after it

the unstretched lengths add up to the belt's, and the bodies balance. docs/theory/cushion.md.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from beltjax.compiling.batched_loops import in_lanes_of
from beltjax.numerics.bvp.collocation import Unknowns
from beltjax.numerics.derivative_rules import frozen_unless
from beltjax.numerics.rigid_bodies import Coordinates
from beltjax.numerics.roots import followed_root, implicit_solution
from beltjax.physics import cushion
from beltjax.physics.cushion import Layer, Met, met_rim, met_thin, strained
from beltjax.physics.cushion_arc import arc_problem, first_arc, lacking_moment, met_of, moved_arc
from beltjax.physics.inclined_arcs import Arc, ArcEnds, arc_step, joint_step, solved_arc
from beltjax.physics.inclined_spans import (
    Frame,
    InclinedSpans,
    body_residuals,
    inclined_spans,
    moments,
    push,
)

Scalar = Float[Array, ""]
Pulleys = Float[Array, " n"]
Spans = Float[Array, " n"]

# A layer that is hard in shear comes from one of _EASY times its radial stiffness.
_EASED = (1.0, 0.75, 0.5, 0.25, 0.0, 0.0, 0.0, 0.0, 0.0)
_EASY = 2.0
_LARGEST = 0.3  # of an unknown in one step of Newton's method
_CLOSE = 1e-10  # a step below it, in units of the largest, is the last one
_MOST_STEPS = 20
SHARP = 1e-4  # blur of friction in the end
# Friction holds ever more sharply, each time on a better mesh.
_BLURS = (1.0, 0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4, SHARP)
_ALL = 0.995  # of an arc that counts as the whole
_BALANCED = 1e-6  # of R P: what the balance of moments may lack


class CushionModel(NamedTuple):
    """One belt and its pulleys, along the travel."""

    frame: Frame
    layers: Layer  # each leaf [n]
    driving: Pulleys  # 1 on the driver
    pull: Pulleys  # M/R that each pulley takes; the driver's is not used
    m0: Scalar
    c: Scalar | None  # V_ref
    v: Scalar | None  # speed of the driver's surface
    G: Scalar | None  # mass flow, in place of m0


class Given(NamedTuple):
    """What the belt and the springs are given by."""

    by_tension: Scalar  # 1: the mean tension of the spans, with the bodies as drawn
    load: Scalar  # 0 at rest and without torques, else 1
    tension: Scalar
    L0: Scalar
    relaxed: Coordinates  # forces of the springs at the drawn positions


class Running(NamedTuple):
    """A drive that runs, or rests."""

    P: Spans
    q: Coordinates
    g: Scalar
    V_ref: Scalar
    met: Met
    spans: InclinedSpans
    M: Pulleys
    L0: Scalar
    relaxed: Coordinates
    force: Coordinates  # on the bodies


class Found(NamedTuple):
    """The drive, and the evidence of the search."""

    running: Running
    arcs: Arc | None  # each leaf [n], along the travel; None: thin layers
    root: Array
    error: Scalar  # relative, of the arcs
    gross: Bool[Array, " n"]  # whether the cords slide over the whole arc
    converged: Bool[Array, ""]
    residual: Scalar
    steps: Array


def _split(x: Array, model: CushionModel) -> tuple[Spans, Pulleys, Coordinates, Scalar]:
    n = len(model.pull)
    return jnp.exp(x[:n]), x[n : 2 * n], x[2 * n : -1], x[-1]


def ends_of(x: Array, model: CushionModel) -> ArcEnds:
    """What unknowns (log P, turns, coordinates, g) prescribe to the belt on each pulley."""
    P, turn, _, g = _split(x, model)
    return ArcEnds(model.frame.loops.preceding(P), P, turn, jnp.broadcast_to(g, P.shape))


def equations(
    x: Array, met: Met, model: CushionModel, given: Given, share: Scalar
) -> tuple[Array, Running]:
    """Residuals of order one and the drive, under a share of its load."""
    load = share * given.load
    P, turn, q, g = _split(x, model)
    frame, R, EA = model.frame, model.layers.R, model.layers.EA[0]
    spans = inclined_spans(met.chi_in, met.chi_out, q, frame)
    M = moments(P, met.chi_in, met.chi_out, frame)
    L0 = jnp.sum(spans.lengths / strained(P, EA, g) + met.unstretched)
    V_ref = _speed(model, met)
    by_belt = push(P, load * model.pull * R, spans, q, frame)
    stretched = frame.K @ q
    relaxed = jnp.where(given.by_tension > 0, stretched - by_belt, given.relaxed)
    force = by_belt + relaxed - stretched
    tension = jnp.mean(P) / given.tension - 1
    length = jnp.where(given.by_tension > 0, tension, (L0 / given.L0 - 1) * EA / given.tension)
    balance = jnp.where(given.by_tension > 0, q, body_residuals(q, force, P, frame))
    moment = (M / R - load * model.pull) / given.tension
    residual = jnp.concatenate(
        [
            jnp.where(model.driving > 0, length, moment),
            turn - spans.turns,
            balance,
            (g - load * _flux(model, V_ref))[None] / given.tension,
        ]
    )
    return residual, Running(P, q, g, V_ref, met, spans, M, L0, relaxed, force)


def _speed(model: CushionModel, met: Met) -> Scalar:
    """V_ref, which is given or follows from the driver's speed."""
    if model.c is not None:
        return model.c
    assert model.v is not None
    return model.v / jnp.sum(model.driving * met.om)


def _flux(model: CushionModel, V_ref: Scalar) -> Scalar:
    return model.m0 * V_ref**2 if model.G is None else model.G * V_ref


def start(model: CushionModel, tension: Scalar) -> Array:
    """Unknowns of a drive at rest in which every span has the same tension."""
    n, q = len(model.pull), jnp.zeros(len(model.frame.K))
    none, P = jnp.zeros(n), jnp.full(n, tension)
    turn = inclined_spans(none, none, q, model.frame).turns
    for _ in range(2):  # the angles hardly depend on the turns
        met = jax.vmap(met_thin)(ArcEnds(P, P, turn, none), model.layers)
        turn = inclined_spans(met.chi_in, met.chi_out, q, model.frame).turns
    return jnp.concatenate([jnp.log(P), turn, q, jnp.zeros(1)])


def solve_thin(model: CushionModel, given: Given, guess: Array) -> Found:
    """The drive with thin layers, near `guess` or by raising the load from none."""
    held = jax.lax.stop_gradient((model, given))
    guess = jax.lax.stop_gradient(guess)

    def residual(x: Array, share: Scalar) -> Array:
        return function(x, (*held, share))[0]

    def function(x: Array, args: tuple[CushionModel, Given, Scalar]) -> tuple[Array, Running]:
        model, given, share = args
        met = jax.vmap(met_thin)(ends_of(x, model), model.layers)
        return equations(x, met, model, given, share)

    found, _ = followed_root(residual, guess, guess, jnp.full(len(guess), _LARGEST))
    good = found.converged & jnp.all(jnp.isfinite(found.root))
    root = jnp.where(good, found.root, guess)
    args = frozen_unless(good, (model, given, jnp.ones(())))
    root, running = implicit_solution(function, args, root)
    error = jnp.max(jnp.abs(running.met.chi_out)) ** 2
    good = good & jnp.all(running.spans.exists)
    left = jnp.max(jnp.abs(found.residual))
    return Found(running, None, root, error, _gross(running), good, left, found.steps)


def wraps(running: Running) -> Pulleys:
    """Angles over which the cords touch."""
    met = running.met
    return running.spans.turns + met.chi_out - met.chi_in


def _gross(running: Running) -> Bool[Array, " n"]:
    return running.met.sliding > _ALL * wraps(running)


class _Search(NamedTuple):
    x: Array
    arcs: Arc
    size: Scalar  # of the last step
    residual: Scalar
    steps: Array


def _ends(x: Array, model: CushionModel, nominal: ArcEnds) -> ArcEnds:
    """What each arc is given; that of a pulley without a cushion is held, and not used."""
    ends, soft = ends_of(x, model), model.layers.soft > 0
    return jax.tree.map(lambda a, b: jnp.where(soft, a, b), ends, nominal)


def _met(x: Array, z: Unknowns, mesh: Array, layers: Layer, model: CushionModel) -> Met:
    """How the belt lies on each pulley, the arcs of those with a cushion given."""
    soft = jax.vmap(met_of)(z, mesh, layers)
    bare = jax.vmap(met_rim)(ends_of(x, model), model.layers)
    return jax.tree.map(lambda a, b: jnp.where(model.layers.soft > 0, a, b), soft, bare)


def _exact(x: Array, args: Any) -> tuple[Array, tuple[Running, Unknowns, Layer]]:
    """Residuals of the drive whose arcs follow x on their meshes."""
    model, given, (arcs, nominal, root) = args
    layers = jax.vmap(cushion.lent)(ends_of(root, model), model.layers)
    z = jax.vmap(lambda one, ends, arc: solved_arc(arc_problem, (one, ends), arc))(
        layers, _ends(x, model, nominal), arcs
    )
    met = _met(x, z, arcs.mesh, layers, model)
    residual, running = equations(x, met, model, given, jnp.ones(()))
    return residual, (running, z, layers)


def solve_exact(model: CushionModel, given: Given, guess: Array, elements: int) -> Found:
    """The drive with the exact geometry of its arcs, near the one of thin layers."""
    of, held_given, x = jax.lax.stop_gradient((model, given, guess))
    layers = jax.vmap(cushion.lent)(ends_of(x, of), of.layers)
    nominal = ends_of(x, of)

    def step(state: _Search, layers: Layer) -> _Search:
        def residual(x: Array, z: Unknowns) -> Array:
            here = _met(x, z, state.arcs.mesh, layers, of)
            return equations(x, here, of, held_given, jnp.ones(()))[0]

        def ends(x: Array) -> ArcEnds:
            return _ends(x, of, nominal)

        steps = jax.vmap(lambda one, ends, arc: arc_step(arc_problem(one, ends), arc))(
            layers, ends(state.x), state.arcs
        )
        move = joint_step(state.x, state.arcs, steps, ends, residual)
        turned = jnp.max(jnp.abs(move.z.y[:, 1])) / _LARGEST
        pulled = jnp.max(jnp.abs(move.z.y[:, 2] / state.arcs.z.y[:, 2])) / _LARGEST
        rows = jnp.max(jnp.abs(state.arcs.z.y), axis=2)  # [n, 4]
        deeper = jnp.max(jnp.max(jnp.abs(move.z.y[:, 0]), axis=1) / rows[:, 0]) / 0.5
        moved = jnp.max(jnp.abs(move.x)) / _LARGEST
        size = jnp.max(jnp.stack([moved, turned, pulled, deeper]))
        part = jnp.minimum(1.0, 1 / size)
        z = jax.tree.map(lambda a, b: a + part * b, state.arcs.z, move.z)
        arcs = state.arcs._replace(z=z)
        left = jnp.maximum(move.residual, jnp.max(steps.residual))
        return _Search(state.x + part * move.x, arcs, size, left, state.steps + 1)

    def going(state: _Search) -> Bool[Array, ""]:
        return (state.size > _CLOSE) & (state.steps < _MOST_STEPS) & (state.size < 1e6)

    def easier(blur: Scalar, share: Scalar) -> Layer:
        easy = jnp.minimum(layers.k_s, _EASY * layers.k_r)
        k_s = layers.k_s ** (1 - share) * easy**share
        return layers._replace(k_s=k_s, blur=jnp.broadcast_to(blur, of.pull.shape))

    def sharper(state: _Search, level: tuple[Scalar, Scalar]) -> tuple[_Search, _Search]:
        blurred = easier(*level)
        begin = state._replace(size=jnp.where(state.size < 1e6, 1.0, jnp.inf))
        end = jax.lax.while_loop(going, lambda state: step(state, blurred), begin)
        again = jax.vmap(moved_arc)(end.arcs)
        return end._replace(arcs=again, steps=jnp.zeros((), int)), end

    first = easier(jnp.asarray(_BLURS[0]), jnp.asarray(_EASED[0]))
    arcs = jax.vmap(lambda one, ends: first_arc(one, ends, elements))(first, nominal)
    zero = jnp.zeros(())
    state = in_lanes_of(x, _Search(x, arcs, zero, zero, jnp.zeros((), int)))
    _, history = jax.lax.scan(sharper, state, (jnp.array(_BLURS), jnp.array(_EASED)))
    last = jax.tree.map(lambda a: a[-1], history)
    good = (last.size <= _CLOSE) & jnp.all(jnp.isfinite(last.x))
    arcs = jax.lax.stop_gradient(jax.tree.map(lambda a, b: jnp.where(good, a, b), last.arcs, arcs))
    root = jnp.where(good, last.x, x)

    # All that is traced goes through the arguments: the rule of the derivative outlives this call.
    args = frozen_unless(good, (model, given))
    held = jax.lax.stop_gradient((arcs, nominal, root))
    root, (running, z, layers) = implicit_solution(_exact, (*args, held), root)
    soft = of.layers.soft > 0
    lacking = jnp.where(soft, jax.vmap(lacking_moment)(z, arcs.mesh, layers), 0.0)
    error = jax.lax.stop_gradient(jnp.max(lacking))
    good = good & jnp.all(running.spans.exists) & (error < _BALANCED)
    # The one before shows what mesh and blur leave out.
    moved = jnp.max(jnp.abs(history.x[-1] - history.x[-2]))
    error = jnp.maximum(error, moved)
    steps = jnp.sum(history.steps)
    gross = _gross(running)
    return Found(running, arcs._replace(z=z), root, error, gross, good, last.residual, steps)
