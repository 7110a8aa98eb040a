"""Sequential quadratic programming from one start: the iteration, for lanes of a batch.

    minimize f(x) subject to c(x) <= 0, least <= x <= greatest

with an l1 penalty whose program always has a solution (R. Fletcher's Sl1QP), a trust region, exact
first derivatives, and for the Lagrangian's second derivatives either these, made positive definite,
or damped BFGS updates. Each iteration evaluates once. A step that fails because the constraints are
curved is corrected by what its own evaluation has shown. A search that does not get on begins anew
from where it is, at a higher price. J. Nocedal and S. Wright, Numerical Optimization (2006),
chapter 18.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .quadratic_program import QuadraticProgram, solve_quadratic_program

Vector = Float[Array, " variables"]
Rows = Float[Array, " constraints"]
Square = Float[Array, "variables variables"]
Scalar = Float[Array, ""]
Flag = Bool[Array, ""]

_GROWTH = 4.0  # of the price of violation, where a program leaves some at that price
_LEAST_PRICE = 1e-6
LARGEST_PRICE = 1e10  # where that leaves some, no small change helps
RESTARTS = 3  # times a search that does not get on begins anew from where it is
_LEAST_GAIN = 1e-4  # part of the predicted gain with which a step is taken
_POOR, _GOOD = 0.25, 0.75  # parts of it below and above which the radius changes
_ROOM = 1e-14  # between bounds that leave none
_WIDEST = 1e6  # radius, over the first one
_LEAST_CURVATURE = 1e-10  # relative; what bends as the sixth power counts as bent, to 1e-9
_ACROSS = 10.0  # curvature across rows that hold, over that of the Lagrangian


class LocalSlopes(NamedTuple):
    """Objective, constraints and their exact derivatives at a point."""

    f: Scalar
    c: Rows
    g: Vector
    J: Float[Array, "constraints variables"]
    valid: Flag  # whether there are values at all


class Bounds(NamedTuple):
    """Bounds of the variables, infinite where there is none."""

    least: Vector
    greatest: Vector


Look = Callable[[Vector], LocalSlopes]
Curvature = Callable[[Vector, Rows], Square]  # of the Lagrangian at a point, with multipliers


class Method(NamedTuple):
    """What a search is given beside its iterate."""

    look: Look
    bounds: Bounds
    radius: float  # of the first step, in the sizes of the variables
    tol: float
    curvature: Curvature | None = None  # updates stand for it where it is None
    sizes: Vector | float = 1.0
    equal: int = 0  # of the last rows, so many are those before them, negated: equalities


class SequentialIterate(NamedTuple):
    """One search, after some iterations."""

    x: Vector
    at: LocalSlopes
    B: Square
    shift: Rows  # of the constraints, by a correction
    gain: Scalar  # that the step before the correction predicted; 0 where none is under way
    radius: Scalar
    price: Scalar
    multipliers: Rows
    stationarity: Scalar
    violation: Scalar
    complementarity: Scalar
    steps: Int[Array, ""]
    anew: Int[Array, ""]
    done: Flag
    stopped: Flag  # done, or it gets on no more


class _Step(NamedTuple):
    """A step that the program proposes, and what it promises."""

    d: Vector
    x: Vector
    multipliers: Rows
    gain: Scalar
    left: Scalar  # sum of the violations that the program leaves
    correcting: Flag


class _Verdict(NamedTuple):
    """What the evaluation after a step says of it."""

    taken: Flag
    correct: Flag  # whether to try a correction
    ratio: Scalar  # of the gain to that promised
    valid: Flag


def first_iterate(x: Vector, rows: int, radius: float) -> SequentialIterate:
    """The state before the first iteration from `x`, for a problem with so many constraints.

    That iteration evaluates at `x` and goes nowhere: evaluating here would compile it twice.
    """
    unknown, none, no_rows = jnp.array(jnp.inf), jnp.zeros(()), jnp.zeros(rows)
    J = jnp.zeros((rows, len(x)))
    return SequentialIterate(
        x=x,
        at=LocalSlopes(none, no_rows, jnp.zeros_like(x), J, jnp.array(True)),
        B=jnp.eye(len(x)),
        shift=no_rows,
        gain=none,
        radius=jnp.array(radius, float),
        price=jnp.array(1.0),
        multipliers=no_rows,
        stationarity=unknown,
        violation=unknown,
        complementarity=unknown,
        steps=jnp.array(0),
        anew=jnp.array(0),
        done=jnp.array(False),
        stopped=jnp.array(False),
    )


def next_iterate(by: Method, s: SequentialIterate) -> SequentialIterate:
    """The state after one more iteration; one that has stopped does not change."""
    at, first = s.at, s.steps == 0
    step = _proposed(by, s)
    step = step._replace(
        d=jnp.where(first, 0.0, step.d),
        x=jnp.where(first, s.x, step.x),
        multipliers=jnp.where(first, 0.0, step.multipliers),
    )
    stationarity, complementarity, met = _conditions(by, s, step.multipliers)
    done = met & ~step.correcting & ~first
    new = by.look(step.x)
    is_ = _verdict(s, step, new)
    is_ = is_._replace(taken=is_.taken | first, correct=is_.correct & ~first)
    moves = is_.taken & ~done
    x = jnp.where(moves, step.x, s.x)
    there = jax.tree.map(lambda a, b: jnp.where(moves, a, b), new, at)
    length = jnp.max(jnp.abs(step.d) / by.sizes, initial=0.0)
    radius = jnp.where(first, by.radius, _next_radius(by, s, is_, length))

    price, short = _next_price(by, s, step, is_, length)
    price = jnp.where(first, 10.0 * jnp.maximum(_size(new.g), 1.0), price)
    lost = ~done & ~is_.correct & ((radius < 1e-11) | ((length < 1e-13) & ~short)) & ~first
    begun = lost & (s.anew < RESTARTS)
    moved = SequentialIterate(
        x=x,
        at=there,
        B=_next_model(by, s, step, new, is_, x, there, begun | first),
        shift=jnp.where(is_.correct, new.c - at.c - at.J @ step.d, 0.0),
        gain=jnp.where(is_.correct, step.gain, 0.0),
        radius=jnp.where(begun, by.radius, radius),
        price=jnp.where(begun, jnp.minimum(10.0 * price, LARGEST_PRICE), price),
        multipliers=step.multipliers,
        stationarity=jnp.where(first, jnp.inf, stationarity),
        violation=_violation(there.c),
        complementarity=jnp.where(first, jnp.inf, complementarity),
        steps=s.steps + 1,
        anew=s.anew + begun,
        done=done,
        stopped=done | (lost & ~begun) | (first & ~new.valid),
    )
    return jax.tree.map(lambda old, fresh: jnp.where(s.stopped, old, fresh), s, moved)


def _size(slope: Vector) -> Scalar:
    """The largest component, from below which nothing is told."""
    return jnp.maximum(jnp.max(jnp.abs(slope), initial=0.0), 1e-3)


def _proposed(by: Method, s: SequentialIterate) -> _Step:
    """The step of the quadratic program within the trust region."""
    at, bounds = s.at, by.bounds
    reach = s.radius * by.sizes
    least = jnp.maximum(-reach, bounds.least - s.x) - _ROOM
    greatest = jnp.minimum(reach, bounds.greatest - s.x) + _ROOM
    program = QuadraticProgram(s.B, at.g, at.J, at.c + s.shift, least, greatest, s.price)
    d, multipliers = solve_quadratic_program(program)
    multipliers = _netted(multipliers, by.equal)
    x = jnp.clip(s.x + d, *bounds)
    d = x - s.x
    left = jnp.sum(jnp.maximum(program.c + at.J @ d, 0.0))
    promised = at.f + at.g @ d + 0.5 * d @ (s.B @ d) + s.price * left
    correcting = s.gain > 0
    gain = jnp.where(correcting, s.gain, _merit(at, s.price) - promised)
    return _Step(d, x, multipliers, gain, left, correcting)


def _netted(multipliers: Rows, equal: int) -> Rows:
    """Multipliers whose pairs of an equality have no common part, which would cancel."""
    inside = len(multipliers) - 2 * equal
    up, down = multipliers[inside : inside + equal], multipliers[inside + equal :]
    net = jnp.append(jnp.maximum(up - down, 0.0), jnp.maximum(down - up, 0.0))
    return jnp.append(multipliers[:inside], net)


def _conditions(by: Method, s: SequentialIterate, multipliers: Rows) -> tuple[Scalar, Scalar, Flag]:
    """Residuals of stationarity and complementarity, and whether all conditions are met."""
    slope = s.at.g + s.at.J.T @ multipliers
    stationarity = jnp.max(jnp.abs(s.x - jnp.clip(s.x - slope, *by.bounds)), initial=0.0)
    complementarity = jnp.max(jnp.abs(multipliers * s.at.c), initial=0.0)
    allowed = by.tol * (1.0 + jnp.max(jnp.abs(s.at.g), initial=0.0))
    met = (stationarity <= allowed) & (complementarity <= allowed)
    return stationarity, complementarity, met & (_violation(s.at.c) <= by.tol)


def _verdict(s: SequentialIterate, step: _Step, new: LocalSlopes) -> _Verdict:
    before = _merit(s.at, s.price)
    won = before - _merit(new, s.price)
    valid = new.valid & jnp.isfinite(won)
    rounding = 1e-14 * (1.0 + jnp.abs(s.at.f) + jnp.abs(before))
    ratio = jnp.where(valid, won, -1.0) / jnp.maximum(step.gain, 1e-300)
    # A gain that rounding hides is believed.
    unseen = (step.gain < 100 * rounding) & (won > -100 * rounding)
    ratio = jnp.where(unseen, 0.5, ratio)
    # The new evaluation says how much the constraints bend along the step.
    bent = jnp.sum(jnp.maximum(new.c, 0.0)) > jnp.sum(jnp.maximum(s.at.c, 0.0))
    correct = (ratio < _POOR) & valid & bent & ~step.correcting
    return _Verdict(valid & (ratio > _LEAST_GAIN) & ~correct, correct, ratio, valid)


def _next_radius(by: Method, s: SequentialIterate, is_: _Verdict, length: Scalar) -> Scalar:
    widened = (is_.ratio > _GOOD) & (length > 0.9 * s.radius)
    wide = jnp.where(widened, jnp.minimum(2.0 * s.radius, _WIDEST * by.radius), s.radius)
    narrow = 0.3 * jnp.minimum(length, s.radius)
    within = jnp.where(is_.ratio < _POOR, jnp.maximum(0.5 * length, narrow), wide)
    return jnp.where(is_.taken, within, jnp.where(is_.correct, s.radius, narrow))


def _next_price(
    by: Method, s: SequentialIterate, step: _Step, is_: _Verdict, length: Scalar
) -> tuple[Scalar, Flag]:
    """The price of violation, and whether it is higher."""
    largest = jnp.max(step.multipliers, initial=0.0)
    # What a program leaves unmet at this price costs more from now on, unless the radius held it.
    held = (length > 0.9 * s.radius) & (step.left < jnp.sum(jnp.maximum(s.at.c, 0.0)))
    missed = (step.left > by.tol) & (s.violation > by.tol) & (s.price < LARGEST_PRICE)
    short = missed & (largest > 0.9 * s.price) & ~held
    higher = jnp.minimum(_GROWTH * s.price, LARGEST_PRICE)
    # A price far above the multipliers makes a search creep along curved constraints.
    enough = jnp.maximum(jnp.maximum(2.0 * largest, _LEAST_PRICE), s.price / _GROWTH)
    easy = is_.taken & (step.left <= by.tol) & (s.anew == 0)
    lower = jnp.where(easy, jnp.minimum(enough, s.price), s.price)
    return jnp.where(short, higher, lower), short


def _violation(c: Rows) -> Scalar:
    return jnp.max(jnp.maximum(c, 0.0), initial=0.0)


def _merit(at: LocalSlopes, price: Scalar) -> Scalar:
    return at.f + price * jnp.sum(jnp.maximum(at.c, 0.0))


def _next_model(
    by: Method,
    s: SequentialIterate,
    step: _Step,
    new: LocalSlopes,
    is_: _Verdict,
    x: Vector,
    there: LocalSlopes,
    begun: Flag,
) -> Square:
    """The Lagrangian's second derivatives for the next program."""
    if by.curvature is None:
        plain = _size(there.g + there.J.T @ step.multipliers) * jnp.eye(len(x))
        B = jnp.where(is_.valid, _updated(s.B, step.d, s.at, new, step.multipliers), s.B)
        return jnp.where(begun, plain, B)
    y = step.multipliers
    met = jnp.abs(s.at.c + s.shift + s.at.J @ step.d) <= 1e-6 * (1.0 + jnp.abs(s.at.c))
    holds = (y > 1e-9 * s.price) & met
    slope = there.g + there.J.T @ y
    low, high = (x <= by.bounds.least) & (slope > 0), (x >= by.bounds.greatest) & (slope < 0)
    return _convexified(by.curvature(x, y), there, holds, low | high, s.B)


