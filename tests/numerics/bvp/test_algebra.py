"""The structured elimination against dense LU."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from beltjax.numerics.bvp.chain import ChainEnds, ChainLinks, factor_chain, solve_chain
from beltjax.numerics.bvp.error_estimate import fastest
from beltjax.numerics.small_matrices import inverse, orthogonalize


@jax.jit
def solved(links, ends, g, c):
    return solve_chain(factor_chain(links, ends), g, c)


def chain(rng, n, k, N, growth=1.0):
    """A random chain whose links grow and shrink by `growth` each."""
    turn = np.stack([np.linalg.qr(rng.normal(size=(n, n)))[0] for _ in range(N + 1)], -1)
    rates = growth ** np.where(np.arange(n) < n // 2, 1.0, -1.0)
    A = -np.einsum("iaz,a,jaz->ijz", turn[..., 1:], rates, turn[..., :-1])
    B = np.broadcast_to(np.eye(n)[..., None], (n, n, N))
    links = ChainLinks(*map(jnp.asarray, (A, B, rng.normal(size=(n, k, N)))))
    m = n + k
    ends = ChainEnds(*(jnp.asarray(rng.normal(size=(m, c))) for c in (n, n, k)))
    return links, ends


def dense(links, ends):
    n, k, N = links.E.shape
    M = np.zeros((n * N + n + k, n * (N + 1) + k))
    for i in range(N):
        rows = slice(i * n, (i + 1) * n)
        M[rows, i * n : (i + 1) * n] = links.A[..., i]
        M[rows, (i + 1) * n : (i + 2) * n] = links.B[..., i]
        M[rows, n * (N + 1) :] = links.E[..., i]
    M[n * N :, :n], M[n * N :, n * N : n * (N + 1)], M[n * N :, n * (N + 1) :] = ends
    return M


def packed(y, p):
    return np.concatenate([np.asarray(y).T.ravel(), p])


@pytest.mark.parametrize(
    ("n", "k", "N", "growth"),
    [(2, 0, 1, 1.0), (3, 2, 10, 3.0), (4, 1, 63, 1.0), (4, 1, 63, 10.0), (4, 1, 63, 1e3)],
)
def test_chain_agrees_with_dense_lu(n, k, N, growth):
    rng = np.random.default_rng(N)
    links, ends = chain(rng, n, k, N, growth)
    g, c = rng.normal(size=(n, N)), rng.normal(size=n + k)
    y, p = solved(links, ends, jnp.asarray(g), jnp.asarray(c))
    M = dense(links, ends)
    expected = np.linalg.solve(M, np.concatenate([g.T.ravel(), c]))
    found = packed(y, p)
    # Forward error of dense LU itself, by the condition of the dense matrix.
    bound = 1e-14 * np.linalg.cond(M)
    assert np.linalg.norm(found - expected) <= bound * np.linalg.norm(expected)
    # Backward error: `found` solves exactly a system within rounding of this one.
    left = np.linalg.norm(M @ found - np.concatenate([g.T.ravel(), c]))
    assert left <= 1e-13 * np.linalg.norm(M, 2) * np.linalg.norm(found)


def test_growth_of_e50_in_both_directions_is_stable():
    """Shooting along such a chain would lose all digits: e^50 is 5e21."""
    rng = np.random.default_rng(0)
    links, ends = chain(rng, 4, 1, 63, np.exp(50 / 63))
    truth, p = rng.normal(size=(4, 64)), 0.7
    g = np.einsum("ijz,jz->iz", links.A, truth[:, :-1]) + truth[:, 1:] + p * links.E[:, 0]
    c = ends.A @ truth[:, 0] + ends.B @ truth[:, -1] + p * ends.P[:, 0]
    y, found = solved(links, ends, jnp.asarray(g), c)
    assert np.max(np.abs(y - truth)) < 1e-12
    assert float(found[0]) == pytest.approx(p, abs=1e-12)


def test_transposed_solve_uses_the_same_factors():
    rng = np.random.default_rng(5)
    links, ends = chain(rng, 3, 2, 10, 2.0)
    g, c = jnp.asarray(rng.normal(size=(3, 10))), jnp.asarray(rng.normal(size=5))
    ybar, pbar = rng.normal(size=(3, 11)), rng.normal(size=2)

    @jax.jit
    def transposed(links, ends, bars):
        factor = factor_chain(links, ends)
        return jax.linear_transpose(lambda g, c: solve_chain(factor, g, c), g, c)(bars)

    gbar, cbar = transposed(links, ends, (jnp.asarray(ybar), jnp.asarray(pbar)))
    expected = np.linalg.solve(dense(links, ends).T, packed(ybar, pbar))
    found = np.concatenate([np.asarray(gbar).T.ravel(), cbar])
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12)


def test_inverse_pivots():
    """Without exchanging rows the first step divides by zero, the second by 1e-20."""
    a = np.array([[0.0, 1.0, 2.0], [1e-20, 3.0, 1.0], [4.0, 1.0, 0.0]])
    found = jax.jit(inverse)(jnp.asarray(a)[..., None])[..., 0]
    np.testing.assert_allclose(found, np.linalg.inv(a), rtol=1e-14, atol=1e-16)


def test_inverse_of_many_blocks_leaves_neighbors_of_a_singular_one_alone():
    rng = np.random.default_rng(3)
    a = rng.normal(size=(5, 5, 9))
    a[:, :, 4] = 0.0
    found = np.asarray(jax.jit(inverse)(jnp.asarray(a)))
    assert not np.isfinite(found[..., 4]).all()
    for i in (0, 3, 5, 8):
        np.testing.assert_allclose(found[..., i], np.linalg.inv(a[..., i]), rtol=1e-9)


def test_orthogonal_factors_reproduce_the_block():
    rng = np.random.default_rng(4)
    a = jnp.asarray(rng.normal(size=(6, 3, 2)))
    q, r = jax.jit(orthogonalize)(a)
    for i in range(2):
        np.testing.assert_allclose(q[..., i] @ q[..., i].T, np.eye(6), atol=1e-14)
        np.testing.assert_allclose(q[:3, :, i].T @ np.triu(r[..., i]), a[..., i], atol=1e-14)


def test_fastest_mode_is_found_whatever_the_units():
    """A norm of the 16th power is no less than the largest eigenvalue's, and 1e9^(1/16) is 3.7."""
    rng = np.random.default_rng(6)
    blocks = rng.normal(size=(8, 3, 3))
    blocks[0] = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.5]]  # oscillates
    units = np.array([1.0, 1e6, 1e-3])
    scaled = blocks * units[:, None] / units
    found = jax.jit(fastest)(jnp.asarray(np.moveaxis(scaled, 0, -1)))
    ratio = np.asarray(found) / np.max(np.abs(np.linalg.eigvals(blocks)), axis=1)
    assert np.all((ratio > 1 - 1e-12) & (ratio < 5.0))
