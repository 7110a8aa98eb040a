"""Pairs of modes that a fluctuation of tension excites: parametric resonance to first order."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Int

from beltjax.analysis.damping import Damping
from beltjax.analysis.linearization import Linearization
from beltjax.analysis.motion import motion_model
from beltjax.analysis.response import Excitation, equations_at
from beltjax.compiling.batched_loops import ready_after
from beltjax.compiling.quick import boundary_jit
from beltjax.drive.canonical import strongly_typed
from beltjax.drive.components import as_real, concrete
from beltjax.drive.readable import Readable
from beltjax.numerics.gyroscopic import hermitian_modes
from beltjax.numerics.parametric import (
    ModalBasis,
    Modulation,
    cluster_critical,
    cluster_of,
    critical_square,
    modal_basis,
    modulation,
    pair_growth,
    pair_terms,
    pairs_of,
)
from beltjax.physics.motion import MotionModel
from beltjax.physics.parametric import PrimaryAmplitudes, modulated_stiffness, slope_forms
from beltjax.physics.vibration import acceleration, convection
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
    succeeded,
)

Term = Literal["tension", "shape", "speed"]
TERMS: tuple[Term, ...] = ("tension", "shape", "speed")
Accelerating = Literal["newton", "uniform"]
ACCELERATING = "newton", "uniform"


class Pairs(Readable):
    """Pairs of modes at one frequency of excitation, each a resonance of its own."""

    modes: Int[np.ndarray, "pairs 2"]  # r <= s, from 1 on
    center: Float[Array, " pairs"]  # om_r + om_s, where the excitation is in resonance [rad/s]
    detuning: Float[Array, " pairs"]  # of the excitation from there [rad/s]
    coupling: Float[Array, " pairs"]  # sqrt(Lam): growth without damping in resonance [rad/s]
    decay_r: Float[Array, " pairs"]  # of the modes [1/s]
    decay_s: Float[Array, " pairs"]
    growth: Float[Array, " pairs"]  # of the pair alone [1/s]
    ratio: Float[Array, " pairs"]  # R of the pair alone: above 1 it is unstable
    cluster_growth: Float[Array, " pairs"]  # with the modes that are near [1/s]
    # The factor by which the excitation may grow until the pair with the modes that are near is
    # unstable; inf where it does not become so.
    critical_factor: Float[Array, " pairs"]
    cluster: Int[Array, "pairs members"]  # modes that are near, from 1 on; 0 where there is none
    # The factor by which the excitation may grow until a span goes slack: until the fluctuation of
    # its tension is all that is left of it beyond m v^2.
    slack_factor: Float[Array, ""]
    tension_fluctuation: Complex[Array, " spans"]  # [N]
    frequencies: Float[Array, " modes"]  # [rad/s]
    frequency: Float[Array, ""]  # of the excitation [rad/s]
    result: RESULTS
    warning: RESULTS  # `span_slackens` where the slack factor is below 1

    @property
    def kind(self) -> tuple[str, ...]:
        """'principal' of a mode with itself, 'sum' of two; those of difference do not grow."""
        return tuple("principal" if r == s else "sum" for r, s in self.modes.tolist())


def parametric_pairs(
    linearization: Linearization,
    frequency: Float[Array, ""] | float,
    excitation: Excitation,
    names: tuple[str, ...] = (),
    *,
    damping: Damping,
    terms: Sequence[Term] = TERMS,
    count: int = 8,
    acceleration: Accelerating = "newton",
    throw: bool = True,
) -> Pairs:
    """Parametric resonance of each pair of modes under an excitation, to first order.

    The linear response makes the tensions of the spans fluctuate, turns their gradients and varies
    the speed of the belt; each excites pairs of modes whose frequencies add up to that of the
    excitation. docs/theory/parametric.md, (P4) to (P10). All numbers are differentiable, in
    closed form. `floquet` is the answer for which this is the screen.

    The result is that of the linearization, `drive_diverges` where its stiffness is not positive
    definite, `commensurate` for a belt that moves without bending stiffness, or
    `response_not_finite`. The warning `span_slackens` says that a span goes slack before.

    Args:
        linearization: the drive about its steady state, as `linearize` returns it.
        frequency: of the excitation, > 0 [rad/s].
        excitation: crank motion and torques.
        names: `drive.pulley_names`, which are needed where the excitation has torques.
        damping: of the drive. Without any all pairs are unstable in resonance.
        terms: what varies: "tension" of the spans, their "shape", the "speed" of the belt.
        count: number of modes, the lowest.
        acceleration: "newton" counts the gradient of tension that accelerates the belt; "uniform"
            leaves it out, as the printed models do, which is for comparison with them.
        throw: raise where the result is a failure.

    Returns:
        The pairs (1, 1), (1, 2), .., (count, count).

    Raises:
        ValueError: the frequency is not positive, `terms`, `count` or `acceleration` are not
            available, or the excitation names a pulley that is not there.
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> linearization = bj.linearize(bj.steady_state(drive, point), bj.Legendre(16))
        >>> crank, damping = bj.Excitation(crank=0.002), bj.Damping(modal=0.01)
        >>> pairs = bj.parametric_pairs(linearization, 549.0, crank, damping=damping)
        >>> pairs.kind, pairs.growth  # [1/s]
    """
    asked = pairs_asked(linearization, excitation, names, terms, count, acceleration)
    frequency = as_real(frequency)
    require_frequency(frequency)
    shaken = excitation.crank, excitation.on(names)
    found = _pairs(
        strongly_typed(linearization), frequency, *shaken, strongly_typed(damping), asked
    )
    return raise_unless_successful(found, found.result, throw)


class PairsAsked(NamedTuple):
    """What of a modulation is counted."""

    terms: tuple[Term, ...]
    modes: int
    uniform: bool


def pairs_asked(
    lin: Linearization | None,
    excitation: Excitation,
    names: tuple[str, ...],
    terms: Sequence[Term],
    count: int,
    accelerating: Accelerating,
) -> PairsAsked:
    """The options of `parametric_pairs`; raises `ValueError` as that does."""
    if not terms or not set(terms) <= set(TERMS):
        raise ValueError(f"terms: found {tuple(terms)}; give some of {', '.join(TERMS)}.")
    if accelerating not in ACCELERATING:
        given = " or ".join(ACCELERATING)
        raise ValueError(f"acceleration: found {accelerating!r}; give {given}.")
    size = count if lin is None else len(lin.mass)
    if not 1 <= count <= size:
        raise ValueError(f"count: found {count}; give 1 to {size}, or a larger basis.")
    return PairsAsked(tuple(one for one in TERMS if one in terms), count, accelerating == "uniform")


def require_frequency(frequency: Float[Array, ""]) -> None:
    """Raise `ValueError` unless a frequency is positive, as far as it is known."""
    number = concrete(frequency)
    if number is not None and not (number > 0).all():
        raise ValueError(f"frequency: must be positive [rad/s]; found {number}.")


class Resonating(NamedTuple):
    """A drive's modes and what an excitation modulates, dimensionless."""

    model: MotionModel
    dissipation: Float[Array, "size size"]
    basis: ModalBasis
    primary: PrimaryAmplitudes
    frequency: Float[Array, ""]
    definite: Bool[Array, ""]


