"""Steps of the implicit method of Radau IIA with three stages, for systems of second order.

Order 5, stiffly accurate (E. Hairer and G. Wanner, 1996, IV.5). States are positions, as many rates
of them, and others; unknown are the gains at the stages, the derivatives of all but the positions,
so that a step of n positions solves 3 n equations and not 6 n.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

Scalar = Float[Array, ""]
State = Float[Array, " states"]
Stages = Float[Array, "3 gains"]  # derivatives of rates and other states

_ROOT = np.sqrt(6)
NODES = np.array([(4 - _ROOT) / 10, (4 + _ROOT) / 10, 1.0])
_A = np.array(
    [
        [(88 - 7 * _ROOT) / 360, (296 - 169 * _ROOT) / 1800, (-2 + 3 * _ROOT) / 225],
        [(296 + 169 * _ROOT) / 1800, (88 + 7 * _ROOT) / 360, (-2 - 3 * _ROOT) / 225],
        [(16 - _ROOT) / 36, (16 + _ROOT) / 36, 1 / 9],
    ]
)
_SQUARE = _A @ _A
WEIGHTS = _A[2]  # of the stages in an integral over the step
# Rows: the polynomial of degree 2 that is 1 at one stage and 0 at the others, from degree 0 on.
LAGRANGE = np.linalg.inv(np.vander(NODES, increasing=True)).T
_POWERS = np.arange(3)
_ONCE = LAGRANGE / (_POWERS + 1)
_TWICE = _ONCE / (_POWERS + 2)

_TOL = 1e-12  # of a step's last correction
_QUICK = 0.3
_MOST_FACTORS, _MOST_CORRECTIONS = 5, 60


class Rates(NamedTuple):
    """What a step integrates, in the mode that it has."""

    of: Callable[[State, Scalar], State]
    positions: int

    def gains(self, x: State, t: Scalar) -> Float[Array, " gains"]:
        """Derivatives of all states but the positions."""
        return self.of(x, t)[self.positions :]


def within(positions: int, x: State, h: Scalar, gains: Stages, at: Array) -> State:
    """The state at a part `at` of the step, of the polynomial through the stages."""
    n = positions
    powers = jnp.stack([at, at * at, at * at * at])  # whose derivatives exist at 0, too
    once, twice = gains.T @ (_ONCE @ powers), gains[:, :n].T @ (_TWICE @ (at * powers))
    moved = x[:n] + h * (at * x[n : 2 * n] + h * twice)
    return jnp.concatenate([moved, x[n:] + h * once])


def stage_states(positions: int, x: State, h: Scalar, gains: Stages) -> Float[Array, "3 states"]:
    """States at the stages; the last one is that at the end of the step."""
    n = positions
    moved = x[:n] + h * NODES[:, None] * x[n : 2 * n] + h**2 * (_SQUARE @ gains[:, :n])
    return jnp.concatenate([moved, x[n:] + h * (_A @ gains)], axis=1)


class Factored(NamedTuple):
    """The equations of a step, linearized and factored."""

    by_state: Float[Array, "3 gains states"]
    lu: Float[Array, "n n"]
    pivots: Array

    def solve(self, right: Float[Array, "3 gains *columns"]) -> Float[Array, "3 gains *columns"]:
        """Gains for right sides."""
        flat = right.reshape(len(self.lu), -1)
        return jax.scipy.linalg.lu_solve((self.lu, self.pivots), flat).reshape(right.shape)


def factored(rates: Rates, x: State, t: Scalar, h: Scalar, gains: Stages) -> Factored:
    """The equations linearized at these gains."""
    n, (_, count) = rates.positions, gains.shape
    at = stage_states(n, x, h, gains)
    by_state = jax.vmap(jax.jacfwd(rates.gains))(at, t + h * NODES)
    by_position, by_rate, by_other = jnp.split(by_state, [n, 2 * n], axis=2)
    once = h * _A[:, :, None, None]
    twice = h**2 * _SQUARE[:, :, None, None]
    by_rates = twice * by_position[:, None] + once * by_rate[:, None]
    by_gains = jnp.concatenate([by_rates, once * by_other[:, None]], axis=3)
    matrix = np.eye(3)[:, :, None, None] * np.eye(count) - by_gains
    square = matrix.transpose(0, 2, 1, 3).reshape(3 * count, 3 * count)
    return Factored(by_state, *jax.scipy.linalg.lu_factor(square))


def missing(rates: Rates, x: State, t: Scalar, h: Scalar, gains: Stages) -> Stages:
    """What the gains lack: 0 of a step that is solved."""
    at = stage_states(rates.positions, x, h, gains)
    return jax.vmap(rates.gains)(at, t + h * NODES) - gains


def solved_step(rates: Rates, x: State, t: Scalar, h: Scalar) -> tuple[Stages, Bool[Array, ""]]:
    """Gains at the stages of a step of length `h`, and whether they were found.

    The same factors serve for further corrections as long as those shorten quickly.
    """
    first = jnp.tile(rates.gains(x, t), (3, 1))

    def small(step: Array, gains: Array) -> Bool[Array, ""]:
        return jnp.linalg.norm(step) <= _TOL * jnp.linalg.norm(gains)

    def body(state: tuple[Any, ...]) -> tuple[Any, ...]:
        gains, _, turn = state
        equations = factored(rates, x, t, h, gains)

        def again(state: tuple[Any, ...]) -> tuple[Any, ...]:
            gains, step, _, count = state
            gains = gains + step
            left = equations.solve(missing(rates, x, t, h, gains))
            return gains, left, jnp.linalg.norm(step), count + 1

        def quick(state: tuple[Any, ...]) -> Bool[Array, ""]:
            gains, step, before, count = state
            shortens = jnp.linalg.norm(step) <= _QUICK * before
            return ~small(step, gains) & shortens & (count < _MOST_CORRECTIONS)

        step = equations.solve(missing(rates, x, t, h, gains))
        start = gains, step, jnp.array(jnp.inf), jnp.array(0)
        gains, step, before, _ = jax.lax.while_loop(quick, again, start)
        # At the level of rounding corrections no longer shorten.
        done = small(step, gains) | (before <= 100 * _TOL * jnp.linalg.norm(gains))
        return gains + step, done, turn + 1

    def unfinished(state: tuple[Any, ...]) -> Bool[Array, ""]:
        _, done, turn = state
        return ~done & (turn < _MOST_FACTORS)

    gains, done, _ = jax.lax.while_loop(unfinished, body, (first, jnp.array(False), jnp.array(0)))
    return gains, done & jnp.all(jnp.isfinite(gains))


def step_matrix(equations: Factored, positions: int, h: Scalar) -> Float[Array, "states states"]:
    """What a step makes of a small disturbance of its start."""
    n, states = positions, equations.by_state.shape[2]
    unit = jnp.eye(states)
    # A disturbance of a rate moves the positions at the stages, too.
    moved = equations.by_state[:, :, :n] * (h * NODES[:, None, None])
    right = equations.by_state.at[:, :, n : 2 * n].add(moved)
    gains = equations.solve(right)
    position = unit[:n] + h * unit[n : 2 * n] + h**2 * jnp.tensordot(_SQUARE[2], gains[:, :n], 1)
    return jnp.concatenate([position, unit[n:] + h * jnp.tensordot(WEIGHTS, gains, 1)])


def known_step(rates: Rates, fixed: Rates, x: State, t: Scalar, h: Scalar, gains: Stages) -> Stages:
    """Gains of a step that are known, with their derivatives by all that enters the equations.

    `fixed` are the same rates without derivatives.
    """
    known = jax.lax.stop_gradient((x, t, h, gains))
    equations = factored(fixed, *known)
    return known[3] + equations.solve(missing(rates, x, t, h, known[3]))
