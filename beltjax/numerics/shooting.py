"""Periodic orbits of systems with modes, by shooting through their events.

Newton's method for x(T) = x(0), with the variational equation along the steps. A step ends at an
event, where a disturbance changes by the saltation matrix (R. I. Leine and H. Nijmeijer, 2004).
A guard that falls through zero and rises again between two stages of a step is not seen.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float, Int

from beltjax.compiling.batched_loops import in_lanes_of
from beltjax.numerics.derivative_rules import without_derivative
from beltjax.numerics.hybrid import HybridSystem, Mode, State
from beltjax.numerics.radau import (
    LAGRANGE,
    NODES,
    WEIGHTS,
    Rates,
    Stages,
    factored,
    known_step,
    solved_step,
    stage_states,
    step_matrix,
    within,
)

Scalar = Float[Array, ""]
Square = Float[Array, "states states"]

EVENTS = 32  # in a period, at most
_ROUNDING = 1e-12  # below zero a guard has fallen
_MOST_TRIALS = 60  # for one event
_MOST_PERIODS = 40  # for one orbit
_SMALLEST_LOAD = 1 / 16
_ONE = 1e-6  # distance from 1 of a multiplier that is 1
_NEUTRAL = 1e-9  # part of the largest singular value below which a direction is free


class Periodic(NamedTuple):
    """A system with modes whose right side has a period."""

    system: HybridSystem
    period: Scalar
    # Directions in which the state may move from period to period without any other change.
    drifts: Float[Array, "states drifts"]


class Steps(NamedTuple):
    """The steps of a period in the order of time; those left over have no length."""

    start: Float[Array, " steps"]  # in periods
    end: Float[Array, " steps"]
    length: Float[Array, " steps"]  # of its polynomial, whose derivatives are not those of the end
    states: Float[Array, "steps states"]  # at the start
    gains: Float[Array, "steps 3 gains"]
    modes: Int[Array, "steps elements"]
    events: Int[Array, " steps"]  # guard that ends the step; -1: none


class Flow(NamedTuple):
    """A period from a state, and the evidence."""

    steps: Steps
    state: State  # at the end
    mode: Mode
    matrix: Square  # of a small disturbance
    # Least sine of the phase that a guard has at its event, of a wave with its slope and curvature.
    least: Scalar
    events: Int[Array, ""]
    solved: Bool[Array, ""]


class Trial(NamedTuple):
    """A step that may end at an event."""

    length: Scalar  # in periods
    low: Scalar  # without the event
    high: Scalar  # with it
    which: Int[Array, ""]
    gains: Stages
    solved: Bool[Array, ""]
    done: Bool[Array, ""]
    trials: Int[Array, ""]


def _in_mode(of: Periodic, mode: Mode) -> Rates:
    return Rates(lambda x, t: of.system.rate(x, t, mode), of.system.positions)


def _step_to_event(of: Periodic, x: State, start: Scalar, mode: Mode, length: Scalar) -> Trial:
    """A step of this length, or as far as the first event in it."""
    system, period, rates = of.system, of.period, _in_mode(of, mode)

    def guards(x: State, part: Scalar) -> Float[Array, " guards"]:
        return system.guards(x, part * period, mode)

    before = jnp.maximum(guards(x, start), 0.0)

    def crossing(values: Float[Array, "3 guards"]) -> tuple[Scalar, Int[Array, ""]]:
        """Part of the step at which the first guard falls, by straight lines, and which it is."""
        ends = jnp.concatenate([before[None], values])
        at = jnp.concatenate([jnp.zeros(1), jnp.asarray(NODES)])[:, None]
        fell = values < -_ROUNDING
        drop = jnp.where(fell, ends[:-1] - values, 1.0)
        part = jnp.clip(ends[:-1] / drop, 0.0, 1.0)
        place = jnp.where(fell, at[:-1] + part * (at[1:] - at[:-1]), jnp.inf)
        first = jnp.min(place, axis=0)
        return jnp.min(first), jnp.argmin(first)

    def body(trial: Trial) -> Trial:
        d = trial.length
        gains, solved = solved_step(rates, x, start * period, d * period)
        states = stage_states(system.positions, x, d * period, gains)
        values = jax.vmap(guards)(states, start + d * NODES)
        part, found = crossing(values)
        known = trial.which >= 0
        others = jnp.arange(values.shape[1]) != trial.which
        earlier = jnp.any(values[:2] < -_ROUNDING) | jnp.any((values[2] < -_ROUNDING) & others)
        anew = jnp.where(known, earlier, jnp.any(values < -_ROUNDING))
        which = jnp.where(anew, found, trial.which)
        # The step that ends where the guard is zero, by Newton's method between bounds.
        end = states[2]
        along = system.rate(end, (start + d) * period, mode) * period
        falling = jax.jvp(guards, (end, start + d), (along, jnp.ones(())))[1][which]
        value = values[2][which]
        passed = anew | (value < 0)
        low, high = jnp.where(passed, trial.low, d), jnp.where(passed, d, trial.high)
        step = d - value / jnp.where(falling < 0, falling, -1.0)
        inside = (falling < 0) & (step >= low) & (step <= high)
        newton = jnp.where(inside, step, (low + high) / 2)
        following = jnp.where(anew, jnp.clip(d * part, low, high), newton)
        close = known & ~anew & (jnp.abs(following - d) <= 1e-14)
        done = (which < 0) | close | (trial.trials >= _MOST_TRIALS) | ~solved
        return Trial(
            jnp.where(done, d, following), low, high, which, gains, solved, done, trial.trials + 1
        )

    count = len(x) - system.positions
    begin = Trial(
        length, jnp.zeros(()), length, jnp.array(-1), jnp.zeros((3, count)), jnp.array(True),
        jnp.array(False), jnp.array(0),
    )  # fmt: skip
    return jax.lax.while_loop(lambda trial: ~trial.done, body, in_lanes_of(x, begin))


class _Switch(NamedTuple):
    """What an event does."""

    state: State
    mode: Mode
    saltation: Square
    clear: Scalar  # as `Flow.least`


def _switch(of: Periodic, x: State, part: Scalar, mode: Mode, which: Int[Array, ""]) -> _Switch:
    """Pass an event."""
    system, t = of.system, part * of.period
    after, new = system.switched(x, t, mode, which)
    before, one = system.rate(x, t, mode), jnp.ones(())
    leaving = system.rate(after, t, new)

    def guard(x: State, t: Scalar) -> Scalar:
        return system.guards(x, t, mode)[which]

    def falling(x: State, t: Scalar) -> Scalar:
        return jax.jvp(guard, (x, t), (system.rate(x, t, mode), one))[1]

    normal = jax.jacfwd(guard)(x, t)
    rate, bend = jax.jvp(falling, (x, t), (before, one))
    falls = rate < 0
    jump = jnp.outer(leaving - before, normal / jnp.where(falls, rate, -1.0))
    matrix = jnp.eye(len(x)) + jnp.where(falls, jump, 0.0)
    size = jnp.hypot(rate, bend * of.period / (2 * jnp.pi))
    clear = jnp.where(falls, -rate / jnp.where(size > 0, size, 1.0), 0.0)
    return _Switch(after, new, matrix, clear)


def _begun(of: Periodic, x: State, mode: Mode, steps: int) -> Flow:
    """A period of which nothing has passed."""
    count, (size,), one = steps + EVENTS, x.shape, jnp.ones(())
    empty = Steps(
        start=jnp.ones(count),
        end=jnp.ones(count),
        length=jnp.zeros(count),
        states=jnp.zeros((count, size)),
        gains=jnp.zeros((count, 3, size - of.system.positions)),
        modes=jnp.zeros((count, len(mode)), int),
        events=jnp.full(count, -1),
    )
    return Flow(empty, x, mode, jnp.eye(size), jnp.inf * one, jnp.array(0), jnp.array(True))


def _period_from(of: Periodic, x: State, mode: Mode, steps: int) -> Flow:
    """A period of the motion from a state."""
    positions, one = of.system.positions, jnp.ones(())

    def body(state: tuple[Any, ...]) -> tuple[Any, ...]:
        start, grid, flow = state
        made, x, mode = flow.steps, flow.state, flow.mode
        target = (grid + 1) / steps
        trial = _step_to_event(of, x, start, mode, target - start)
        h, event = trial.length * of.period, trial.which >= 0
        end = jnp.where(event, start + trial.length, target)
        equations = factored(_in_mode(of, mode), x, start * of.period, h, trial.gains)
        matrix = step_matrix(equations, positions, h)
        at = stage_states(positions, x, h, trial.gains)[2]
        passed = jax.lax.cond(
            event,
            lambda: _switch(of, at, end, mode, trial.which),
            lambda: _Switch(at, mode, jnp.eye(len(x)), jnp.inf * one),
        )
        new = Steps(start, end, end - start, x, trial.gains, mode, trial.which)
        k = flow.events + grid
        flow = Flow(
            steps=jax.tree.map(lambda rows, row: rows.at[k].set(row), made, new),
            state=passed.state,
            mode=passed.mode,
            matrix=passed.saltation @ (matrix @ flow.matrix),
            least=jnp.minimum(flow.least, passed.clear),
            events=flow.events + event,
            solved=flow.solved & trial.solved,
        )
        return end, jnp.where(event, grid, grid + 1), flow

    def unfinished(state: tuple[Any, ...]) -> Bool[Array, ""]:
        _, grid, flow = state
        return (grid < steps) & flow.solved & (flow.events < EVENTS)

    start = jnp.zeros(()), jnp.array(0), _begun(of, x, mode, steps)
    _, _, flow = jax.lax.while_loop(unfinished, body, in_lanes_of(x, start))
    made = flow.steps
    left = jnp.arange(len(made.start))[:, None] >= steps + flow.events
    states = jnp.where(left, flow.state, made.states)
    return flow._replace(
        steps=made._replace(states=states, modes=jnp.where(left, flow.mode, made.modes))
    )


class _Closing(NamedTuple):
    """The search for a period that ends where it begins."""

    state: State
    mode: Mode
    flow: Flow
    inverse: Float[Array, "unknowns states"]
    drift: Float[Array, " drifts"]  # a period
    gap: Scalar  # over the size of the motion
    done: Bool[Array, ""]
    periods: Int[Array, ""]


def _inverse(of: Periodic, flow: Flow) -> Float[Array, "unknowns states"]:
    """What takes the change of the state over a period to corrections of its start and the drifts.

    The least corrections, where some are free: of a body that sticks its place is.
    """
    linear = jnp.concatenate([jnp.eye(len(flow.state)) - flow.matrix, of.drifts], axis=1)
    finite = jnp.where(jnp.all(jnp.isfinite(linear)), linear, 0.0)
    return jnp.linalg.pinv(finite, rtol=_NEUTRAL)


def _closed(of: Periodic, x: State, mode: Mode, steps: int, tol: float) -> _Closing:
    """The orbit near a state, by Newton's method; where that does not help, by waiting."""
    size = len(x)

    def body(at: _Closing) -> _Closing:
        x, mode = of.system.resumed(at.state, jnp.zeros(()), at.mode)
        flow = _period_from(of, x, mode, steps)
        inverse = _inverse(of, flow)
        step = inverse @ (flow.state - x)
        drift = step[size:]
        left = flow.state - x - of.drifts @ drift
        scale = jnp.max(jnp.linalg.norm(flow.steps.states, axis=1))
        gap = jnp.maximum(jnp.linalg.norm(left), jnp.linalg.norm(step[:size]))
        gap = gap / jnp.where(scale > 0, scale, 1.0)
        done = (gap <= tol) & jnp.all(flow.mode == mode) & flow.solved & (flow.events < EVENTS)
        # Where the corrections do not shrink the next period begins where this one ended.
        shrinks = (gap < 0.5 * at.gap) | (at.periods == 0)
        following = jnp.where(shrinks, x + step[:size], flow.state - of.drifts @ drift)
        return _Closing(
            state=jnp.where(done, x, following),
            mode=jnp.where(done, mode, flow.mode),
            flow=flow,
            inverse=inverse,
            drift=drift,
            gap=jnp.where(shrinks, gap, jnp.inf),
            done=done,
            periods=at.periods + 1,
        )

    def unfinished(at: _Closing) -> Bool[Array, ""]:
        return ~at.done & jnp.all(jnp.isfinite(at.state)) & (at.periods < _MOST_PERIODS)

    begin = _nothing(of, x, mode, steps)
    return jax.lax.while_loop(unfinished, body, in_lanes_of(x, begin))


