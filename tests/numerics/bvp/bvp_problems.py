"""Published two-point problems other than Cash and Mazzia's, in groups that compile once each.

A group is one `rhs` and one `bc` that choose by an index in `args`; its members share n and k.
"""

import jax
import jax.numpy as jnp
import numpy as np
import scipy.special


def group(*members):
    """(rhs, bc) of a group from the (rhs, bc) of its members; args is (index, value)."""

    def rhs(x, y, p, args):
        return jax.lax.switch(args[0], [m[0] for m in members], x, y, p, args[1])

    def bc(ya, yb, p, args):
        return jax.lax.switch(args[0], [m[1] for m in members], ya, yb, p, args[1])

    return rhs, bc


def second_order(g):
    """y'' = g(x, y, y', p, value) as two equations."""
    return lambda x, y, p, v: jnp.stack([y[1], g(x, y[0], y[1], p, v)])


# Two states and one parameter; all are given a singular term, zero for the first four.
MATHIEU, VAN_DER_POL, FORCED, EIGENVALUE, EMDEN, BESSEL, CHANDRASEKHAR, STRAIGHT = range(8)


def _van_der_pol(x, y, p, mu):
    # In a period's own time: x runs from 0 to 1, p is the period.
    return p[0] * jnp.stack([y[1], mu * (1 - y[0] ** 2) * y[1] - y[0]])


def _round(g, last):
    return (
        second_order(lambda x, y, d, p, v: -g(y)),
        lambda ya, yb, p, v: jnp.stack([ya[1], last(ya, yb), p[0]]),
    )


with_parameter = group(
    # y'' + (p - 2 q cos 2x) y = 0, even about 0 and about pi (SciPy's example).
    (
        second_order(lambda x, y, d, p, q: -(p[0] - 2 * q * jnp.cos(2 * x)) * y),
        lambda ya, yb, p, q: jnp.stack([ya[1], yb[1], ya[0] - 1]),
    ),
    (_van_der_pol, lambda ya, yb, p, mu: jnp.stack([ya[0] - yb[0], ya[1] - yb[1], ya[1]])),
    # Forced oscillator over one period of the force; p is idle and held at value.
    (
        second_order(lambda x, y, d, p, v: -v * d - 4 * y + jnp.cos(x)),
        lambda ya, yb, p, v: jnp.stack([ya[0] - yb[0], ya[1] - yb[1], p[0] - v]),
    ),
    # (Sturm-Liouville) y'' + p y/(1 + x)^2 = 0: p_n = 1/4 + (n pi/log 2)^2.
    (
        second_order(lambda x, y, d, p, v: -p[0] * y / (1 + x) ** 2),
        lambda ya, yb, p, v: jnp.stack([ya[0], yb[0], ya[1] - 1]),
    ),
    # y'' + (m/x) y' + g(y) = 0 with y'(0) = 0, m in the singular term; p is idle.
    _round(lambda u: u**5, lambda ya, yb: yb[0] - np.sqrt(3) / 2),
    _round(lambda u: u, lambda ya, yb: yb[0] - scipy.special.j0(2.0)),
    _round(lambda u: -jnp.exp(-u), lambda ya, yb: ya[0]),
    # y'' = 0 with the slope given at both ends: any constant may be added.
    (
        second_order(lambda x, y, d, p, v: 0.0 * y),
        lambda ya, yb, p, v: jnp.stack([ya[1], yb[1] - 1.0, p[0]]),
    ),
)

# Four states.
BUCKLED, POROUS, TENSIONED, GRADED = range(4)


def _deflecting_beam(x, y, p, e):
    # Cash-Mazzia 31: y' = sin th, th' = M, e M' = -Q, e Q' = (y - 1) cos th - M T
    sec = 1 / jnp.cos(y[1])
    T = sec + e * y[3] * jnp.tan(y[1])
    return jnp.stack([jnp.sin(y[1]), y[2], -y[3] / e, ((y[0] - 1) * jnp.cos(y[1]) - y[2] * T) / e])


def _fourth(g):
    return lambda x, y, p, v: jnp.stack([y[1], y[2], y[3], g(x, y, v)])


four_states = group(
    (_deflecting_beam, lambda ya, yb, p, e: jnp.stack([ya[0], ya[2], yb[0], yb[2]])),
    # Cash-Mazzia 32: flow between porous walls, y'''' = R (y' y'' - y y''').
    (
        _fourth(lambda x, y, R: R * (y[1] * y[2] - y[0] * y[3])),
        lambda ya, yb, p, R: jnp.stack([ya[0], ya[1], yb[0] - 1, yb[1]]),
    ),
    # Tensioned beam under uniform load, e^2 y'''' - y'' = 1, clamped: layers of width e.
    (
        _fourth(lambda x, y, e: (y[2] + 1) / e**2),
        lambda ya, yb, p, e: jnp.stack([ya[0], ya[1], yb[0], yb[1]]),
    ),
    # Beam of graded stiffness: (x^3 y'')'' = 1 on [1, 2], simply supported.
    (
        _fourth(lambda x, y, v: (1 - 6 * x**2 * y[3] - 6 * x * y[2]) / x**3),
        lambda ya, yb, p, v: jnp.stack([ya[0], ya[2], yb[0], yb[2]]),
    ),
)


def swirling(x, y, p, e):
    """Cash-Mazzia 33, flow between disks that turn against each other; y is (f .. f''', g, g').

    e f'''' + f f''' + g g' = 0,   e g'' + f g' - f' g = 0.
    """
    f, f1, f2, f3, g, g1 = y
    return jnp.stack([f1, f2, f3, -(f * f3 + g * g1) / e, g1, (f1 * g - f * g1) / e])


def disks(ya, yb, p, e):
    """f = f' = 0 on both disks, which turn at -1 and 1."""
    return jnp.stack([ya[0], ya[1], yb[0], yb[1], ya[4] + 1, yb[4] - 1])


def tensioned_beam(x, e):
    """Exact deflection: (e/2) coth(1/(2e)) [cosh((x - 1/2)/e)/cosh(1/(2e)) - 1] + x(1 - x)/2."""
    z = np.abs(np.asarray(x) - 0.5)
    layer = np.exp((z - 0.5) / e) * (1 + np.exp(-2 * z / e)) / (1 + np.exp(-1 / e))
    return 0.5 * e / np.tanh(0.5 / e) * (layer - 1) + x * (1 - x) / 2


def graded_beam(x):
    """Exact deflection of `GRADED` (Ascher, Mattheij and Russell)."""
    x = np.asarray(x)
    bracket = 1 / x + (3 + x) * np.log(x) - x
    return 0.25 * (10 * np.log(2) - 3) * (1 - x) + 0.5 * bracket
