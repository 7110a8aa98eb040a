"""By how much an excitation may grow before a drive is unstable anywhere in a range of speeds."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Int

from beltjax.analysis.damping import Damping
from beltjax.analysis.exact_tongues import Shaking, exact_factors, growth_in_tip
from beltjax.analysis.linearization import Linearization, linearize
from beltjax.analysis.parametric import (
    TERMS,
    PairsAsked,
    is_commensurate,
    modulated,
    resonating,
    slack_factor,
)
from beltjax.analysis.response import Excitation
from beltjax.analysis.sensitivity import Gradient
from beltjax.analysis.steady import steady_state
from beltjax.compiling.quick import boundary_jit, quickly_compiled
from beltjax.drive.canonical import canonical, restored, strongly_typed
from beltjax.drive.components import as_real, concrete
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.readable import Readable
from beltjax.drive.system import Drive
from beltjax.numerics.bases import AbstractBasis, Legendre
from beltjax.numerics.derivative_rules import without_derivative
from beltjax.numerics.gyroscopic import hermitian_modes
from beltjax.numerics.parametric import (
    cluster_critical,
    cluster_of,
    critical_square,
    pair_growth,
    pair_terms,
    pairs_of,
)
from beltjax.numerics.roots import implicit_root, implicit_solution
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
    succeeded,
)

Scalar = Float[Array, ""]
_GRID = 25  # speeds on which tongues are bracketed
_POLISHED = 2  # steps of Newton's method from there
LEAST = 4  # tongues whose factors have derivatives


class Tongues(Readable):
    """Where each pair of modes is in resonance, and from which excitation on it is unstable.

    A pair whose resonance is not in the range of speeds stands at its closer end, with its
    detuning there. Values have no derivatives (they are NaN); `Margin.least` has.
    """

    modes: Int[Array, "pairs 2"]  # r <= s, from 1 on
    driver_speed: Float[Array, " pairs"]  # [rad/s]
    frequency: Float[Array, " pairs"]  # of the excitation [rad/s]
    inside: Bool[Array, " pairs"]  # whether the resonance lies in the range
    half_width: Float[Array, " pairs"]  # of the unstable frequencies [rad/s]; 0: it is stable
    growth: Float[Array, " pairs"]  # of the pair alone under the excitation [1/s]
    coupling: Float[Array, " pairs"]  # sqrt(Lam) [rad/s]
    decays: Float[Array, "pairs 2"]  # of the two modes [1/s]
    sweep: Float[Array, " pairs"]  # of the detuning, per driver's speed
    critical_factor: Float[Array, " pairs"]  # with the modes that are near; inf: never
    # The same by Floquet's theory in the neighborhood; NaN where it was not asked for.
    exact_factor: Float[Array, " pairs"]
    slack_factor: Float[Array, " pairs"]  # at which a span goes slack there, or in the exact place
    tension_fluctuation: Complex[Array, "pairs spans"]  # [N]

    @property
    def kind(self) -> tuple[str, ...]:
        """'principal' of a mode with itself, 'sum' of two."""
        return tuple("principal" if r == s else "sum" for r, s in self.modes.tolist())

    @property
    def slack(self) -> Bool[Array, " pairs"]:
        """Whether a span goes slack before the tongue is reached."""
        return self.best_factor >= self.slack_factor

    @property
    def best_factor(self) -> Float[Array, " pairs"]:
        """The critical factor, exact where it was found so."""
        return jnp.where(jnp.isnan(self.exact_factor), self.critical_factor, self.exact_factor)


class Margin(Readable):
    """What is left before parametric instability."""

    # The factor by which the excitation may grow; inf where no tongue is reached before a span
    # goes slack.
    margin: Float[Array, ""]
    speed: Float[Array, ""]  # of the driver in the worst tongue [rad/s]
    modes: Int[Array, "2"]  # of the worst tongue, from 1 on
    worst: Int[Array, ""]  # its place among the tongues
    # The least critical factors, slack or not: each is smooth where they do not change places.
    least: Float[Array, " least"]
    tongues: Tongues
    complete: Bool[Array, ""]  # whether modes beyond those have no resonance in the range
    result: RESULTS
    warning: RESULTS  # `span_slackens` where the worst tongue is beyond slack

    @property
    def safe(self) -> bool:
        """Whether no speed of the range is unstable under the excitation."""
        return bool(self.margin >= 1)


def parametric_margin(
    drive: Drive,
    point: OperatingPoint,
    driver_speeds: tuple[float, float],
    excitation: Excitation,
    *,
    damping: Damping,
    order: Scalar | float = 2.0,
    exact: bool = False,
    count: int = 12,
    basis: AbstractBasis | None = None,
    throw: bool = True,
) -> Margin:
    """The factor by which an excitation may grow before some speed of a range is unstable.

    For each pair of modes the speed is found at which their frequencies add up to that of the
    excitation, and the critical factor there, with the modes that are near:
    docs/theory/parametric.md, (P12). Tongues are narrow, so that no grid of speeds would meet
    them. `margin` and `least` have derivatives, forward (`jax.jvp`, `jax.jacfwd`) and in reverse
    (`jax.grad`), which take a minute to compile; the places have none. With `exact` the least
    tongues are refined by Floquet's theory about the linear response, within 3 % of their speed.
    Tongues beyond the factor at which a span goes slack do not
    count.

    The result is that of the steady states, `drive_diverges`, `commensurate`, `no_damping` or
    `response_not_finite`, of the first speed that fails. The warning `span_slackens` says that a
    span goes slack before the least tongue is reached.

    Args:
        drive: the drive.
        point: its torques; speeds of the range replace its speed.
        driver_speeds: from and to, > 0 [rad/s].
        excitation: crank motion and torques, the same at each speed.
        damping: of the drive, which must damp all modes.
        order: excitation frequency over the driver's speed.
        exact: refine the least tongues.
        count: number of modes, the lowest, whose pairs are looked at, up to 16. `complete` says
            whether they are enough for the range.
        basis: functions for the deflections of each span, `Legendre(16)` unless given.
        throw: raise where the result is a failure.

    Returns:
        The margin, the worst tongue and all others.

    Raises:
        ValueError: speeds are not positive or do not increase, the excitation names a pulley that
            is not there, or an inertia is missing.
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> crank, damping = bj.Excitation(crank=0.001), bj.Damping(modal=0.02)
        >>> speeds = 100.0, 300.0  # [rad/s]
        >>> found = bj.parametric_margin(
        ...     drive, point, speeds, crank, damping=damping, count=2, basis=bj.Legendre(8)
        ... )
        >>> found.margin, found.modes
    """
    ends = as_real(driver_speeds[0]), as_real(driver_speeds[1])
    require_range(*ends)
    if not 1 <= count <= 16:
        raise ValueError(f"count: found {count}; give 1 to 16.")
    excitation, damping = strongly_typed((excitation, damping))
    basis = Legendre(16) if basis is None else basis
    at = Shaking(
        *canonical(drive, point),
        (excitation.crank, excitation.on(drive.pulley_names)),
        as_real(order),
        damping,
    )
    found = _margin(at, ends, MarginAsked(count, exact, basis))
    return raise_unless_successful(found, found.result, throw)


class MarginAsked(NamedTuple):
    """The options of `parametric_margin`."""

    modes: int
    exact: bool
    basis: AbstractBasis


def require_range(lower: Scalar, upper: Scalar) -> None:
    """Raise `ValueError` unless speeds are positive and increase, as far as they are known."""
    low, high = concrete(lower), concrete(upper)
    if low is not None and high is not None and not (low > 0).all() & (low < high).all():
        raise ValueError(f"driver_speeds: found {low:g}, {high:g}; give 0 < from < to [rad/s].")


def _at(of: Shaking, speed: Scalar, basis: AbstractBasis) -> Linearization:
    """The drive about its steady state at a speed of its driver."""
    steady = steady_state(of.drive, of.point.at_driver_speed(speed), throw=False)
    return linearize(steady, basis, throw=False)


class _Evaluated(NamedTuple):
    """One pair at one speed."""

    critical: Scalar
    growth: Scalar  # [1/s]
    coupling: Scalar  # [rad/s]
    decays: Float[Array, "2"]  # [1/s]
    half_width: Scalar  # [rad/s]
    slack: Scalar
    tensions: Complex[Array, " spans"]  # [N]
    damped: Bool[Array, ""]
    result: RESULTS


def _evaluated(
    of: Shaking, speed: Scalar, pair: Int[Array, "2"], asked: MarginAsked
) -> tuple[Scalar, _Evaluated]:
    """By how much the excitation is off the pair's resonance [rad/s], and the rest."""
    crank, torques = of.shaken
    lin = _at(of, speed, asked.basis)
    at = resonating(lin, of.order * speed, crank, torques, of.damping, asked.modes)
    modulation = modulated(lin, at, crank, PairsAsked(TERMS, asked.modes, False))
    terms = pair_terms(at.basis, modulation, at.frequency, pair[None])
    square = critical_square(terms)[0]
    near = jnp.sqrt(jnp.where(square > 0, square, 1.0)) * (square > 0)
    cluster = cluster_of(at.basis, modulation, at.frequency, pair, near)
    time, tensions = lin.scales.time, at.primary.tensions
    finite = jnp.all(jnp.isfinite(at.primary.z)) & jnp.all(jnp.isfinite(at.basis.frequencies))
    total = terms.decay_r[0] + terms.decay_s[0]
    beyond = jnp.maximum(1 / jnp.maximum(square, 1e-300) - 1, 0.0)
    result = first_failure(
        (~succeeded(lin.result), lin.result),
        (~at.definite, RESULTS.drive_diverges),
        (is_commensurate(lin), RESULTS.commensurate),
        (~finite, RESULTS.response_not_finite),
    )
    return terms.detuning[0] / time, _Evaluated(
        critical=cluster_critical(cluster, near),
        growth=pair_growth(terms)[0] / time,
        coupling=jnp.sqrt(jnp.maximum(terms.product[0], 1e-300)) / time,
        decays=jnp.concatenate([terms.decay_r, terms.decay_s]) / time,
        half_width=jax.lax.stop_gradient(total * jnp.sqrt(beyond)) / time,
        slack=slack_factor(lin, tensions),
        tensions=tensions * lin.scales.tension,
        damped=jnp.min(at.basis.decays) > 0,
        result=result,
    )


