"""Belts that are strings, for analyses of how a belt meets its pulleys."""

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.analysis.installed import held_by_tensions, installed_by_tension
from beltjax.drive.assembly import Assembly
from beltjax.drive.contact_groups import ContactGroups
from beltjax.drive.installation import BeltGiven, Preloaded, TensionGiven
from beltjax.physics.inclined_spans import Frame


def belts_of_the_string(made: Assembly) -> Assembly:
    """`made`; where its tensions are those of strings, with the belts and springs they give."""
    rule = made.rule
    if isinstance(rule, Preloaded):
        string = installed_by_tension(made).held
    elif isinstance(rule, TensionGiven) and rule.tension_of == "string":
        tensions = made.loops.spread(jnp.broadcast_to(rule.tension, made.EA.shape))
        string = held_by_tensions(made, made.drawn, tensions, made.still)
    else:
        return made
    free = string.free if len(string.free) else None
    given = BeltGiven(each_or_single(string.lengths), free=free)
    return made._replace(drive=dataclasses.replace(made.drive, installation=given))


def each_or_single(of_belts: Float[Array, " belts"]) -> Float[Array, "*belts"]:
    """A number of each belt, or of the only one alone."""
    return of_belts if len(of_belts) > 1 else of_belts[0]


def frame_of(groups: ContactGroups) -> Frame:
    """The pulleys and bodies of a drive, for a string that meets its pulleys at angles."""
    return Frame(
        x=groups.centers[:, 0],
        y=groups.centers[:, 1],
        rho=groups.radii,
        loops=groups.loops,
        bodies=groups.bodies,
        housed=groups.housed,
        K=groups.stiffness,
        outside=groups.outside,
    )
