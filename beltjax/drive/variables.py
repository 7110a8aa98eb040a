"""Design variables: named numbers of a drive, and how a drive changes with them."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.drive.installation import BeltGiven
from beltjax.drive.layout import turned
from beltjax.drive.readable import UNITS
from beltjax.drive.system import Drive

ANGLE, ARM_LENGTH = "tensioner.angle", "tensioner.arm_length"
_CENTER = {"x": 0, "y": 1}


def variable_names(drive: Drive) -> list[str]:
    """Names of all numbers of this drive that a study may vary."""
    names = [
        f"belt.{field}" for field in ("axial_stiffness", "bending_stiffness", "mass_per_length")
    ]
    for pulley in drive.pulleys:
        names += [f"pulley.{pulley.name}.{end}" for end in ("radius", "center.x", "center.y")]
    if drive.tensioner is not None:
        names += [ANGLE, ARM_LENGTH, "tensioner.stiffness"]
    if isinstance(drive.installation, BeltGiven):
        names += ["installation.belt_length"]
        names += ["installation.free_angle"] if drive.tensioner is not None else []
        return names
    return [*names, "installation.tension"]


def unit_of(name: str) -> str:
    """SI unit of a design variable, or of another number of a drive file but a torque."""
    return UNITS[name.rsplit(".", 1)[1]]


def value_of(drive: Drive, name: str) -> Float[Array, ""]:
    """Value of a design variable in `drive` (SI); `tensioner.angle` is relative and hence 0."""
    if name == ANGLE:
        return jnp.zeros(())
    if name == ARM_LENGTH:
        return jnp.sqrt(jnp.sum(drive.arm**2))
    part, field = _locate(drive, name)
    if field in _CENTER:
        return part.center[_CENTER[field]]
    return getattr(part, field)


def with_values(drive: Drive, values: Mapping[str, Float[Array, ""]]) -> Drive:
    """`drive` with the named numbers set.

    Radii and centers go first. A pulley's rim keeps its distance from the neutral axis.
    `tensioner.angle` then turns the tensioner as a whole (pivot, stops and, under `BeltGiven`,
    the spring's free angle) about the center of its pulley, and `tensioner.arm_length` moves
    the pivot along the arm.
    """
    drawn = drive
    for name, value in values.items():
        if name not in (ANGLE, ARM_LENGTH):
            drive = _with_number(drive, name, value)
    if ANGLE in values:
        drive = _with_tensioner_turned(drive, values[ANGLE])
    if ARM_LENGTH in values:
        arm = drive.arm
        direction = arm / jnp.sqrt(jnp.sum(arm**2))
        drive = _with_pivot(drive, values[ARM_LENGTH] * direction)
    return wound_alike(drive, drawn, values.get(ANGLE, jnp.zeros(())))


def wound_alike(drive: Drive, before: Drive, turned: Float[Array, ""]) -> Drive:
    """`drive`, whose free angle has jumped with its drawn arm since `before`.

    The drawn arm's direction is told between -180 and 180 degrees. A move across that cut, beside
    the angle by which the tensioner was `turned`, must not wind the spring by a whole turn.
    """
    rule = drive.installation
    if not isinstance(rule, BeltGiven) or rule.free_angle is None:
        return drive
    now, then = (jnp.arctan2(d.arm[1], d.arm[0]) for d in (drive, before))
    turns = jnp.round((now - then - turned) / (2 * jnp.pi))
    free = rule.free_angle + 2 * jnp.pi * jax.lax.stop_gradient(turns)
    return eqx.tree_at(lambda d: d.installation.free_angle, drive, free)


def _locate(drive: Drive, name: str) -> tuple[Any, str]:
    """The part of the drive that a variable belongs to, and its field."""
    words = name.split(".")
    if words[0] == "pulley":
        return drive.pulleys[drive.pulley(words[1])], words[-1]
    return getattr(drive, words[0]), words[-1]


def _with_number(drive: Drive, name: str, value) -> Drive:
    words = name.split(".")
    if words[0] != "pulley":
        return eqx.tree_at(lambda d: getattr(getattr(d, words[0]), words[1]), drive, value)
    i = drive.pulley(words[1])
    pulley = drive.pulleys[i]
    if words[-1] in _CENTER:
        moved = pulley.center.at[_CENTER[words[-1]]].set(value)
        return eqx.tree_at(lambda d: d.pulleys[i].center, drive, moved)
    if pulley.rim_radius is not None:
        rim = pulley.rim_radius + value - pulley.radius
        drive = eqx.tree_at(lambda d: d.pulleys[i].rim_radius, drive, rim)
    return eqx.tree_at(lambda d: d.pulleys[i].radius, drive, value)


def _with_pivot(drive: Drive, arm: Float[Array, "2"]) -> Drive:
    pivot = drive.carried @ drive.centers - arm
    return eqx.tree_at(lambda d: d.tensioner.pivot, drive, pivot)


def _with_tensioner_turned(drive: Drive, angle: Float[Array, ""]) -> Drive:
    drive = _with_pivot(drive, turned(drive.arm, angle))
    if drive.tensioner is not None and drive.tensioner.stops is not None:
        stops = drive.tensioner.stops + angle
        drive = eqx.tree_at(lambda d: d.tensioner.stops, drive, stops)
    if isinstance(drive.installation, BeltGiven) and drive.installation.free_angle is not None:
        free = drive.installation.free_angle + angle
        drive = eqx.tree_at(lambda d: d.installation.free_angle, drive, free)
    return drive
