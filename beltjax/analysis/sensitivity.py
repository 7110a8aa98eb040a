"""Derivatives of Gamma and of the frequencies by the numbers of the drive file."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.analysis.linearization import Linearization, has_inertias, linearize
from beltjax.analysis.modes import Causes, Modes, causes, modes_with_slopes
from beltjax.analysis.steady import SteadyState, steady_state
from beltjax.drive.canonical import canonical, restored
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.numerics.bases import AbstractBasis

Gradient = tuple[Drive, OperatingPoint]


class Sensitivities(NamedTuple):
    """States of a drive, and their derivatives by its numbers."""

    steady: SteadyState
    modes: Modes | None  # None where an inertia is missing, or `count` is 0
    coupling: Gradient  # of Gamma, all spans
    frequencies: Gradient | None  # of each frequency [rad/s], along a leading axis


def sensitivities(
    drive: Drive, point: OperatingPoint, count: int, basis: AbstractBasis
) -> Sensitivities:
    """Steady state and modes, and the total derivatives of Gamma and of the frequencies.

    It never raises for numbers: read the result of each state. Derivatives of a failed state are
    zero.
    """
    found = canonical_sensitivities(*canonical(drive, point), count, basis)
    return in_names_of(drive, point, found)


def in_names_of(drive: Drive, point: OperatingPoint, found: Sensitivities) -> Sensitivities:
    """Sensitivities of the canonical drive and point with the names of `drive` and `point`."""
    frequencies = found.frequencies and restored(found.frequencies, drive, point)
    coupling = restored(found.coupling, drive, point)
    return found._replace(coupling=coupling, frequencies=frequencies)


@eqx.filter_jit
def canonical_sensitivities(
    drive: Drive, point: OperatingPoint, count: int, basis: AbstractBasis
) -> Sensitivities:
    """`sensitivities` of a canonical drive and point.

    All derivatives are pulled back through the steady state at once.
    """
    vibrates = count > 0 and has_inertias(drive)

    def states(
        numbers: Gradient,
    ) -> tuple[tuple[Float[Array, ""], Causes | None], tuple[SteadyState, Linearization | None]]:
        steady = steady_state(*numbers, throw=False)
        linearization = linearize(steady, basis, throw=False) if vibrates else None
        moved = causes(linearization) if linearization is not None else None
        return (jnp.sum(steady.coupling), moved), (steady, linearization)

    (total, _), pull, found = eqx.filter_vjp(states, (drive, point), has_aux=True)
    steady, linearization = found
    if linearization is None:
        return Sensitivities(steady, None, pull((jnp.ones_like(total), None))[0], None)
    modes, slopes = modes_with_slopes(linearization, count)
    # The slopes of Gamma are stacked on those of the frequencies: all are pulled back at once.
    rows = jnp.zeros(count + 1).at[0].set(1.0)
    slopes = jax.tree.map(lambda x: jnp.concatenate([jnp.zeros_like(x[:1]), x]), slopes)
    (gradients,) = jax.vmap(pull)((rows, slopes))
    coupling = jax.tree.map(lambda x: x[0], gradients)
    return Sensitivities(steady, modes, coupling, jax.tree.map(lambda x: x[1:], gradients))
