"""Forced vibration of a drive: crank motion or accessory torque, at one speed or over a range."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.scipy.linalg import block_diag
from jaxtyping import Array, Bool, Complex, Float

from beltjax.analysis.damping import Damping, damping_matrix, own_damping
from beltjax.analysis.linearization import Linearization, linearize
from beltjax.analysis.steady import of_single, steady_state
from beltjax.compiling.quick import boundary_jit
from beltjax.drive.canonical import canonical, strongly_typed
from beltjax.drive.components import as_complex, as_real, concrete
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.readable import Readable
from beltjax.drive.system import Drive
from beltjax.numerics.bases import AbstractBasis, Legendre
from beltjax.physics.exact_vibration import (
    dynamic_stiffness,
    span_response,
    spans_in_motion,
)
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
    succeeded,
)

_POINTS = 65  # of a grid on which the peak of a span is found before it is refined


# Coordinates (None: exact), rotations of the rotors, motions of the tensioners, strains and peaks
# of the spans, all at one frequency.
Fields = tuple[
    Complex[Array, " size"] | None,
    Complex[Array, " rotors"],
    Complex[Array, " coordinates"],
    Complex[Array, " spans"],
    Float[Array, " spans"],
]
# The crank's rotation, and the torques as `_response` takes them.
Shaken = tuple[Complex[Array, ""], Complex[Array, " pulleys"]]


class Excitation(eqx.Module):
    """A harmonic excitation: the driver's rotation, torques on pulleys, or both.

    `crank` is the driver's rotation [rad]. Amplitudes are zero to peak and may be complex:
    z(t) = Re(z e^{i Omega t}). Torques act in the direction of belt travel.
    """

    crank: Complex[Array, ""] = eqx.field(converter=as_complex, default=0.0)
    torques: dict[str, Complex[Array, ""]] = eqx.field(
        converter=lambda t: {name: as_complex(x) for name, x in t.items()},
        default_factory=dict,
    )  # [N m], by name of pulley

    def on(self, names: tuple[str, ...]) -> Complex[Array, " pulleys"]:
        """Torque on each pulley [N m]; raises `ValueError` for a name that is not there.

        Without torques and without `names`, which only torques need, it is a single zero.
        """
        if not self.torques:
            names = names or ("",)
        for name in self.torques:
            if name not in names:
                raise ValueError(
                    f"Excitation.torques: there is no pulley {name!r}; give one of "
                    f"{', '.join(names)}."
                )
        return jnp.stack([self.torques.get(name, as_complex(0.0)) for name in names])


class Response(Readable):
    """Steady oscillation at each frequency: amplitudes zero to peak, z(t) = Re(z e^{i Omega t})."""

    frequencies: Float[Array, " points"]  # Omega [rad/s]
    rotations: Complex[Array, "points pulleys"]  # of the hubs [rad], in the direction of travel
    rotor_rotations: Complex[Array, "points rotors"]  # [rad]; rims and rings after the hubs
    tensioner_motions: Complex[Array, "points tensioners"]  # [rad] or [m]
    span_peaks: Float[Array, "points spans"]  # largest deflection over each span [m]
    tensions: Complex[Array, "points spans"]  # tension fluctuations [N]
    hub_loads: Float[Array, "points pulleys"]  # [N], of the vector sum of those tensions
    # The factor by which the excitation may grow until a span goes slack, where the fluctuation of
    # its tension reaches its running tension. Below 1 the linear response does not hold.
    slack_factors: Float[Array, "points spans"]
    stiffness_ratios: Float[Array, "points pulleys"]  # of the steady state, as `SteadyState` has
    coordinates: Complex[Array, "points size"] | None  # in the linearization's basis; None: exact
    result: RESULTS
    warning: RESULTS  # `span_slackens` where a slack factor is below 1

    @property
    def arm_rotation(self) -> Complex[Array, " points"]:
        """Rotation of a single arm [rad], counterclockwise; 0 without a tensioner."""
        return of_single(self.tensioner_motions)


def frequency_response(
    linearization: Linearization,
    frequencies: Float[Array, " points"],
    excitation: Excitation,
    names: tuple[str, ...] = (),
    *,
    damping: Damping | None = None,
    exact: bool = False,
    throw: bool = True,
) -> Response:
    """Response of a linearized drive to a harmonic excitation at `frequencies` > 0 [rad/s].

    It solves (-Omega^2 M + i Omega (G + C) + K) z = f, docs/theory/vibration.md. The result is that
    of the linearization, or `response_not_finite` where there is no finite motion; all values are
    then zero. With `throw=False` read `.result`. The warning `span_slackens` in `.warning` says
    that a span's tension fluctuates by more than its running tension.

    Args:
        linearization: the drive about its steady state, as `linearize` returns it.
        frequencies: one angular frequency or [points] of them, > 0 [rad/s].
        excitation: crank motion and torques. Crank motion has no effect on a drive linearized with
            `free`.
        names: `drive.pulley_names`, which are needed where the excitation has torques.
        damping: `Damping()` unless given, which counts the drive's own dampers.
        exact: solve the spans in closed form instead, D(Omega) z = f of docs/theory/vibration.md,
            (V14) to (V16), with the damping of the drive's own dampers alone.
        throw: raise where the result is a failure.

    Returns:
        Amplitudes zero to peak, with the frequencies along the first axis.

    Raises:
        ValueError: frequencies are missing or not positive, the excitation names a pulley that is
            not there, or `exact` is set beside modal or stiffness damping or with a linearization
            that is `free` or has `fixed_steady` or `fixed_bending`.
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> linearization = bj.linearize(bj.steady_state(drive, point))
        >>> crank = bj.Excitation(crank=0.01)  # [rad]
        >>> bj.frequency_response(linearization, [100.0, 200.0], crank).hub_loads  # [N]
    """
    damping = Damping() if damping is None else damping
    frequencies = jnp.atleast_1d(as_real(frequencies))
    require_frequencies(frequencies)
    if exact:
        _require_closed_form(linearization, damping)
    excitation = strongly_typed(excitation)
    found = _response(
        strongly_typed(linearization),
        frequencies,
        excitation.crank,
        excitation.on(names),
        strongly_typed(damping),
        exact,
    )
    return raise_unless_successful(found, found.result, throw)


@boundary_jit
def _response(
    lin: Linearization,
    frequencies: Float[Array, " points"],
    crank: Complex[Array, ""],
    torques: Complex[Array, " pulleys"] | Complex[Array, "1"],
    damping: Damping,
    exact: bool,
) -> Response:
    """`frequency_response` to torques [pulleys], or [1] for the same on each."""
    forces = jnp.broadcast_to(torques / lin.scales.energy, (lin.spans,))
    omega = frequencies * lin.scales.time
    solve = _exactly if exact else _by_basis
    fields = jax.vmap(lambda w: solve(lin, w, crank, forces, damping))(omega)
    answer = _in_newtons(lin, frequencies, *fields, crank)
    return frozen_where_failed(answer, answer.result)


def harmonic_response(
    lin: Linearization,
    frequencies: Float[Array, " harmonics"],
    cranks: Complex[Array, " harmonics"],
    torques: Complex[Array, "harmonics pulleys"],
    damping: Damping,
) -> tuple[Complex[Array, "harmonics spans"], Bool[Array, ""]]:
    """Fluctuations of tension [N] to an excitation at several frequencies, and if all are finite.

    For compiled code; a harmonic that is not excited does not move the drive.
    """

    def at(
        omega: Float[Array, ""], crank: Complex[Array, ""], torque: Complex[Array, " pulleys"]
    ) -> tuple[Complex[Array, " spans"], Bool[Array, ""]]:
        forces = torque / lin.scales.energy
        _, _, _, strains, _ = _by_basis(lin, omega * lin.scales.time, crank, forces, damping)
        tensions = lin.scales.tension * lin.model.gam * strains
        finite = jnp.all(jnp.isfinite(tensions))
        return jnp.where(finite, tensions, 0.0), finite

    tensions, finite = jax.vmap(at)(frequencies, cranks, torques)
    return tensions, jnp.all(finite)


def require_frequencies(frequencies: Array) -> None:
    """Raise `ValueError` unless there are frequencies, all of them positive."""
    if frequencies.size == 0:
        raise ValueError("frequencies: found none; give at least one [rad/s].")
    numbers = concrete(frequencies)
    if numbers is not None and not (numbers > 0).all():
        raise ValueError(f"frequencies: must be positive [rad/s]; found {numbers.min():g}.")


def _require_closed_form(lin: Linearization, damping: Damping) -> None:
    given = concrete(damping.modal), concrete(damping.stiffness), concrete(damping.belt)
    if any(value is not None and value.any() for value in given):
        raise ValueError(
            "exact: modal, stiffness and belt damping have no closed form; leave them out."
        )
    if lin.mixed or lin.free:
        raise ValueError("exact: leave out free, fixed_steady and fixed_bending.")


def _by_basis(
    lin: Linearization,
    omega: Float[Array, ""],
    crank: Complex[Array, ""],
    forces: Complex[Array, " pulleys"],
    damping: Damping,
) -> Fields:
    """Coordinates, strains and peaks at one frequency by the linearization's basis."""
    z = jnp.linalg.solve(*equations_at(lin, omega, crank, forces, damping))
    strains = lin.elongations @ z + lin.driving * crank
    _, rotations, moved = lin.split(z)
    peaks = jax.vmap(lambda i: _peak(lambda x, order: lin.deflection(z, i, x, order)))(
        jnp.arange(lin.spans)
    )
    return z, rotations, moved, strains, peaks


