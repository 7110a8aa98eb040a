"""Steady state of a running drive and its belt-pulley coupling (chapter 3)."""

import abc
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from beltjax.analysis.reference import (
    LARGEST_STRAIN,
    ReferenceState,
    RunningString,
    resting,
    running_string,
)
from beltjax.compiling.quick import boundary_jit, usual_promotion
from beltjax.drive.assembly import Assembly, assembled
from beltjax.drive.canonical import canonical
from beltjax.drive.groups import Groups, Scales, groups_and_scales
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.placeholders import harmless, numbers_are_usable
from beltjax.drive.readable import Readable
from beltjax.drive.system import Drive
from beltjax.physics import steady as physics
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
    succeeded,
)

FARTHEST = 0.1  # motion [rad], or in mean spans, above which linear equations are inaccurate
STIFFEST = 0.15  # sqrt(EI/T)/radius above which fixed contact points are inaccurate


class AbstractSteadyMethod(eqx.Module):
    """A way to find the steady state and to describe the spans' shapes."""

    @abc.abstractmethod
    def solve(self, model: physics.SteadyModel) -> physics.SteadySolution:
        """Tension of each belt and the coordinates."""

    @abc.abstractmethod
    def coupling(
        self, model: physics.SteadyModel, solved: physics.SteadySolution
    ) -> Float[Array, " spans"]:
        """Gamma_i of the solution's shapes."""

    @abc.abstractmethod
    def deflection(
        self,
        model: physics.SteadyModel,
        q: physics.Coordinates,
        Q: physics.Spans,
        i: physics.Index,
        x: Array,
    ) -> Array:
        """w_i(x), both over the span's own length."""


class Exact(AbstractSteadyMethod):
    """The nonlinear model, one scalar equation: docs/theory/steady_state.md, (S4) to (S10)."""

    def solve(self, model: physics.SteadyModel) -> physics.SteadySolution:
        """Tensions from (3.41), with (3.42) and (3.43) solved for each trial T."""
        return physics.exact(model)

    def coupling(
        self, model: physics.SteadyModel, solved: physics.SteadySolution
    ) -> Float[Array, " spans"]:
        """Gamma_i in closed form."""
        return physics.coupling(model, solved.Q)

    def deflection(
        self,
        model: physics.SteadyModel,
        q: physics.Coordinates,
        Q: physics.Spans,
        i: physics.Index,
        x: Array,
    ) -> Array:
        """w_i(x) in closed form."""
        return physics.deflection(model, q, Q, i, x)


class Perturbation(AbstractSteadyMethod):
    """Leading order for small bending stiffness, (3.60)-(3.92): string and boundary layers."""

    def solve(self, model: physics.SteadyModel) -> physics.SteadySolution:
        """T0 and q0 of the string."""
        return physics.string(model)

    def coupling(
        self, model: physics.SteadyModel, solved: physics.SteadySolution
    ) -> Float[Array, " spans"]:
        """Gamma_i to leading order in eps."""
        return physics.leading_coupling(model, solved.Q)

    def deflection(
        self,
        model: physics.SteadyModel,
        q: physics.Coordinates,
        Q: physics.Spans,
        i: physics.Index,
        x: Array,
    ) -> Array:
        """w_i(x) by the composite expansion."""
        return physics.leading_deflection(model, q, Q, i, x)


class Linear(Exact):
    """The linearized model (3.57)-(3.59), for comparison: it is not accurate enough for design."""

    def solve(self, model: physics.SteadyModel) -> physics.SteadySolution:
        """Tensions and coordinates from linear equations."""
        return physics.linear(model)


def of_single(motions: Array) -> Array:
    """The motion [...] of the only tensioner from `motions` [..., tensioners]; 0 without one.

    Raises `ValueError` where there are several tensioners.
    """
    if motions.shape[-1] > 1:
        raise ValueError("There are several tensioners: read the numbers of each.")
    return jnp.sum(motions, axis=-1)