def _convexified(
    hessian: Square,
    at: LocalSlopes,
    holds: Bool[Array, " constraints"],
    bound: Bool[Array, " variables"],
    otherwise: Square,
) -> Square:
    """A positive definite matrix that bends along what holds as the Lagrangian does.

    Curvature across these rows and bounds does not move the program's solution on them. So it is
    added first, and then nothing is left to turn where the reduced Hessian is positive definite.
    """
    sizes = jnp.sum(at.J**2, axis=1)
    weight = jnp.where(holds & (sizes > 0), 1.0 / jnp.where(sizes > 0, sizes, 1.0), 0.0)
    across = _ACROSS * jnp.sqrt(jnp.sum(hessian**2))
    whole = hessian + across * ((at.J.T * weight) @ at.J + jnp.diag(1.0 * bound))
    usable = jnp.all(jnp.isfinite(whole))
    values, vectors = jnp.linalg.eigh(jnp.where(usable, whole, jnp.eye(len(whole))))
    sized = jnp.abs(values)
    least = 1.0 + jnp.max(sized, initial=0.0) + jnp.max(jnp.abs(at.g), initial=0.0)
    convex = (vectors * jnp.maximum(sized, _LEAST_CURVATURE * least)) @ vectors.T
    return jnp.where(usable, convex, otherwise)


