"""Squeal: whether a belt that slides on a pulley oscillates along its path."""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int

from beltjax.analysis.friction_laws import CoulombFriction, CubicFriction, StribeckFriction
from beltjax.analysis.friction_oscillator import beyond_stick, sound, usable
from beltjax.analysis.linearization import has_inertias, rotors_in_order, vibration_model
from beltjax.analysis.steady import SteadyState, steady_state
from beltjax.compiling.quick import boundary_jit
from beltjax.drive.canonical import canonical
from beltjax.drive.components import Pulley, as_real, concrete
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.placeholders import harmless, numbers_are_usable
from beltjax.drive.readable import Readable
from beltjax.drive.system import Drive
from beltjax.physics.friction_laws import FrictionCurve
from beltjax.physics.stick_slip import FrictionModel, fold, onset
from beltjax.physics.vibration import BOLTED, geometric_stiffness, of_moving
from beltjax.results import (
    RESULTS,
    code,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
    succeeded,
)

ANSWERS = RESULTS.successful, RESULTS.no_negative_slope, RESULTS.onset_beyond_stick


class SlidingEquations(NamedTuple):
    """M z'' + (C + F_v s s^T) z' + (K + 2 tanh(mu w/2) s p^T) z = 0 of a whole drive.

    Dimensionless, docs/theory/friction_vibration.md, (F16); the coordinates are the rotations of
    the rotors that turn, the tensioners' coordinates and the belt's displacement on the pulley.
    """

    mass: Float[Array, "size size"]
    damping: Float[Array, "size size"]
    stiffness: Float[Array, "size size"]
    sliding: Float[Array, " size"]  # s
    tension: Float[Array, " size"]  # p, with the sign of the pulley
    unit: Float[Array, ""]  # of F_v [N s/m]
    time: Float[Array, ""]  # unit of time [s]

    def at(
        self, model: FrictionModel, v: Float[Array, ""]
    ) -> tuple[Float[Array, "size size"], Float[Array, "size size"]]:
        """Damping and stiffness at a sliding speed [m/s]."""
        by_rate = model.slope(v) / self.unit * jnp.outer(self.sliding, self.sliding)
        pull = model.wrap * model.phi(v)  # 2 tanh(mu w/2)
        by_tension = pull * jnp.outer(self.sliding, self.tension)
        return self.damping + by_rate, self.stiffness + by_tension


class SlipStability(Readable):
    """The belt sliding on a pulley at a given speed.

    Where all pulleys are asked for every field but `steady` is by pulley. The pulley is held at its
    speed; `equations` are those of the whole drive.
    """

    sliding_speed: Float[Array, ""]  # at which growth and frequencies are taken [m/s]
    onset_speed: Float[Array, ""]  # V*: at a higher sliding speed the belt is quiet [m/s]
    fold_speed: Float[Array, ""]  # V_f: at a higher one it stays quiet after a knock [m/s]
    squeal_frequency: Float[Array, ""]  # [rad/s]
    growth: Float[Array, ""]  # of the oscillation; negative: it dies out [1/s]
    # Damping of the belt from which on it is quiet at this sliding speed; where none is given, at
    # any [N s/m].
    critical_damping: Float[Array, ""]
    # At which the pulley runs away under a constant torque, without oscillating, as far as the belt
    # follows at once; negative: it does not [1/s]. 0 without inertias.
    runaway_rate: Float[Array, ""]
    model: FrictionModel  # of the belt on its arc
    equations: SlidingEquations | None  # None where an inertia is missing
    steady: SteadyState
    result: RESULTS

    @property
    def eigenvalues(self) -> Complex[np.ndarray, " states"]:
        """Eigenvalues of the whole drive at the sliding speed [1/s]; on the host, of one pulley.

        Raises `ValueError` where an inertia is missing.
        """
        return eigenvalues_at(self, self.sliding_speed)[0]

    def of_place(self, place: int) -> "SlipStability":
        """The belt on one pulley, of all pulleys."""
        whole = eqx.tree_at(lambda f: (f.result, f.steady), self, (None, None))
        part = jax.tree.map(lambda x: x[place], whole)
        result = jax.tree.map(lambda x: x[place], self.result)
        return eqx.tree_at(
            lambda f: (f.result, f.steady), part, (result, self.steady), is_leaf=lambda x: x is None
        )


