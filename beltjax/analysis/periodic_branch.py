"""Branches of periodic motions over a number of the drive, past their folds."""

import dataclasses
from collections.abc import Callable
from typing import Any, Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from beltjax.analysis.damping import Damping
from beltjax.analysis.motion import oscillator
from beltjax.analysis.orders import Orders
from beltjax.analysis.periodic import (
    HarmonicBalance,
    MotionAsked,
    PeriodicResponse,
    Prepared,
    Resolution,
    asked_of,
    described,
    prepared,
)
from beltjax.compiling.quick import quickly_compiled, usual_promotion
from beltjax.drive.canonical import canonical
from beltjax.drive.numbers import canonical_key, require_number, unit_of, with_number
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.numerics.bases import AbstractBasis
from beltjax.numerics.harmonic_balance import Coefficients, Oscillator
from beltjax.numerics.periodic import known_orbit, periodic_orbit
from beltjax.numerics.periodic_branch import (
    Corrected,
    Units,
    Vector,
    corrected,
    doublings,
    start_of,
    walked,
)
from beltjax.results import RESULTS, raise_unless_successful

_FIRST_STEP = 0.1


@dataclasses.dataclass(frozen=True, eq=False)
class PeriodicBranch:
    """Periodic motions along a branch, in the order in which it was followed."""

    name: str  # of the number, by its key in the drive file
    unit: str  # SI
    values: Float[np.ndarray, " points"]  # of that number [SI]; they may turn back
    responses: tuple[PeriodicResponse, ...]
    folds: Float[np.ndarray, " folds"]  # where the branch turns back
    flips: Float[np.ndarray, " flips"]  # where the period doubles, between two points
    complete: bool  # whether the branch was followed to an end of the range

    @property
    def stable(self) -> np.ndarray:
        """Whether each motion is stable [points]."""
        return np.array([bool(one.stable) for one in self.responses])


class _Question:
    """The drive over the values of one number, for compiled code."""

    def __init__(self, drive: Drive, point: OperatingPoint, name: str, asked: MotionAsked):
        self.drive, self.point = canonical(drive, point)
        self.name, self.asked = canonical_key(drive, name), asked

    def __call__(self, function: Callable, *given: Any) -> Any:
        numbers = self.drive, self.point, self.name, self.asked
        return quickly_compiled(function)(*numbers, *given)


