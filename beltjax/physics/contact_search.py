"""The search for a belt in contact: at rest, running, or slipping under the largest torques.

One square system in the letters of `physics.contact`: the level of C, the arm's turn, the factor
on the torques, each pulley's wrap and two numbers for the shape of each span.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from beltjax.numerics.derivative_rules import frozen_unless
from beltjax.numerics.roots import followed_root, implicit_solution
from beltjax.physics.contact import ContactModel, Loop, Motion, Unknown, joined, long_spans

Scalar = Float[Array, ""]


class Held(NamedTuple):
    """What an installed belt and spring keep."""

    L0: Scalar  # unstretched length
    wind_up: Scalar  # of the spring, with the arm as drawn


def at_rest(model: ContactModel) -> ContactModel:
    """The same drive without torques and standing still."""
    still = jax.tree.map(jnp.zeros_like, model.motion)._replace(m0=model.motion.m0)
    nothing = jnp.zeros_like(model.pull)
    return model._replace(pull=nothing, loaded=nothing, motion=still)


class Task(NamedTuple):
    """Which equations of contact are to be met; data, so that one compiled search does for all."""

    resting: Scalar  # 1: find the belt for `tension` and the arm as drawn; 0: the belt is `held`
    maximum: Scalar  # 1: torques scaled until a first pulley slips fully; 0: torques as they are
    tension: Scalar  # mean over the spans of the tension at half the arc length
    held: Held


class Solved(NamedTuple):
    """Where the equations of contact are met, and the belt there."""

    unknown: Unknown
    loop: Loop
    held: Held
    converged: Bool[Array, ""]
    residual: Scalar
    steps: Int[Array, ""]
    load: Scalar  # the part of torques and speed up to which it was followed, if not at once


def solve(model: ContactModel, task: Task, start: Unknown, origin: Unknown) -> Solved:
    """The belt that meets the task, searched from a start that `likely` gives.

    Where that leads nowhere it is followed from `origin`, the belt without torques and speed.
    One square system, differentiated at its root.
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
    unknown = _unpacked(root)
    resting = task.resting > 0
    found_here = Held(_length(loop), loop.moment / model.k_r - unknown.turn)
    held = jax.tree.map(lambda a, b: jnp.where(resting, a, b), found_here, task.held)
    residual = jnp.max(jnp.abs(found.residual))
    return Solved(unknown, loop, held, converged, residual, found.steps, load)


def likely(C: Scalar, turn: Scalar, scale: Scalar, model: ContactModel) -> Unknown:
    """A start for `solve`: C at the tensioner, or the mean over the spans; wraps of long spans.

    Only a place to search from: without derivatives.
    """
    C, turn, scale, model = jax.lax.stop_gradient((C, turn, scale, model))
    offsets = jnp.exp(scale) * jnp.cumsum(model.pull)
    taken = jnp.max(model.EI / model.rho**2 / 2)
    # The arm holds the tension that it had at rest; locked centers the mean.
    sprung = jnp.sum(model.carried) > 0
    kept = jnp.where(sprung, model.carried @ offsets, jnp.mean(offsets))
    spare = C - taken - (kept - jnp.min(offsets))
    level = jnp.log(jnp.maximum(spare, 0.05 * C))
    touching, unshaped = jnp.ones_like(model.rho), jnp.zeros((len(model.rho), 2))
    unknown = Unknown(touching, level, turn, scale, unshaped)
    wraps, shape = long_spans(unknown, model)
    return unknown._replace(w=jnp.maximum(wraps, -0.5), shape=shape)


def _largest(start: Unknown) -> Unknown:
    """What one step may change: a factor e, 6 degrees, a factor 2; a radian or so of the rest."""
    return Unknown(
        w=jnp.ones_like(start.w),
        level=jnp.array(1.0),
        turn=jnp.array(0.1),
        scale=jnp.array(0.7),
        shape=jnp.broadcast_to(jnp.array([1.5, 0.5]), start.shape.shape),
    )


def _packed(unknown: Unknown) -> Array:
    head = jnp.stack([unknown.level, unknown.turn, unknown.scale])
    return jnp.concatenate([head, unknown.w, unknown.shape.ravel()])


def _unpacked(x: Array) -> Unknown:
    n = len(x) // 3 - 1
    return Unknown(x[3 : 3 + n], x[0], x[1], x[2], x[3 + n :].reshape(n, 2))


def _met(x: Array, args: tuple[ContactModel, Task]) -> tuple[Array, Loop]:
    """What is left of the equations at x, and the belt there."""
    loop = joined(_unpacked(x), args[0])
    return _equations(_unpacked(x), loop, *args), loop


def _equations(unknown: Unknown, loop: Loop, model: ContactModel, task: Task) -> Array:
    """Tension or belt length, the arm, the torques, contacts and spans; of order one."""
    size = jnp.mean(loop.C)
    length = (_length(loop) / task.held.L0 - 1) * model.EA / size
    # At rest T = P; whichever the law, nothing else is bent there.
    tension = jnp.mean(loop.spans.P_mid) / task.tension - 1
    spring = model.k_r * (task.held.wind_up + unknown.turn)
    moment = (loop.moment - spring) / (size * jnp.sqrt(jnp.sum(model.arm**2)))
    spare = jnp.min(jnp.where(model.loaded > 0, loop.wrap - loop.slip, jnp.inf))
    head = [
        jnp.where(task.resting > 0, tension, length),
        jnp.where(task.resting > 0, unknown.turn, moment),
        jnp.where(task.maximum > 0, spare, unknown.scale),
    ]
    # Zero where w is the wrap, or where the wrap is zero and w what is left of the curvature.
    contacts = loop.wrap - loop.touching
    return jnp.concatenate([jnp.stack(head), contacts, loop.unmet.ravel()])


def _length(loop: Loop) -> Scalar:
    return jnp.sum(loop.unstretched + loop.on_pulleys)


def _under(load: Scalar, model: ContactModel, task: Task) -> tuple[ContactModel, Task]:
    """The same with this part of the torques and of the speed's square."""
    m0, c, v, G = model.motion
    root = jnp.sqrt(load)
    c, v, G = (None if x is None else root * x for x in (c, v, G))
    return model._replace(pull=load * model.pull, motion=Motion(m0, c, v, G)), task