def slip_stability(
    drive: Drive,
    point: OperatingPoint,
    pulley: str | None = None,
    sliding_speed: Float[Array, ""] | float | None = None,
    *,
    damping: Float[Array, ""] | float | None = None,
    throw: bool = True,
) -> SlipStability:
    """Onset and growth of squeal where the belt slides on a pulley.

    The belt moves along its path on the arc, between its two spans, under friction that depends on
    the sliding speed: `Pulley.friction_static`, `friction` and `friction_speed`. The tensions are
    those of the running drive; docs/theory/friction_vibration.md, (F13) to (F18).

    The result is that of the steady state, or `numbers_unusable`; or it says why there is no
    squeal, which raises nothing: `no_negative_slope` or `onset_beyond_stick`. The fold is not sure
    above a damping ratio of 2.5. With `throw=False`
    read `.result`: the numbers of a failure are 0, without derivatives. Whether the pulley slides
    at all is another question: `slip_margin`.

    Args:
        drive: the drive.
        point: speeds and torques.
        pulley: the pulley's name; None: all pulleys, along the first axis of every field.
        sliding_speed: of the belt on the pulley, > 0 [m/s]; the onset speed unless given.
        damping: of the belt's motion along the pulley, > 0 [N s/m]; `Belt.longitudinal_damping`
            unless given.
        throw: raise where the result is a failure.

    Returns:
        The limits of the sliding speed, frequency and growth, and the equations of the whole drive.

    Raises:
        KeyError: there is no such pulley.
        ValueError: the damping is missing or not positive, the sliding speed is not positive, or
            the pulley has no friction.
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> import dataclasses
        >>> drive, point = bj.load_drive("examples/seven_pulley.toml")
        >>> law = {"friction_static": 0.6, "friction": 0.3, "friction_speed": 0.3}
        >>> pulleys = tuple(dataclasses.replace(one, **law) for one in drive.pulleys)
        >>> drive = dataclasses.replace(drive, pulleys=pulleys)
        >>> found = bj.slip_stability(drive, point, "alternator", damping=50.0)
        >>> found.onset_speed, found.squeal_frequency
    """
    asked = asked_of_slip(drive, point, pulley, damping)
    if sliding_speed is not None:
        sliding_speed = as_real(sliding_speed)
        _require_positive("sliding_speed", sliding_speed, "m/s")
    found = _slip_stability(*asked, sliding_speed)
    return raise_unless_successful(found, failure_of(found.result), throw)


def failure_of(result: RESULTS) -> RESULTS:
    """`result` where it is a failure; that there is no squeal is an answer."""
    if code(result).ndim:  # of all pulleys
        return jax.vmap(failure_of)(result)
    answered = result == ANSWERS[0]
    for answer in ANSWERS[1:]:
        answered = answered | (result == answer)
    return RESULTS.where(answered, RESULTS.successful, result)


class AskedOfSlip(NamedTuple):
    """A canonical drive, whose belts have their damping, and the pulleys that are asked for."""

    drive: Drive
    point: OperatingPoint
    places: Int[Array, "*pulleys"]


def asked_of_slip(
    drive: Drive,
    point: OperatingPoint,
    pulley: str | None,
    damping: Float[Array, ""] | float | None,
) -> AskedOfSlip:
    """The question of `slip_stability` for compiled code; raises what that does."""
    place = None if pulley is None else drive.pulley(pulley)
    if place is not None and drive.pulleys[place].friction is None:
        raise ValueError(f"Pulley {pulley!r}: friction is missing; squeal needs it.")
    drive = with_damping(drive, damping)
    for belt in drive.belts:
        if belt.longitudinal_damping is None:
            raise ValueError(
                f"Belt {belt.name!r}: longitudinal_damping is missing; give it, or damping=."
            )
        _require_positive("damping", belt.longitudinal_damping, "N s/m")
    places = jnp.asarray(np.arange(len(drive.pulleys)) if place is None else place)
    return AskedOfSlip(*canonical(drive, point), places)


def with_damping(drive: Drive, damping: Float[Array, ""] | float | None) -> Drive:
    """The drive whose belts have this damping along their pulleys, their own where it is None."""
    if damping is None:
        return drive
    damped = [dataclasses.replace(b, longitudinal_damping=damping) for b in drive.belts]
    return eqx.tree_at(lambda d: d.belts, drive, tuple(damped))


def _require_positive(what: str, value: Array, unit: str) -> None:
    known = concrete(value)
    if known is not None and not ((known > 0) & np.isfinite(known)).all():
        raise ValueError(f"{what}: must be positive [{unit}]; found {known}.")


