"""Parametric resonance of a single moving span, in pure numbers."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from beltjax.analysis.parametric import ACCELERATING, Accelerating
from beltjax.compiling.batched_loops import ready_after
from beltjax.compiling.quick import boundary_jit
from beltjax.drive.components import as_real, concrete
from beltjax.drive.readable import Readable
from beltjax.numerics.bases import Legendre
from beltjax.numerics.derivative_rules import frozen_unless, without_derivative
from beltjax.numerics.floquet import growth, monodromy
from beltjax.numerics.gyroscopic import hermitian_modes, modal_damping
from beltjax.numerics.parametric import (
    ModalBasis,
    critical_square,
    modal_basis,
    modal_generator,
    modulation,
    pair_terms,
    pairs_of,
)
from beltjax.numerics.roots import first_upcrossing, implicit_root
from beltjax.physics.span_parametric import span_matrices, span_modulation
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
)

Scalar = Float[Array, ""]

_RESOLVED = 8  # functions more than modes
_TRIED = np.exp2(np.arange(-8, 13) / 4)  # of the pair's own critical factor
_BISECTIONS = 44
_STILL = 1e-8  # growth over the frequency that counts as none


class SpanStability(Readable):
    """A span under fluctuating tension and speed; dimensionless."""

    growth: Float[Array, ""]  # at the frequency asked for
    edges: Float[Array, "2"]  # frequencies between which the nearest tongue is unstable
    center: Float[Array, ""]  # om_r + om_s of its modes
    coupling: Float[Array, ""]  # sqrt(Lam)
    modes: Int[Array, "2"]  # r and s, from 1 on
    frequencies: Float[Array, " modes"]
    # The factor by which both fluctuations may grow until the span is unstable at the frequency
    # asked for; inf where none was found. None where it was left out.
    critical_factor: Float[Array, ""] | None
    result: RESULTS


def span_stability(
    speed: Float[Array, ""] | float,
    bending: Float[Array, ""] | float,
    tension_fluctuation: Float[Array, ""] | float,
    speed_fluctuation: Float[Array, ""] | float,
    frequency: Float[Array, ""] | float,
    modal: Float[Array, ""] | float = 0.0,
    *,
    acceleration: Accelerating = "newton",
    modes: int = 12,
    steps: int = 128,
    critical: bool = False,
    throw: bool = True,
) -> SpanStability:
    """Growth of disturbances of one moving span, and the tongue that is nearest.

    A span of a belt, pinned at both ends, whose tension and transport speed fluctuate at one
    frequency: docs/theory/parametric.md, (P17) to (P19). Lengths are over the span's, tensions over
    its mean tension, speeds over the wave speed sqrt(P/m), frequencies over that by the length.
    Edges have no derivatives (they are NaN).

    The result is `beam_unusable` for numbers that are not finite or a negative bending or modal
    ratio, `beyond_critical_speed`, `commensurate` for a string that moves or whose speed
    fluctuates (bending 0), or `no_damping` where a critical factor is asked for without damping.

    Args:
        speed: of the belt.
        bending: sqrt(EI/P)/L.
        tension_fluctuation: zero to peak, over the mean tension.
        speed_fluctuation: zero to peak.
        frequency: of both, > 0.
        modal: damping ratio of every mode of the span at rest.
        acceleration: "newton" counts the gradient of tension that accelerates the belt; "uniform"
            leaves it out, as the printed models do.
        modes: number of modes, the lowest.
        steps: of a period.
        critical: find the critical factor, which needs damping.
        throw: raise where the result is a failure.

    Returns:
        Growth, edges of the tongue, its modes and their coupling.

    Raises:
        ValueError: the frequency is not positive, or an option is not available.
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> found = bj.span_stability(0.3, 0.02, 0.05, 0.0, 5.7364)
        >>> found.growth, found.edges
    """
    if acceleration not in ACCELERATING:
        given = " or ".join(ACCELERATING)
        raise ValueError(f"acceleration: found {acceleration!r}; give {given}.")
    if modes < 1 or steps < 8:
        raise ValueError(f"modes, steps: found {modes}, {steps}; give at least 1 mode and 8 steps.")
    numbers = SpanNumbers(
        *map(as_real, (speed, bending, tension_fluctuation, speed_fluctuation, frequency, modal))
    )
    known = concrete(numbers.frequency)
    if known is not None and not (known > 0).all():
        raise ValueError(f"frequency: must be positive; found {known}.")
    found = _span_stability(numbers, acceleration == "uniform", modes, steps, critical)
    return raise_unless_successful(found, found.result, throw)


class SpanNumbers(NamedTuple):
    """A span and how it fluctuates."""

    v: Scalar
    eps: Scalar
    p: Scalar
    dv: Scalar
    frequency: Scalar
    modal: Scalar


class _Resonant(NamedTuple):
    """A span by its modes."""

    numbers: SpanNumbers
    modes: ModalBasis
    dissipation: Float[Array, "n n"]


@boundary_jit
def _span_stability(
    given: SpanNumbers, uniform: bool, count: int, steps: int, critical: bool
) -> SpanStability:
    finite = jnp.all(jnp.isfinite(jnp.stack(given)))
    usable = finite & (given.eps >= 0) & (given.modal >= 0)
    slow = given.v**2 < 1
    commensurate = (given.eps == 0) & ((given.v != 0) | (given.dv != 0))
    bare = SpanNumbers(*map(jnp.asarray, (0.0, 0.1, 0.0, 0.0, 1.0, 0.1)))
    good = usable & slow
    n = jax.tree.map(lambda a, b: jnp.where(good, a, b), given, bare)
    basis = Legendre(count + _RESOLVED)
    M, G, K = span_matrices(basis, n.v, n.eps)
    C = modal_damping(M, K, n.modal)
    found, _ = hermitian_modes(ready_after(M, C), G, K, basis.size)
    of = _Resonant(n, modal_basis(M, G, K, C, found, count), C)

    def modulated(of: _Resonant, frequency: Scalar) -> tuple[Array, Array]:
        n = of.numbers
        return span_modulation(basis, n.v, n.p, n.dv, frequency, uniform)

    def growing(of: _Resonant, frequency: Scalar, amplitude: Scalar | float = 1.0) -> Scalar:
        K, G = modulated(of, frequency)
        still, waves = modal_generator(of.modes, of.dissipation, amplitude * K, amplitude * G)

        def at(part: Scalar) -> Array:
            angle = 2 * jnp.pi * part
            return still + jnp.cos(angle) * waves[0] + jnp.sin(angle) * waves[1]

        period = 2 * jnp.pi / frequency
        return growth(monodromy(at, period, steps), period)

    pairs = pairs_of(count)
    terms = pair_terms(
        of.modes, modulation(of.modes, *modulated(of, n.frequency)), n.frequency, pairs
    )
    strength = jnp.sqrt(jnp.maximum(terms.product, 1e-300))
    place = jnp.argmin(jax.lax.stop_gradient(jnp.abs(terms.detuning) - 2 * strength))
    center, coupling = n.frequency - terms.detuning[place], strength[place]
    factor, undamped = None, jnp.array(False)
    if critical:
        undamped = jnp.min(of.modes.decays) <= 0
        near = jax.lax.stop_gradient(jnp.sqrt(critical_square(terms)[place]))
        factor = _critical(growing, of, near)
    result = first_failure(
        (~usable, RESULTS.beam_unusable),
        (~slow, RESULTS.beyond_critical_speed),
        (commensurate, RESULTS.commensurate),
        (undamped, RESULTS.no_damping),
    )
    fixed = jax.lax.stop_gradient(of)
    edges = _edges(lambda f: growing(fixed, f), center, coupling)
    answer = SpanStability(
        growth=growing(of, n.frequency),
        edges=edges + without_derivative(0.0 * center),
        center=center,
        coupling=coupling,
        modes=jnp.asarray(pairs)[place] + 1,
        frequencies=of.modes.frequencies,
        critical_factor=factor,
        result=result,
    )
    return frozen_where_failed(answer, result)


def _critical(growing: Callable[..., Scalar], of: _Resonant, near: Scalar) -> Scalar:
    """The factor of both fluctuations at which the span becomes unstable."""
    fixed = jax.lax.stop_gradient(of)
    known = jnp.isfinite(near) & (near > 0)
    tried = jnp.where(known, near, 1.0) * _TRIED
    root, found = first_upcrossing(lambda a: growing(fixed, fixed.numbers.frequency, a), tried)

    def left(a: Scalar, of: _Resonant) -> Scalar:
        return growing(of, of.numbers.frequency, a)

    held = frozen_unless(found & known, of)
    return jnp.where(found & known, implicit_root(left, held, root), jnp.inf)


def _edges(
    growing: Callable[[Scalar], Scalar], center: Scalar, coupling: Scalar
) -> Float[Array, "2"]:
    """Frequencies beside an unstable one near the center at which the growth ends."""
    center, coupling = jax.lax.stop_gradient((center, coupling))
    limit = _STILL * center
    near = center + coupling * jnp.linspace(-2.0, 2.0, 9)
    rates = jax.vmap(growing)(near)
    inside = near[jnp.argmax(rates)]
    ways = 4 * coupling * jnp.arange(1, 25) / 24

    def edge(sense: Scalar) -> Scalar:
        still = jax.vmap(lambda way: growing(inside + sense * way))(ways) <= limit
        place = jnp.argmax(still)
        low = jnp.where(place > 0, ways[jnp.maximum(place - 1, 0)], 0.0)

        def halve(_: Array, ends: tuple[Array, Array]) -> tuple[Array, Array]:
            low, high = ends
            middle = (low + high) / 2
            grows = growing(inside + sense * middle) > limit
            return jnp.where(grows, middle, low), jnp.where(grows, high, middle)

        low, high = jax.lax.fori_loop(0, _BISECTIONS, halve, (low, ways[place]))
        return inside + sense * jnp.where(jnp.any(still), (low + high) / 2, jnp.inf)

    edges = jax.vmap(edge)(jnp.array([-1.0, 1.0]))
    return jnp.where(jnp.max(rates) > limit, edges, center)
