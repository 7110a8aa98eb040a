"""More problems of Hock and Schittkowski (1981), with data and of plants and networks.

As in `hock_schittkowski`; rows of large numbers are divided by their size. Every statement is
confirmed by SciPy's SLSQP or by this project's own search, at the printed digits, from the start.
"""

import jax
import jax.numpy as jnp
import numpy as np
from hock_schittkowski import COLVILLE, INF, Problem, hs112, hs112_rows, squares, stack


def between(value, least, greatest):
    """Rows of 0 or less for least <= value <= greatest."""
    return jnp.concatenate([jnp.atleast_1d(least - value), jnp.atleast_1d(value - greatest)])


_AGES = np.repeat(np.arange(8.0, 43, 2), [2, 4, 4, 3, 3, 2, 3, 3, 3, 3, 2, 3, 2, 1, 2, 2, 1, 1])
_CHLORINE = np.repeat(
    np.array(
        [
            49,
            48,
            47,
            48,
            47,
            46,
            45,
            43,
            45,
            43,
            44,
            43,
            46,
            45,
            42,
            43,
            41,
            40,
            42,
            40,
            41,
            40,
            41,
            40,
            38,
            41,
            40,
            41,
            38,
            40,
            39,
        ]
    )
    / 100,
    [2, 1, 1, 1, 1, 2, 1, 1, 1, 2, 1, 2, 1, 1, 2, 1, 2, 1, 1, 2, 1, 1, 2, 3, 1, 1, 2, 1, 1, 2, 2],
)


def _hs57(x):
    return squares(_CHLORINE - x[0] - (0.49 - x[0]) * jnp.exp(-x[1] * (_AGES - 8)))


def _hs59(x):
    a, b = x
    return (
        -75.196 + 3.8112 * a + 0.0020567 * a**3 - 1.0345e-5 * a**4 + 6.8306 * b
        - 0.030234 * a * b + 1.28134e-3 * b * a**2 + 2.266e-7 * a**4 * b - 0.25645 * b**2
        + 0.0034604 * b**3 - 1.3514e-5 * b**4 + 28.106 / (b + 1) + 5.2375e-6 * a**2 * b**2
        + 6.3e-8 * a**3 * b**2 - 7e-10 * a**3 * b**3 - 3.405e-4 * a * b**2
        + 1.6638e-6 * a * b**3 + 2.8673 * jnp.exp(0.0005 * a * b) - 3.5256e-5 * a**3 * b
        - 0.12694 * a**2
    )  # fmt: skip


def _hs62(x):
    a, b, c = x[0] + x[1] + x[2] + 0.03, x[1] + x[2] + 0.03, x[2] + 0.03
    return -32.174 * (
        255 * jnp.log(a / (0.09 * x[0] + b))
        + 280 * jnp.log(b / (0.07 * x[1] + c))
        + 290 * jnp.log(c / (0.13 * x[2] + 0.03))
    )


def _chart(a, b, n):
    """Problems 68 and 69, a control chart."""

    def cost(x):
        grown = jnp.exp(x[0]) - 1
        return (a * n - (b * grown - x[2]) * x[3] / (grown + x[3])) / x[0]

    def equal(x):
        normal, root = jax.scipy.stats.norm.cdf, np.sqrt(n)
        beyond = normal(-x[1] + root) + normal(-x[1] - root)
        return stack(x[2] - 2 * normal(-x[1]), x[3] - beyond)

    return dict(
        f=cost, equal=equal, start=(1,) * 4, least=(1e-4, 0, 0, 0), greatest=(100, 100, 2, 2)
    )


def _grid(a):
    """Problems 74 and 75, two generators."""

    def equal(x):
        p, q = x[2], x[3]
        return stack(
            1000 * (jnp.sin(-p - 0.25) + jnp.sin(-q - 0.25)) + 894.8 - x[0],
            1000 * (jnp.sin(p - 0.25) + jnp.sin(p - q - 0.25)) + 894.8 - x[1],
            1000 * (jnp.sin(q - 0.25) + jnp.sin(q - p - 0.25)) + 1294.8,
        ) / 1000  # fmt: skip

    return dict(
        f=lambda x: 3 * x[0] + 1e-6 * x[0] ** 3 + 2 * x[1] + 2e-6 / 3 * x[1] ** 3,
        start=(0,) * 4, at_most=lambda x: between(x[3] - x[2], -a, a), equal=equal,
        least=(0, 0, -a, -a), greatest=(1200, 1200, a, a),
    )  # fmt: skip


