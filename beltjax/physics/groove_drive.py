"""A drive whose belt wedges in the grooves of some pulleys and lies on others, in one system.

Unknowns are those of `GrooveUnknown` and the arcs of all grooves; each Newton step eliminates the
arcs, whose response to their ends is known, and solves for the rest. Friction is viscous below a
sliding speed eps, which is lowered level by level. Letters as in `physics.groove` and
`physics.inclined_spans`. docs/theory/grooves.md, (W7) to (W11).
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_batching import sequential_vmap
from jaxtyping import Array, Bool, Float, Int

from beltjax.compiling.batched_loops import in_lanes_of
from beltjax.numerics.bvp.collocation import Unknowns
from beltjax.numerics.derivative_rules import frozen_unless, without_slopes
from beltjax.numerics.rigid_bodies import Coordinates
from beltjax.numerics.roots import implicit_solution
from beltjax.physics.contact import BeltMotion
from beltjax.physics.groove import Flanks
from beltjax.physics.groove_arc import (
    Passed,
    arc_problem,
    first_arc,
    groove_step,
    moved_arc,
    passed,
    seating_stiffness,
    states,
)
from beltjax.physics.inclined_arcs import Arc, ArcEnds, joint_step, on_rim, solved_arc
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

COARSEST = 1.0  # eps of the first level
RATIO = 0.3  # of eps from level to level, at most
SMALLEST = -0.12  # log of the ratio, above which the way down ends
MOST_LEVELS = 24
MOST_STEPS = 14  # of Newton's method, a level
NEAR = 1e-3  # a step below it ends a level
CLOSE = 1e-10  # likewise, of the last one
SLOW = 5e-4  # sliding speed over V_ref below which the belt is said to adhere


class GrooveModel(NamedTuple):
    """A drive of one belt, along its travel."""

    frame: Frame
    grooves: Flanks  # each leaf [n]; of flat pulleys `flat_groove`
    flat: Pulleys  # 1 where the pulley has no groove
    mu: Pulleys  # of flat pulleys
    EA: Scalar
    pull: Pulleys  # M/R that each pulley takes; the driver's is not used
    driving: Pulleys
    loaded: Pulleys  # 1 where there is torque, at rest or not
    motion: BeltMotion


class GrooveUnknown(NamedTuple):
    """The unknowns of the drive besides its arcs."""

    P: Pulleys  # of each span
    turn: Pulleys
    q: Coordinates
    g: Scalar
    scale: Scalar  # log of the factor on all torques


class GrooveBelt(NamedTuple):
    """Properties of the installed belt and springs that stay the same."""

    L0: Scalar
    relaxed: Coordinates  # the springs push by this less K q


class GrooveTask(NamedTuple):
    """What is asked, as data, so that one compiled search serves all."""

    resting: Scalar  # 1: the springs follow, the bodies stand as drawn; 0: belt and springs held
    tension: Scalar  # mean over the spans, at rest
    limit: Scalar  # 0: torques as they are; 1: up to the slip limit; 2: to the limit of adhesion
    slip: Scalar  # largest slip allowed, of limit 1
    scale: Scalar  # log of the factor on the torques, of limit 0
    held: GrooveBelt


class GrooveLoop(NamedTuple):
    """The drive for given unknowns."""

    at: Passed  # each leaf [n]
    spans: InclinedSpans
    V_ref: Scalar
    stretch: Pulleys  # of the spans
    moments: Pulleys
    slip: Pulleys  # 1 - om/om of the driver
    length: Scalar  # unstretched, of the whole belt
    push: Coordinates


class SolvedGrooves(NamedTuple):
    """The state of the drive that meets a task."""

    unknown: GrooveUnknown
    loop: GrooveLoop
    arcs: Arc  # each leaf [n]; of flat pulleys a placeholder
    held: GrooveBelt
    grooves: Flanks
    ends: ArcEnds
    converged: Bool[Array, ""]
    residual: Scalar
    steps: Int[Array, ""]
    eps: Scalar  # the last level that was solved
    coarser: "Coarser"


class Coarser(NamedTuple):
    """The same drive, not differentiated, with a larger eps: it shows what eps does."""

    unknown: GrooveUnknown
    loop: GrooveLoop
    arcs: Arc
    grooves: Flanks


def flat_groove(R: Pulleys, tension: Scalar, EA: Scalar, eps: Scalar) -> tuple[Flanks, ArcEnds]:
    """A groove and ends that are easy to solve, in the place of those of a flat pulley."""
    one = jnp.ones_like(R)
    beta, mu = 0.35 * one, 0.3 * one
    K = 50 * tension / (R**2 * 2 * jnp.tan(beta + jnp.arctan(mu)))
    EA = jnp.broadcast_to(EA, R.shape)
    groove = Flanks(R, beta, mu, K, EA, eps * one)
    return groove, ArcEnds(tension * one, tension * one, 2.5 * one, 0 * one)


def at_rest(model: GrooveModel) -> GrooveModel:
    """The same drive turned slowly without torque."""
    still = jax.tree.map(jnp.zeros_like, model.motion)._replace(m0=model.motion.m0)
    nothing = jnp.zeros_like(model.pull)
    return model._replace(pull=nothing, loaded=nothing, motion=still)


def _with_eps(model: GrooveModel, eps: Scalar) -> GrooveModel:
    spread = jnp.broadcast_to(eps, model.grooves.eps.shape)
    return model._replace(grooves=model.grooves._replace(eps=spread))


def ends_of(unknown: GrooveUnknown, model: GrooveModel) -> ArcEnds:
    """What each arc is given; flat pulleys are given what `flat_groove` is."""
    P = unknown.P
    g = jnp.broadcast_to(unknown.g, P.shape)
    ends = ArcEnds(model.frame.loops.preceding(P), P, unknown.turn, g)
    nominal = flat_groove(model.grooves.R, jnp.ones(()), model.EA, jnp.ones(()))[1]
    return jax.tree.map(lambda a, b: jnp.where(model.flat > 0, a, b), nominal, ends)


def flat_arc(unknown: GrooveUnknown, model: GrooveModel) -> Passed:
    """What flat pulleys pass on."""
    P = unknown.P
    ends = ArcEnds(model.frame.loops.preceding(P), P, unknown.turn, unknown.g)
    rim = on_rim(ends, jnp.abs(model.frame.rho), model.mu, model.EA)
    none = jnp.zeros_like(P)
    return Passed(none, none, rim.om, rim.unstretched)


def loop_of(unknown: GrooveUnknown, at: Passed, model: GrooveModel) -> GrooveLoop:
    """The drive whose arcs pass this on."""
    frame, EA, g = model.frame, model.EA, unknown.g
    spans = inclined_spans(at.chi_in, at.chi_out, unknown.q, frame)
    stretch = (EA + unknown.P) / (EA - g)
    taken = moments(unknown.P, at.chi_in, at.chi_out, frame)
    driver = model.driving @ at.om
    housed = model.pull * jnp.abs(frame.rho) * jnp.exp(unknown.scale)
    _, c, v, _ = model.motion
    V_ref = c if c is not None else v / driver  # pyright: ignore[reportOptionalOperand]
    return GrooveLoop(
        at=at,
        spans=spans,
        V_ref=V_ref,
        stretch=stretch,
        moments=taken,
        slip=1 - at.om / driver,
        length=jnp.sum(spans.lengths / stretch) + jnp.sum(at.unstretched),
        push=push(unknown.P, housed, spans, unknown.q, frame),
    )


def _flux(V_ref: Scalar, model: GrooveModel) -> Scalar:
    m0, _, _, G = model.motion
    return m0[0] * V_ref**2 if G is None else G * V_ref


def equations(
    unknown: GrooveUnknown, at: Passed, spare: Scalar, model: GrooveModel, task: GrooveTask
) -> tuple[Array, GrooveLoop]:
    """Residuals of order one, and the drive; `spare` vanishes at the limit of adhesion."""
    loop, level = loop_of(unknown, at, model), jnp.mean(unknown.P)
    wanted = model.pull * jnp.exp(unknown.scale)
    balance = (loop.moments / jnp.abs(model.frame.rho) - wanted) / level
    length = (loop.length / task.held.L0 - 1) * model.EA / level
    T = unknown.P + unknown.g * loop.stretch
    total = jnp.where(task.resting > 0, jnp.mean(T) / task.tension - 1, length)
    force = loop.push + task.held.relaxed - model.frame.K @ unknown.q
    bodies = body_residuals(unknown.q, force, unknown.P, model.frame)
    bodies = jnp.where(task.resting > 0, unknown.q, bodies)
    worst = jnp.max(jnp.where(model.loaded * (1 - model.driving) > 0, loop.slip, -1.0))
    limits = [unknown.scale - task.scale, 10 * (worst - task.slip), spare]
    limit = jnp.stack(limits)[task.limit.astype(int)]
    residuals = jnp.concatenate(
        [
            jnp.where(model.driving > 0, total, balance),
            unknown.turn - loop.spans.turns,
            bodies,
            (unknown.g - _flux(loop.V_ref, model))[None] / level,
            limit[None],
        ]
    )
    return residuals, loop


def adhering(arcs: Arc, model: GrooveModel) -> Scalar:
    """Log of the least sliding speed over that at which adhesion is said to end, of the worst."""
    at = jax.vmap(states)(arcs.z.y, arcs.z.p, model.grooves)
    least = jnp.min(jnp.log(at.w[:, 1:-1] / slow(model.grooves.eps)[:, None]), axis=1)
    grooved = model.loaded * (1 - model.flat)
    return jnp.max(jnp.where(grooved > 0, least, -jnp.inf)) / 10


class _GrooveSearch(NamedTuple):
    """A search by Newton's method at one level of eps."""

    unknown: GrooveUnknown
    arcs: Arc
    size: Scalar  # of the whole last step, over the largest that is taken
    part: Scalar  # of the step that is taken
    residual: Scalar
    steps: Int[Array, ""]


