"""A mass on a spring that a moving belt drags by friction: steady sliding and stick-slip.

    m x'' + c x' + k x = N(x) g(mu(v)),  v = V - x',  N = N_0 + n_x x

    V        speed of the belt;  v  sliding speed
    g        grip (`friction_laws.grip`);  phi(v) = g(mu(v))
    zeta     c/(2 sqrt(k m))
    n_0, n_1 N_0/(V sqrt(k m)), n_x/k
    tau      time in sqrt(m/k); lengths are in V sqrt(m/k), speeds in V

docs/theory/friction_vibration.md, (F4) to (F12). Nothing here waits for an event: a path is
integrated over a given time in a fixed number of steps, and that time is an unknown.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from beltjax.compiling.batched_loops import in_lanes_of
from beltjax.numerics.derivative_rules import with_own_slopes
from beltjax.numerics.roots import bracketed_root, implicit_root, system_root
from beltjax.physics.friction_laws import FrictionCurve, grip

Scalar = Float[Array, ""]
Path = tuple[Float[Array, " nodes"], Float[Array, " nodes"]]

_STEPS = 256
_UNIFORM = np.linspace(0.0, 1.0, _STEPS + 1)
# Friction changes fastest where the mass leaves the belt and where it meets it again.
_GRADED = _UNIFORM**2 * (3 - 2 * _UNIFORM)
_RELEASING = _UNIFORM**2
_RETURN = 1.75  # periods of the free vibration after which a path that has not returned will not
_SPEEDS = 32  # of the belt, among which the fold is looked for
_LEVELS = 6  # of them, each between two of the level before
_LOWEST = 1 / 200  # of the highest of these
_MARGIN = 1.3  # of the highest beyond the estimate (F11)
_TOLERANCE = 1e-12
_NEWTON_STEPS = 25

# Gragg's method: the midpoint rule in so many steps, extrapolated to order 8 (Hairer, Norsett and
# Wanner, Solving Ordinary Differential Equations I, II.9); without the last, to order 6.
_PARTS = np.array([2, 4, 6, 8])


def _extrapolation(parts: np.ndarray) -> np.ndarray:
    square = parts.astype(float) ** 2
    ratio = square[:, None] / (square[:, None] - square + np.eye(len(parts)))
    return np.prod(ratio + np.eye(len(parts)) * (1 - np.diag(ratio)), axis=1)


_EIGHTH = _extrapolation(_PARTS)
_SIXTH = np.append(_extrapolation(_PARTS[:-1]), 0.0)


class FrictionModel(NamedTuple):
    """The numbers of one mass, in any consistent units."""

    mass: Scalar
    damping: Scalar
    stiffness: Scalar
    load: Scalar  # N_0; where `held`, N of steady sliding, whatever the speed
    gain: Scalar  # n_x
    wrap: Scalar  # 0: a block
    held: Scalar  # 1 or 0
    curve: FrictionCurve

    def phi(self, v: Array) -> Array:
        """Friction over the load at a sliding speed."""
        return grip(self.curve.coefficient(v), self.wrap)

    def sliding_load(self, v: Scalar) -> Scalar:
        """N of steady sliding at this speed (F5)."""
        free = self.load * self.stiffness / (self.stiffness - self.gain * self.phi(v))
        return jnp.where(self.held > 0, self.load, free)

    def slope(self, v: Scalar) -> Scalar:
        """F_v: derivative of friction by the sliding speed, at steady sliding."""
        return self.sliding_load(v) * jax.jvp(self.phi, (v,), (jnp.ones_like(v),))[1]

    def effective_stiffness(self, v: Scalar) -> Scalar:
        """What holds the mass while it slides: k - n_x phi."""
        return self.stiffness - self.gain * self.phi(v)


class Reduced(NamedTuple):
    """The equation of slip in pure numbers (F7)."""

    zeta: Scalar
    n0: Scalar
    n1: Scalar
    wrap: Scalar
    curve: FrictionCurve  # speeds in V

    def force(self, x: Array, v: Array) -> Array:
        """Friction on the mass."""
        return (self.n0 + self.n1 * x) * grip(self.curve.coefficient(v), self.wrap)

    def rates(self, x: Array, v: Array) -> tuple[Array, Array]:
        """Derivatives of displacement and sliding speed."""
        return 1 - v, -(self.force(x, v) - 2 * self.zeta * (1 - v) - x)

    def sliding(self) -> Array:
        """Friction over the load while the mass rests."""
        return grip(self.curve.coefficient(jnp.ones(())), self.wrap)

    def release(self) -> Scalar:
        """Where the mass begins to slip (F8)."""
        held = grip(self.curve.static, self.wrap)
        return (self.n0 * held - 2 * self.zeta) / (1 - self.n1 * held)

    def holds(self, x: Scalar) -> Bool[Array, ""]:
        """Whether static friction holds the mass on the belt at x."""
        most = (self.n0 + self.n1 * x) * grip(self.curve.static, self.wrap)
        # At release, where both are equal, rounding decides.
        return jnp.abs(x + 2 * self.zeta) <= most * (1 + 1e-9)


def reduced(model: FrictionModel, V: Scalar) -> Reduced:
    """The equation of slip on a belt of speed V."""
    m = model
    impedance = jnp.sqrt(m.mass * m.stiffness)
    load = m.sliding_load(V) * m.effective_stiffness(V) / m.stiffness  # N_0
    return Reduced(
        zeta=m.damping / (2 * impedance),
        n0=load / (V * impedance),
        n1=m.gain / m.stiffness,
        wrap=m.wrap,
        curve=m.curve.per(V),
    )


def _gragg(of: Reduced, x: Scalar, v: Scalar, h: Scalar, weights: Array) -> tuple[Scalar, Scalar]:
    """One step of extrapolation; all numbers of parts go side by side."""
    part = h / _PARTS
    start = jnp.broadcast_to(x, part.shape), jnp.broadcast_to(v, part.shape)
    rates = of.rates(*start)
    first = start[0] + part * rates[0], start[1] + part * rates[1]

    def leap(
        k: Array, state: tuple[tuple[Array, Array], tuple[Array, Array]]
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        before, now = state
        going = k < jnp.asarray(_PARTS)
        rates = of.rates(*now)
        after = before[0] + 2 * part * rates[0], before[1] + 2 * part * rates[1]
        return jax.tree.map(lambda *y: jnp.where(going, *y), (now, after), (before, now))

    _, now = jax.lax.fori_loop(1, int(_PARTS[-1]), leap, (start, first))
    return weights @ now[0], weights @ now[1]


def _path(
    of: Reduced, x: Scalar, v: Scalar, time: Scalar, grid: np.ndarray, weights: Array | None = None
) -> Path:
    """Displacements and sliding speeds at `time` times the nodes of `grid`."""
    weights = jnp.asarray(_EIGHTH) if weights is None else weights

    def step(at: tuple[Scalar, Scalar], part: Scalar) -> tuple[Path, Path]:
        after = _gragg(of, *at, time * part, weights)
        return after, after

    start = in_lanes_of(time, (x + 0.0 * time, v + 0.0 * time))
    _, (xs, vs) = jax.lax.scan(step, start, jnp.asarray(np.diff(grid)))
    return jnp.append(start[0], xs), jnp.append(start[1], vs)


class _Returned(NamedTuple):
    """The first return of a path from release towards the belt, on a coarse grid."""

    found: Bool[Array, ""]
    least: Scalar  # sliding speed at its first minimum
    at_least: Scalar  # time of that
    meets: Scalar  # time at which the mass meets the belt, where that is


def _returned(of: Reduced) -> _Returned:
    """Follow a path from release to its first minimum of the sliding speed."""
    period = 2 * jnp.pi / jnp.sqrt(1 - of.n1 * of.sliding())
    span = _RETURN * period * (1 + 1.5 * of.zeta)  # damped, it returns late
    xs, vs = _path(of, of.release(), jnp.zeros_like(span), span, _RELEASING)
    times, lengths = span * jnp.asarray(_RELEASING), span * jnp.asarray(np.diff(_RELEASING))
    turns = of.rates(xs, vs)[1]
    # At release both are 0, and rounding decides: the first steps are no return.
    armed = jnp.arange(_STEPS) > 1
    lows = (turns[:-1] < 0) & (turns[1:] >= 0) & armed
    low = jnp.argmax(lows)
    # The cubic through speeds and their derivatives; its minimum, by Newton's method.
    dt = lengths[low]
    left, right = (vs[low], turns[low] * dt), (vs[low + 1], turns[low + 1] * dt)

    def cubic(s: Scalar) -> Scalar:
        rise = right[0] - left[0]
        a, b = left[1] - rise, rise - right[1]
        return left[0] + s * rise + s * (1 - s) * ((1 - s) * a + s * b)

    slope, bend = jax.grad(cubic), jax.grad(jax.grad(cubic))
    place = left[1] / jnp.where(lows[low], left[1] - right[1], 1.0)
    for _ in range(3):
        curved = bend(place)
        place = jnp.clip(place - slope(place) / jnp.where(curved > 0, curved, jnp.inf), 0.0, 1.0)
    least = cubic(place)
    # It is met where the speed falls below 0, between two nodes or just before the minimum.
    below = (vs[1:] <= 0) & armed
    first = jnp.argmax(below)
    fall = vs[first] - vs[first + 1]
    between = times[first] + lengths[first] * vs[first] / jnp.where(fall > 0, fall, 1.0)
    ahead = jnp.sqrt(jnp.maximum(-2 * least / jnp.maximum(bend(place), 1e-300), 0.0))
    met = jnp.any(below) & (first < jnp.where(jnp.any(lows), low, _STEPS))
    at_least = times[low] + dt * place
    meets = jnp.where(met, between, at_least - dt * ahead)
    found = jnp.any(lows) | met
    return _Returned(found, jnp.where(met, jnp.minimum(least, -0.0), least), at_least, meets)


class SlipPath(NamedTuple):
    """One slip, or one period of a cycle without sticking, in pure numbers."""

    time: Scalar
    end: Scalar  # displacement there
    lowest: Scalar
    highest: Scalar
    fastest: Scalar  # greatest sliding speed
    error: Scalar  # estimate, relative to the amplitude


def _described(of: Reduced, x: Scalar, v: Scalar, time: Scalar) -> SlipPath:
    """Extremes of a path: exact, and so are their derivatives, since there the rate is 0."""
    both = jnp.stack([jnp.asarray(_EIGHTH), jnp.asarray(_SIXTH)])
    (xs, rough), (vs, _) = jax.vmap(lambda weights: _path(of, x, v, time, _GRADED, weights))(both)
    fixed = jax.lax.stop_gradient
    still, last = fixed(of), fixed(time)
    weights = jnp.asarray(_EIGHTH)
    # Where displacement is greatest, where it is least, and where the sliding speed is greatest.
    nodes = fixed(jnp.stack([jnp.argmax(xs), jnp.argmin(xs), jnp.argmax(vs)]))
    of_speed = jnp.array([0.0, 0.0, 1.0])

    def beside(x: Scalar, v: Scalar, speed: Scalar) -> tuple[Scalar, Scalar]:
        """The extreme beside a node, where its rate vanishes: a part of a step away."""

        def newton(_: Array, h: Scalar) -> Scalar:
            def along(h: Scalar) -> Scalar:
                rates = still.rates(*_gragg(still, fixed(x), fixed(v), h, weights))
                return jnp.where(speed > 0, rates[1], rates[0])

            value, slope = jax.jvp(along, (h,), (jnp.ones_like(h),))
            step = value / jnp.where(slope == 0, jnp.inf, slope)
            return jnp.clip(h - step, -2 * last / _STEPS, 2 * last / _STEPS)

        h = fixed(jax.lax.fori_loop(0, 4, newton, jnp.zeros_like(last)))
        return _gragg(of, x, v, h, weights)

    displaced, sliding = jax.vmap(beside)(xs[nodes], vs[nodes], of_speed)
    highest, lowest, fastest = displaced[0], displaced[1], sliding[2]
    size = jnp.maximum(highest - lowest, 1e-300)
    return SlipPath(time, xs[-1], lowest, highest, fastest, jnp.max(jnp.abs(xs - rough)) / size)


def _end(of: Reduced, x: Scalar, v: Scalar, time: Scalar) -> tuple[Scalar, Scalar]:
    xs, vs = _path(of, x, v, time, _GRADED)
    return xs[-1], vs[-1]


class _Closed(NamedTuple):
    start: Scalar  # displacement
    time: Scalar
    found: Bool[Array, ""]


def _closed(of: Reduced, sticks: Bool[Array, ""], guess: Float[Array, "2"]) -> _Closed:
    """Displacement at the start and time of a slip, or of a cycle that slips all the time.

    A slip begins at release and ends when the sliding speed is 0 again. The other begins where the
    displacement is greatest, and ends there.
    """

    def unmet(unknown: Float[Array, "2"], of: Reduced) -> Float[Array, "2"]:
        begun = jnp.where(sticks, 0.0, 1.0)
        x, v = _end(of, unknown[0], begun + 0.0 * unknown[0], unknown[1])
        back = jnp.where(sticks, of.release(), x)
        return jnp.stack([unknown[0] - back, v - begun])

    fixed, guess = jax.lax.stop_gradient((of, guess))
    largest = jnp.array([0.1, 0.3])
    found = system_root(
        lambda x: unmet(x, fixed), guess, largest, tol=_TOLERANCE, max_steps=_NEWTON_STEPS
    )
    good = found.converged & (jnp.abs(found.root[1] - guess[1]) < 0.5)
    start, time = implicit_root(unmet, of, jnp.where(good, found.root, guess))
    return _Closed(start, time, good)


class Onset(NamedTuple):
    """Where steady sliding becomes stable (F6)."""

    speed: Scalar  # 0: it is stable at every speed; infinite: at none
    critical_damping: Scalar  # from which on it is stable at every speed
    steepest: Scalar  # sliding speed at which friction falls most steeply


def onset(model: FrictionModel) -> Onset:
    """The sliding speed above which friction no longer feeds an oscillation."""
    m, fixed = model, jax.lax.stop_gradient(model)
    curve = fixed.curve
    falls = curve.steepness < 0
    # Speeds beyond which the law is flat, or rises.
    has_cubic = (curve.cubic > 0) & (curve.linear < 0)
    lowest = jnp.sqrt(-curve.linear / jnp.where(has_cubic, 3 * curve.cubic, jnp.inf))
    flat = jnp.where(has_cubic, lowest, 8 * curve.speed)
    nodes = flat * jnp.linspace(0.0, 1.0, 65)
    place = jnp.argmin(jax.vmap(fixed.slope)(nodes))
    rise, bend = jax.grad(fixed.slope), jax.grad(jax.grad(fixed.slope))

    def newton(_: Array, v: Scalar) -> Scalar:
        curved = bend(v)
        step = -rise(v) / jnp.where(curved > 0, curved, jnp.inf)
        return jnp.clip(
            v + step, jnp.maximum(nodes[place] - nodes[1], 0.0), nodes[place] + nodes[1]
        )

    steepest = jax.lax.fori_loop(0, 8, newton, nodes[place])
    critical = jnp.where(falls, -m.slope(jax.lax.stop_gradient(steepest)), 0.0)
    some = falls & (critical > m.damping)
    upper = _no_longer_falling(fixed, lowest)
    wanted = some & jnp.isfinite(upper)
    # Friction may fall for ever, and nothing damp it: then there is no root.
    upper = jnp.where(wanted, upper, 1.0)
    lower = jnp.where(wanted, jnp.minimum(steepest, upper), 0.0)

    def unmet(v: Scalar, m: FrictionModel) -> Scalar:
        return jnp.where(wanted, m.damping + m.slope(v), v - 0.5)

    found = bracketed_root(lambda v: unmet(v, fixed), lower, upper)
    speed = implicit_root(unmet, m, found.root)
    speed = jnp.where(wanted, speed, jnp.where(some, jnp.inf, 0.0))
    return Onset(speed, critical, steepest)


def _no_longer_falling(m: FrictionModel, lowest: Scalar) -> Scalar:
    """A sliding speed from which on damping surely outweighs friction; infinite: there is none."""
    curve, load = m.curve, jnp.maximum(m.sliding_load(0.0 * m.damping), m.load)
    drop, speed = jnp.maximum(curve.drop, 0.0), curve.speed

    def fades_below(slope: Scalar) -> Scalar:
        ratio = drop / (speed * jnp.where(slope > 0, slope, 1.0))
        faded = speed * jnp.log(jnp.maximum(ratio, 1.0))
        return jnp.where(slope > 0, faded, jnp.inf)

    faded = jnp.minimum(fades_below(m.damping / load), fades_below(curve.linear))
    return jnp.where(curve.linear < 0, lowest, faded)


def criticality(model: FrictionModel, v: Scalar) -> Scalar:
    """How a small cycle is limited (F10): above 0 gently; below 0 it grows until it sticks."""
    m = model
    one = jnp.ones_like(v)

    def derivative(f: Callable[[Scalar], Scalar]) -> Callable[[Scalar], Scalar]:
        return lambda v: jax.jvp(f, (v,), (one,))[1]

    first = derivative(m.phi)
    second = derivative(first)
    third = derivative(second)
    load, square = m.sliding_load(v), m.effective_stiffness(v)  # m omega^2
    return load * (third(v) - m.gain * first(v) * second(v) / square) / 8


def _numbers(model: FrictionModel) -> tuple[Scalar, ...]:
    return tuple(jax.tree.leaves(model))


def _model(numbers: tuple[Scalar, ...]) -> FrictionModel:
    own = len(FrictionModel._fields) - 1
    return FrictionModel(*numbers[:own], curve=FrictionCurve(*numbers[own:]))


def fold(model: FrictionModel) -> Scalar:
    """The belt speed above which nothing sticks (F9); 0: nothing ever does, infinite: at none.

    A slip from release then comes back to the belt without meeting it.
    """
    return _fold(*_numbers(model))[0]


@with_own_slopes
def _fold(*numbers: Scalar) -> Float[Array, "1"]:
    model = _model(numbers)
    m = jax.lax.stop_gradient(model)
    estimate = _MARGIN * _fold_estimate(m)
    bounded = jnp.isfinite(estimate) & (estimate > 0)
    highest = jnp.where(bounded, estimate, 1.0)
    fractions = jnp.linspace(0.0, 1.0, _SPEEDS)

    def narrowed(_: Array, state: tuple[Scalar, ...]) -> tuple[Scalar, ...]:
        """The last pair of neighboring speeds at the lower of which it sticks."""
        low, high = state[0], state[1]
        speeds = low * (high / low) ** fractions
        returned = jax.vmap(lambda V: _returned(reduced(m, V)))(speeds)
        sticks = returned.found & (returned.least <= 0)
        last = _SPEEDS - 1 - jnp.argmax(sticks[::-1])
        beyond = jnp.minimum(last + 1, _SPEEDS - 1)
        time = jnp.where(returned.found[beyond], returned.at_least[beyond], 2 * jnp.pi)
        inside = jnp.any(sticks) & ~sticks[-1]
        return speeds[last], speeds[beyond], time, jnp.any(sticks), inside

    whole = highest * _LOWEST, highest, 0.0 * highest + 2 * jnp.pi
    start = in_lanes_of(highest, (*whole, jnp.array(False), jnp.array(False)))
    first = narrowed(jnp.array(0), start)
    # Close to the fold of a steep law the least speed changes within a small part of V.
    any_sticks, inside = first[3], first[4]
    state = jax.lax.fori_loop(1, _LEVELS, narrowed, first)
    any_sticks, inside = bounded & any_sticks, bounded & any_sticks & inside
    unit, time = state[1], state[2]

    def unmet(unknown: Float[Array, "2"], model: FrictionModel) -> Float[Array, "2"]:
        of = reduced(model, unknown[0] * unit)
        x, v = _end(of, of.release(), jnp.zeros_like(unknown[1]), unknown[1])
        return jnp.stack([v, of.rates(x, v)[1]])

    guess = jnp.stack([jnp.ones_like(time), time])
    largest = jnp.array([1e-3, 0.1])
    found = system_root(lambda x: unmet(x, m), guess, largest, tol=1e-11, wanted=inside)
    # Where friction falls steeply a slip near the fold follows for long what repels it, and all of
    # its least speeds lie within a tiny part of V: there Newton's method does not see the root,
    # and the bracket is as good. The slopes hold at any of these speeds.
    near = jnp.abs(found.root[0] - 1) < 1e-2
    good = inside & found.converged & near
    root = implicit_root(unmet, model, jnp.where(good, found.root, guess))
    alone = jnp.where(any_sticks | (estimate > 0) & ~bounded, jnp.inf, 0.0)
    return jnp.where(inside, root[0] * unit, alone)[None]


def _fold_estimate(m: FrictionModel) -> Scalar:
    """An upper estimate of the fold (F11), infinite without damping, 0 where friction has no drop.

    It is that of a jump in friction (Brockley et al.) and that of an exponential drop, by the work
    of friction over one round of the amplitude V/omega; a cubic law ends where it is least.
    """
    curve = m.curve
    load = m.sliding_load(0.0 * m.damping)
    fall = load * (grip(curve.static, m.wrap) - grip(curve.level, m.wrap))
    has_cubic = (curve.cubic > 0) & (curve.linear < 0)
    jump = load * jnp.where(has_cubic, curve.jump, curve.jump + curve.drop)
    jump = jnp.where(has_cubic, jump, fall)
    damped = m.damping > 0
    c = jnp.where(damped, m.damping, 1.0)
    impedance = jnp.sqrt(m.stiffness * m.mass)
    by_jump = jump / jnp.sqrt(2 * jnp.pi * c * impedance)
    falling = jnp.where(curve.drop > 0, jnp.maximum(fall, 0.0), 0.0)
    by_drop = (falling * jnp.sqrt(2 * curve.speed / jnp.pi) / c) ** (2 / 3)
    lowest = jnp.sqrt(-curve.linear / jnp.where(has_cubic, 3 * curve.cubic, jnp.inf))
    found = jnp.maximum(by_jump, 0.0) + by_drop + jnp.where(has_cubic, lowest, 0.0)
    return jnp.where(damped | (found == 0), found, jnp.inf)


class Cycle(NamedTuple):
    """The oscillation of the mass, in the model's units."""

    sticks: Bool[Array, ""]
    passes: Bool[Array, ""]  # it meets the belt, and static friction does not hold it
    slips: Bool[Array, ""]  # it is a cycle that never sticks
    period: Scalar
    stick_time: Scalar
    lowest: Scalar
    highest: Scalar
    v_max: Scalar  # greatest sliding speed
    release: Scalar  # displacement where sticking ends
    capture: Scalar  # and where it begins
    error: Scalar


