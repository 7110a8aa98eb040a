"""Harmonic balance: the equations of a periodic motion in its Fourier coefficients.

Of M z'' + C z' + K z + f(z, z', tau) = 0 with tau = w t, the force f evaluated in time (T. M.
Cameron and J. H. Griffin, 1989): the coordinates are Fourier series of `harmonics` terms, and f is
projected from samples over a period. Coefficients are [2 harmonics + 1, size]: the mean, then
cosine and sine of each harmonic.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

Scalar = Float[Array, ""]
State = Float[Array, " size"]
Matrix = Float[Array, "size size"]
Coefficients = Float[Array, "terms size"]


class Oscillator(NamedTuple):
    """A system whose force has the period 2 pi in tau, at one angular frequency."""

    mass: Matrix
    damping: Matrix
    stiffness: Matrix
    frequency: Scalar  # w
    force: Callable[[State, State, Scalar], State]  # of z, z' and tau
    neutral: "Neutral | None" = None


class Neutral(NamedTuple):
    """A translation that changes no force, so that the mean of a motion along it is free.

    The mean of the load on one of its coordinates is unknown instead; `mean_load` reads it from
    where the motion is found along the translation.
    """

    direction: State
    coordinate: Int[Array, ""]

    @property
    def row(self) -> State:
        """What the equation of that coordinate has of the mean beside the force's own."""
        return self.direction / (self.direction @ self.direction)

    def mean_load(self, X: Coefficients) -> Scalar:
        """The mean load beside the force's own, from the coefficients of a motion."""
        return -(self.row @ X[0])


def series(phase: Array, harmonics: int) -> Float[Array, "*phases terms"]:
    """1, cos tau, sin tau, .., of a phase or of many."""
    angles = phase[..., None] * np.arange(1, harmonics + 1)
    waves = jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)
    return jnp.concatenate([jnp.ones_like(phase)[..., None], waves.reshape(*phase.shape, -1)], -1)


def derived(coefficients: Coefficients) -> Coefficients:
    """Coefficients of the derivative by tau."""
    cosines, sines = coefficients[1::2], coefficients[2::2]
    order = np.arange(1, len(cosines) + 1)[:, None]
    turned = jnp.stack([order * sines, -order * cosines], axis=1)
    return jnp.concatenate([jnp.zeros_like(coefficients[:1]), turned.reshape(-1, cosines.shape[1])])


class _Sampling(NamedTuple):
    """Values at equal phases from coefficients, and back; constants."""

    phases: Float[np.ndarray, " samples"]
    values: Float[np.ndarray, "samples terms"]
    rates: Float[np.ndarray, "samples terms"]  # of the derivative by tau
    project: Float[np.ndarray, "terms samples"]
    turn: Float[np.ndarray, "terms terms"]  # the derivative by tau


def _sampling(harmonics: int, samples: int) -> _Sampling:
    phases = 2 * np.pi * np.arange(samples) / samples
    angles = phases[:, None] * np.arange(1, harmonics + 1)
    waves = np.stack([np.cos(angles), np.sin(angles)], axis=-1).reshape(samples, -1)
    values = np.concatenate([np.ones((samples, 1)), waves], axis=1)
    turn = np.zeros((2 * harmonics + 1,) * 2)
    order = np.arange(1, harmonics + 1)
    turn[2 * order - 1, 2 * order], turn[2 * order, 2 * order - 1] = order, -order
    weights = np.append(1.0, np.full(2 * harmonics, 2.0)) / samples
    return _Sampling(phases, values, values @ turn, (values * weights).T, turn)


def residual(system: Oscillator, X: Coefficients, samples: int) -> Coefficients:
    """Coefficients of the equations of motion for the motion with coefficients X."""
    of, w = _sampling(len(X) // 2, samples), system.frequency
    rate = w * (of.turn @ X)
    points = jnp.asarray(of.values @ X), w * (of.rates @ X), jnp.asarray(of.phases)
    force = jax.vmap(system.force)(*points)
    linear = w * (of.turn @ rate) @ system.mass.T + rate @ system.damping.T
    whole = linear + X @ system.stiffness.T + of.project @ force
    if system.neutral is not None:
        whole = whole.at[0, system.neutral.coordinate].add(-system.neutral.mean_load(X))
    return whole


def _tangents(
    system: Oscillator, X: Coefficients, of: _Sampling
) -> tuple[Float[Array, "samples size size"], Float[Array, "samples size size"]]:
    """Derivatives of the force by z and z' at the samples."""
    by_both = jax.vmap(jax.jacfwd(system.force, (0, 1)))
    rate = system.frequency * (of.rates @ X)
    return by_both(of.values @ X, rate, jnp.asarray(of.phases))


_FOR_MEANS = 16  # samples


def preconditioner(
    system: Oscillator, X: Coefficients, samples: int
) -> Callable[[Coefficients], Coefficients]:
    """The inverse of the Jacobian with the means of the force's tangents in place of themselves.

    Constant tangents act on each harmonic alone, so that it costs one inverse a harmonic.
    """
    # A mean that is not quite exact costs an iteration at most.
    of = _sampling(len(X) // 2, min(samples, _FOR_MEANS))
    K, C = (jnp.mean(part, axis=0) for part in _tangents(system, X, of))
    w = system.frequency * jnp.arange(len(X) // 2 + 1)[:, None, None]
    pencils = (system.stiffness + K) - w**2 * system.mass + 1j * w * (system.damping + C)
    if system.neutral is not None:
        pencils = pencils.at[0, system.neutral.coordinate].add(system.neutral.row)
    # One after the other, as in elimination.py.
    inverses = jax.lax.map(jnp.linalg.inv, pencils)

    def apply(right: Coefficients) -> Coefficients:
        waves = jnp.concatenate([right[:1] + 0j, right[1::2] - 1j * right[2::2]])
        found = jnp.einsum("kij,kj->ki", inverses, waves)
        parts = jnp.stack([found[1:].real, -found[1:].imag], axis=1)
        return jnp.concatenate([found[:1].real, parts.reshape(-1, right.shape[1])])

    return apply


def jacobian(
    system: Oscillator, X: Coefficients, samples: int
) -> Float[Array, "unknowns unknowns"]:
    """Derivative of `residual` by X, both flat."""
    of, w = _sampling(len(X) // 2, samples), system.frequency
    terms, size = X.shape
    # One product serves all: first the parts of the matrices, then the tangents at the samples.
    constant = [np.eye(terms)[None], w * of.turn[None], w**2 * (of.turn @ of.turn)[None]]
    parts = [system.stiffness[None], system.damping[None], system.mass[None]]
    tangents = _tangents(system, X, of)
    for values, part in zip((of.values, w * of.rates), tangents, strict=True):
        constant.append(of.project.T[:, :, None] * values[:, None, :])
        parts.append(part)
    outer = jnp.concatenate(constant).reshape(-1, terms**2)
    inner = jnp.concatenate(parts).reshape(-1, size**2)
    whole = (outer.T @ inner).reshape(terms, terms, size, size)
    if system.neutral is not None:
        whole = whole.at[0, 0, system.neutral.coordinate].add(system.neutral.row)
    return whole.transpose(0, 2, 1, 3).reshape(terms * size, -1)
