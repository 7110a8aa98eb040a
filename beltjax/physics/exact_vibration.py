"""Vibration of a whole drive without discretization: docs/theory/vibration.md, (V11) to (V14).

The rows of the bodies are docs/theory/bodies.md, (M15). At a given frequency omega each span of
the linearized drive has a closed form, because all that forces it is its stretch, acting on w*'',
which is a sum of two exponentials:

    B w'''' - Q w'' - 2 i c omega w' - m omega^2 w = gamma delta w*'',
    B = (eps/lam)^2,  c = -tau s lam,  m = lam^2

    w = sum of the four waves of `waves` + gamma delta (alpha A e^{-kx} + beta A' e^{-k(1-x)})

for a motion w e^{i omega t} whose elongation has the amplitude delta. With the spans solved, the
amplitudes delta of the spans, theta of the rotors and q of the bodies obey D(omega) z = 0 with
D Hermitian. D has poles at the frequencies of the spans held at their ends; D's determinant
times the spans' own characteristic functions has none, and vanishes at each frequency of the
drive. The negative pivots of D and the held spans' frequencies count the frequencies below omega
(Wittrick and Williams, 1971).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float, Int

from beltjax.physics.vibration import VibrationModel
from beltjax.physics.waves import wave_numbers

Scalar = Float[Array, ""]
Spans = Float[Array, " spans"]
ComplexSpans = Complex[Array, " spans"]
PerSpan = Complex[Array, "spans columns"]

_TINY = 1e-150  # whose inverse has a square that is finite
_LEAST_STIFFNESS = 1e-30  # below it a span is a string to rounding


class SpanWaves(NamedTuple):
    """A span's waves and layers at one frequency; a trailing axis of 4 runs over the waves."""

    r: Complex[Array, "spans 4"]
    start: Complex[Array, "spans 4"]  # the waves at x = 0
    end: Complex[Array, "spans 4"]
    bend: Complex[Array, "spans 4"]  # -(r/k)^2: second derivative over k^2
    k: Spans
    A: Spans  # w*'' = A e^{-kx} + A_end e^{-k(1-x)}
    A_end: Spans
    alpha: ComplexSpans
    beta: ComplexSpans


class SpanResponse(NamedTuple):
    """Closed-form response of each span to w(0) = 1, w(1) = 1 and delta = 1, along axes of 3."""

    waves: SpanWaves
    amplitudes: Complex[Array, "spans 4 3"]  # of the four waves
    forces: Complex[Array, "spans 3 3"]  # Hermitian: on w(0), on w(1), on delta
    held: Spans  # vanishes at the frequencies of the span with both ends held
    below: Int[Array, " spans"]  # how many of those lie below omega


class Characteristic(NamedTuple):
    """The exact eigenvalue problem at one frequency."""

    value: Scalar  # real, without poles, zero at each frequency of the drive
    below: Int[Array, ""]  # number of frequencies of the drive below omega


def _span_waves(m: VibrationModel, omega: Scalar) -> SpanWaves:
    B, c = _operator(m)
    inertia = m.mu * m.lam**2
    r1, r2, r3, r4 = wave_numbers(B, m.Q, c, inertia, omega)
    r = jnp.stack([r1 + 0j, r2 + 0j, r3, r4], axis=-1)
    k = jnp.sqrt(m.Q / B)
    E = jnp.exp(-k)
    shrink = -jnp.expm1(-2 * k)
    one = jnp.ones_like(r3)
    phase = jnp.exp(1j * r[:, :3])
    # The fourth wave is written from x = 1, so that no exponential grows.
    back = jnp.exp(-1j * r[:, 3])
    away = 2j * c * omega * k
    return SpanWaves(
        r=r,
        start=jnp.stack([one, one, one, back], axis=-1),
        end=jnp.concatenate([phase, one[:, None]], axis=-1),
        bend=-((r / k[:, None]) ** 2),
        k=k,
        A=(m.kap_s - m.kap_e * E) / shrink,
        A_end=(m.kap_e - m.kap_s * E) / shrink,
        alpha=1 / (away - inertia * omega**2),
        beta=1 / (-away - inertia * omega**2),
    )


def _operator(m: VibrationModel) -> tuple[Spans, Spans]:
    """B and c of the spans."""
    return jnp.maximum((m.eps / m.lam) ** 2, _LEAST_STIFFNESS), -m.tau * m.s * m.mu * m.lam


