"""Smooth problems of W. Hock and K. Schittkowski, Test Examples for Nonlinear Programming (1981).

Each by its number there: objective, what must be 0 or less, what must be 0, bounds, start, and the
objective at the solution that the book gives; `other` is that of another local minimum, in closed
form or as SciPy finds it. Rows of large numbers are divided by their size. The statements are this
project's own.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

INF = np.inf


class Problem(NamedTuple):
    """Minimize f subject to at_most(x) <= 0, equal(x) = 0, least <= x <= greatest."""

    f: Callable[[Any], Any]
    start: tuple[float, ...]
    best: float
    at_most: Callable[[Any], Any] | None = None
    equal: Callable[[Any], Any] | None = None
    least: Any = -INF
    greatest: Any = INF
    other: float = np.nan


def rosenbrock(x):
    return 100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2


def _least_at_real_root(coefficients, function):
    """The value of `function` at the least of a polynomial's real roots."""
    roots = np.roots(coefficients)
    return float(function(np.min(roots[np.isreal(roots)].real)))


def stack(*rows):
    return jnp.stack(rows)


def product(x):
    return jnp.prod(x)


def squares(x):
    return jnp.sum(x**2)


def _hs43(x):
    first = x[0] ** 2 + x[1] ** 2 + 2 * x[2] ** 2 + x[3] ** 2
    return first - 5 * x[0] - 5 * x[1] - 21 * x[2] + 7 * x[3]


def _hs43_rows(x):
    a, b, c, d = x
    return stack(
        squares(x) + a - b + c - d - 8,
        a**2 + 2 * b**2 + c**2 + 2 * d**2 - a - d - 10,
        2 * a**2 + b**2 + c**2 + 2 * a - b - d - 5,
    )


def _wood(x):
    a, b, c, d = x
    return (
        100 * (b - a**2) ** 2
        + (1 - a) ** 2
        + 90 * (d - c**2) ** 2
        + (1 - c) ** 2
        + 10.1 * ((b - 1) ** 2 + (d - 1) ** 2)
        + 19.8 * (b - 1) * (d - 1)
    )


def _hs55_rows(x):
    a, b, c, d, e, g = x
    return stack(
        a + 2 * b + 5 * e - 6, a + b + c - 3, d + e + g - 2, a + d - 1, b + e - 2, c + g - 2
    )


def _hs56_rows(x):
    bent = jnp.sin(x[3:]) ** 2
    sides = x[:3] - 4.2 * bent[:3]
    return jnp.append(sides, x[0] + 2 * x[1] + 2 * x[2] - 7.2 * bent[3])


def _hs73_rows(x):
    weights = jnp.array([0.28, 0.19, 20.5, 0.62])
    mean = jnp.array([12.0, 11.9, 41.8, 52.1]) @ x - 21
    return stack(5 - jnp.array([2.3, 5.6, 11.1, 1.3]) @ x, 1.645 * jnp.sqrt(weights @ x**2) - mean)


def _hs78_rows(x):
    return stack(squares(x) - 10, x[1] * x[2] - 5 * x[3] * x[4], x[0] ** 3 + x[1] ** 3 + 1)


def _hs79_rows(x):
    root = np.sqrt(2.0)
    return stack(
        x[0] + x[1] ** 2 + x[2] ** 3 - 2 - 3 * root,
        x[1] - x[2] ** 2 + x[3] + 2 - 2 * root,
        x[0] * x[4] - 2,
    )


def _hs100(x):
    a, b, c, d, e, g, h = x
    return (
        (a - 10) ** 2 + 5 * (b - 12) ** 2 + c**4 + 3 * (d - 11) ** 2 + 10 * e**6
        + 7 * g**2 + h**4 - 4 * g * h - 10 * g - 8 * h
    )  # fmt: skip


def _hs100_rows(x):
    a, b, c, d, e, g, h = x
    return stack(
        2 * a**2 + 3 * b**4 + c + 4 * d**2 + 5 * e - 127,
        7 * a + 3 * b + 10 * c**2 + d - e - 282,
        23 * a + b**2 + 6 * g**2 - 8 * h - 196,
        4 * a**2 + b**2 - 3 * a * b + 2 * c**2 + 5 * g - 11 * h,
    )