def slow(eps: Array) -> Array:
    """Sliding speed below which the belt is said to adhere; where friction is viscous it creeps."""
    return jnp.maximum(SLOW, 5 * eps)


def packed(unknown: GrooveUnknown) -> Array:
    """All unknowns in one vector."""
    return jnp.concatenate([jnp.ravel(x) for x in unknown])


def unpacked(x: Array, like: GrooveUnknown) -> GrooveUnknown:
    """The unknowns of a vector, in the shapes of `like`."""
    sizes = [leaf.size for leaf in like]
    parts = jnp.split(x, np.cumsum(sizes)[:-1])
    return GrooveUnknown(*(x.reshape(jnp.shape(of)) for x, of in zip(parts, like, strict=True)))


def _newton(state: _GrooveSearch, model: GrooveModel, task: GrooveTask) -> _GrooveSearch:
    unknown, arcs = state.unknown, state.arcs
    steps = jax.vmap(groove_step)(arcs, model.grooves, ends_of(unknown, model))

    def met(x: Array, z: Unknowns) -> Array:
        moved = unpacked(x, unknown)
        at = jax.vmap(passed)(z, arcs.mesh, model.grooves)
        mixed = chosen(model, flat_arc(moved, model), at)
        return equations(moved, mixed, adhering(arcs._replace(z=z), model), model, task)[0]

    def ends(x: Array) -> ArcEnds:
        return ends_of(unpacked(x, unknown), model)

    move, flat = joint_step(packed(unknown), arcs, steps, ends, met), model.flat > 0

    def kept(change: Array) -> Array:
        # What stands in the place of a smooth pulley stays as it is.
        return jnp.where(flat.reshape(-1, *(1,) * (change.ndim - 1)), 0.0, change)

    dz = jax.tree.map(kept, move.z)
    d = unpacked(move.x, unknown)
    size = _size(d, dz, unknown, arcs)
    # Steps that hardly become shorter jump across the turn of the friction: half of one does not.
    slower = (size > (1 - 0.5 * state.part) * state.size) & (size > 1e-3)
    part = jnp.where(slower, jnp.maximum(state.part / 2, 1 / 8), jnp.minimum(2 * state.part, 1.0))
    part = jnp.where(size <= 1e-3, 1.0, jnp.minimum(part, 1 / size))
    return _GrooveSearch(
        unknown=jax.tree.map(lambda a, b: a + part * b, unknown, d),
        arcs=arcs._replace(z=jax.tree.map(lambda a, b: a + part * b, arcs.z, dz)),
        size=size,
        part=part,
        residual=jnp.maximum(move.residual, jnp.max(jnp.where(flat, 0.0, steps.residual))),
        steps=state.steps + 1,
    )


