"""A drive at an operating point as arrays, prepared once and handed on to all that follows."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from beltjax.drive.bodies import Springs, outside_forces, springs
from beltjax.drive.installation import Installation
from beltjax.drive.layout import Layout, Outline, laid_out, layout, outline
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.placeholders import harmless, numbers_are_usable
from beltjax.drive.shafts import Transmission, transmission
from beltjax.drive.system import Drive
from beltjax.numerics.loops import Loops
from beltjax.numerics.rigid_bodies import Bodies, OutsideForces
from beltjax.results import RESULTS, succeeded


class Assembly(NamedTuple):
    """The arrays of a drive at an operating point."""

    drive: Drive  # for the numbers that only one analysis uses
    loops: Loops
    outline: Outline
    springs: Springs
    driven: Transmission
    EA: Float[Array, " belts"]  # [N]
    offsets: Float[Array, " spans"]  # of the tensions above a belt's level [N]
    moments: Float[Array, " coordinates"]  # of accessories bolted to the bodies [N m]
    outside: OutsideForces  # on the bodies, with torques or without
    drawn: Layout

    @property
    def bodies(self) -> Bodies:
        """The tensioners."""
        return self.outline.bodies

    @property
    def rule(self) -> Installation:
        """What is given of belts and springs."""
        return self.drive.installation

    @property
    def still(self) -> Float[Array, " coordinates"]:
        """The coordinates of the drawn layout."""
        return jnp.zeros(len(self.drive.tensioners))

    @property
    def mean_length(self) -> Float[Array, ""]:
        """Mean length of the drawn spans [m], without derivatives: a unit for searches."""
        return jax.lax.stop_gradient(jnp.mean(self.drawn.span_lengths))

    def layout(self, coordinates: Float[Array, " coordinates"]) -> Layout:
        """The layout with the tensioners at these coordinates."""
        return laid_out(self.outline, self.loops, coordinates)


def assembled(drive: Drive, point: OperatingPoint) -> Assembly:
    """The arrays of `drive` at `point`.

    Raises `KeyError` for a torque on a pulley that is not there.
    """
    of, loops, driven = outline(drive), drive.loops, transmission(drive, point)
    return Assembly(
        drive=drive,
        loops=loops,
        outline=of,
        springs=springs(drive),
        driven=driven,
        EA=drive.axial_stiffnesses,
        offsets=_tension_offsets(drive, of.bodies, driven, loops),
        moments=_housed_moments(drive, of.bodies, driven),
        outside=outside_forces(drive),
        drawn=laid_out(of, loops, jnp.zeros(len(drive.tensioners))),
    )


class UsableAssembly(NamedTuple):
    """An assembly whose numbers spoil no batch, and what those that were given are."""

    made: Assembly
    point: OperatingPoint
    good: Bool[Array, ""]  # whether the numbers are some that a drive can have
    drawable: RESULTS  # of the drawn layout


def usable_assembly(drive: Drive, point: OperatingPoint) -> UsableAssembly:
    """The arrays of `drive` at `point`, or harmless ones where these cannot be used or drawn.

    Raises `KeyError` for a torque on a pulley that is not there.
    """
    good = numbers_are_usable(drive, point)
    drive, point = harmless(drive, point, good)
    drawn = layout(drive, throw=False)
    drive, point = harmless(drive, point, succeeded(drawn.result))
    # The layout is at hand: that of the assembly would be compiled once more.
    made = assembled(drive, point)._replace(drawn=drawn)
    return UsableAssembly(made, point, good, drawn.result)


def _tension_offsets(
    drive: Drive, of: Bodies, driven: Transmission, loops: Loops
) -> Float[Array, " spans"]:
    """Tension of each span above the mean of those that leave a belt's tensioner pulleys (R2).

    In the direction of travel the span that leaves an accessory carries M/r more than the one
    before. On a belt without a tensioner the first span is the reference.
    """
    steps = driven.travel * driven.torques / drive.radii  # P_i - P_{i-1} at pulley i
    offsets = jnp.cumsum(steps)
    first = jnp.zeros(len(offsets)).at[loops.starts].set(1.0)
    sprung = jnp.sum(of.carries, axis=1)
    weight = jnp.where(loops.spread(loops.sums(sprung)) > 0, sprung, first)
    level = loops.sums(weight * offsets) / loops.sums(weight)
    return offsets - loops.spread(level)


def _housed_moments(drive: Drive, of: Bodies, driven: Transmission) -> Float[Array, " coordinates"]:
    """Moments of accessories that are bolted to bodies, on each body with which they turn.

    The belt turns the accessory's rotor, and the housing passes that torque on to the body.
    """
    housed = jax.lax.stop_gradient(jnp.stack([pulley.housed for pulley in drive.pulleys]))
    turned = housed * driven.turning * driven.torques
    return of.rotary * jnp.sum(turned[:, None] * of.carried, axis=0)
