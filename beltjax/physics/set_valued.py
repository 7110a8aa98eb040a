"""Dry friction that holds, decouplers and rigid one-way clutches: laws with modes, dimensionless.

    R      friction of a body against its motion, or torque of a joint on its hub
    g      rate of the body's coordinate, or of a joint's wind-up, rim less hub
    s      wind-up of a decoupler's spring

docs/theory/motion.md, (O8) to (O10).
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from beltjax.numerics.hybrid import Elements, HybridSystem, mechanical_system
from beltjax.physics.joints import DECOUPLER
from beltjax.physics.motion import MotionModel, dry_friction, stretching

Scalar = Float[Array, ""]
State = Float[Array, " size"]


def holding(model: MotionModel) -> Bool[Array, " coordinates"]:
    """Which bodies stand still under their friction, which has no speed to turn round at."""
    return (model.friction > 0) & (model.friction_speed == 0)


def hybrid_drive(
    model: MotionModel,
    driver: Callable[[Scalar], Scalar],
    load: Callable[[State, State, Scalar], State],
) -> HybridSystem:
    """The drive in motion in dimensionless time, with modes of its bodies and of its joints.

    `driver(t)` is the rotation of the driver, twice differentiable, and `load(z, z', t)` what acts
    on the coordinates beside the drive itself. States are z, z' and a wind-up s of each joint;
    elements are the bodies, then the joints.
    """
    m, joints = model, model.joints
    size, count = len(m.mass), len(m.friction)
    none = jnp.zeros(0) if joints is None else jnp.zeros(len(joints.rows))

    def turning(t: Scalar) -> Scalar:
        return jax.jvp(driver, (t,), (jnp.ones_like(t),))[1]

    def force(z: State, rate: State, t: Scalar) -> State:
        theta = driver(t)
        found = m.damping @ rate + m.stiffness @ z + stretching(m, z, theta)
        found = found + dry_friction(m, rate) - load(z, rate, t)
        return found if joints is None else found + joints.force(z, rate, theta, turning(t))

    def bounds(z: State, rate: State, t: Scalar) -> tuple[Array, Array]:
        return jnp.append(-m.friction, none), jnp.append(m.friction, none + jnp.inf)

    rows = jnp.eye(size)[size - count :]
    present = holding(m)
    driving, stiffness, damping = none, none, none
    if joints is not None:
        rows = jnp.concatenate([rows, joints.rows])
        present = jnp.concatenate([present, joints.one_way])
        compliant = joints.law == DECOUPLER
        driving = joints.driving
        stiffness = jnp.where(compliant, joints.stiffness, 0.0)
        damping = jnp.where(compliant, joints.damping, 0.0)
    still = jnp.zeros(count)
    elements = Elements(
        rows=rows,
        driven=lambda t: jnp.append(still, driving * turning(t)),
        bounds=bounds,
        present=present,
        stiffness=jnp.append(still, stiffness),
        damping=jnp.append(still, damping),
        springs=len(none),
    )
    return mechanical_system(jnp.linalg.inv(m.mass), force, elements)