def _hs113(x):
    a, b, c, d, e, g, h, i, j, k = x
    return (
        a**2 + b**2 + a * b - 14 * a - 16 * b + (c - 10) ** 2 + 4 * (d - 5) ** 2 + (e - 3) ** 2
        + 2 * (g - 1) ** 2 + 5 * h**2 + 7 * (i - 11) ** 2 + 2 * (j - 10) ** 2 + (k - 7) ** 2 + 45
    )  # fmt: skip


def _hs113_rows(x):
    a, b, c, d, e, g, h, i, j, k = x
    return stack(
        4 * a + 5 * b - 3 * h + 9 * i - 105,
        10 * a - 8 * b - 17 * h + 2 * i,
        -8 * a + 2 * b + 5 * j - 2 * k - 12,
        3 * (a - 2) ** 2 + 4 * (b - 3) ** 2 + 2 * c**2 - 7 * d - 120,
        5 * a**2 + 8 * b + (c - 6) ** 2 - 2 * d - 40,
        0.5 * (a - 8) ** 2 + 2 * (b - 4) ** 2 + 3 * e**2 - g - 30,
        a**2 + 2 * (b - 2) ** 2 - 2 * a * b + 14 * e - 6 * g,
        -3 * a + 6 * b + 12 * (j - 8) ** 2 - 7 * k,
    )


def _hs106_rows(x):
    a, b, c, d, e, g, h, i = x
    return stack(
        0.0025 * (d + g) - 1,
        0.0025 * (e + h - d) - 1,
        0.01 * (i - e) - 1,
        (833.33252 * d + 100 * a - 83333.333 - a * g) / 1e5,
        (1250 * e + b * d - b * h - 1250 * d) / 1e5,
        (1250000 + c * e - 2500 * e - c * i) / 1e5,
    )


def _hs110(x):
    return jnp.sum(jnp.log(x - 2) ** 2 + jnp.log(10 - x) ** 2) - jnp.prod(x) ** 0.2


def hs112(x):
    c = jnp.array(
        [-6.089, -17.164, -34.054, -5.914, -24.721, -14.986, -24.1, -10.708, -26.662, -22.179]
    )
    return x @ (c + jnp.log(x / jnp.sum(x)))


def hs112_rows(x):
    a, b, c, d, e, g, h, i, j, k = x
    return stack(a + 2 * b + 2 * c + g + k - 2, d + 2 * e + g + h - 1, c + h + i + 2 * j + k - 1)


# Data that problems 86 and 117 share.
COLVILLE = {
    "e": [-15.0, -27, -36, -18, -12],
    "c": [
        [30.0, -20, -10, 32, -10],
        [-20, 39, -6, -31, 32],
        [-10, -6, 10, -6, -10],
        [32, -31, -6, 39, -20],
        [-10, 32, -10, -20, 30],
    ],
    "d": [4.0, 8, 10, 6, 2],
    "a": [
        [-16.0, 2, 0, 1, 0],
        [0, -2, 0, 4, 2],
        [-3.5, 0, 2, 0, 0],
        [0, -2, 0, -4, -1],
        [0, -9, -2, 1, -2.8],
        [2, 0, -4, 0, 0],
        [-1, -1, -1, -1, -1],
        [-1, -2, -3, -2, -1],
        [1, 2, 3, 4, 5],
        [1, 1, 1, 1, 1],
    ],
    "b": [-40.0, -2, -0.25, -4, -4, -1, -40, -60, 5, 1],
}


def _hs86(x):
    c, d, e = (jnp.array(COLVILLE[key]) for key in "cde")
    return e @ x + x @ c @ x + d @ x**3


def _hs86_rows(x):
    return jnp.array(COLVILLE["b"]) - jnp.array(COLVILLE["a"]) @ x


_ROOT2, _ROOT3 = np.sqrt(2.0), np.sqrt(3.0)
_SIN = np.arcsin(np.sqrt(1 / 4.2))

