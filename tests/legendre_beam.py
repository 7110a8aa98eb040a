"""The moving beam by Galerkin's method with Legendre polynomials: a second route to its modes.

With q the coefficients of conforming polynomials, (K - i omega G - omega^2 M) q = 0 has K > 0 below
the critical speed, and is a Hermitian eigenproblem in 1/omega. No wave, root or phase enters.
"""

import functools

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import cholesky, eigh, null_space, solve_triangular


@functools.cache
def basis(ends, size):
    """Quadrature weights, and the basis with its two derivatives at the points, on [0, 1]."""
    width = 3 + ends.count("fixed")
    coefficients = np.zeros((size + width, size))
    for k in range(size):
        degree = np.arange(k, k + width)
        sign, slope = (-1.0) ** degree, degree * (degree + 1.0) / (k + width) ** 2
        conditions = [np.ones(width), sign]
        conditions += [-sign * slope] * (ends[0] == "fixed") + [slope] * (ends[1] == "fixed")
        coefficients[k : k + width, k] = null_space(np.array(conditions))[:, 0]
    x, weights = legendre.leggauss(size + width)
    values = [
        2.0**m * legendre.legval(x, legendre.legder(coefficients, m)).T if m else
        legendre.legval(x, coefficients).T
        for m in range(3)
    ]  # fmt: skip
    weights = weights / 2
    scale = 1 / np.sqrt(weights @ values[1] ** 2)
    return weights, *(value * scale for value in values)


def frequencies(eps, v, ends, count, size):
    """The lowest `count` frequencies from `size` polynomials."""
    weights, f, f1, f2 = basis(ends, size)
    stiffness = (1 - v) * (1 + v) * (f1.T * weights) @ f1 + eps**2 * (f2.T * weights) @ f2
    coriolis = (f.T * weights) @ f1
    coriolis = v * (coriolis - coriolis.T)
    lower = cholesky(stiffness, lower=True)

    def solve(right):
        return solve_triangular(lower, right, lower=True)

    mass = np.linalg.qr((np.sqrt(weights)[:, None] * f) @ solve(np.eye(size)).T, mode="r").T
    turning = 1j * solve(solve(coriolis).T).T
    matrix = np.block([[turning, mass], [mass.T, np.zeros_like(mass)]])
    last = 2 * size - 1
    return 1 / eigh(matrix, eigvals_only=True, subset_by_index=[last + 1 - count, last])[::-1]