def equations_at(
    lin: Linearization,
    omega: Float[Array, ""],
    crank: Complex[Array, ""],
    forces: Complex[Array, " pulleys"],
    damping: Damping,
    damped: Float[Array, "size size"] | None = None,
) -> tuple[Complex[Array, "size size"], Complex[Array, " size"]]:
    """Matrix and load of the coordinates' equations at one frequency (V16), dimensionless.

    `damped` is the gyroscopic and damping matrix, where that is known already.
    """
    C = lin.gyroscopic + damping_matrix(lin, damping) if damped is None else damped
    factor = 1 + 1j * omega * damping.stiffness / lin.scales.time  # of a damped stiffness
    pencil = lin.stiffness - omega**2 * lin.mass + 1j * omega * C
    work = lin.model.lam * lin.model.gam
    of_belt = factor + 1j * omega * damping.belt / lin.scales.time
    load = -of_belt * crank * (lin.elongations.T @ (work * lin.driving))
    n = lin.spans * lin.basis.size
    on_rotors = moments_on_rotors(lin, omega, crank, forces, damping, factor)
    return pencil, load.at[n : n + len(lin.rotors)].add(on_rotors)


def _peak(deflection: Callable[[Array, int], Array]) -> Float[Array, ""]:
    """Largest |w| over a span: the largest on a grid, refined by one step of Newton's method."""
    grid = jnp.linspace(0.0, 1.0, _POINTS)
    best = grid[jnp.argmax(jnp.abs(jax.vmap(lambda x: deflection(x, 0))(grid)))]
    w, slope, bend = (jax.lax.stop_gradient(deflection(best, order)) for order in range(3))
    first = (jnp.conj(w) * slope).real
    second = (jnp.conj(w) * bend).real + jnp.abs(slope) ** 2
    step = jnp.where(second < 0, -first / jnp.where(second < 0, second, 1.0), 0.0)
    # The slope vanishes at the peak, so that a move of its place changes nothing to first order.
    place = jnp.clip(best + jnp.clip(step, -1 / _POINTS, 1 / _POINTS), 0.0, 1.0)
    return modulus(deflection(place, 0))


