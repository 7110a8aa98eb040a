"""Dry friction that keeps tensioners still."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from beltjax.analysis.damping import Damping
from beltjax.analysis.linearization import Linearization
from beltjax.analysis.response import Excitation, equations_at, modulus, require_frequencies
from beltjax.compiling.quick import boundary_jit
from beltjax.drive.canonical import strongly_typed
from beltjax.drive.components import as_real
from beltjax.results import frozen_where_failed, raise_unless_successful


def lock_torque(
    linearization: Linearization,
    frequencies: Float[Array, " points"],
    excitation: Excitation,
    names: tuple[str, ...] = (),
    *,
    damping: Damping | None = None,
    throw: bool = True,
) -> Float[Array, "points tensioners"]:
    """Dry friction above which the tensioners do not move under a harmonic excitation.

    It is the amplitude of the force that holds all tensioners still, from one linear solve, and
    grows in proportion to the excitation; docs/theory/motion.md, (O6). With less
    `friction_torque` they slip and stick, or slip all the time. The result is that of the
    linearization; where it failed the numbers are placeholders.

    Args:
        linearization: the drive about its steady state, as `linearize` returns it.
        frequencies: one angular frequency or [points] of them, > 0 [rad/s].
        excitation: crank motion and torques.
        names: `drive.pulley_names`, which are needed where the excitation has torques.
        damping: `Damping()` unless given, which counts the drive's own dampers.
        throw: raise where the linearization failed.

    Returns:
        Torques [N m], or forces [N] of linear tensioners, by frequency; 0 where one is bolted.

    Raises:
        ValueError: frequencies are missing or not positive, or the excitation names a pulley that
            is not there.
        AnalysisError: the linearization failed, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> linearization = bj.linearize(bj.steady_state(drive, point))
        >>> bj.lock_torque(linearization, 400.0, bj.Excitation(crank=0.002))  # [N m]
    """
    damping = Damping() if damping is None else damping
    frequencies = jnp.atleast_1d(as_real(frequencies))
    require_frequencies(frequencies)
    excitation, damping = strongly_typed((excitation, damping))
    lin = strongly_typed(linearization)
    found = _lock_torque(lin, frequencies, excitation.crank, excitation.on(names), damping)
    return raise_unless_successful(found, lin.result, throw)


@boundary_jit
def _lock_torque(
    lin: Linearization,
    frequencies: Float[Array, " points"],
    crank: Complex[Array, ""],
    torques: Complex[Array, " pulleys"] | Complex[Array, "1"],
    damping: Damping,
) -> Float[Array, "points tensioners"]:
    forces = jnp.broadcast_to(torques / lin.scales.energy, (lin.spans,))

    def at(omega: Float[Array, ""]) -> Float[Array, " tensioners"]:
        matrix, load = equations_at(lin, omega, crank, forces, damping)
        free = len(load) - lin.bodies
        z = jnp.linalg.solve(matrix[:free, :free], load[:free])
        held = matrix[free:, :free] @ z - load[free:]
        return modulus(held) * lin.model.movable * lin.scales.energy / lin.units

    return frozen_where_failed(jax.vmap(at)(frequencies * lin.scales.time), lin.result)