def _nothing(of: Periodic, x: State, mode: Mode, steps: int) -> _Closing:
    """A search that has not begun."""
    size, drifts = of.drifts.shape
    return _Closing(
        state=x,
        mode=mode,
        flow=_begun(of, x, mode, steps),
        inverse=jnp.zeros((size + drifts, size)),
        drift=jnp.zeros(drifts),
        gap=jnp.array(jnp.inf),
        done=jnp.array(False),
        periods=jnp.array(0),
    )


class Trajectory(eqx.Module):
    """A period of an orbit, as the polynomials of its steps."""

    steps: Steps
    period: Scalar
    drifts: Float[Array, "states drifts"]
    drift: Float[Array, " drifts"]  # what the state gains in a period
    positions: int = eqx.field(static=True)

    def at(self, part: Scalar) -> State:
        """The state at a part of the period, without the steady drift."""
        starts = jax.lax.stop_gradient(self.steps.start)
        part = part - jnp.floor(jax.lax.stop_gradient(part))
        k = jnp.searchsorted(starts, jax.lax.stop_gradient(part), side="right") - 1
        start, length = self.steps.start[k], self.steps.length[k]
        inside = (part - start) / jnp.where(length > 0, length, 1.0)
        h = length * self.period
        x = within(self.positions, self.steps.states[k], h, self.steps.gains[k], inside)
        return x - self.drifts @ self.drift * part

    @property
    def stages(self) -> tuple[Float[Array, "points states"], Float[Array, " points"]]:
        """States at all stages, and the weight of each in a mean over the period."""
        made = self.steps
        of = jax.vmap(lambda x, h, gains: stage_states(self.positions, x, h, gains))
        states = of(made.states, made.length * self.period, made.gains)
        drifted = (self.parts[:, None] * (self.drifts @ self.drift)).reshape(states.shape)
        weights = made.length[:, None] * WEIGHTS
        # An event that moves takes the end of its step with it.
        weights = weights.at[:, 2].add(made.end - made.start - made.length)
        return (states - drifted).reshape(-1, made.states.shape[1]), weights.ravel()

    @property
    def parts(self) -> Float[Array, " points"]:
        """Where the stages are, in periods."""
        made = self.steps
        return (made.start[:, None] + made.length[:, None] * NODES).ravel()


