"""Derivatives of what an engineer asks about, by the names of the numbers in the drive file."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from beltjax.analysis.linearization import has_inertias, linearize
from beltjax.analysis.modes import Modes, causes, modes_with_slopes
from beltjax.analysis.steady import SteadyState, steady_state
from beltjax.drive.canonical import canonical, restored
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.numerics.bases import AbstractBasis

Gradient = tuple[Drive, OperatingPoint]


class Sensitivities(NamedTuple):
    """States of a drive, and how its numbers move them."""

    steady: SteadyState
    modes: Modes | None  # None where an inertia is missing, or none are asked for
    coupling: Gradient  # of Gamma, all spans
    frequencies: Gradient | None  # of each frequency [rad/s], along a leading axis


def sensitivities(drive: Drive, point: OperatingPoint, count: int, basis) -> Sensitivities:
    """Steady state and exact modes, and the total derivatives of Gamma and of the frequencies.

    Never raises for numbers: read each state's result. Derivatives of a failed state are zero.
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

    Everything is pulled back through the steady state at once.
    """
    vibrates = count > 0 and has_inertias(drive)

    def states(numbers):
        steady = steady_state(*numbers, throw=False)
        linearization = linearize(steady, basis, throw=False) if vibrates else None
        moved = causes(linearization) if linearization is not None else None
        return (jnp.sum(steady.coupling), moved), (steady, linearization)

    (total, _), pull, found = eqx.filter_vjp(states, (drive, point), has_aux=True)
    steady, linearization = found
    if linearization is None:
        return Sensitivities(steady, None, pull((jnp.ones_like(total), None))[0], None)
    modes, slopes = modes_with_slopes(linearization, count)
    # Gamma's own slopes go with those of the frequencies, so that all are pulled back at once.
    rows = jnp.zeros(count + 1).at[0].set(1.0)
    slopes = jax.tree.map(lambda x: jnp.concatenate([jnp.zeros_like(x[:1]), x]), slopes)
    (gradients,) = jax.vmap(pull)((rows, slopes))
    coupling = jax.tree.map(lambda x: x[0], gradients)
    return Sensitivities(steady, modes, coupling, jax.tree.map(lambda x: x[1:], gradients))