class ModalDrive(NamedTuple):
    """The modes of a drive in motion."""

    dissipation: Float[Array, "size size"]
    basis: ModalBasis
    definite: Bool[Array, ""]  # whether its stiffness is


def modal_drive(lin: Linearization, model: MotionModel, count: int, after: Array) -> ModalDrive:
    """The lowest modes of a drive.

    In a batch each routine of linear algebra waits for the one before it. The modes come last,
    `after` the response, because their derivatives have routines of their own.
    """
    C = model.damping - lin.gyroscopic
    M = ready_after(lin.mass, after)
    rigid = int(lin.free)
    every = len(lin.mass) - rigid
    found, definite = hermitian_modes(M, lin.gyroscopic, lin.stiffness, every, rigid)
    basis = modal_basis(M, lin.gyroscopic, lin.stiffness, C, found, count)
    return ModalDrive(C, basis, definite)


def resonating(
    lin: Linearization,
    frequency: Float[Array, ""],
    crank: Complex[Array, ""],
    torques: Complex[Array, " pulleys"] | Complex[Array, "1"],
    damping: Damping,
    count: int,
) -> Resonating:
    """The modes and the primary motion of a drive at one frequency [rad/s]."""
    model = motion_model(lin, damping)
    omega = frequency * lin.scales.time
    forces = jnp.broadcast_to(torques / lin.scales.energy, (lin.spans,))
    damped = model.damping
    if model.rigid is not None:
        damped = ready_after(damped, jnp.sum(model.rigid))
    z = jnp.linalg.solve(*equations_at(lin, omega, crank, forces, damping, damped))
    C, basis, definite = modal_drive(lin, model, count, z)
    tensions = lin.model.gam * (lin.elongations @ z + lin.driving * crank)
    return Resonating(model, C, basis, PrimaryAmplitudes(z, tensions), omega, definite)


