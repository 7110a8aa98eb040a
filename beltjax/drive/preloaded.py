"""The tension that springs, weights and constant forces give a belt in the drawn layout."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from beltjax.compiling.quick import quickly_compiled
from beltjax.drive.assembly import Assembly, assembled
from beltjax.drive.canonical import canonical
from beltjax.drive.installation import Preloaded
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.numerics.definite import Definite, definite_solve


def balancing_tensions(made: Assembly, rule: Preloaded) -> Definite:
    """Tensions [N] that balance the drawn bodies whose springs and outside forces are known.

    They are not definite where a belt has no such body. Of more bodies than belts they are those of
    least squares, which the balance of each body then tests.
    """
    of, locked, belts = made.springs, made.bodies.locked, len(made.loops.sizes)
    free = jnp.full_like(of.stiffness, jnp.nan) if rule.free is None else rule.free
    lacking = jnp.isnan(free)
    follows = jnp.where(lacking & (of.stiffness > 0), 1.0, 0.0)
    known = jnp.where(jnp.abs(follows @ of.rows) > 0, 0.0, 1.0 - locked)
    wound = jnp.where(lacking, 0.0, of.stiffness * jnp.where(lacking, 0.0, free))
    # Moments count over a length beside forces.
    weight = known * jnp.where(made.bodies.rotary > 0, 1.0 / made.mean_length, 1.0)
    force = (made.outside.push(made.bodies, made.still) + wound @ of.rows) * weight
    pulls = made.loops.sums(made.drawn.span_pulls) * weight
    return definite_solve(pulls @ pulls.T, pulls @ force, jnp.ones(belts))


def _balance(drive: Drive, point: OperatingPoint) -> Definite:
    rule = drive.installation
    assert isinstance(rule, Preloaded)  # as its caller holds
    return balancing_tensions(assembled(drive, point), rule)


def require_tension(drive: Drive, path: object) -> None:
    """Raise `FileError` where preloads and weights give a belt no tension, or push it off."""
    rule = drive.installation
    if not isinstance(rule, Preloaded):
        return
    # What the balance does not depend on would compile anew where it differs.
    bare = dataclasses.replace(drive, isolators=(), dampers=())
    still = OperatingPoint(belt_speed=0.0)
    found = jax.device_get(quickly_compiled(_balance)(*canonical(bare, still)))
    tensions = np.atleast_1d(found.solution)
    if not found.definite:
        raise FileError(
            path,
            "installation",
            "nothing gives the tension; give tension or belt_length, or the preload, force or "
            "weight of a tensioner on each belt",
        )
    for belt, tension in zip(drive.belts, tensions, strict=True):
        if not tension > 0:
            raise FileError(
                path,
                "tensioner",
                f"preload, force and weight push away from {belt.name!r}, whose tension would be "
                f"{tension:.4g} N; turn their sign, which is positive counterclockwise or along "
                "direction",
            )
