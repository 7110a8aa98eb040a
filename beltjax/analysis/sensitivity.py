"""Derivatives of what an engineer asks about, by the names of the numbers in the drive file."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from beltjax.analysis.steady import SteadyState, steady_state
from beltjax.drive.components import Drive, OperatingPoint

# Choices kept as numbers for the compiler's sake, not numbers of the drive.
_FLAGS = ("name", "face", "driver", "on_arm", "travel", "torque")


def named_numbers(drive: Drive, point: OperatingPoint) -> dict[str, Array]:
    """Every number of a drive and its operating point, by its key in the drive file.

    The keys read "belt.bending_stiffness", "pulley.NAME.radius", "operation.torque.NAME". A
    gradient of a drive is a drive, so this names the parts of a gradient too.
    """
    numbers = _fields("belt", drive.belt)
    for pulley in drive.pulleys:
        numbers |= _fields(f"pulley.{pulley.name}", pulley)
    if drive.tensioner is not None:
        numbers |= _fields("tensioner", drive.tensioner)
    numbers |= _fields("installation", drive.installation)
    numbers |= _fields("operation", point)
    return numbers | {f"operation.torque.{name}": x for name, x in point.torque.items()}


def _fields(table: str, part: Any) -> dict[str, Array]:
    fields = {key: value for key, value in vars(part).items() if key not in _FLAGS}
    return {f"{table}.{key}": value for key, value in fields.items() if value is not None}


@eqx.filter_jit
def coupling_sensitivity(
    drive: Drive, point: OperatingPoint
) -> tuple[SteadyState, tuple[Drive, OperatingPoint]]:
    """The steady state, and the total derivative of Gamma with respect to drive and point.

    Never raises: read the state's `result`. The derivative of a failed state is zero.
    """

    def total(numbers):
        steady = steady_state(*numbers, throw=False)
        return jnp.sum(steady.coupling), steady

    (_, steady), gradient = eqx.filter_value_and_grad(total, has_aux=True)((drive, point))
    return steady, gradient
