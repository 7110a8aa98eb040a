"""A drive in motion as a periodic system with modes, for shooting."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.analysis.motion import Excited
from beltjax.numerics.harmonic_balance import series
from beltjax.numerics.shooting import Periodic
from beltjax.physics.set_valued import hybrid_drive, overruns


def shot_system(excited: Excited, part: Float[Array, ""]) -> Periodic:
    """The drive under that part of the excitation, with all laws that have modes."""
    m, w, harmonics = excited.model, excited.frequency, len(excited.driver) // 2

    def driver(t: Float[Array, ""]) -> Float[Array, ""]:
        return part * (series(w * t, harmonics) @ excited.driver)

    def load(z: Array, rate: Array, t: Float[Array, ""]) -> Float[Array, " size"]:
        return part * (series(w * t, harmonics) @ excited.load)

    system = hybrid_drive(m, driver, load)
    turned = overruns(m)
    rest = len(m.mass) + (0 if m.joints is None else len(m.joints.rows))
    drifts = jnp.concatenate([turned, jnp.zeros((rest, turned.shape[1]))])
    return Periodic(system, 2 * jnp.pi / w, drifts)
