"""Vibration of a single moving beam, and of each span of a drive taken alone (chapter 2)."""

from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float

from beltjax.analysis.steady import SteadyState, steady_state
from beltjax.compiling.quick import boundary_jit, usual_promotion
from beltjax.drive.canonical import canonical
from beltjax.drive.components import as_real, concrete
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.readable import Readable
from beltjax.drive.system import Drive
from beltjax.physics import moving_beam as beam
from beltjax.physics import moving_beam_expansion as expansion
from beltjax.physics import moving_beam_shapes as shapes
from beltjax.physics.waves import wave_numbers
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
    succeeded,
)

Scalar = Float[Array, ""]
Support = Literal["simple", "fixed"]
Ends = tuple[Support, Support]
Method = Literal["exact", "perturbation"]
METHODS = ("exact", "perturbation")


class MovingBeamModes(Readable):
    """Frequencies and complex modes of a moving beam: w(x, t) = Re[shape(x) e^{-i omega t}].

    All is dimensionless: x is over the span's length L, and frequencies are in sqrt(P/m)/L.
    """

    frequencies: Float[Array, " count"]  # omega, ascending
    wave_numbers: Complex[Array, "count 4"]  # r1..r4
    amplitudes: Complex[Array, "count 4"]  # c1..c4 of (2.33)
    error: Float[Array, " count"]  # relative; see `moving_beam_modes`
    bending: Scalar  # eps
    speed: Scalar  # v
    result: RESULTS
    stats: dict[str, Array]
    ends: Ends = eqx.field(static=True)
    method: Method = eqx.field(static=True)

    @usual_promotion
    def shapes(self, x: Any) -> Complex[Array, "count ..."]:
        """The modes at `x` in [0, 1], of any shape, scaled to c2 = i/2.

        The wave that travels against the beam has amplitude 1/2: simple supports at rest give
        sin(n pi x). Derivatives with respect to `bending` need bending > 0.
        """
        x = as_real(x)
        return jax.vmap(shapes.shape, (0, 0, None))(self.wave_numbers, self.amplitudes, x)


class SpanFrequencies(Readable):
    """Frequencies of each span of a running drive between ends that do not move."""

    hertz: Float[Array, "spans count"]
    tensions: Float[Array, " spans"]  # P_i + T P0, running [N]
    bending: Float[Array, " spans"]  # eps_i = sqrt(EI/P)/L of each span, under its own tension
    speed: Float[Array, " spans"]  # v_i = c sqrt(m/P)
    error: Float[Array, "spans count"]  # relative, of the dimensionless frequency
    result: RESULTS


def moving_beam_modes(
    bending: Any,
    speed: Any,
    ends: Ends = ("simple", "simple"),
    count: int = 4,
    method: Method = "exact",
    *,
    throw: bool = True,
) -> MovingBeamModes:
    """The lowest `count` frequencies and modes of a tensioned beam that moves along itself.

    Kong (2003), chapter 2; docs/theory/moving_beam.md. Tension is P, span length L, mass per length
    m and transport speed c. Both methods are differentiable in `bending` and `speed`, also at 0.

    "exact" solves the boundary determinant for any bending >= 0 and any speed below critical,
    v^2 = 1 + beta^2 bending^2 with beta = pi for simple supports, 4.4934 with one fixed end and
    2 pi with two; `error` is the size of the last step of Newton's method. "perturbation" is
    (2.28), (2.37) or (2.38) with the next term (docs/theory/moving_beam.md, (B10) and (B11)), the
    roots (2.15) and the modes (2.34), for speeds below 1 and small bending; `error` is the size of
    the last term.

    The result is `beyond_critical_speed` at the critical speed and above, `beam_unusable` for a
    bending that is negative or numbers that are not finite, and `frequency_not_found` where the
    search did not end. With `throw=False` read `.result`: then all values are zero, with zero
    derivatives.

    Args:
        bending: eps = sqrt(EI/P)/L >= 0, a number; 0 for a string.
        speed: v = c sqrt(m/P), a number of either sign.
        ends: the supports at x = 0 and x = 1, each "simple" (w = w'' = 0) or "fixed"
            (w = w' = 0).
        count: number of frequencies, 1 or more.
        method: "exact" or "perturbation".
        throw: raise where the result is a failure.

    Returns:
        Frequencies of shape [count] in sqrt(P/m)/L, and the modes.

    Raises:
        ValueError: an option is unknown, `count` is not a whole number above 0, or `bending` or
            `speed` is an array, not finite or, for `bending`, negative.
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> bj.moving_beam_modes(0.01, 0.5, ("fixed", "fixed")).frequencies
    """
    ends, count = _checked_ends(ends), _checked_count(count)
    if method not in METHODS:
        raise ValueError(f"method: {method!r} is not one of {', '.join(map(repr, METHODS))}.")
    eps, v = _checked_number("bending", bending), _checked_number("speed", speed)
    eps_known = concrete(eps)
    if eps_known is not None and eps_known < 0:
        raise ValueError(
            f"bending: found {eps_known:g}, but sqrt(EI/P)/L is not negative. Give 0 for a string."
        )
    found = _modes(eps, v, ends, count, method)
    return raise_unless_successful(found, found.result, throw)


