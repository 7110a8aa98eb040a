"""Natural modes of a drive about its steady state, and their derivatives."""

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float

from beltjax.analysis.damping import Damping, damping_matrix
from beltjax.analysis.linearization import Linearization
from beltjax.numerics.bases import Products
from beltjax.numerics.counting import Counted, counted_derivative, counted_root
from beltjax.numerics.gyroscopic import (
    Eigen,
    eigenvalues,
    eigenvectors,
    general_modes,
    hermitian_modes,
    positive_definite,
)
from beltjax.physics.exact_vibration import characteristic
from beltjax.physics.vibration import VibrationModel
from beltjax.results import RESULTS, first_failure, frozen_where_failed, succeeded

Route = Literal["auto", "hermitian", "general"]

_SAME = 1e-9  # relative gap between exact frequencies that count as one repeated
# Kinetic energy of pulleys and arm above which a mode is rotational, below which the spans'.
_MOSTLY = 0.7


class Modes(eqx.Module):
    """Natural modes z = Re(shape e^{(growth + i frequency) t}), of lowest frequency first.

    Shapes are amplitudes, zero to peak, of a motion that stores 1 joule; in each, the coordinate
    with the largest kinetic energy is real and positive.
    """

    frequencies: Float[Array, " count"]  # [rad/s]
    growth_rates: Float[Array, " count"]  # [1/s]; 0 for undamped stable drives, > 0: unstable
    dimensionless: Float[Array, " count"]  # frequencies times `linearization.scales.time`
    coordinates: Complex[Array, "count size"]  # in the linearization's basis
    rotations: Complex[Array, "count pulleys"]  # [rad], in the direction of belt travel
    arm_rotations: Complex[Array, " count"]  # [rad], counterclockwise
    span_shares: Float[Array, "count spans"]  # of the mode's kinetic energy
    pulley_shares: Float[Array, "count pulleys"]
    arm_shares: Float[Array, " count"]
    error: Float[Array, " count"]  # relative, of the frequencies, estimated
    linearization: Linearization
    result: RESULTS

    def deflection(self, k: int, i: int, x: Array) -> Array:
        """Deflection of span i in mode k [m, zero to peak, complex], positive inwards.

        x runs from 0 at the span's first listed pulley to 1 at its second.
        """
        lin = self.linearization
        if not 0 <= k < len(self.frequencies):
            raise IndexError(f"mode {k} of {len(self.frequencies)}: modes count from 0.")
        if not 0 <= i < lin.spans:
            raise IndexError(f"span {i} of {lin.spans}: spans count from 0.")
        return span_deflection(lin, self.coordinates[k], i, jnp.asarray(x))

    @property
    def labels(self) -> tuple[str, ...]:
        """'rotational', 'span 0', 'spans' or 'coupled', by the shares of kinetic energy."""
        rigid = jnp.sum(self.pulley_shares, axis=1) + self.arm_shares
        return tuple(
            _label(float(share), spans)
            for share, spans in zip(rigid, self.span_shares.tolist(), strict=True)
        )


def _label(rigid: float, spans: list[float]) -> str:
    if rigid > _MOSTLY:
        return "rotational"
    largest = max(range(len(spans)), key=lambda i: spans[i])
    if spans[largest] > _MOSTLY:
        return f"span {largest}"
    return "spans" if rigid < 1 - _MOSTLY else "coupled"


def span_deflection(lin: Linearization, z: Array, i, x: Array) -> Array:
    """Deflection [m] of span i at x [...] for one vector of coordinates with its lift."""
    fields, _, arm = lin.split(z)
    m = lin.model
    lifted = (m.w_start[i] + m.a[i] * x) * arm
    return (lin.basis.values(x) @ fields[i] + lifted) * m.lam[i] * lin.scales.length