def _size(d: GrooveUnknown, dz: Unknowns, unknown: GrooveUnknown, arcs: Arc) -> Scalar:
    """A step over the largest that is taken at once: 0.15 rad, two fifths of a tension, ..."""
    sizes = [
        jnp.max(jnp.abs(dz.y[:, 1])) / 0.15,
        jnp.max(jnp.abs(dz.y[:, 2] / arcs.z.y[:, 2])) / 0.4,
        jnp.max(jnp.abs(d.P / unknown.P)) / 0.4,
        jnp.max(jnp.abs(d.turn)) / 0.3,
        jnp.abs(d.scale) / 0.7,
        *([jnp.max(jnp.abs(d.q)) / 0.15] if d.q.size else []),
    ]
    return jnp.max(jnp.stack(sizes))


class _GrooveLevel(NamedTuple):
    """The way down in eps."""

    unknown: GrooveUnknown
    arcs: Arc
    eps: Scalar  # of these two
    before: tuple[GrooveUnknown, Arc, Scalar]  # of the level before
    step: Scalar  # log of the ratio of levels
    done: Bool[Array, ""]
    residual: Scalar
    tries: Int[Array, ""]
    steps: Int[Array, ""]


def solve(
    model: GrooveModel, task: GrooveTask, start: GrooveUnknown, elements: int
) -> SolvedGrooves:
    """The drive that meets the task, from a start that need not be close.

    The square system is differentiated at its root, on a mesh that is held.
    """
    found, arcs, evidence = _in_turn(elements)(model, task, start)
    return _with_derivatives(found, arcs, model, task, evidence)