def span_frequencies(
    drive: Drive,
    point: OperatingPoint,
    ends: Ends = ("simple", "simple"),
    count: int = 4,
    *,
    throw: bool = True,
) -> SpanFrequencies:
    """The lowest `count` frequencies [Hz] of each span of a running drive, taken alone.

    A tension meter measures them. A span between its tangent points, under its running tension
    P_i + T, moves at the belt's speed, while pulleys and tensioners do not vibrate. Kong (2003),
    chapter 2; docs/theory/moving_beam.md.

    The result is that of `steady_state`, or `frequency_not_found`. With `throw=False` read
    `.result`: a failed lane of a batch holds zeros with zero derivatives.

    Args:
        drive: the drive.
        point: speeds and torques.
        ends: the supports of each span, as in `moving_beam_modes`; those of a real span lie
            between "simple" and "fixed".
        count: number of frequencies of each span, 1 or more.
        throw: raise where the result is a failure.

    Returns:
        Frequencies of shape [spans, count], with each span's tension, bending and speed.

    Raises:
        ValueError: `ends` or `count` is not available.
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> bj.span_frequencies(drive, point).hertz[:, 0]  # the lowest of each span
    """
    ends, count = _checked_ends(ends), _checked_count(count)
    found = _span_frequencies(*canonical(drive, point), ends, count)
    return raise_unless_successful(found, found.result, throw)


def _checked_ends(ends: Any) -> Ends:
    found = tuple(ends) if isinstance(ends, tuple | list) else (ends,)
    if len(found) != 2:
        raise ValueError(f"ends: give a pair such as ('simple', 'fixed'), not {ends!r}.")
    for end in found:
        beam.require_support(end)
    return found


def _checked_count(count: Any) -> int:
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 1:
        raise ValueError(f"count: give a whole number of modes, 1 or more, not {count!r}.")
    return int(count)


def _checked_number(name: str, value: Any) -> Scalar:
    number = as_real(value)
    if number.shape != ():
        raise ValueError(
            f"{name}: give one number, not an array of shape {number.shape}; "
            "jax.vmap takes a batch of them."
        )
    known = concrete(number)
    if known is not None and not np.isfinite(known):
        raise ValueError(f"{name}: found {known}; give a finite number.")
    return number


class _Solved(NamedTuple):
    omega: Float[Array, " count"]
    error: Float[Array, " count"]
    converged: Bool[Array, ""]
    steps: Array


def _exact_frequencies(eps: Scalar, v: Scalar, ends: Ends, count: int) -> _Solved:
    found = jax.vmap(lambda n: beam.frequency(eps, v, n, ends))(jnp.arange(1, count + 1))
    return _Solved(found.omega, found.error, jnp.all(found.converged), jnp.max(found.steps))


def _leading_frequencies(eps: Scalar, v: Scalar, ends: Ends, count: int) -> _Solved:
    terms = expansion.frequency_terms(eps, v, jnp.arange(1, count + 1), ends)
    omega = sum(terms[1:], terms[0])
    return _Solved(omega, jnp.abs(terms[-1] / omega), jnp.array(True), jnp.array(0))


