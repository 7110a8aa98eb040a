"""Torque and speed, which shafts carry from belt to belt."""

from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from beltjax.drive.components import Damper, Isolator
from beltjax.drive.system import Drive

if TYPE_CHECKING:
    from beltjax.drive.operation import OperatingPoint


class Transmission(NamedTuple):
    """Speed, travel and torque of every pulley at an operating point of the drive."""

    speeds: Float[Array, " pulleys"]  # of the belt that the pulley belongs to [m/s]
    travel: Float[Array, " pulleys"]  # +1 where that belt runs as listed, -1 where against
    torques: Float[Array, " pulleys"]  # taken from that belt [N m]
    turning: Float[Array, " pulleys"]  # +1 where the pulley turns counterclockwise, -1 clockwise
    gives: Float[Array, " pulleys"]  # 1 for the pulley that gives its belt what the others take
    driving: Float[Array, " pulleys"]  # 1 on the shaft of the driver, the driver included
    given: Float[Array, " pulleys"]  # torque that the point gives each pulley itself [N m]
    outside: Bool[Array, " pulleys"]  # whether the speed lies outside of the table of its load
    at_standstill: Bool[Array, " pulleys"]  # whether a load takes power where nothing turns
    slopes: Float[Array, " pulleys"]  # of the loads' torques by the pulleys' speeds [N m s/rad]
    # Speed of a belt at that pulley as a sum of this times the speeds at other pulleys, along the
    # list; a row of zeros for the belt of the driver.
    gearing: Float[Array, "belts pulleys"]


def transmission(drive: Drive, point: "OperatingPoint") -> Transmission:
    """Speeds and torques of all pulleys, from the driver's belt to those that it drives.

    Shafts and belts form a tree. On each belt the pulley nearest to the driver gives what the
    others take; on each shaft but the driver's the pulley nearest to the driver takes what the
    shaft's accessories and its other belts need. Raises `KeyError` for a torque or a load on an
    unknown pulley.
    """
    for name in point.names_of_takers:
        drive.pulley(name)
    count, radii, drives = len(drive.pulleys), drive.radii, drive.drives
    of_belt, on_shaft = drive.loops.members, _on_shaft(drive)
    together = on_shaft.T @ on_shaft  # 1 where two pulleys share a shaft
    # The masks of the driver's shaft and belt are data, so that the driver is not structure.
    driving = together @ drives
    near = driving * (of_belt.T @ (of_belt @ drives))  # gives to its belt what the others take
    reached = of_belt.T @ (of_belt @ near)
    left = jax.lax.stop_gradient(drive.senses) * drive.faces  # rims turn left with the belt
    turns = left / radii  # of a shaft, per length of belt
    ratio = jax.lax.stop_gradient(point.travel) * reached  # surface speeds, along the list
    gearing: Float[Array, "belts pulleys"] = jnp.zeros((len(drive.belts), count))
    for _ in range(len(drive.belts) - 1):
        # Pulleys of one shaft turn alike; the reached ones of a shaft agree.
        share = together @ reached
        next_near = (1 - reached) * jnp.minimum(share, 1.0)
        by_shaft = (next_near / turns / jnp.maximum(share, 1.0))[:, None] * together
        turned = of_belt @ (by_shaft * (reached * turns))
        near, gearing = near + next_near, gearing + turned
        ratio = ratio + of_belt.T @ (turned @ ratio)
        reached = jnp.minimum(reached + of_belt.T @ (of_belt @ next_near), 1.0)
    speeds = jnp.abs(ratio) * point.speed(drive)
    given, outside, at_standstill, slopes = _given(drive, point, speeds / radii)
    on_its_shaft = together @ given
    torques: Float[Array, " pulleys"] = jnp.zeros(count)
    for _ in drive.belts:
        passed = together @ (near * torques)
        taken = (1 - near) * (on_its_shaft - passed)
        torques = jnp.asarray(taken) - near * radii * (of_belt.T @ (of_belt @ (taken / radii)))
    travel = jax.lax.stop_gradient(jnp.sign(ratio))
    return Transmission(
        speeds=speeds,
        travel=travel,
        torques=torques,
        turning=travel * left,
        gives=jnp.asarray(near),
        driving=jnp.asarray(driving),
        given=given,
        outside=outside & (driving == 0),
        at_standstill=at_standstill & (driving == 0),
        slopes=slopes * (driving == 0),
        gearing=gearing,
    )


class _Given(NamedTuple):
    """What torques and loads ask of each pulley."""

    torque: Float[Array, " pulleys"]
    outside: Bool[Array, " pulleys"]
    at_standstill: Bool[Array, " pulleys"]
    slope: Float[Array, " pulleys"]


def _given(drive: Drive, point: "OperatingPoint", turning: Float[Array, " pulleys"]) -> _Given:
    """What torques and loads ask of each pulley, which turns at these speeds [rad/s]."""
    zero, no = jnp.zeros(()), jnp.array(False)
    torque = [point.torque.get(name, zero) for name in drive.pulley_names]
    outside, at_standstill, slope = ([part] * len(torque) for part in (no, no, zero))
    for name, load in point.load.items():
        k = drive.pulley(name)
        taken = load.at(turning[k])
        torque[k] = torque[k] + taken.torque
        outside[k], at_standstill[k] = taken.outside, taken.at_standstill
        slope[k] = load.slope(turning[k])
    return _Given(*(jnp.stack(each) for each in (torque, outside, at_standstill, slope)))