def modulus(w: Complex[Array, "..."]) -> Float[Array, "..."]:
    """|w|, with derivative 0 at 0."""
    square = w.real**2 + w.imag**2
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)


def moments_on_rotors(
    lin: Linearization,
    omega: Float[Array, ""],
    crank: Complex[Array, ""],
    forces: Complex[Array, " pulleys"],
    damping: Damping,
    factor: Complex[Array, ""] | float,
) -> Complex[Array, " turning"]:
    """Moments on the rotors that turn, by torques on hubs and by the driver's torsion springs.

    The inertia of the belt's own motion along its path transmits the driver's motion, too.
    """
    torques = (forces @ lin.steady.groups.hubs)[lin.rotors]
    by_angle, by_rate, by_acceleration = driver_moments(lin, damping)
    through = factor * by_angle + 1j * omega * by_rate - omega**2 * by_acceleration
    return torques - through * crank


def driver_moments(lin: Linearization, damping: Damping) -> Float[Array, "3 turning"]:
    """Moments that a held driver puts on the other rotors by isolators, dampers and belt inertia.

    They are per unit of its angle, its rate and its acceleration, positive against their turning.
    """
    m, none = lin.model, jnp.zeros(len(lin.rotors))
    if lin.free:
        return jnp.stack([lin.twisting, none, none])
    by_rate = lin.steady.groups.rotor_damping[lin.rotors, lin.driver] if damping.arm else none
    return jnp.stack([lin.twisting, by_rate, m.M_r[lin.rotors, lin.driver]])


