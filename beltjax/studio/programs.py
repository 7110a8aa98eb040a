"""The compiled programs behind the page: values and their derivatives by many numbers at once.

Each takes a drive as arrays, so that whatever is dragged compiles nothing. Derivatives are pushed
forward, one lane for each number: they run beside the values, in one program.
"""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from beltjax import optimize
from beltjax.analysis.linearization import has_inertias, linearize
from beltjax.analysis.modes import modes
from beltjax.analysis.steady import SteadyState, steady_state
from beltjax.commands.reports.states import Readings, readings
from beltjax.drive.bodies import moved_pulleys
from beltjax.drive.buildable import Clearances, clearances
from beltjax.drive.layout import Layout, layout
from beltjax.drive.numbers import is_relative, number_value, with_number, with_numbers
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.numerics.bases import AbstractBasis
from beltjax.results import RESULTS, succeeded

Names = tuple[str, ...]


class Readout(NamedTuple):
    """What the page shows of a drive at one operating point, SI."""

    centers: Float[Array, "pulleys 2"]  # where the drive rests
    radii: Float[Array, " pulleys"]
    starts: Float[Array, "spans 2"]
    ends: Float[Array, "spans 2"]
    pivots: Float[Array, "coordinates 2"]
    wraps: Float[Array, " pulleys"]
    span_lengths: Float[Array, " spans"]
    coupling: Float[Array, " spans"]  # Gamma of each span
    coupling_total: Float[Array, ""]
    effectiveness: Float[Array, " belts"]
    tensions: Float[Array, " spans"]  # running [N]
    rest_tensions: Float[Array, " spans"]
    hub_loads: Float[Array, "pulleys 2"]  # [N]
    slip_exponents: Float[Array, " pulleys"]
    meter: Float[Array, " spans"]  # what a tension meter hears of the running belt [Hz]
    gap: Float[Array, ""]  # the least between rims, and between rims and the belt [m]
    frequencies: Float[Array, " modes"]  # natural [Hz]


class Answered(NamedTuple):
    """A readout with its derivatives, and what explains it."""

    flat: Float[Array, " values"]  # the numbers of `Readout`, in its order
    slopes: Float[Array, "values numbers"]
    steady: SteadyState
    read: Readings
    drawn: Layout
    gaps: Clearances  # of the drawn layout
    rest_gaps: Clearances
    modes_found: Bool[Array, ""]
    numbers: Float[Array, " numbers"]  # the values of the named ones


def stepped(
    drive: Drive, point: OperatingPoint, names: Names, steps: Mapping[str, Array]
) -> tuple[Drive, OperatingPoint]:
    """The drive and its point with these steps added to their numbers.

    What follows from other numbers, like the length of an arm, is set after those.
    """
    plain = [name for name in names if not is_relative(name)]
    values = {name: number_value(drive, point, name) + steps[name] for name in plain}
    drive, point = with_numbers(drive, point, values)
    for name in names:
        if is_relative(name):
            value = number_value(drive, point, name) + steps[name]
            drive, point = with_number(drive, point, name, value)
    return drive, point


