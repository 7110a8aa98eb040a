"""A string on an elastic layer around its pulley: thin layers in closed form.

The cords give way by x towards the axis against k_r x and lag by zeta against k_s zeta, per unit
length, while the layer's foot sticks to the pulley. Along one arc, in the direction of travel and
in any consistent units:

    P       T - G V;   g   G V_ref, the momentum flux;   chi   angle of the cord to the circle
    lam     1/lam is the length of the radial layers at the ends, 1/a that of the shear
    om      omega R/V_ref;   moment   that the pulley takes, R (P_out cos chi_out - P_in cos chi_in)

Effects are of order sqrt(P/k_r)/R on wraps and lengths; what is left out here is of its square, and
of the ratio a/lam in the shear. docs/theory/cushion.md, (U3) to (U7).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.numerics.roots import bracketed_root, implicit_root
from beltjax.physics.inclined_arcs import ArcEnds, on_rim

Scalar = Float[Array, ""]

_STEPS = 8  # of Newton's method for the contact length, which is convex in it


class Layer(NamedTuple):
    """One pulley, its layer, and the belt."""

    R: Scalar
    k_r: Scalar
    k_s: Scalar
    mu: Scalar
    soft: Scalar  # 1 with a cushion, 0 for cords that lie on the pulley itself
    sticks: Scalar  # 1 where no friction is given, so that nothing slides
    EA: Scalar
    blur: Scalar  # length over R in which sliding cords give up shear that friction cannot hold


class Met(NamedTuple):
    """How the belt lies on one pulley."""

    chi_in: Scalar  # negative
    chi_out: Scalar
    length: Scalar  # of the cords in contact
    unstretched: Scalar
    om: Scalar
    zeta_out: Scalar  # shear that is carried out, before the last layer unloads it
    sliding: Scalar  # arc over which the cords slide [rad]
    deepest: Scalar  # largest x


class Shear(NamedTuple):
    """P = low + first e^{-a s} + last e^{-a (end - s)}, up to where the cords slide."""

    low: Scalar  # P*
    first: Scalar
    last: Scalar
    a: Scalar
    end: Scalar  # s_c

    def at(self, s: Array, k_s: Scalar) -> tuple[Array, Array]:
        """P and the shear zeta at s."""
        s = jnp.minimum(s, self.end)
        first, last = (
            self.first * jnp.exp(-self.a * s),
            self.last * jnp.exp(self.a * (s - self.end)),
        )
        return self.low + first + last, self.a / k_s * (last - first)


def decay(P: Scalar, of: Layer) -> Scalar:
    """The lam of (U3); real while the layer bears the belt, P < k_r R^2."""
    square = of.k_r / P - 1 / of.R**2
    return jnp.sqrt(jnp.maximum(square, 1e-3 / of.R**2))


def bears(P: Scalar, of: Layer) -> Array:
    """Whether the layer is stiff enough for the belt's pull not to sink through it."""
    return (of.soft == 0) | (of.k_r / P > 2 / of.R**2)


def strained(P: Array, EA: Scalar, g: Scalar) -> Array:
    """1 + T/EA."""
    return (EA + P) / (EA - g)


def contact_length(pull: ArcEnds, of: Layer) -> tuple[Scalar, Scalar, Scalar]:
    """Length of the cords in contact, and the sizes of the angles at its ends (U3)."""
    lam_in, lam_out = decay(pull.P_in, of), decay(pull.P_out, of)
    mean = (pull.P_in + pull.P_out) / 2
    arc = (of.R - 1 / (of.R * decay(mean, of) ** 2)) * jnp.maximum(pull.turn, 0.0)

    def ends(S: Scalar) -> tuple[Scalar, Scalar]:
        return jnp.tanh(lam_in * S / 2) / lam_in, jnp.tanh(lam_out * S / 2) / lam_out

    S = arc + 1 / lam_in + 1 / lam_out
    for _ in range(_STEPS):
        first, last = ends(S)
        slope = ((lam_in * first) ** 2 + (lam_out * last) ** 2) / 2
        S = S - (S - arc - first - last) / jnp.maximum(slope, 1e-9)
    first, last = ends(S)
    return arc + first + last, first / of.R, last / of.R