def _exactly(
    lin: Linearization,
    omega: Float[Array, ""],
    crank: Complex[Array, ""],
    forces: Complex[Array, " pulleys"],
    damping: Damping,
) -> Fields:
    """The fields of `_by_basis` without discretization, from D(Omega) z = f."""
    m = lin.model
    of = span_response(m, omega)
    on_delta, coupling, own = dynamic_stiffness(m, lin.rotors, omega, of)
    if damping.arm:
        own = own + 1j * omega * block_diag(*own_damping(lin))
    whole = jnp.block([[jnp.diag(on_delta) + 0j, coupling], [coupling.conj().T, own]])
    scale = jnp.sqrt(m.lam * m.gam)
    on_rotors = moments_on_rotors(lin, omega, crank, forces, damping, 1.0)
    load = [-scale * lin.driving * crank, on_rotors, jnp.zeros(lin.bodies)]
    z = jnp.linalg.solve(whole, jnp.concatenate(load))
    delta, turning = z[: lin.spans], z[lin.spans : lin.spans + len(lin.rotors)]
    moved = z[lin.spans + len(lin.rotors) :] * m.movable
    rotations = jnp.zeros(m.turns.shape[1], complex).at[lin.rotors].set(turning)
    fine = jnp.linspace(0.0, 1.0, 8 * _POINTS + 1)
    peaks = jnp.max(modulus(spans_in_motion(m, of, delta, moved, fine)), axis=1)
    return None, rotations, moved, delta / scale, peaks