class ShotOrbit(NamedTuple):
    """Where the search for an orbit ended, and the evidence."""

    trajectory: Trajectory
    matrix: Square  # of a small disturbance over a period
    converged: Bool[Array, ""]
    crowded: Bool[Array, ""]  # more events in a period than are followed
    gap: Scalar  # by which the last period did not close, over the size of the motion
    periods: Int[Array, ""]  # that were followed
    # How clearly events are met: the least rate h' at which a guard falls through zero, as
    # h'/hypot(h', h''/w) with w of the period; 1 without events. At 0 one only touches, and
    # derivatives do not exist.
    least: Scalar
    events: Int[Array, ""]  # in the period
    error: Scalar  # estimated, of the steps, over the size of the motion


def shot_orbit(
    system: Callable[[Any, Scalar], Periodic], args: Any, steps: int, *, tol: float = 1e-9
) -> ShotOrbit:
    """The periodic orbit of `system(args, load)` at load 1 to which its motion from rest leads.

    From rest at load 1 at once, or else by smaller loads. Its derivatives by `args` are those of
    the period that closes, with the events that it has. A failed search gives zeros.
    """
    fixed = jax.lax.stop_gradient(args)
    found, converged, periods = _followed(lambda load: system(fixed, load), steps, tol)
    still = system(fixed, jnp.ones(()))
    made = jax.tree.map(lambda rows: jnp.where(converged, rows, 0), found.flow.steps)
    made = made._replace(events=jnp.where(converged, made.events, -1))
    start, drift, inverse = (
        jnp.where(converged, x, 0.0) for x in (found.state, found.drift, found.inverse)
    )
    made, start, drift, inverse = jax.lax.stop_gradient((made, start, drift, inverse))
    of = system(args, jnp.ones(()))
    count = len(start)

    def correct(at: tuple[State, Array], _: None) -> tuple[tuple[State, Array], Steps]:
        exact, end = _replayed(of, still, at[0], made)
        step = inverse @ (end - at[0] - of.drifts @ at[1])
        return (at[0] + step[:count], at[1] + step[count:]), exact

    # One more correction of the start carries the derivatives of what closes the period; the steps
    # from there are the second ones.
    begin = in_lanes_of(start, (start, drift))
    (_, drift), twice = jax.lax.scan(correct, begin, None, length=2)
    exact = jax.tree.map(lambda rows: rows[1], twice)
    trajectory = Trajectory(exact, of.period, of.drifts, drift, of.system.positions)
    flow, mode = found.flow, made.modes[0]
    # A disturbance does not move what is held at the start.
    admitted = jax.jacfwd(lambda x: still.system.resumed(x, jnp.zeros(()), mode)[0])(start)
    return ShotOrbit(
        trajectory=trajectory,
        matrix=jnp.where(converged, flow.matrix @ admitted, 0.0),
        converged=converged,
        crowded=flow.events >= EVENTS,
        gap=found.gap,
        periods=periods,
        least=jnp.minimum(flow.least, 1.0),
        events=flow.events,
        error=_missed(still, made),
    )


