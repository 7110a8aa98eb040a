"""Linear systems x' = A(t) x with periodic coefficients: what a period makes of x, and its growth.

docs/theory/parametric.md, (P14) and (P15): by the method of Magnus of fourth order. The growth is
found by squaring the monodromy matrix, without an eigensolver, so that batches of any size and any
device will do.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float

from beltjax.compiling.batched_loops import in_lanes_of
from beltjax.numerics.derivative_rules import without_derivative

Scalar = Float[Array, ""]
Square = Float[Array, "n n"] | Complex[Array, "n n"]

_NODES = 0.5 + np.array([-1, 1]) * np.sqrt(3) / 6  # Gauss
# Of the exponent of a step, by the number of states: the series is stable up to 3.4 times 2 to the
# power of that, and the more modes there are the higher is their frequency.
_HALVINGS = ((48, 2), (96, 4), (10_000, 8))
_SQUARINGS = 40
_TINY = 1e-300


def exponential(matrix: Square) -> Square:
    """The exponential of a matrix of moderate norm, by a series of eight terms.

    On the imaginary axis the series does not grow up to 3.39, so that what is too quick for the
    step is damped and not excited.
    """
    halvings = next(count for most, count in _HALVINGS if len(matrix) <= most)
    A = matrix / 2**halvings
    A2 = A @ A
    A3, A4 = A2 @ A, A2 @ A2
    unit = jnp.eye(len(A), dtype=A.dtype)
    high = unit / 24 + A / 120 + A2 / 720 + A3 / 5040 + A4 / 40320
    found = unit + A + A2 / 2 + A3 / 6 + A4 @ high
    for _ in range(halvings):
        found = found @ found
    return found


def monodromy(matrix_at: Callable[[Scalar], Square], period: Scalar, steps: int) -> Square:
    """What a period makes of x' = A(t) x, with `matrix_at` the matrix A at a part 0..1 of it."""
    h = period / steps

    def advance(found: Square, step: Array) -> tuple[Square, None]:
        one, two = (matrix_at((step + node) / steps) for node in _NODES)
        mean, twist = (one + two) / 2, two @ one - one @ two
        return exponential(h * mean + np.sqrt(3) / 12 * h**2 * twist) @ found, None

    like = matrix_at(jnp.zeros(()))
    start = in_lanes_of(jnp.ravel(like) * period, jnp.eye(len(like), dtype=like.dtype))
    # In reverse only the products are kept from step to step.
    found, _ = jax.lax.scan(jax.checkpoint(advance), start, jnp.arange(steps))
    return found


class _Dominant(NamedTuple):
    """Where powers of a matrix end."""

    logarithm: Scalar  # of the spectral radius
    right: Square  # two columns, that lie in the space of the largest eigenvalues
    left: Square
    single: Bool[Array, ""]  # one eigenvalue is largest, not a pair


def _dominant(matrix: Square) -> _Dominant:
    def normed(power: Square) -> tuple[Square, Scalar]:
        size = jnp.sqrt(jnp.sum(power.real**2 + power.imag**2)) + _TINY
        return power / size, size

    def square(state: tuple[Square, Scalar], k: Array) -> tuple[tuple[Square, Scalar], None]:
        power, logarithm = state
        power, size = normed(power @ power)
        return (power, logarithm + jnp.log(size) / 2.0**k), None

    power, size = normed(matrix)
    start = in_lanes_of(jnp.ravel(power), (power, jnp.log(size)))
    (power, logarithm), _ = jax.lax.scan(square, start, jnp.arange(1, _SQUARINGS + 1))
    right, share = _two_columns(power)
    left, _ = _two_columns(power.conj().T)
    return _Dominant(logarithm, right, left, share < _ONE_ALONE)


_ONE_ALONE = 1e-6  # of the second direction of a power, below which there is one


def _two_columns(power: Square) -> tuple[Square, Scalar]:
    """Orthonormal columns along the largest ones of a matrix, and the size of the second."""

    def largest(matrix: Square) -> tuple[Array, Scalar]:
        squares = jnp.sum(matrix.real**2 + matrix.imag**2, axis=0)
        place = jnp.argmax(squares)
        size = jnp.sqrt(squares[place]) + _TINY
        return matrix[:, place] / size, size

    first, size = largest(power)
    second, rest = largest(power - jnp.outer(first, first.conj() @ power))
    second = second - first * (first.conj() @ second)  # what rounding left of it
    second = second / (jnp.linalg.norm(second) + _TINY)
    return jnp.stack([first, second], axis=1), rest / size


@jax.custom_jvp
def log_spectral_radius(matrix: Square) -> Scalar:
    """Logarithm of the largest modulus of a matrix's eigenvalues, by squaring it again and again.

    Its derivative is that of the largest eigenvalue, or of a pair of equal modulus the mean.
    """
    return _dominant(matrix).logarithm


@log_spectral_radius.defjvp
def _log_spectral_radius_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> Any:
    (matrix,), (moved,) = primals, tangents
    found = _dominant(without_derivative(matrix))
    left = found.left.conj().T
    now, change = left @ matrix @ found.right, left @ moved @ found.right
    # tr(now^-1 change) / 2 of a pair, and of a single one its own part.
    determinant = now[0, 0] * now[1, 1] - now[0, 1] * now[1, 0]
    trace = now[1, 1] * change[0, 0] + now[0, 0] * change[1, 1]
    trace = trace - now[0, 1] * change[1, 0] - now[1, 0] * change[0, 1]
    pair = trace / jnp.where(found.single, 1.0, 2 * determinant)
    alone = change[0, 0] / jnp.where(found.single, now[0, 0], 1.0)
    return found.logarithm, jnp.where(found.single, alone, pair).real


def growth(matrix: Square, period: Scalar) -> Scalar:
    """Growth rate of the solution that grows most, or decays least, from a monodromy matrix."""
    return log_spectral_radius(matrix) / period