def _in_newtons(
    lin: Linearization,
    frequencies: Float[Array, " points"],
    z: Complex[Array, "points size"] | None,
    rotations: Complex[Array, "points rotors"],
    moved: Complex[Array, "points coordinates"],
    strains: Complex[Array, "points spans"],
    peaks: Float[Array, "points spans"],
    crank: Complex[Array, ""],
) -> Response:
    """The response in SI units, from the fields at each frequency."""
    m, scales, loops = lin.model, lin.scales, lin.steady.groups.loops
    tensions = scales.tension * m.gam * strains
    # Pulley i is pulled along the span that starts there and against the one that ends there.
    along = lin.steady.reference.layout.directions
    pulls = tensions[..., None] * along
    hub = modulus(pulls - jax.vmap(loops.preceding)(pulls))
    driven = jnp.zeros(m.turns.shape[1]).at[lin.driver].set(1.0 - lin.free)
    rotations = rotations + crank * driven
    swing = modulus(tensions)
    running = lin.steady.running_tensions
    slack = jnp.where(swing > 0, running / jnp.where(swing > 0, swing, 1.0), jnp.inf)
    answer = Response(
        frequencies=frequencies,
        rotations=lin.of_pulleys(rotations),
        rotor_rotations=rotations,
        tensioner_motions=moved * lin.units,
        span_peaks=peaks * m.lam * scales.length,
        tensions=tensions,
        hub_loads=jnp.sqrt(jnp.sum(hub**2, axis=-1) + 1e-300),
        slack_factors=slack,
        stiffness_ratios=jnp.tile(lin.steady.stiffness_ratios, (len(frequencies), 1)),
        coordinates=z,
        result=lin.result,
        warning=first_failure((jnp.any(slack < 1), RESULTS.span_slackens)),
    )
    parts = rotations, moved, answer.span_peaks, tensions, answer.hub_loads
    finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(part)) for part in parts]))
    result = first_failure(
        (~succeeded(lin.result), lin.result), (~finite, RESULTS.response_not_finite)
    )
    kept = jax.tree.map(lambda x: jnp.where(finite, x, jnp.zeros_like(x)), answer)
    return eqx.tree_at(lambda r: r.result, kept, result)


def speed_response(
    drive: Drive,
    point: OperatingPoint,
    driver_speeds: Float[Array, " points"],
    excitation: Excitation,
    *,
    order: float = 2.0,
    damping: Damping | None = None,
    basis: AbstractBasis | None = None,
    free: bool = False,
    throw: bool = True,
) -> Response:
    """Response over a range of the driver's speed [rad/s], excited at `order` times that speed.

    The steady state is that of each speed. The results are those of `steady_state` and
    `frequency_response`, one per speed. With `throw=False` read `.result`.

    Args:
        drive: the drive.
        point: its torques; the driver's speed replaces its speed.
        driver_speeds: one speed or [points] of them, > 0 [rad/s].
        excitation: crank motion and torques, the same at each speed.
        order: excitation frequency over the driver's speed.
        damping: `Damping()` unless given, which counts the drive's own dampers.
        basis: functions for the deflections of each span, `Legendre(16)` unless given.
        free: let the driver turn by its torque, as `linearize` does; there is no crank motion then.
        throw: raise where the result of any speed is a failure.

    Returns:
        Amplitudes zero to peak; every field, `result` and `warning` too, has the speeds along its
        first axis.

    Raises:
        ValueError: speeds are missing or not positive, the excitation names a pulley that is not
            there, or an inertia is missing.
        AnalysisError: a result is a failure, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> speeds = jnp.linspace(70.0, 600.0, 20)  # [rad/s]
        >>> bj.speed_response(drive, point, speeds, bj.Excitation(crank=0.01)).span_peaks  # [m]
    """
    driver_speeds = jnp.atleast_1d(as_real(driver_speeds))
    require_frequencies(driver_speeds)
    basis = Legendre(16) if basis is None else basis
    damping = Damping() if damping is None else damping
    excitation, damping = strongly_typed((excitation, damping))
    shaken = excitation.crank, excitation.on(drive.pulley_names)
    numbers = *canonical(drive, point), driver_speeds, shaken, as_real(order)
    found = _over_speeds(*numbers, damping, basis, free)
    return raise_unless_successful(found, found.result, throw)


@boundary_jit
def _over_speeds(
    drive: Drive,
    point: OperatingPoint,
    driver_speeds: Float[Array, " points"],
    shaken: Shaken,
    order: Float[Array, ""],
    damping: Damping,
    basis: AbstractBasis,
    free: bool,
) -> Response:
    def at(speed: Float[Array, ""]) -> tuple[Response, tuple[RESULTS, RESULTS]]:
        steady = steady_state(drive, point.at_driver_speed(speed), throw=False)
        lin = linearize(steady, basis, free=free, throw=False)
        found = _response(lin, order * speed[None], *shaken, damping, False)
        outcomes = found.result, found.warning
        flat = eqx.tree_at(lambda r: (r.result, r.warning), found, (None, None))
        return jax.tree.map(lambda x: x[0], flat), outcomes

    fields, outcomes = jax.vmap(at)(driver_speeds)
    return eqx.tree_at(
        lambda r: (r.result, r.warning), fields, outcomes, is_leaf=lambda leaf: leaf is None
    )