@boundary_jit
def _slip_stability(
    drive: Drive,
    point: OperatingPoint,
    places: Int[Array, "*pulleys"],
    sliding_speed: Float[Array, ""] | None,
) -> SlipStability:
    steady = steady_state(drive, point, throw=False)
    return stability_about(drive, point, steady, places, sliding_speed)


def stability_about(
    drive: Drive,
    point: OperatingPoint,
    steady: SteadyState,
    places: Int[Array, "*pulleys"],
    sliding_speed: Float[Array, ""] | None,
) -> SlipStability:
    """`slip_stability` of a canonical drive and point, whose steady state is known."""
    drive, point = harmless(drive, point, numbers_are_usable(drive, point))
    frame, arcs = drive_frame(drive, steady), arc_models(drive, steady)

    def at(place: Int[Array, ""]) -> SlipStability:
        return _on_one(drive, steady, frame, arcs, place, sliding_speed)

    if places.ndim == 0:
        return at(places)
    found, results = jax.vmap(lambda place: _apart(at(place)))(places)
    return eqx.tree_at(
        lambda f: (f.result, f.steady), found, (results, steady), is_leaf=lambda x: x is None
    )


def _apart(found: SlipStability) -> tuple[SlipStability, RESULTS]:
    """A part of a batch: without the state that all have, and its result by itself."""
    return eqx.tree_at(lambda f: (f.result, f.steady), found, (None, None)), found.result


class SlidingArcs(NamedTuple):
    """The belt on every pulley, as a mass between its two spans."""

    models: FrictionModel  # every number by pulley
    senses: Float[Array, " pulleys"]  # sigma: 1 where the belt drives the pulley, else -1


def arc_models(drive: Drive, steady: SteadyState) -> SlidingArcs:
    """Mass, stiffness, load and friction of the belt on every pulley (F14)."""
    loops, at = drive.loops, steady.reference.layout
    mass = loops.spread(jnp.stack([belt.mass_per_length for belt in drive.belts]))
    none = jnp.zeros(())
    damped = [belt.longitudinal_damping for belt in drive.belts]
    damping = loops.spread(jnp.stack([none if c is None else c for c in damped]))
    rates = loops.spread(drive.axial_stiffnesses) / at.span_lengths
    Q = steady.effective_tensions * steady.scales.tension
    listed = steady.groups.travel > 0

    def beside(of_span: Float[Array, " spans"]) -> tuple[Array, Array]:
        """The values of the span that arrives at each pulley, and of that which leaves it."""
        before = loops.preceding(of_span)
        return jnp.where(listed, before, of_span), jnp.where(listed, of_span, before)

    (rate_in, rate_out), (Q_in, Q_out) = beside(rates), beside(Q)
    senses = jax.lax.stop_gradient(jnp.where(Q_out >= Q_in, 1.0, -1.0))
    lengths = at.span_lengths + loops.preceding(at.span_lengths)
    curves = [friction_curve(pulley) for pulley in drive.pulleys]
    models = FrictionModel(
        mass=mass * (drive.radii * at.wraps + lengths / 3),
        damping=damping,
        stiffness=rate_in + rate_out,
        load=(Q_in + Q_out) / 2 * at.wraps,
        gain=-at.wraps / 2 * senses * (rate_in - rate_out),
        wrap=at.wraps,
        held=jnp.ones_like(rates),
        curve=jax.tree.map(lambda *numbers: jnp.stack(numbers), *curves),
    )
    return SlidingArcs(models, senses)


def friction_curve(pulley: Pulley) -> FrictionCurve:
    """The law of friction of a pulley; without a law one coefficient, and without that none."""
    none, low = jnp.zeros(()), pulley.friction
    if low is None:
        return FrictionCurve(none, none, none, none + 1.0, none, none)
    if pulley.friction_static is None or pulley.friction_speed is None:
        return CoulombFriction(low, low).curve
    numbers = pulley.friction_static, low, pulley.friction_speed
    falling = StribeckFriction(*numbers).curve
    if pulley.friction_law is None:
        return falling
    cubic = jax.lax.stop_gradient(pulley.friction_law) > 0
    return jax.tree.map(lambda a, b: jnp.where(cubic, a, b), CubicFriction(*numbers).curve, falling)


