"""All about squeal of one drive at once, and its derivatives."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.analysis.damping import Damping
from beltjax.analysis.orders import Orders
from beltjax.analysis.sensitivity import Gradient
from beltjax.analysis.slip_margin import Shaken, SlipMargin, margins_about, shaken_by
from beltjax.analysis.slip_stability import SlipStability, asked_of_slip, stability_about
from beltjax.analysis.steady import steady_state
from beltjax.compiling.kept_programs import run_kept
from beltjax.drive.canonical import restored
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.numerics.bases import Legendre
from beltjax.results import succeeded

BASIS = Legendre(12)  # gives tensions to about 0.1 %
MEASURES = "squeal_speed", "critical_damping", "slip_margin", "dynamic_slip_margin"


class Squeal(NamedTuple):
    """The belt on every pulley."""

    stability: SlipStability
    margins: SlipMargin


class SquealAsked(NamedTuple):
    """What is asked of a drive, beside its sliding speed."""

    shaken: Shaken | None
    damping: Damping


def squeal_asked(
    drive: Drive, point: OperatingPoint, orders: Orders | None, damping: Damping
) -> SquealAsked:
    """The excitation and the damping of vibration; without orders nothing is excited."""
    if orders is None:
        return SquealAsked(None, damping)
    return SquealAsked(shaken_by(drive, point, orders, 1.0), damping)


def squeal(
    drive: Drive,
    point: OperatingPoint,
    asked: SquealAsked,
    sliding_speed: Float[Array, ""] | None = None,
) -> Squeal:
    """Stability and margins of all pulleys; it raises nothing for numbers.

    Raises `ValueError` where a belt has no longitudinal damping.
    """
    given = asked_of_slip(drive, point, None, None)
    return run_kept(_squeal, *given, asked, sliding_speed)


def _squeal(
    drive: Drive,
    point: OperatingPoint,
    places: Array,
    asked: SquealAsked,
    sliding_speed: Float[Array, ""] | None,
) -> Squeal:
    steady = steady_state(drive, point, throw=False)
    stability = stability_about(drive, point, steady, places, sliding_speed)
    margins = margins_about(drive, point, steady, asked.shaken, asked.damping, BASIS)
    return Squeal(stability, margins)


def squeal_slopes(
    drive: Drive, point: OperatingPoint, asked: SquealAsked
) -> dict[tuple[str, str], Gradient]:
    """Derivatives of what squeal is judged by, by measure and pulley.

    Those of a pulley without a law of friction, and of what failed, are zero.
    """
    given = asked_of_slip(drive, point, None, None)
    stacked = run_kept(_slopes, *given, asked)
    names = [(measure, name) for measure in MEASURES for name in drive.pulley_names]
    if asked.shaken is None:
        names = [name for name in names if name[0] != MEASURES[-1]]
    return {
        name: restored(jax.tree.map(lambda x, k=k: x[k], stacked), drive, point)
        for k, name in enumerate(names)
    }


def _slopes(drive: Drive, point: OperatingPoint, places: Array, asked: SquealAsked) -> Gradient:
    """The gradients of all measures along a leading axis, pulled back at once."""

    def values(numbers: Gradient) -> Float[Array, " measures"]:
        found = _squeal(*numbers, places, asked, None)
        margins, numbers_of = found.margins, found.stability
        finite = succeeded(margins.result)
        parts = [numbers_of.onset_speed, numbers_of.critical_damping, margins.static]
        parts += [] if margins.dynamic is None else [margins.dynamic]
        whole = jnp.concatenate(parts)
        return jnp.where(finite & jnp.isfinite(whole), whole, 0.0)

    found, pull = eqx.filter_vjp(values, (drive, point))
    (gradients,) = jax.vmap(pull)(jnp.eye(len(found)))
    return gradients
