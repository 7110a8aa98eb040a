"""The search for a belt in contact: at rest, running, or slipping under the largest torques.

One square system in the letters of `physics.contact`: each belt's level of C, the bodies'
coordinates, the factor on the torques, each pulley's wrap and two numbers for each span's shape.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from beltjax.numerics.derivative_rules import frozen_unless
from beltjax.numerics.rigid_bodies import Bodies, Coordinates, holding_stop
from beltjax.numerics.roots import followed_root, implicit_solution
from beltjax.physics.contact import BeltMotion, ContactModel, Loop, Unknown, joined, long_spans

Scalar = Float[Array, ""]
Belts = Float[Array, " belts"]


class HeldBelt(NamedTuple):
    """Properties of the installed belts and springs that stay the same."""

    L0: Belts  # unstretched lengths
    relaxed: Coordinates  # the springs push by this less K q
    at: Coordinates  # where the bodies stand that are bolted


def at_rest(model: ContactModel) -> ContactModel:
    """The same drive without torques and standing still."""
    still = jax.tree.map(jnp.zeros_like, model.motion)._replace(m0=model.motion.m0)
    nothing = jnp.zeros_like(model.pull)
    return model._replace(pull=nothing, loaded=nothing, motion=still)


class Task(NamedTuple):
    """The equations of contact to meet, as data, so that one compiled search serves all."""

    resting: Scalar  # 1: find the springs for the bodies as drawn; 0: belt and springs are `held`
    by_tension: Scalar  # 1: the belt has the `tension`; 0: the length
    maximum: Scalar  # 1: torques scaled until a first pulley slips fully; 0: torques as they are
    tension: Belts  # mean over the spans of the tension at half the arc length
    held: HeldBelt
    bolted: Coordinates  # 1 where a body stands at `held.at`
    adjusted: Coordinates  # 1 where one is moved until the belt has its length, too
    marks: Float[Array, "coordinates coordinates"]  # or until another stands at `held.at`


class Solved(NamedTuple):
    """The root of the equations of contact, and the belt there."""

    unknown: Unknown
    loop: Loop
    held: HeldBelt
    converged: Bool[Array, ""]
    residual: Scalar
    steps: Int[Array, ""]
    load: Scalar  # the part of torques and speed up to which it was followed, if not at once


def solve(model: ContactModel, task: Task, start: Unknown, origin: Unknown) -> Solved:
    """The belt that meets the task, searched from a start that `likely` gives.

    Where that search fails the belt is followed from `origin`, the belt without torques and speed.
    The square system is differentiated at its root.
    """
    args = model, task
    fixed = jax.lax.stop_gradient(args)
    found, load = followed_root(
        lambda x, load: _met(x, _under(load, *fixed))[0],
        _packed(start),
        _packed(origin),
        _packed(_largest(start)),
    )
    converged = found.converged
    # Where no root was found the last one on the way keeps all numbers finite, and shows what
    # stopped it.
    root, loop = implicit_solution(_met, frozen_unless(converged, args), found.root)
    unknown = _unpacked(root, model)
    resting = task.resting > 0
    relaxed = jnp.where(resting, model.K @ unknown.q - loop.push, task.held.relaxed)
    length = jnp.where(task.by_tension > 0, _lengths(loop, model), task.held.L0)
    held = HeldBelt(length, relaxed, jnp.where(task.bolted > 0, unknown.q, task.held.at))
    residual = jnp.max(jnp.abs(found.residual))
    return Solved(unknown, loop, held, converged, residual, found.steps, load)


def likely(C: Belts, q: Coordinates, scale: Scalar, model: ContactModel) -> Unknown:
    """A start for `solve`: C at the tensioners, or the mean over the spans; wraps of long spans.

    It has no derivatives, since a search does not need them.
    """
    C, q, scale, model = jax.lax.stop_gradient((C, q, scale, model))
    offsets, loops = jnp.exp(scale) * jnp.cumsum(model.pull), model.loops
    taken = loops.largest(loops.spread(model.EI) / model.rho**2 / 2)
    # Tensioners hold the tension that they had at rest; locked centers the mean.
    carried = jnp.sum(model.bodies.carries, axis=1)
    count = loops.sums(carried)
    at_tensioners = loops.sums(carried * offsets) / jnp.maximum(count, 1.0)
    kept = jnp.where(count > 0, at_tensioners, loops.means(offsets))
    spare = C - taken - (kept + loops.largest(-offsets))
    level = jnp.log(jnp.maximum(spare, 0.05 * C))
    touching, unshaped = jnp.ones_like(model.rho), jnp.zeros((len(model.rho), 2))
    unknown = Unknown(touching, level, q, scale, unshaped)
    wraps, shape = long_spans(unknown, model)
    return unknown._replace(w=jnp.maximum(wraps, -0.5), shape=shape)


def _largest(start: Unknown) -> Unknown:
    """Largest change in one step: a factor e, 6 degrees, a factor 2, and about 1 for the rest."""
    return Unknown(
        w=jnp.ones_like(start.w),
        level=jnp.ones_like(start.level),
        q=jnp.full_like(start.q, 0.1),
        scale=jnp.array(0.7),
        shape=jnp.broadcast_to(jnp.array([1.5, 0.5]), start.shape.shape),
    )


def _packed(unknown: Unknown) -> Array:
    head = unknown.level, unknown.scale[None], unknown.q, unknown.w
    return jnp.concatenate([*head, unknown.shape.ravel()])


def _unpacked(x: Array, model: ContactModel) -> Unknown:
    sizes = len(model.EI), 1, len(model.floating), len(model.rho)
    level, scale, q, w, shape = jnp.split(x, np.cumsum(sizes))
    return Unknown(w, level, q, scale[0], shape.reshape(-1, 2))


def _met(x: Array, args: tuple[ContactModel, Task]) -> tuple[Array, Loop]:
    """Residuals of the equations at x, and the belt there."""
    unknown = _unpacked(x, args[0])
    loop = joined(unknown, args[0])
    return _equations(unknown, loop, *args), loop


def _equations(unknown: Unknown, loop: Loop, model: ContactModel, task: Task) -> Array:
    """Residuals of tension or belt length, bodies, torques, contacts and spans, of order one."""
    length = (_lengths(loop, model) / task.held.L0 - 1) * model.EA / model.loops.means(loop.C)
    # At rest T = P; whichever the law, nothing else is bent there.
    tension = model.loops.means(loop.spans.P_mid) / task.tension - 1
    spare = jnp.min(jnp.where(model.loaded > 0, loop.wrap - loop.slip, jnp.inf))
    scale = jnp.where(task.maximum > 0, spare, unknown.scale)
    levels = jnp.where(task.by_tension > 0, tension, length)
    # Zero where w is the wrap, or where the wrap is zero and w what is left of the curvature.
    contacts = loop.wrap - loop.touching
    bodies = _bodies(unknown.q, loop, length, model, task)
    return jnp.concatenate([levels, scale[None], bodies, contacts, loop.unmet.ravel()])


def _bodies(q: Coordinates, loop: Loop, length: Belts, model: ContactModel, task: Task) -> Array:
    """Residuals of the bodies' positions.

    Installed by a tension, sprung bodies stand as drawn, and floating ones where the belt leaves no
    push on them together. A bolted one stands where it is, or is moved to fit belt or mark. When
    running each stands where the forces on it balance, or at a stop.
    """
    of = model.bodies
    arm = jnp.sqrt(jnp.maximum(jnp.max(of.carried * _distances(of, model), axis=0), 1e-12))
    size = jnp.mean(loop.C) * jnp.where(of.rotary > 0, arm, 1.0)
    # A body that the balance would move beyond a stop stands at the stop. The residual is zero
    # exactly where the stop's force, which only pushes, balances the other forces.
    free = _force(q, loop.push, model, task.held) / size
    balance = jnp.clip(q + free, of.stops[:, 0], of.stops[:, 1]) - q
    apart = q - model.floating * (model.together.T @ (model.first * q))
    drawn = jnp.where(model.first > 0, model.together @ loop.push / size, apart)
    stands = q + task.marks @ q - task.held.at
    found = jnp.where(task.resting > 0, drawn, balance)
    # An adjusted body fits the belts that it moves.
    moved = jnp.minimum(model.loops.sums(of.carried @ task.adjusted), 1.0)
    return jnp.where(task.adjusted > 0, moved @ length, jnp.where(task.bolted > 0, stands, found))


def _force(q: Coordinates, push: Coordinates, model: ContactModel, held: HeldBelt) -> Coordinates:
    """Force of belt, accessories, springs and the outside together on the bodies."""
    return push + held.relaxed - model.K @ q


def at_stop(solved: Solved, model: ContactModel) -> Coordinates:
    """-1 where a stop holds a body at its least, 1 at its greatest coordinate, else 0."""
    force = _force(solved.unknown.q, solved.loop.push, model, solved.held)
    return holding_stop(model.bodies, solved.unknown.q, force)


def _distances(of: Bodies, model: ContactModel) -> Float[Array, "pulleys coordinates"]:
    """Squares of the distances of the drawn pulleys from the drawn pivots."""
    across = model.x[:, None] - of.pivots[:, 0]
    up = model.y[:, None] - of.pivots[:, 1]
    return across**2 + up**2


def _lengths(loop: Loop, model: ContactModel) -> Belts:
    return model.loops.sums(loop.unstretched + loop.on_pulleys)


def _under(load: Scalar, model: ContactModel, task: Task) -> tuple[ContactModel, Task]:
    """The model and task with this part of the torques and of the speed's square."""
    m0, c, v, G = model.motion
    root = jnp.sqrt(load)
    c, v, G = (None if x is None else root * x for x in (c, v, G))
    return model._replace(pull=load * model.pull, motion=BeltMotion(m0, c, v, G)), task
