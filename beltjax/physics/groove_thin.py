"""A belt that sinks in little: the arc in a groove by one equation for the friction's direction.

The limit of small penetration with Coulomb's friction, in the letters of `physics.groove` and

    gamma  direction of the sliding: 0 inwards, 90 degrees along the groove, forwards
    theta  angle from where the belt leaves adhesion;   m   d ln P/d theta
    u      sliding along the groove, over V_ref
    turn   angle of the arc;   layers at its ends, where the belt seats and unseats, have no width

docs/theory/grooves.md, (W14) to (W17).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.physics.groove import Flanks
from beltjax.physics.inclined_arcs import ArcEnds

Scalar = Float[Array, ""]
STEPS = 160  # along the arc that slides, of equal ratios
FIRST = 1e-3  # where they begin, in the root of ln P
LEAST = 1e-12  # of |ln(P_out/P_in)|: below it nothing slides


class ThinArc(NamedTuple):
    """The arc in a groove."""

    chi_in: Scalar
    chi_out: Scalar
    om: Scalar
    sliding: Scalar  # angle over which the belt slides
    unstretched: Scalar  # length of the belt in contact
    theta: Float[Array, " steps"]
    gamma: Float[Array, " steps"]
    xi: Float[Array, " steps"]
    P: Float[Array, " steps"]


def depth(P: Array, gamma: Array, of: Flanks) -> Array:
    """Penetration over R that carries P with friction in this direction (W14)."""
    rho = jnp.arctan(of.mu * jnp.cos(gamma))
    return P / (2 * of.K * of.R**2 * jnp.tan(of.beta + rho))


def thin_arc(of: Flanks, ends: ArcEnds) -> ThinArc:
    """The arc between given tensions; `sliding` may be more than there is (W14) to (W17)."""
    low, high, EA, mu = ends.P_in, ends.P_out, of.EA, of.mu
    ratio = jnp.log(high / low)
    side = jnp.where(ratio < 0, -1.0, 1.0)
    ratio = side * jnp.maximum(side * ratio, LEAST)
    resting = depth(low, jnp.zeros(()), of)
    k, m1 = _start(low, resting, side, of)

    def slopes(gamma: Scalar, tau: Scalar) -> tuple[Scalar, Scalar]:
        """Derivatives of gamma and theta by tau, where ln(P/P_in) = ratio tau^2."""
        P = low * jnp.exp(ratio * tau**2)
        rho, sin = jnp.arctan(mu * jnp.cos(gamma)), jnp.sin(gamma)
        m = mu * sin * jnp.cos(rho) / jnp.sin(of.beta + rho)
        xi = depth(P, gamma, of)
        u = (P - low) / EA + xi - resting
        pull = jnp.cos(of.beta) * u / (xi * jnp.tan(gamma)) - m
        turn = pull * jnp.sin(2 * (of.beta + rho)) / (2 * mu * sin * jnp.cos(rho) ** 2)
        by_tau = 2 * ratio * tau / m
        return turn * by_tau, by_tau

    def step(state: tuple[Scalar, Scalar], at: Scalar) -> tuple[tuple[Scalar, Scalar], Array]:
        gamma, theta = state
        h = -jnp.log(FIRST) / STEPS
        half, whole = jnp.exp(h / 2), jnp.exp(h)
        a, ta = (at * x for x in slopes(gamma, at))
        b, tb = (at * half * x for x in slopes(gamma + h / 2 * a, at * half))
        c, tc = (at * half * x for x in slopes(gamma + h / 2 * b, at * half))
        d, td = (at * whole * x for x in slopes(gamma + h * c, at * whole))
        after = gamma + h / 6 * (a + 2 * b + 2 * c + d), theta + h / 6 * (ta + 2 * tb + 2 * tc + td)
        return after, jnp.stack(after)

    begun = FIRST * jnp.sqrt(2 * side * ratio / (m1 * k))
    first = side * k * begun, begun
    places = FIRST ** (1 - jnp.arange(STEPS) / STEPS)
    (_, sliding), path = jax.lax.scan(step, first, places)
    gamma = jnp.concatenate([first[0][None], path[:, 0]])
    theta = jnp.concatenate([first[1][None], path[:, 1]])
    P = low * jnp.exp(ratio * jnp.append(places, 1.0) ** 2)
    xi = depth(P, gamma, of)
    last = xi[-1]
    loosening = 2 * of.K * of.R**2 * jnp.tan(of.beta - jnp.arctan(mu))
    chi_in, chi_out = -jnp.sqrt(resting), jnp.sqrt(2 * last - loosening * last**2 / high)
    stretch = (EA + P) / (EA - ends.g)
    inside = (1 - xi) / stretch
    slid = jnp.sum((inside[1:] + inside[:-1]) / 2 * jnp.diff(theta))
    first_in = (EA + low) / (EA - ends.g)
    adheres = (ends.turn + chi_out - chi_in - sliding) * (1 - resting) / first_in
    return ThinArc(
        chi_in=chi_in,
        chi_out=chi_out,
        om=first_in * (1 + resting),
        sliding=sliding,
        unstretched=of.R * (slid + adheres),
        theta=theta,
        gamma=gamma,
        xi=xi,
        P=P,
    )


def _start(P: Scalar, resting: Scalar, side: Scalar, of: Flanks) -> tuple[Scalar, Scalar]:
    """gamma/theta, without sign, where the belt leaves adhesion, and m/gamma (W16)."""
    rho = jnp.arctan(of.mu)
    m1 = of.mu * jnp.cos(rho) / jnp.sin(of.beta + rho)
    c1 = 2 * of.mu * jnp.cos(rho) ** 2 / jnp.sin(2 * (of.beta + rho))
    e, cos = P / of.EA, jnp.cos(of.beta)
    a, half = 2 * cos / (resting * c1), side * (2 * m1 / c1 + cos) / 2
    b = (half + jnp.sqrt(half**2 + a * e * m1)) / a
    return (cos * b / resting - side * m1) / c1, m1


def thin_power_loss(M: Scalar, om: Scalar, of: Flanks, ends: ArcEnds) -> Scalar:
    """Power of sliding over V_ref that the balance of energy leaves (W17)."""
    EA, low, high = of.EA, ends.P_in, ends.P_out
    work = (EA * (high - low) + (high**2 - low**2) / 2) / (EA - ends.g)
    return work - om / of.R * M