def _missed(of: Periodic, steps: Steps) -> Scalar:
    """What the steps miss, as a formula of third order in them sees it; they have the fifth.

    That compares what the polynomial of a step has for derivatives at its start.
    """
    n = of.system.positions

    def of_step(step: Steps) -> Scalar:
        h = (step.end - step.start) * of.period
        right = of.system.rate(step.states, step.start * of.period, step.modes)[n:]
        off = (right - LAGRANGE[:, 0] @ step.gains)[:n]
        return h**2 * jnp.linalg.norm(off)

    size = jnp.max(jnp.linalg.norm(steps.states[:, :n], axis=1))
    missed = jnp.sqrt(jnp.mean(jax.vmap(of_step)(steps) ** 2))
    return missed / jnp.where(size > 0, size, 1.0)


def _followed(
    at_load: Callable[[Scalar], Periodic], steps: int, tol: float
) -> tuple[_Closing, Bool[Array, ""], Int[Array, ""]]:
    """The orbit at load 1, whether it was found, and the periods that were followed."""
    full = at_load(jnp.ones(()))
    rest, zero = jnp.zeros(full.drifts.shape[0]), jnp.zeros(())

    def body(state: tuple[Any, ...]) -> tuple[Any, ...]:
        x, mode, load, step, _, periods = state
        of = at_load(load + step)
        mode = jnp.where(load > 0, mode, of.system.started(x, zero))
        end = _closed(of, x, mode, steps, tol)
        x, mode = jnp.where(end.done, end.state, x), jnp.where(end.done, end.mode, mode)
        load = jnp.where(end.done, load + step, load)
        step = jnp.minimum(jnp.where(end.done, 2 * step, step / 2), 1 - load)
        return x, mode, load, step, end, periods + end.periods

    def unfinished(state: tuple[Any, ...]) -> Bool[Array, ""]:
        _, _, load, step, *_ = state
        return (load < 1) & (step >= _SMALLEST_LOAD)

    mode = full.system.started(rest, zero)
    nothing = _nothing(full, rest, mode, steps)
    start = (rest, mode, zero, jnp.ones(()), nothing, jnp.array(0))
    *_, load, _, end, periods = jax.lax.while_loop(unfinished, body, in_lanes_of(rest, start))
    return end, load >= 1, periods


