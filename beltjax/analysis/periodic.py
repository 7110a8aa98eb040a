"""Periodic vibration of finite amplitude: the motion, its stability, and its derivatives."""

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
    counted,
    law_with_modes,
    moving,
    require_functions,
)
from beltjax.analysis.orbit_measures import Measures, OverTime, Signals, friction_use, measures
from beltjax.analysis.orbit_motion import HarmonicMotion, SteppedMotion
from beltjax.analysis.orders import Forcing, Orders, given_forcing
from beltjax.analysis.shooting import shot_system
from beltjax.compiling.batched_loops import ready_after
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
from beltjax.numerics.shooting import ShotOrbit, shot_multipliers, shot_orbit
from beltjax.physics.motion import MotionModel
from beltjax.physics.set_valued import has_modes
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


class HarmonicBalance(eqx.Module):
    """Fourier series whose coefficients balance the equations: quick, differentiable, in batches.

    For laws that are functions of state and rate; a branch is followed past the folds of a clutch.
    """


class Shooting(eqx.Module):
    """Steps in time that end at events, repeated until a period closes: for laws with modes.

    Dry friction that holds, decouplers and rigid clutches, beside all that harmonic balance knows
    but a driver that is free. The motion is the one to which the drive comes from rest, if Newton's
    method leads there. Raises `ValueError` for fewer than 8 steps.
    """

    steps: int = eqx.field(static=True, default=160)  # a period

    def __check_init__(self):
        if self.steps < 8:
            raise ValueError(f"Shooting.steps: found {self.steps}; give 8 or more, usually 160.")


class PeriodicResponse(OverTime):
    """A periodic motion of a drive about its steady state."""

    # Fourier coefficients of the deviation in the linearization's coordinates: the mean, then the
    # cosine and the sine of each harmonic; of shooting, projections of its steps.
    coefficients: Float[Array, "terms size"]
    frequency: Float[Array, ""]  # of the period [rad/s]
    driver: Float[Array, " terms"]  # rotation of the driver, given [rad]
    # Floquet's, the largest first; None where `stability=False` left them out.
    multipliers: Complex[Array, " states"] | None
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
    # Least singular value of the scaled equations, 0 at a fold. Of shooting, how clearly events are
    # met: 1 without events, and 0 where one only touches.
    # None as `multipliers`.
    conditioning: Float[Array, ""] | None
    # Size of the last two harmonics over that of all: what is left out is of that size; of
    # shooting, an estimate of what its steps miss. The error of the functions of the spans is not
    # in it.
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
        """Whether a small disturbance dies out; raises `ValueError` where that was left out."""
        if self.multipliers is None:
            raise ValueError("PeriodicResponse.stable: was left out; leave out stability=False.")
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
    method: HarmonicBalance | Shooting | None = None,
    stability: bool = True,
    throw: bool = True,
) -> PeriodicResponse:
    """Periodic motion of finite amplitude under crank motion and torques at orders of the speed.

    The spans stretch by the squares of their slopes and of the tensioners' motions, so that
    tension and deflection act on each other; dry friction of the tensioners, clutches
    (`Isolator.law`) and loads over speed are counted; docs/theory/motion.md. Small amplitudes give
    `speed_response`. The motion is the one that grows from rest with the excitation.

    The result is that of the steady state, or `orbit_not_found`, or `too_many_events`, or
    `motion_has_modes` where harmonic balance is asked for laws that it does not know, or
    `numbers_unusable` for an excitation that is not finite. With `throw=False` read
    `.result`: a failed motion is zero. A success may carry a `.warning`: `orbit_unstable`,
    `span_slack_in_motion`, `slope_too_large`, `belt_slips_in_motion` or `grazing`, in this order.

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
        belt_speed: "constant", or "varying": the belts follow the rotation of the driver (O16),
            which changes the motion by some 0.1 %.
        method: `HarmonicBalance()` unless given, and `Shooting()` of a drive with a tensioner whose
            `friction_speed` is 0, a decoupler or a rigid clutch.
        stability: find `multipliers` and `conditioning`, which takes harmonic balance as long as
            the motion itself; without them nothing warns of an unstable motion.
        throw: raise where the result is a failure.

    Returns:
        The motion with its stability and its extremes.

    Raises:
        ValueError: an inertia or an excitation is missing, harmonics or samples are too few,
            `belt_speed` is another word, the excitation names a pulley that is not there, or the
            method does not know a law.
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> orders = bj.Orders({2: bj.Excitation(crank=0.002)})  # [rad]
        >>> damping = bj.Damping(modal=0.02)
        >>> found = bj.periodic_response(drive, point, orders, damping=damping)
        >>> found.measures.tension_min, found.stable
    """
    resolution = Resolution(harmonics, samples, functions, basis)
    asked = asked_of(drive, point, orders, resolution, damping, belt_speed, method, stability)
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
    method: HarmonicBalance | Shooting
    stability: bool = eqx.field(static=True)
    samples: int = eqx.field(static=True)


