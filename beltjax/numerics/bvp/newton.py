"""Newton's method for the collocation equations, damped so that its steps, not residuals, fall.

The natural monotonicity test compares J(z)^-1 F(z + t d) with d = J(z)^-1 F(z): both are errors
in the unknowns' own units, and no scaling of the equations changes the outcome (Deuflhard,
2004, section 2.1: NLEQ-ERR). Each pass linearizes once and uses that both for the test's
residual and, if the step is taken, for the next direction.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from beltjax.numerics.bvp.chain import ChainEnds
from beltjax.numerics.bvp.collocation import (
    Factor,
    Interval,
    Local,
    Mesh,
    Problem,
    Unknowns,
    factored,
    solve_factored,
    stage_values,
)
from beltjax.numerics.bvp.compiled_parts import evaluated_apart, part, repeat
from beltjax.numerics.bvp.mesh import scale_of

SMALLEST_DAMPING = 1e-6
MOST_PASSES = 40


class NewtonResult(NamedTuple):
    """Where the iteration ended. `factor` is of the last linearization, `step` its last step."""

    z: Unknowns
    factor: Factor
    converged: Bool[Array, ""]
    finite: Bool[Array, ""]  # the equations, where the iteration began
    regular: Bool[Array, ""]  # their linearization there
    passes: Int[Array, ""]
    step: Float[Array, ""]


class _NewtonState(NamedTuple):
    z: Unknowns
    direction: Unknowns
    factor: Factor
    damping: Float[Array, ""]
    size: Float[Array, ""]  # largest component of the direction
    passes: Int[Array, ""]
    done: Bool[Array, ""]
    failed: Bool[Array, ""]
    finite: Bool[Array, ""]
    regular: Bool[Array, ""]
    going: Bool[Array, ""]
    trial: Unknowns  # where the equations are to be evaluated next


class _Trial(NamedTuple):
    """A trial point and both Newton steps from it: with the old linearization, and its own."""

    z: Unknowns
    simplified: Unknowns
    direction: Unknowns
    factor: Factor
    finite: Bool[Array, ""]  # the equations there


class _Outcome(NamedTuple):
    accept: Bool[Array, ""]
    damping: Float[Array, ""]  # for the next direction, or for this one again
    size: Float[Array, ""]  # largest component of the trial's own direction


def newton(
    problem: Problem,
    mesh: Mesh,
    start: Unknowns,
    *,
    tol: Float[Array, ""],
    skip: Bool[Array, ""],
) -> NewtonResult:
    """Zero of the collocation equations near `start`; steps are below `tol` at the end."""

    def body(state: _NewtonState) -> _NewtonState:
        local = evaluated_apart(problem, mesh, state.trial)
        return _advanced(problem.interval, mesh, state, local, tol)

    return _ended(repeat(lambda state: state.going, body, _first_state(start, skip)))


@part
def _first_state(start: Unknowns, skip: Bool[Array, ""]) -> _NewtonState:
    yes = jnp.array(True)
    return _NewtonState(
        z=start,
        direction=jax.tree.map(jnp.zeros_like, start),
        factor=no_factor(start),
        damping=jnp.ones(()),
        size=jnp.array(jnp.inf),
        passes=jnp.zeros((), int),
        done=skip,
        failed=~yes,
        finite=yes,
        regular=yes,
        going=~skip,
        trial=start,
    )


def no_factor(like: Unknowns) -> Factor:
    """Zeros in the shape of a factored linearization at `like`."""
    s, n, N = like.K.shape
    k, zeros = like.p.shape[0], jnp.zeros

    def factor() -> Factor:
        ends = ChainEnds(zeros((n + k, n)), zeros((n + k, n)), zeros((n + k, k)))
        local = Local(zeros((s, n, N)), zeros((s, n, n + k, N)), zeros(n + k), ends)
        return factored(Interval(zeros(()), zeros(())), zeros(N + 1), like, local)[1]

    return jax.tree.map(lambda like: zeros(like.shape, like.dtype), jax.eval_shape(factor))


@part
def _advanced(
    interval: Interval, mesh: Mesh, state: _NewtonState, local: Local, tol: Array
) -> _NewtonState:
    """The state after a trial, at which the equations are `local`."""
    left, factor = factored(interval, mesh, state.trial, local)
    minus = jax.tree.map(jnp.negative, left)
    simplified = solve_factored(state.factor, minus)
    direction = solve_factored(factor, minus)
    finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(x)) for x in left]))
    trial = _Trial(state.trial, simplified, direction, factor, finite)
    return _next(state, trial, _judged(interval, mesh, state, trial), tol)


@part
def _ended(state: _NewtonState) -> NewtonResult:
    # The last direction is far below `tol`: taking it whole squares the error once more.
    polished = _plus(state.z, jnp.where(state.done, 1.0, 0.0), state.direction)
    return NewtonResult(
        polished,
        state.factor,
        state.done,
        state.finite,
        state.regular,
        state.passes,
        state.size,
    )


def _judged(interval: Interval, mesh: Mesh, state: _NewtonState, trial: _Trial) -> _Outcome:
    """The natural monotonicity test, and Deuflhard's damping after it.

    Where the test is passed: his prediction for the next step; else his correction of this one.
    """

    def sizes(d: Unknowns) -> tuple[Array, Array]:
        return _sizes(d, stage_values(interval, mesh, d), trial.z)

    first, t = state.passes == 0, state.damping
    old, _ = sizes(state.direction)
    new, _ = sizes(trial.simplified)
    bent, _ = sizes(_plus(trial.simplified, t - 1.0, state.direction))
    changed, _ = sizes(_plus(trial.simplified, -1.0, trial.direction))
    after, largest = sizes(trial.direction)
    accept = ((new <= (1.0 - 0.25 * t) * old) | first) & jnp.isfinite(largest)
    predicted = t * (old / _positive(changed)) * (new / _positive(after))
    predicted = jnp.where(first, 1.0, jnp.minimum(1.0, predicted))
    corrected = 0.5 * old * t**2 / _positive(bent)
    corrected = jnp.where(jnp.isfinite(corrected), corrected, 0.5 * t)
    corrected = jnp.minimum(jnp.maximum(corrected, 0.1 * t), 0.5 * t)
    damping = jnp.where(accept, jnp.maximum(predicted, 0.01), corrected)
    return _Outcome(accept, damping, largest)


def _next(state: _NewtonState, trial: _Trial, outcome: _Outcome, tol: Array) -> _NewtonState:
    accept, damping, largest = outcome
    first = state.passes == 0
    # At rounding the test is a toss-up: a rejected step this small ends the iteration.
    stalled = ~accept & (state.size <= 100.0 * tol)
    z, direction, factor, size = jax.tree.map(
        lambda yes, no: jnp.where(accept, yes, no),
        (trial.z, trial.direction, trial.factor, largest),
        (state.z, state.direction, state.factor, state.size),
    )
    done = (accept & (largest <= tol)) | stalled
    failed = ~accept & (first | (damping < SMALLEST_DAMPING))
    passes = state.passes + 1
    return _NewtonState(
        z=z,
        direction=direction,
        factor=factor,
        damping=damping,
        size=size,
        passes=passes,
        done=done,
        failed=failed,
        finite=state.finite & (trial.finite | ~first),
        regular=state.regular & (jnp.isfinite(largest) | ~trial.finite | ~first),
        going=~done & ~failed & (passes < MOST_PASSES),
        trial=_plus(z, damping, direction),
    )


def _sizes(d: Unknowns, stages: Float[Array, "s n N"], z: Unknowns) -> tuple[Array, Array]:
    """(root mean square, largest) of a change of the unknowns, in units of their sizes at `z`."""
    scale = scale_of(z.y)
    parts = [d.y / scale, stages / scale, d.p / (1.0 + jnp.abs(z.p))]
    squares = sum(jnp.sum(part**2) for part in parts)
    count = sum(part.size for part in parts)
    largest = jnp.max(jnp.stack([jnp.max(jnp.abs(part), initial=0.0) for part in parts]))
    return jnp.sqrt(squares / count), largest


def _plus(z: Unknowns, t: Array | float, d: Unknowns) -> Unknowns:
    return jax.tree.map(lambda a, b: a + t * b, z, d)


def _positive(x: Array) -> Array:
    return jnp.maximum(x, 1e-300)
