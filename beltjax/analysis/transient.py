"""Transients of a drive at finite amplitude: run-up, coast-down, start, stop, any crank motion."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from beltjax.analysis.damping import Damping
from beltjax.analysis.driver_motion import CrankSignal
from beltjax.analysis.linearization import Linearization
from beltjax.analysis.motion import driver_speed
from beltjax.analysis.moving import counted, law_with_modes, require_functions
from beltjax.analysis.orbit_measures import Measures, OverTime, Signals, friction_use, measures
from beltjax.analysis.orders import Forcing, Orders, orders_of
from beltjax.analysis.periodic import STEEPEST, PeriodicResponse
from beltjax.analysis.sampled_motion import SampledMotion, trapezoid
from beltjax.analysis.time_equations import (
    Begun,
    Equations,
    TransientAsked,
    accelerations,
    begun,
    overruns,
)
from beltjax.compiling.quick import boundary_jit, long_boundary_jit
from beltjax.drive.canonical import canonical, strongly_typed
from beltjax.drive.components import as_real, concrete
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.readable import Readable
from beltjax.drive.system import Drive
from beltjax.numerics.bases import AbstractBasis
from beltjax.numerics.hybrid import Mode
from beltjax.numerics.time_integration import (
    DERIVATIVES,
    METHODS,
    How,
    Integrated,
    integrated,
    integrated_through_events,
    require_diffrax,
)
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
    succeeded,
)

if TYPE_CHECKING:
    import xarray

Scalar = Float[Array, ""]
State = Float[Array, " size"]

_PER_TURN = 64  # times of a rotation at the highest speed that are kept, for orders up to 4
_LEAST_RATE = 1000.0  # times a second
_MOST_TIMES = 2**15
_USUAL_TIMES = 2**10  # where the duration is not known
_PARTS = 16  # of a motion that reports its progress


class PeakSpeeds(Readable):
    """Speeds of the driver at which a transient is at its greatest [rad/s]."""

    rotations: Float[Array, " pulleys"]  # of the hubs from their mean
    tensions: Float[Array, " spans"]
    motions: Float[Array, " tensioners"]  # from the steady state
    hub_loads: Float[Array, " pulleys"]


class Transient(OverTime):
    """A motion of a drive over time, from where it began.

    Deviations are from the steady state at `reference_speed`. Between the times that were kept it
    is interpolated to fifth order.
    """

    times: Float[Array, " times"]  # at which the motion was kept [s]
    driver_speeds: Float[Array, " times"]  # mean speed of the driver there [rad/s]
    crank: Float[Array, " times"]  # rotation of the driver beyond that [rad]
    reference_speed: Float[Array, ""]  # of the driver [rad/s]
    measures: Measures
    peak_speeds: PeakSpeeds
    friction_use: Float[Array, " pulleys"]  # largest over the motion; 0 without friction
    linearization: Linearization
    signals: Signals
    unit: Float[Array, ""]  # of the time of the equations [s]
    result: RESULTS
    warning: RESULTS
    stats: dict[str, Array]

    def _variable(self, times: Float[Array, " times"]) -> Float[Array, " times"]:
        return (times - self.times[0]) / self.unit

    @property
    def final(self) -> tuple[Float[Array, " size"], Float[Array, " size"]]:
        """Coordinates and their rates [1/s] at the end, from which `transient` may go on.

        They are those of the linearization, about the steady state at `reference_speed`.
        """
        end = self._variable(self.times[-1:])[0]
        return self.signals.state(end)[0], self.signals.motion.rate(end) / self.unit

    def time_above(self, values: Float[Array, "times *items"], limit: float) -> Array:
        """For how long each of some values at `times` is above a limit [s]."""
        above = (jnp.asarray(values) > limit).astype(float)
        return jnp.tensordot(trapezoid(self.times), above, 1)

    def to_xarray(self, drive: Drive) -> "xarray.Dataset":
        """The motion at its times with named axes, and units in the attributes."""
        import xarray  # brings in pandas, which takes as long to load as JAX

        times = np.asarray(self.times)
        kinds = ["rad" if float(body.kind) else "m" for body in drive.tensioners]
        middle = self._over(lambda at: _middles(self.signals, at), times)

        def named(part: str, values: Array, unit: str, text: str) -> tuple:
            return ("time", part), np.asarray(values), {"units": unit, "long_name": text}

        speed = "rotations beyond those at the driver's mean speed"
        return xarray.Dataset(
            {
                "driver_speed": (
                    "time",
                    np.asarray(self.driver_speeds),
                    {"units": "rad/s", "long_name": "mean speed of the driver"},
                ),
                "crank": (
                    "time",
                    np.asarray(self.crank),
                    {"units": "rad", "long_name": "rotation of the driver beyond its mean"},
                ),
                "rotation": named("pulley", self.rotations(times), "rad", speed),
                "tension": named("span", self.tensions(times), "N", "tensions"),
                "deflection": named("span", middle, "m", "deflection at mid-span"),
                "hub_load": named(
                    "pulley", self.hub_loads(times), "N", "loads on hubs, of effective tensions"
                ),
                "tensioner_motion": named(
                    "tensioner",
                    self.tensioner_motions(times),
                    kinds[0] if len(set(kinds)) == 1 else "rad or m, see tensioner_unit",
                    "motions of tensioners from the steady state at the reference speed",
                ),
            },
            coords={
                "time": ("time", times, {"units": "s"}),
                "pulley": ("pulley", list(drive.pulley_names)),
                "span": ("span", list(drive.span_names)),
                "tensioner": ("tensioner", [body.name for body in drive.tensioners]),
                "tensioner_unit": ("tensioner", kinds),
            },
            attrs={"drive": drive.name, "reference_speed": float(self.reference_speed)},
        )


def _middles(signals: Signals, at: Scalar) -> Float[Array, " spans"]:
    """Deflection in the middle of each span [m]."""
    lin, (z, _) = signals.linearization, signals.state(at)
    half = jnp.asarray(0.5)
    middle = jax.vmap(lambda i: lin.deflection(z, i, half))(jnp.arange(lin.spans))
    return middle * lin.model.lam * lin.scales.length


def transient(
    drive: Drive,
    point: OperatingPoint,
    duration: float | Array | None = None,
    *,
    profile: Array | np.ndarray | list | tuple | None = None,
    orders: Orders | None = None,
    crank: CrankSignal | None = None,
    initial: PeriodicResponse | tuple[Array, Array] | None = None,
    saves: Array | np.ndarray | None = None,
    functions: int = 12,
    basis: AbstractBasis | None = None,
    damping: Damping | None = None,
    rtol: float = 1e-6,
    atol: float = 1e-8,
    max_steps: int = 2_000_000,
    max_events: int = 500,
    method: Literal["explicit", "implicit"] = "explicit",
    derivatives: Literal["reverse", "forward"] = "reverse",
    advance: Callable[[str, int, int | None], None] | None = None,
    throw: bool = True,
) -> Transient:
    """Motion of finite amplitude over time: run-up, coast-down, start and stop, any crank motion.

    The equations are those of `periodic_response`, in a frame that turns with the driver's mean
    speed, with belts whose speed follows the driver: docs/theory/motion.md, (O16) and (O17). One
    model, about the steady state at the speed halfway between the lowest and the highest, serves
    all speeds. It needs diffrax: `pip install 'beltjax[time]'`.

    The drive begins in its steady state at the first speed, and turns as its driver does; or as
    `initial` says, whose speed is then that of the model.

    The result is that of the steady state, or `steady_state_not_found` at the first speed,
    `numbers_unusable`, `too_many_steps`, `too_many_events`, or `motion_not_finite`. With
    `throw=False` read `.result`: a failed motion is zero. A success may carry a `.warning`:
    `span_slack_in_motion`, `slope_too_large` or `belt_slips_in_motion`, in this order. One program
    serves all numbers; of another number of times, knots or orders it is compiled anew.

    Args:
        drive: the drive.
        point: speeds and torques.
        duration: of the motion [s]; that of the profile unless given.
        profile: times [s], which increase, and the driver's mean speeds there [rad/s], [knots, 2],
            joined by lines; the speed may be 0, and it is held after the last time. The point's
            excitation may give it; else the speed is the point's.
        orders: what excites the drive, over the angle of the driver; the point's `excitation`
            unless given, which may be none.
        crank: rotation of the driver over time, on top of orders.
        initial: a periodic motion, which goes on at its phase 0, or coordinates and their rates
            [1/s] in the linearization's coordinates, as `Transient.final` has.
        saves: increasing times that are kept [s], from the first to the last of the motion; 64 in
            each rotation at the highest speed unless given, and more for orders above 4.
        functions: for the deflection of each span, as in `periodic_response`.
        basis: functions for the deflections in place of these.
        damping: `Damping()` unless given, which counts the drive's own dampers.
        rtol: tolerance of a step over the size of the motion, whose other part is
        atol: in the dimensionless coordinates.
        max_steps: steps after which it is given up, and of a law with modes a part without events.
        max_events: events after which it is given up: stops and slips of tensioners whose
            `friction_speed` is 0, and of decouplers and rigid clutches.
        method: "explicit", or "implicit", which is for dry friction with a very small
            `friction_speed` above 0.
        derivatives: the mode in which JAX may differentiate it, "reverse" or "forward"; forward is
            for few parameters.
        advance: function that is called as `advance(stage, done, total)` as time goes on. JAX
            cannot trace such a call.
        throw: raise where the result is a failure.

    Returns:
        The motion at the times kept, and its extremes.

    Raises:
        ValueError: diffrax or an inertia is missing, there is no duration, times do not increase,
            the driver is free, or an option is out of range.
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> run_up = [(0.0, 100.0), (0.5, 300.0)]  # [s], [rad/s]
        >>> orders = bj.Orders({2: bj.Excitation(crank=0.002)})  # [rad]
        >>> damping = bj.Damping(modal=0.02)
        >>> found = bj.transient(drive, point, profile=run_up, orders=orders, damping=damping)
        >>> found.measures.tension_min, found.peak_speeds.tensions
    """
    require_diffrax()
    _require_options(method, derivatives, functions, min(max_steps, max_events))
    times, speeds = _profile(drive, point, duration, profile)
    given = _excitation(point, orders)
    forcing, base = _forcing(drive, given)
    _require_signal(crank, times)
    asked = TransientAsked(
        damping=Damping() if damping is None else damping,
        basis=basis,
        functions=functions,
        counted=counted(drive),
        varying=True,
        free=False,
        times=times,
        speeds=speeds,
        forcing=forcing,
        base=base,
        signal=crank,
        initial=_initial(initial, speeds),
        saves=_saves(saves, times, speeds, given),
        stepping=law_with_modes(drive, traced=True) is not None,
    )
    how = How(as_real(rtol), as_real(atol), max_steps, max_events, method, derivatives)
    asked, numbers = strongly_typed(asked), canonical(drive, point)
    started = begun(*numbers, asked)
    run = _integrated_in_parts(started, how, advance)
    found = _described(numbers[0], started, run)
    return raise_unless_successful(found, found.result, throw)


def _require_options(method: str, derivatives: str, functions: int, least: int) -> None:
    for name, word, known in (
        ("method", method, METHODS),
        ("derivatives", derivatives, DERIVATIVES),
    ):
        if word not in known:
            raise ValueError(f"{name}: found {word!r}; give {' or '.join(known)}.")
    require_functions(functions)
    if least < 1:
        raise ValueError(f"max_steps, max_events: found {least}; give at least 1.")


def _profile(
    drive: Drive, point: OperatingPoint, duration: float | Array | None, profile: object
) -> tuple[Float[Array, " knots"], Float[Array, " knots"]]:
    """Knots of the mean speed, the last at the end of the motion."""
    if profile is None and point.excitation is not None:
        profile = point.excitation.profile
    if profile is None:
        if duration is None:
            raise ValueError("duration: found none, and no profile; give one of them.")
        speed = driver_speed(drive, point)
        knots = jnp.stack([jnp.zeros_like(speed), speed])[None]
    else:
        knots = as_real(profile)
        if knots.ndim != 2 or knots.shape[1] != 2:
            raise ValueError(
                f"profile: found shape {knots.shape}; give pairs of a time [s] and a speed [rad/s]."
            )
    times, speeds = knots[:, 0], knots[:, 1]
    if duration is not None:
        end = times[:1] + as_real(duration)
        numbers = concrete(end - times[-1])
        if numbers is not None and numbers[0] < 0:
            raise ValueError("duration: is shorter than the profile; shorten that.")
        if len(times) == 1 or numbers is None or numbers[0] > 0:
            times, speeds = jnp.append(times, end), jnp.append(speeds, speeds[-1])
    numbers = concrete(times), concrete(speeds)
    if numbers[0] is not None and not (
        len(times) > 1 and np.isfinite(numbers[0]).all() and (np.diff(numbers[0]) > 0).all()
    ):
        raise ValueError("profile, duration: times must be finite and increase, from two on.")
    if numbers[1] is not None and not ((numbers[1] >= 0) & (numbers[1] < np.inf)).all():
        raise ValueError("profile: speeds must be finite and not negative [rad/s].")
    return times, speeds


def _excitation(point: OperatingPoint, orders: Orders | None) -> Orders | None:
    """The orders that excite, if any."""
    file = point.excitation
    if orders is None and file is not None and file.excites:
        orders = orders_of(file)
    if orders is not None and orders.driver == "free":
        raise ValueError(
            'orders: the driver is "free", and a transient\'s is "prescribed"; give the latter.'
        )
    return orders


def _forcing(drive: Drive, orders: Orders | None) -> tuple[Forcing, Scalar]:
    """The excitation by harmonics of its period, and the order of that."""
    names = drive.pulley_names
    if orders is None:
        return Forcing(jnp.zeros(2, complex), jnp.zeros((2, len(names)), complex)), as_real(1.0)
    highest = round(max(orders.excitations) / orders.base)
    return orders.forcing(names, highest), as_real(orders.base)


def _require_signal(crank: CrankSignal | None, times: Float[Array, " knots"]) -> None:
    """Raise `ValueError` for a signal that does not last as long as the motion."""
    if crank is None:
        return
    ends = concrete(crank.times), concrete(times)
    if ends[0] is not None and ends[1] is not None:
        slip = 1e-9 * (ends[1][-1] - ends[1][0])
        if ends[0][0] > ends[1][0] + slip or ends[0][-1] < ends[1][-1] - slip:
            raise ValueError(
                f"crank: lasts from {ends[0][0]:g} to {ends[0][-1]:g} s, the motion from "
                f"{ends[1][0]:g} to {ends[1][-1]:g} s; give the whole of it."
            )


def _initial(
    given: PeriodicResponse | tuple[Array, Array] | None, speeds: Float[Array, " knots"]
) -> tuple[State, State] | None:
    """Coordinates, and rates [1/s]."""
    if given is None or isinstance(given, tuple):
        return given
    lin = given.linearization
    belt = lin.model.s * lin.scales.length / lin.scales.time  # [m/s], of each span
    radii = lin.steady.groups.radius_ratios * lin.scales.length
    speed = concrete(jnp.sum(lin.steady.groups.drives * belt / radii))
    first = concrete(speeds[0])
    if speed is not None and first is not None and abs(speed - first) > 1e-6 * first:
        raise ValueError(
            f"initial: is a motion at {speed:g} rad/s of the driver, and this one begins at "
            f"{first:g} rad/s; begin at that speed."
        )
    start = jnp.zeros(())
    return given.at(0.0), given.signals.motion.rate(start) / lin.scales.time


def _saves(
    saves: Array | np.ndarray | None,
    times: Float[Array, " knots"],
    speeds: Float[Array, " knots"],
    orders: Orders | None,
) -> Float[Array, " times"]:
    """The times to keep."""
    if saves is not None:
        kept = as_real(saves)
        numbers, ends = concrete(kept), concrete(times)
        if kept.ndim != 1 or len(kept) < 2:
            raise ValueError("saves: give a list of at least two times [s].")
        if numbers is not None and not (np.diff(numbers) > 0).all():
            raise ValueError("saves: times must increase.")
        if numbers is not None and ends is not None and numbers[0] != ends[0]:
            raise ValueError(
                f"saves: begin at {numbers[0]:g} s, and the motion at {ends[0]:g} s; begin there."
            )
        return kept
    numbers = concrete(times), concrete(speeds)
    count = _USUAL_TIMES
    if numbers[0] is not None and numbers[1] is not None:
        highest = max([4.0, *(orders.excitations if orders is not None else ())])
        rate = max(_PER_TURN * highest / 4 * numbers[1].max() / (2 * np.pi), _LEAST_RATE)
        wanted = rate * (numbers[0][-1] - numbers[0][0])
        count = int(2 ** np.ceil(np.log2(np.clip(wanted, 2 * _PARTS, _MOST_TIMES))))
    return times[0] + (times[-1] - times[0]) * jnp.linspace(0.0, 1.0, count + 1)


def _integrated_in_parts(
    begun: Begun, how: How, advance: Callable[[str, int, int | None], None] | None
) -> Integrated:
    count, equations, at = len(begun.saves) - 1, begun.equations, (begun.state, begun.mode)
    if advance is None or count % _PARTS:
        return _integrated(equations, at, begun.saves, begun.kinks, how)
    size, parts = count // _PARTS, []
    for k in range(_PARTS):
        advance("moving", k, _PARTS)
        times = begun.saves[k * size : (k + 1) * size + 1]
        one = _integrated(equations, at, times, begun.kinks, how)
        parts.append(one)
        at = one.states[-1], one.modes[-1]
        if not np.isfinite(np.asarray(one.states[-1])).all():
            break
    advance("moving", _PARTS, _PARTS)
    lost = count - size * len(parts)

    def joined(first: Array, *rest: Array, fill: float) -> Array:
        whole = jnp.concatenate([first, *(one[1:] for one in rest)])
        left = jnp.full((lost, whole.shape[1]), fill, whole.dtype)
        return jnp.concatenate([whole, left])

    def counted_over(field: str) -> Array:
        return jnp.sum(jnp.stack([getattr(one, field) for one in parts]))

    return Integrated(
        states=joined(*(one.states for one in parts), fill=np.inf),
        modes=joined(*(one.modes for one in parts), fill=0),
        steps=counted_over("steps"),
        rejected=counted_over("rejected"),
        events=counted_over("events"),
        exhausted=parts[-1].exhausted,
        crowded=parts[-1].crowded,
    )


@long_boundary_jit
def _integrated(
    equations: Equations,
    start: tuple[State, Mode],
    times: Float[Array, " times"],
    kinks: Float[Array, " kinks"],
    how: How,
) -> Integrated:
    state, mode = start
    if len(mode):
        return integrated_through_events(Equations.system, equations, start, times, kinks, how)
    size = len(equations.inverse)

    def rate(x: State, t: Scalar, equations: Equations) -> State:
        gained = equations.acceleration(x[:size], x[size:], t)
        return jnp.concatenate([x[size:], gained])

    return integrated(rate, equations, state, times, kinks, how)


@boundary_jit
def _described(drive: Drive, begun: Begun, run: Integrated) -> Transient:
    lin, equations = begun.made.linearization, begun.equations
    finite = jnp.all(jnp.isfinite(run.states))
    result = first_failure(
        (~succeeded(begun.result), begun.result),
        (run.exhausted, RESULTS.too_many_steps),
        (run.crowded, RESULTS.too_many_events),
        (~finite, RESULTS.motion_not_finite),
    )
    good = succeeded(result)
    states = jnp.where(good, run.states, 0.0)
    gained = jnp.where(good, accelerations(begun, states, run.modes), 0.0)
    size = len(equations.inverse)
    motion = SampledMotion(
        times=begun.saves,
        values=states[:, :size],
        rates=states[:, size : 2 * size],
        accelerations=gained,
        modes=run.modes,
        overruns=overruns(equations, begun.saves, states),
        shapes=begun.made.shapes,
        driver=equations.driver,
        start=equations.start,
        unit=equations.unit,
        omega0=begun.reference * equations.unit,
        frequency=jnp.ones(()),
    )
    signals = Signals(lin, begun.made.whole, motion)
    found = measures(signals, 0)
    use = friction_use(drive, lin, found)
    times = equations.start + equations.unit * begun.saves
    now = jax.vmap(equations.driver.at)(times)
    answer = Transient(
        times=times,
        driver_speeds=now.Omega,
        crank=now.theta,
        reference_speed=begun.reference,
        measures=found,
        peak_speeds=_peak_speeds(signals, begun.saves, now.Omega),
        friction_use=use,
        linearization=lin,
        signals=signals,
        unit=equations.unit,
        result=result,
        warning=first_failure(
            (jnp.min(found.tension_min) < 0, RESULTS.span_slack_in_motion),
            (jnp.max(found.slope_max) > STEEPEST, RESULTS.slope_too_large),
            (jnp.max(use) > 1, RESULTS.belt_slips_in_motion),
        ),
        stats={"steps": run.steps, "rejected": run.rejected, "events": run.events},
    )
    return frozen_where_failed(answer, result)


def _peak_speeds(
    signals: Signals, times: Float[Array, " times"], speeds: Float[Array, " times"]
) -> PeakSpeeds:
    """The driver's speed at the greatest of each signal."""
    lin, fixed = signals.linearization, jax.lax.stop_gradient(signals)

    def at_most(values: Float[Array, "times items"]) -> Float[Array, " items"]:
        return jax.lax.stop_gradient(speeds)[jnp.argmax(values, axis=0)]

    def of(function: Callable[[Scalar], Array]) -> Float[Array, "times items"]:
        return jax.vmap(function)(times)

    rotations = of(lambda at: lin.of_pulleys(fixed.rotors(at)))
    return PeakSpeeds(
        rotations=at_most(jnp.abs(rotations - jnp.mean(rotations, axis=0))),
        tensions=at_most(of(fixed.gains)),
        motions=at_most(jnp.abs(of(fixed.motions))),
        hub_loads=at_most(of(fixed.hub_loads)),
    )