@eqx.filter_jit
def modes(
    linearization: Linearization,
    count: int = 8,
    *,
    exact: bool = False,
    damping: Damping | None = None,
    route: Route = "auto",
) -> Modes:
    """The `count` natural modes of lowest frequency of a linearized drive.

    Kong (2003), chapter 4. `exact` polishes each frequency with the drive's own characteristic
    function, without discretization error, and proves by counting that none is missing or
    double; shapes remain those of the basis. `damping` asks for damped modes. A rigid rotation
    (of a free drive) is left out.

    Where the stiffness matrix is positive definite and nothing is damped the problem is
    Hermitian; elsewhere a general eigenproblem is solved. `route` "auto" decides by the numbers,
    which in a batch costs both; "hermitian" never solves the general one.

    Never raises for numbers: `.result` is `drive_diverges` or `drive_flutters` for an unstable
    drive, whose values are right under "auto" and "general" and placeholders under
    "hermitian"; a failed steady state's result travels; `frequencies_not_isolated` where
    `exact` could not close in. Raises `ValueError` for a count above the system's size.
    """
    lin = linearization
    rigid = 1 if lin.free else 0
    _require_askable(lin, count, len(lin.mass) - rigid, exact, damping, route)
    M, K, C = lin.mass, lin.stiffness, lin.gyroscopic
    if damping is not None:
        C, route = C + damping_matrix(lin, damping), "general"
    definite = _definite(K, rigid)
    found = _eigen(jax.lax.stop_gradient((M, C, K)), count, rigid, definite, route)
    values = eigenvalues(M, C, K, found.values, found.left, found.vectors)
    vectors = eigenvectors(M, C, K, found.values, found.vectors)
    frequencies, error, isolated = values.imag, _tail(lin, found.vectors), jnp.array(True)
    if exact:
        wanted = definite & succeeded(lin.result)
        polished, frequencies = _exact(lin, found.values.imag, wanted, rigid)
        isolated = jnp.all(polished.converged) | ~wanted
        error = jnp.where(wanted, (polished.upper - polished.lower) / polished.root, error)
    flutters = jnp.any((values.real > 0) & (values.imag > 0)) & ~found.stable
    placeholders = ~definite & (route == "hermitian")
    result = first_failure(
        (~succeeded(lin.result), lin.result),
        (~isolated, RESULTS.frequencies_not_isolated),
        (flutters, RESULTS.drive_flutters),
        (placeholders | ~found.stable, RESULTS.drive_diverges),
    )
    answer = _modes(lin, frequencies, values.real, vectors, error, result)
    spoiled = ~succeeded(lin.result) | ~isolated | placeholders
    return frozen_where_failed(answer, RESULTS.where(spoiled, result, RESULTS.successful))


def _require_askable(lin: Linearization, count, size, exact, damping, route) -> None:
    if not 1 <= count <= size:
        raise ValueError(f"count: found {count}; give 1 to {size}, or a larger basis.")
    if route not in ("auto", "hermitian", "general"):
        raise ValueError(f"route: found {route!r}; give 'auto', 'hermitian' or 'general'.")
    if exact and (lin.mixed or damping is not None or route == "general"):
        raise ValueError(
            "exact: applies to undamped modes of one steady state; leave out damping, "
            "route='general', fixed_steady and fixed_bending."
        )


def _definite(K: Array, rigid: int) -> Bool[Array, ""]:
    """Whether K is positive definite, but for a rigid rotation."""
    K = jax.lax.stop_gradient(K)
    slack = 1e-12 * jnp.max(jnp.diag(K)) if rigid else 0.0
    return positive_definite(K + slack * jnp.eye(len(K)))


def _eigen(matrices, count: int, rigid: int, definite, route: Route) -> Eigen:
    """By the Hermitian form where it applies, and elsewhere as the route says."""

    def hermitian(matrices):
        M, C, K = matrices
        unit = jnp.eye(len(K))
        K = jnp.where(definite, K, unit)
        return hermitian_modes(M, jnp.where(definite, C, 0.0), K, count, rigid)

    def general(matrices):
        return general_modes(*matrices, count, rigid)

    if route == "general":
        return general(matrices)
    if route == "hermitian":
        return hermitian(matrices)
    return jax.lax.cond(definite, hermitian, general, matrices)