def asked_of(
    drive: Drive,
    point: OperatingPoint,
    orders: Orders | None,
    how: Resolution,
    damping: Damping | None,
    belt_speed: str = "constant",
    method: HarmonicBalance | Shooting | None = None,
    stability: bool = True,
) -> MotionAsked:
    """The question of `periodic_response` for compiled code; raises `ValueError` as that does."""
    free = _driver(point, orders) == "free"
    method = _method(drive, method, free)
    frictions = [body.friction_torque for body in drive.tensioners]
    parts = counted(drive)
    kinked = parts.loose or parts.varied or any_of(frictions)
    per_harmonic = _PER_HARMONIC * (2 if kinked else 1)
    samples = per_harmonic * how.harmonics if how.samples is None else how.samples
    _require_resolution(how.harmonics, samples, how.functions)
    if belt_speed not in BELT_SPEEDS:
        raise ValueError(f"belt_speed: found {belt_speed!r}; give {' or '.join(BELT_SPEEDS)}.")
    varying = belt_speed == "varying"
    if free and varying:
        raise ValueError(
            'belt_speed: found "varying", and the driver is free; belts follow a rotation that is '
            'given. Give "constant".'
        )
    forcing, base = _forcing(drive, point, orders, how.harmonics)
    forcing, damping = strongly_typed((forcing, Damping() if damping is None else damping))
    return MotionAsked(
        forcing=forcing,
        base=base,
        damping=damping,
        basis=how.basis,
        method=method,
        stability=stability,
        samples=samples,
        functions=how.functions,
        counted=parts,
        varying=varying,
        free=free,
    )


def _method(
    drive: Drive, method: HarmonicBalance | Shooting | None, free: bool
) -> HarmonicBalance | Shooting:
    """The method that was asked for, or the one that knows the drive's laws.

    Raises `ValueError` for one that does not, as far as the numbers are known.
    """
    found = law_with_modes(drive)
    if method is None:
        method = HarmonicBalance() if found is None else Shooting()
    if isinstance(method, HarmonicBalance) and found is not None:
        raise ValueError(
            f"method: found HarmonicBalance(), and {found} changes the equations at events, which "
            "it does not know; give Shooting(), or a smooth law."
        )
    if isinstance(method, Shooting) and free:
        raise ValueError(
            "method: found Shooting(), and the driver is free; give the motion of the driver, or "
            "HarmonicBalance() and laws without modes."
        )
    return method


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
    return "prescribed" if point.excitation is None else point.excitation.driver


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
    samples: int
    result: RESULTS


def prepared(drive: Drive, point: OperatingPoint, asked: MotionAsked) -> Prepared:
    """The equations of a drive's motion at an operating point."""
    made = moving(drive, point, asked)
    lin = made.linearization
    frequency = asked.base * driver_speed(drive, point)
    w = frequency * lin.scales.time
    driver, load = load_series(lin, asked.forcing, w, asked.damping)
    excited = Excited(made.model, w, driver, narrowed(made.shapes, load))
    result = first_failure(
        (~succeeded(lin.result), lin.result),
        (~jnp.all(jnp.isfinite(load)), RESULTS.numbers_unusable),
    )
    excited = frozen_where_failed(excited, result)
    return Prepared(drive, lin, made.whole, made.shapes, excited, frequency, asked.samples, result)


def motion_asked(drive: Drive, point: OperatingPoint, asked: MotionAsked) -> PeriodicResponse:
    """The motion of a canonical drive and point."""
    made = prepared(drive, point, asked)
    harmonics = len(asked.forcing.crank) - 1
    if isinstance(asked.method, Shooting):
        return _shot(made, shot_orbit(shot_system, made.excited, asked.method.steps), harmonics)
    # An opening clutch softens the drive so much that the branch from rest folds.
    orbit = periodic_orbit(
        oscillator, made.excited, harmonics, made.samples, past_folds=asked.counted.loose
    )
    return described(made, orbit, asked.stability)


_periodic = boundary_jit(motion_asked)


class _Found(NamedTuple):
    """A motion and its evidence, as the methods differ in it."""

    signals: Signals
    coefficients: Float[Array, "terms size"]
    multipliers: Complex[Array, " states"] | None
    torque: Float[Array, ""]
    conditioning: Float[Array, ""] | None
    error: Float[Array, ""]
    failures: tuple[tuple[Bool[Array, ""], RESULTS], ...]
    grazes: Bool[Array, ""]
    stats: dict[str, Array]


