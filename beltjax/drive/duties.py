"""Several operating points of one drive as one, whose numbers have a leading axis."""

import dataclasses
from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from beltjax.drive.loads import Load, without_load
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.shafts import transmission
from beltjax.drive.system import Drive


def at_belt_speeds(
    drive: Drive, points: Sequence[OperatingPoint]
) -> tuple[OperatingPoint, Bool[Array, " points"]]:
    """Points of any kind [points], by the belt's speed and with torques in place of loads.

    For analyses of `drive` alone: when its radii change, what loads and speeds come to is another.
    The second array says which points are outside of the table of a load. Raises `KeyError` for a
    torque or a load on a pulley that the drive does not have.
    """
    plain, outside = [], []
    for point in points:
        driven = transmission(drive, point)
        # Power at standstill is no number of a drive, and ends as such.
        torques = jnp.where(driven.at_standstill, jnp.nan, driven.given)
        torque = dict(zip(drive.pulley_names, torques, strict=True))
        speed = point.speed(drive)
        plain.append(OperatingPoint(belt_speed=speed, torque=torque, travel=point.travel))
        outside.append(jnp.any(driven.outside))
    return jax.tree.map(lambda *x: jnp.stack(x), *plain), jnp.stack(outside)


def stacked(points: Mapping[str, OperatingPoint]) -> OperatingPoint:
    """Points by their names as they are [points], so that loads and speeds follow a drive's radii.

    A pulley that has a torque or a load at one of them has one of 0 at the others.

    Raises:
        ValueError: the points cannot be one: some have a belt speed and some a driver speed, or
            the loads of one pulley are of two kinds, or tables of different lengths.
    """
    rules = {(point.belt_speed is None, point.mass_flow is None) for point in points.values()}
    if len(rules) > 1:
        raise ValueError(
            "some give belt_speed and some driver_speed, or mass_flow; give the same for all"
        )
    torques = dict.fromkeys(name for point in points.values() for name in point.torque)
    loads = {name: load for point in points.values() for name, load in point.load.items()}
    alike = [
        dataclasses.replace(
            point,
            torque={name: point.torque.get(name, 0.0) for name in torques},
            load={name: point.load.get(name, without_load(one)) for name, one in loads.items()},
        )
        for point in points.values()
    ]
    for name, one in loads.items():
        for where, point in zip(points, alike, strict=True):
            if _form(point.load[name]) != _form(one):
                raise ValueError(
                    f"the load of {name!r} at {where!r} has other numbers than elsewhere; give "
                    "tables of one length, or power at all"
                )
    return jax.tree.map(lambda *x: jnp.stack(x), *alike)


def _form(load: Load) -> tuple[object, ...]:
    return (jax.tree.structure(load), *(leaf.shape for leaf in jax.tree.leaves(load)))
