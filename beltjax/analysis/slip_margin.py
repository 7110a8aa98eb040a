"""Whether a belt slides on its pulleys: what is left of friction, at rest and in motion."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from beltjax.analysis.damping import Damping
from beltjax.analysis.linearization import linearize
from beltjax.analysis.motion import driver_speed
from beltjax.analysis.orbit_measures import extremes, held_exponents, slip_exponents
from beltjax.analysis.orbit_motion import MotionGrid
from beltjax.analysis.orders import ORDER, Forcing, Orders, given_forcing
from beltjax.analysis.periodic import PeriodicResponse
from beltjax.analysis.response import Excitation, harmonic_response
from beltjax.analysis.steady import SteadyState, steady_state
from beltjax.compiling.quick import boundary_jit
from beltjax.drive.canonical import canonical, strongly_typed
from beltjax.drive.components import as_real
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.placeholders import harmless, numbers_are_usable
from beltjax.drive.readable import Readable
from beltjax.drive.system import Drive
from beltjax.numerics.bases import AbstractBasis, Legendre
from beltjax.numerics.loops import Loops
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
    succeeded,
)

_POINTS = 32  # of a period of the highest order


class SlipMargin(Readable):
    """What is left of friction times wrap on each pulley; below 0 the belt slides there.

    Infinite where a pulley has no friction.
    """

    static: Float[Array, " pulleys"]  # under the tensions of the steady state
    dynamic: Float[Array, " pulleys"] | None  # least over a period; None without an excitation
    result: RESULTS


def slip_margin(
    drive: Drive,
    point: OperatingPoint,
    excitation: Excitation | Orders | None = None,
    *,
    motion: PeriodicResponse | None = None,
    order: Float[Array, ""] | float = ORDER,
    damping: Damping | None = None,
    basis: AbstractBasis | None = None,
    throw: bool = True,
) -> SlipMargin:
    """How far each pulley is from sliding on its whole arc.

    Friction times wrap, with `Pulley.friction_static` where it is given, less |ln(Q_out/Q_in)|;
    docs/theory/friction_vibration.md, (F19). The dynamic margin is the least over a period, of the
    linear response or of a periodic motion of finite amplitude. Where a margin is positive the belt
    only creeps there, and does not squeal.

    The result is that of the steady state, or `response_not_finite`. With `throw=False` read
    `.result`: margins of a failure are 0, without derivatives.

    Args:
        drive: the drive.
        point: speeds and torques.
        excitation: crank motion and torques, at `order` or at several; the point's own unless
            given. Without either there is no dynamic margin.
        motion: a periodic motion of this drive, from which the dynamic margin is then taken.
        order: of an `Excitation`, per rotation of the driver.
        damping: `Damping()` unless given, for the linear response.
        basis: functions for the deflections of each span, `Legendre(16)` unless given.
        throw: raise where the result is a failure.

    Returns:
        The margins, by pulley.

    Raises:
        ValueError: an inertia is missing, or the excitation names a pulley that is not there.
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/seven_pulley.toml")
        >>> crank = bj.Excitation(crank=0.01)
        >>> bj.slip_margin(drive, point, crank, damping=bj.Damping(modal=0.02)).dynamic
    """
    if motion is not None:
        found = _of_motion(*canonical(drive, point), motion.measures.slip_exponent_max)
        result = RESULTS.where(succeeded(found.result), motion.result, found.result)
        found = eqx.tree_at(lambda f: f.result, found, result)
        return raise_unless_successful(found, found.result, throw)
    basis = Legendre(16) if basis is None else basis
    shaken = shaken_by(drive, point, excitation, order)
    damping = strongly_typed(Damping() if damping is None else damping)
    found = _slip_margin(*canonical(drive, point), shaken, damping, basis)
    return raise_unless_successful(found, found.result, throw)


class Shaken(NamedTuple):
    """An excitation by harmonics of its period."""

    forcing: Forcing
    base: Float[Array, ""]  # order of the period
    free: bool


def shaken_by(
    drive: Drive,
    point: OperatingPoint,
    excitation: Excitation | Orders | None,
    order: Float[Array, ""] | float,
) -> Shaken | None:
    """The excitation by harmonics of its period; None where there is none."""
    names, given = drive.pulley_names, point.excitation
    if isinstance(excitation, Excitation):
        forcing = Orders({1.0: excitation}).forcing(names, 1)
        return Shaken(strongly_typed(forcing), as_real(order), False)
    if isinstance(excitation, Orders):
        highest = round(max(excitation.excitations) / excitation.base)
        forcing = strongly_typed(excitation).forcing(names, highest)
        return Shaken(forcing, as_real(excitation.base), excitation.driver == "free")
    if given is None or not given.excites:
        return None
    highest = 1
    if given.orders:
        every = Orders({one.order: Excitation() for one in given.orders})
        highest = round(max(every.excitations) / every.base)
    forcing, base = given_forcing(given, names, highest)
    return Shaken(strongly_typed(forcing), as_real(base), given.driver == "free")


@boundary_jit
def _of_motion(drive: Drive, point: OperatingPoint, most: Float[Array, " pulleys"]) -> SlipMargin:
    steady = steady_state(drive, point, throw=False)
    drive, _ = harmless(drive, point, numbers_are_usable(drive, point))
    return _margins(drive, steady, most, jnp.array(True))


@boundary_jit
def _slip_margin(
    drive: Drive,
    point: OperatingPoint,
    shaken: Shaken | None,
    damping: Damping,
    basis: AbstractBasis,
) -> SlipMargin:
    steady = steady_state(drive, point, throw=False)
    return margins_about(drive, point, steady, shaken, damping, basis)


def margins_about(
    drive: Drive,
    point: OperatingPoint,
    steady: SteadyState,
    shaken: Shaken | None,
    damping: Damping,
    basis: AbstractBasis,
) -> SlipMargin:
    """`slip_margin` of a canonical drive and point, whose steady state is known."""
    drive, point = harmless(drive, point, numbers_are_usable(drive, point))
    if shaken is None:
        return _margins(drive, steady, None, jnp.array(True))
    lin = linearize(steady, basis, free=shaken.free, throw=False)
    harmonics = jnp.arange(1, len(shaken.forcing.crank))
    frequencies = harmonics * shaken.base * driver_speed(drive, point)
    parts = shaken.forcing.crank[1:], shaken.forcing.torques[1:]
    given = jnp.all(jnp.stack([jnp.all(jnp.isfinite(part)) for part in parts]))
    cranks, torques = (jnp.where(given, part, 0.0) for part in parts)
    swings, finite = harmonic_response(lin, frequencies, cranks, torques, damping)
    over = swings / steady.scales.tension
    most = largest_exponents(steady.effective_tensions, over, drive.loops)
    return _margins(drive, steady, most, given & finite)


def largest_exponents(
    Q: Float[Array, " spans"], swings: Complex[Array, "harmonics spans"], loops: Loops
) -> Float[Array, " pulleys"]:
    """Greatest |ln(Q_out/Q_in)| over a period of tensions that swing by these amplitudes."""
    numbers = np.arange(1, len(swings) + 1)

    def at(signal: tuple[Array, Array], phase: Float[Array, ""]) -> Float[Array, " pulleys"]:
        steady, moving = signal
        turned = jnp.exp(1j * numbers * phase)
        return slip_exponents(steady + (turned @ moving).real, loops)

    count = _POINTS * len(swings)
    step = 2 * np.pi / count
    phases, weights = jnp.arange(count) * step, jnp.full(count, 1 / count)
    grid = MotionGrid(phases, weights, jnp.asarray(step), (-np.inf, np.inf))
    return extremes(at, (Q, swings), grid)[1]


def _margins(
    drive: Drive,
    steady: SteadyState,
    most: Float[Array, " pulleys"] | None,
    finite: Array,
) -> SlipMargin:
    held = held_exponents(drive, steady.reference.layout.wraps)
    result = first_failure(
        (~succeeded(steady.result), steady.result), (~finite, RESULTS.response_not_finite)
    )
    bare = jnp.asarray(np.array([pulley.holding is None for pulley in drive.pulleys]))

    def left(used: Float[Array, " pulleys"]) -> Float[Array, " pulleys"]:
        return jnp.where(succeeded(result), jnp.where(bare, jnp.inf, held - used), 0.0)

    dynamic = None if most is None else left(most)
    found = SlipMargin(left(steady.slip_exponents), dynamic, result)
    return frozen_where_failed(found, result)