def shear(pull: ArcEnds, of: Layer, S: Scalar) -> tuple[Shear, Scalar, Array]:
    """Tension along the arc, the shear that is carried out, and gross slip (U5), (U6).

    The first layer leaves the cords behind by 5/4 chi^2/lam, the last one does so again.
    """
    lam_in, lam_out = decay(pull.P_in, of), decay(pull.P_out, of)
    # The cords' give turns more slowly the more they are pulled, as a softer belt would.
    creep = 1 / of.EA + 1 / (of.k_r * of.R**2)
    a = jnp.sqrt(of.k_s * creep)
    behind = [1.25 / (of.R**2 * lam**3) for lam in (lam_in, lam_out)]
    way = jnp.where(pull.P_out < pull.P_in, -1.0, 1.0)
    adhering = _Adhering(pull, of, S, behind[0], a, way)
    found = _sliding_from(adhering)
    end = jnp.where(found.slides, found.begin, S)
    top = jnp.where(found.slides, _capstan(end, pull, of, S), pull.P_out)
    along = adhering.up_to(end, top)
    _, lag = along.at(end, of.k_s)
    return along, lag - jnp.where(found.slides, 0.0, behind[1]), found.wholly


class _Sliding(NamedTuple):
    slides: Array
    begin: Scalar
    wholly: Array  # whether friction cannot hold the tensions apart, wherever sliding begins


class _Adhering(NamedTuple):
    """Where the cords adhere, in terms of where they cease to."""

    pull: ArcEnds
    of: Layer
    S: Scalar
    behind: Scalar  # shear that the first layer leaves
    a: Scalar
    way: Scalar  # of the change of tension

    def up_to(self, end: Scalar, to: Scalar) -> Shear:
        """The tension that is P_in at the entry and `to` at the end."""
        decayed = jnp.exp(-self.a * end)
        left = -jnp.expm1(-self.a * end)
        begun = -self.behind * self.of.k_s / self.a
        last = ((to - self.pull.P_in) / left - begun) / left
        first = last * decayed - begun
        return Shear(self.pull.P_in - first - last * decayed, first, last, self.a, end)

    def excess(self, s: Scalar) -> Scalar:
        """Shear stress at s over what friction holds, if the cords slide from there on."""
        to = _capstan(s, self.pull, self.of, self.S)
        _, lag = self.up_to(s, to).at(s, self.of.k_s)
        return (self.way * self.of.k_s * lag - self.of.mu * to / self.of.R) / to


def _capstan(s: Array, pull: ArcEnds, of: Layer, S: Scalar) -> Array:
    """Tension of cords that slide from s on."""
    way = jnp.where(pull.P_out < pull.P_in, -1.0, 1.0)
    return pull.P_out * jnp.exp(-way * of.mu * jnp.maximum(S - s, 0.0) / of.R)


def _sliding_from(adhering: _Adhering) -> _Sliding:
    """Whether the cords slide at the end of the arc, and from where."""
    held = jax.lax.stop_gradient(adhering)
    slides = (held.of.sticks == 0) & (held.excess(held.S) > 0)
    least = jnp.minimum(1e-3 / held.a, 1e-3 * held.S)
    found = bracketed_root(held.excess, least, held.S)
    begin = jnp.where(slides, found.root, held.S)
    rooted = implicit_root(lambda s, of: of.excess(s), adhering, begin)
    wholly = slides & (held.excess(least) > 0)
    return _Sliding(slides, jnp.where(slides, rooted, adhering.S), wholly)


def tension(s: Array, pull: ArcEnds, of: Layer, along: Shear, S: Scalar) -> Array:
    """P at s [...] of the arc."""
    return jnp.where(s < along.end, along.at(s, of.k_s)[0], _capstan(s, pull, of, S))


def _adhering_length(along: Shear, of: Layer, g: Scalar) -> Scalar:
    """Unstretched length of the cords that adhere, to the third order of their tension over EA."""
    full = of.EA + along.low
    first, last = along.first / full, along.last / full
    a, end = along.a, along.end
    left = -jnp.expm1(-a * end)
    once = (first + last) * left / a
    both = 2 * first * last * jnp.exp(-a * end) * end
    twice = -(first**2 + last**2) * jnp.expm1(-2 * a * end) / (2 * a) + both
    return (of.EA - g) / full * (end - once + twice)