class _Frame(NamedTuple):
    """What the equations of a drive have in common on all of its pulleys; dimensionless."""

    strains: Float[Array, "spans rest"]  # by the rotors that turn and the tensioners
    along: Float[Array, "spans pulleys"]  # by the belt's displacement on each pulley
    surface: Float[Array, "pulleys rest"]  # displacement of the rims
    mass: Float[Array, "rest rest"]
    damping: Float[Array, "rest rest"]
    stiffness: Float[Array, "rest rest"]  # of springs and of the tension alone
    work: Float[Array, " spans"]
    gains: Float[Array, " spans"]


def drive_frame(drive: Drive, steady: SteadyState) -> _Frame | None:
    """The drive with straight spans; None where an inertia is missing."""
    if not has_inertias(drive):
        return None
    m, g = vibration_model(steady, steady), steady.groups
    loops, kept = g.loops, rotors_in_order(steady)[1:]
    ends = loops.following(jnp.eye(len(m.lam))) - jnp.eye(len(m.lam))
    surface = (g.radius_ratios[:, None] * g.turning)[:, kept]
    count = len(m.movable)
    assert g.rotor_inertias is not None  # as `has_inertias` found

    def joined(rotors: Array, bodies: Array) -> Array:
        apart = jnp.zeros((len(kept), count))
        return jnp.block([[rotors[kept][:, kept], apart], [apart.T, bodies]])

    return _Frame(
        strains=jnp.concatenate([m.turns[:, kept], m.pull * m.movable], axis=1),
        along=(g.travel / m.lam)[:, None] * ends,
        surface=jnp.concatenate([surface, jnp.zeros((len(m.lam), count))], axis=1),
        mass=joined(jnp.diag(g.rotor_inertias), of_moving(m, m.M, 1.0)),
        damping=joined(g.rotor_damping, of_moving(m, g.arm_damping, 0.0)),
        stiffness=joined(m.K_r, of_moving(m, m.K + geometric_stiffness(m), BOLTED)),
        work=m.lam * m.gam,
        gains=m.gam,
    )


def _equations(
    drive: Drive,
    steady: SteadyState,
    frame: _Frame,
    model: FrictionModel,
    sense: Float[Array, ""],
    place: Int[Array, ""],
) -> SlidingEquations:
    """The whole drive, whose belt slides on one pulley (F16)."""
    scales, loops = steady.scales, drive.loops
    along, rim = frame.along[:, place], frame.surface[place]
    # The spans that end there move with the belt, not with the rim.
    strains = frame.strains - jnp.outer(along, rim)
    strains = jnp.concatenate([strains, along[:, None]], axis=1)
    gains = frame.gains[:, None] * strains
    mean = (gains + loops.preceding(gains))[place] / 2
    belt = scales.tension * scales.time / scales.length  # [N s/m]
    m0 = scales.tension * scales.time**2 / scales.length  # m_0 l [kg]

    def bordered(matrix: Array, own: Array) -> Array:
        return jnp.pad(matrix, ((0, 1), (0, 1))).at[-1, -1].set(own)

    stiffness = bordered(frame.stiffness, jnp.zeros(()))
    return SlidingEquations(
        mass=bordered(frame.mass, model.mass / m0),
        damping=bordered(frame.damping, model.damping / belt),
        stiffness=stiffness + strains.T @ (frame.work[:, None] * strains),
        sliding=jnp.append(-rim, 1.0),
        tension=sense * mean,
        unit=belt,
        time=scales.time,
    )


def sliding_at(
    drive: Drive, steady: SteadyState, place: Int[Array, ""]
) -> tuple[SlidingEquations | None, FrictionModel]:
    """Equations of the whole drive whose belt slides on one pulley, and the belt on its arc."""
    arcs, frame = arc_models(drive, steady), drive_frame(drive, steady)
    model, sense = jax.tree.map(lambda x: x[place], arcs)
    if frame is None:
        return None, model
    return _equations(drive, steady, frame, model, sense, place), model


