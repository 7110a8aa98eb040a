"""Problems of Hock and Schittkowski (1981) that are long, badly scaled or nearly flat at the start.

As in `hock_schittkowski`. `PRINTED` are solutions of the book, at which the statements give the
printed objective. Of 105 they do not, and SciPy ends where this project does, which is lower.
"""

import jax.numpy as jnp
import numpy as np
from hock_schittkowski import INF, Problem, squares, stack
from scipy.optimize import brentq

# 25: a curve through 99 points.
_LEVELS = 0.01 * np.arange(1, 100)
_PLACES = 25 + (-50 * np.log(_LEVELS)) ** (2 / 3)


def _hs25(x):
    a, b, c = x
    apart = jnp.where(b < _PLACES, _PLACES - b, 1e-12)
    return squares(jnp.exp(-(apart**c) / a) - _LEVELS)


def _hs47(x):
    a, b, c, d, e = x
    return (a - b) ** 2 + (b - c) ** 3 + (c - d) ** 4 + (d - e) ** 4


def _hs47_rows(x):
    a, b, c, d, e = x
    return stack(a + b**2 + c**3 - 3, b - c**2 + d - 1, a * e - 1)


_CONCENTRATIONS = np.append(0.1, np.arange(1.0, 19))
# fmt: off
_MEASURED = np.array([
    0.00189, 0.1038, 0.268, 0.506, 0.577, 0.604, 0.725, 0.898, 0.947, 0.845,
    0.702, 0.528, 0.385, 0.257, 0.159, 0.0869, 0.0453, 0.01509, 0.00189,
])
# fmt: on


def _hs70(x):
    """Two distributions, by Stirling's series, through 19 points.

    The book multiplies by the series where it divides; so it gives the objective that it prints.
    """
    first, second, share, ratio = x
    b = share + (1 - share) * ratio
    at = _CONCENTRATIONS / 7.658

    def density(k, scale):
        front = scale**k * (k / 6.2832) ** 0.5 / (1 + 1 / (12 * k))
        return front * at ** (k - 1) * jnp.exp(k - scale * at * k)

    found = share * density(second, b) + (1 - share) * density(first, b / ratio)
    return squares(found - _MEASURED)


# 88 to 92: heating a plate to within 1e-4 of a profile; 30 terms of the series.
_MU = np.array(
    [brentq(lambda m: m * np.sin(m) - np.cos(m), k * np.pi, (k + 0.5) * np.pi) for k in range(30)]
)
_A = 2 * np.sin(_MU) / (_MU + np.sin(_MU) * np.cos(_MU))


def _plate(x):
    """Mean square of the error over the plate, less what is allowed."""
    later = jnp.cumsum(x[::-1] ** 2)[::-1]  # of the squares from each on
    signs = (-1.0) ** np.arange(len(x) + 1)
    factors = np.append(1.0, np.full(len(x) - 1, 2.0)) * signs[:-1]
    rho = -(jnp.exp(-(_MU[:, None] ** 2) * later) @ factors + signs[-1]) / _MU**2
    weights = _MU**2 * _A * rho
    total, apart = _MU[:, None] + _MU, _MU[:, None] - _MU
    products = (np.sinc(total / np.pi) + np.sinc(apart / np.pi)) / 2
    profile = 2 * (np.sin(_MU) - _MU * np.cos(_MU)) / _MU**3
    return weights @ products @ weights - weights @ profile + 2 / 15 - 1e-4


def _heated(count):
    start = tuple(0.5 * (-1) ** k for k in range(count))
    return Problem(squares, start, 1.36265681, lambda x: 1e4 * _plate(x)[None])


# fmt: off
_WEIGHTS = np.repeat(
    [95, 105, 110, 115, 120, 125, 130, 135, 140, 145, 150, 155, 160, 165, 170,
     175, 180, 185, 190, 195, 200, 205, 210, 215, 220, 230, 235, 240, 245, 250.0],
    [1, 1, 4, 4, 15, 15, 15, 13, 21, 12, 17, 4, 20, 8, 17,
     8, 6, 6, 7, 4, 3, 3, 8, 1, 6, 5, 1, 7, 1, 2],
)
# fmt: on


def _hs105(x):
    """The likelihood of three normal distributions, of 235 weights."""
    shares = stack(x[0], x[1], 1 - x[0] - x[1])
    means, widths = x[2:5], x[5:8]
    parts = shares / widths * jnp.exp(-(((_WEIGHTS[:, None] - means) / widths) ** 2) / 2)
    return -jnp.sum(jnp.log(jnp.sum(parts, axis=1) / np.sqrt(2 * np.pi)))


def _hs109(x):
    """The cost of power [thousands] from two stations of a network of three."""
    return (3 * x[0] + 1e-6 * x[0] ** 3 + 2 * x[1] + 0.522074e-6 * x[1] ** 3) / 1e3


