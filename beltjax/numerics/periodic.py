"""Periodic orbits of M z'' + C z' + K z + f(z, z', tau) = 0 with tau = w t, and their stability.

By harmonic balance, from rest at load 0; past folds of the load by arc length where that is asked.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_batching import sequential_vmap
from jaxtyping import Array, Bool, Complex, Float, Int

from beltjax.compiling.batched_loops import in_lanes_of
from beltjax.numerics.derivative_rules import without_derivative, without_slopes
from beltjax.numerics.elimination import eliminated
from beltjax.numerics.harmonic_balance import (
    Coefficients,
    Matrix,
    Oscillator,
    Scalar,
    derived,
    jacobian,
    preconditioner,
    residual,
    series,
)
from beltjax.numerics.krylov import gmres
from beltjax.numerics.periodic_branch import Point, Units, corrected, start_of


class Orbit(NamedTuple):
    """Where the search for an orbit ended, and the evidence."""

    coefficients: Coefficients
    step: Scalar  # last correction over the size of the coefficients
    converged: Bool[Array, ""]
    steps: Int[Array, ""]  # of Newton's method


Solver = Callable[[Array], Array]


class _Newton(NamedTuple):
    """Where Newton's method ended."""

    root: Float[Array, " n"]
    first: Float[Array, " n"]  # after the first step
    step: Scalar  # length of the last correction over that of the root
    converged: Bool[Array, ""]
    steps: Int[Array, ""]  # solvers made


_LEAST_PART = 1 / 8  # of a step
_QUICK = 0.3  # what a correction with old factors leaves of the one before
_SMALLEST_LOAD = 1 / 64
_FARTHEST = 0.5
_TINY = 1e-300


