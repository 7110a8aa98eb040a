"""Drives in contact that several tests share, made so that they share compiled programs too.

Every answer is one call of the public function: drives of equal structure (number of pulleys,
rule of installation, rule of speed) compile once in a process, and a call takes milliseconds.
"""

import equinox as eqx
import jax.numpy as jnp
from drives import example

import beltjax as bj

_PLACES = {
    "EI": lambda d, p: d.belt.bending_stiffness,
    "EA": lambda d, p: d.belt.axial_stiffness,
    "m0": lambda d, p: d.belt.mass_per_length,
    "tension": lambda d, p: d.installation.tension,
    "k_r": lambda d, p: d.tensioner.stiffness,
    "c": lambda d, p: p.belt_speed,
    "omega": lambda d, p: p.driver_speed,
    "G": lambda d, p: p.mass_flow,
}


def variant(drive, point, **numbers):
    """The same drive and point with other numbers, by the letters of the source."""
    for letter, value in numbers.items():  # strongly typed: a weak type compiles again
        place = _PLACES[letter]
        drive, point = eqx.tree_at(
            lambda both, place=place: place(*both), (drive, point), jnp.asarray(value, dtype=float)
        )
    return drive, point


def equal(**numbers):
    """The drive of Table 5.1; M2 its torque."""
    return _two("two_pulley_table_5_1", numbers)


def unequal(**numbers):
    """The drive of Table 5.3, on which M2 is 1 N m unless given: what `maximum_moment` scales."""
    return _two("two_pulley_table_5_3", {"M2": 1.0, **numbers})


def _two(name, numbers):
    drive, point = example(name)
    torque = dict(numbers).pop("M2", None)
    numbers = {letter: value for letter, value in numbers.items() if letter != "M2"}
    if torque is not None:
        point = bj.OperatingPoint(
            point.belt_speed, point.driver_speed, point.mass_flow, {"driven": float(torque)}
        )
    return variant(drive, point, **numbers)


def state(drive, point, **how):
    """`contact_state`, whatever its result."""
    return bj.contact_state(drive, point, throw=False, **how)


def largest(drive, point, **how):
    """`maximum_moment`, whatever its result."""
    return bj.maximum_moment(drive, point, throw=False, **how)
