"""Growth of disturbances of a drive's motion under an excitation, by Floquet's theory."""

from collections.abc import Callable
from typing import Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from beltjax.analysis.damping import Damping
from beltjax.analysis.linearization import Linearization
from beltjax.analysis.motion import (
    Excited,
    load_series,
    motion_model,
    oscillator,
    real_series,
)
from beltjax.analysis.orders import Forcing, Orders
from beltjax.analysis.parametric import is_commensurate, modal_drive, require_frequency
from beltjax.analysis.response import Excitation, Response, frequency_response
from beltjax.compiling.batched_loops import ready_after
from beltjax.compiling.quick import boundary_jit
from beltjax.drive.canonical import strongly_typed
from beltjax.drive.components import as_real
from beltjax.drive.readable import Readable
from beltjax.numerics.derivative_rules import frozen_unless
from beltjax.numerics.floquet import growth, monodromy
from beltjax.numerics.harmonic_balance import derived, series
from beltjax.numerics.parametric import ModalBasis
from beltjax.numerics.periodic import periodic_orbit
from beltjax.numerics.roots import first_upcrossing, implicit_root
from beltjax.physics.motion import MotionModel
from beltjax.physics.parametric import (
    disturbance_of_response,
    modal_disturbance,
)
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
    succeeded,
)

Scalar = Float[Array, ""]
Level = Literal["response", "orbit"]
LEVELS = "response", "orbit"

_OF_ORBIT = 5  # harmonics of an orbit, per harmonic of its excitation
_PER_HARMONIC = 6  # samples


class Floquet(Readable):
    """What becomes of small disturbances of a motion that repeats itself."""

    growth: Float[Array, ""]  # of the disturbance that grows most, or decays least [1/s]
    # The factor by which the excitation may grow until the motion is unstable; inf where it is not
    # before a span goes slack. None where it was left out.
    critical_amplitude: Float[Array, ""] | None
    # The factor at which a span goes slack by the linear response, as `Pairs` has it.
    slack_factor: Float[Array, ""]
    monodromy: Float[Array, "states states"]  # of the modes' amplitudes, real and imaginary parts
    error: Float[Array, ""]  # of the growth [1/s]: its change by the last quarter of the modes
    primary: Response  # the linear response, one row for each order of the excitation
    frequency: Float[Array, ""]  # of the period [rad/s]
    result: RESULTS
    warning: RESULTS  # `span_slackens` where the slack factor is below 1

    @property
    def multipliers(self) -> np.ndarray:
        """Floquet's multipliers, the largest first, by NumPy on the host."""
        found = np.linalg.eigvals(np.asarray(self.monodromy))
        return found[np.argsort(-np.abs(found))]


def floquet(
    linearization: Linearization,
    frequency: Float[Array, ""] | float,
    excitation: Excitation | Orders,
    names: tuple[str, ...] = (),
    *,
    damping: Damping,
    level: Level = "response",
    modes: int = 24,
    steps: int = 64,
    critical: bool = True,
    throw: bool = True,
) -> Floquet:
    """Growth of disturbances of a drive's motion, with all that its modes do to each other.

    The equations are those of the motion of finite amplitude, linearized about the linear response
    (`level="response"`) or about the periodic orbit (`level="orbit"`), in the amplitudes of the
    lowest modes; docs/theory/parametric.md, (P1) to (P3) and (P13) to (P16). No eigensolver is
    needed for the growth, so that large batches will do.

    The result is that of the linearization, `drive_diverges` where its stiffness is not positive
    definite, `commensurate` for a belt that moves without bending stiffness, `no_damping` where a
    critical amplitude is asked for without damping, `response_not_finite`, or `orbit_not_found`.
    The warning `span_slackens` says that a span goes slack under this excitation.

    Args:
        linearization: the drive about its steady state, as `linearize` returns it; 16 Legendre
            functions a span leave an error of some 0.3 %.
        frequency: of the excitation, > 0 [rad/s]; of several orders that of their common period.
        excitation: crank motion and torques at that frequency, or several `Orders` of it.
        names: `drive.pulley_names`, which are needed where the excitation has torques.
        damping: of the drive.
        level: "response" or "orbit". Close to a boundary of stability both agree as far as the
            motion is small; the orbit is the answer where it is not.
        modes: number of modes, the lowest; all where there are fewer.
        steps: of a period.
        critical: find the critical amplitude, which takes some 30 times as long.
        throw: raise where the result is a failure.

    Returns:
        The growth, the critical amplitude, and the monodromy matrix.

    Raises:
        ValueError: the frequency is not positive, `level`, `modes` or `steps` are not available,
            or the excitation names a pulley that is not there.
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> linearization = bj.linearize(bj.steady_state(drive, point), bj.Legendre(12))
        >>> crank, damping = bj.Excitation(crank=0.002), bj.Damping(modal=0.01)
        >>> bj.floquet(linearization, 549.0, crank, damping=damping, critical=False).growth  # [1/s]
    """
    if level not in LEVELS:
        raise ValueError(f"level: found {level!r}; give {' or '.join(LEVELS)}.")
    if modes < 1 or steps < 8:
        raise ValueError(f"modes, steps: found {modes}, {steps}; give at least 1 mode and 8 steps.")
    frequency = as_real(frequency)
    require_frequency(frequency)
    orders, places = _orders(excitation)
    forcing = strongly_typed(orders.forcing(names or ("",), max(places)))
    lin = strongly_typed(linearization)
    asked = FloquetAsked(level, min(modes, len(lin.mass) - lin.free), steps, critical, places)
    found = _floquet(lin, frequency, forcing, strongly_typed(damping), asked)
    return raise_unless_successful(found, found.result, throw)