def _newton(
    equations: Callable[[Array], Array],
    solver: Callable[[Array], Solver],
    guess: Float[Array, " n"],
    tol: float,
    max_steps: int | Int[Array, ""],
) -> _Newton:
    """A root near `guess`, by steps that the test of `roots.system_root` damps.

    `solver` makes at a point what solves with the Jacobian there. After a full step it serves for
    further ones as long as they shorten quickly, since to make it costs more than a correction.
    """

    def small(correction: Array, x: Array) -> Bool[Array, ""]:
        return jnp.linalg.norm(correction) <= tol * jnp.linalg.norm(x + correction)

    def body(state: tuple[Any, ...]) -> tuple[Any, ...]:
        x, first, _, _, _, steps = state
        solve = solver(x)

        def correction(x: Array) -> Array:
            return -solve(equations(x))

        def useless(trial: tuple[Array, Array]) -> Bool[Array, ""]:
            part, left = trial
            allowed = (1 - part / 4) * jnp.linalg.norm(step)
            shorter = (jnp.linalg.norm(left) <= allowed) | small(step, x)
            return (part >= _LEAST_PART) & ~shorter

        def damped(trial: tuple[Array, Array]) -> tuple[Array, Array]:
            part = trial[0] / 2
            return part, correction(x + part * step)

        def quick(trial: tuple[Array, Array, Array]) -> Bool[Array, ""]:
            x, left, before = trial
            return ~small(left, x) & (jnp.linalg.norm(left) <= _QUICK * before)

        def again(trial: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            x, left, _ = trial
            return x + left, correction(x + left), jnp.linalg.norm(left)

        step = correction(x)
        first = jnp.where(steps == 0, x + step, first)
        part, left = jax.lax.while_loop(useless, damped, (jnp.ones(()), correction(x + step)))
        good = part >= _LEAST_PART
        before = jnp.where(part == 1, jnp.linalg.norm(step), 0.0)
        x, left, _ = jax.lax.while_loop(quick, again, (x + part * step, left, before))
        done = good & small(left, x)
        relative = jnp.linalg.norm(left) / (jnp.linalg.norm(x) + _TINY)
        return jnp.where(done, x + left, x), first, relative, done, good, steps + 1

    def unfinished(state: tuple[Any, ...]) -> Bool[Array, ""]:
        _, _, _, done, good, steps = state
        return ~done & good & (steps < max_steps)

    yes, no = jnp.array(True), jnp.array(False)
    start = (guess, guess, jnp.array(jnp.inf), no, yes, jnp.array(0))
    x, first, step, done, _, steps = jax.lax.while_loop(unfinished, body, in_lanes_of(guess, start))
    return _Newton(x, first, step, done & jnp.all(jnp.isfinite(x)), steps)


def _by_elimination(system: Oscillator, X: Coefficients, samples: int) -> Solver:
    """What solves with the Jacobian at X, flat: by its matrix."""
    return eliminated(jacobian(system, X, samples)).solve


_KRYLOV, _CYCLES = 60, 2  # directions of GMRES, and how often it begins anew


def _by_krylov(system: Oscillator, X: Coefficients, samples: int) -> Solver:
    """What solves with the Jacobian at X, flat: by GMRES, without its matrix.

    Preconditioned by the mean of the tangents the Jacobian is 1 but for what the tension's
    fluctuation adds. Where the directions do not suffice the step of Newton's method is not quite
    its own, and there are more of them.
    """
    inverse, shape = preconditioner(system, X, samples), X.shape

    def near_one(X: Coefficients) -> Coefficients:
        return inverse(residual(system, X, samples))

    _, moved = jax.linearize(near_one, X)

    def solve(right: Array) -> Array:
        start = inverse(right.reshape(shape)).ravel()
        return gmres(lambda v: moved(v.reshape(shape)).ravel(), start, _KRYLOV, cycles=_CYCLES)

    return solve


MakeSolver = Callable[[Oscillator, Coefficients, int], Solver]


def _orbit_near(
    system: Oscillator,
    guess: Coefficients,
    samples: int,
    tol: float,
    max_steps: int | Int[Array, ""],
    make: MakeSolver = _by_elimination,
) -> _Newton:
    """An orbit of `system` near `guess`, its coefficients flat."""
    shape = guess.shape
    return _newton(
        lambda x: residual(system, x.reshape(shape), samples).ravel(),
        lambda x: make(system, x.reshape(shape), samples),
        guess.ravel(),
        tol,
        max_steps,
    )


def _is_close(found: _Newton) -> Bool[Array, ""]:
    """Whether a root was found, no farther from the first correction than half its size."""
    reach = _FARTHEST * jnp.linalg.norm(found.root)
    return found.converged & (jnp.linalg.norm(found.root - found.first) <= reach)


def _followed(
    at_load: Callable[[Scalar], Oscillator],
    guess: Coefficients,
    begin: Scalar,
    samples: int,
    tol: float,
    max_steps: int,
) -> tuple[Coefficients, _Newton, Scalar]:
    """The orbit at load 1 from that at load `begin`: at once if it is close, else by loads between.

    Newton's method from afar may end at another orbit than the one that grows from rest. A root
    farther from the first correction than half its size is therefore not taken, and the load
    is halved.
    """
    shape = guess.shape

    def body(state: tuple[Any, ...]) -> tuple[Any, ...]:
        x, load, step, _, steps = state
        stretch = jnp.where(load > 0, (load + step) / jnp.where(load > 0, load, 1.0), 1.0)
        near = (stretch * x).reshape(shape)
        found = _orbit_near(at_load(load + step), near, samples, tol, max_steps)
        good = _is_close(found)
        x, load = jnp.where(good, found.root, x), jnp.where(good, load + step, load)
        step = jnp.minimum(jnp.where(good, 2 * step, step / 2), 1 - load)
        return x, load, step, found, steps + found.steps

    def unfinished(state: tuple[Any, ...]) -> Bool[Array, ""]:
        _, load, step, *_ = state
        return (load < 1) & (step >= _SMALLEST_LOAD)

    flat = guess.ravel()
    nothing = _Newton(flat, flat, jnp.array(jnp.inf), jnp.array(False), jnp.array(0))
    start = (flat, begin, 1 - begin, nothing, jnp.array(0))
    x, load, _, last, steps = jax.lax.while_loop(unfinished, body, in_lanes_of(flat, start))
    return x.reshape(shape), last._replace(converged=load >= 1, steps=steps), load


def _found_past_folds(
    at_load: Callable[[Scalar], Oscillator],
    found: Coefficients,
    end: _Newton,
    load: Scalar,
    samples: int,
    tol: float,
    max_steps: int,
) -> tuple[Coefficients, _Newton]:
    """The orbit and the evidence, by arc length where the search did not come to load 1."""
    walked, steps = _past_folds(at_load, found, load, samples, ~end.converged)
    left = jnp.where(end.converged, 0, max_steps)  # an orbit that is found takes no more steps
    last = _orbit_near(at_load(jnp.ones(())), walked, samples, tol, left)
    last = last._replace(steps=end.steps + steps + last.steps)
    end = jax.tree.map(lambda a, b: jnp.where(end.converged, a, b), end, last)
    return end.root.reshape(found.shape), end


class _Path(NamedTuple):
    """A walk by arc length, over the load."""

    point: Point
    step: Scalar
    steps: Int[Array, ""]  # matrices factored
    points: Int[Array, ""]


def _past_folds(
    at_load: Callable[[Scalar], Oscillator],
    begin: Coefficients,
    load: Scalar,
    samples: int,
    wanted: Bool[Array, ""],
) -> tuple[Coefficients, Int[Array, ""]]:
    """The first motion at load 1 on the branch on which `begin` lies at a smaller load.

    Where the load turns back on the way from rest, no motion of load 1 is close to those before.
    """
    count, shape = begin.size, begin.shape
    size = jnp.linalg.norm(begin)
    units = Units(jnp.where(size > 0, size, 1.0), jnp.asarray(_LOAD_UNIT))

    def correct(guess: Array, along: Array) -> Any:
        return corrected(lambda _, load: at_load(load), None, units, samples, shape, guess, along)

    def unfinished(path: _Path) -> Bool[Array, ""]:
        short = path.point.place[count] * _LOAD_UNIT < 1 - _ROUNDING
        return wanted & short & (path.step >= _LEAST_WALK) & (path.points < _MOST_POINTS)

    def walk(path: _Path) -> _Path:
        here = path.point
        # Onto load 1 exactly, where the next step would pass it.
        rate = here.direction[count] * _LOAD_UNIT
        left = 1 - here.place[count] * _LOAD_UNIT
        near = (rate > 0) & (rate * path.step >= left)
        onto = jnp.where(near, left / jnp.where(near, rate, 1.0), path.step)
        across = jnp.where(near, jnp.zeros(count + 1).at[count].set(1.0), here.direction)
        found = correct(here.place + onto * here.direction, across)
        straight = found.point.direction @ here.direction > _STRAIGHT
        good = found.converged & (straight | near)
        point = jax.tree.map(lambda a, b: jnp.where(good, a, b), found.point, here)
        easy = jnp.where(found.steps <= 4, jnp.minimum(1.4 * path.step, 1.0), path.step)
        step = jnp.where(good, easy, path.step / 2)
        return _Path(point, step, path.steps + found.steps, path.points + 1)

    place = start_of(begin, load, units)
    up = jnp.zeros_like(place).at[count].set(1.0)
    start = _Path(Point(place, up), jnp.array(_FIRST_WALK), jnp.array(0), jnp.array(0))
    end = jax.lax.while_loop(unfinished, walk, in_lanes_of(place, start))
    return units.coefficients * end.point.place[:count].reshape(shape), end.steps


_LOAD_UNIT = 0.1  # of the load, in arc length
_FIRST_WALK, _LEAST_WALK, _MOST_POINTS = 0.05, 1e-4, 200
_ROUNDING = 1e-12  # of the load on which a walk ends
_STRAIGHT = 0.85  # least cosine between directions that follow each other


def _searched(
    system: Callable[[Any, Scalar], Oscillator],
    args: Any,
    harmonics: int,
    samples: int,
    past_folds: bool,
    tol: float,
    max_steps: int,
) -> tuple[Coefficients, _Newton]:
    """The orbit of `periodic_orbit` without derivatives, 0 where the search failed."""
    still = jnp.zeros((2 * harmonics + 1, len(system(args, jnp.ones(())).mass)))

    def at_load(load: Scalar) -> Oscillator:
        return system(args, load)

    none = jnp.zeros(())
    if past_folds:
        found, end, load = _followed(at_load, still, none, samples, tol, max_steps)
        found, end = _found_past_folds(at_load, found, end, load, samples, tol, max_steps)
    else:
        # Far from resonances and folds Newton's method with GMRES is there at once.
        quick = _orbit_near(at_load(none + 1), still, samples, tol, max_steps, _by_krylov)
        there = _is_close(quick)
        begin, found = jnp.where(there, 1.0, 0.0), jnp.where(there, quick.root, 0.0)
        found, end, _ = _followed(
            at_load, found.reshape(still.shape), begin, samples, tol, max_steps
        )
        end = end._replace(steps=quick.steps + end.steps)
        end = jax.tree.map(lambda a, b: jnp.where(there, a, b), quick, end)
    # One more correction, so that differences of orbits are not those of the tolerance.
    make = _by_elimination if past_folds else _by_krylov
    last = system(args, jnp.ones(()))
    left = make(last, found, samples)(residual(last, found, samples).ravel())
    better = end.converged & (jnp.linalg.norm(left) <= tol * jnp.linalg.norm(found))
    found = jnp.where(better, found - left.reshape(found.shape), found)
    return jnp.where(end.converged, found, 0.0), end


def periodic_orbit(
    system: Callable[[Any, Scalar], Oscillator],
    args: Any,
    harmonics: int,
    samples: int,
    *,
    past_folds: bool = False,
    tol: float = 1e-9,
    max_steps: int = 12,
) -> Orbit:
    """The periodic orbit of `system(args, load)` at load 1 that grows from rest at load 0.

    Its derivatives are those of the converged equations by `args`. A failed search gives zeros.
    With `past_folds` the branch from rest is followed also where the load turns back on it, at the
    cost of more to compile.
    """
    fixed = jax.lax.stop_gradient(args)
    # A batch goes one after the other: some searches take ten times as long as others, and together
    # all would take as long as the longest.
    search = without_slopes(
        sequential_vmap(
            lambda given: _searched(system, given, harmonics, samples, past_folds, tol, max_steps)
        )
    )
    found, end = search(fixed)

    def keep(_: Any, start: Coefficients) -> Coefficients:
        return start

    def solve(_: Any, right: Coefficients) -> Coefficients:
        factors = eliminated(jacobian(system(fixed, jnp.ones(())), found, samples))
        return factors.solve(right.ravel()).reshape(right.shape)

    coefficients = jax.lax.custom_root(
        lambda X: residual(system(args, jnp.ones(())), X, samples), found, keep, solve
    )
    return Orbit(coefficients, end.step, end.converged, end.steps)


def known_orbit(system: Oscillator, X: Coefficients, samples: int) -> Orbit:
    """The evidence of an orbit that is found already; it has no derivatives."""
    factors = eliminated(jacobian(system, X, samples))
    left = factors.solve(residual(system, X, samples).ravel())
    step = jnp.linalg.norm(left) / (jnp.linalg.norm(X) + _TINY)
    return Orbit(X, step, jnp.array(True), jnp.array(0))


def conditioning(
    system: Callable[[Any, Scalar], Oscillator], args: Any, X: Coefficients, samples: int
) -> Scalar:
    """Least singular value of an orbit's Jacobian over the stiffness and inertia of coordinates.

    By inverse iteration, without derivatives. It vanishes at a fold.
    """
    fixed, orbit = jax.lax.stop_gradient((args, X))
    at = system(fixed, jnp.ones(()))
    factors = eliminated(jacobian(at, orbit, samples))
    squares = (np.arange(1, len(X) + 1) // 2)[:, None] ** 2 * at.frequency**2
    unit = jnp.sqrt(jnp.diag(at.stiffness) + squares * jnp.diag(at.mass)).ravel()

    def improve(_: Array, state: tuple[Array, Array]) -> tuple[Array, Array]:
        x, _ = state
        y = unit * factors.solve(unit * x)
        z = unit * factors.solve(unit * y, transposed=True)
        size = jnp.linalg.norm(z)
        return z / size, size

    start = jnp.cos(jnp.arange(unit.size) * 1.0), jnp.ones(())
    _, size = jax.lax.fori_loop(0, 6, improve, in_lanes_of(unit, start))
    return 1 / jnp.sqrt(size)


_UNDAMPED = 1e-10
_A = np.array([[1 / 4, 1 / 4 - np.sqrt(3) / 6], [1 / 4 + np.sqrt(3) / 6, 1 / 4]])  # Gauss, 2 stages


def after_period(
    system: Oscillator, X: Coefficients, disturbed: Float[Array, "states columns"], steps: int
) -> Float[Array, "states columns"]:
    """What a period makes of small disturbances of (z, z') of an orbit, one in each column.

    By Gauss's implicit method of two stages, whose order is 4 and which neither damps nor excites.
    Neutral translations, and their rates where nothing damps them, are taken out.
    """
    size, w = X.shape[1], system.frequency
    h = 2 * np.pi / steps / w
    rate = w * derived(X)
    A, second, nodes = _A, _A @ _A, _A.sum(axis=1)

    def tangents(phase: Scalar) -> tuple[Matrix, Matrix]:
        of = series(phase, len(X) // 2)
        by_z, by_rate = jax.jacfwd(system.force, (0, 1))(of @ X, of @ rate, phase)
        return system.stiffness + by_z, system.damping + by_rate

    def advance(state: tuple[Array, Array], step: Array) -> tuple[tuple[Array, Array], None]:
        # Unknown are the accelerations at both stages.
        position, velocity = state
        left, right = [], []
        for k in range(2):
            K, C = tangents(2 * np.pi / steps * (step + nodes[k]))
            row = [h * A[k, m] * C + h**2 * second[k, m] * K for m in range(2)]
            row[k] = row[k] + system.mass
            left.append(jnp.concatenate(row, axis=1))
            right.append(-(K @ (position + h * nodes[k] * velocity) + C @ velocity))
        solved = jnp.linalg.solve(jnp.concatenate(left), jnp.concatenate(right))
        one, two = solved[:size], solved[size:]
        weights = A.sum(axis=0) / 2
        position = position + h * velocity + h**2 * (weights[0] * one + weights[1] * two)
        return (position, velocity + h / 2 * (one + two)), None

    # In reverse only the states are kept from step to step.
    start = in_lanes_of(X, _without_free_rate(system, disturbed))
    split = start[:size], start[size:]
    (position, velocity), _ = jax.lax.scan(jax.checkpoint(advance), split, jnp.arange(steps))
    return _without_translation(system, jnp.concatenate([position, velocity]))


def _without_translation(
    system: Oscillator, states: Float[Array, "states columns"]
) -> Float[Array, "states columns"]:
    """States less what they have of the neutral translation, by its own coordinate."""
    if system.neutral is None:
        return states
    u, row = system.neutral
    return states.at[: len(u)].add(-jnp.outer(u / u[row], states[row]))


def _without_free_rate(
    system: Oscillator, states: Float[Array, "states columns"]
) -> Float[Array, "states columns"]:
    """States less what they have of the translation's rate, which stays where nothing damps it.

    The momentum u M z' is then what it was, so that it measures that part.
    """
    if system.neutral is None:
        return states
    u, size = system.neutral.direction, len(system.mass)
    momentum = u @ system.mass
    free = jnp.abs(u @ system.damping @ u) < _UNDAMPED * (momentum @ u) * system.frequency
    part = jnp.where(free, momentum @ states[size:] / (momentum @ u), 0.0)
    return states.at[size:].add(-jnp.outer(u, part))


def monodromy(system: Oscillator, X: Coefficients, steps: int) -> Float[Array, "states states"]:
    """The matrix of `after_period`."""
    return after_period(system, X, jnp.eye(2 * X.shape[1]), steps)


def multipliers(
    system: Callable[[Any, Scalar], Oscillator], args: Any, X: Coefficients, steps: int = 200
) -> Complex[Array, " states"]:
    """Floquet multipliers of an orbit, the largest first; their derivatives are NaN.

    That of a neutral translation is 0 in place of 1; also that of its rate where nothing damps it.
    """
    fixed, orbit = jax.lax.stop_gradient((args, X))
    found = jnp.linalg.eigvals(monodromy(system(fixed, jnp.ones(())), orbit, steps))
    return found[jnp.argsort(-jnp.abs(found))] + without_derivative(0.0 * jnp.sum(X))


def largest_multiplier(
    system: Callable[[Any, Scalar], Oscillator], args: Any, X: Coefficients, steps: int = 200
) -> Scalar:
    """Modulus of the largest Floquet multiplier, with its derivatives by the system and the orbit.

    Those are the products of its left and right eigenvector with the derivative of the monodromy
    matrix; where two of different modulus change places they jump.
    """
    fixed, orbit = jax.lax.stop_gradient((args, X))
    matrix = monodromy(system(fixed, jnp.ones(())), orbit, steps)
    values, vectors = jnp.linalg.eig(matrix)
    place = jnp.argmax(jnp.abs(values))
    value, right = values[place], vectors[:, place]
    unit = jnp.zeros(len(values), complex).at[place].set(1.0)
    left = jnp.linalg.solve(vectors.T, unit)  # a row of the inverse: left.right = 1
    columns = jnp.stack([right.real, right.imag], axis=1)
    moved = after_period(system(args, jnp.ones(())), X, columns, steps)
    mapped = left @ (moved[:, 0] + 1j * moved[:, 1])
    # `mapped` is the multiplier itself; of its modulus the derivative along its own direction.
    along = jnp.conj(value) / jnp.abs(value)
    slope = (along * mapped).real
    return jnp.abs(value) + slope - jax.lax.stop_gradient(slope)
