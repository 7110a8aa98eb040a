"""One moving beam with small bending stiffness: expansions in eps, in the letters of chapter 2."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.physics.moving_beam import Ends
from beltjax.physics.waves import WaveNumbers

Real = Float[Array, "..."]

# The last power of eps that (2.28), (2.37) and (2.38) print, by the number of fixed ends.
PRINTED_ORDER = (2, 1, 1)
_LEAST_EPS = 1e-20  # for r3 and r4 alone, as in `wave_numbers`


def leading_wave_numbers(eps: Real, v: Real, omega: Real) -> WaveNumbers:
    """The roots (2.15): r1 and r2 to eps^2, r3 and r4 to order 1; for |v| < 1."""
    Q = (1.0 - v) * (1.0 + v)
    r1 = omega / (1.0 + v) - eps**2 * omega**3 / (2.0 * (1.0 + v) ** 4)
    r2 = -omega / (1.0 - v) + eps**2 * omega**3 / (2.0 * (1.0 - v) ** 4)
    held = jnp.where(eps > _LEAST_EPS, eps, _LEAST_EPS)
    r3 = jax.lax.complex(v * omega / Q, jnp.sqrt(Q) / held)
    return WaveNumbers(r1, r2, r3, jnp.conj(r3))


def frequency_terms(eps: Real, v: Real, n: Real, ends: Ends) -> tuple[Real, ...]:
    """The n-th frequency as terms of order eps^0, eps^1, ...; their sum is the approximation.

    For simple supports the terms go to eps^3, one order beyond (2.28); for one or two fixed ends
    to eps^2, one order beyond (2.37) and (2.38). `PRINTED_ORDER` says where the print stops. They
    hold for |v| < 1.
    """
    N, Q = n * jnp.pi, (1.0 - v) * (1.0 + v)
    string = N * Q
    dispersion = eps**2 * N**3 * (v**4 + 6.0 * v**2 + 1.0) / 2.0
    fixed = ends.count("fixed")
    if not fixed:
        third = -8.0 * eps**3 * N**3 * v**2 / jnp.sqrt(Q)
        return string, jnp.zeros_like(string), dispersion, third
    return string, N * fixed * eps * jnp.sqrt(Q), dispersion + N * (fixed * eps) ** 2
