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

from beltjax.numerics.bvp_collocation import (
    Factor,
    Mesh,
    Problem,
    Unknowns,
    factored,
    solve_factored,
    stage_values,
)
from beltjax.numerics.bvp_gauss import Gauss
from beltjax.numerics.bvp_mesh import scale_of

SMALLEST_DAMPING = 1e-6


class NewtonResult(NamedTuple):
    """Where the iteration ended. `factor` is of the last linearization, `step` its last step."""

    z: Unknowns
    factor: Factor
    converged: Bool[Array, ""]
    finite: Bool[Array, ""]  # the equations, where the iteration began
    regular: Bool[Array, ""]  # their linearization there
    passes: Int[Array, ""]
    step: Float[Array, ""]


class _State(NamedTuple):
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


def _plus(z: Unknowns, t, d: Unknowns) -> Unknowns:
    return jax.tree.map(lambda a, b: a + t * b, z, d)


def newton(
    problem: Problem,
    scheme: Gauss,
    mesh: Mesh,
    start: Unknowns,
    *,
    tol: float | Float[Array, ""],
    max_passes: int = 40,
    skip: Bool[Array, ""] | bool = False,
) -> NewtonResult:
    """Zero of the collocation equations near `start`; steps are below `tol` at the end."""

    def sizes(d: Unknowns, z: Unknowns):
        scale = scale_of(z.y)
        parts = [d.y / scale, stage_values(problem, scheme, mesh, d) / scale]
        parts.append(d.p / (1.0 + jnp.abs(z.p)))
        squares = sum(jnp.sum(part**2) for part in parts)
        count = sum(part.size for part in parts)
        largest = jnp.max(jnp.stack([jnp.max(jnp.abs(part), initial=0.0) for part in parts]))
        return jnp.sqrt(squares / count), largest

    def body(state: _State) -> _State:
        first = state.passes == 0
        trial = _plus(state.z, state.damping, state.direction)
        left, factor = factored(problem, scheme, mesh, trial)
        minus = jax.tree.map(jnp.negative, left)
        simplified = solve_factored(state.factor, scheme, minus)
        direction = solve_factored(factor, scheme, minus)

        t = state.damping
        old, _ = sizes(state.direction, trial)
        new, _ = sizes(simplified, trial)
        bent, _ = sizes(_plus(simplified, t - 1.0, state.direction), trial)
        after, largest = sizes(direction, trial)
        good = (new <= (1.0 - 0.25 * t) * old) | first
        accept = good & jnp.isfinite(largest)
        # Deuflhard's prediction for the next step, and correction of a rejected one.
        changed, _ = sizes(_plus(simplified, -1.0, direction), trial)
        predicted = t * (old / _positive(changed)) * (new / _positive(after))
        predicted = jnp.where(first, 1.0, jnp.minimum(1.0, predicted))
        corrected = 0.5 * old * t**2 / _positive(bent)
        corrected = jnp.where(jnp.isfinite(corrected), corrected, 0.5 * t)
        corrected = jnp.minimum(jnp.maximum(corrected, 0.1 * t), 0.5 * t)

        def taken(yes, no):
            return jax.tree.map(lambda a, b: jnp.where(accept, a, b), yes, no)

        finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(x)) for x in left]))
        damping = jnp.where(accept, jnp.maximum(predicted, 0.01), corrected)
        size = jnp.where(accept, largest, state.size)
        # At rounding the test is a toss-up: a rejected step this small ends the iteration.
        stalled = ~accept & (state.size <= 100.0 * tol)
        return _State(
            z=taken(trial, state.z),
            direction=taken(direction, state.direction),
            factor=taken(factor, state.factor),
            damping=damping,
            size=size,
            passes=state.passes + 1,
            done=(accept & (largest <= tol)) | stalled,
            failed=~accept & (first | (damping < SMALLEST_DAMPING)),
            finite=state.finite & (finite | ~first),
            regular=state.regular & (jnp.isfinite(largest) | ~finite | ~first),
        )

    def unfinished(state: _State):
        return ~state.done & ~state.failed & (state.passes < max_passes)

    shapes = jax.eval_shape(lambda z: factored(problem, scheme, mesh, z)[1], start)
    nothing = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)
    state = _State(
        z=start,
        direction=jax.tree.map(jnp.zeros_like, start),
        factor=nothing,
        damping=jnp.ones(()),
        size=jnp.array(jnp.inf),
        passes=jnp.zeros((), int),
        done=jnp.asarray(skip),
        failed=jnp.array(False),
        finite=jnp.array(True),
        regular=jnp.array(True),
    )
    state = jax.lax.while_loop(unfinished, body, state)
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


def _positive(x):
    return jnp.maximum(x, 1e-300)