@functools.cache
def _in_turn(elements: int) -> Callable[..., Any]:
    """`_searched`, which in a batch runs lane by lane.

    Lanes need very different numbers of steps, and the 400 elements of one fill a core's vectors
    as well as those of many: side by side, all would wait for the slowest at each level.
    """
    return without_slopes(sequential_vmap(functools.partial(_searched, elements)))


def _searched(
    elements: int, held_model: GrooveModel, task: GrooveTask, start: GrooveUnknown
) -> tuple[GrooveUnknown, Arc, tuple[Any, ...]]:
    """The root, its arcs, and the evidence for it; without derivatives."""
    # The limit of adhesion is at the factor that is given: whoever finds it calls this repeatedly.
    held_task = task._replace(limit=jnp.where(task.limit == 2, 0.0, task.limit))
    eps = jnp.max(held_model.grooves.eps)
    coarse = jnp.maximum(eps, COARSEST)
    count = jnp.maximum(jnp.ceil(jnp.log(coarse / eps) / -np.log(RATIO)), 1.0)
    first = _with_eps(held_model, coarse)
    arcs = jax.vmap(lambda of, ends: first_arc(of, ends, elements))(
        first.grooves, ends_of(start, first)
    )

    def unfinished(at: _GrooveLevel) -> Bool[Array, ""]:
        return ~at.done & (at.tries < MOST_LEVELS) & (at.step < SMALLEST)

    def level(at: _GrooveLevel) -> _GrooveLevel:
        last = at.eps <= eps * (1 + 1e-9)  # nothing is left but to solve on a mesh of its own
        begun = at.eps > coarse
        # A belt that hardly feels friction may sink in too deep: then one that feels more.
        start_at = jnp.where(at.tries == 0, coarse, jnp.maximum(eps, coarse / 10))
        aim = jnp.where(begun, start_at, jnp.maximum(eps, at.eps * jnp.exp(at.step)))
        aim = jnp.where(aim < eps * (1 + 1e-6), eps, aim)
        now, close = _with_eps(held_model, aim), jnp.where(last, CLOSE, NEAR)
        most = jnp.where(begun, 2 * MOST_STEPS, MOST_STEPS)

        def going(search: _GrooveSearch) -> Bool[Array, ""]:
            return (search.size > close) & (search.steps < most) & (search.size < 1e6)

        begin = _GrooveSearch(
            at.unknown, at.arcs, jnp.array(1e5), jnp.ones(()), at.residual, at.tries
        )
        begin = begin._replace(steps=jnp.zeros_like(at.tries))
        end = jax.lax.while_loop(going, lambda search: _newton(search, now, held_task), begin)
        fine = end.size <= close
        moved = jax.vmap(moved_arc)(end.arcs, now.grooves)
        # The last solution stays on the mesh on which it solves the equations.
        arcs = jax.tree.map(lambda a, b: jnp.where(last, a, b), end.arcs, moved)
        after = end.unknown, arcs, aim, last
        before = at.unknown, at.arcs, at.eps, jnp.zeros_like(at.done)
        unknown, arcs, reached, done = jax.tree.map(
            lambda a, b: jnp.where(fine, a, b), after, before
        )
        kept = jax.tree.map(
            lambda a, b: jnp.where(fine & ~last & ~begun, a, b), before[:3], at.before
        )
        halved = jnp.where(begun & (at.tries == 0), at.step, at.step / 2)
        halved = jnp.where(last | (begun & (at.tries > 0)), 0.0, halved)
        return _GrooveLevel(
            unknown=unknown,
            arcs=arcs,
            eps=reached,
            before=kept,
            step=jnp.where(fine, at.step, halved),
            done=done,
            residual=jnp.where(fine, end.residual, at.residual),
            tries=at.tries + 1,
            steps=at.steps + end.steps,
        )

    none = jnp.array(0)
    step = jnp.minimum(jnp.log(eps / coarse) / count, jnp.log(0.9))
    # Above the first level: it is not reached yet.
    above = 2 * coarse
    state = _GrooveLevel(
        unknown=start,
        arcs=arcs,
        eps=above,
        before=(start, arcs, above),
        step=step,
        done=jnp.array(False),
        residual=jnp.zeros(()),
        tries=none,
        steps=none,
    )
    end = jax.lax.while_loop(unfinished, level, in_lanes_of(start.P, state))
    unknown, arcs, coarser = end.before
    before = _coarser(unknown, arcs, _with_eps(held_model, coarser))
    return end.unknown, end.arcs, (end.done, end.residual, end.steps, end.eps, before)


