"""Integration of systems of first order in time, by diffrax, and from event to event.

Dormand's and Prince's explicit method of order 8 (1989) unless an implicit one is asked for,
Kvaerno's of order 5 (2004). A belt drive's fast modes are hardly damped and hardly excited: the
explicit method follows them at a step of 1/w, of which hundreds cost as much as one implicit step.
"""

import importlib.util
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from beltjax.compiling.batched_loops import in_lanes_of
from beltjax.numerics.hybrid import HybridSystem, Mode

State = Float[Array, " states"]
Scalar = Float[Array, ""]
METHODS = "explicit", "implicit"
DERIVATIVES = "reverse", "forward"

_BELOW = 1e-10  # a guard has fallen: so far rounding may leave it below 0 where a mode begins
_PRECISION = 1e-11  # of the time of an event, and of its guard


class How(NamedTuple):
    """How to integrate."""

    rtol: Scalar
    atol: Scalar
    most: int  # steps, between events
    events: int  # at most
    method: str
    derivatives: str


class Integrated(NamedTuple):
    """A motion at the times asked for; infinite from where it was given up."""

    states: Float[Array, "times states"]
    modes: Int[Array, "times elements"]
    steps: Int[Array, ""]
    rejected: Int[Array, ""]
    events: Int[Array, ""]
    exhausted: Bool[Array, ""]  # it took too many steps
    crowded: Bool[Array, ""]  # it has too many events


def require_diffrax() -> None:
    """Raise `ValueError` where diffrax is not installed."""
    if importlib.util.find_spec("diffrax") is None:
        raise ValueError("diffrax is not installed: pip install 'beltjax[time]'")


class _Options(NamedTuple):
    """What diffrax is given for every part of a motion."""

    solver: Any
    stepsize_controller: Any
    adjoint: Any
    max_steps: int
    throw: bool


def _options(kinks: Float[Array, " kinks"], how: How) -> _Options:
    import diffrax  # an optional dependency

    control = diffrax.PIDController(rtol=how.rtol, atol=how.atol)
    if len(kinks):
        control = diffrax.ClipStepSizeController(control, jump_ts=kinks)
    forward = how.derivatives == "forward"
    return _Options(
        solver=diffrax.Dopri8() if how.method == "explicit" else diffrax.Kvaerno5(),
        stepsize_controller=control,
        adjoint=diffrax.ForwardMode() if forward else diffrax.RecursiveCheckpointAdjoint(),
        max_steps=how.most,
        throw=False,
    )


def integrated(
    rate: Callable[[State, Scalar, Any], State],
    args: Any,
    start: State,
    times: Float[Array, " times"],
    kinks: Float[Array, " kinks"],
    how: How,
) -> Integrated:
    """The motion of a smooth system from its state at the first of the times to the last.

    At `kinks` its rate jumps or has a kink: steps end there. Derivatives are those of the steps,
    in the mode that `how` names.
    """
    import diffrax

    def along(t: Any, x: State, args: Any) -> State:
        return rate(x, t, args)

    run = diffrax.diffeqsolve(
        diffrax.ODETerm(along),
        t0=times[0],
        t1=times[-1],
        dt0=None,
        y0=start,
        args=args,
        saveat=diffrax.SaveAt(ts=times),
        **_options(kinks, how)._asdict(),
    )
    assert run.ys is not None  # what SaveAt asks for
    none = jnp.array(0)
    return Integrated(
        states=run.ys,
        modes=jnp.zeros((len(times), 0), int),
        steps=run.stats["num_steps"],
        rejected=run.stats["num_rejected_steps"],
        events=none,
        exhausted=run.result == diffrax.RESULTS.max_steps_reached,
        crowded=jnp.array(False),
    )


class _OnTheWay(NamedTuple):
    """A motion on its way from event to event."""

    t: Scalar
    state: State
    mode: Mode
    found: Integrated
    done: Bool[Array, ""]


def integrated_through_events(
    system: Callable[[Any], HybridSystem],
    args: Any,
    start: tuple[State, Mode],
    times: Float[Array, " times"],
    kinks: Float[Array, " kinks"],
    how: How,
) -> Integrated:
    """`integrated` of a system with modes, from event to event.

    The time of an event moves with what the motion depends on, so that derivatives are exact as
    long as the sequence of events stays what it is.
    """
    import diffrax
    import optimistix as optx

    end, options = times[-1], _options(kinks, how)._asdict()

    def rate(t: Any, x: State, given: tuple[Any, Mode]) -> State:
        return system(given[0]).rate(x, t, given[1])

    def fallen(t: Any, y: State, args: tuple[Any, Mode], **_: Any) -> Scalar:
        # diffrax passes these by their names.
        return jnp.min(system(args[0]).guards(y, t, args[1])) + _BELOW

    # From above to below; lanes of a batch without an event are not asked for one.
    finder = optx.Bisection(rtol=1e-2 * _PRECISION, atol=_PRECISION, flip=True)
    event = diffrax.Event(fallen, finder, direction=False)

    def part(at: _OnTheWay) -> _OnTheWay:
        run = diffrax.diffeqsolve(
            diffrax.ODETerm(rate),
            t0=at.t,
            t1=end,
            dt0=None,
            y0=at.state,
            args=(args, at.mode),
            event=event,
            saveat=diffrax.SaveAt(
                subs=[
                    diffrax.SubSaveAt(t1=True),
                    diffrax.SubSaveAt(ts=jnp.clip(times, at.t, end)),
                ]
            ),
            **options,
        )
        assert run.ts is not None
        assert run.ys is not None
        t, x = run.ts[0][-1], run.ys[0][-1]
        met = jnp.asarray(run.event_mask)
        of = system(args)
        which = jnp.argmin(of.guards(x, t, at.mode))
        after, mode = of.switched(x, t, at.mode, which)
        inside = ((times > at.t) & (times <= t))[:, None]
        made, exhausted = at.found, run.result == diffrax.RESULTS.max_steps_reached
        found = Integrated(
            states=jnp.where(inside, run.ys[1], made.states),
            modes=jnp.where(inside, at.mode, made.modes),
            steps=made.steps + run.stats["num_steps"],
            rejected=made.rejected + run.stats["num_rejected_steps"],
            events=made.events + met,
            exhausted=exhausted,
            crowded=made.crowded,
        )
        return _OnTheWay(
            t=t,
            state=jnp.where(met, after, x),
            mode=jnp.where(met, mode, at.mode),
            found=found,
            done=~met,
        )

    def following(at: _OnTheWay, _: None) -> tuple[_OnTheWay, None]:
        return jax.lax.cond(at.done, lambda at: at, part, at), None

    x, mode = start
    first = (jnp.arange(len(times)) == 0)[:, None]
    none, no = jnp.array(0), jnp.array(False)
    begun = Integrated(
        states=jnp.where(first, x, jnp.inf),
        modes=jnp.broadcast_to(mode, (len(times), len(mode))),
        steps=none,
        rejected=none,
        events=none,
        exhausted=no,
        crowded=no,
    )
    at = in_lanes_of(x, _OnTheWay(times[0], x, mode, begun, no))
    last, _ = jax.lax.scan(jax.checkpoint(following), at, None, length=how.events + 1)
    return last.found._replace(crowded=~last.done)