def _frequencies(of: Shaking, speed: Scalar, asked: MarginAsked) -> Float[Array, " modes"]:
    """The lowest natural frequencies at a speed [rad/s]."""
    lin = _at(of, speed, asked.basis)
    found, _ = hermitian_modes(lin.mass, lin.gyroscopic, lin.stiffness, asked.modes)
    return found.values.imag / lin.scales.time


class _Places(NamedTuple):
    """Speeds of the pairs' resonances."""

    speed: Float[Array, " pairs"]
    inside: Bool[Array, " pairs"]
    sweep: Float[Array, " pairs"]
    complete: Bool[Array, ""]  # no pair of a mode beyond those is in the range


def _places(
    of: Shaking, ends: tuple[Scalar, Scalar], pairs: Int[np.ndarray, "pairs 2"], asked: MarginAsked
) -> _Places:
    """Where the excitation meets the sum of two frequencies: on a grid, then by Newton's method."""
    speeds = jnp.linspace(*ends, _GRID)
    frequencies = jax.vmap(lambda speed: _frequencies(of, speed, asked))(speeds)
    sums = frequencies[:, pairs[:, 0]] + frequencies[:, pairs[:, 1]]
    left = of.order * speeds[:, None] - sums  # rises
    above = left >= 0
    place = jnp.argmax(above, axis=0)
    inside = jnp.any(above, axis=0) & (place > 0)
    upper = jnp.clip(place, 1, _GRID - 1)
    columns = jnp.arange(len(pairs))
    low, high = speeds[upper - 1], speeds[upper]
    below, beyond = left[upper - 1, columns], left[upper, columns]
    slope = (beyond - below) / (high - low)

    def polish(_: Array, speed: Array) -> Array:
        there = jax.vmap(lambda speed: _frequencies(of, speed, asked))(speed)
        total = there[columns, pairs[:, 0]] + there[columns, pairs[:, 1]]
        return jnp.clip(speed - (of.order * speed - total) / slope, low, high)

    start = jnp.clip(low - below / slope, low, high)
    start = _curved(left, speeds, upper, columns, start)
    speed = jax.lax.fori_loop(0, _POLISHED, polish, jnp.clip(start, low, high))
    outside = jnp.where(jnp.any(above, axis=0), ends[0], ends[1])
    complete = jnp.all(of.order * speeds <= frequencies[:, 0] + frequencies[:, -1])
    return _Places(jnp.where(inside, speed, outside), inside, slope, complete)


