"""Derivatives of a periodic motion's extremes by the numbers of the drive file."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.analysis.damping import Damping
from beltjax.analysis.orders import Orders
from beltjax.analysis.periodic import (
    MotionAsked,
    PeriodicResponse,
    Resolution,
    asked_of,
    motion_asked,
)
from beltjax.analysis.sensitivity import Gradient
from beltjax.compiling.quick import quickly_compiled
from beltjax.drive.canonical import canonical, restored
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive


class MotionSlopes(NamedTuple):
    """What a motion is measured by, and its derivatives."""

    names: tuple[str, ...]  # as quantities of a study, with the name of a part behind a colon
    values: Float[Array, " measures"]
    gradients: tuple[Gradient, ...]


def periodic_sensitivities(
    drive: Drive,
    point: OperatingPoint,
    orders: Orders,
    resolution: Resolution,
    damping: Damping,
    belt_speed: str = "constant",
) -> MotionSlopes:
    """Total derivatives of a motion's measures by all numbers of the drive and the point.

    The excitation stays as it is. Derivatives of a motion that was not found are zero, and those
    of one by `Shooting` NaN where they do not exist. Raises `ValueError` as `periodic_response`.
    """
    asked = asked_of(drive, point, orders, resolution, damping, belt_speed, stability=False)
    values, stacked = quickly_compiled(_slopes)(*canonical(drive, point), asked)
    names = _names(drive)
    gradients = tuple(
        restored(jax.tree.map(lambda x, k=k: x[k], stacked), drive, point)
        for k in range(len(names))
    )
    return MotionSlopes(names, values, gradients)


def _slopes(
    drive: Drive, point: OperatingPoint, asked: MotionAsked
) -> tuple[Float[Array, " measures"], Gradient]:
    """Values, and the gradients of all along a leading axis, pulled back at once."""

    def values(numbers: Gradient) -> Float[Array, " measures"]:
        return _measured(motion_asked(*numbers, asked))

    found, pull = eqx.filter_vjp(values, (drive, point))
    (gradients,) = jax.vmap(pull)(jnp.eye(len(found)))
    return found, gradients


def _measured(found: PeriodicResponse) -> Float[Array, " measures"]:
    m = found.measures
    parts = (
        m.travels,
        m.rotation_amplitudes,
        m.hub_load_max,
        found.friction_use,
        m.tension_min,
        m.tension_max,
        m.span_peaks,
    )
    return jnp.concatenate(parts)


def _names(drive: Drive) -> tuple[str, ...]:
    """Names of what `_measured` returns."""
    tensioners = [body.name for body in drive.tensioners]
    pulleys, spans = drive.pulley_names, drive.span_names
    parts = (
        ("travel", tensioners),
        ("rotation", pulleys),
        ("hub_load_max", pulleys),
        ("friction_use", pulleys),
        ("tension_min", spans),
        ("tension_max", spans),
        ("span_deflection", spans),
    )
    return tuple(f"{measure}:{name}" for measure, names in parts for name in names)
