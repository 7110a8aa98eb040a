"""Drives whose pulleys have a law of friction."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from drives import example

LAW = {
    "friction_static": 0.6,
    "friction": 0.3,
    "friction_speed": 0.3,
    "friction_law": "stribeck",
}


def with_laws(drive, **law):
    """The drive with the same law of friction on every pulley."""
    pulleys = tuple(dataclasses.replace(p, **(LAW | law)) for p in drive.pulleys)
    return dataclasses.replace(drive, pulleys=pulleys)


def squealing(name, **law):
    """An example whose belt is a string, so that its tensions are those of the cases."""
    drive, point = example(name)
    drive = eqx.tree_at(lambda d: d.belt.bending_stiffness, drive, jnp.asarray(0.0))
    return with_laws(drive, **law), point
