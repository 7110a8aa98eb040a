"""Eigenvalues of M z'' + C z' + K z = 0, and their derivatives.

M is symmetric and positive definite. Where K is too and C = G is skew, the problem is Hermitian:
with M = L L^T, K = R R^T and S = L^{-1} R,

    H = [[i L^{-1} G L^{-T}, i S], [-i S^T, 0]],      x = (i omega L^T v, R^T v)

has the eigenvalues +-omega, all real, with orthogonal vectors of unit energy
omega^2 v*Mv + v*Kv = 1. Damped and unstable systems need the general eigenproblem.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float

from beltjax.compiling.batched_loops import ready_after
from beltjax.numerics.derivative_rules import without_derivative

Matrix = Float[Array, "size size"]
Vectors = Complex[Array, "count size"]

_REPEATED = 1e-9  # relative gap below which a mode has no shape of its own


class Eigen(NamedTuple):
    """Modes z = Re(v e^{lambda t}), of lowest frequency first."""

    values: Complex[Array, " count"]  # lambda = growth rate + i angular frequency
    vectors: Vectors
    left: Vectors  # y with y* (lambda^2 M + lambda C + K) = 0; the vectors, where Hermitian
    diverges: Bool[Array, ""]  # some mode, of all there are, grows without oscillating
    flutters: Bool[Array, ""]  # some oscillation grows


def hermitian_modes(
    M: Matrix, G: Matrix, K: Matrix, count: int, rigid: int = 0
) -> tuple[Eigen, Bool[Array, ""]]:
    """The `count` lowest modes for K positive definite, and whether it is.

    With `rigid` zeros K may be semidefinite; modes of frequency zero are left out. Where K is
    not definite the modes are placeholders. Vectors have unit energy, and their component of
    largest kinetic energy is real and positive.
    """
    M, G, K = jax.lax.stop_gradient((M, G, K))
    size, unit = len(M), jnp.eye(len(M))
    slack = 1e-12 * jnp.max(jnp.diag(K)) if rigid else 0.0
    # Each matrix routine waits for the one before it. In a batch each blocks a thread of XLA's
    # pool (jaxlib 0.10): two at a time on two cores wait for each other forever.
    L, R = jnp.linalg.cholesky(jnp.stack([M, K + slack * unit]))
    definite = jnp.all(jnp.isfinite(R))
    if rigid:
        stiffness, modes = jnp.linalg.eigh(ready_after(jnp.where(definite, K, unit), L))
        R = modes * jnp.sqrt(jnp.maximum(stiffness, 0.0))
    R = jnp.where(definite, R, unit)
    solved = _solved(L, jnp.concatenate([R, jnp.where(definite, G, 0.0)], axis=1))
    S, B = solved[:, :size], _solved(L, solved[:, size:].T).T
    upper = jnp.concatenate([1j * B, 1j * S], axis=1)
    lower = jnp.concatenate([-1j * S.T, jnp.zeros_like(K) + 0j], axis=1)
    omega, x = jnp.linalg.eigh(jnp.concatenate([upper, lower]), symmetrize_input=False)
    first = size + rigid
    omega = omega[first : first + count]
    moving = x[:size, first : first + count] / (1j * omega)
    vectors = jax.scipy.linalg.solve_triangular(L, moving, trans="T", lower=True).T
    vectors = _turned(vectors, moving.T)
    never = jnp.array(False)
    return Eigen(1j * omega, vectors, vectors, never, never), definite


def repeated(values: Array) -> Bool[Array, " count"]:
    """Which of some eigenvalues or frequencies have another one at the same place."""
    apart = jnp.where(jnp.eye(len(values)) > 0, jnp.inf, 0.0)
    gaps = jnp.abs(values[:, None] - values) + apart
    return jnp.min(gaps, axis=1) <= _REPEATED * jnp.abs(values)


def general_modes(
    M: Matrix, C: Matrix, K: Matrix, count: int, rigid: int = 0, after: Array | None = None
) -> Eigen:
    """The `count` lowest modes of any system by its companion matrix.

    Of a pair of conjugate eigenvalues the one with positive frequency is taken, of real ones
    the half that grows most (or decays least). Sorted by frequency, then by decay. Nothing
    begins before `after` is there (see `hermitian_modes`).
    """
    M, C, K = jax.lax.stop_gradient((M, C, K))
    M = M if after is None else ready_after(M, after)
    size = len(M)
    values, vectors = jnp.linalg.eig(_companion(M, C, K))
    scale = jnp.max(jnp.abs(values))
    still = jnp.abs(values.imag) <= 1e-10 * scale
    # Rigid rotations and undamped modes have growth rates of the size of rounding errors.
    grows = values.real > 1e-7 * scale
    diverges, flutters = jnp.any(grows & still), jnp.any(grows & ~still)
    real = jnp.sort(jnp.where(still, values.real, -jnp.inf))[::-1]
    threshold = real[jnp.maximum(jnp.sum(still) // 2 - 1, 0)]
    chosen = jnp.where(still, values.real >= threshold, values.imag > 0)
    order = jnp.argsort(
        jnp.where(chosen, jnp.where(still, -1.0, values.imag), jnp.inf)
        - jnp.where(still & chosen, 1e-3 * values.real / scale, 0.0)
    )[rigid : rigid + count]
    values = jnp.where(still, values.real + 0j, values)[order]
    v = vectors[:size, order].T
    energy = jnp.abs(values) ** 2 * _form(v, M, v).real + jnp.abs(_form(v, K, v).real)
    v = v / jnp.sqrt(energy)[:, None]
    v = _turned(v, v * jnp.sqrt(jnp.diag(M)))
    return Eigen(values, v, _left_vectors(M, C, K, values, v), diverges, flutters)


def _companion(M: Matrix, C: Matrix, K: Matrix) -> Array:
    size = len(M)
    solved = jax.scipy.linalg.cho_solve((jnp.linalg.cholesky(M), True), jnp.hstack([K, C]))
    top = jnp.hstack([jnp.zeros((size, size)), jnp.eye(size)])
    return jnp.vstack([top, -solved])


def _solved(L: Matrix, right: Matrix) -> Matrix:
    return jax.scipy.linalg.solve_triangular(L, right, lower=True)


def _form(left: Vectors, matrix: Matrix, right: Vectors) -> Complex[Array, " count"]:
    """left* matrix right, mode by mode."""
    return jnp.sum(jnp.conj(left) * (right @ matrix.T), axis=-1)


def _turned(vectors: Vectors, weighted: Vectors) -> Vectors:
    """`vectors`, each turned so that its component of largest weight is real and positive."""
    largest = jnp.argmax(jnp.abs(weighted), axis=-1)
    pivot = jnp.take_along_axis(vectors, largest[:, None], axis=-1)
    size = jnp.abs(pivot)
    return vectors * jnp.where(size > 0, jnp.conj(pivot) / jnp.where(size > 0, size, 1.0), 1.0)


def _left_vectors(M: Matrix, C: Matrix, K: Matrix, values: Array, vectors: Vectors) -> Vectors:
    """By inverse iteration with the adjoint."""

    def left(value: Array, vector: Array) -> Array:
        # A little off the eigenvalue, where the matrix is not singular to rounding.
        near = value * (1 + 1e-11) + 1e-300
        adjoint = (near**2 * M + near * C + K).conj().T
        y = jnp.linalg.solve(adjoint, vector)
        y = jnp.linalg.solve(adjoint, y / jnp.linalg.norm(y))
        return y / jnp.linalg.norm(y)

    return jax.vmap(left)(values, vectors)


class Forms(NamedTuple):
    """y* M v, y* C v and y* K v of pairs of vectors y and v."""

    mass: Complex[Array, " count"]
    damping: Complex[Array, " count"]
    stiffness: Complex[Array, " count"]


def forms(M: Matrix, C: Matrix, K: Matrix, left: Vectors, right: Vectors) -> Forms:
    """The forms of three matrices."""
    return Forms(_form(left, M, right), _form(left, C, right), _form(left, K, right))


@jax.custom_jvp
def eigenvalues(values: Array, held: Forms) -> Complex[Array, " count"]:
    """`values`, with their derivatives through the forms of their left and right vectors, held.

    d lambda = -y* (lambda^2 dM + lambda dC + dK) v / y* (2 lambda M + C) v: no gaps between
    eigenvalues enter, so that repeated ones have finite derivatives whose sum is right. For
    Hermitian problems y = v.
    """
    return values


@eigenvalues.defjvp
def _eigenvalues_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
    (values, held), (_, moved) = primals, tangents
    held = without_derivative(held)  # which would lack the motion of the vectors
    change = values**2 * moved.mass + values * moved.damping + moved.stiffness
    slope = 2 * values * held.mass + held.damping
    return values, -change / jnp.where(slope == 0, 1.0, slope)


@jax.custom_jvp
def eigenvectors(M: Matrix, C: Matrix, K: Matrix, values: Array, vectors: Vectors) -> Vectors:
    """`vectors` of simple modes, with their derivatives by M, C and K.

    They keep unit energy and their phase. Where a mode's frequency repeats its shape has no
    derivative, and zero is returned.
    """
    return vectors


@eigenvectors.defjvp
def _eigenvectors_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
    M, C, K, values, vectors = without_derivative(primals)
    dM, dC, dK = tangents[:3]

    def moved(value: Array, v: Array) -> Array:
        pencil = value**2 * M + value * C + K
        slope = (2 * value * M + C) @ v
        change = (value**2 * dM + value * dC + dK) @ v
        weight = (M @ v).conj()
        # (pencil dv + slope dlambda = -change), with v* M dv = 0 for now.
        bordered = jnp.block([[pencil, slope[:, None]], [weight[None, :], jnp.zeros((1, 1))]])
        solved = jnp.linalg.solve(bordered, jnp.append(-change, 0.0))
        dv, dvalue = solved[:-1], solved[-1]
        # Then along v: unit energy, and a pivot that stays real.
        square = (value * value.conj()).real
        energy = 2 * ((value.conj() * dvalue).real * (v.conj() @ M @ v).real)
        energy = energy + square * (v.conj() @ dM @ v).real + (v.conj() @ dK @ v).real
        energy = energy + 2 * (v.conj() @ (square * M + K) @ dv).real
        pivot = jnp.argmax(jnp.where(jnp.abs(v.imag) <= 1e-12 * jnp.abs(v), v.real, -jnp.inf))
        turn = dv[pivot].imag / v[pivot].real
        total = (v.conj() @ (square * M + K) @ v).real
        return dv - (energy / (2 * total) + 1j * turn) * v

    return vectors, jnp.where(repeated(values)[:, None], 0.0, jax.vmap(moved)(values, vectors))


def modal_damping(M: Matrix, K: Matrix, ratio: Float[Array, ""]) -> Matrix:
    """Damping matrix that gives every mode of M and K (without G) the same damping ratio."""
    return 2 * ratio * geometric_mean(M, K)


@jax.custom_jvp
def geometric_mean(M: Matrix, K: Matrix) -> Matrix:
    """The symmetric R with R M^-1 R = K; negative eigenvalues of K count as zero.

    Its derivative divides by sums of frequencies, never by gaps between them, and takes products
    alone: matrix routines on tangents would run at the same time, and in a batch wait for each
    other (see `hermitian_modes`).
    """
    return _mean_by_modes(M, K)[0]


def _mean_by_modes(M: Matrix, K: Matrix) -> tuple[Matrix, Array, Matrix, Matrix]:
    """The mean, the natural frequencies, the modes V with V.T M V = 1 in columns, and M V."""
    L = jnp.linalg.cholesky(M)
    A = _solved(L, _solved(L, K).T).T
    values, vectors = jnp.linalg.eigh((A + A.T) / 2)
    roots = jnp.sqrt(jnp.maximum(values, 0.0))
    modes = jax.scipy.linalg.solve_triangular(L, vectors, trans="T", lower=True)
    momenta = L @ vectors
    return (momenta * roots) @ momenta.T, roots, modes, momenta


@geometric_mean.defjvp
def _geometric_mean_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
    mean, roots, modes, momenta = _mean_by_modes(*primals)
    dM, dK = tangents
    sums = roots[:, None] + roots[None, :]
    moved = modes.T @ dK @ modes + roots[:, None] * (modes.T @ dM @ modes) * roots
    inner = moved / jnp.where(sums > 0, sums, jnp.inf)
    # What waits for the mean waits for all routines.
    return ready_after(mean, modes), momenta @ inner @ momenta.T