def _curved(
    left: Float[Array, "grid pairs"],
    speeds: Float[Array, " grid"],
    upper: Int[Array, " pairs"],
    columns: Int[Array, " pairs"],
    start: Float[Array, " pairs"],
) -> Float[Array, " pairs"]:
    """The root of a cubic through four points of the grid, near `start`."""
    first = jnp.clip(upper - 2, 0, _GRID - 4)
    points = first[:, None] + np.arange(4)
    x, y = speeds[points], left[points, columns[:, None]]
    # Through the inverse function, which is as smooth.
    found = jnp.zeros_like(start)
    for k in range(4):
        weight = jnp.ones_like(start)
        for j in range(4):
            if j != k:
                apart = y[:, k] - y[:, j]
                weight = weight * -y[:, j] / jnp.where(apart == 0, 1.0, apart)
        found = found + weight * x[:, k]
    return jnp.where(jnp.isfinite(found), found, start)


@boundary_jit
def _margin(given: Shaking, ends: tuple[Scalar, Scalar], asked: MarginAsked) -> Margin:
    fixed, ends = jax.lax.stop_gradient((given, ends))
    pairs = pairs_of(asked.modes)
    places = _places(fixed, ends, pairs, asked)

    def one(speed: Array, pair: Array) -> tuple[_Evaluated, RESULTS]:
        _, found = _evaluated(fixed, speed, pair, asked)
        return found._replace(result=None), found.result

    found, results = jax.vmap(one)(places.speed, jnp.asarray(pairs))
    exact, speeds, slack = jnp.full(len(pairs), jnp.nan), places.speed, found.slack
    order = jnp.argsort(found.critical)[:LEAST]
    if asked.exact:
        near = places.speed[order], found.critical[order]
        tips = exact_factors(fixed, *near, ends, asked.basis)
        # What is not in the range would take the tip of another one.
        there = places.inside[order]
        exact = exact.at[order].set(jnp.where(there, tips.factor, jnp.nan))
        speeds = speeds.at[order].set(jnp.where(there, tips.speed, near[0]))
        slack = slack.at[order].set(jnp.where(there, tips.slack, slack[order]))
    tongues = Tongues(
        modes=jnp.asarray(pairs) + 1,
        driver_speed=places.speed,
        frequency=fixed.order * places.speed,
        inside=places.inside,
        half_width=found.half_width,
        growth=found.growth,
        coupling=found.coupling,
        decays=found.decays,
        sweep=places.sweep,
        critical_factor=found.critical,
        exact_factor=exact,
        slack_factor=slack,
        tension_fluctuation=found.tensions,
    )
    factors = jnp.where(tongues.slack, jnp.inf, tongues.best_factor)
    worst = jnp.argmin(jnp.where(jnp.isfinite(factors), factors, 1e30 + tongues.best_factor))
    failed = results != RESULTS.successful
    first = jnp.argmax(failed)
    why = jax.tree.map(lambda code: code[first], results)
    result = first_failure((jnp.any(failed), why), (~jnp.all(found.damped), RESULTS.no_damping))
    places_of = jnp.concatenate([worst[None], order])
    values = jnp.concatenate([factors[worst][None], found.critical[order]])
    held = _Held(
        places.speed[places_of],
        places.inside[places_of],
        jnp.asarray(pairs)[places_of],
        speeds[worst],
        ~jnp.isnan(exact[worst]),
    )
    smooth = _with_slopes(given, held, values, asked=asked)
    moving = without_derivative(0.0 * jnp.sum(jnp.where(jnp.isfinite(smooth), smooth, 0.0)))
    tongues = jax.tree.map(
        lambda x: x + moving if jnp.issubdtype(x.dtype, jnp.inexact) else x, tongues
    )
    answer = Margin(
        margin=smooth[0],
        speed=speeds[worst],
        modes=jnp.asarray(pairs)[worst] + 1,
        worst=worst,
        least=smooth[1:],
        tongues=tongues,
        complete=places.complete,
        result=result,
        warning=first_failure((~jnp.isfinite(factors[worst]), RESULTS.span_slackens)),
    )
    return frozen_where_failed(answer, result)