def _hs83_rows(x):
    a, b, c, d, e = x
    return jnp.concatenate([
        between(85.334407 + 0.0056858 * b * e + 0.0006262 * a * d - 0.0022053 * c * e, 0, 92),
        between(80.51249 + 0.0071317 * b * e + 0.0029955 * a * b + 0.0021813 * c**2, 90, 110),
        between(9.300961 + 0.0047026 * c * e + 0.0012547 * a * c + 0.0019085 * c * d, 20, 25),
    ])  # fmt: skip


def _hs84_rows(x):
    a = jnp.array(
        [
            [-145421.402, 2931.1506, -40.427932, 5106.192, 15711.36],
            [-155011.1084, 4360.53352, 12.9492344, 10236.884, 13176.786],
            [-326669.5104, 7390.68412, -27.8986976, 16643.076, 30988.146],
        ]
    )
    made = a @ (x[0] * jnp.append(1.0, x[1:])) / 1e5
    return between(made, jnp.zeros(3), jnp.array([2.94, 2.94, 2.772]))


def _hs84(x):
    a = jnp.array([-8720288.849, 150512.5253, -156.6950325, 476470.3222, 729482.8271])
    return 24345 - x[0] * (a @ jnp.append(1.0, x[1:]))


def _hs93_parts(x):
    a, b, c, d = x[:4]
    return a * d * (a + b + c), b * c * (a + 1.57 * b + d)


def _hs93(x):
    first, second = _hs93_parts(x)
    return (0.0204 + 0.0607 * x[4] ** 2) * first + (0.0187 + 0.0437 * x[5] ** 2) * second


def _hs93_rows(x):
    first, second = _hs93_parts(x)
    hot = 0.00062 * first * x[4] ** 2 + 0.00058 * second * x[5] ** 2
    return stack(2.07 - 0.001 * jnp.prod(x), hot - 1)


def _beds(*least):
    """Problems 95 to 98, by what their four rows must reach."""

    def rows(x):
        a, b, c, d, e, g = x
        return jnp.array(least) - stack(
            17.1 * a + 38.2 * b + 204.2 * c + 212.3 * d + 623.4 * e + 1495.5 * g - 169 * a * c
            - 3580 * c * e - 3810 * d * e - 18500 * d * g - 24300 * e * g,
            17.9 * a + 36.8 * b + 113.9 * c + 169.7 * d + 337.8 * e + 1385.2 * g - 139 * a * c
            - 2450 * d * e - 16600 * d * g - 17200 * e * g,
            -273 * b - 70 * d - 819 * e + 26000 * d * e,
            159.9 * a - 311 * b + 587 * d + 391 * e + 2198 * g - 14000 * a * g,
        )  # fmt: skip

    return dict(
        f=lambda x: jnp.array([4.3, 31.8, 63.3, 15.8, 68.5, 4.7]) @ x,
        start=(0,) * 6, at_most=rows, least=0.0,
        greatest=(0.31, 0.046, 0.068, 0.042, 0.028, 0.0134),
    )  # fmt: skip


def _flight(x):
    """Range, height and speed of problem 99, in units of 1e4, 1e5 and 1e3."""
    thrust = np.array([50, 50, 75, 75, 75, 100, 100])
    times = np.diff([0, 25, 50, 100, 150, 200, 290, 380])
    r = h = v = 0.0
    for push, time, angle in zip(thrust, times, x, strict=True):
        r = r + push * time * jnp.cos(angle)
        h = h + time**2 * (push * jnp.sin(angle) - 32) / 2 + time * v
        v = v + time * (push * jnp.sin(angle) - 32)
    return r / 1e4, h / 1e5, v / 1e3


def _hs99_rows(x):
    _, h, v = _flight(x)
    return stack(h - 1, v - 1)


def monomials(factors, powers, x):
    """The sum of monomials with these factors and rows of powers."""
    return jnp.array(factors) @ jnp.exp(jnp.array(powers) @ jnp.log(x))