def peak_response(
    linearization: Linearization,
    amplitude: Callable[[Response], Array],
    lower: float,
    upper: float,
    excitation: Excitation,
    names: tuple[str, ...] = (),
    *,
    damping: Damping | None = None,
    points: int = 400,
    throw: bool = True,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Largest value of `amplitude(response)` between two frequencies [rad/s], and where it is.

    The largest value on a grid is refined by Newton's method. The derivative of the peak is exact,
    since its place does not matter to first order. One compiled program serves every call with the
    same function `amplitude`. The results are those of `frequency_response`; with `throw=False` a
    failure shows in `linearization.result` alone.

    Args:
        linearization: the drive about its steady state, as `linearize` returns it.
        amplitude: function that takes the response at one frequency to one real number.
        lower: the lowest frequency, > 0 [rad/s].
        upper: the highest frequency [rad/s].
        excitation: crank motion and torques.
        names: `drive.pulley_names`, which are needed where the excitation has torques.
        damping: `Damping()` unless given, which counts the drive's own dampers.
        points: number of points of the grid.
        throw: raise where the result is a failure.

    Returns:
        The peak, and the frequency [rad/s] at which it is.

    Raises:
        ValueError: the limits are not 0 < lower < upper, or the excitation names a pulley that is
            not there.
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> linearization = bj.linearize(bj.steady_state(drive, point))
        >>> def tension(response):
        ...     return jnp.abs(response.tensions[0, 1])  # of the second span [N]
        >>> crank = bj.Excitation(crank=0.01)
        >>> bj.peak_response(linearization, tension, 100.0, 900.0, crank)
    """
    if not 0 < float(lower) < float(upper):
        raise ValueError(f"lower, upper: found {lower:g}, {upper:g}; give 0 < lower < upper.")
    excitation = strongly_typed(excitation)
    shaken = excitation.crank, excitation.on(names)
    damping = Damping() if damping is None else strongly_typed(damping)
    ends = as_real(lower), as_real(upper)
    peak, place, result = _peak_response(
        strongly_typed(linearization), amplitude, *ends, shaken, damping, points
    )
    return raise_unless_successful((peak, place), result, throw)


@boundary_jit
def _peak_response(
    linearization: Linearization,
    amplitude: Callable[[Response], Array],
    lower: Float[Array, ""],
    upper: Float[Array, ""],
    shaken: Shaken,
    damping: Damping,
    points: int,
) -> tuple[Float[Array, ""], Float[Array, ""], RESULTS]:
    def at(omega: Float[Array, ""], lin: Linearization) -> tuple[Float[Array, ""], RESULTS]:
        found = _response(lin, omega[None], *shaken, damping, False)
        return jnp.squeeze(amplitude(found)), found.result

    fixed = jax.lax.stop_gradient(linearization)
    grid = jnp.linspace(lower, upper, points)
    place = grid[jnp.argmax(jax.vmap(lambda omega: at(omega, fixed)[0])(grid))]
    slope = jax.grad(lambda omega: at(omega, fixed)[0])
    reach = (grid[1] - grid[0]) / 2

    def newton(_: Array, place: Float[Array, ""]) -> Float[Array, ""]:
        first, second = jax.jvp(slope, (place,), (jnp.ones(()),))
        step = jnp.where(second < 0, -first / jnp.where(second < 0, second, 1.0), 0.0)
        return jnp.clip(place + jnp.clip(step, -reach, reach), lower, upper)

    place = jax.lax.stop_gradient(jax.lax.fori_loop(0, 6, newton, place))
    peak, result = at(place, linearization)
    return peak, place, result
