"""Periodic vibration of finite amplitude: harmonic balance, stability, and its derivatives."""

from typing import Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float

from beltjax.analysis.damping import Damping
from beltjax.analysis.linearization import Linearization
from beltjax.analysis.motion import (
    Excited,
    driver_speed,
    load_series,
    narrowed,
    oscillator,
    widened,
)
from beltjax.analysis.moving import (
    ModelAsked,
    any_of,
    has_clutches,
    has_curved_paths,
    moving,
    require_functions,
)
from beltjax.analysis.orbit_measures import (
    Measures,
    OverTime,
    PeriodicMotion,
    Signals,
    friction_use,
    measures,
)
from beltjax.analysis.orders import Forcing, Orders, given_forcing
from beltjax.compiling.quick import boundary_jit
from beltjax.drive.canonical import canonical, strongly_typed
from beltjax.drive.components import as_real
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.numerics.bases import AbstractBasis
from beltjax.numerics.periodic import (
    Orbit,
    conditioning,
    largest_multiplier,
    multipliers,
    periodic_orbit,
)
from beltjax.physics.motion import MotionModel
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
    succeeded,
)

STEEPEST = 0.2  # slope above which small slopes are no good approximation
_PER_HARMONIC = 8  # samples
BELT_SPEEDS = "constant", "varying"


class PeriodicResponse(OverTime):
    """A periodic motion of a drive about its steady state, found by harmonic balance."""

    # Fourier coefficients of the deviation in the linearization's coordinates: the mean, then the
    # cosine and the sine of each harmonic.
    coefficients: Float[Array, "terms size"]
    frequency: Float[Array, ""]  # of the period [rad/s]
    driver: Float[Array, " terms"]  # rotation of the driver, given [rad]
    multipliers: Complex[Array, " states"]  # Floquet's, the largest first
    measures: Measures
    friction_use: Float[Array, " pulleys"]  # largest over the period; 0 without friction
    # Mean torque of the driver in the direction of travel, beside what the steady state has [N m];
    # 0 where its rotation is given.
    mean_driver_torque: Float[Array, ""]
    linearization: Linearization
    signals: Signals
    # The equations in the functions that were counted, and these by the linearization's.
    excited: Excited
    shapes: Float[Array, "spans n functions"]
    conditioning: Float[Array, ""]  # least singular value of the scaled equations; 0 at a fold
    # Size of the last two harmonics over that of all: what is left out is of that size. The
    # error of the functions of the spans is not in it.
    error: Float[Array, ""]
    result: RESULTS
    warning: RESULTS
    stats: dict[str, Array]

    @property
    def period(self) -> Float[Array, ""]:
        """Period [s]."""
        return 2 * jnp.pi / self.frequency

    @property
    def stable(self) -> Bool[Array, ""]:
        """Whether a small disturbance dies out."""
        return jnp.abs(self.multipliers[0]) < 1

    def _variable(self, times: Float[Array, " times"]) -> Float[Array, " times"]:
        return self.frequency * times


def periodic_response(
    drive: Drive,
    point: OperatingPoint,
    orders: Orders | None = None,
    *,
    harmonics: int = 12,
    samples: int | None = None,
    functions: int = 16,
    basis: AbstractBasis | None = None,
    damping: Damping | None = None,
    belt_speed: Literal["constant", "varying"] = "constant",
    throw: bool = True,
) -> PeriodicResponse:
    """Periodic motion of finite amplitude under crank motion and torques at orders of the speed.

    The spans stretch by the squares of their slopes and of the tensioners' motions, so that
    tension and deflection act on each other; dry friction of the tensioners and clutches
    (`Isolator.law`) are counted.
    docs/theory/motion.md. Small amplitudes give
    `speed_response`. The motion is the one that grows from rest with the excitation.

    The result is that of the steady state, or `orbit_not_found`, or `numbers_unusable` for an
    excitation that is not finite. With `throw=False` read
    `.result`: a failed motion is zero. A success may carry a `.warning`: `orbit_unstable`,
    `span_slack_in_motion`, `slope_too_large` or `belt_slips_in_motion`, in this order.

    Args:
        drive: the drive.
        point: speeds and torques.
        orders: what excites the drive; the point's own `excitation` unless given.
        harmonics: of the period that all orders have in common.
        samples: points of time at which forces are evaluated; 8 per harmonic unless given, and
            16 of a drive with dry friction or a clutch.
        functions: for the deflection of each span. From 8 on four of them are the layers at the
            span's ends, the others polynomials; below all are polynomials, and 0 leaves the
            spans straight.
        basis: functions for the deflections in place of these, such as `Legendre(24)`.
        damping: `Damping()` unless given, which counts the drive's own dampers.
        belt_speed: "constant", or "varying": the belts follow the rotation of the driver (O9),
            which changes the motion by some 0.1 %.
        throw: raise where the result is a failure.

    Returns:
        The motion with its stability and its extremes.

    Raises:
        ValueError: an inertia or an excitation is missing, harmonics or samples are too few,
            `belt_speed` is another word, or the excitation names a pulley that is not there.
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> orders = bj.Orders({2: bj.Excitation(crank=0.002)})  # [rad]
        >>> damping = bj.Damping(modal=0.02)
        >>> found = bj.periodic_response(drive, point, orders, damping=damping)
        >>> found.measures.tension_min, found.stable
    """
    asked = asked_of(
        drive, point, orders, Resolution(harmonics, samples, functions, basis), damping, belt_speed
    )
    found = _periodic(*canonical(drive, point), asked)
    return raise_unless_successful(found, found.result, throw)