def _coarser(unknown: GrooveUnknown, arcs: Arc, model: GrooveModel) -> Coarser:
    at = jax.vmap(passed)(arcs.z, arcs.mesh, model.grooves)
    at = chosen(model, flat_arc(unknown, model), at)
    return Coarser(unknown, loop_of(unknown, at, model), arcs, model.grooves)


def chosen(model: GrooveModel, flat: Passed, grooved: Passed) -> Passed:
    """What flat and grooved pulleys pass on."""
    return jax.tree.map(lambda a, b: jnp.where(model.flat > 0, a, b), flat, grooved)


def _with_derivatives(
    found: GrooveUnknown,
    arcs: Arc,
    model: GrooveModel,
    task: GrooveTask,
    evidence: tuple[Any, ...],
) -> SolvedGrooves:
    good, residual, count, last, coarser = evidence

    def function(x: Array, args: tuple[GrooveModel, GrooveTask, Arc]) -> tuple[Array, Any]:
        model, task, arcs = args
        unknown = unpacked(x, found)
        ends = ends_of(unknown, model)
        z = jax.vmap(lambda of, ends, arc: solved_arc(arc_problem, (of, ends), arc))(
            model.grooves, ends, arcs
        )
        at = jax.vmap(passed)(z, arcs.mesh, model.grooves)
        at = chosen(model, flat_arc(unknown, model), at)
        value, loop = equations(unknown, at, adhering(arcs._replace(z=z), model), model, task)
        return value, (loop, z, ends)

    args = (*frozen_unless(good, (model, task)), jax.lax.stop_gradient(arcs))
    root, (loop, z, ends) = implicit_solution(function, args, packed(found))
    unknown = unpacked(root, found)
    relaxed = jnp.where(task.resting > 0, model.frame.K @ unknown.q - loop.push, task.held.relaxed)
    length = jnp.where(task.resting > 0, loop.length, task.held.L0)
    return SolvedGrooves(
        unknown=unknown,
        loop=loop,
        arcs=arcs._replace(z=z),
        held=GrooveBelt(length, relaxed),
        grooves=model.grooves,
        ends=ends,
        converged=good,
        residual=residual,
        steps=count,
        eps=last,
        coarser=coarser,
    )


def likely_tension(L0: Scalar, model: GrooveModel) -> Scalar:
    """About the tension of a belt of this length on locked pulleys that turn slowly.

    It sinks in as far as it does where it adheres, and that shortens its path.
    """
    none = jnp.zeros_like(model.pull)
    q = jnp.zeros(len(model.frame.bodies.rotary))
    spans, radius = inclined_spans(none, none, q, model.frame), jnp.abs(model.frame.rho)
    path = jnp.sum(spans.lengths) + spans.turns @ radius
    sunk = spans.turns * (1 - model.flat) / (seating_stiffness(model.grooves) * radius)
    return (path - L0) / (L0 / model.EA + jnp.sum(sunk))


def likely(tension: Scalar, q: Coordinates, scale: Scalar, model: GrooveModel) -> GrooveUnknown:
    """A start for `solve`: tensions about a given mean, turns of a belt that does not sink in."""
    tension, q, scale, model = jax.lax.stop_gradient((tension, q, scale, model))
    offsets = jnp.exp(scale) * jnp.cumsum(model.pull)
    offsets = offsets - jnp.mean(offsets)
    _, c, v, _ = model.motion
    speed = c if c is not None else v
    g = jnp.minimum(_flux(speed, model), 0.5 * tension)  # pyright: ignore[reportArgumentType]
    mean = tension - g
    # The slack span keeps a fifth of the mean tension at least.
    mean = jnp.maximum(mean, 0.25 * mean - jnp.min(offsets))
    none = jnp.zeros_like(model.pull)
    turns = inclined_spans(none, none, q, model.frame).turns
    return GrooveUnknown(mean + offsets, turns, q, g, scale)