def _on_one(
    drive: Drive,
    steady: SteadyState,
    frame: _Frame | None,
    arcs: SlidingArcs,
    place: Int[Array, ""],
    sliding_speed: Float[Array, ""] | None,
) -> SlipStability:
    model, sense = jax.tree.map(lambda x: x[place], arcs)
    rests = succeeded(steady.result)
    speed = jnp.ones(()) if sliding_speed is None else sliding_speed
    good = usable(model) & (speed > 0) & jnp.isfinite(speed) & (model.damping > 0)
    model, speed = sound(model, speed, rests & good)
    limit = onset(model)
    at = limit.speed if sliding_speed is None else speed
    at = jnp.where(jnp.isfinite(at), at, 0.0)
    stiffness = model.effective_stiffness(at)
    equations = None
    if frame is not None:
        equations = _equations(drive, steady, frame, model, sense, place)
    result = first_failure(
        (~rests, steady.result),
        (~good, RESULTS.numbers_unusable),
        (model.curve.steepness >= 0, RESULTS.no_negative_slope),
        (beyond_stick(model, limit.speed), RESULTS.onset_beyond_stick),
    )
    needed = limit.critical_damping
    if sliding_speed is not None:
        needed = jnp.maximum(-model.slope(at), 0.0)
    found = SlipStability(
        sliding_speed=at,
        onset_speed=limit.speed,
        fold_speed=fold(model),
        squeal_frequency=jnp.sqrt(stiffness / model.mass),
        growth=-(model.damping + model.slope(at)) / (2 * model.mass),
        critical_damping=needed,
        runaway_rate=_runaway_rate(drive, steady, model, at, place),
        model=model,
        equations=equations,
        steady=steady,
        result=result,
    )
    works = rests & good
    numbers = [
        name for name in vars(found) if name not in ("model", "equations", "steady", "result")
    ]
    kept = {name: jnp.where(works, getattr(found, name), 0.0) for name in numbers}
    found = eqx.tree_at(
        lambda f: [getattr(f, name) for name in numbers], found, list(kept.values())
    )
    return frozen_where_failed(found, failure_of(result))


def _runaway_rate(
    drive: Drive,
    steady: SteadyState,
    model: FrictionModel,
    v: Float[Array, ""],
    place: Int[Array, ""],
) -> Float[Array, ""]:
    """Rate of a pulley of constant torque, whose belt follows at once (F18)."""
    g, scales = steady.groups, steady.scales
    if g.rotor_inertias is None:
        return jnp.zeros(())
    turns = g.turning[place]
    inertia = (turns @ g.rotor_inertias) * scales.tension * scales.length * scales.time**2
    drag = (turns @ g.rotor_damping @ turns) * scales.tension * scales.length * scales.time
    # tanh(mu w/2) sigma (k_in - k_out) is -n_x phi.
    yielding = 1 - model.gain * model.phi(v) / model.stiffness
    r = drive.radii[place]
    held = jnp.sum(turns * g.held_rotor)  # the driver's own speed is given
    return (1 - held) * (-(r**2) * model.slope(v) / yielding - drag) / inertia


class Tracked(NamedTuple):
    """Eigenvalues of a whole drive, and the pair that squeals."""

    values: Complex[np.ndarray, " states"]  # [1/s]
    squeal: complex  # [1/s]


def eigenvalues_at(
    found: SlipStability, v: Float[Array, ""] | float, near: complex | None = None
) -> Tracked:
    """Eigenvalues of the whole drive at a sliding speed, on the host.

    The pair that squeals is the one nearest to that of a neighboring speed, or to that of the arc
    alone. Raises `ValueError` where an inertia is missing.
    """
    if found.equations is None:
        raise ValueError("SlipStability.eigenvalues: an inertia is missing; the drive has none.")
    C, K = (np.asarray(x) for x in matrices_at(found.equations, found.model, as_real(v)))
    M, unit = np.asarray(found.equations.mass), np.eye(len(C))
    states = np.block(
        [[np.zeros_like(unit), unit], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]]
    )
    values = np.linalg.eigvals(states) / float(found.equations.time)
    target = 1j * float(found.squeal_frequency) if near is None else near
    return Tracked(values, complex(values[np.argmin(np.abs(values - target))]))


@boundary_jit
def matrices_at(
    equations: SlidingEquations, model: FrictionModel, v: Float[Array, ""]
) -> tuple[Float[Array, "size size"], Float[Array, "size size"]]:
    """Damping and stiffness of a whole drive at a sliding speed."""
    return equations.at(model, v)


@boundary_jit
def growth_over_speed(
    model: FrictionModel, speeds: Float[Array, " speeds"]
) -> Float[Array, "pulleys speeds"]:
    """Growth of the oscillation on each arc at sliding speeds [m/s]."""

    def at(one: FrictionModel, v: Float[Array, ""]) -> Float[Array, ""]:
        return -(one.damping + one.slope(v)) / (2 * one.mass)

    return jax.vmap(lambda one: jax.vmap(lambda v: at(one, v))(speeds))(model)