class SteadyState(Readable):
    """Steady shape and tensions of a running drive.

    `tension_change` is over P0, the tension of the first belt at rest without torques
    (`reference.base_tension`).
    """

    coupling: Float[Array, " spans"]  # Gamma_i
    tension_change: Float[
        Array, "*belts"
    ]  # T, gained by every span, over P0; of several belts each. See `running_tensions`.
    coordinate_change: Float[Array, " coordinates"]  # from the reference state [rad] or [m]
    # The change from the state in which `groups` are taken: the reference state, or under
    # `stretching_arcs` the running string, from whose spans deflections are then counted.
    deviation: Float[Array, " coordinates"]
    # P_i + T P0 [N]; under `stretching_arcs` torques let the spans gain slightly different
    # tensions, whose mean over the belt is then T.
    running_tensions: Float[Array, " spans"]
    effective_tensions: Float[Array, " spans"]  # Q_i = P_i - m c^2 + T, over P0
    # eta of the string at rest (3.95), 0 without a tensioner; of several belts the matrix whose
    # entry [b, c] says what the speed of belt c does to the tension of belt b.
    effectiveness: Float[Array, "*belts"]
    at_stop: Float[Array, " coordinates"]  # -1 at the least, 1 at the greatest coordinate, else 0
    stop_reactions: Float[Array, " coordinates"]  # forces of those stops [N m] or [N]
    # sqrt(EI/T)/radius, with the smaller effective tension T beside the pulley: the reach of the
    # belt's bending over the pulley's size. Above `STIFFEST` the contact points of a string, which
    # this state assumes, are inaccurate, and so are tensions and Gamma.
    stiffness_ratios: Float[Array, " pulleys"]
    groups: Groups
    scales: Scales
    reference: ReferenceState
    error: Float[Array, ""]  # residual of (3.41) before the last Newton step: an upper bound
    result: RESULTS
    warning: RESULTS  # why a success may be inaccurate; `successful` where there is no such reason
    stats: dict[str, Array]
    method: AbstractSteadyMethod

    @property
    def arm_rotation(self) -> Float[Array, ""]:
        """theta_t of a single arm from the reference state [rad], counterclockwise; 0 without one.

        Raises `ValueError` where there are several tensioners.
        """
        return of_single(self.coordinate_change)

    @property
    def hub_loads(self) -> Float[Array, "pulleys 2"]:
        """Force of the running belt on the hub of each pulley [N], x and y.

        The part m c^2 of a tension turns the belt round, and does not reach the hub.
        """
        pulls = self.effective_tensions * self.scales.tension
        pulls = pulls[:, None] * self.reference.layout.directions
        return pulls - self.groups.loops.preceding(pulls)

    @property
    def slip_exponents(self) -> Float[Array, " pulleys"]:
        """|ln| of the ratio of the effective tensions beside each pulley: friction times wrap holds
        no more (Euler and Eytelwein).
        """
        before = self.groups.loops.preceding(self.effective_tensions)
        return jnp.abs(jnp.log(self.effective_tensions / before))

    @usual_promotion
    def deflection(self, i: int, x: Array) -> Array:
        """Deflection of span i at `x`, positive towards the inside of the loop.

        Both are fractions of the span's own length: x runs from 0 at the span's first listed
        pulley to 1 at its second. Multiply by `reference.layout.span_lengths[i]` for meters.
        Raises `IndexError` for a span that is not there.
        """
        if not 0 <= i < len(self.coupling):
            raise IndexError(f"span {i} of {len(self.coupling)}: spans count from 0.")
        q, Q = self.deviation / self.groups.units, self.effective_tensions
        return self.method.deflection(steady_model(self.groups), q, Q, i, jnp.asarray(x))


def steady_state(
    drive: Drive,
    point: OperatingPoint,
    method: AbstractSteadyMethod | None = None,
    *,
    throw: bool = True,
) -> SteadyState:
    """Steady shape and tensions of a running drive with bending-stiff belt spans.

    The model assumes small slopes, a uniform belt speed and no creep on the pulleys. Kong (2003),
    eqs. (3.41)-(3.43) for any number of pulleys, tensioners and belts; docs/theory/steady_state.md.

    The result is that of `reference_state` where it failed, `span_slack` where the running belt
    cannot keep every span tight, `belt_overstretched` (strain above a tenth), `tensioner_unstable`,
    `steady_state_not_found` or, of `Collocation`, `mesh_exhausted`. With `throw=False` read
    `.result`: a failed lane of a batch holds finite placeholders with zero derivatives, and does
    not affect its neighbors. A success may carry a `.warning`: `belt_stiff_on_pulley`,
    `tensioner_moves_far` or `load_outside_table`.

    Args:
        drive: the drive.
        point: speeds and torques.
        method: `Exact()` unless given, `Collocation()`, or for comparison `Perturbation()` or
            `Linear()`.
        throw: raise where the result is a failure.

    Returns:
        The state, with the coupling Gamma of shape [spans], tensions and the reference state.

    Raises:
        KeyError: a torque is given for a pulley that is not there.
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> steady = bj.steady_state(drive, point)
        >>> steady.coupling, steady.running_tensions  # Gamma and [N], per span
    """
    method = Exact() if method is None else method
    steady = _steady_state(*canonical(drive, point), method)
    return raise_unless_successful(steady, steady.result, throw)