def _replayed(of: Periodic, still: Periodic, x: State, known: Steps) -> tuple[Steps, State]:
    """A period whose steps and events are known, with derivatives, and the state at its end.

    An event moves in time by what its guard is there, over the rate at which that falls.
    """
    positions, fixed = of.system.positions, jax.lax.stop_gradient

    def advance(carry: tuple[State, Scalar], step: Steps) -> tuple[tuple[State, Scalar], Steps]:
        x, start = carry
        mode, which = step.modes, jnp.maximum(step.events, 0)
        h = (step.end - start) * of.period
        gains = known_step(
            _in_mode(of, mode), _in_mode(still, mode), x, start * of.period, h, step.gains
        )
        end = stage_states(positions, x, h, gains)[2]
        here, event = fixed(end), step.events >= 0
        t = step.end * still.period
        along = still.system.rate(here, t, mode)
        value = of.system.guards(end, step.end * of.period, mode)[which]
        falling = jax.jvp(
            lambda x, t: still.system.guards(x, t, mode)[which], (here, t), (along, jnp.ones(()))
        )[1]
        falls = event & (falling < 0)
        later = jnp.where(falls, -value / jnp.where(falls, falling, -1.0), 0.0)
        after, _ = still.system.switched(here, t, mode, which)
        moved = end + along * later + jnp.where(event, after - here, 0.0)
        done = step.end + later / still.period
        return (moved, done), Steps(start, done, step.end - start, x, gains, mode, step.events)

    (end, _), steps = jax.lax.scan(advance, in_lanes_of(x, (x, jnp.zeros(()))), known)
    return steps, end


def shot_multipliers(orbit: ShotOrbit) -> Complex[Array, " states"]:
    """Floquet multipliers of an orbit, the largest first; their derivatives are NaN.

    Those of 1, of drifts and of a body that sticks all the time, are left out: 0 stands for them.
    """
    found = jnp.linalg.eigvals(jax.lax.stop_gradient(orbit.matrix))
    found = jnp.where(jnp.abs(found - 1) < _ONE, 0.0, found)
    moved = 0.0 * jnp.sum(orbit.trajectory.steps.states)
    return found[jnp.argsort(-jnp.abs(found))] + without_derivative(moved)
