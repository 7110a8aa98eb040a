"""A drive in motion as a periodic system with modes, for shooting."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.analysis.motion import Excited
from beltjax.numerics.harmonic_balance import derived, series
from beltjax.numerics.shooting import Periodic
from beltjax.physics.motion import Driving
from beltjax.physics.set_valued import hybrid_drive, overruns


def shot_system(excited: Excited, part: Float[Array, ""]) -> Periodic:
    """The drive under that part of the excitation, with all laws that have modes."""
    m, w, harmonics = excited.model, excited.frequency, len(excited.driver) // 2

    by_time = w * derived(excited.driver[:, None])
    course = jnp.stack([excited.driver, by_time[:, 0], w * derived(by_time)[:, 0]], axis=1)

    def driving(t: Float[Array, ""]) -> Driving:
        return Driving(*(part * (series(w * t, harmonics) @ course)))

    def load(z: Array, rate: Array, t: Float[Array, ""]) -> Float[Array, " size"]:
        return part * (series(w * t, harmonics) @ excited.load)

    system = hybrid_drive(m, driving, load)
    turned = overruns(m)
    rest = len(m.mass) + (0 if m.joints is None else len(m.joints.rows))
    drifts = jnp.concatenate([turned, jnp.zeros((rest, turned.shape[1]))])
    return Periodic(system, 2 * jnp.pi / w, drifts)
