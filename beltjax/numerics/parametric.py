"""Parametric resonance of M z'' + (G + C) z' + K(t) z = 0 by its modes, where K(t) and G(t) vary.

    om, v  frequencies and shapes of M, G and K, scaled to v* (2 om M - i G) v = 1
    dec    decay rates om v* C v
    a      amplitudes: z = sum a v + conj, so that a' = i om a + i v* F for M z'' + G z' + K z = -F
    sigma  frequencies +om and -om of the signed modes v and conj(v)
    b      coupling of a pair of modes; Lam = b_rs conj(b_sr)

docs/theory/parametric.md, (P7) to (P11). One harmonic: K(t) = K + Re(K^ e^{i Om t}), and so G(t).
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int

from beltjax.numerics.derivative_rules import frozen_unless, without_derivative
from beltjax.numerics.floquet import exponential, log_spectral_radius
from beltjax.numerics.gyroscopic import Eigen, Matrix, eigenvalues, forms
from beltjax.numerics.roots import first_upcrossing, implicit_root

Scalar = Float[Array, ""]
Pairs = Float[Array, " pairs"]


class ModalBasis(NamedTuple):
    """Modes of a gyroscopic system without damping, and how it is damped."""

    frequencies: Float[Array, " modes"]
    shapes: Complex[Array, "modes size"]  # v
    decays: Float[Array, " modes"]


class Modulation(NamedTuple):
    """What a harmonic of K(t) and G(t) does to the signed modes: first v, then conj(v)."""

    raising: Complex[Array, "signed signed"]  # by e^{i Om t}
    lowering: Complex[Array, "signed signed"]  # by e^{-i Om t}


def modal_basis(M: Matrix, G: Matrix, K: Matrix, C: Matrix, found: Eigen, count: int) -> ModalBasis:
    """The `count` lowest of all modes, which `hermitian_modes` found, with their derivatives."""
    low = found._replace(
        values=found.values[:count], vectors=found.vectors[:count], left=found.left[:count]
    )
    frequencies = eigenvalues(low.values, forms(M, G, K, low.left, low.vectors)).imag
    # Their energy om^2 v*Mv + v*Kv is 1, which is om v* (2 om M - i G) v.
    every = found.values.imag
    shapes = _lowest_shapes(M, G, K, every, found.vectors * jnp.sqrt(every)[:, None], count)
    decays = frequencies * jnp.sum(shapes.conj() * (shapes @ C), axis=1).real
    return ModalBasis(frequencies, shapes, decays)


_CLOSE = 1e-9  # relative gap of frequencies below which modes do not move each other


@functools.partial(jax.custom_jvp, nondiff_argnums=(5,))
def _lowest_shapes(
    M: Matrix, G: Matrix, K: Matrix, om: Array, shapes: Array, count: int
) -> Complex[Array, "count size"]:
    """Some of all scaled shapes, with derivatives by sums over all modes; their phases are free.

    No linear system is solved, which in a batch would wait for that of another part.
    """
    return shapes[:count]


@_lowest_shapes.defjvp
def _lowest_shapes_jvp(
    count: int, primals: tuple[Any, ...], tangents: tuple[Any, ...]
) -> tuple[Any, Any]:
    M, G, _, om, shapes = without_derivative(primals)
    dM, dG, dK = tangents[:3]
    v, own = shapes[:count], om[:count, None]
    every, sigma = jnp.concatenate([shapes, shapes.conj()]), jnp.concatenate([om, -om])
    sign = jnp.concatenate([jnp.ones_like(om), -jnp.ones_like(om)])
    force = -(own**2) * (v @ dM.T) + 1j * own * (v @ dG.T) + v @ dK.T
    part = force @ every.conj().T
    gap = own - sigma
    apart = jnp.abs(gap) > _CLOSE * own
    moved = jnp.where(apart, sign * part / jnp.where(apart, gap, 1.0), 0.0) @ every
    shift = jnp.sum(v.conj() * force, axis=1).real[:, None]  # of the frequencies
    scaled = 2 * shift * (v @ M.T) + 2 * own * (v @ dM.T) - 1j * (v @ dG.T)
    across = 2 * own * (moved @ M.T) - 1j * (moved @ G.T)
    change = jnp.sum(v.conj() * scaled, axis=1).real / 2
    change = change + jnp.sum(v.conj() * across, axis=1).real
    return v, moved - change[:, None] * v


def modulation(
    basis: ModalBasis, K: Complex[Array, "size size"], G: Complex[Array, "size size"]
) -> Modulation:
    """The couplings of the signed modes by a harmonic with these complex amplitudes."""
    v, om = basis.shapes, basis.frequencies
    shapes = jnp.concatenate([v, v.conj()])
    sigma = jnp.concatenate([om, -om])
    sign = jnp.concatenate([jnp.ones_like(om), -jnp.ones_like(om)])[:, None]

    def coupling(K: Array, G: Array) -> Array:
        acting = shapes @ K.T + 1j * sigma[:, None] * (shapes @ G.T)
        return 1j * sign * (shapes.conj() @ acting.T) / 2

    return Modulation(coupling(K, G), coupling(K.conj(), G.conj()))


class ModalTransfer(NamedTuple):
    """Amplitudes of modes as real states xi = (Re a, Im a), and the coordinates that they make."""

    turn: Float[Array, "states states"]  # xi' of the modes alone
    onto: Float[Array, "states size"]  # xi' by forces that stand on the left of the equations
    of: Float[Array, "size states"]  # coordinates
    rates: Float[Array, "size states"]


def modal_transfer(basis: ModalBasis) -> ModalTransfer:
    """(P13) of the lowest modes, which is exact for all of them."""
    v, om = basis.shapes, basis.frequencies
    turn, none = jnp.diag(om), jnp.zeros((len(om),) * 2)
    return ModalTransfer(
        turn=jnp.block([[none, -turn], [turn, none]]),
        onto=jnp.concatenate([v.imag, v.real]),
        of=2 * jnp.concatenate([v.real, -v.imag]).T,
        rates=2 * jnp.concatenate([-om[:, None] * v.imag, -om[:, None] * v.real]).T,
    )


def modal_generator(
    basis: ModalBasis, C: Matrix, K: Complex[Array, "size size"], G: Complex[Array, "size size"]
) -> tuple[Float[Array, "states states"], Float[Array, "2 states states"]]:
    """The matrix of xi' without a harmonic of K(t) and G(t), and what its cosine and sine add."""
    to = modal_transfer(basis)

    def acting(K: Array, G: Array) -> Array:
        return to.onto @ (K @ to.of + G @ to.rates)

    still = to.turn + to.onto @ C @ to.rates
    return still, jnp.stack([acting(K.real, G.real), -acting(K.imag, G.imag)])