class Resolution(NamedTuple):
    """How finely a motion is resolved, as `periodic_response` takes it."""

    harmonics: int
    samples: int | None
    functions: int
    basis: AbstractBasis | None


class MotionAsked(ModelAsked):
    """What a motion is asked for, beside the drive; the harmonics are those of the forcing."""

    forcing: Forcing
    base: Float[Array, ""]  # order of the period
    samples: int = eqx.field(static=True)


def asked_of(
    drive: Drive,
    point: OperatingPoint,
    orders: Orders | None,
    how: Resolution,
    damping: Damping | None,
    belt_speed: str = "constant",
) -> MotionAsked:
    """The question of `periodic_response` for compiled code; raises `ValueError` as that does."""
    frictions = [body.friction_torque for body in drive.tensioners]
    loose = has_clutches(drive)
    per_harmonic = _PER_HARMONIC * (2 if loose or any_of(frictions) else 1)
    samples = per_harmonic * how.harmonics if how.samples is None else how.samples
    _require_resolution(how.harmonics, samples, how.functions)
    if belt_speed not in BELT_SPEEDS:
        raise ValueError(f"belt_speed: found {belt_speed!r}; give {' or '.join(BELT_SPEEDS)}.")
    varying = belt_speed == "varying"
    forcing, base = _forcing(drive, point, orders, how.harmonics)
    free = _driver(point, orders) == "free"
    if free and varying:
        raise ValueError(
            'belt_speed: found "varying", and the driver is free; belts follow a rotation that is '
            'given. Give "constant".'
        )
    forcing, damping = strongly_typed((forcing, Damping() if damping is None else damping))
    return MotionAsked(
        forcing=forcing,
        base=base,
        damping=damping,
        basis=how.basis,
        samples=samples,
        functions=how.functions,
        curved=has_curved_paths(drive),
        loose=loose,
        varying=varying,
        free=free,
    )


def _forcing(
    drive: Drive, point: OperatingPoint, orders: Orders | None, harmonics: int
) -> tuple[Forcing, Float[Array, ""]]:
    """What excites the drive by harmonics of the period, and the order of that."""
    names = drive.pulley_names
    if orders is not None:
        return strongly_typed(orders).forcing(names, harmonics), jnp.asarray(orders.base)
    if point.excitation is None or not point.excitation.excites:
        raise ValueError("orders: found none, and the point has no excitation; give Orders(...).")
    forcing, base = given_forcing(point.excitation, names, harmonics)
    return forcing, as_real(base)


def _driver(point: OperatingPoint, orders: Orders | None) -> str:
    if orders is not None:
        return orders.driver
    assert point.excitation is not None  # as _forcing holds
    return point.excitation.driver


def _require_resolution(harmonics: int, samples: int, functions: int) -> None:
    if harmonics < 1:
        raise ValueError(f"harmonics: found {harmonics}; give at least 1.")
    if samples < 2 * harmonics + 2:
        least = 2 * harmonics + 2
        raise ValueError(
            f"samples: found {samples}; give at least {least} for {harmonics} harmonics."
        )
    require_functions(functions)


class Prepared(NamedTuple):
    """A drive at an operating point, ready to be moved."""

    drive: Drive
    linearization: Linearization
    model: MotionModel  # in the linearization's coordinates
    shapes: Float[Array, "spans n functions"]  # of the functions that are counted
    excited: Excited  # in those
    frequency: Float[Array, ""]  # [rad/s]
    speed: Float[Array, ""]  # of the driver [rad/s]
    samples: int
    result: RESULTS


