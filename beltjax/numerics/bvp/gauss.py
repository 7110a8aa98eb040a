"""Gauss collocation on one interval: points, weights, and the polynomial through them.

On an interval of length h the solution is the polynomial u of degree s (the number of stages)
with u(0) = y and u' = K_j at the s Gauss points c_j:

    u(t h) = y + h sum_j B_j(t) K_j,   B_j(t) = integral of the Lagrange polynomial l_j from 0 to t

so A = B_j(c_i) and b = B_j(1). Its error is O(h^(2s)) at the nodes, O(h^(s+1)) in between.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

MOST_STAGES = 8


class Gauss(NamedTuple):
    """One Gauss formula, as constants."""

    points: np.ndarray  # c [s], in (0, 1)
    inner: np.ndarray  # A [s, s]
    weights: np.ndarray  # b [s]
    slope: np.ndarray  # l_j = sum_m slope[j, m] t^m
    top: np.ndarray  # u^(s) = sum_j top_j K_j / h^(s-1)

    @property
    def stages(self) -> int:
        """Number of collocation points an interval."""
        return len(self.points)


@lru_cache
def gauss(stages: int) -> Gauss:
    """The formula with `stages` points, of order `2 stages` at the nodes."""
    nodes, weights = np.polynomial.legendre.leggauss(stages)
    points = 0.5 * (nodes + 1.0)
    slope = np.linalg.inv(np.vander(points, increasing=True)).T
    powers = np.arange(1, stages + 1)
    inner = (points[:, None] ** powers) @ (slope / powers).T
    top = slope[:, -1] * float(np.prod(np.arange(1, stages)))
    return Gauss(points, inner, 0.5 * weights, slope, top)