@usual_promotion
def periodic_branch(
    drive: Drive,
    point: OperatingPoint,
    orders: Orders | None,
    start: float,
    end: float,
    *,
    over: str = "operation.driver_speed",
    harmonics: int = 12,
    samples: int | None = None,
    functions: int = 12,
    basis: AbstractBasis | None = None,
    damping: Damping | None = None,
    belt_speed: Literal["constant", "varying"] = "constant",
    most: int = 400,
    throw: bool = True,
) -> PeriodicBranch:
    """Periodic motions over a number of the drive, from `start` towards `end`, through folds.

    The first is that of `periodic_response`. From there the branch is followed by arc length
    until the number leaves the range on either side, so that one that folds comes back: between
    two folds there are three motions, of which the middle one is unstable. Folds are refined,
    flips lie between two points. It cannot be traced or differentiated. Of a branch that could not
    be followed to an end of the range `complete` is False: look for a kink, or give more samples.

    Args:
        drive: the drive.
        point: speeds and torques.
        orders: what excites the drive; None for the point's own `excitation`.
        start: the number at which the branch begins [SI].
        end: the other end of the range [SI].
        over: the number's key in the drive file.
        harmonics: as in `periodic_response`, as are the next four.
        samples: points of time at which forces are evaluated.
        functions: for the deflection of each span.
        basis: functions for the deflections in place of these.
        damping: `Damping()` unless given, which counts the drive's own dampers.
        belt_speed: as in `periodic_response`.
        most: number of points after which it is given up.
        throw: raise where the first motion is not found.

    Returns:
        The points of the branch, each with its motion.

    Raises:
        ValueError: there is no number of that name, `start` and `end` are equal or not finite, or
            as `periodic_response` does.
        AnalysisError: the first motion is not found, and `throw` is set; otherwise the branch then
            has no points.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> orders = bj.Orders({2: bj.Excitation(crank=0.002)})  # [rad]
        >>> options = {"damping": bj.Damping(modal=0.02), "functions": 4, "harmonics": 4}
        >>> branch = bj.periodic_branch(drive, point, orders, 230.0, 200.0, **options)
        >>> branch.values, branch.folds  # [rad/s]
    """
    require_number(drive, over)
    if not (np.isfinite(start) and np.isfinite(end) and start != end):
        raise ValueError(f"start, end: found {start:g}, {end:g}; give two different numbers.")
    resolution = Resolution(harmonics, samples, functions, basis)
    asked = asked_of(drive, point, orders, resolution, damping, belt_speed, HarmonicBalance())
    ask = _Question(drive, point, over, asked)
    first = jnp.asarray(float(start))
    found, result = ask(_first, first)
    raise_unless_successful(found, result, throw)
    unit = unit_of(drive, over)
    none = np.zeros(0)
    if result != RESULTS.successful:
        return PeriodicBranch(over, unit, none, (), none, none, False)
    units, shape = Units(jnp.linalg.norm(found), jnp.asarray(abs(end - start) / 10)), found.shape

    def correct(guess: Vector, along: Vector) -> Corrected:
        return ask(_correct, jnp.zeros(shape), units, guess, along)

    place = start_of(found, first, units)
    towards = jnp.zeros_like(place).at[-1].set(np.sign(end - start))
    ends = sorted((start, end))
    low, high = (value / float(units.parameter) for value in ends)
    # Rounding must not take the first point out of its range.
    margin = 1e-9 * (high - low)
    walk = walked(
        correct, correct(place, towards).point, _FIRST_STEP, (low - margin, high + margin), most
    )
    values = np.array([float(one.place[-1]) for one in walk.points]) * float(units.parameter)
    responses = tuple(
        ask(_answer, jnp.asarray(value), units.coefficients * one.place[:-1].reshape(shape))
        for value, one in zip(values, walk.points, strict=True)
    )
    products = np.array([float(jnp.prod(1 + one.multipliers).real) for one in responses])
    flips = [
        values[k] + (values[k + 1] - values[k]) * products[k] / (products[k] - products[k + 1])
        for k in doublings(products)
    ]
    return PeriodicBranch(
        over, unit, values, responses, values[walk.folds], np.array(flips), walk.complete
    )


def _made(
    drive: Drive, point: OperatingPoint, name: str, asked: MotionAsked, value: Float[Array, ""]
) -> Prepared:
    return prepared(*with_number(drive, point, name, value), asked)


def _first(
    drive: Drive, point: OperatingPoint, name: str, asked: MotionAsked, value: Float[Array, ""]
) -> tuple[Coefficients, RESULTS]:
    """Coefficients of the motion that grows from rest."""
    made = _made(drive, point, name, asked, value)
    harmonics = len(asked.forcing.crank) - 1
    orbit = periodic_orbit(
        oscillator, made.excited, harmonics, asked.samples, past_folds=asked.counted.loose
    )
    missed = RESULTS.where(orbit.converged, RESULTS.successful, RESULTS.orbit_not_found)
    good = made.result == RESULTS.successful
    return orbit.coefficients, RESULTS.where(good, missed, made.result)


def _correct(
    drive: Drive,
    point: OperatingPoint,
    name: str,
    asked: MotionAsked,
    like: Coefficients,
    units: Units,
    guess: Vector,
    along: Vector,
) -> Corrected:
    def system(_: None, value: Float[Array, ""]) -> Oscillator:
        return oscillator(_made(drive, point, name, asked, value).excited, jnp.ones(()))

    return corrected(system, None, units, asked.samples, like.shape, guess, along)


def _answer(
    drive: Drive,
    point: OperatingPoint,
    name: str,
    asked: MotionAsked,
    value: Float[Array, ""],
    coefficients: Coefficients,
) -> PeriodicResponse:
    made = _made(drive, point, name, asked, value)
    system = oscillator(made.excited, jnp.ones(()))
    return described(made, known_orbit(system, coefficients, asked.samples))
