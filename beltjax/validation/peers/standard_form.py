"""The steady state as a two-point problem in standard form, (3.48)-(3.55), solved by SciPy.

The peer of the closed form: 5n + 2 states for n spans, four first-order equations and the
stretch I_i for each, and the constants T and theta_t. Gamma_i are integrated alongside.
"""

from typing import Any, NamedTuple

import jax
import numpy as np
from scipy.integrate import solve_bvp

from beltjax.physics.steady import SteadyModel


class Peer(NamedTuple):
    """SciPy's answer."""

    T: float
    th: float
    coupling: np.ndarray
    nodes: int
    success: bool


class OneArm(NamedTuple):
    """A model of one belt and one arm, or none, in the letters of chapter 3."""

    eps: float
    s: float
    gam: float
    k_s: float
    rho: float
    D: float
    P: np.ndarray
    lam: np.ndarray
    kap_s: np.ndarray
    kap_e: np.ndarray
    a: np.ndarray
    w_start: np.ndarray


def one_arm(model: SteadyModel) -> OneArm:
    """`model` with r_t = l: what the arm's length is measured in has no part in the equations."""
    m: Any = jax.tree.map(np.asarray, model)
    if np.any(m.H) or m.S.shape[1] > 1 or len(m.give) > 1:
        raise ValueError("The standard form is that of the source: one belt, one arm and no H.")
    arm = m.S.shape[1] == 1
    none = np.zeros(len(m.P))
    return OneArm(
        eps=float(m.eps[0]),
        s=float(np.sqrt(m.c2[0])),
        gam=float(np.sum(m.lam) / m.give[0]),
        k_s=float(m.K[0, 0]) if arm else 1.0,
        rho=1.0,
        D=float(-np.sum(m.S)) if arm else 0.0,
        P=m.P,
        lam=m.lam,
        kap_s=m.kap_s,
        kap_e=m.kap_e,
        a=m.a[:, 0] if arm else none,
        w_start=m.W0[:, 0] if arm else none,
    )


def solve_standard_form(model: SteadyModel, tol: float = 1e-6, max_nodes: int = 100_000) -> Peer:
    """Steady state of `model` by `scipy.integrate.solve_bvp` from a straight, clustered guess."""
    m = one_arm(model)
    n = len(m.P)
    weight = m.lam / m.rho

    def rhs(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        T = y[6 * n]
        w1, w2, w3 = y[n : 2 * n], y[2 * n : 3 * n], y[3 * n : 4 * n]  # w3 = eps w'''
        Q = m.P[:, None] - m.s**2 + T
        w4 = m.lam[:, None] ** 2 * Q * w2 / m.eps  # eps w''''
        zero = np.zeros_like(x)
        return np.vstack([w1, w2, w3 / m.eps, w4, w1**2 / 2, w2**2, zero, zero])

    def bc(ya: np.ndarray, yb: np.ndarray) -> np.ndarray:
        T, th = ya[6 * n], ya[6 * n + 1]
        Q = m.P - m.s**2 + T
        shear_a, shear_b = (
            -Q * y[n : 2 * n] + m.eps * y[3 * n : 4 * n] / m.lam**2 for y in (ya, yb)
        )
        stretch = np.sum(m.lam * (T / m.gam - yb[4 * n : 5 * n])) + m.rho * m.D * th
        lift = weight * ((m.w_start + m.a) * shear_b - m.w_start * shear_a)
        arm = np.sum(lift) + (T - m.s**2) * m.D - m.k_s * th
        return np.concatenate(
            [
                ya[:n] - m.w_start * th,
                yb[:n] - (m.w_start + m.a) * th,
                ya[2 * n : 3 * n] - m.kap_s,
                yb[2 * n : 3 * n] - m.kap_e,
                ya[4 * n : 6 * n],
                [stretch, arm],
            ]
        )

    layer = np.linspace(0, 1, 60) ** 3 / 2
    x = np.unique(np.concatenate([layer, 1 - layer]))
    guess = np.zeros((6 * n + 2, x.size))
    k = m.lam[:, None] * np.sqrt(m.P[:, None]) / m.eps
    start, end = np.exp(-k * x), np.exp(-k * (1 - x))
    guess[2 * n : 3 * n] = m.kap_s[:, None] * start + m.kap_e[:, None] * end
    guess[3 * n : 4 * n] = m.eps * k * (m.kap_e[:, None] * end - m.kap_s[:, None] * start)
    guess[6 * n] = m.s**2 / 2
    found = solve_bvp(rhs, bc, x, guess, tol=tol, max_nodes=max_nodes)
    end = found.y[:, -1]
    return Peer(end[6 * n], end[6 * n + 1], end[5 * n : 6 * n], found.x.size, found.success)
