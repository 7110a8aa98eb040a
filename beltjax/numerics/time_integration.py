"""Integration of z'' = a(z, z', t) in time, by diffrax.

Dormand's and Prince's explicit method of order 8 (1989) unless an implicit one is asked for,
Kvaerno's of order 5 (2004). A belt drive's fast modes are hardly damped and hardly excited: the
explicit method follows them at a step of 1/w, of which hundreds cost as much as one implicit step.
"""

import importlib.util
from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

State = Float[Array, " size"]
METHODS = "explicit", "implicit"
DERIVATIVES = "reverse", "forward"


class How(NamedTuple):
    """How to integrate."""

    rtol: Float[Array, ""]
    atol: Float[Array, ""]
    most: int  # steps
    method: str
    derivatives: str


class Integrated(NamedTuple):
    """A motion at the times asked for; infinite from where it was given up."""

    z: Float[Array, "times size"]
    rates: Float[Array, "times size"]
    steps: Int[Array, ""]
    rejected: Int[Array, ""]
    exhausted: Bool[Array, ""]  # it took too many steps


def require_diffrax() -> None:
    """Raise `ValueError` where diffrax is not installed."""
    if importlib.util.find_spec("diffrax") is None:
        raise ValueError("diffrax is not installed: pip install 'beltjax[time]'")


def integrated(
    acceleration: Callable[[State, State, Float[Array, ""], Any], State],
    args: Any,
    start: tuple[State, State],
    times: Float[Array, " times"],
    kinks: Float[Array, " kinks"],
    how: How,
) -> Integrated:
    """The motion from `start` = (z, z') at the first of the times to the last.

    At `kinks` the acceleration jumps or has a kink: steps end there. Derivatives are those of the
    steps, in the mode that `how` names.
    """
    import diffrax  # an optional dependency

    size = len(start[0])

    def rate(t: Any, x: Float[Array, " both"], args: Any) -> Float[Array, " both"]:
        z, v = x[:size], x[size:]
        return jnp.concatenate([v, acceleration(z, v, t, args)])

    solver = diffrax.Dopri8() if how.method == "explicit" else diffrax.Kvaerno5()
    control = diffrax.PIDController(rtol=how.rtol, atol=how.atol)
    if len(kinks):
        control = diffrax.ClipStepSizeController(control, jump_ts=kinks)
    by = diffrax.RecursiveCheckpointAdjoint() if how.derivatives == "reverse" else None
    run = diffrax.diffeqsolve(
        diffrax.ODETerm(rate),
        solver,
        times[0],
        times[-1],
        None,
        jnp.concatenate(start),
        args,
        saveat=diffrax.SaveAt(ts=times),
        stepsize_controller=control,
        adjoint=by or diffrax.ForwardMode(),
        max_steps=how.most,
        throw=False,
    )
    assert run.ys is not None  # what SaveAt asks for
    return Integrated(
        z=run.ys[:, :size],
        rates=run.ys[:, size:],
        steps=run.stats["num_steps"],
        rejected=run.stats["num_rejected_steps"],
        exhausted=run.result == diffrax.RESULTS.max_steps_reached,
    )
