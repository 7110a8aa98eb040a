"""A drive that is ready to be moved at finite amplitude: its model, in a few functions a span."""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.analysis.damping import Damping
from beltjax.analysis.linearization import Linearization, linearize
from beltjax.analysis.motion import (
    accessories_of,
    belt_speeds,
    joints_of,
    layered_shapes,
    loaded_friction,
    motion_model,
    span_paths,
)
from beltjax.analysis.steady import steady_state
from beltjax.compiling.batched_loops import ready_after
from beltjax.drive.components import concrete
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.numerics.bases import AbstractBasis, Legendre
from beltjax.physics.joints import DECOUPLER
from beltjax.physics.motion import MotionModel, projected

FINE = 32  # Legendre functions from which the layered ones are combined


class CountedParts(NamedTuple):
    """What of a drive is not the same for all of its kind, and is counted where it may be there."""

    curved: bool  # bodies may move on exact paths
    loose: bool  # joints may be other than springs
    varied: bool  # dry friction may depend on what a body carries


def counted(drive: Drive) -> CountedParts:
    """What is counted of a drive."""
    bodies, isolators = drive.tensioners, drive.isolators
    loads = [number for body in bodies for number in (body.friction_hub, body.friction_spring)]
    return CountedParts(
        curved=bool(bodies) and any_of([drive.model.arm_curvature]),
        loose=any_of([part.law for part in isolators])
        or any_of([part.stop_stiffness for part in isolators]),
        varied=any_of(loads) or any_of([body.friction_unwinding - 1 for body in bodies]),
    )


class ModelAsked(eqx.Module):
    """What a motion counts."""

    damping: Damping
    basis: AbstractBasis | None
    functions: int = eqx.field(static=True)
    counted: CountedParts = eqx.field(static=True)
    varying: bool = eqx.field(static=True)  # the belts' speed follows the driver's rotation
    free: bool = eqx.field(static=True)  # the driver turns by its torque


class Moving(NamedTuple):
    """A drive at an operating point, in motion."""

    linearization: Linearization
    whole: MotionModel  # in the linearization's coordinates
    shapes: Float[Array, "spans n functions"]  # of the functions that are counted
    model: MotionModel  # in those


def moving(drive: Drive, point: OperatingPoint, asked: ModelAsked) -> Moving:
    """The equations of a drive's motion about its steady state."""
    steady = steady_state(drive, point, throw=False)
    basis = Legendre(FINE) if asked.basis is None else asked.basis
    lin = linearize(steady, basis, free=asked.free, throw=False)
    parts = asked.counted
    whole = motion_model(
        lin,
        asked.damping,
        span_paths(drive, steady) if parts.curved else None,
        joints_of(drive, lin, asked.damping) if parts.loose else None,
        belt_speeds(drive, point, lin) if asked.varying else None,
        accessories_of(drive, point, lin) if point.load else None,
        loaded_friction(drive, lin) if parts.varied else None,
    )
    if asked.basis is None:
        # A rigid rotation comes after the damping itself.
        earlier = whole.damping if whole.rigid is None else jnp.sum(whole.rigid)
        tensions = ready_after(lin.model.Q, earlier)
        later = eqx.tree_at(lambda lin: lin.model.Q, lin, tensions)
        shapes = layered_shapes(later, asked.functions)
    else:
        shapes = jnp.broadcast_to(jnp.eye(basis.size), (lin.spans, basis.size, basis.size))
    return Moving(lin, whole, shapes, projected(whole, shapes))


def law_with_modes(drive: Drive, traced: bool = False) -> str | None:
    """What of the drive has a law with modes; None also where JAX traces its numbers.

    With `traced` friction whose size is traced counts where its friction_speed is known to be 0.
    """
    for body in drive.tensioners:
        numbers = body.friction_torque, body.friction_hub, body.friction_spring
        friction, speed = [concrete(number) for number in numbers], concrete(body.friction_speed)
        dry = any(traced if number is None else number.any() for number in friction)
        if dry and speed is not None and not speed.all():
            return f"tensioner {body.name!r} with friction_speed = 0"
    for part in drive.isolators:
        law = concrete(part.law)
        if law is not None and (law >= DECOUPLER).any():
            return f"isolator {part.name!r} with its law"
    return None


def any_of(flags: Sequence[Array]) -> bool:
    """Whether one of the numbers may be other than 0: all that are traced may be."""
    return any((value := concrete(flag)) is None or bool(value.any()) for flag in flags)


def require_functions(functions: int) -> None:
    """Raise `ValueError` for a number of functions that there is not."""
    if not 0 <= functions <= FINE:
        raise ValueError(f"functions: found {functions}; give 0 to {FINE}, or a basis.")
