"""A mass on a moving belt: steady sliding, its stability, and stick-slip."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float

from beltjax.analysis.friction_laws import AbstractFrictionLaw
from beltjax.compiling.quick import boundary_jit
from beltjax.drive.canonical import strongly_typed
from beltjax.drive.components import as_real
from beltjax.drive.readable import Readable
from beltjax.physics.friction_laws import FrictionCurve, grip
from beltjax.physics.stick_slip import (
    FrictionModel,
    criticality,
    cycle,
    fold,
    onset,
)
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
)

_STRONGEST = 2.5  # damping ratio up to which slips were compared with an adaptive integration


class FrictionCycle(Readable):
    """A self-excited oscillation; all numbers are 0 where there is none."""

    sticks: Bool[Array, ""]  # whether the mass sticks to the belt for a part of it
    period: Float[Array, ""]  # [s]
    slip_time: Float[Array, ""]  # [s]
    stick_time: Float[Array, ""]  # [s]
    amplitude: Float[Array, ""]  # of the displacement, half peak to peak [m]
    v_max: Float[Array, ""]  # greatest sliding speed [m/s]
    release: Float[Array, ""]  # displacement where sticking ends [m]
    capture: Float[Array, ""]  # and where it begins [m]


class FrictionOscillator(Readable):
    """A mass that a moving belt drags, and what it does."""

    equilibrium: Float[Array, ""]  # displacement of steady sliding [m]
    eigenvalues: Complex[Array, "2"]  # of small disturbances of that [1/s]
    onset_speed: Float[Array, ""]  # V*: above it steady sliding is stable [m/s]
    fold_speed: Float[Array, ""]  # V_f: above it nothing sticks, even after a knock [m/s]
    critical_damping: Float[Array, ""]  # from which on sliding is stable at any speed [N s/m]
    # Above 0 an oscillation grows gently below the onset, and slips at first; below 0 it coexists
    # with steady sliding between the onset and the fold [N s^3/m^3].
    criticality: Float[Array, ""]
    cycle: FrictionCycle
    error: Float[Array, ""]  # of the cycle, relative to its amplitude
    result: RESULTS
    warning: RESULTS  # `strongly_damped`: fold and cycle are not sure


class OscillatorNumbers(NamedTuple):
    """What `oscillating` finds for a model, without judging it."""

    onset_speed: Float[Array, ""]
    fold_speed: Float[Array, ""]
    critical_damping: Float[Array, ""]
    criticality: Float[Array, ""]
    cycle: FrictionCycle
    error: Float[Array, ""]
    slips: Bool[Array, ""]
    passes: Bool[Array, ""]


def friction_oscillator(
    mass: Float[Array, ""] | float,
    damping: Float[Array, ""] | float,
    stiffness: Float[Array, ""] | float,
    load: Float[Array, ""] | float,
    law: AbstractFrictionLaw,
    belt_speed: Float[Array, ""] | float,
    *,
    load_rate: Float[Array, ""] | float = 0.0,
    wrap: Float[Array, ""] | float = 0.0,
    throw: bool = True,
) -> FrictionOscillator:
    """A mass on a spring and a damper that a moving belt drags by dry friction.

    m x'' + c x' + k x = N(x) g(mu(V - x')), docs/theory/friction_vibration.md, (F4) to (F12). The
    stick-slip cycle is exact: it is superstable, so that one slip from release to rest on the belt
    determines it, and nothing is regularized or iterated over periods.

    The result is `successful` where there is an oscillation that lasts. Otherwise it says why there
    is none, which raises nothing: `no_negative_slope`, `onset_beyond_stick` or `no_stick_slip`; or
    `slides_back`, where there is one that this function does not follow.
    `numbers_unusable` is a failure; its numbers are 0, without derivatives. The warning
    `strongly_damped` says that fold and cycle are not sure.

    Args:
        mass: m > 0 [kg].
        damping: c >= 0 [N s/m].
        stiffness: k > 0 [N/m].
        load: N > 0 at x = 0 [N].
        law: friction over the sliding speed.
        belt_speed: V > 0 [m/s].
        load_rate: by which the load grows with x [N/m].
        wrap: of a belt on an arc, for which g = (2/w) tanh(mu w/2) and the load is that of the mean
            tension times the wrap [rad]; 0 is a block, with g = mu.
        throw: raise where the numbers are unusable.

    Returns:
        Steady sliding, its stability, the limits of the belt's speed and the cycle.

    Raises:
        AnalysisError: the numbers are unusable, and `throw` is set.

    Examples:
        >>> law = bj.StribeckFriction(static=0.4, kinetic=0.25, speed=0.1)
        >>> found = bj.friction_oscillator(1.0, 0.1, 1.0, 1.0, law, belt_speed=0.1)
        >>> found.onset_speed, found.fold_speed, found.cycle.amplitude  # [m/s], [m/s], [m]
    """
    numbers = map(as_real, (mass, damping, stiffness, load, load_rate, wrap, 0.0))
    m, c, k, N, n, w, held = numbers
    model = FrictionModel(m, c, k, N, n, w, held, curve=strongly_typed(law.curve))
    found = _friction_oscillator(model, as_real(belt_speed))
    return raise_unless_successful(found, _failure(found.result), throw)


def _failure(result: RESULTS) -> RESULTS:
    """`result` where it is a failure; why there is no oscillation is an answer."""
    bad = result == RESULTS.numbers_unusable
    return RESULTS.where(bad, result, RESULTS.successful)


@boundary_jit
def _friction_oscillator(model: FrictionModel, V: Float[Array, ""]) -> FrictionOscillator:
    good = usable(model) & (V > 0) & jnp.isfinite(V)
    model, V = sound(model, V, good)
    found = oscillating(model, V)
    stiffness = model.effective_stiffness(V)
    half = (model.damping + model.slope(V)) / (2 * model.mass)
    root = jnp.sqrt(half**2 - stiffness / model.mass + 0j)
    ratio = model.damping / (2 * jnp.sqrt(model.stiffness * model.mass))
    silent = ~(found.cycle.sticks | found.slips)
    result = first_failure(
        (~good, RESULTS.numbers_unusable),
        (found.passes, RESULTS.slides_back),
        (silent & ~drops(model.curve), RESULTS.no_negative_slope),
        (silent & beyond_stick(model, found.onset_speed), RESULTS.onset_beyond_stick),
        (silent, RESULTS.no_stick_slip),
    )
    answer = FrictionOscillator(
        equilibrium=model.sliding_load(V) * model.phi(V) / model.stiffness,
        eigenvalues=jnp.stack([-half + root, -half - root]),
        onset_speed=found.onset_speed,
        fold_speed=found.fold_speed,
        critical_damping=found.critical_damping,
        criticality=found.criticality,
        cycle=found.cycle,
        error=found.error,
        result=result,
        warning=first_failure(
            (good & (ratio > _STRONGEST), RESULTS.strongly_damped),
        ),
    )
    kept = jax.tree.map(lambda x: jnp.where(good, x, jnp.zeros_like(x)), answer)
    told = result, answer.warning
    kept = eqx.tree_at(lambda a: (a.result, a.warning), kept, told)
    return frozen_where_failed(kept, _failure(result))


def drops(curve: FrictionCurve) -> Bool[Array, ""]:
    """Whether friction falls as sliding begins, at once or with the sliding speed."""
    return (curve.steepness < 0) | (curve.jump > 0)


def beyond_stick(model: FrictionModel, onset_speed: Float[Array, ""]) -> Bool[Array, ""]:
    """Whether friction falls, but so little that damping keeps sliding stable at any speed."""
    return (model.curve.steepness < 0) & (onset_speed == 0)


def usable(model: FrictionModel) -> Bool[Array, ""]:
    """Whether a model's numbers are finite and of the right sign."""
    m, curve = model, model.curve
    finite = jnp.all(jnp.isfinite(jnp.stack(jax.tree.leaves(model))))
    positive = (m.mass > 0) & (m.stiffness > 0) & (m.load > 0) & (curve.speed > 0)
    law = (curve.static >= 0) & (curve.level >= 0) & (curve.jump >= -1e-12 * curve.static)
    # Friction that grows faster with the displacement than the spring pulls back holds for ever.
    held = m.stiffness > m.gain * grip(curve.static, m.wrap)
    return finite & positive & law & held & (m.damping >= 0) & (m.wrap >= 0)