def _hs109_rows(x):
    limit = 2.25e6
    return stack(
        x[2] - x[3] - 0.55,
        x[3] - x[2] - 0.55,
        (x[0] ** 2 + x[7] ** 2 - limit) / limit,
        (x[1] ** 2 + x[8] ** 2 - limit) / limit,
    )


def _hs109_balances(x):
    a, angle = 50.176, 0.25
    b, c = np.sin(angle), np.cos(angle)
    p, q, _, _, u, v, w, s, t = x
    d, e = x[2], x[3]
    sin, cos = jnp.sin, jnp.cos
    shunt = 0.7533e-3 * a
    rows = stack(
        u * v * sin(-d - angle) + u * w * sin(-e - angle) + 2 * b * u**2 - a * p + 400 * a,
        u * v * sin(d - angle) + v * w * sin(d - e - angle) + 2 * b * v**2 - a * q + 400 * a,
        u * w * sin(e - angle) + v * w * sin(e - d - angle) + 2 * b * w**2 + 881.779 * a,
        a * s + u * v * cos(-d - angle) + u * w * cos(-e - angle)
        - 200 * a - 2 * c * u**2 + shunt * u**2,
        a * t + u * v * cos(d - angle) + v * w * cos(d - e - angle)
        - 2 * c * v**2 + shunt * v**2 - 200 * a,
        u * w * cos(e - angle) + v * w * cos(e - d - angle)
        - 2 * c * w**2 - 22.938 * a + shunt * w**2,
    )  # fmt: skip
    return rows / 1e4


def _hs116(x):
    """Three stages that separate gases by membranes: what they cost.

    The book ends at 97.588409, where SciPy goes a little lower.
    """
    return jnp.sum(x[10:13])


def _hs116_rows(x):
    cost, k, few = _hs116(x), 0.03475, 0.00975
    (a, b, c), (d, e, f, g, h, i, j), (m, n, o) = x[:3], x[3:10], x[10:13]
    return -stack(
        c - b,
        b - a,
        1 - 0.002 * (g - h),
        (cost - 50) / 100,
        (250 - cost) / 100,
        (o - 1.262626 * j + 1.231059 * c * j) / 100,
        e - k * b - 0.975 * b * e + few * b**2,
        f - k * c - 0.975 * c * f + few * c**2,
        (e * g - a * h - d * g + d * h) / 100,
        1 - 0.002 * (b * i + e * h - a * h - f * i) - e - f,
        (b * i - c * j - f * i - 500 * b + 500 * f + b * j) / 100,
        b - 0.9 - 0.002 * (b * j - c * j),
        d - k * a - 0.975 * a * d + few * a**2,
        (m - 1.262626 * h + 1.231059 * a * h) / 100,
        (n - 1.262626 * i + 1.231059 * b * i) / 100,
    )


PRINTED = {
    70: (12.27695, 4.631788, 0.3128625, 2.029290),
    109: (674.8881, 1134.170, 0.1335691, -0.3711526, 252, 252, 201.4648, 426.6607, 368.4939),
}

HARDER = {
    25: Problem(_hs25, (100, 12.5, 3), 0.0, least=(0.1, 0, 0), greatest=(100, 25.6, 5)),
    47: Problem(
        _hs47, (2, np.sqrt(2), -1, 2 - np.sqrt(2), 0.5), 0.0, equal=_hs47_rows,
    ),
    70: Problem(
        _hs70, (2, 4, 0.04, 2), 0.007498464, lambda x: -(x[2] + (1 - x[2]) * x[3])[None],
        least=1e-5, greatest=(100, 100, 1, 100),
    ),
    **{86 + count: _heated(count) for count in range(2, 7)},
    105: Problem(
        _hs105, (0.1, 0.2, 100, 125, 175, 11.2, 13.2, 15.8), 1138.416240,
        lambda x: (x[0] + x[1] - 1)[None],
        least=(0.001, 0.001, 100, 130, 170, 5, 5, 5),
        greatest=(0.499, 0.499, 180, 210, 240, 25, 25, 25), other=1136.307300,
    ),
    109: Problem(
        _hs109, (0, 0, 0, 0, 250, 250, 200, 0, 0), 5.36206928, _hs109_rows, _hs109_balances,
        least=(0, 0, -0.55, -0.55, 196, 196, 196, -400, -400),
        greatest=(INF, INF, 0.55, 0.55, 252, 252, 252, 800, 800),
    ),
    116: Problem(
        _hs116, (0.5, 0.8, 0.9, 0.1, 0.14, 0.5, 489, 80, 650, 450, 150, 150, 150), 97.5875096,
        _hs116_rows,
        least=(0.1, 0.1, 0.1, 1e-4, 0.1, 0.1, 0.1, 0.1, 500, 0.1, 1, 1e-4, 1e-4),
        greatest=(1, 1, 1, 0.1, 0.9, 0.9, 1000, 1000, 1000, 500, 150, 150, 150), other=97.5910347,
    ),
}  # fmt: skip
