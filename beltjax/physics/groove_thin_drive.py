"""A drive with grooves in which the belt sinks in little: explicit arcs, one small system.

Letters and unknowns are those of `physics.groove_drive`, the arcs `physics.groove_thin`.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from beltjax.numerics.derivative_rules import frozen_unless
from beltjax.numerics.roots import followed_root, implicit_solution
from beltjax.physics.groove_arc import Passed
from beltjax.physics.groove_drive import (
    GrooveBelt,
    GrooveLoop,
    GrooveModel,
    GrooveTask,
    GrooveUnknown,
    chosen,
    ends_of,
    equations,
    flat_arc,
    packed,
    unpacked,
)
from beltjax.physics.groove_measures import GrooveMeasures, told
from beltjax.physics.groove_thin import ThinArc, thin_arc, thin_power_loss
from beltjax.physics.inclined_arcs import ArcEnds

Scalar = Float[Array, ""]


class SolvedThinGrooves(NamedTuple):
    """The state of the drive that meets a task."""

    unknown: GrooveUnknown
    loop: GrooveLoop
    arcs: ThinArc  # each leaf [n, ...]; of flat pulleys a placeholder
    held: GrooveBelt
    ends: ArcEnds
    converged: Bool[Array, ""]
    residual: Scalar
    steps: Int[Array, ""]
    eps: Scalar  # 0: friction is Coulomb's


def solve_thin(model: GrooveModel, task: GrooveTask, start: GrooveUnknown) -> SolvedThinGrooves:
    """The drive that meets the task; it is differentiated at its root."""
    fixed = jax.lax.stop_gradient((model, task))

    def met(
        x: Array, args: tuple[GrooveModel, GrooveTask]
    ) -> tuple[Array, tuple[GrooveLoop, ThinArc, ArcEnds]]:
        model, task = args
        unknown = unpacked(x, start)
        ends = ends_of(unknown, model)
        arcs = jax.vmap(thin_arc)(model.grooves, ends)
        own = Passed(arcs.chi_in, arcs.chi_out, arcs.om, arcs.unstretched)
        at = chosen(model, flat_arc(unknown, model), own)
        spare = jnp.where(model.loaded * (1 - model.flat) > 0, ends.turn - arcs.sliding, jnp.inf)
        value, loop = equations(unknown, at, jnp.min(spare), model, task)
        return value, (loop, arcs, ends)

    def under(load: Scalar) -> tuple[GrooveModel, GrooveTask]:
        model, task = fixed
        return model._replace(pull=load * model.pull), task

    # In one step a factor 1.5 of a tension, 20 degrees and so on.
    largest = GrooveUnknown(
        P=0.4 * start.P,
        turn=jnp.full_like(start.turn, 0.3),
        q=jnp.full_like(start.q, 0.1),
        g=0.4 * jnp.mean(start.P),
        scale=jnp.array(0.5),
    )
    begin = jax.lax.stop_gradient(packed(start))
    found, _ = followed_root(
        lambda x, load: met(x, under(load))[0], begin, begin, packed(jax.lax.stop_gradient(largest))
    )
    good = found.converged
    root, (loop, arcs, ends) = implicit_solution(
        met, frozen_unless(good, (model, task)), found.root
    )
    unknown = unpacked(root, start)
    relaxed = jnp.where(task.resting > 0, model.frame.K @ unknown.q - loop.push, task.held.relaxed)
    length = jnp.where(task.resting > 0, loop.length, task.held.L0)
    return SolvedThinGrooves(
        unknown=unknown,
        loop=loop,
        arcs=arcs,
        held=GrooveBelt(length, relaxed),
        ends=ends,
        converged=good,
        residual=jnp.max(jnp.abs(found.residual)),
        steps=found.steps,
        eps=jnp.zeros(()),
    )


def thin_measures(solved: SolvedThinGrooves, model: GrooveModel) -> GrooveMeasures:
    """The numbers of the drive; layers at the ends of the arcs have no width."""
    arcs, loop = solved.arcs, solved.loop
    loss = jax.vmap(thin_power_loss)(loop.moments, loop.at.om, model.grooves, solved.ends)
    none = jnp.zeros_like(loss)
    wraps = solved.unknown.turn + loop.at.chi_out - loop.at.chi_in
    zones = jnp.stack([none, wraps - arcs.sliding, arcs.sliding, none], axis=-1)
    return told(solved.unknown, loop, model, (loss, loop.moments, jnp.max(arcs.xi, axis=-1), zones))