def answered(
    drive: Drive, point: OperatingPoint, names: Names, count: int, basis: AbstractBasis
) -> Answered:
    """Everything shown of a canonical drive at one point, and its derivatives by `names`.

    `count` natural frequencies are found where all inertias are there.
    """
    vibrates = count > 0 and has_inertias(drive)

    def at(x: Float[Array, " numbers"]) -> tuple[Float[Array, " values"], tuple]:
        moved, runs = stepped(drive, point, names, dict(zip(names, x, strict=True)))
        steady = steady_state(moved, runs, throw=False)
        read, found, rest = readings(moved, runs, steady), jnp.array(True), steady.reference.layout
        gaps, hertz = clearances(moved, rest), jnp.zeros(0)
        if vibrates:
            linear = linearize(steady, basis, throw=False)
            natural = modes(linear, count, route="hermitian", throw=False)
            hertz, found = natural.frequencies / (2 * jnp.pi), succeeded(natural.result)
        eta = jnp.asarray(steady.effectiveness)
        shown = Readout(
            centers=rest.centers,
            radii=moved.radii,
            starts=rest.starts,
            ends=rest.ends,
            pivots=moved_pulleys(moved, rest.coordinates).pivots,
            wraps=rest.wraps,
            span_lengths=rest.span_lengths,
            coupling=steady.coupling,
            coupling_total=jnp.sum(steady.coupling),
            effectiveness=jnp.diagonal(eta) if eta.ndim else eta[None],
            tensions=steady.running_tensions,
            rest_tensions=steady.reference.tensions,
            hub_loads=read.hub_loads,
            slip_exponents=read.slip_exponents,
            meter=read.heard,
            gap=jnp.min(jnp.concatenate([gaps.rims, gaps.belt])),
            frequencies=hertz,
        )
        return ravel_pytree(shown)[0], (steady, read, gaps, found)

    def push(direction: Array) -> tuple[Array, Array, tuple]:
        return jax.jvp(at, (jnp.zeros(len(names)),), (direction,), has_aux=True)

    flat, slopes, rest = jax.vmap(push, out_axes=(None, -1, None))(jnp.eye(len(names)))
    steady, read, gaps, found = rest
    drawn = layout(drive, throw=False)
    return Answered(
        flat=flat,
        slopes=slopes,
        steady=steady,
        read=read,
        drawn=drawn,
        gaps=clearances(drive, drawn),
        rest_gaps=gaps,
        modes_found=found | (not vibrates),
        numbers=jnp.stack([number_value(drive, point, name) for name in names]),
    )


class JudgedStudy(NamedTuple):
    """Objective and limited quantities of a study's drive, and their derivatives."""

    values: optimize.Measured
    slopes: optimize.Measured  # [..., numbers], without `found`


def judged(study: optimize.Study, names: Names) -> JudgedStudy:
    """What a canonical study measures of its drive, and its derivatives by `names`.

    Numbers of operation are those of the study's points, and have no derivatives here.
    """
    own = tuple(name for name in names if not name.startswith("operation."))

    def at(x: Float[Array, " numbers"]) -> tuple[tuple, optimize.Measured]:
        moved, _ = stepped(study.drive, study.point, own, dict(zip(own, x, strict=True)))
        found = optimize.measured(study, moved)
        return found[:-1], found

    def push(direction: Array) -> tuple[tuple, optimize.Measured]:
        _, slopes, found = jax.jvp(at, (jnp.zeros(len(own)),), (direction,), has_aux=True)
        return slopes, found

    slopes, values = jax.vmap(push, out_axes=(-1, None))(jnp.eye(len(own)))
    places = jnp.array([own.index(name) if name in own else len(own) for name in names])
    spread = [jnp.append(leaf, jnp.zeros_like(leaf[..., :1]), axis=-1)[..., places]
              for leaf in jax.tree.leaves(slopes)]  # fmt: skip
    named = jax.tree.unflatten(jax.tree.structure(slopes), spread)
    return JudgedStudy(values, optimize.Measured(*named, found=values.found))


class OverSpeed(NamedTuple):
    """Natural frequencies over the driver's speed, and their derivatives in two directions."""

    hertz: Float[Array, "speeds modes"]
    slopes: Float[Array, "directions speeds modes"]
    result: RESULTS  # of each speed


def over_speed(
    drive: Drive,
    point: OperatingPoint,
    names: Names,
    directions: Float[Array, "directions numbers"],
    speeds: Float[Array, " speeds"],
    count: int,
    basis: AbstractBasis,
) -> OverSpeed:
    """`count` natural frequencies [Hz] of a canonical drive at speeds of its driver [rad/s]."""

    def at(x: Float[Array, " numbers"], speed: Array) -> tuple[Array, RESULTS]:
        moved, runs = stepped(drive, point, names, dict(zip(names, x, strict=True)))
        runs = runs.at_driver_speed(speed)
        linear = linearize(steady_state(moved, runs, throw=False), basis, throw=False)
        found = modes(linear, count, route="hermitian", throw=False)
        return found.frequencies / (2 * jnp.pi), found.result

    def one(speed: Array) -> tuple[Array, Array, RESULTS]:
        def push(direction: Array) -> tuple[Array, Array, RESULTS]:
            none = jnp.zeros(len(names))
            return jax.jvp(lambda x: at(x, speed), (none,), (direction,), has_aux=True)

        return jax.vmap(push, out_axes=(None, 0, None))(directions)

    hertz, slopes, result = jax.vmap(one, out_axes=(0, 1, 0))(speeds)
    return OverSpeed(hertz, slopes, result)