def _updated(B: Square, d: Vector, at: LocalSlopes, new: LocalSlopes, multipliers: Rows) -> Square:
    """BFGS with M. Powell's damping, which keeps B positive definite."""
    y = (new.g + new.J.T @ multipliers) - (at.g + at.J.T @ multipliers)
    Bd = B @ d
    curved, seen = d @ Bd, d @ y
    far = seen < 0.2 * curved
    share = jnp.where(far, 0.8 * curved / jnp.where(far, curved - seen, 1.0), 1.0)
    r = share * y + (1 - share) * Bd
    along = d @ r
    good = (curved > 0) & (along > 0) & jnp.all(jnp.isfinite(r))
    safe = jnp.where(good, curved, 1.0), jnp.where(good, along, 1.0)
    fresh = B - jnp.outer(Bd, Bd) / safe[0] + jnp.outer(r, r) / safe[1]
    return jnp.where(good, fresh, B)


def slopes_of(evaluate: Callable[[Vector], tuple[Scalar, Rows, Flag]]) -> Look:
    """The look at a point, from a function that gives objective, constraints and validity."""

    def packed(x: Vector) -> tuple[Array, Flag]:
        f, c, valid = evaluate(x)
        return jnp.append(c, f), valid

    def look(x: Vector) -> LocalSlopes:
        # Forward: there are fewer variables than constraints.
        def push(direction: Vector) -> tuple[Array, Array, Array]:
            return jax.jvp(packed, (x,), (direction,), has_aux=True)

        value, slope, valid = jax.vmap(push, out_axes=(None, -1, None))(jnp.eye(len(x)))
        finite = jnp.all(jnp.isfinite(value)) & jnp.all(jnp.isfinite(slope))
        return LocalSlopes(value[-1], value[:-1], slope[-1], slope[:-1], valid & finite)

    return look


def curvature_of(evaluate: Callable[[Vector], tuple[Scalar, Rows, Flag]]) -> Curvature:
    """The Lagrangian's exact second derivatives, from that function."""

    def curvature(x: Vector, multipliers: Rows) -> Square:
        def lagrangian(x: Vector) -> Scalar:
            f, c, _ = evaluate(x)
            return f + multipliers @ c

        return jax.hessian(lagrangian)(x)

    return curvature