def _membrane(a):
    """Problems 101 to 103, by the last power in the objective."""
    third = 1 / 3

    def cost(x):
        powers = [
            [1, -1, 0, 2, 0, -3, a],
            [-1, -2, 1, 1, -1, 0, -0.5],
            [-2, 1, 0, -1, -2, 1, 0],
            [2, 2, -1, 0, 0.5, -2, 1],
        ]
        return monomials([10.0, 15, 20, 25], powers, x)

    def rows(x):
        first = [[0.5, 0, -1, 0, 0, -2, 1], [3, 1, -2, 0, 0, 1, 0.5]]
        first += [[0, -1, 1, -0.5, 0, 2 * third, 0.25]]
        second = [[-0.5, 1, -1, 0, -1, 1, 0], [0, 0, 1, -1, -1, 2, 0]]
        second += [[-1, 0.5, 0, -2, -1, third, 0]]
        third_row = [[1, 0, -1.5, 0, 1, -1, third], [0, 1, -0.5, 0, 1, -1, -0.5]]
        third_row += [[-1, 1, 0.5, 0, 1, 0, 0], [0, -2, 1, 0, 1, -1, 1]]
        fourth = [[-2, 1, 0, -1, 0.5, 0, third], [0.5, 2, 1, third, -2 * third, 0, 0.25]]
        fourth += [[-3, -2, 1, 0, 1, 0, 0.75], [0, 0, -2, 1, 0, 0, 0.5]]
        limits = stack(
            monomials([0.5, 0.7, 0.2], first, x),
            monomials([1.3, 0.8, 3.1], second, x),
            monomials([2, 0.1, 1, 0.65], third_row, x),
            monomials([0.2, 0.3, 0.4, 0.5], fourth, x),
        )
        return jnp.append(limits - 1, between(cost(x), 100, 3000) / 1000)

    return dict(
        f=cost, start=(6,) * 7, at_most=rows, least=(*(0.1,) * 6, 0.01), greatest=10.0
    )  # fmt: skip


def _hs104(x):
    return 0.4 * (x[0] / x[6]) ** 0.67 + 0.4 * (x[1] / x[7]) ** 0.67 + 10 - x[0] - x[1]


def _hs104_rows(x):
    a, b, c, d, e, g, h, i = x
    limits = stack(
        0.0588 * e * h + 0.1 * a - 1,
        0.0588 * g * i + 0.1 * a + 0.1 * b - 1,
        4 * c / e + 2 * c**-0.71 / e + 0.0588 * c**-1.3 * h - 1,
        4 * d / g + 2 * d**-0.71 / g + 0.0588 * d**-1.3 * i - 1,
    )
    return jnp.append(limits, between(_hs104(x), 1, 4.2))


def _hs107_equal(x):
    v, w, u = x[4:7]
    c, d = (48.4 / 50.176) * np.sin(0.25), (48.4 / 50.176) * np.cos(0.25)
    (s1, s2, s3), (c1, c2, c3) = (
        [turn(angle) for angle in (x[7], x[8], x[7] - x[8])] for turn in (jnp.sin, jnp.cos)
    )
    return stack(
        0.4 - x[0] + 2 * c * v**2 - v * w * (d * s1 + c * c1) - v * u * (d * s2 + c * c2),
        0.4 - x[1] + 2 * c * w**2 + v * w * (d * s1 - c * c1) + w * u * (d * s3 - c * c3),
        0.8 + 2 * c * u**2 + v * u * (d * s2 - c * c2) - w * u * (d * s3 + c * c3),
        0.2 - x[2] + 2 * d * v**2 + v * w * (c * s1 - d * c1) + v * u * (c * s2 - d * c2),
        0.2 - x[3] + 2 * d * w**2 - v * w * (c * s1 + d * c1) - w * u * (c * s3 + d * c3),
        -0.337 + 2 * d * u**2 - v * u * (c * s2 + d * c2) + w * u * (c * s3 - d * c3),
    )


def _hs108(x):
    return -0.5 * (
        x[0] * x[3] - x[1] * x[2] + x[2] * x[8] - x[4] * x[8] + x[4] * x[7] - x[5] * x[6]
    )


def _hs108_rows(x):
    a, b, c, d, e, g, h, i, j = x
    return stack(
        c**2 + d**2 - 1, j**2 - 1, e**2 + g**2 - 1, a**2 + (b - j) ** 2 - 1,
        (a - e) ** 2 + (b - g) ** 2 - 1, (a - h) ** 2 + (b - i) ** 2 - 1,
        (c - e) ** 2 + (d - g) ** 2 - 1, (c - h) ** 2 + (d - i) ** 2 - 1,
        h**2 + (i - j) ** 2 - 1, b * c - a * d, -c * j, e * j, g * h - e * i,
    )  # fmt: skip


