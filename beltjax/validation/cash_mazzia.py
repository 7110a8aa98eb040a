"""The singularly perturbed test set of Cash and Mazzia (bvpTestSet), its scalar members.

Every problem is y'' = g(x, y, y', eps) with y(a), y(b) given. `EXACT` has the solution where it
is known in closed form, in a form that neither overflows nor cancels.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import airy, airye, erf

PI = np.pi
Values = float | np.ndarray
Arguments = tuple[Array, Array, Array, Array]  # problem, eps, y(a), y(b)


class ScalarProblem(NamedTuple):
    """One problem of the set."""

    number: int
    interval: tuple[float, float]
    ends: Callable  # eps -> (y(a), y(b))
    second: Callable  # y'' of (x, y, y', eps)
    exact: Callable | None  # y of (x, eps)


def _e(x: Values) -> np.ndarray:
    return np.exp(np.maximum(x, -745.0)) * (np.asarray(x) > -745.0)


def _p01(x: Values, e: float) -> np.ndarray:
    r = np.sqrt(e)
    return (_e(-x / r) - _e((x - 2) / r)) / (1 - _e(-2 / r))


def _p07(x: Values, e: float) -> np.ndarray:
    r = np.sqrt(2 * e)
    top = x * erf(x / r) + np.sqrt(2 * e / PI) * _e(-(x**2) / (2 * e))
    return np.cos(PI * x) + x + top / (erf(1 / r) + np.sqrt(2 * e / PI) * _e(-1 / (2 * e)))


def _growing(t: Values, r: float) -> np.ndarray:
    # sinh(t/r)/sinh(2/r) for t in [0, 2]
    return _e((t - 2) / r) * (1 - _e(-2 * t / r)) / (1 - _e(-4 / r))


def _p15(x: Values, e: float) -> np.ndarray:
    # Ai and Bi scaled by their exponentials; oscillatory for x < 0.
    s = e ** (-1.0 / 3.0)
    a_l, _, b_l, _ = airy(-s)
    a_r, _, b_r, _ = airye(s)  # times e^(+z), e^(-z)
    z1 = 2.0 / 3.0 * s**1.5
    # y = c Ai + d Bi with d scaled: d = D e^(-z1) / b_r
    # rows: c a_l + d b_l = 1 ; c a_r e^-z1 + d b_r e^z1 = 1
    g = _e(-z1)
    det = a_l * b_r - a_r * g * g * b_l
    c = (b_r - b_l * g) / det
    d_scaled = (a_l - a_r * g) / det  # d e^z1
    x = np.asarray(x, dtype=float)
    neg = np.minimum(x, 0.0) * s
    pos = np.maximum(x, 0.0) * s
    an, _, bn, _ = airy(neg)
    ap, _, bp, _ = airye(pos)
    zp = 2.0 / 3.0 * pos**1.5
    left = c * an + d_scaled * g * bn
    right = c * ap * _e(-zp) + d_scaled * bp * _e(zp - z1)
    return np.where(x < 0, left, right)


def _log_cosh(z: Values) -> np.ndarray:
    z = np.abs(z)
    return z + np.log1p(_e(-2 * z)) - np.log(2.0)


def _const(a: float, b: float) -> Callable[[float], tuple[float, float]]:
    return lambda e: (a, b)


def _cos(x: Array) -> Array:
    return jnp.cos(PI * x)


def _sin(x: Array) -> Array:
    return jnp.sin(PI * x)


CASES = [
    ScalarProblem(1, (0, 1), _const(1.0, 0.0), lambda x, y, d, e: y / e, _p01),
    ScalarProblem(
        2,
        (0, 1),
        _const(1.0, 0.0),
        lambda x, y, d, e: d / e,
        lambda x, e: (1 - _e((x - 1) / e)) / (1 - _e(-1 / e)),
    ),
    ScalarProblem(
        3,
        (-1, 1),
        _const(-1.0, -1.0),
        lambda x, y, d, e: (
            (-(2 + _cos(x)) * d + y - (1 + e * PI**2) * _cos(x) - (2 + _cos(x)) * PI * _sin(x)) / e
        ),
        lambda x, e: np.cos(PI * x),
    ),
    ScalarProblem(
        4,
        (-1, 1),
        lambda e: (1 + np.exp(-2), 1 + np.exp(-2 * (1 + e) / e)),
        lambda x, y, d, e: (-d + (1 + e) * y) / e,
        lambda x, e: np.exp(x - 1) + _e(-(1 + e) * (1 + x) / e),
    ),
    ScalarProblem(
        5,
        (-1, 1),
        _const(-1.0, -1.0),
        lambda x, y, d, e: (x * d + y - (1 + e * PI**2) * _cos(x) + PI * x * _sin(x)) / e,
        lambda x, e: np.cos(PI * x),
    ),
    ScalarProblem(
        6,
        (-1, 1),
        _const(-2.0, 0.0),
        lambda x, y, d, e: (-x * d - e * PI**2 * _cos(x) - PI * x * _sin(x)) / e,
        lambda x, e: np.cos(PI * x) + erf(x / np.sqrt(2 * e)) / erf(1 / np.sqrt(2 * e)),
    ),
    ScalarProblem(
        7,
        (-1, 1),
        _const(-1.0, 1.0),
        lambda x, y, d, e: (-x * d + y - (1 + e * PI**2) * _cos(x) - PI * x * _sin(x)) / e,
        _p07,
    ),
    ScalarProblem(
        8,
        (0, 1),
        _const(1.0, 2.0),
        lambda x, y, d, e: -d / e,
        lambda x, e: (2 - _e(-1 / e) - _e(-x / e)) / (1 - _e(-1 / e)),
    ),
    ScalarProblem(
        9,
        (-1, 1),
        lambda e: (1 / (1 + e), 1 / (1 + e)),
        lambda x, y, d, e: -(4 * x * d + 2 * y) / (e + x**2),
        lambda x, e: 1 / (e + x**2),
    ),
    ScalarProblem(
        10,
        (-1, 1),
        _const(0.0, 2.0),
        lambda x, y, d, e: -x * d / e,
        lambda x, e: 1 + erf(x / np.sqrt(2 * e)) / erf(1 / np.sqrt(2 * e)),
    ),
    ScalarProblem(
        11,
        (-1, 1),
        _const(-1.0, -1.0),
        lambda x, y, d, e: (y - (1 + e * PI**2) * _cos(x)) / e,
        lambda x, e: np.cos(PI * x),
    ),
    ScalarProblem(
        12,
        (-1, 1),
        _const(-1.0, 0.0),
        lambda x, y, d, e: (y - (1 + e * PI**2) * _cos(x)) / e,
        lambda x, e: np.cos(PI * x) + _growing(1 + x, np.sqrt(e)),
    ),
    ScalarProblem(
        13,
        (-1, 1),
        _const(0.0, -1.0),
        lambda x, y, d, e: (y - (1 + e * PI**2) * _cos(x)) / e,
        lambda x, e: np.cos(PI * x) + _growing(1 - x, np.sqrt(e)),
    ),
    ScalarProblem(
        14,
        (-1, 1),
        _const(0.0, 0.0),
        lambda x, y, d, e: (y - (1 + e * PI**2) * _cos(x)) / e,
        lambda x, e: np.cos(PI * x) + _growing(1 - x, np.sqrt(e)) + _growing(1 + x, np.sqrt(e)),
    ),
    ScalarProblem(15, (-1, 1), _const(1.0, 1.0), lambda x, y, d, e: x * y / e, _p15),
    ScalarProblem(
        16,
        (0, 1),
        lambda e: (0.0, np.sin(PI / (2 * e))),
        lambda x, y, d, e: -(PI**2) * y / (4 * e**2),
        lambda x, e: np.sin(PI * x / (2 * e)),
    ),
    ScalarProblem(
        17,
        (-0.1, 0.1),
        lambda e: (-0.1 / np.sqrt(e + 0.01), 0.1 / np.sqrt(e + 0.01)),
        lambda x, y, d, e: -3 * e * y / (e + x**2) ** 2,
        lambda x, e: x / np.sqrt(e + x**2),
    ),
    ScalarProblem(
        18, (0, 1), lambda e: (1.0, _e(-1 / e)), lambda x, y, d, e: -d / e, lambda x, e: _e(-x / e)
    ),
    ScalarProblem(
        19,
        (0, 1),
        _const(0.0, 0.0),
        lambda x, y, d, e: (0.5 * PI * jnp.sin(0.5 * PI * x) * jnp.exp(2 * y) - jnp.exp(y) * d) / e,
        None,
    ),
    ScalarProblem(
        20,
        (0, 1),
        lambda e: (1 + e * _log_cosh(-0.745 / e), 1 + e * _log_cosh(0.255 / e)),
        lambda x, y, d, e: (1 - d**2) / e,
        lambda x, e: 1 + e * _log_cosh((x - 0.745) / e),
    ),
    ScalarProblem(
        21,
        (0, 1),
        lambda e: (1.0, _e(-1 / np.sqrt(e))),
        lambda x, y, d, e: (y + y**2 - jnp.exp(-2 * x / jnp.sqrt(e))) / e,
        lambda x, e: _e(-x / np.sqrt(e)),
    ),
    ScalarProblem(22, (0, 1), _const(0.0, 0.5), lambda x, y, d, e: -(d + y**2) / e, None),
    ScalarProblem(23, (0, 1), _const(0.0, 1.0), lambda x, y, d, e: jnp.sinh(y / e) / e, None),
    ScalarProblem(
        24,
        (0, 1),
        _const(0.9129, 0.375),
        lambda x, y, d, e: (
            (((1 + 1.4) / 2 - e * 2 * x) * y * d - d / y - 2 * x / (1 + x**2) * (1 - 0.2 * y**2))
            / (e * (1 + x**2) * y)
        ),
        None,
    ),
    ScalarProblem(25, (0, 1), _const(-1 / 3, 1 / 3), lambda x, y, d, e: (y - y * d) / e, None),
    ScalarProblem(26, (0, 1), _const(1.0, -1 / 3), lambda x, y, d, e: (y - y * d) / e, None),
    ScalarProblem(27, (0, 1), _const(1.0, 1 / 3), lambda x, y, d, e: (y - y * d) / e, None),
    ScalarProblem(28, (0, 1), _const(1.0, 1.5), lambda x, y, d, e: (y - y * d) / e, None),
    ScalarProblem(29, (0, 1), _const(0.0, 1.5), lambda x, y, d, e: (y - y * d) / e, None),
    ScalarProblem(30, (0, 1), _const(-7 / 6, 1.5), lambda x, y, d, e: (y - y * d) / e, None),
    ScalarProblem(35, (-1, 1), _const(1.0, 2.0), lambda x, y, d, e: (x * d - y) / e, None),
]
BY_NUMBER = {case.number: i for i, case in enumerate(CASES)}


def rhs(
    x: Float[Array, ""], y: Float[Array, "2"], p: Float[Array, "0"], args: Arguments
) -> Float[Array, "2"]:
    """All problems in one: args is (index, eps, y(a), y(b))."""
    index, eps, _, _ = args
    branches = [lambda x, u, v, e, g=case.second: g(x, u, v, e) for case in CASES]
    return jnp.stack([y[1], jax.lax.switch(index, branches, x, y[0], y[1], eps)])


def bc(
    ya: Float[Array, "2"], yb: Float[Array, "2"], p: Float[Array, "0"], args: Arguments
) -> Float[Array, "2"]:
    """Both values given."""
    return jnp.stack([ya[0] - args[2], yb[0] - args[3]])


def path(number: int, eps: float, rungs: int, start: float) -> tuple[np.ndarray, ...]:
    """The arguments of a problem from eps = `start` down to `eps` in equal ratios."""
    case = CASES[BY_NUMBER[number]]
    ladder = np.geomspace(max(start, eps), eps, rungs)
    ends = np.array([case.ends(e) for e in ladder])
    index = np.full(rungs, BY_NUMBER[number])
    return index, ladder, ends[:, 0], ends[:, 1]


def line(number: int, eps: float) -> tuple[np.ndarray, np.ndarray]:
    """The guess: straight between the given values."""
    case = CASES[BY_NUMBER[number]]
    (a, b), (ya, yb) = case.interval, case.ends(eps)
    y = np.array([[ya, yb], [(yb - ya) / (b - a)] * 2])
    return np.array([a, b], float), y