def _on_shaft(drive: Drive) -> Float[np.ndarray, "shafts pulleys"]:
    """1 where the pulley sits on the shaft."""
    places = np.arange(len(drive.pulleys))
    return np.array([np.isin(places, shaft) for shaft in drive.shafts], float)


class Rotors(NamedTuple):
    """The rotors: a hub for each shaft, then the rims of isolators, then the rings of dampers.

    Rotations are positive in the direction in which the pulleys follow the belt's travel.
    """

    rims: Float[Array, "pulleys rotors"]  # 1 at the rotor that the belt turns
    hubs: Float[Array, "pulleys rotors"]  # 1 at the rotor that takes the pulley's torque
    driver: Float[Array, " rotors"]  # 1 for the hub of the driver
    inertias: Float[Array, " rotors"] | None  # [kg m^2]; None where one is missing
    stiffness: Float[Array, "rotors rotors"]  # [N m/rad]
    damping: Float[Array, "rotors rotors"]  # [N m s/rad]
    wind_ups: Float[Array, "isolators rotors"]  # of each isolator: 1 at its rim, -1 at its hub


def rotors(drive: Drive) -> Rotors:
    """The rotors of a drive, and the torsion springs between them."""
    shafts = drive.shafts
    on_shaft = _on_shaft(drive)
    isolated, rings = drive.isolators, drive.dampers
    size = len(shafts) + len(isolated) + len(rings)
    hubs = jnp.pad(jnp.asarray(on_shaft.T), ((0, 0), (0, size - len(shafts))))
    fixed = jax.lax.stop_gradient
    wind_ups: list[Array] = []
    rims, springs, dampings = hubs, jnp.zeros((size, size)), jnp.zeros((size, size))

    def joined(
        one: Float[Array, " rotors"], other: Float[Array, " rotors"], part: Isolator | Damper
    ) -> tuple[Float[Array, "rotors rotors"], Float[Array, "rotors rotors"]]:
        """Stiffness and damping of a part between two rotors."""
        row = one - other
        return part.stiffness * jnp.outer(row, row), part.damping * jnp.outer(row, row)

    for k, isolator in enumerate(isolated):
        flags, rim = fixed(isolator.pulleys), jnp.zeros(size).at[len(shafts) + k].set(1.0)
        hub = flags @ hubs / jnp.sum(flags)
        rims = (1 - flags)[:, None] * rims + flags[:, None] * rim
        wind_ups.append(rim - hub)
        stiffness, damping = joined(rim, hub, isolator)
        springs, dampings = springs + stiffness, dampings + damping
    for k, damper in enumerate(rings):
        flags = fixed(damper.pulley)
        ring = jnp.zeros(size).at[len(shafts) + len(isolated) + k].set(1.0)
        on = flags @ jnp.where(fixed(damper.on_rim) > 0, rims, hubs)
        stiffness, damping = joined(ring, on, damper)
        springs, dampings = springs + stiffness, dampings + damping
    return Rotors(
        rims=rims,
        hubs=hubs,
        driver=drive.drives @ hubs,
        inertias=_inertias(drive),
        stiffness=springs,
        damping=dampings,
        wind_ups=jnp.stack(wind_ups) if wind_ups else jnp.zeros((0, size)),
    )


def rotor_names(drive: Drive) -> tuple[str, ...]:
    """Names of the rotors: the first pulley of a shaft, "NAME.rim" and "NAME.ring"."""
    names = drive.pulley_names
    rims = [names[int(np.argmax(np.asarray(part.pulleys)))] for part in drive.isolators]
    rings = [names[int(np.argmax(np.asarray(part.pulley)))] for part in drive.dampers]
    return (
        *(names[shaft[0]] for shaft in drive.shafts),
        *(f"{name}.rim" for name in rims),
        *(f"{name}.ring" for name in rings),
    )


def has_rotor_inertias(drive: Drive) -> bool:
    """Whether each rotor has its inertia given."""
    return all(_given_inertias(drive))


def _inertias(drive: Drive) -> Float[Array, " rotors"] | None:
    """Inertia of each rotor; None where one is missing."""
    if not has_rotor_inertias(drive):
        return None
    return jnp.stack([jnp.sum(jnp.stack(parts), axis=0) for parts in _given_inertias(drive)])


def _given_inertias(drive: Drive) -> list[list[Array]]:
    """What is given of each rotor's inertia; that of a shaft with any of its pulleys."""
    hubs = [[drive.pulleys[place].inertia for place in shaft] for shaft in drive.shafts]
    rims = [[isolator.rim_inertia] for isolator in drive.isolators]
    rings = [[damper.inertia] for damper in drive.dampers]
    return [[part for part in parts if part is not None] for parts in (*hubs, *rims, *rings)]