def sound(
    model: FrictionModel, V: Float[Array, ""], good: Bool[Array, ""]
) -> tuple[FrictionModel, Float[Array, ""]]:
    """The model and speed where they are good; elsewhere harmless ones, without derivatives."""
    one, none = jnp.ones(()), jnp.zeros(())
    curve = FrictionCurve(0.3 * one, 0.2 * one, 0.1 * one, 0.1 * one, none, none)
    spare = FrictionModel(one, 0.1 * one, one, one, none, none, none, curve)
    return jax.tree.map(lambda a, b: jnp.where(good, a, b), (model, V), (spare, 0.1 * one))


def oscillating(model: FrictionModel, V: Float[Array, ""]) -> OscillatorNumbers:
    """Limits and cycle of a model whose numbers are usable."""
    limit, edge, around = onset(model), fold(model), cycle(model, V)
    bounded = (limit.speed > 0) & jnp.isfinite(limit.speed)
    at = jnp.where(bounded, limit.speed, 1.0)
    found = FrictionCycle(
        sticks=around.sticks,
        period=around.period,
        slip_time=around.period - around.stick_time,
        stick_time=around.stick_time,
        amplitude=(around.highest - around.lowest) / 2,
        v_max=around.v_max,
        release=around.release,
        capture=around.capture,
    )
    return OscillatorNumbers(
        onset_speed=limit.speed,
        fold_speed=edge,
        critical_damping=limit.critical_damping,
        criticality=jnp.where(bounded, criticality(model, at), 0.0),
        cycle=found,
        error=around.error,
        slips=around.slips,
        passes=around.passes,
    )
