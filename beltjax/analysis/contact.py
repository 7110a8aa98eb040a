"""Contact mechanics: where the belt touches, adheres and slips (chapter 5)."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from beltjax.analysis.installed import free_positions, held, installed_by_tension
from beltjax.analysis.reference import LARGEST_STRAIN, resting
from beltjax.analysis.string_belts import belts_of_the_string, each_or_single
from beltjax.compiling.batched_loops import in_lanes_of
from beltjax.compiling.quick import boundary_jit
from beltjax.drive.assembly import Assembly, usable_assembly
from beltjax.drive.canonical import canonical
from beltjax.drive.components import as_real, concrete
from beltjax.drive.contact_groups import ContactGroups, TravelOrder, contact_groups
from beltjax.drive.groups import Scales
from beltjax.drive.installation import (
    AdjustedToMark,
    AdjustedToTension,
    BeltGiven,
    Preloaded,
    TensionGiven,
)
from beltjax.drive.layout import Layout, layout
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.readable import Readable
from beltjax.drive.system import Drive
from beltjax.numerics.derivative_rules import differentiated_once
from beltjax.physics import contact as physics
from beltjax.physics import contact_search as search
from beltjax.physics.belt_law import AbstractBeltLaw, find_belt_law
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
    succeeded,
)

Law = str | AbstractBeltLaw
_NO_SLIP = (
    "is of a toothed belt, which does not slip: contact mechanics adds nothing to geometry and "
    "tensions; `beltjax analyze` and `bj.steady_state` give them"
)
_OF_OTHERS = (
    ". Belts that share shafts are found together, and none can be left out: for the others "
    "describe a drive without this belt, with its torque on the pulleys that share its shafts"
)
_SLIPPING = 1e-9  # adhesion below minus this is gross slip [rad]
# Where a search ends without a belt, at the last step of load (1/64) that had one:
_BARE = 0.05  # of the tension at rest: a least P at a contact below it was about to be lost
_NARROW = 0.02  # a wrap below it was about to vanish [rad]


class ContactState(Readable):
    """Belts and pulleys in contact, in listed order; a span's start is at its first listed pulley.

    Angles of spans are inclinations of the belt going from start to end, from the line of
    centers, positive towards the outside of the loop. What belongs to a belt is a single number
    where there is one belt, and has an entry for each where there are several.
    """

    wraps: Float[Array, " pulleys"]  # [rad]; 0 where the belt touches at one point
    slips: Float[Array, " pulleys"]  # arcs of slip, up to where the belt leaves [rad]
    adhesions: Float[Array, " pulleys"]  # wrap less slip [rad]; negative: not physical
    moments: Float[Array, " pulleys"]  # taken from the belt, the driver's negative [N m]
    pulley_speeds: Float[Array, " pulleys"]  # [rad/s], magnitudes
    contact_curvatures: Float[Array, " pulleys"]  # of the belt on each pulley [1/m]
    span_lengths: Float[Array, " spans"]  # [m]
    unstretched_span_lengths: Float[Array, " spans"]  # [m]
    tensions: Float[Array, "spans 3"]  # at start, half the arc length and end [N]
    speeds: Float[Array, "spans 2"]  # of the belt, at start and end [m/s]
    angles: Float[Array, "spans 2"]  # at start and end [rad]
    unstretched_length: Float[Array, "*belts"]  # L0 [m]
    unstretched_speed: Float[Array, "*belts"]  # V_ref [m/s]
    mass_flow: Float[Array, "*belts"]  # G [kg/s]
    efficiency: Float[Array, ""]  # power delivered over power taken up
    driver_moment: Float[Array, ""]  # that its shaft gives to all belts, magnitude [N m]
    torque_factor: Float[Array, ""]  # on the operating point's torques; 1 unless they were scaled
    coordinates: Float[Array, " coordinates"]  # from the drawn positions [rad] or [m]
    installed: Float[Array, " coordinates"]  # at rest without torques
    at_stop: Float[Array, " coordinates"]  # -1 at the least, 1 at the greatest coordinate, else 0
    arm_angle: Float[Array, ""] | None  # direction of a single arm [rad]
    free_angle: Float[Array, ""] | None  # with its spring relaxed
    order: TravelOrder  # of what is listed, as the belts meet it
    forward: Bool[Array, " spans"]  # whether the belt runs in the listed order
    inside_left: Bool[Array, " spans"]  # whether the loop's inside is left of the running belt
    model: physics.ContactModel  # in the units of `scales`, along the belts' travel
    solved: search.Solved
    scales: Scales
    error: Float[Array, ""]  # residual of the equations before the last Newton step: an upper bound
    found: Bool[Array, ""]  # whether its numbers are those of a state, be it not physical
    result: RESULTS
    stats: dict[str, Array]

    @property
    def feasible(self) -> Bool[Array, ""]:
        """Whether the state was found and is physical."""
        return succeeded(self.result)


def contact_state(
    drive: Drive, point: OperatingPoint, *, law: Law = "kong", throw: bool = True
) -> ContactState:
    """The running belts on their pulleys: contact points, arcs of slip and adhesion, tensions.

    The model has belt inertia, bending stiffness, creep and large rotations: Kong (2003), chapter
    5, for any number of pulleys on either face, any tensioners and any belts that shafts join;
    docs/theory/contact.md, (C1) to (C26).
    `installation.tension` is the mean over the spans of the tension at half their length, at
    rest without torques; with `tension_of="string"` it is the tension of the same belt as a
    string. `law` is a belt law or the name of one: `"kong"` is T = EA e, `"hyperelastic"` is
    EA e = T + EI kappa^2/2, under which power in equals power out and friction; `@bj.belt_law`
    adds others.

    A body may stand at a stop. A state that was found but is not physical (`gross_slip`,
    `wrap_vanished`, or an arm turned to where `layout` fails) keeps its values and derivatives
    with `throw=False`.
    `belt_too_stiff`, `contact_pressure_lost`, `contact_not_found`, and the results of the drawn
    layout and of the numbers themselves leave finite placeholders with zero derivatives. Second
    derivatives are NaN where the tension is given.

    Args:
        drive: a drive of one belt or several.
        point: speeds and torques.
        law: the belt law, or its name.
        throw: raise where the result is a failure.

    Returns:
        Contact angles, tensions, speeds and efficiency, in SI units and listed order.

    Raises:
        KeyError: a torque is given for a pulley that is not there.
        ValueError: a pulley with torque has no friction, `mass_flow` is given for several belts,
            a belt is toothed, or `law` is unknown.
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/two_pulley_table_5_1.toml")
        >>> state = bj.contact_state(drive, point)
        >>> state.wraps, state.slips, state.efficiency  # [rad], [rad], 1
    """
    return _contact(drive, point, law, False, throw)


def maximum_moment(
    drive: Drive, point: OperatingPoint, *, law: Law = "kong", throw: bool = True
) -> ContactState:
    """`contact_state` under the largest torques, at which a first pulley slips over its whole arc.

    All torques are scaled by one `torque_factor`. Two pulleys need no torque given: it acts on the
    one that does not drive. The results are those of `contact_state` and `no_torque_to_scale`.
    docs/contact.md.

    Args:
        drive: a drive of one belt or several.
        point: speeds, and torques whose proportion is kept.
        law: the belt law, as in `contact_state`.
        throw: raise where the result is a failure.

    Returns:
        The state under the largest torques, in SI units and listed order.

    Raises:
        KeyError: a torque is given for a pulley that is not there.
        ValueError: a pulley with torque has no friction, `mass_flow` is given for several belts,
            a belt is toothed, or `law` is unknown.
        AnalysisError: the result is a failure, and `throw` is set.
    """
    return _contact(drive, point, law, True, throw)


def _contact(
    drive: Drive, point: OperatingPoint, law: Law, maximum: bool, throw: bool
) -> ContactState:
    question = contact_question(law, maximum)
    unmet = unmet_need(drive, point, maximum)
    if unmet is not None:
        raise ValueError(f"{unmet.key} {unmet.message}.")
    # The law and the question are data, so that one compiled program answers them all.
    found = contact_solution(*canonical(drive, point), *question)
    return raise_unless_successful(found, found.result, throw)


class UnmetNeed(NamedTuple):
    """What contact mechanics cannot do without, by its key in a drive file."""

    key: str
    message: str


def unmet_need(drive: Drive, point: OperatingPoint, maximum: bool) -> UnmetNeed | None:
    """What keeps a drive from being asked for contact; None where nothing does."""
    if len(drive.belts) > 1 and point.mass_flow is not None:
        message = "is that of a single belt; give each belt's mass_per_length alone"
        return UnmetNeed("operation.mass_flow", message)
    toothed = next((belt.name for belt in drive.belts if belt.pitch is not None), None)
    if toothed is not None:
        single = len(drive.belts) == 1
        key = "belt.pitch" if single else f"belt.{toothed}.pitch"
        return UnmetNeed(key, _NO_SLIP if single else _NO_SLIP + _OF_OTHERS)
    bare = without_friction(drive, point, maximum)
    if bare is not None:
        message = "is missing; this pulley has torque, which friction holds"
        return UnmetNeed(f"pulley.{bare}.friction", message)
    return None


def without_friction(drive: Drive, point: OperatingPoint, maximum: bool) -> str | None:
    """Name of a pulley that has torque, the driver too, and no friction to hold it."""

    def turned(name: str) -> bool:
        if name in point.load:
            return True
        torque = concrete(point.torque.get(name, jnp.zeros(())))
        # One that is traced may be anything.
        return torque is None or bool(np.any(torque))

    alone = len(drive.pulleys) == 2 and maximum
    driven = any(map(turned, point.names_of_takers))
    shared = [shaft for shaft in drive.shafts if len(shaft) > 1]
    for place, pulley in enumerate(drive.pulleys):
        drives = concrete(pulley.driver)
        driving = drives is None or bool(np.any(drives))
        # A shaft with several pulleys passes torque from belt to belt.
        passes = any(place in shaft for shaft in shared)
        loaded = driven and (driving or passes)
        if pulley.friction is None and (alone or loaded or turned(pulley.name)):
            return pulley.name
    return None


def contact_question(law: Law, maximum: bool) -> tuple[AbstractBeltLaw, Float[Array, ""]]:
    """The law and the question as `contact_solution` takes them.

    Raises `ValueError` for the name of a law that there is not.
    """
    return find_belt_law(law), as_real(maximum)


@boundary_jit
def contact_solution(
    drive: Drive, point: OperatingPoint, law: AbstractBeltLaw, maximum: Float[Array, ""]
) -> ContactState:
    """`contact_state` or `maximum_moment`, whose failures are in its result alone."""
    made, point, good, drawable = usable_assembly(drive, point)
    made, drawn = belts_of_the_string(made), made.drawn
    drive, start = made.drive, _installed(made)
    base = start.tensions[0]
    taken, scalable = scaled_torques(made, base, maximum)
    groups, scales = contact_groups(made, point, taken, base)
    model = contact_model(groups, law)
    rested, solved, installed = _solutions(made, groups, scales, model, start, maximum)
    loop, at_rest = solved.loop, start.tensions / base
    none = jnp.zeros_like(loop.C)
    strain = jnp.max(law.stretch(loop.C, none, loop.g, loop.data.EA)) - 1
    bare = jnp.any(jnp.exp(solved.unknown.level) < _BARE * at_rest)
    loaded = model.loaded > 0
    narrow = (maximum > 0) & jnp.any(loaded & (loop.wrap < _NARROW))
    moved = layout(drive, solved.unknown.q * groups.units, throw=False)
    missing = first_failure(
        (~good, RESULTS.numbers_unusable),
        (~succeeded(drawable), drawable),
        (~scalable, RESULTS.no_torque_to_scale),
        (~(solved.converged & rested) & _too_stiff(model, at_rest), RESULTS.belt_too_stiff),
        (~solved.converged & ~succeeded(start.result), start.result),
        (~solved.converged & bare, RESULTS.contact_pressure_lost),
        (~solved.converged & narrow, RESULTS.wrap_vanished),
        (~(solved.converged & rested), RESULTS.contact_not_found),
    )
    result = first_failure(
        (~succeeded(missing), missing),
        (~succeeded(moved.result), moved.result),
        (strain > LARGEST_STRAIN, RESULTS.belt_overstretched),
        (jnp.any(loaded & (loop.wrap <= 0)), RESULTS.wrap_vanished),
        (jnp.any(loaded & (loop.wrap - loop.slip < -_SLIPPING)), RESULTS.gross_slip),
    )
    found = succeeded(missing)
    in_si = installed * groups.units, drawn
    state = _state(made, groups, scales, model, solved, in_si, found, result)
    if not isinstance(drive.installation, BeltGiven):
        # The belts at rest and the running belts are found in one scan, in which JAX (0.10 to 0.12)
        # forgets custom rules when it differentiates forward over reverse.
        state = differentiated_once(state)
    return frozen_where_failed(state, missing)


class _Start(NamedTuple):
    """The numbers that the installation gives, and the start of a search."""

    tensions: Float[Array, " belts"]  # [N]
    coordinates: Float[Array, " coordinates"]  # from the drawn positions [rad] or [m]
    lengths: Float[Array, " belts"]  # of the unstretched belts [m]; 1 where tensions give them
    relaxed: Float[Array, " coordinates"]  # force of the springs at the drawn positions
    installed: Float[Array, " coordinates"]  # of the string at rest without torques
    result: RESULTS  # of the string


def _installed(made: Assembly) -> _Start:
    """The belts that the installation gives, and the start of a search for their contact."""
    rule, still, size = made.rule, made.still, made.EA.shape
    fixed = jax.lax.stop_gradient
    if isinstance(rule, TensionGiven | AdjustedToTension):
        place = installed_by_tension(made)
        at = fixed(jnp.where(place.converged, place.coordinates, 0.0))
        length = rule.belt_length if isinstance(rule, AdjustedToTension) else jnp.ones(())
        tensions, lengths = (jnp.broadcast_to(x, size) for x in (rule.tension, length))
        return _Start(tensions, at, lengths, still, at, RESULTS.successful)
    assert not isinstance(rule, Preloaded)  # the belts of its strings are given by now
    string = resting(made)
    rested = succeeded(string.result)
    at, bare = (
        fixed(jnp.where(rested, places, 0.0)) for places in (string.coordinates, string.installed)
    )
    lengths = jnp.broadcast_to(rule.belt_length, size)
    springs_of = held(made, lengths, free_positions(made, rule))
    tensions = fixed(string.base_tensions)
    return _Start(tensions, at, lengths, springs_of.relaxed, bare, string.result)


def scaled_torques(
    made: Assembly, tension: Float[Array, ""], maximum: Float[Array, ""]
) -> tuple[Float[Array, " pulleys"], Bool[Array, ""]]:
    """Torques taken from the belts [N m], and whether there are any to scale."""
    drive, taken = made.drive, made.driven.torques
    none = (maximum > 0) & jnp.all(taken == 0)
    if len(drive.pulleys) > 2:
        return taken, ~none
    # Any torque serves, since it is scaled.
    pull = 0.5 * jax.lax.stop_gradient(tension) * (1 - 2 * drive.drives)
    return jnp.where(none, pull * drive.radii, taken), jnp.array(True)


def contact_model(groups: ContactGroups, law: AbstractBeltLaw) -> physics.ContactModel:
    """The groups in the letters of the source."""
    motion = physics.BeltMotion(
        groups.masses, groups.belt_speed, groups.driver_speed, groups.mass_flow
    )
    return physics.ContactModel(
        EI=groups.bendings,
        EA=groups.stretches,
        law=law,
        loops=groups.loops,
        x=groups.centers[:, 0],
        y=groups.centers[:, 1],
        rho=groups.radii,
        mu=groups.friction,
        pull=groups.pulls,
        driving=groups.driving,
        gives=groups.gives,
        gearing=groups.gearing,
        loaded=jax.lax.stop_gradient((groups.pulls != 0).astype(float)),
        bodies=groups.bodies,
        housed=groups.housed,
        K=groups.stiffness,
        together=groups.springs.together,
        floating=groups.springs.floating,
        first=groups.springs.first,
        outside=groups.outside,
        motion=motion,
    )


def _solutions(
    made: Assembly,
    groups: ContactGroups,
    scales: Scales,
    model: physics.ContactModel,
    start: _Start,
    maximum: Float[Array, ""],
) -> tuple[Bool[Array, ""], search.Solved, Float[Array, " coordinates"]]:
    """Whether the belts rest, the running belts, and where the bodies are installed."""
    rule, units = made.rule, groups.units
    one, zero, none = jnp.ones(()), jnp.zeros(()), jnp.zeros_like(units)
    tensions = start.tensions / scales.tension
    fixed = jax.lax.stop_gradient
    widest = jnp.max(jnp.abs(jnp.cumsum(model.pull)))
    half = jnp.log(0.5 / jnp.where(widest > 0, widest, 1.0))
    bolted = fixed(model.bodies.locked)
    relaxed = start.relaxed * units / scales.energy
    # Without a search at rest bolted bodies stand as drawn.
    holding = search.HeldBelt(start.lengths / scales.length, relaxed, none)
    begin = search.likely(
        tensions, start.coordinates / units, jnp.where(maximum > 0, half, 0.0), model
    )
    unmarked = jnp.zeros_like(model.K)
    running = search.Task(zero, zero, maximum, tensions, holding, bolted, none, unmarked)
    if isinstance(rule, BeltGiven):
        return jnp.array(True), search.solve(model, running, begin, begin), start.installed / units
    still = search.at_rest(model)
    unbent = search.likely(tensions, start.installed / units, zero, still)
    rest = running._replace(maximum=zero)
    if isinstance(rule, AdjustedToMark):
        adjusted, marked = map(fixed, (rule.adjusted, rule.marked))
        rest = rest._replace(
            marks=adjusted[:, None] * (marked - adjusted),
            held=holding._replace(at=adjusted * rule.mark / units),
        )
    else:
        adjusted = fixed(getattr(rule, "adjusted", none))
        rest = rest._replace(resting=one, by_tension=one, adjusted=adjusted)
    stages = jax.tree.map(
        lambda a, b: jnp.stack([a, b]), (still, rest, unbent), (model, running, begin)
    )

    # Both tasks use one compiled search in turn: the first finds the belt for the second.
    def stage(
        before: tuple[search.HeldBelt, physics.Unknown],
        now: tuple[physics.ContactModel, search.Task, physics.Unknown],
    ) -> tuple[tuple[search.HeldBelt, physics.Unknown], search.Solved]:
        kept, origin = before
        model, task, start = now
        # Where torques are scaled to the largest, the belt without torques is no origin.
        origin = jax.tree.map(lambda a, b: jnp.where(task.maximum > 0, a, b), start, origin)
        first = (jnp.sum(task.marks**2) > 0) | (task.resting > 0)
        kept = jax.tree.map(lambda a, b: jnp.where(first, a, b), task.held, kept)
        solved = search.solve(model, task._replace(held=kept), start, origin)
        return (solved.held, jax.lax.stop_gradient(solved.unknown)), solved

    first = in_lanes_of(model.EI[0], (rest.held, unbent))
    _, both = jax.lax.scan(stage, first, stages)
    rested, run = (jax.tree.map(lambda x, k=k: x[k], both) for k in (0, 1))
    return rested.converged, run, rested.unknown.q


def _too_stiff(model: physics.ContactModel, tensions: Float[Array, " belts"]) -> Bool[Array, ""]:
    """Whether the tension of a belt at rest is below EI/(2 R^2).

    A torque-free pulley then touches the belt at one point at most, also at rest.
    """
    spread = model.loops.spread
    return jnp.any(spread(model.EI) / model.rho**2 / 2 >= spread(tensions))


def _state(
    made: Assembly,
    groups: ContactGroups,
    scales: Scales,
    model: physics.ContactModel,
    solved: search.Solved,
    in_si: tuple[Float[Array, " coordinates"], Layout],
    found: Bool[Array, ""],
    result: RESULTS,
) -> ContactState:
    """The solution in SI and listed order."""
    loop, force, length, drive = solved.loop, scales.tension, scales.length, made.drive
    travel = jax.lax.stop_gradient(made.driven.travel)
    order, factor = TravelOrder.of(made.loops, travel), jnp.exp(solved.unknown.scale)
    unit_of_speed = length / scales.time
    # A belt's travel is the same all along it, so that its order does not matter here.
    listed = travel[:, None] > 0
    T, V, outward = (
        jnp.where(listed, ends, ends[:, ::-1])[order.spans]
        for ends in _ends(drive.senses, loop, model)
    )
    surface = physics.speed(loop.P_in, loop.data.EI * loop.kap**2 / 2, loop, model)
    taken = (factor * model.pull)[order.pulleys] * force * drive.radii
    installed, drawn = in_si
    single = len(drive.tensioners) == 1
    coordinates = solved.unknown.q * groups.units
    stiff = jnp.where(model.K > 0, model.K, 1.0)
    return ContactState(
        wraps=loop.touching[order.pulleys],
        slips=loop.slip[order.pulleys],
        adhesions=(loop.touching - loop.slip)[order.pulleys],
        moments=taken,
        pulley_speeds=surface[order.pulleys] * unit_of_speed / drive.radii,
        contact_curvatures=jnp.abs(loop.kap[order.pulleys]) / length,
        span_lengths=loop.spans.L[order.spans] * length,
        unstretched_span_lengths=loop.unstretched[order.spans] * length,
        tensions=T * force,
        speeds=V[:, ::2] * unit_of_speed,
        angles=outward[:, ::2],
        unstretched_length=each_or_single(solved.held.L0 * length),
        unstretched_speed=each_or_single(loop.V_ref[model.loops.starts] * unit_of_speed),
        mass_flow=each_or_single(physics.mass_flow(loop, model) * force / unit_of_speed),
        efficiency=physics.efficiency(loop, model),
        driver_moment=jnp.abs(made.driven.driving @ taken),
        torque_factor=factor,
        coordinates=coordinates,
        installed=installed,
        at_stop=search.at_stop(solved, model),
        arm_angle=drawn.arm_angle + coordinates[0] if single else None,
        free_angle=drawn.arm_angle + solved.held.relaxed[0] / stiff[0, 0] if single else None,
        order=order,
        forward=travel > 0,
        inside_left=drive.senses * travel > 0,
        model=model,
        solved=solved,
        scales=scales,
        error=solved.residual,
        found=found,
        result=result,
        stats={"steps": solved.steps, "load": solved.load},
    )


def _ends(
    senses: Float[Array, " spans"], loop: physics.Loop, model: physics.ContactModel
) -> tuple[Float[Array, "spans 3"], Float[Array, "spans 3"], Float[Array, "spans 3"]]:
    """Tension, speed and outward inclination at the start, middle and end of each span."""
    bent, following = loop.data.EI * loop.kap**2 / 2, model.loops.following
    P = jnp.stack([loop.P_out, loop.spans.P_mid, following(loop.P_in)], axis=1)
    bents = jnp.stack([bent, loop.C - loop.spans.P_mid, following(bent)], axis=1)
    start, end = physics.inclinations(loop.spans, model)
    outward = -senses[:, None] * jnp.stack([start, 0 * start, end], axis=1)
    column = np.s_[:, None]
    T = physics.tension(P, bents, loop, model, column)
    return T, physics.speed(P, bents, loop, model, column), outward