PROBLEMS = {
    1: Problem(rosenbrock, (-2, 1), 0.0, least=(-INF, -1.5)),
    2: Problem(
        rosenbrock, (-2, 1), 0.0504261879, least=(-INF, 1.5),
        # Where the slope along x2 = 1.5 is 0.
        other=_least_at_real_root([400, 0, -598, -2], lambda x: rosenbrock((x, 1.5))),
    ),
    3: Problem(lambda x: x[1] + 1e-5 * (x[1] - x[0]) ** 2, (10, 1), 0.0, least=(-INF, 0)),
    4: Problem(lambda x: (x[0] + 1) ** 3 / 3 + x[1], (1.125, 0.125), 8 / 3, least=(1, 0)),
    5: Problem(
        lambda x: jnp.sin(x[0] + x[1]) + (x[0] - x[1]) ** 2 - 1.5 * x[0] + 2.5 * x[1] + 1,
        (0, 0), -_ROOT3 / 2 - np.pi / 3, least=(-1.5, -3), greatest=(4, 3),
    ),
    6: Problem(lambda x: (1 - x[0]) ** 2, (-1.2, 1), 0.0, equal=lambda x: 10 * (x[1] - x[0] ** 2)),
    7: Problem(
        lambda x: jnp.log(1 + x[0] ** 2) - x[1], (2, 2), -_ROOT3,
        equal=lambda x: (1 + x[0] ** 2) ** 2 + x[1] ** 2 - 4,
    ),
    8: Problem(
        lambda x: -1.0 + 0 * x[0], (2, 1), -1.0,
        equal=lambda x: stack(squares(x) - 25, x[0] * x[1] - 9),
    ),
    9: Problem(
        lambda x: jnp.sin(np.pi * x[0] / 12) * jnp.cos(np.pi * x[1] / 16), (0, 0), -0.5,
        equal=lambda x: 4 * x[0] - 3 * x[1],
    ),
    10: Problem(
        lambda x: x[0] - x[1], (-10, 10), -1.0,
        lambda x: 3 * x[0] ** 2 - 2 * x[0] * x[1] + x[1] ** 2 - 1,
    ),
    11: Problem(
        lambda x: (x[0] - 5) ** 2 + x[1] ** 2 - 25, (4.9, 0.1), -8.498464223,
        lambda x: x[0] ** 2 - x[1],
    ),
    12: Problem(
        lambda x: x[0] ** 2 / 2 + x[1] ** 2 - x[0] * x[1] - 7 * x[0] - 7 * x[1], (0, 0), -30.0,
        lambda x: 4 * x[0] ** 2 + x[1] ** 2 - 25,
    ),
    14: Problem(
        lambda x: (x[0] - 2) ** 2 + (x[1] - 1) ** 2, (2, 2), 9 - 2.875 * np.sqrt(7.0),
        lambda x: x[0] ** 2 / 4 + x[1] ** 2 - 1, lambda x: x[0] - 2 * x[1] + 1,
    ),
    15: Problem(
        rosenbrock, (-2, 1), 306.5, lambda x: stack(1 - x[0] * x[1], -x[0] - x[1] ** 2),
        greatest=(0.5, INF),
        # Where the slope along x1 x2 = 1 is 0.
        other=_least_at_real_root([400, 0, 2, -202, 0, 0, -200], lambda x: rosenbrock((x, 1 / x))),
    ),
    16: Problem(
        rosenbrock, (-2, 1), 0.25, lambda x: stack(-x[0] - x[1] ** 2, -x[0] ** 2 - x[1]),
        least=(-0.5, -INF), greatest=(0.5, 1), other=rosenbrock((-0.5, np.sqrt(0.5))),
    ),
    17: Problem(
        rosenbrock, (-2, 1), 1.0, lambda x: stack(x[0] - x[1] ** 2, x[1] - x[0] ** 2),
        least=(-0.5, -INF), greatest=(0.5, 1),
    ),
    18: Problem(
        lambda x: x[0] ** 2 / 100 + x[1] ** 2, (2, 2), 5.0,
        lambda x: stack(25 - x[0] * x[1], 25 - squares(x)), least=(2, 0), greatest=(50, 50),
    ),
    19: Problem(
        lambda x: (x[0] - 10) ** 3 + (x[1] - 20) ** 3, (20.1, 5.84), -6961.81381,
        lambda x: stack(
            100 - (x[0] - 5) ** 2 - (x[1] - 5) ** 2, (x[1] - 5) ** 2 + (x[0] - 6) ** 2 - 82.81
        ),
        least=(13, 0), greatest=(100, 100),
    ),
    20: Problem(
        rosenbrock, (-2, 1), 81.5 - 25 * _ROOT3,
        lambda x: stack(-x[0] - x[1] ** 2, -x[0] ** 2 - x[1], 1 - squares(x)),
        least=(-0.5, -INF), greatest=(0.5, INF), other=rosenbrock((-0.5, _ROOT3 / 2)),
    ),
    21: Problem(
        lambda x: 0.01 * x[0] ** 2 + x[1] ** 2 - 100, (-1, -1), -99.96,
        lambda x: 10 - 10 * x[0] + x[1], least=(2, -50), greatest=(50, 50),
    ),
    22: Problem(
        lambda x: (x[0] - 2) ** 2 + (x[1] - 1) ** 2, (2, 2), 1.0,
        lambda x: stack(x[0] + x[1] - 2, x[0] ** 2 - x[1]),
    ),
    23: Problem(
        squares, (3, 1), 2.0,
        lambda x: stack(
            1 - x[0] - x[1], 1 - squares(x), 9 - 9 * x[0] ** 2 - x[1] ** 2,
            x[1] - x[0] ** 2, x[0] - x[1] ** 2,
        ),
        least=-50.0, greatest=50.0,
    ),
    24: Problem(
        lambda x: ((x[0] - 3) ** 2 - 9) * x[1] ** 3 / (27 * _ROOT3), (1, 0.5), -1.0,
        lambda x: stack(
            x[1] - x[0] / _ROOT3, -x[0] - _ROOT3 * x[1], x[0] + _ROOT3 * x[1] - 6
        ),
        least=0.0,
    ),
    26: Problem(
        lambda x: (x[0] - x[1]) ** 2 + (x[1] - x[2]) ** 4, (-2.6, 2, 2), 0.0,
        equal=lambda x: (1 + x[1] ** 2) * x[0] + x[2] ** 4 - 3,
    ),
    27: Problem(
        lambda x: 0.01 * (x[0] - 1) ** 2 + (x[1] - x[0] ** 2) ** 2, (2, 2, 2), 0.04,
        equal=lambda x: x[0] + x[2] ** 2 + 1,
    ),
    28: Problem(
        lambda x: (x[0] + x[1]) ** 2 + (x[1] + x[2]) ** 2, (-4, 1, 1), 0.0,
        equal=lambda x: x[0] + 2 * x[1] + 3 * x[2] - 1,
    ),
    29: Problem(
        lambda x: -product(x), (1, 1, 1), -16 * _ROOT2,
        lambda x: x[0] ** 2 + 2 * x[1] ** 2 + 4 * x[2] ** 2 - 48,
    ),
    30: Problem(
        squares, (1, 1, 1), 1.0, lambda x: 1 - x[0] ** 2 - x[1] ** 2,
        least=(1, -10, -10), greatest=10.0,
    ),
    31: Problem(
        lambda x: 9 * x[0] ** 2 + x[1] ** 2 + 9 * x[2] ** 2, (1, 1, 1), 6.0,
        lambda x: 1 - x[0] * x[1], least=(-10, 1, -10), greatest=(10, 10, 1),
    ),
    32: Problem(
        lambda x: (x[0] + 3 * x[1] + x[2]) ** 2 + 4 * (x[0] - x[1]) ** 2, (0.1, 0.7, 0.2), 1.0,
        lambda x: 3 + x[0] ** 3 - 6 * x[1] - 4 * x[2], lambda x: 1 - jnp.sum(x), least=0.0,
    ),
    33: Problem(
        lambda x: (x[0] - 1) * (x[0] - 2) * (x[0] - 3) + x[2], (0, 0, 3), _ROOT2 - 6,
        lambda x: stack(x[0] ** 2 + x[1] ** 2 - x[2] ** 2, 4 - squares(x)),
        least=0.0, greatest=(INF, INF, 5), other=-4.0,
    ),
    34: Problem(
        lambda x: -x[0], (0, 1.05, 2.9), -np.log(np.log(10.0)),
        lambda x: stack(jnp.exp(x[0]) - x[1], jnp.exp(x[1]) - x[2]),
        least=0.0, greatest=(100, 100, 10),
    ),
    35: Problem(
        lambda x: 9 - 8 * x[0] - 6 * x[1] - 4 * x[2] + 2 * x[0] ** 2 + 2 * x[1] ** 2 + x[2] ** 2
        + 2 * x[0] * x[1] + 2 * x[0] * x[2],
        (0.5, 0.5, 0.5), 1 / 9, lambda x: x[0] + x[1] + 2 * x[2] - 3, least=0.0,
    ),
    36: Problem(
        lambda x: -product(x), (10, 10, 10), -3300.0, lambda x: x[0] + 2 * x[1] + 2 * x[2] - 72,
        least=0.0, greatest=(20, 11, 42),
    ),
    37: Problem(
        lambda x: -product(x), (10, 10, 10), -3456.0,
        lambda x: (x[0] + 2 * x[1] + 2 * x[2]) * jnp.array([1.0, -1.0]) - jnp.array([72.0, 0.0]),
        least=0.0, greatest=42.0,
    ),
    38: Problem(_wood, (-3, -1, -3, -1), 0.0, least=-10.0, greatest=10.0),
    39: Problem(
        lambda x: -x[0], (2, 2, 2, 2), -1.0,
        equal=lambda x: stack(x[1] - x[0] ** 3 - x[2] ** 2, x[0] ** 2 - x[1] - x[3] ** 2),
    ),
    40: Problem(
        lambda x: -product(x), (0.8,) * 4, -0.25,
        equal=lambda x: stack(
            x[0] ** 3 + x[1] ** 2 - 1, x[0] ** 2 * x[3] - x[2], x[3] ** 2 - x[1]
        ),
    ),
    41: Problem(
        lambda x: 2 - x[0] * x[1] * x[2], (2, 2, 2, 2), 52 / 27,
        equal=lambda x: x[0] + 2 * x[1] + 2 * x[2] - x[3], least=0.0, greatest=(1, 1, 1, 2),
    ),
    42: Problem(
        lambda x: squares(x - jnp.array([1.0, 2, 3, 4])), (1,) * 4, 28 - 10 * _ROOT2,
        equal=lambda x: stack(x[0] - 2, x[2] ** 2 + x[3] ** 2 - 2),
    ),
    43: Problem(_hs43, (0,) * 4, -44.0, _hs43_rows),
    45: Problem(
        lambda x: 2 - product(x) / 120, (2,) * 5, 1.0, least=0.0, greatest=(1, 2, 3, 4, 5)
    ),
    46: Problem(
        lambda x: (x[0] - x[1]) ** 2 + (x[2] - 1) ** 2 + (x[3] - 1) ** 4 + (x[4] - 1) ** 6,
        (_ROOT2 / 2, 1.75, 0.5, 2, 2), 0.0,
        equal=lambda x: stack(
            x[0] ** 2 * x[3] + jnp.sin(x[3] - x[4]) - 1, x[1] + x[2] ** 4 * x[3] ** 2 - 2
        ),
    ),
    48: Problem(
        lambda x: (x[0] - 1) ** 2 + (x[1] - x[2]) ** 2 + (x[3] - x[4]) ** 2, (3, 5, -3, 2, -2),
        0.0, equal=lambda x: stack(jnp.sum(x) - 5, x[2] - 2 * (x[3] + x[4]) + 3),
    ),
    49: Problem(
        lambda x: (x[0] - x[1]) ** 2 + (x[2] - 1) ** 2 + (x[3] - 1) ** 4 + (x[4] - 1) ** 6,
        (10, 7, 2, -3, 0.8), 0.0,
        equal=lambda x: stack(x[0] + x[1] + x[2] + 4 * x[3] - 7, x[2] + 5 * x[4] - 6),
    ),
    50: Problem(
        lambda x: (x[0] - x[1]) ** 2 + (x[1] - x[2]) ** 2 + (x[2] - x[3]) ** 4
        + (x[3] - x[4]) ** 2,
        (35, -31, 11, 5, -5), 0.0, equal=lambda x: x[:3] + 2 * x[1:4] + 3 * x[2:] - 6,
    ),
    51: Problem(
        lambda x: (x[0] - x[1]) ** 2 + (x[1] + x[2] - 2) ** 2 + squares(x[3:] - 1),
        (2.5, 0.5, 2, -1, 0.5), 0.0,
        equal=lambda x: stack(x[0] + 3 * x[1] - 4, x[2] + x[3] - 2 * x[4], x[1] - x[4]),
    ),
    52: Problem(
        lambda x: (4 * x[0] - x[1]) ** 2 + (x[1] + x[2] - 2) ** 2 + squares(x[3:] - 1),
        (2,) * 5, 1859 / 349,
        equal=lambda x: stack(x[0] + 3 * x[1], x[2] + x[3] - 2 * x[4], x[1] - x[4]),
    ),
    53: Problem(
        lambda x: (x[0] - x[1]) ** 2 + (x[1] + x[2] - 2) ** 2 + squares(x[3:] - 1),
        (2,) * 5, 176 / 43,
        equal=lambda x: stack(x[0] + 3 * x[1], x[2] + x[3] - 2 * x[4], x[1] - x[4]),
        least=-10.0, greatest=10.0,
    ),
    55: Problem(
        lambda x: x[0] + 2 * x[1] + 4 * x[4] + jnp.exp(x[0] * x[3]), (1, 2, 0, 0, 0, 2), 19 / 3,
        equal=_hs55_rows, least=0.0, greatest=(1, INF, INF, 1, INF, INF), other=20 / 3,
    ),
    56: Problem(
        lambda x: -product(x[:3]), (1, 1, 1, _SIN, _SIN, _SIN, np.arcsin(np.sqrt(5 / 7.2))),
        -3.456, equal=_hs56_rows,
    ),
    60: Problem(
        lambda x: (x[0] - 1) ** 2 + (x[0] - x[1]) ** 2 + (x[1] - x[2]) ** 4, (2, 2, 2),
        0.03256820025, equal=lambda x: x[0] * (1 + x[1] ** 2) + x[2] ** 4 - 4 - 3 * _ROOT2,
        least=-10.0, greatest=10.0,
    ),
    61: Problem(
        lambda x: 4 * x[0] ** 2 + 2 * x[1] ** 2 + 2 * x[2] ** 2 - 33 * x[0] + 16 * x[1]
        - 24 * x[2],
        (0, 0, 0), -143.6461422,
        equal=lambda x: stack(3 * x[0] - 2 * x[1] ** 2 - 7, 4 * x[0] - x[2] ** 2 - 11),
    ),
    63: Problem(
        lambda x: 1000 - x[0] ** 2 - 2 * x[1] ** 2 - x[2] ** 2 - x[0] * x[1] - x[0] * x[2],
        (2, 2, 2), 961.7151721,
        equal=lambda x: stack(8 * x[0] + 14 * x[1] + 7 * x[2] - 56, squares(x) - 25), least=0.0,
    ),
    64: Problem(
        lambda x: 5 * x[0] + 5e4 / x[0] + 20 * x[1] + 7.2e4 / x[1] + 10 * x[2] + 1.44e5 / x[2],
        (1, 1, 1), 6299.842428, lambda x: 4 / x[0] + 32 / x[1] + 120 / x[2] - 1, least=1e-5,
    ),
    65: Problem(
        lambda x: (x[0] - x[1]) ** 2 + (x[0] + x[1] - 10) ** 2 / 9 + (x[2] - 5) ** 2, (-5, 5, 0),
        0.9535288567, lambda x: squares(x) - 48, least=(-4.5, -4.5, -5), greatest=(4.5, 4.5, 5),
    ),
    66: Problem(
        lambda x: 0.2 * x[2] - 0.8 * x[0], (0, 1.05, 2.9), 0.5181632741,
        lambda x: stack(jnp.exp(x[0]) - x[1], jnp.exp(x[1]) - x[2]),
        least=0.0, greatest=(100, 100, 10),
    ),
    71: Problem(
        lambda x: x[0] * x[3] * (x[0] + x[1] + x[2]) + x[2], (1, 5, 5, 1), 17.0140173,
        lambda x: 25 - product(x), lambda x: squares(x) - 40, least=1.0, greatest=5.0,
    ),
    72: Problem(
        lambda x: 1 + jnp.sum(x), (1,) * 4, 727.67937,
        lambda x: stack(
            jnp.array([4, 2.25, 1, 0.25]) @ (1 / x) - 0.0401,
            jnp.array([0.16, 0.36, 0.64, 0.64]) @ (1 / x) - 0.010085,
        ),
        least=1e-3, greatest=(4e5, 3e5, 2e5, 1e5),
    ),
    73: Problem(
        lambda x: jnp.array([24.55, 26.75, 39.0, 40.5]) @ x, (1,) * 4, 29.894378,
        _hs73_rows, lambda x: jnp.sum(x) - 1, least=0.0,
    ),
    76: Problem(
        lambda x: x[0] ** 2 + 0.5 * x[1] ** 2 + x[2] ** 2 + 0.5 * x[3] ** 2 - x[0] * x[2]
        + x[2] * x[3] - x[0] - 3 * x[1] + x[2] - x[3],
        (0.5,) * 4, -4.681818181,
        lambda x: stack(
            x[0] + 2 * x[1] + x[2] + x[3] - 5, 3 * x[0] + x[1] + 2 * x[2] - x[3] - 4,
            1.5 - x[1] - 4 * x[2],
        ),
        least=0.0,
    ),
    77: Problem(
        lambda x: (x[0] - 1) ** 2 + (x[0] - x[1]) ** 2 + (x[2] - 1) ** 2 + (x[3] - 1) ** 4
        + (x[4] - 1) ** 6,
        (2,) * 5, 0.24150513,
        equal=lambda x: stack(
            x[0] ** 2 * x[3] + jnp.sin(x[3] - x[4]) - 2 * _ROOT2,
            x[1] + x[2] ** 4 * x[3] ** 2 - 8 - _ROOT2,
        ),
    ),
    78: Problem(product, (-2, 1.5, 2, -1, -1), -2.91970041, equal=_hs78_rows),
    79: Problem(
        lambda x: (x[0] - 1) ** 2 + (x[0] - x[1]) ** 2 + (x[1] - x[2]) ** 2 + (x[2] - x[3]) ** 4
        + (x[3] - x[4]) ** 4,
        (2,) * 5, 0.0787768209, equal=_hs79_rows,
    ),
    80: Problem(
        lambda x: jnp.exp(product(x)), (-2, 2, 2, -1, -1), 0.0539498478, equal=_hs78_rows,
        least=(-2.3, -2.3, -3.2, -3.2, -3.2), greatest=(2.3, 2.3, 3.2, 3.2, 3.2),
    ),
    81: Problem(
        lambda x: jnp.exp(product(x)) - 0.5 * (x[0] ** 3 + x[1] ** 3 + 1) ** 2,
        (-2, 2, 2, -1, -1), 0.0539498478, equal=_hs78_rows,
        least=(-2.3, -2.3, -3.2, -3.2, -3.2), greatest=(2.3, 2.3, 3.2, 3.2, 3.2),
    ),
    86: Problem(_hs86, (0, 0, 0, 0, 1), -32.34867897, _hs86_rows, least=0.0),
    100: Problem(_hs100, (1, 2, 0, 4, 0, 1, 1), 680.6300573, _hs100_rows),
    106: Problem(
        lambda x: x[0] + x[1] + x[2], (5000, 5000, 5000, 200, 350, 150, 225, 425), 7049.2480205,
        _hs106_rows, least=(100, 1e3, 1e3, *(10,) * 5), greatest=(*(1e4,) * 3, *(1e3,) * 5),
    ),
    110: Problem(_hs110, (9,) * 10, -45.77846971, least=2.001, greatest=9.999),
    112: Problem(hs112, (0.1,) * 10, -47.76109, equal=hs112_rows, least=1e-6),
    113: Problem(_hs113, (2, 3, 5, 5, 1, 2, 7, 3, 6, 10), 24.3062091, _hs113_rows),
}  # fmt: skip