def span_response(m: VibrationModel, omega: Scalar) -> SpanResponse:
    """The spans in closed form at frequency `omega` > 0, for Q > 0."""
    of = _span_waves(m, omega)
    _, c = _operator(m)
    E = jnp.exp(-of.k)
    near, far = of.A * of.alpha, of.A_end * of.beta
    # The particular solution at both ends, and its second derivative over k^2.
    forced = m.gam[:, None] * jnp.stack([near + far * E, near * E + far], -1)
    amplitudes, determinant = _amplitudes(of, forced)

    # Transverse force Q w' - B w''' + i c omega w of each wave, by the dispersion relation.
    inertia = (m.mu * m.lam**2)[:, None]
    force = 1j * (inertia * omega**2 / of.r - (c * omega)[:, None])
    slope = _steady_slopes(m, of)
    # int w*' w' = [w*' w] - int w*'' w
    of_waves = jnp.stack([force * of.start, force * of.end, _layer_moments(of, E)], axis=1)
    # Sums of products here and below: XLA makes slow calls of small batched matrix products.
    by_waves = jnp.sum(of_waves[:, :, :, None] * amplitudes[:, None, :, :], axis=2)
    push, pull, moment = (by_waves[:, j] for j in range(3))
    on_delta = jnp.array([0.0, 0.0, 1.0])
    extra = 1j * (c * omega)[:, None] * forced + m.gam[:, None] * slope
    push = push + extra[:, :1] * on_delta
    pull = pull + extra[:, 1:] * on_delta
    same = (of.A**2 * of.alpha + of.A_end**2 * of.beta) * -jnp.expm1(-2 * of.k) / (2 * of.k)
    cross = of.A * of.A_end * (of.alpha + of.beta) * E
    moment = moment + (m.gam * (same + cross))[:, None] * on_delta
    ends = jnp.stack([-slope[:, 0], slope[:, 1], jnp.zeros_like(of.k)], axis=-1)
    stretch = m.gam[:, None] * (ends - moment - on_delta)
    held, below = _held_span(of, determinant)
    return SpanResponse(of, amplitudes, jnp.stack([-push, pull, stretch], axis=1), held, below)


def _amplitudes(
    of: SpanWaves, forced: Complex[Array, "spans 2"]
) -> tuple[Complex[Array, "spans 4 3"], ComplexSpans]:
    """Amplitudes of the waves by the end conditions, and the determinant of these conditions.

    The two waves that stay at the ends are eliminated by the moments there, which they carry;
    two equations for the two that travel remain.
    """
    near, far = of.end[:, 2], of.start[:, 3]  # each layer's value at its far end
    shared = 1 - near * far
    give = of.bend[:, :2] * of.start[:, :2], of.bend[:, :2] * of.end[:, :2]

    def layers(h0: PerSpan, h1: PerSpan) -> tuple[PerSpan, PerSpan]:
        """Amplitudes of the layers' moments for given moments at x = 0 and 1."""
        at_start, at_end = h0 - far[:, None] * h1, h1 - near[:, None] * h0
        return at_start / shared[:, None], at_end / shared[:, None]

    def displaced(at_start: PerSpan, at_end: PerSpan) -> tuple[PerSpan, PerSpan]:
        """Displacements at x = 0 and 1 by layers whose moments have these amplitudes."""
        a, b = at_start / of.bend[:, 2:3], at_end / of.bend[:, 3:4]
        return a + far[:, None] * b, near[:, None] * a + b

    by_waves = layers(-give[0], -give[1])
    d0, d1 = displaced(*by_waves)
    row0, row1 = of.start[:, :2] + d0, of.end[:, :2] + d1  # [spans 2]
    # Right sides: columns for w(0) = 1, w(1) = 1, delta = 1.
    zero = jnp.zeros_like(forced[:, 0])
    h0, h1 = jnp.stack([zero, zero, -forced[:, 0]], -1), jnp.stack([zero, zero, -forced[:, 1]], -1)
    by_delta = layers(h0, h1)
    e0, e1 = displaced(*by_delta)
    rhs0 = jnp.array([1.0, 0.0, 0.0]) + h0 - e0
    rhs1 = jnp.array([0.0, 1.0, 0.0]) + h1 - e1
    determinant = row0[:, 0] * row1[:, 1] - row0[:, 1] * row1[:, 0]
    over = jnp.where(determinant == 0, 1e-300, determinant)[:, None]
    c1 = rhs0 * row1[:, 1:] - rhs1 * row0[:, 1:]
    c2 = rhs1 * row0[:, :1] - rhs0 * row1[:, :1]
    c3 = by_waves[0][:, :1] * c1 + by_waves[0][:, 1:] * c2 + by_delta[0] * over
    c4 = by_waves[1][:, :1] * c1 + by_waves[1][:, 1:] * c2 + by_delta[1] * over
    # The only division comes last: XLA keeps its result, and does not recompute the amplitudes at
    # each use.
    one = jnp.ones_like(shared)
    below = over * jnp.stack([one, one, of.bend[:, 2], of.bend[:, 3]], axis=1)
    return jnp.stack([c1, c2, c3, c4], axis=1) / below[:, :, None], determinant