def _exact(lin: Linearization, guesses, wanted, rigid: int) -> tuple[Counted, Array]:
    """Frequencies as roots of the characteristic function, and with their derivatives."""
    model = jax.tree.map(lambda a, b: jnp.where(wanted, a, b), lin.model, _bare(lin.model))
    guesses = jnp.where(wanted, guesses, 1.0)
    numbers = rigid + 1 + jnp.arange(len(guesses))
    fixed = jax.lax.stop_gradient(model)

    def at(model, omega):
        return characteristic(model, lin.pulleys, lin.has_arm, omega)

    def polish(number, guess):
        return counted_root(lambda omega: at(fixed, omega), number, guess, wanted=wanted)

    polished = jax.vmap(polish)(numbers, guesses)
    roots = polished.root
    gaps = jnp.abs(roots[:, None] - roots) + jnp.where(jnp.eye(len(roots)) > 0, jnp.inf, 0.0)
    repeated = jnp.min(gaps, axis=1) < _SAME * roots

    def differentiated(root, repeated):
        return counted_derivative(lambda w, m: at(m, w).value, model, root, repeated)

    return polished, jax.vmap(differentiated)(roots, repeated)


def _bare(model: VibrationModel) -> VibrationModel:
    """A model that any arithmetic survives, for lanes whose own would not."""
    ones, none = jnp.ones_like(model.lam), jnp.zeros_like(model.lam)
    one, zero = jnp.ones(()), jnp.zeros(())
    return VibrationModel(
        eps=0.1 * one, s=zero, tau=one, gam=one, k_s=one, lam=ones, rho=one, Q=ones,
        kap_s=none, kap_e=none, u=0.1 * ones, z=jnp.inf * ones, drop=none, a=none,
        w_start=none, pull=none, r=ones, J=ones, J_t=one,
    )  # fmt: skip


def _tail(lin: Linearization, vectors: Array) -> Float[Array, " count"]:
    """Largest share of a span's slope energy in its last two functions: what a basis misses."""
    fields, *_ = lin.split(vectors)
    energy = jnp.abs(fields) ** 2  # the functions are orthonormal in slope
    whole = jnp.sum(energy, axis=(1, 2))
    return jnp.max(jnp.sum(energy[..., -2:], axis=-1), axis=-1) / jnp.where(whole > 0, whole, 1.0)


def _modes(lin: Linearization, dimensionless, growth, vectors, error, result) -> Modes:
    fields, rotations, arm = lin.split(vectors)
    m, of = lin.model, lin.basis.products()
    spans = m.lam**2 * m.ka * _span_squares(lin, fields, arm, of)
    pulleys, lever = m.J * jnp.abs(rotations) ** 2, m.J_t * jnp.abs(arm) ** 2
    whole = jnp.sum(spans, axis=1) + jnp.sum(pulleys, axis=1) + lever
    whole = jnp.where(whole > 0, whole, 1.0)
    # A shape of unit Hermitian energy stores a quarter of P0 r_t.
    joule = 2 / jnp.sqrt(lin.scales.tension * m.rho * lin.scales.length)
    time = lin.scales.time
    return Modes(
        frequencies=dimensionless / time,
        growth_rates=growth / time,
        dimensionless=dimensionless,
        coordinates=joule * vectors,
        rotations=joule * rotations,
        arm_rotations=joule * arm,
        span_shares=spans / whole[:, None],
        pulley_shares=pulleys / whole[:, None],
        arm_shares=lever / whole,
        error=error,
        linearization=lin,
        result=result,
    )


def _span_squares(lin: Linearization, fields, arm, of: Products) -> Float[Array, "count spans"]:
    """Integrals of |w|^2 over each span, lift included."""
    m = lin.model
    own = jnp.einsum("ksa,ab,ksb->ks", jnp.conj(fields), of.value, fields).real
    lift = m.w_start[:, None] * of.mean + m.a[:, None] * of.first
    cross = jnp.einsum("ksa,sa->ks", jnp.conj(fields), lift) * arm[:, None]
    square = m.w_start**2 + m.w_start * m.a + m.a**2 / 3
    return own + 2 * cross.real + square * (jnp.abs(arm) ** 2)[:, None]