class FloquetAsked(NamedTuple):
    """The options of `floquet`."""

    level: Level
    modes: int
    steps: int
    critical: bool
    places: tuple[int, ...]  # harmonics of the period that are excited


def _orders(excitation: Excitation | Orders) -> tuple[Orders, tuple[int, ...]]:
    """The excitation as orders, and the harmonics that these are of their period."""
    orders = excitation if isinstance(excitation, Orders) else Orders({1.0: excitation})
    return orders, tuple(sorted(round(order / orders.base) for order in orders.excitations))


class Disturbed(NamedTuple):
    """A drive whose motion is disturbed, dimensionless."""

    model: MotionModel
    dissipation: Float[Array, "size size"]
    basis: ModalBasis
    definite: Bool[Array, ""]
    response: Float[Array, "terms size"]  # Fourier coefficients of the linear response
    excited: Excited
    slack: Scalar  # factor of the excitation

    @property
    def period(self) -> Scalar:
        """Dimensionless."""
        return 2 * jnp.pi / self.excited.frequency


def disturbed(
    lin: Linearization,
    frequency: Scalar,
    forcing: Forcing,
    damping: Damping,
    count: int,
    places: tuple[int, ...],
) -> tuple[Disturbed, Response]:
    """The modes of a drive, and its linear response to an excitation."""
    w = frequency * lin.scales.time
    picked = jnp.asarray(places)

    def responding(place: Array, crank: Array, torques: Array) -> tuple[Response, RESULTS]:
        names = tuple(map(str, range(len(torques))))
        given = Excitation(crank, dict(zip(names, torques, strict=True)))
        of = frequency_response(
            lin, place * frequency[None], given, names, damping=damping, throw=False
        )
        flat = eqx.tree_at(lambda r: (r.result, r.warning), of, (None, None))
        return jax.tree.map(lambda x: x[0], flat), of.result

    torques = forcing.torques[picked]
    torques = jnp.broadcast_to(torques, (len(places), lin.spans))
    fields, results = jax.vmap(responding)(picked, forcing.crank[picked], torques)
    swing = jnp.sqrt(fields.tensions.real**2 + fields.tensions.imag**2 + 1e-300)
    slack = jnp.min(lin.model.Q * lin.scales.tension / jnp.sum(swing, axis=0))
    warning = first_failure((slack < 1, RESULTS.span_slackens))
    result = first_failure((jnp.any(results != RESULTS.successful), RESULTS.response_not_finite))
    primary = eqx.tree_at(
        lambda r: (r.result, r.warning), fields, (result, warning), is_leaf=lambda x: x is None
    )
    assert primary.coordinates is not None  # by the basis, not in closed form
    later = eqx.tree_at(lambda lin: lin.mass, lin, ready_after(lin.mass, primary.coordinates))
    model = motion_model(later, damping)
    after = model.damping if model.rigid is None else jnp.sum(model.rigid)
    C, basis, definite = modal_drive(lin, model, count, after)
    waves = jnp.zeros((len(forcing.crank), len(lin.mass)), complex)
    waves = waves.at[picked].set(primary.coordinates)
    wide = Forcing(
        forcing.crank, jnp.broadcast_to(forcing.torques, (len(forcing.crank), lin.spans))
    )
    driver, load = load_series(lin, wide, w, damping)
    excited = Excited(model, w, driver, load)
    made = Disturbed(model, C, basis, definite, real_series(waves), excited, slack)
    return made, primary


def lowest(basis: ModalBasis, count: int) -> ModalBasis:
    """So many of the modes."""
    return ModalBasis(*(part[:count] for part in basis))


def response_monodromy(of: Disturbed, count: int, amplitude: Scalar | float, steps: int) -> Array:
    """The monodromy matrix about the linear response to `amplitude` times the excitation."""
    modal = modal_disturbance(of.model, lowest(of.basis, count), of.dissipation)
    motion, driver = amplitude * of.response, amplitude * of.excited.driver

    def at(part: Scalar) -> Array:
        return disturbance_of_response(of.model, modal, motion, driver, 2 * jnp.pi * part)

    return monodromy(at, of.period, steps)


class OrbitFound(NamedTuple):
    """A periodic motion of finite amplitude."""

    excited: Excited
    coefficients: Float[Array, "terms size"]
    converged: Bool[Array, ""]