def _steady_slopes(m: VibrationModel, of: SpanWaves) -> Float[Array, "spans 2"]:
    """w*' at both ends."""
    E = jnp.exp(-of.k)
    middle = m.drop - (m.kap_e - m.kap_s) / of.k**2
    start = middle + (of.A_end * E - of.A) / of.k
    end = middle + (of.A_end - of.A * E) / of.k
    return jnp.stack([start, end], axis=-1)


def _layer_moments(of: SpanWaves, E: Spans) -> Complex[Array, "spans 4"]:
    """Integral of w*'' with each wave."""
    k, ir = of.k[:, None], 1j * of.r
    forward = _mean_exponential(ir - k)  # of e^{(ir - k) x}, for waves written from x = 0
    backward = _mean_exponential(-(ir + k))  # of e^{-(ir + k)(1 - x)}, from x = 1
    with_start = forward.at[:, 3].multiply(of.start[:, 3])
    # The third wave and the layer at x = 1 have nearly the same exponent.
    near = E * _mean_exponential(ir[:, 2] + of.k)
    with_end = jnp.stack(
        [of.end[:, 0] * backward[:, 0], of.end[:, 1] * backward[:, 1], near, backward[:, 3]],
        axis=-1,
    )
    return of.A[:, None] * with_start + of.A_end[:, None] * with_end


def _mean_exponential(a: Array) -> Array:
    """(e^a - 1)/a, for Re a not large and positive."""
    small = jnp.abs(a) < 1e-2
    safe = jnp.where(small, 1.0, a)
    series = 1 + a / 2 * (1 + a / 3 * (1 + a / 4 * (1 + a / 5 * (1 + a / 6))))
    return jnp.where(small, series, (jnp.exp(safe) - 1) / safe)


def _held_span(of: SpanWaves, determinant: ComplexSpans) -> tuple[Spans, Int[Array, " spans"]]:
    """Characteristic function of each span with both ends held, and its zeros below omega.

    The closure of the phase, in which the ends' layers do not feel each other, counts up to
    the last zero; the sign of the function itself, (-1)^count, decides that one.
    """
    r1, r2 = of.r[:, 0].real, of.r[:, 1].real
    held = -(determinant * jnp.exp(-0.5j * (r1 + r2))).imag
    q1, q2, q3, q4 = (of.bend[:, j] for j in range(4))
    lag = jnp.angle((1 - q1 / q3) * (1 - q2 / q4))
    half_turns = ((r1 - r2) / 2 - lag) / jnp.pi
    nearest = jnp.round(half_turns).astype(int)
    sign = jnp.where(nearest % 2 == 0, 1.0, -1.0)
    return held, jnp.maximum(jnp.where(held * sign > 0, nearest, nearest - 1), 0)