def prepared(drive: Drive, point: OperatingPoint, asked: MotionAsked) -> Prepared:
    """The equations of a drive's motion at an operating point."""
    made = moving(drive, point, asked)
    lin, turning = made.linearization, driver_speed(drive, point)
    frequency = asked.base * turning
    w = frequency * lin.scales.time
    driver, load = load_series(lin, asked.forcing, w, asked.damping)
    excited = Excited(made.model, w, driver, narrowed(made.shapes, load))
    result = first_failure(
        (~succeeded(lin.result), lin.result),
        (~jnp.all(jnp.isfinite(load)), RESULTS.numbers_unusable),
    )
    excited = frozen_where_failed(excited, result)
    return Prepared(
        drive, lin, made.whole, made.shapes, excited, frequency, turning, asked.samples, result
    )


@boundary_jit
def _periodic(drive: Drive, point: OperatingPoint, asked: MotionAsked) -> PeriodicResponse:
    made = prepared(drive, point, asked)
    harmonics = len(asked.forcing.crank) - 1
    # An opening clutch softens the drive so much that the branch from rest folds.
    orbit = periodic_orbit(
        oscillator, made.excited, harmonics, made.samples, past_folds=asked.loose
    )
    return described(made, orbit)


def described(made: Prepared, orbit: Orbit) -> PeriodicResponse:
    """The answer about an orbit of the drive."""
    lin, driver, w = made.linearization, made.excited.driver, made.excited.frequency
    neutral = oscillator(made.excited, jnp.ones(())).neutral
    found_at, torque = orbit.coefficients, jnp.zeros(())
    if neutral is not None:
        torque = neutral.mean_load(found_at)
        found_at = found_at.at[0].add(torque * neutral.direction)  # its mean rotation is 0
    coefficients = widened(made.shapes, found_at)
    motion = PeriodicMotion(coefficients, driver, w, made.speed * lin.scales.time)
    signals = Signals(lin, made.model, motion)
    found = measures(signals, motion.grid(made.samples))
    use = friction_use(made.drive, lin, found)
    equations = oscillator, made.excited
    floquet = multipliers(*equations, orbit.coefficients)
    size = jnp.linalg.norm(orbit.coefficients)
    result = first_failure(
        (~succeeded(made.result), made.result), (~orbit.converged, RESULTS.orbit_not_found)
    )
    answer = PeriodicResponse(
        coefficients=coefficients,
        frequency=made.frequency,
        driver=driver,
        multipliers=floquet,
        measures=found,
        friction_use=use,
        mean_driver_torque=torque * lin.scales.energy,
        linearization=lin,
        signals=signals,
        excited=made.excited,
        shapes=made.shapes,
        conditioning=conditioning(*equations, orbit.coefficients, made.samples),
        error=jnp.linalg.norm(orbit.coefficients[-4:]) / jnp.where(size > 0, size, 1.0),
        result=result,
        warning=first_failure(
            (jnp.abs(floquet[0]) > 1, RESULTS.orbit_unstable),
            (jnp.min(found.tension_min) < 0, RESULTS.span_slack_in_motion),
            (jnp.max(found.slope_max) > STEEPEST, RESULTS.slope_too_large),
            (jnp.max(use) > 1, RESULTS.belt_slips_in_motion),
        ),
        stats={"steps": orbit.steps, "residual": orbit.step},
    )
    return frozen_where_failed(answer, result)


def stability_margin(response: PeriodicResponse) -> Float[Array, ""]:
    """What is left of a motion's stability: 1 less the modulus of its largest Floquet multiplier.

    Negative where the motion is unstable. Unlike `response.multipliers` it has derivatives, which
    cost one more monodromy matrix. Where the motion was not found it is 0 and has none.

    Args:
        response: a motion, as `periodic_response` returns it.

    Returns:
        The margin, at most 1.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> orders = bj.Orders({2: bj.Excitation(crank=0.002)})  # [rad]
        >>> damping = bj.Damping(modal=0.02)
        >>> found = bj.periodic_response(drive, point, orders, damping=damping, functions=4)
        >>> bj.stability_margin(found)
    """
    return _stability_margin(response)


@boundary_jit
def _stability_margin(response: PeriodicResponse) -> Float[Array, ""]:
    of = response
    orbit = narrowed(of.shapes, of.coefficients)
    margin = 1 - largest_multiplier(oscillator, of.excited, orbit)
    return frozen_where_failed(margin, of.result)
