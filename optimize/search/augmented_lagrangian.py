"""Minimization under inequality constraints from many starts at once.

An augmented Lagrangian over BFGS, for smooth problems in the unit box:

    minimize f(x) subject to g(x) <= 0, 0 <= x <= 1.

Box bounds are met by x = sin^2(z/2), whose minimum over z is regular also on the bound. Each
start is a lane of `vmap`; a lane that hits designs without a value backs away from them.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

Vector = Float[Array, " variables"]

_NO_VALUE = 1e6  # stands for a design that cannot be evaluated; objectives are scaled to order one
_GROWTH = 5.0  # of the penalty, where the violation does not fall to a quarter
_LARGEST_PENALTY = 1e6


class Evaluation(NamedTuple):
    """Scaled objective and constraints at one design; derivatives are zero where not valid."""

    objective: Float[Array, ""]
    constraints: Float[Array, " constraints"]  # feasible where <= 0
    valid: Bool[Array, ""]


Evaluate = Callable[[Vector], Evaluation]


class Iterate(NamedTuple):
    """One start, after some outer iterations."""

    z: Vector
    multipliers: Float[Array, " constraints"]
    penalty: Float[Array, ""]
    objective: Float[Array, ""]
    violation: Float[Array, ""]  # largest g, or 0
    stationarity: Float[Array, ""]  # largest component of the Lagrangian's gradient in z
    complementarity: Float[Array, ""]
    inner_steps: Int[Array, ""]
    valid: Bool[Array, ""]  # whether the design has a value at all
    done: Bool[Array, ""]
    stopped: Bool[Array, ""]  # done, or the constraints cannot be met from here


def to_unit(z: Vector) -> Vector:
    """The point of the unit box that the free variable z stands for."""
    return jnp.sin(z / 2) ** 2


def from_unit(x: Vector) -> Vector:
    """A z for a point strictly inside the box (on a bound dx/dz vanishes and nothing moves)."""
    inside = jnp.clip(x, 1e-3, 1 - 1e-3)
    return 2 * jnp.arcsin(jnp.sqrt(inside))


def first_iterate(x: Vector, constraints: int, penalty: float = 10.0) -> Iterate:
    """The state before the first outer iteration from `x` in the unit box."""
    unknown = jnp.array(jnp.inf, dtype=float)
    return Iterate(
        z=from_unit(x),
        multipliers=jnp.zeros(constraints),
        penalty=jnp.array(penalty, dtype=float),
        objective=unknown,
        violation=unknown,
        stationarity=unknown,
        complementarity=unknown,
        inner_steps=jnp.array(0, dtype=int),
        valid=jnp.array(False),
        done=jnp.array(False),
        stopped=jnp.array(False),
    )


def outer_step(
    evaluate: Evaluate, state: Iterate, *, tol: float = 1e-6, inner_steps: int = 60
) -> Iterate:
    """Minimize the augmented Lagrangian once and update its multipliers and penalty.

    No closer than `tol`, nor in more than `inner_steps`: multipliers that are still wrong reward
    no effort, and optima are polished afterwards.
    `done` when violation and complementarity are below `tol` and the gradient is below its
    tenfold; given up when the largest penalty leaves a violation. A state that has stopped does
    not change.
    """

    def lagrangian(z: Vector, args: tuple[Array, Array]) -> tuple[Array, Evaluation]:
        multipliers, penalty = args
        at = evaluate(to_unit(z))
        shifted = jnp.maximum(0.0, multipliers + penalty * at.constraints)
        value = at.objective + jnp.sum(shifted**2 - multipliers**2) / (2 * penalty)
        return jnp.where(at.valid, value, _NO_VALUE), at

    found = optx.minimise(
        lagrangian,
        optx.BFGS(rtol=0.01 * tol, atol=0.01 * tol),
        state.z,
        args=(state.multipliers, state.penalty),
        has_aux=True,
        max_steps=inner_steps,
        throw=False,
    )
    # Evaluation and gradient of the last accepted point, which the minimizer has at hand:
    # to evaluate once more would compile the whole drive once more.
    z, at, slope = found.value, found.aux, found.state.f_info.grad
    multipliers = jnp.maximum(0.0, state.multipliers + state.penalty * at.constraints)
    violation = _violation(at.constraints)
    slack = jnp.maximum(at.constraints, -state.multipliers / state.penalty)
    complementarity = jnp.max(jnp.abs(slack), initial=0.0)
    stationarity = jnp.max(jnp.abs(slope))
    stalled = complementarity > jnp.maximum(0.25 * state.complementarity, tol)
    grown = jnp.minimum(_GROWTH * state.penalty, _LARGEST_PENALTY)
    done = at.valid & (complementarity <= tol) & (stationarity <= 10 * tol)
    hopeless = stalled & (state.penalty >= _LARGEST_PENALTY)
    new = Iterate(
        z=z,
        multipliers=multipliers,
        penalty=jnp.where(stalled & jnp.isfinite(state.complementarity), grown, state.penalty),
        objective=at.objective,
        violation=violation,
        stationarity=stationarity,
        complementarity=complementarity,
        inner_steps=state.inner_steps + found.stats["num_steps"],
        valid=at.valid,
        done=done,
        stopped=done | hopeless | ~at.valid,
    )
    return jax.tree.map(lambda old, fresh: jnp.where(state.stopped, old, fresh), state, new)


def _violation(constraints: Float[Array, " constraints"]) -> Float[Array, ""]:
    return jnp.max(jnp.maximum(constraints, 0.0), initial=0.0)