def cycle(model: FrictionModel, V: Scalar) -> Cycle:
    """Stick-slip, or below the onset a cycle that slips all the time (F8), (F10)."""
    sticks, passes, slips, *numbers = _cycle(V, *_numbers(model))
    return Cycle(sticks > 0, passes > 0, slips > 0, *numbers)


@with_own_slopes
def _cycle(V: Scalar, *numbers: Scalar) -> Float[Array, " numbers"]:
    model = _model(numbers)
    of = reduced(model, V)
    fixed = jax.lax.stop_gradient
    coarse = _returned(fixed(of))
    meets = coarse.found & (coarse.least <= 0)
    grown = model.damping + model.slope(V)
    limit = criticality(model, V)
    soft = (grown < 0) & (limit > 0)
    square = fixed(-grown / jnp.where(soft, limit, 1.0))
    frequency = jnp.sqrt(jnp.maximum(model.effective_stiffness(V) / model.stiffness, 1e-12))
    amplitude = jnp.minimum(jnp.sqrt(jnp.maximum(square, 0.0)) / V, 0.98) / frequency
    centre = of.n0 * of.sliding() / frequency**2
    guess = jnp.where(
        meets,
        jnp.stack([of.release(), coarse.meets]),
        jnp.stack([centre + amplitude, 2 * jnp.pi / frequency]),
    )
    whole = _closed(of, meets, guess)
    path = _described(of, whole.start, jnp.where(meets, 0.0, 1.0), whole.time)
    capture = path.end
    stuck = of.release() - capture
    sticks = meets & whole.found & of.holds(capture) & (stuck > 0)
    small = path.highest - path.lowest < 1e-9
    slips = soft & ~meets & whole.found & ~small & (path.fastest < 2.5)
    length, time = (
        V * jnp.sqrt(model.mass / model.stiffness),
        jnp.sqrt(model.mass / model.stiffness),
    )
    kept = sticks | slips
    waits = jnp.where(sticks, stuck, 0.0)
    found = [
        time * (path.time + waits),
        time * waits,
        length * path.lowest,
        length * path.highest,
        V * path.fastest,
        length * jnp.where(sticks, of.release(), path.highest),
        length * jnp.where(sticks, capture, path.highest),
        path.error,
    ]
    shown = [jnp.where(kept, number, 0.0) for number in found]
    flags = [flag.astype(float) for flag in (sticks, meets & ~sticks, slips)]
    return jnp.stack([*flags, *shown])