def described(made: Prepared, orbit: Orbit, stability: bool = True) -> PeriodicResponse:
    """The answer about an orbit of the drive, by harmonic balance."""
    lin, driver, w = made.linearization, made.excited.driver, made.excited.frequency
    neutral = oscillator(made.excited, jnp.ones(())).neutral
    found_at, torque = orbit.coefficients, jnp.zeros(())
    if neutral is not None:
        torque = neutral.mean_load(found_at)
        found_at = found_at.at[0].add(torque * neutral.direction)  # its mean rotation is 0
    coefficients = widened(made.shapes, found_at)
    motion = HarmonicMotion(coefficients=coefficients, driver=driver, frequency=w)
    floquet = distance = None
    if stability:
        equations = oscillator, made.excited, orbit.coefficients
        floquet = multipliers(*equations)
        later = ready_after(orbit.coefficients, floquet)
        distance = conditioning(*equations[:2], later, made.samples)
    size = jnp.linalg.norm(orbit.coefficients)
    found = _Found(
        signals=Signals(lin, made.model, motion),
        coefficients=motion.coefficients,
        multipliers=floquet,
        torque=torque * lin.scales.energy,
        conditioning=distance,
        error=jnp.linalg.norm(orbit.coefficients[-4:]) / jnp.where(size > 0, size, 1.0),
        failures=(
            (has_modes(made.model), RESULTS.motion_has_modes),
            (~orbit.converged, RESULTS.orbit_not_found),
        ),
        grazes=jnp.array(False),
        stats={"steps": orbit.steps, "residual": orbit.step},
    )
    return _answer(made, found)


def _shot(made: Prepared, orbit: ShotOrbit, harmonics: int) -> PeriodicResponse:
    """The answer about an orbit of the drive, by shooting."""
    motion = SteppedMotion(
        trajectory=orbit.trajectory,
        shapes=made.shapes,
        driver=made.excited.driver,
        frequency=made.excited.frequency,
    )
    found = _Found(
        signals=Signals(made.linearization, made.model, motion),
        coefficients=motion.coefficients(harmonics),
        multipliers=shot_multipliers(orbit),
        torque=jnp.zeros(()),
        conditioning=orbit.least,
        error=orbit.error,
        failures=(
            (orbit.crowded, RESULTS.too_many_events),
            (~orbit.converged, RESULTS.orbit_not_found),
        ),
        grazes=orbit.least < _GRAZES,
        stats={"steps": orbit.periods, "residual": orbit.gap, "events": orbit.events},
    )
    return _answer(made, found)


def _answer(made: Prepared, found: _Found) -> PeriodicResponse:
    lin, extremes = made.linearization, measures(found.signals, made.samples)
    use, floquet = friction_use(made.drive, lin, extremes), found.multipliers
    unstable = jnp.array(False) if floquet is None else jnp.abs(floquet[0]) > 1
    result = first_failure((~succeeded(made.result), made.result), *found.failures)
    answer = PeriodicResponse(
        coefficients=found.coefficients,
        frequency=made.frequency,
        driver=made.excited.driver,
        multipliers=floquet,
        measures=extremes,
        friction_use=use,
        mean_driver_torque=found.torque,
        linearization=lin,
        signals=found.signals,
        excited=made.excited,
        shapes=made.shapes,
        conditioning=found.conditioning,
        error=found.error,
        result=result,
        warning=first_failure(
            (unstable, RESULTS.orbit_unstable),
            (jnp.min(extremes.tension_min) < 0, RESULTS.span_slack_in_motion),
            (jnp.max(extremes.slope_max) > STEEPEST, RESULTS.slope_too_large),
            (jnp.max(use) > 1, RESULTS.belt_slips_in_motion),
            (found.grazes, RESULTS.grazing),
        ),
        stats=found.stats,
    )
    return frozen_where_failed(answer, result)


_GRAZES = 1e-2  # `conditioning` below which an event only just happens


def stability_margin(response: PeriodicResponse) -> Float[Array, ""]:
    """What is left of a motion's stability: 1 less the modulus of its largest Floquet multiplier.

    Negative where the motion is unstable. Unlike `response.multipliers` it has derivatives, which
    cost one more monodromy matrix; those of a motion by `Shooting` are NaN. Where the motion was
    not found it is a placeholder without derivatives.

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
    if isinstance(of.signals.motion, HarmonicMotion):
        orbit = narrowed(of.shapes, of.coefficients)
        margin = 1 - largest_multiplier(oscillator, of.excited, orbit)
    else:
        assert of.multipliers is not None  # shooting always has them
        margin = 1 - jnp.abs(of.multipliers[0])
    return frozen_where_failed(margin, of.result)