class _Held(NamedTuple):
    """Some tongues as they were found."""

    speed: Float[Array, " few"]
    inside: Bool[Array, " few"]
    pairs: Int[Array, "few 2"]
    tip: Scalar  # speed at the tip of the first
    refined: Bool[Array, ""]  # whether its factor is that of the tip


def _factors(
    given: Shaking, held: _Held, first: Scalar, asked: MarginAsked
) -> Float[Array, " few"]:
    """Critical factors in places that move with the drive."""

    def at(root: Array, args: tuple[Shaking, tuple[Array, ...]]) -> tuple[Array, Array]:
        of, (speed, inside, pair) = args
        left, found = _evaluated(of, root[0], pair, asked)
        residual = jnp.where(inside, left, root[0] - speed)
        return residual[None], found.critical

    def one(tongue: tuple[Array, ...]) -> Array:
        return implicit_solution(at, (given, tongue), tongue[0][None])[1]

    # One after the other: in a batch linear algebra and its derivatives wait for each other.
    found = jax.lax.map(one, (held.speed, held.inside, held.pairs))
    if not asked.exact:
        return found

    def left(factor: Array, of: Shaking) -> Array:
        # The place of a least factor does not matter to first order.
        return growth_in_tip(of, held.tip, factor, asked.basis)

    tip = implicit_root(left, given, first)
    return found.at[0].set(jnp.where(held.refined, tip, found[0]))


