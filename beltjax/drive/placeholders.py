"""Numbers that no drive can have, and placeholders that keep them from spoiling a batch."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from beltjax.drive.bodies import bodies, springs
from beltjax.drive.components import NO_STOPS
from beltjax.drive.installation import Preloaded, TensionGiven
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.shafts import transmission
from beltjax.drive.system import Drive

Numbers = tuple[Drive, OperatingPoint]


def numbers_are_usable(drive: Drive, point: OperatingPoint) -> Bool[Array, ""]:
    """Whether all numbers are finite, all that must be positive are, and power has a speed."""
    rule = drive.installation
    positive: list[Any] = [drive.radii]
    positive += [belt.axial_stiffness for belt in drive.belts]
    positive += [belt.mass_per_length for belt in drive.belts]
    wedges = [(belt.wedge_angle, belt.wedge_stiffness) for belt in drive.belts]
    positive += [number for pair in wedges for number in pair if number is not None]
    if isinstance(rule, TensionGiven):
        positive.append(rule.tension)
    elif not isinstance(rule, Preloaded):
        positive.append(rule.belt_length)
    not_negative = [belt.bending_stiffness for belt in drive.belts]
    not_negative += [body.stiffness for body in drive.tensioners]
    # Stops may be infinite, and free positions that are not given are NaN.
    leaves = jax.tree_util.tree_leaves_with_path((drive, point))
    finite = [
        jnp.ravel(leaf)
        for path, leaf in leaves
        if getattr(path[-1], "name", "") not in ("stops", "free")
    ]
    least = jnp.min(jnp.concatenate([jnp.ravel(number) for number in positive]))
    floor = jnp.min(jnp.stack(not_negative))
    good = jnp.all(jnp.isfinite(jnp.concatenate(finite))) & (least > 0) & (floor >= 0)
    if point.load:
        good = good & ~jnp.any(transmission(drive, point).at_standstill)
    if drive.tensioners:
        of = bodies(drive)
        good = good & jnp.all(of.stops[:, 0] <= of.stops[:, 1])
        # An arm has a length: its pulleys do not all lie at its pivot.
        across = of.carries * (drive.centers[:, :1] - of.pivots[:, 0])
        up = of.carries * (drive.centers[:, 1:] - of.pivots[:, 1])
        arms = jnp.max(across**2 + up**2, axis=0)
        is_arm = (of.rotary > 0) & (jnp.sum(of.carries, axis=0) > 0)
        good = good & jnp.all((arms > 0) | ~is_arm)
        if isinstance(rule, TensionGiven) and rule.as_drawn:
            good = good & (jnp.sum(springs(drive).floating) == 0)
    return good


def harmless(drive: Drive, point: OperatingPoint, good: Bool[Array, ""]) -> Numbers:
    """The drive and point where `good`; elsewhere rings of equal pulleys, without derivatives.

    The computation goes on with them, so that every number stays finite; the result reports the
    failure.
    """
    centers = []
    for size in drive.loop_sizes:
        turns = 2 * jnp.pi * jnp.arange(size) / size
        centers += [*(10.0 * jnp.stack([jnp.cos(turns), jnp.sin(turns)], axis=-1))]
    ones = jax.tree.map(jnp.ones_like, (drive, point))
    count = len(drive.tensioners)

    def places(n: Numbers) -> list[Any]:
        # `tree_at` shows an empty tuple as one leaf.
        moved, where = [n[0].tensioners[i] for i in range(count)], n[0].pulleys
        return [
            *(pulley.center for pulley in where),
            *(belt.axial_stiffness for belt in n[0].belts),
            *(belt.bending_stiffness for belt in n[0].belts),
            *(speed for speed in (n[1].belt_speed, n[1].driver_speed) if speed is not None),
            *(pulley.on for pulley in where),
            *(body.on for body in moved),
            *(body.stops for body in moved),
        ]

    belts = len(drive.belts)
    nominal = eqx.tree_at(
        places,
        ones,
        [
            *centers,
            *[jnp.array(1e3)] * belts,
            *[jnp.array(1e-3)] * belts,
            jnp.array(0.0),
            *[jnp.zeros(count)] * (len(drive.pulleys) + count),
            *[jnp.array(NO_STOPS)] * count,
        ],
    )
    return jax.tree.map(lambda a, b: jnp.where(good, a, b), (drive, point), nominal)
