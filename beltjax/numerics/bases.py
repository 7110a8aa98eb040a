"""Spectral bases on the unit interval for functions that vanish at both ends.

Each basis knows, in closed form, the products of its functions and their moments with the end
layer S(x) = sinh(kx)/sinh(k), so that nothing downstream needs a quadrature rule. Functions are
scaled to unit slope: the integral of psi_a' psi_b' is 1 where a = b, and 0 elsewhere.
"""

import abc
import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import legendre

from beltjax.numerics.derivative_rules import with_own_slopes

# Order from which the continued fraction of the Bessel ratio starts. It contracts by
# exp(-depth^2/k) on the way down, and its start is good to 1/k^2: rounding for every k.
_DEPTH = 320


Pair = tuple[Array, Array]


class Products(NamedTuple):
    """Integrals over [0, 1] of products of the basis' functions psi_a; constants."""

    value: Float[np.ndarray, "n n"]  # psi_a psi_b
    curvature: Float[np.ndarray, "n n"]  # psi_a'' psi_b''
    skew: Float[np.ndarray, "n n"]  # psi_a psi_b', antisymmetric
    graded: Float[np.ndarray, "n n"]  # (x - 1/2) psi_a' psi_b'
    mean: Float[np.ndarray, " n"]  # psi_a
    first: Float[np.ndarray, " n"]  # x psi_a


class AbstractBasis(eqx.Module):
    """Functions psi_0 .. psi_{size-1} on [0, 1], zero at both ends."""

    size: eqx.AbstractVar[int]

    def __check_init__(self):
        if self.size < 1:
            raise ValueError(
                f"{type(self).__name__}: size must be at least 1, not {self.size}; it is the "
                "number of functions on each span."
            )

    @abc.abstractmethod
    def products(self) -> Products:
        """Integrals of products of the functions."""

    @abc.abstractmethod
    def layer_moments(self, u: Array, z: Array) -> tuple[Array, Array]:
        """Integrals of psi_a with S(1-x) and with S(x), [n] each, for z = k^2 and u = 1/k.

        Whichever of z and u is good at the k in question is used: z below 3, u above.
        """

    @abc.abstractmethod
    def values(self, x: Array, order: int = 0) -> Array:
        """The functions' derivatives of that order at x: [..., n] for x [...]."""


class Sine(AbstractBasis):
    """sqrt(2) sin(n pi x)/(n pi), n = 1 .. size: the source's. Converges algebraically, N^-5."""

    size: int = eqx.field(static=True)

    def products(self) -> Products:
        """In closed form."""
        n = np.arange(1, self.size + 1)
        waves = n * np.pi
        # int sin(a pi x) cos(b pi x) is 2a/(pi (a^2 - b^2)) for a + b odd, else 0.
        a, b = n[:, None], n[None, :]
        odd = (a + b) % 2 == 1
        skew = np.where(odd, 2 * a / (np.pi * np.where(odd, a**2 - b**2, 1)), 0.0)
        sign = np.where(n % 2 == 1, 1.0, -1.0)
        scale = np.sqrt(2.0) / waves
        # int (x - 1/2) cos(k pi x) is -2/(k pi)^2 for odd k, else 0; a - b is odd where a + b is.
        graded = -2 / np.where(odd, a - b, 1) ** 2 - 2 / (a + b) ** 2
        return Products(
            value=np.diag(1 / waves**2),
            curvature=np.diag(waves**2),
            skew=2 * skew / (a * np.pi),
            graded=np.where(odd, graded / np.pi**2, 0.0),
            mean=scale * (1 + sign) / waves,
            first=scale * sign / waves,
        )

    def layer_moments(self, u: Array, z: Array) -> tuple[Array, Array]:
        """k^2 S = S'' by parts twice: only the end where S is 1 contributes."""
        n = np.arange(1, self.size + 1)
        waves = n * np.pi
        thick = z < 3.0
        moment = jnp.where(
            thick,
            np.sqrt(2.0) / (jnp.where(thick, z, 0.0) + waves**2),
            np.sqrt(2.0) * u**2 / (1 + (u * waves) ** 2),
        )
        return moment, moment * np.where(n % 2 == 1, 1.0, -1.0)

    def values(self, x: Array, order: int = 0) -> Array:
        """By the angle moved on a quarter turn for each derivative."""
        waves = np.arange(1, self.size + 1) * np.pi
        angle = x[..., None] * waves + order * np.pi / 2
        return np.sqrt(2.0) * waves ** (order - 1) * jnp.sin(angle)


