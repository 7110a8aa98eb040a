"""Mode shapes of one moving beam: sums of its four waves (2.33), in the letters of chapter 2.

    w(x) = c1 e^{i r1 x} + c2 e^{i r2 x} + c3 e^{i r3 x} + c4 e^{i r4 (x - 1)}

scaled to c2 = i/2, so that simple supports at rest give sin(n pi x), and a string
sin(n pi x) e^{-i n pi v x}. No term is larger than its amplitude anywhere on the span.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from beltjax.physics.moving_beam import Ends, require_support
from beltjax.physics.waves import WaveNumbers

Real = Float[Array, "..."]
Cplx = Complex[Array, "..."]
Amplitudes = tuple[Cplx, Cplx, Cplx, Cplx]


class Reflection(NamedTuple):
    """Reflection coefficients of the supports A (x = 0) and B (x = 1) (Table 2.2)."""

    R_A: Cplx  # amplitude of the travelling wave r1 over that of the arriving r2
    Rbar_A: Cplx  # of the layer r3 over the arriving r2
    R_B: Cplx  # of the travelling wave r2 over the arriving r1
    Rbar_B: Cplx  # of the layer r4 over the arriving r1


def _apart(support: str, r: Cplx | Real, s: Cplx | Real) -> Cplx:
    """r^q - s^q, q = 2 for a simple support and 1 for a fixed one; no squares cancel."""
    return (r - s) * (r + s) if support == "simple" else r - s


def reflection(support: str, roots: WaveNumbers) -> Reflection:
    """The four coefficients of Table 2.2 for "simple" or "fixed" supports, element by element."""
    require_support(support)
    r1, r2, r3, r4 = roots
    at_A, at_B = _apart(support, r3, r1), _apart(support, r4, r2)
    return Reflection(
        R_A=-_apart(support, r3, r2) / at_A,
        Rbar_A=_apart(support, r1, r2) / at_A,
        R_B=-_apart(support, r4, r1) / at_B,
        Rbar_B=-_apart(support, r1, r2) / at_B,
    )


def exact_amplitudes(roots: WaveNumbers, ends: Ends) -> Amplitudes:
    """c1..c4 from w = 0 at both ends and the other condition at x = 0.

    The last condition is met if omega is a frequency. Both layers enter the conditions at both
    ends, so that nothing of size e^{-Im r3} is neglected.
    """
    r1, r2, r3, r4 = roots
    E1, E2, g3, g4 = (jnp.exp(1j * r) for r in (r1, r2, r3, -r4))
    A12, A13, A23 = (_apart(ends[0], *pair) for pair in ((r2, r1), (r3, r1), (r3, r2)))
    A14, A24, A34 = (g4 * _apart(ends[0], r4, r) for r in (r1, r2, r3))
    c1 = E2 * A34 - g3 * A24 + A23
    c2 = -(E1 * A34 - g3 * A14 + A13)
    c3 = E1 * A24 - E2 * A14 + A12
    c4 = -(E1 * A23 - E2 * A13 + g3 * A12)
    return _scaled(c1, c2, c3, c4)


def leading_amplitudes(roots: WaveNumbers, ends: Ends) -> Amplitudes:
    """c1..c4 of (2.34), in which each layer enters the conditions at its own end alone."""
    R_A, Rbar_A, _, _ = reflection(ends[0], roots)
    Rbar_B = reflection(ends[1], roots).Rbar_B
    arriving = R_A * jnp.exp(1j * roots.r1)
    return _scaled(R_A, jnp.ones_like(R_A), Rbar_A, arriving * Rbar_B)


def _scaled(c1: Cplx, c2: Cplx, c3: Cplx, c4: Cplx) -> Amplitudes:
    factor = 0.5j / c2
    return c1 * factor, c2 * factor, c3 * factor, c4 * factor


def shape(roots: Cplx, amplitudes: Cplx, x: Real) -> Cplx:
    """Deflection w at x [...] from r1..r4 and c1..c4, each [4]."""
    # Not a complex dot product: XLA compiles its transpose wrongly on a CPU when told not to fuse
    # kernels, and reverse derivatives are then wrong without any sign of it.
    return sum(
        c * jnp.exp(1j * r * at)
        for r, c, at in zip(roots, amplitudes, (x, x, x, x - 1.0), strict=True)
    )  # pyright: ignore[reportReturnType]


def omalley_shape(eps: Real, n: int, x: Real) -> Real:
    """The resting fixed-fixed mode (2.42) to order eps, with the sign of its last layer corrected.

    Printed with (-1)^n, which leaves w(1) = 2 eps (-1)^n. But for a constant phase it is
    (1 + eps)/(n pi) times the shape above, to that order.
    """
    sine, cosine = jnp.sin(n * jnp.pi * x), jnp.cos(n * jnp.pi * x)
    layers = jnp.exp(-x / eps) - (-1.0) ** n * jnp.exp(-(1.0 - x) / eps)
    bent = sine / (n * jnp.pi) - (1.0 - 2.0 * x) * cosine + layers
    return sine / (n * jnp.pi) + eps * bent
