"""Dry friction that holds, decouplers and rigid one-way clutches: laws with modes, dimensionless.

    R      friction of a body against its motion, or torque of a joint on its hub
    g      rate of the body's coordinate, or of a joint's wind-up, rim less hub
    s      wind-up of a decoupler's spring

docs/theory/motion.md, (O7) to (O12).
"""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from beltjax.numerics.hybrid import (
    ABOVE,
    BELOW,
    Elements,
    HybridSystem,
    Mode,
    mechanical_system,
)
from beltjax.physics.joints import DECOUPLER
from beltjax.physics.motion import Driving, MotionModel, beside_linear, friction_bounds

Scalar = Float[Array, ""]
State = Float[Array, " size"]


def has_modes(model: MotionModel) -> Bool[Array, ""]:
    """Whether some law of the drive is set-valued."""
    found = jnp.any(model.friction.holds())
    return found if model.joints is None else found | jnp.any(model.joints.one_way)


def friction_power(
    model: MotionModel,
    z: State,
    rate: Float[Array, " coordinates"],
    theta: Scalar,
    mode: Mode,
) -> Float[Array, " coordinates"]:
    """Power of dry friction of each body, whose rates and modes these are."""
    low, high = friction_bounds(model, z, theta)
    held = jnp.where(mode == ABOVE, high, jnp.where(mode == BELOW, low, 0.0))
    return (model.friction.smooth(rate, low, high) + held) * rate


def overruns(model: MotionModel) -> Float[Array, "size joints"]:
    """What turns beyond each one-way joint when its hub gains an angle of 1 on the rim.

    Where that strains nothing; 0 of a joint whose hub is held by something else, and of others.
    """
    m, joints = model, model.joints
    if joints is None or m.rigid is not None:
        return jnp.zeros((len(m.mass), 0 if joints is None else len(joints.rows)))
    fields = len(m.work) * m.functions
    turning = slice(fields, len(m.mass) - len(m.friction.constant))
    rows = jnp.where(joints.one_way[:, None], joints.rows, 0.0)
    apart = m.stiffness - (rows * joints.stiffness[:, None]).T @ rows
    held = apart[:, turning] / jnp.max(jnp.abs(m.stiffness))
    rows = rows[:, turning]
    turned = -jnp.linalg.solve(held.T @ held + rows.T @ rows, rows.T)
    strained = jnp.max(jnp.abs(held @ turned), axis=0) > _STRAINS
    turned = jnp.where(strained | ~joints.one_way, 0.0, turned)
    return jnp.zeros((len(m.mass), len(rows))).at[turning].set(turned)


_STRAINS = 1e-8  # of the largest stiffness


def hybrid_drive(
    model: MotionModel,
    driving: Callable[[Scalar], Driving],
    load: Callable[[State, State, Scalar], State],
) -> HybridSystem:
    """The drive in motion in dimensionless time, with modes of its bodies and of its joints.

    `driving(t)` is what the driver does, whose rate must have a derivative, and `load(z, z', t)`
    what acts on the coordinates beside the drive itself. States are z, z' and a wind-up s of each
    joint; elements are the bodies, then the joints.
    """
    m, joints = model, model.joints
    size, count = len(m.mass), len(m.friction.constant)
    none = jnp.zeros(0) if joints is None else jnp.zeros(len(joints.rows))

    def force(z: State, rate: State, t: Scalar) -> State:
        found = m.damping @ rate + m.stiffness @ z
        return found + beside_linear(m, z, rate, driving(t)) - load(z, rate, t)

    def bounds(z: State, rate: State, t: Scalar) -> tuple[Array, Array]:
        low, high = friction_bounds(m, z, driving(t).theta)
        return jnp.append(low, none), jnp.append(high, none + jnp.inf)

    def beyond(s: Float[Array, " elements"]) -> Float[Array, " elements"]:
        if joints is None:
            return jnp.zeros_like(s)
        return jnp.append(still, jnp.where(compliant, joints.stopped(s[count:]), 0.0))

    rows = jnp.eye(size)[size - count :]
    present = m.friction.holds()
    by_driver, stiffness, damping, compliant = none, none, none, none
    still = jnp.zeros(count)
    if joints is not None:
        rows = jnp.concatenate([rows, joints.rows])
        present = jnp.concatenate([present, joints.one_way])
        compliant = joints.law == DECOUPLER
        by_driver = joints.driving
        stiffness = jnp.where(compliant, joints.stiffness, 0.0)
        damping = jnp.where(compliant, joints.damping, 0.0)
    elements = Elements(
        rows=rows,
        driven=lambda t: jnp.append(still, by_driver * driving(t).rate),
        bounds=bounds,
        present=present,
        stiffness=jnp.append(still, stiffness),
        damping=jnp.append(still, damping),
        beyond=beyond,
        springs=len(none),
    )
    return mechanical_system(jnp.linalg.inv(m.mass), force, elements)