class Legendre(AbstractBasis):
    """(P_n - P_{n+2})(2x - 1)/(2 sqrt(2n + 3)), n = 0 .. size-1. Converges exponentially."""

    size: int = eqx.field(static=True)

    def products(self) -> Products:
        """By the orthogonality of Legendre polynomials; psi_n' = -sqrt(2n + 3) P_{n+1}(2x - 1)."""
        count = self.size
        n = np.arange(count)
        combine = np.zeros((count, count + 2))  # psi = combine @ P
        combine[n, n], combine[n, n + 2] = 1.0, -1.0
        combine /= 2 * np.sqrt(2 * n + 3.0)[:, None]
        norms = 1 / (2 * np.arange(count + 2) + 1.0)  # of P_j(2x - 1)
        slope = np.zeros((count, count + 2))
        slope[n, n + 1] = -np.sqrt(2 * n + 3.0)
        # int_{-1}^{1} P_a' P_b' = m (m + 1), m = min(a, b), for a + b even; twice that on [0, 1].
        a, b = n[:, None] + 1, n[None, :] + 1
        least = np.minimum(a, b)
        bent = np.where((a + b) % 2 == 0, 2.0 * least * (least + 1), 0.0)
        weights = np.sqrt(2 * n + 3.0)
        # (2m + 1) t P_m = (m + 1) P_{m+1} + m P_{m-1}, with t = 2x - 1 and m = n + 1.
        above = (n[:-1] + 2) / (2 * weights[:-1] * weights[1:])
        mean, odd = combine[:, 0], combine[:, 1] * norms[1]
        return Products(
            value=(combine * norms) @ combine.T,
            curvature=bent * weights[:, None] * weights[None, :],
            skew=(combine * norms) @ slope.T,
            graded=np.diag(above, 1) + np.diag(above, -1),
            mean=mean,
            first=(mean + odd) / 2,
        )

    def layer_moments(self, u: Array, z: Array) -> tuple[Array, Array]:
        """Moments of P_j: i_j(k/2)/(2 cosh(k/2)) for even j, over 2 sinh for odd j.

        The i_j are modified spherical Bessel functions.
        """
        moments = with_own_slopes(functools.partial(_legendre_layer, count=self.size + 2))(u, z)
        n = np.arange(self.size)
        ends = (moments[n] - moments[n + 2]) / (2 * np.sqrt(2 * n + 3.0))
        # P_j(1 - 2x) = (-1)^j P_j(2x - 1).
        return ends * np.where(n % 2 == 0, 1.0, -1.0), ends

    def values(self, x: Array, order: int = 0) -> Array:
        """Through the coefficients of each function's derivative in Legendre polynomials."""
        count = self.size
        n = np.arange(count)
        functions = np.zeros((count + 2, count))
        functions[n, n], functions[n + 2, n] = 1.0, -1.0
        functions /= 2 * np.sqrt(2 * n + 3.0)
        derived = legendre.legder(functions, order) * 2.0**order if order else functions
        return _legendre_values(2 * x - 1, len(derived)) @ derived


def _legendre_values(t: Array, count: int) -> Array:
    """P_0 .. P_{count-1} at t in [-1, 1]: [..., count]."""

    def following(pair: Pair, j: Array) -> tuple[Pair, Array]:
        before, here = pair
        return (here, ((2 * j + 1) * t * here - j * before) / (j + 1)), before

    _, values = jax.lax.scan(following, (jnp.ones_like(t), t), jnp.arange(1, count + 1))
    return jnp.moveaxis(values, 0, -1)


def _legendre_layer(u: Array, z: Array, count: int) -> Array:
    """Integrals of P_j(2x - 1) with sinh(kx)/sinh(k), j = 0 .. count-1.

    With t_j = i_{j+1}/i_j at k/2, from t_j = 1/((2j + 3) 2u + t_{j+1}), downwards: upwards it
    is unstable. For thick layers tau_j = 2 t_j/k is used, which is smooth through k = 0.
    """
    thick = z < 3.0
    zeta = jnp.where(thick, z, 0.0) / 4
    w = 2 * u  # 2/k
    start = (2 * _DEPTH + 3) / 2 * w
    first = (1 / (2 * _DEPTH + 3.0) * jnp.ones_like(zeta), jnp.sqrt(1 + start**2) - start)

    def down(ratios: Pair, j: Array) -> tuple[Pair, Pair]:
        tau, t = ratios
        ratios = 1 / (2 * j + 3 + zeta * tau), 1 / ((2 * j + 3) * w + t)
        return ratios, ratios

    _, (tau, t) = jax.lax.scan(down, first, jnp.arange(_DEPTH - 1, -1, -1))
    tau, t = tau[::-1][: count - 1], t[::-1][: count - 1]
    # rho_j = i_j/i_0 at k/2. Thick: i_j = (k/2)^j prod(tau); one factor k/2 cancels below.
    tanh_over = 1 / (1 + zeta * tau[0])  # tanh(k/2)/(k/2), since coth x - 1/x = i_1/i_0
    pairs = jnp.concatenate([jnp.ones(1), jnp.cumprod(tau)])
    powers = zeta ** (np.arange(count) // 2)
    even = np.arange(count) % 2 == 0
    of_thick = pairs * powers * jnp.where(even, tanh_over, 1.0) / 2
    # coth = t_0 + 2/k.
    of_thin = jnp.concatenate([jnp.ones(1), jnp.cumprod(t)]) * w / 2
    of_thin = of_thin * jnp.where(even, 1 / (t[0] + w), 1.0)
    return jnp.where(thick, of_thick, of_thin)