def modulated(
    lin: Linearization, at: Resonating, crank: Complex[Array, ""], asked: PairsAsked
) -> Modulation:
    """What the primary motion does to the modes, (P4) to (P6)."""
    K = modulated_stiffness(at.model, at.primary, "tension" in asked.terms, "shape" in asked.terms)
    G = jnp.zeros_like(K)
    if "speed" in asked.terms:
        m, omega = lin.model, at.frequency
        gained = 1j * omega * _travels(lin, at.primary.z, crank)
        K = K - 2 * slope_forms(at.model, m.lam * m.mu * m.s * gained)
        carried = convection(m, lin.basis, lin.rotors, gained)
        rates = 1j * omega * gained
        if asked.uniform:
            K = K + convection(m, lin.basis, lin.rotors, rates)
        else:
            K = K + acceleration(m, lin.basis, lin.elongations, lin.rotors, rates).matrix
        G = carried - carried.T
    return modulation(at.basis, K, G)


def _travels(
    lin: Linearization, z: Complex[Array, " size"], crank: Complex[Array, ""]
) -> Complex[Array, " spans"]:
    """By how much the middle of each span moves along itself, in the direction of travel."""
    g = lin.steady.groups
    _, rotations, moved = lin.split(z)
    driven = jnp.zeros(len(rotations)).at[lin.driver].set(1.0 - lin.free)
    rims = g.radius_ratios * (g.turning @ (rotations + crank * driven))
    return (rims + g.loops.following(rims)) / 2 + g.travel * (g.drifts @ moved)


@boundary_jit
def _pairs(
    lin: Linearization,
    frequency: Float[Array, ""],
    crank: Complex[Array, ""],
    torques: Complex[Array, " pulleys"] | Complex[Array, "1"],
    damping: Damping,
    asked: PairsAsked,
) -> Pairs:
    at = resonating(lin, frequency, crank, torques, damping, asked.modes)
    of, pairs = modulated(lin, at, crank, asked), pairs_of(asked.modes)
    terms = pair_terms(at.basis, of, at.frequency, pairs)
    square = critical_square(terms)
    near = jnp.sqrt(jnp.where(square > 0, square, 1.0)) * (square > 0)

    def clustered(pair: Array, near: Array) -> tuple[Array, Array, Array]:
        cluster = cluster_of(at.basis, of, at.frequency, pair, near)
        members = jnp.where(cluster.weights > 0, cluster.members + 1, 0)
        return cluster.growth(), cluster_critical(cluster, near), members[2:]

    growing, critical, members = jax.vmap(clustered)(jnp.asarray(pairs), near)
    time = lin.scales.time
    slack = slack_factor(lin, at.primary.tensions)
    finite = jnp.all(jnp.isfinite(at.primary.z)) & jnp.all(jnp.isfinite(at.basis.frequencies))
    result = first_failure(
        (~succeeded(lin.result), lin.result),
        (~at.definite, RESULTS.drive_diverges),
        (is_commensurate(lin), RESULTS.commensurate),
        (~finite, RESULTS.response_not_finite),
    )
    answer = Pairs(
        modes=pairs + 1,
        center=(frequency - terms.detuning / time),
        detuning=terms.detuning / time,
        coupling=jnp.sqrt(jnp.maximum(terms.product, 1e-300)) / time,
        decay_r=terms.decay_r / time,
        decay_s=terms.decay_s / time,
        growth=pair_growth(terms) / time,
        ratio=1 / square,
        cluster_growth=growing / time,
        critical_factor=critical,
        cluster=members,
        slack_factor=slack,
        tension_fluctuation=at.primary.tensions * lin.scales.tension,
        frequencies=at.basis.frequencies / time,
        frequency=frequency,
        result=result,
        warning=first_failure((slack < 1, RESULTS.span_slackens)),
    )
    return frozen_where_failed(answer, result)


def slack_factor(lin: Linearization, tensions: Complex[Array, " spans"]) -> Float[Array, ""]:
    """The factor of an excitation at which the first span goes slack.

    There the fluctuation of its tension is all that is left of it beyond m v^2.
    """
    swing = jnp.sqrt(tensions.real**2 + tensions.imag**2 + 1e-300)
    return jnp.min(lin.model.Q / swing)


def is_commensurate(lin: Linearization) -> Bool[Array, ""]:
    """Whether a belt moves without bending stiffness, so that its frequencies are multiples."""
    return jnp.any((lin.model.eps == 0) & (lin.model.s != 0))