@boundary_jit
def _steady_state(drive: Drive, point: OperatingPoint, method: AbstractSteadyMethod) -> SteadyState:
    good = numbers_are_usable(drive, point)
    drive, point = harmless(drive, point, good)
    made = assembled(drive, point)
    loops, reference = made.loops, resting(made)
    rested = succeeded(reference.result)
    begin = _beginning(made, reference)
    groups, scales, model, string = begin.groups, begin.scales, begin.model, begin.string
    solved = method.solve(model)
    strain = (groups.tensions + loops.spread(solved.T)) / loops.spread(groups.stretches)
    result = first_failure(
        (~good, RESULTS.numbers_unusable),
        (~rested, reference.result),
        # A string whose bodies snap away is not found either.
        (solved.unstable, RESULTS.tensioner_unstable),
        *([] if string is None else [(~succeeded(string.result), string.result)]),
        (solved.slack, RESULTS.span_slack),
        (~solved.converged, RESULTS.steady_state_not_found),
        (jnp.asarray(solved.unresolved), RESULTS.mesh_exhausted),
        (jnp.max(strain) > LARGEST_STRAIN, RESULTS.belt_overstretched),
    )
    runs = succeeded(result)
    Q = jnp.where(runs, solved.Q, 1.0)
    weaker = jnp.minimum(Q, loops.preceding(Q))
    reach = loops.spread(groups.bendings) / jnp.sqrt(weaker)
    stiffness_ratios = reach / groups.radius_ratios
    stiff = runs & (jnp.max(stiffness_ratios) > STIFFEST)
    far = runs & jnp.any(jnp.abs(solved.q) > FARTHEST)
    off = runs & jnp.any(made.driven.outside)
    # A warning of loads costs nothing where there are none.
    beyond = [(off, RESULTS.load_outside_table)] * bool(point.load)
    gained = groups.tensions - begin.resting.P + loops.spread(solved.T)
    gained = jnp.where(runs, gained, 0.0)
    change = loops.sums(gained) / jnp.asarray(loops.sizes)
    deviation = jnp.where(runs, solved.q, 0.0) * groups.units
    moved = deviation
    if string is not None:
        way = string.layout.coordinates - reference.coordinates
        moved = moved + jnp.where(runs, way, 0.0)
    sprung = model.movable * (solved.held == 0)
    effectiveness = physics.effectiveness(begin.resting, jax.lax.stop_gradient(sprung))
    single = len(drive.belts) == 1
    steady = SteadyState(
        coupling=jnp.where(runs, method.coupling(model, solved), 0.0),
        tension_change=change[0] if single else change,
        coordinate_change=moved,
        deviation=deviation,
        running_tensions=reference.tensions + gained * scales.tension,
        effective_tensions=Q,
        effectiveness=jnp.where(rested, effectiveness[0, 0] if single else effectiveness, 0.0),
        at_stop=jnp.where(runs, solved.held, 0.0),
        stop_reactions=jnp.where(runs, solved.reaction, 0.0) * scales.energy / groups.units,
        stiffness_ratios=stiffness_ratios,
        groups=groups,
        scales=scales,
        reference=reference,
        error=solved.residual,
        result=result,
        warning=first_failure(
            (stiff, RESULTS.belt_stiff_on_pulley),
            (far, RESULTS.tensioner_moves_far),
            *beyond,
        ),
        stats={"steps": solved.steps, "reference_steps": reference.stats["steps"]},
        method=method,
    )
    return frozen_where_failed(steady, result)


class _Beginning(NamedTuple):
    """The state of strings from which the bending of the belts moves the drive."""

    groups: Groups
    scales: Scales
    model: physics.SteadyModel
    resting: physics.SteadyModel  # the model of the reference state
    string: RunningString | None  # None: the reference state


def _beginning(made: Assembly, reference: ReferenceState) -> _Beginning:
    """The reference state, or where arcs stretch the running string of exact statics."""
    rested = succeeded(reference.result)
    # The numbers of a drive that cannot rest have no meaning, but must stay finite.
    level = made.loops.spread(reference.base_tensions)

    def described(
        state: ReferenceState | RunningString, good: Bool[Array, ""]
    ) -> tuple[Groups, Scales]:
        tensions = jnp.where(good, state.tensions, level)
        base = reference.base_tension
        return groups_and_scales(made, state.layout, tensions, base, state.stop_reactions)

    groups, scales = described(reference, rested)
    resting_model = steady_model(groups)
    if not made.drive.model.stretching_arcs:
        return _Beginning(groups, scales, resting_model, resting_model, None)
    string = running_string(made, reference, resting_model.flux * scales.tension)
    found = succeeded(string.result)
    groups, scales = described(string, found)
    momentum = jnp.where(found, string.flux, 0.0) / scales.tension
    model = steady_model(groups)._replace(c2=momentum, flux=jnp.zeros_like(momentum))
    return _Beginning(groups, scales, model, resting_model, string)


def steady_model(groups: Groups) -> physics.SteadyModel:
    """The groups in the letters of the source."""
    g, loops = groups, groups.loops
    flux = loops.spread(g.masses * g.speeds**2)
    return physics.SteadyModel(
        eps=loops.spread(g.bendings),
        c2=flux,
        flux=flux,
        give=g.unstretched / g.stretches,
        belts=jnp.asarray(loops.members),
        P=g.tensions,
        lam=g.span_ratios,
        kap_s=g.curvature_start,
        kap_e=g.curvature_end,
        S=g.pulls,
        a=g.slopes,
        W0=g.lifts,
        H=g.curvatures,
        K=g.springs,
        movable=g.movable,
        lo=g.ways[:, 0],
        hi=g.ways[:, 1],
        rho=g.stop_forces,
    )