def _sliding_length(along: Shear, pull: ArcEnds, of: Layer, S: Scalar) -> Scalar:
    """Unstretched length of the cords that slide."""
    start = _capstan(along.end, pull, of, S)
    change = jnp.log(pull.P_out / start)
    creep = jnp.log((of.EA + pull.P_out) / (of.EA + start))
    way = jnp.where(pull.P_out < pull.P_in, -1.0, 1.0)
    return way * of.R / of.mu * (of.EA - pull.g) / of.EA * (change - creep)


def on_cushion(pull: ArcEnds, of: Layer) -> Met:
    """The belt on a pulley with a cushion, by thin layers."""
    S, first, last = contact_length(pull, of)
    along, left, wholly = shear(pull, of, S)
    unstretched = _adhering_length(along, of, pull.g) + _sliding_length(along, pull, of, S)
    om = strained(along.low, of.EA, pull.g) * (1 + along.low / (of.k_r * of.R**2))
    most = jnp.maximum(pull.P_in, pull.P_out)
    depth = 1 / (of.R * decay(most, of) ** 2) * (1 - 1 / jnp.cosh(decay(most, of) * S / 2))
    # Sliding all over is told by an angle that no belt touches.
    sliding = jnp.where(wholly, 2 * jnp.pi + pull.turn, (S - along.end) / of.R)
    return Met(-first, last, S, unstretched, om, left, sliding, depth)


def profile(pull: ArcEnds, of: Layer, share: Array) -> tuple[Array, Array, Array, Array]:
    """Give x, angle chi, P and shear zeta at shares [...] of the contact length (U4)."""
    S, first, last = contact_length(pull, of)
    along, _, _ = shear(pull, of, S)
    s = S * share
    lam_in, lam_out = decay(pull.P_in, of), decay(pull.P_out, of)
    P = tension(s, pull, of, along, S)
    start, end = jnp.exp(-lam_in * s), jnp.exp(-lam_out * (S - s))
    whole = 1 + jnp.exp(-(lam_in + lam_out) * S / 2)
    x = (1 - (start + end) / whole) / (of.R * decay(P, of) ** 2)
    _, adhering = along.at(s, of.k_s)
    # The shear begins at nothing; the first layer brings it to what the formula starts from.
    adhering = adhering - start * along.at(jnp.zeros_like(s), of.k_s)[1]
    way = jnp.where(pull.P_out < pull.P_in, -1.0, 1.0)
    zeta = jnp.where(s < along.end, adhering, way * of.mu * P / (of.k_s * of.R))
    return x, last * end - first * start, P, zeta


def met_rim(pull: ArcEnds, of: Layer) -> Met:
    """A string on the pulley itself."""
    rim, none = on_rim(pull, of.R, of.mu, of.EA), jnp.zeros_like(pull.turn)
    return Met(none, none, of.R * pull.turn, rim.unstretched, rim.om, none, rim.slip, none)


def lent(pull: ArcEnds, of: Layer) -> Layer:
    """`of`, whose pulley without a cushion lends the formulas of one a harmless layer."""
    return of._replace(
        k_r=jnp.where(of.soft > 0, of.k_r, 1e3 * pull.P_in / of.R**2),
        k_s=jnp.where(of.soft > 0, of.k_s, 1e2 * of.EA / of.R**2),
    )


def met_thin(pull: ArcEnds, of: Layer) -> Met:
    """The belt on any pulley, by thin layers."""
    soft, bare = on_cushion(pull, lent(pull, of)), met_rim(pull, of)
    return jax.tree.map(lambda a, b: jnp.where(of.soft > 0, a, b), soft, bare)


def end_curvature(P: Array, EI: Scalar, k_r: Scalar) -> Array:
    """Curvature of a stiff belt where it meets the cushion, over the pulley's (U8).

    On a hard pulley it is 1. A cushion takes the belt up before and after the point of contact, so
    that its curvature grows over a length there.
    """
    root = jnp.sqrt(k_r * jnp.where(EI > 0, EI, 1.0))
    found = root / (root + jnp.sqrt(P * (P + 2 * root)) + P)
    return jnp.where(EI > 0, found, 0.0)