def orbit_at(of: Disturbed, amplitude: Scalar | float) -> OrbitFound:
    """The motion under `amplitude` times the excitation."""
    harmonics = _OF_ORBIT * (len(of.excited.driver) // 2)
    terms = 2 * harmonics + 1

    def longer(part: Array) -> Array:
        return jnp.zeros((terms, *part.shape[1:])).at[: len(part)].set(amplitude * part)

    excited = of.excited._replace(driver=longer(of.excited.driver), load=longer(of.excited.load))
    found = periodic_orbit(oscillator, excited, harmonics, _PER_HARMONIC * harmonics)
    return OrbitFound(excited, found.coefficients, found.converged)


def orbit_monodromy(of: Disturbed, orbit: OrbitFound, count: int, steps: int) -> Array:
    """The monodromy matrix about an orbit."""
    modal = modal_disturbance(of.model, lowest(of.basis, count), of.dissipation)
    system = oscillator(orbit.excited, jnp.ones(()))
    X, rate = orbit.coefficients, orbit.excited.frequency * derived(orbit.coefficients)

    def at(part: Scalar) -> Array:
        phase = 2 * jnp.pi * part
        waves = series(phase, len(X) // 2)
        _, push = jax.linearize(lambda z, v: system.force(z, v, phase), waves @ X, waves @ rate)
        forces = jax.vmap(push, in_axes=1, out_axes=1)(modal.of, modal.rates)
        return modal.still + modal.onto @ forces

    return monodromy(at, of.period, steps)


@boundary_jit
def _floquet(
    lin: Linearization, frequency: Scalar, forcing: Forcing, damping: Damping, asked: FloquetAsked
) -> Floquet:
    of, primary = disturbed(lin, frequency, forcing, damping, asked.modes, asked.places)
    fewer = max(3 * asked.modes // 4, 1)
    there = jnp.array(True)
    if asked.level == "orbit":
        orbit = orbit_at(of, 1.0)
        there = orbit.converged
        matrices = [orbit_monodromy(of, orbit, m, asked.steps) for m in (asked.modes, fewer)]
    else:
        matrices = [response_monodromy(of, m, 1.0, asked.steps) for m in (asked.modes, fewer)]
    growing, coarser = (growth(matrix, of.period) for matrix in matrices)
    critical = critical_factor(of, asked) if asked.critical else None
    undamped = jnp.min(of.basis.decays) <= 0
    result = first_failure(
        (~succeeded(lin.result), lin.result),
        (~of.definite, RESULTS.drive_diverges),
        (is_commensurate(lin), RESULTS.commensurate),
        (~succeeded(primary.result), RESULTS.response_not_finite),
        (undamped & asked.critical, RESULTS.no_damping),
        (~there, RESULTS.orbit_not_found),
        (~jnp.all(jnp.isfinite(matrices[0])), RESULTS.response_not_finite),
    )
    answer = Floquet(
        growth=growing / lin.scales.time,
        critical_amplitude=critical,
        slack_factor=of.slack,
        monodromy=matrices[0],
        error=jnp.abs(growing - coarser) / lin.scales.time,
        primary=primary,
        frequency=frequency,
        result=result,
        warning=primary.warning,
    )
    return frozen_where_failed(answer, result)


_SEARCHED = np.exp2(np.arange(-14, 1) / 2)  # of the factor at which a span goes slack
_NEAR = np.linspace(0.7, 1.6, 7)  # of the critical amplitude by the linear response


def critical_factor(of: Disturbed, asked: FloquetAsked) -> Scalar:
    """The least factor of the excitation at which its motion is unstable; inf: none before slack.

    Its derivatives are those of the equation that the growth vanishes.
    """

    def by_response(amplitude: Scalar, of: Disturbed) -> Scalar:
        return growth(response_monodromy(of, asked.modes, amplitude, asked.steps), of.period)

    def by_orbit(amplitude: Scalar, of: Disturbed) -> Scalar:
        orbit = orbit_at(of, amplitude)
        found = growth(orbit_monodromy(of, orbit, asked.modes, asked.steps), of.period)
        return jnp.where(orbit.converged, found, -1.0)

    fixed = jax.lax.stop_gradient(of)
    far = jnp.where(jnp.isfinite(fixed.slack), fixed.slack, 1.0)
    root, found = first_upcrossing(lambda a: by_response(a, fixed), far * _SEARCHED)
    if asked.level == "response":
        return _followed(by_response, of, root, found)
    tried = jnp.where(found, root, far) * _NEAR
    root, there = first_upcrossing(lambda a: by_orbit(a, fixed), tried, one_by_one=True)
    return _followed(by_orbit, of, root, found & there)


def _followed(
    growing: Callable[[Scalar, Disturbed], Scalar],
    of: Disturbed,
    root: Scalar,
    found: Bool[Array, ""],
) -> Scalar:
    held = frozen_unless(found, of)
    return jnp.where(found, implicit_root(growing, held, root), jnp.inf)