def dynamic_stiffness(
    m: VibrationModel, kept: Int[Array, " kept"], omega: Scalar, of: SpanResponse
) -> tuple[Float[Array, " spans"], Complex[Array, "spans turns"], Complex[Array, "turns turns"]]:
    """The three blocks of D(omega): delta (diagonal), its coupling with the rest, and the rest.

    The rest are the rotations of the rotors `kept`, then the coordinates. A coordinate that does
    not move has the row and the column of the unit matrix. delta is measured in
    1/sqrt(lam gamma), so that its block is near -1 but for its poles.
    """
    scale = jnp.sqrt(m.lam * m.gam)
    on_delta = (m.lam * of.forces[:, 2, 2]).real / scale**2
    by_turns = (scale[:, None] * m.turns[:, kept]).astype(complex)
    rotors = (m.K_r - omega**2 * m.M_r)[kept][:, kept].astype(complex)
    lift = jnp.stack([m.W0, m.W0 + m.a], axis=1)  # [spans, ends, coordinates]
    to_bodies = jnp.sum(of.forces[:, 2, :2, None] * lift, axis=1)
    to_bodies = (m.lam / scale)[:, None] * to_bodies + scale[:, None] * m.pull
    lifted = of.forces[:, :2, :2, None, None] * lift[:, :, None, :, None] * lift[:, None, :, None]
    lifted = jnp.sum(m.lam[:, None, None] * jnp.sum(lifted, axis=(1, 2)), axis=0)
    springs = m.K - omega**2 * m.M + jnp.sum(m.Q[:, None, None] * m.H, axis=0)
    bodies = m.movable[:, None] * m.movable * (springs + lifted) + jnp.diag(1.0 - m.movable)
    coupling = jnp.concatenate([by_turns, to_bodies * m.movable], axis=1)
    apart = jnp.zeros((len(kept), len(m.movable)))
    return on_delta, coupling, jnp.block([[rotors, apart], [apart.T, bodies]])


def characteristic(m: VibrationModel, kept: Int[Array, " kept"], omega: Scalar) -> Characteristic:
    """Characteristic function of the drive at `omega` > 0, and how many frequencies lie below."""
    of = span_response(m, omega)
    on_delta, coupling, own = dynamic_stiffness(m, kept, omega, of)
    pivots = _not_zero(on_delta, -_TINY)
    products = jnp.conj(coupling)[:, :, None] * coupling[:, None, :]
    rest = own - jnp.sum(products / pivots[:, None, None], axis=0)
    later = _pivots(rest)
    value = jnp.prod(pivots) * jnp.prod(later) * jnp.prod(of.held)
    # Each span's delta is a multiplier, whose negative pivot does not count.
    negative = jnp.sum(pivots < 0) + jnp.sum(later < 0) - len(m.lam)
    return Characteristic(value, negative + jnp.sum(of.below))


def _not_zero(pivot: Array, tiny: float) -> Array:
    """`pivot`, or `tiny` where it is 0; the derivative, which a root needs there, is kept."""
    return pivot + jnp.where(pivot == 0, tiny, 0.0)


def _pivots(matrix: Complex[Array, "n n"]) -> Float[Array, " n"]:
    """Pivots of Gaussian elimination of a Hermitian matrix; their signs give its inertia."""

    def eliminate(
        left: Complex[Array, "n n"], j: Int[Array, ""]
    ) -> tuple[Complex[Array, "n n"], Scalar]:
        pivot = _not_zero(left[j, j].real, _TINY)
        return left - jnp.outer(left[:, j], left[j, :]) / pivot, pivot

    _, pivots = jax.lax.scan(eliminate, matrix, jnp.arange(len(matrix)))
    return pivots


def spans_in_motion(
    m: VibrationModel,
    found: SpanResponse,
    delta: ComplexSpans,
    q: Complex[Array, " coordinates"],
    x: Float[Array, " points"],
) -> Complex[Array, "spans points"]:
    """Deflections w of the spans at x for elongations `delta` and the bodies' coordinates `q`.

    `delta` is measured as in `dynamic_stiffness`.
    """
    of = found.waves
    delta = delta / jnp.sqrt(m.lam * m.gam)
    given = jnp.stack([m.W0 @ q, (m.W0 + m.a) @ q, delta], axis=-1)
    amplitudes = jnp.einsum("sjc,sc->sj", found.amplitudes, given)
    r, k = of.r[:, :, None], of.k[:, None]
    # The fourth wave is written from x = 1.
    fields = jnp.exp(1j * r * jnp.where(jnp.arange(4)[None, :, None] == 3, x - 1, x))
    near, far = (of.A * of.alpha)[:, None], (of.A_end * of.beta)[:, None]
    layers = near * jnp.exp(-k * x) + far * jnp.exp(-k * (1 - x))
    return jnp.einsum("sj,sjx->sx", amplitudes, fields) + (m.gam * delta)[:, None] * layers