def _hs114_rows(x):
    g5 = 1.12 * x[0] + 0.13167 * x[0] * x[7] - 0.00667 * x[0] * x[7] ** 2 - 0.99 * x[3]
    g6 = 57.425 + 1.098 * x[7] - 0.038 * x[7] ** 2 + 0.325 * x[5] - 0.99 * x[6]
    wide = 1 / 0.99 - 0.99
    return -stack(
        35.82 - 0.222 * x[9] - 0.9 * x[8],
        3 * x[6] - 133 - 0.99 * x[9],
        -(35.82 - 0.222 * x[9] - 0.9 * x[8]) + x[8] * (1 / 0.9 - 0.9),
        -(3 * x[6] - 133 - 0.99 * x[9]) + wide * x[9],
        g5 / 1e3,
        g6,
        (-g5 + wide * x[3]) / 1e3,
        -g6 + wide * x[6],
    )


def _hs114_equal(x):
    return stack(
        (1.22 * x[3] - x[0] - x[4]) / 1e3,
        98 * x[2] / (x[3] * x[8] / 1e3 + x[2]) - x[5],
        (x[1] + x[4]) / x[0] - x[7],
    )


def _hs117(x):
    b, c, d = (jnp.array(COLVILLE[key]) for key in "bcd")
    return -b @ x[:10] + x[10:] @ c @ x[10:] + 2 * d @ x[10:] ** 3


def _hs117_rows(x):
    a, c, d, e = (jnp.array(COLVILLE[key]) for key in "acde")
    return -(2 * c @ x[10:] + 3 * d * x[10:] ** 2 + e - x[:10] @ a)


def _hs118(x):
    linear, square = jnp.array([2.3, 1.7, 2.2]), jnp.array([1e-4, 1e-4, 1.5e-4])
    return jnp.sum(jnp.reshape(x, (5, 3)) @ linear + jnp.reshape(x, (5, 3)) ** 2 @ square)


def _hs118_rows(x):
    periods = jnp.reshape(x, (5, 3))
    rise = jnp.diff(periods, axis=0) + 7
    most = jnp.array([13.0, 14, 13])
    sums = jnp.array([60.0, 50, 70, 85, 100]) - jnp.sum(periods, axis=1)
    return jnp.concatenate([sums, jnp.ravel(-rise), jnp.ravel(rise - most)])


def _hs119(x):
    ones = [(1, 4, 7, 8, 16), (2, 3, 7, 10), (3, 7, 9, 10, 14), (4, 7, 11, 15), (5, 6, 10, 12, 16)]
    ones += [(6, 8, 15), (7, 11, 13), (8, 10, 15), (9, 12, 16), (10, 14), (11, 13), (12, 14)]
    ones += [(13, 14), (14,), (15,), (16,)]
    a = np.zeros((16, 16))
    for row, places in enumerate(ones):
        a[row, np.array(places) - 1] = 1
    y = x**2 + x + 1
    return y @ a @ y


def _hs119_equal(x):
    b = jnp.array(
        [
            [0.22, 0.20, 0.19, 0.25, 0.15, 0.11, 0.12, 0.13],
            [-1.46, 0, -1.30, 1.82, -1.15, 0, 0.80, 0],
            [1.29, -0.89, 0, 0, -1.16, -0.96, 0, -0.49],
            [-1.10, -1.06, 0.95, -0.54, 0, -1.78, -0.41, 0],
            [0, 0, 0, -1.43, 1.51, 0.59, -0.33, -0.43],
            [0, -1.72, -0.33, 0, 1.62, 1.24, 0.21, -0.26],
            [1.12, 0, 0, 0.31, 0, 0, 1.12, 0],
            [0, 0.45, 0.26, -1.10, 0.58, 0, -1.03, 0.10],
        ]
    )
    single = jnp.asarray(x)[8:].at[6].add(-0.36 * x[8])
    return b @ x[:8] + single - jnp.array([2.5, 1.1, -3.1, -3.5, 1.3, 2.1, 2.3, -1.5])