def pairs_of(count: int) -> Int[np.ndarray, "pairs 2"]:
    """The pairs (r, s), r <= s, of so many modes."""
    return np.stack(np.triu_indices(count), axis=1)


class PairTerms(NamedTuple):
    """What a pair of modes is to a harmonic: its sum resonance Om = om_r + om_s + detuning."""

    product: Pairs  # Lam
    decay_r: Pairs
    decay_s: Pairs
    detuning: Pairs


def pair_terms(
    basis: ModalBasis,
    of: Modulation,
    frequency: Scalar,
    pairs: Int[np.ndarray | Array, "pairs 2"],
) -> PairTerms:
    """(P7) of each pair at one frequency of the harmonic."""
    (r, s), om, dec = pairs.T, basis.frequencies, basis.decays
    count = len(om)
    b_rs, b_sr = of.raising[r, count + s], of.raising[s, count + r]
    product = (b_rs * b_sr.conj()).real
    return PairTerms(product, dec[r], dec[s], frequency - om[r] - om[s])


def pair_growth(of: PairTerms) -> Pairs:
    """The larger growth rate of each pair (P8)."""
    total, apart = of.decay_r + of.decay_s, of.decay_r - of.decay_s
    square = (apart + 1j * of.detuning) ** 2 + 4 * of.product
    there = jnp.abs(square) > 0
    root = jnp.where(there, jnp.sqrt(jnp.where(there, square, 1.0)), 0.0)
    return (root.real - total) / 2


def critical_square(of: PairTerms) -> Pairs:
    """Square of the factor of amplitude at which each pair becomes unstable (P9); inf: never."""
    total = of.decay_r + of.decay_s
    damped = total > 0
    part = of.decay_r * of.decay_s / jnp.where(damped, total, 1.0) ** 2
    # Of two modes without damping that of vanishing, equal damping.
    part = jnp.where(damped, part, 0.25)
    needed = of.decay_r * of.decay_s + part * of.detuning**2
    coupled = of.product > 0
    return jnp.where(coupled, needed / jnp.where(coupled, of.product, 1.0), jnp.inf)


_MEMBERS = 4  # of a cluster: the pair, and the two modes nearest to it
_NEAR = 5.0  # widths within which a mode belongs to it
_SOFT = 0.25  # of that, over which it comes in
_FAR = 1e30