def _outcome(eps: Scalar, v: Scalar, limit: Scalar) -> tuple[Scalar, Scalar, RESULTS]:
    """Numbers to compute with, harmless where the result is a failure, and the result."""
    usable = jnp.isfinite(eps) & jnp.isfinite(v) & (eps >= 0)
    result = first_failure(
        (~usable, RESULTS.beam_unusable),
        (~(jnp.abs(v) < limit), RESULTS.beyond_critical_speed),
    )
    good = succeeded(result)
    return jnp.where(good, eps, 0.0), jnp.where(good, v, 0.0), result


@boundary_jit
def _modes(eps: Scalar, v: Scalar, ends: Ends, count: int, method: Method) -> MovingBeamModes:
    exact = method == "exact"
    limit = beam.critical_speed(eps, ends) if exact else jnp.ones_like(eps)
    eps, v, result = _outcome(eps, v, limit)
    if exact:
        solved = _exact_frequencies(eps, v, ends, count)
        stiffness, tension = eps**2, (1.0 - v) * (1.0 + v)
        roots = wave_numbers(stiffness, tension, v, jnp.ones_like(v), solved.omega)
        amplitudes = shapes.exact_amplitudes(roots, ends)
    else:
        solved = _leading_frequencies(eps, v, ends, count)
        roots = expansion.leading_wave_numbers(eps, v, solved.omega)
        amplitudes = shapes.leading_amplitudes(roots, ends)
    unfound = succeeded(result) & ~solved.converged
    result = RESULTS.where(unfound, RESULTS.frequency_not_found, result)
    good = succeeded(result)

    def kept(values: Array) -> Array:
        return jnp.where(good, values, jnp.zeros_like(values))

    modes = MovingBeamModes(
        frequencies=kept(solved.omega),
        wave_numbers=kept(jnp.stack([r.astype(complex) for r in roots], axis=-1)),
        amplitudes=kept(jnp.stack(amplitudes, axis=-1)),
        error=kept(solved.error),
        bending=eps,
        speed=v,
        result=result,
        stats={"steps": solved.steps},
        ends=ends,
        method=method,
    )
    return frozen_where_failed(modes, result)


class HeldSpans(NamedTuple):
    """The spans of a running drive as moving beams; those of one that does not run are strings."""

    bending: Float[Array, " spans"]
    speed: Float[Array, " spans"]
    unit: Float[Array, " spans"]  # of their frequencies [Hz]


def held_spans(steady: SteadyState) -> HeldSpans:
    """Each span of a running drive, taken alone between pulleys that do not vibrate."""
    groups = steady.groups
    # A single beam is scaled by its own length and tension P_i + T; Q is that tension less s^2.
    loops = groups.loops
    mass, speed = loops.spread(groups.masses), loops.spread(groups.speeds)
    root = jnp.sqrt(steady.effective_tensions + mass * speed**2)
    ran = succeeded(steady.result)
    return HeldSpans(
        bending=jnp.where(ran, loops.spread(groups.bendings) / (groups.span_ratios * root), 0.0),
        speed=jnp.where(ran, speed * jnp.sqrt(mass) / root, 0.0),
        unit=root / (2.0 * jnp.pi * groups.span_ratios * steady.scales.time * jnp.sqrt(mass)),
    )


def lowest_of_spans(spans: HeldSpans) -> Float[Array, " spans"]:
    """The lowest frequency [Hz] of each span, whose ends turn freely."""
    ends = ("simple", "simple")

    def lowest(eps: Scalar, v: Scalar) -> Scalar:
        return _exact_frequencies(eps, v, ends, 1).omega[0]

    return spans.unit * jax.vmap(lowest)(spans.bending, spans.speed)


@boundary_jit
def _span_frequencies(
    drive: Drive, point: OperatingPoint, ends: Ends, count: int
) -> SpanFrequencies:
    steady = steady_state(drive, point, throw=False)
    eps, v, unit = held_spans(steady)
    ran = succeeded(steady.result)
    solved = jax.vmap(lambda eps, v: _exact_frequencies(eps, v, ends, count))(eps, v)
    result = RESULTS.where(
        ran & ~jnp.all(solved.converged), RESULTS.frequency_not_found, steady.result
    )
    good = succeeded(result)
    found = SpanFrequencies(
        hertz=jnp.where(good, unit[:, None] * solved.omega, 0.0),
        tensions=steady.running_tensions,
        bending=eps,
        speed=v,
        error=jnp.where(good, solved.error, 0.0),
        result=result,
    )
    return frozen_where_failed(found, result)