MORE = {
    44: Problem(
        lambda x: x[0] - x[1] - x[2] - x[0] * x[2] + x[0] * x[3] + x[1] * x[2] - x[1] * x[3],
        (0,) * 4, -15.0,
        lambda x: stack(
            x[0] + 2 * x[1] - 8, 4 * x[0] + x[1] - 12, 3 * x[0] + 4 * x[1] - 12,
            2 * x[2] + x[3] - 8, x[2] + 2 * x[3] - 8, x[2] + x[3] - 5,
        ),
        least=0.0, other=-13.0,
    ),
    57: Problem(
        _hs57, (0.42, 5), 0.02845966972, lambda x: 0.09 - 0.49 * x[1] + x[0] * x[1],
        least=(0.4, -4),
    ),
    59: Problem(
        _hs59, (90, 10), -7.804226324,
        lambda x: stack(
            700 - x[0] * x[1], x[0] ** 2 / 125 - x[1], 5 * (x[0] - 55) - (x[1] - 50) ** 2
        ),
        least=0.0, greatest=(75, 65), other=-6.7495052737,
    ),
    62: Problem(
        _hs62, (0.7, 0.2, 0.1), -26272.51448, equal=lambda x: jnp.sum(x) - 1,
        least=0.0, greatest=1.0,
    ),
    68: Problem(best=-0.920425026, **_chart(1e-4, 1.0, 24)),
    69: Problem(best=-956.71288, **_chart(0.1, 1000.0, 4)),
    74: Problem(best=5126.4981, **_grid(0.55)),
    75: Problem(best=5174.4129, **_grid(0.48)),
    83: Problem(
        lambda x: 5.3578547 * x[2] ** 2 + 0.8356891 * x[0] * x[4] + 37.293239 * x[0] - 40792.141,
        (78, 33, 27, 27, 27), -30665.53867, _hs83_rows, least=(78, 33, 27, 27, 27),
        greatest=(102, 45, 45, 45, 45),
    ),
    84: Problem(
        _hs84, (2.52, 2, 37.5, 9.25, 6.8), -5280335.133, _hs84_rows,
        least=(0, 1.2, 20, 9, 6.5), greatest=(1000, 2.4, 60, 9.3, 7),
    ),
    93: Problem(
        _hs93, (5.54, 4.4, 12.02, 11.82, 0.702, 0.852), 135.075961, _hs93_rows, least=0.0
    ),
    95: Problem(best=0.015619514, **_beds(4.97, -1.88, -29.08, -78.02)),
    96: Problem(best=0.015619514, **_beds(4.97, -1.88, -69.08, -118.02)),
    97: Problem(best=3.1358091, other=4.0712464, **_beds(32.97, 25.12, -29.08, -78.02)),
    98: Problem(best=3.1358091, other=4.0712464, **_beds(32.97, 25.12, -124.08, -173.02)),
    99: Problem(
        lambda x: -_flight(x)[0] ** 2, (0.5,) * 7, -8.31079892, equal=_hs99_rows,
        least=0.0, greatest=1.58,
    ),
    101: Problem(best=1809.76476, **_membrane(-0.25)),
    102: Problem(best=911.880571, **_membrane(0.125)),
    103: Problem(best=543.667958, **_membrane(0.5)),
    104: Problem(
        _hs104, (6, 3, 0.4, 0.2, 6, 6, 1, 0.5), 3.9511634396, _hs104_rows,
        least=0.1, greatest=10.0,
    ),
    107: Problem(
        lambda x: 3000 * x[0] + 1000 * x[0] ** 3 + 2000 * x[1] + 666.667 * x[1] ** 3,
        (0.8, 0.8, 0.2, 0.2, 1.0454, 1.0454, 1.0454, 0, 0), 5055.011803, equal=_hs107_equal,
        least=(0, 0, -INF, -INF, 0.90909, 0.90909, 0.90909, -INF, -INF),
        greatest=(INF, INF, INF, INF, 1.0909, 1.0909, 1.0909, INF, INF),
    ),
    108: Problem(
        _hs108, (1,) * 9, -np.sqrt(0.75), _hs108_rows, least=(*(-INF,) * 8, 0),
        other=-0.674981443,
    ),
    111: Problem(
        lambda x: hs112(jnp.exp(x)), (-2.3,) * 10, -47.76109026,
        equal=lambda x: hs112_rows(jnp.exp(x)), least=-100.0, greatest=100.0,
    ),
    114: Problem(
        lambda x: 5.04 * x[0] + 0.035 * x[1] + 10 * x[2] + 3.36 * x[4] - 0.063 * x[3] * x[6],
        (1745, 12000, 110, 3048, 1974, 89.2, 92.8, 8, 3.6, 145), -1768.80696, _hs114_rows,
        _hs114_equal, (*(1e-5,) * 5, 85, 90, 3, 1.2, 145),
        (2000, 16000, 120, 5000, 2000, 93, 95, 12, 4, 162),
    ),
    117: Problem(
        _hs117, (*(0.001,) * 6, 60, *(0.001,) * 8), 32.348679, _hs117_rows, least=0.0
    ),
    118: Problem(
        _hs118, (20, 55, 15, *(20, 60, 20) * 4), 664.82045, _hs118_rows,
        least=(8, 43, 3, *(0,) * 12), greatest=(21, 57, 16, *(90, 120, 60) * 4),
    ),
    119: Problem(
        _hs119, (10,) * 16, 244.899698, equal=_hs119_equal, least=0.0, greatest=5.0
    ),
}  # fmt: skip