class Cluster(NamedTuple):
    """The modes near a resonance, which move together: amplitudes' = (diagonal + a coupling) x."""

    diagonal: Complex[Array, " members"]
    coupling: Complex[Array, "members members"]
    members: Int[Array, " members"]  # modes
    weights: Float[Array, " members"]  # 0: apart from it

    def growth(self, amplitude: Scalar | float = 1.0) -> Scalar:
        """Largest growth rate at a factor of amplitude."""
        whole = jnp.diag(self.diagonal) + amplitude * self.coupling
        unit = jax.lax.stop_gradient(jnp.max(jnp.abs(whole)))
        unit = jnp.where(unit > 0, unit, 1.0)
        return unit * log_spectral_radius(exponential(whole / unit))


def cluster_of(
    basis: ModalBasis,
    of: Modulation,
    frequency: Scalar,
    pair: Int[Array, "2"],
    near: Scalar,
) -> Cluster:
    """The cluster of a pair of modes (P10), as it is at a factor `near` of amplitude.

    A signed mode belongs to it where some harmonic takes its frequency to that of the pair within
    a few widths of the resonance: then difference resonances lend it the damping of other modes.
    """
    om, dec, count = basis.frequencies, basis.decays, len(basis.frequencies)
    sigma, decay = jnp.concatenate([om, -om]), jnp.concatenate([dec, dec])
    first, second = pair[0], count + pair[1]
    places = jnp.arange(2 * count)
    is_pair = (places == first) | (places == second)
    order = jnp.round(jax.lax.stop_gradient((om[pair[0]] - sigma) / frequency))
    order = jnp.where(places == first, 0.0, jnp.where(places == second, 1.0, order))
    detuning = sigma + order * frequency - om[pair[0]]

    apart = order[:, None] - order  # -1 where the harmonic raises the second to the first
    coupling = jnp.where(apart == -1, of.raising, jnp.where(apart == 1, of.lowering, 0.0))
    strength = jnp.abs(jax.lax.stop_gradient(coupling * coupling.T))
    strength = jnp.sqrt(jnp.maximum(strength[:, first], strength[:, second]))
    width = _NEAR * (decay + near * strength)
    distance = jnp.abs(jax.lax.stop_gradient(detuning)) / jnp.where(width > 0, width, 1.0)
    distance = jnp.where((strength > 0) & (width > 0), distance, _FAR)
    distance = jax.lax.stop_gradient(jnp.where(is_pair, jnp.inf, distance))
    others = jnp.argsort(distance)[: _MEMBERS - 2]
    members = jnp.concatenate([jnp.stack([first, second]), others])
    # A pair that is far from its own resonance is near to others' and not their center.
    own = _NEAR * (decay[first] + decay[second])
    off = jnp.abs(jax.lax.stop_gradient(detuning[second])) / jnp.where(own > 0, own, 1.0)
    joining = _comes_in(distance[others]) * _comes_in(jnp.where(own > 0, off, _FAR))
    weights = jax.lax.stop_gradient(jnp.concatenate([jnp.ones(2), joining]))
    # What is apart must not be what decays least.
    away = jnp.where(weights > 0, 0.0, 10 * (decay[first] + decay[second]) + frequency)
    diagonal = 1j * detuning[members] - decay[members] - away
    shared = coupling[members][:, members] * jnp.sqrt(weights[:, None] * weights)
    return Cluster(diagonal, shared, members % count, weights)


def _comes_in(distance: Array) -> Array:
    """From 1 inside of 1 to 0 outside, smoothly."""
    part = jnp.clip((1 + _SOFT - distance) / (2 * _SOFT), 0.0, 1.0)
    return part**2 * (3 - 2 * part)


_SEARCHED = np.exp2(np.arange(-6, 17) / 4)  # of the pair's own critical amplitude


def cluster_critical(cluster: Cluster, near: Scalar) -> Scalar:
    """The least factor of amplitude at which a cluster becomes unstable; inf: none near `near`.

    Its derivatives are those of the equation that the growth vanishes.
    """
    at = jnp.where(jnp.isfinite(near), near, 1.0)
    fixed, start = jax.lax.stop_gradient((cluster, at))

    critical, grows = first_upcrossing(fixed.growth, start * _SEARCHED)
    found = grows & jnp.isfinite(near)
    held = frozen_unless(found, cluster)
    root = implicit_root(lambda a, of: of.growth(a), held, critical)
    return jnp.where(found, root, jnp.inf)