def margin_gradient(
    drive: Drive,
    point: OperatingPoint,
    excitation: Excitation,
    damping: Damping,
    order: Scalar | float,
    asked: MarginAsked,
    found: Margin,
) -> Gradient:
    """Derivatives of a margin that was found by all numbers of the drive and the point."""
    of, worst = found.tongues, found.worst
    tip = asked.exact and not bool(jnp.isnan(of.exact_factor[worst]))
    held = _Held(
        of.driver_speed[worst][None], of.inside[worst][None], found.modes[None] - 1,
        found.speed, jnp.asarray(tip),
    )  # fmt: skip
    shaken = excitation.crank, excitation.on(drive.pulley_names)
    given = Shaking(*canonical(drive, point), shaken, as_real(order), damping)
    slopes = quickly_compiled(_gradient)(given, held, found.margin, asked._replace(exact=tip))
    return restored(slopes, drive, point)


def _gradient(given: Shaking, held: _Held, first: Scalar, asked: MarginAsked) -> Gradient:
    def factor(numbers: Gradient) -> Scalar:
        return _factors(given._replace(drive=numbers[0], point=numbers[1]), held, first, asked)[0]

    return eqx.filter_grad(factor)((given.drive, given.point))


@eqx.filter_custom_jvp
def _with_slopes(
    given: Shaking, held: _Held, values: Float[Array, " few"], *, asked: MarginAsked
) -> Float[Array, " few"]:
    """`values`, with the derivatives of the critical factors in their places, which move."""
    return values


@_with_slopes.def_jvp
def _with_slopes_jvp(
    primals: tuple[Any, ...], tangents: tuple[Any, ...], *, asked: MarginAsked
) -> tuple[Any, Any]:
    given, held, values = primals
    moved = tangents[0]
    moves = jax.tree.map(lambda x: x is not None, moved, is_leaf=lambda x: x is None)
    numbers, others = eqx.partition(given, moves)

    def factors(numbers: Shaking) -> Float[Array, " few"]:
        return _factors(eqx.combine(numbers, others), held, values[0], asked)

    _, change = jax.jvp(factors, (numbers,), (moved,))
    return values, jnp.where(jnp.isfinite(values), change, 0.0)
