"""Ways to find a belt in grooves, limits of its torques, and what they cannot do without."""

from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from beltjax.analysis.contact import without_friction
from beltjax.drive.components import Pulley, as_real, concrete
from beltjax.drive.installation import BeltGiven, TensionGiven
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive, all_held

ROUNDS = 18  # of the search for the limit of adhesion


class Groove(eqx.Module):
    """The full model, by collocation on each arc."""

    slip_velocity: Float[Array, ""] = eqx.field(converter=as_real, default=1e-5)
    elements: int = eqx.field(static=True, default=400)


class ThinGroove(eqx.Module):
    """Formulas for a belt that sinks in little, with Coulomb's friction; up to `AdhesionLimit`."""


class SlipLimit(eqx.Module):
    """Torques up to which no loaded pulley slips more than this: 1 - (omega R)/(omega R)_driver."""

    slip: Float[Array, ""] = eqx.field(converter=as_real, default=0.05)


class AdhesionLimit(eqx.Module):
    """Torques up to which some of the belt adheres on every loaded pulley."""


def groove_method(drive: Drive) -> Groove | ThinGroove:
    """The method that the drive itself gives, by [contact] of its file."""
    if drive.contact.model == "thin":
        return ThinGroove()
    return Groove(slip_velocity=drive.contact.slip_velocity)


def _is_thin(method: Groove | ThinGroove) -> bool:
    return isinstance(method, ThinGroove)


def groove_question(
    method: Groove | ThinGroove, limit: SlipLimit | AdhesionLimit | None
) -> tuple[Groove | ThinGroove, Float[Array, ""], Float[Array, ""], int]:
    """Method and limit as `groove_solution` takes them."""
    if isinstance(limit, AdhesionLimit):
        return method, as_real(2.0), as_real(0.0), 0 if _is_thin(method) else ROUNDS
    if limit is None:
        return method, as_real(0.0), as_real(0.0), 0
    return method, as_real(1.0), limit.slip, 0


class UnmetGroove(NamedTuple):
    """What keeps a drive from being asked, by its key in a drive file."""

    key: str
    message: str


def unmet_groove(drive: Drive, point: OperatingPoint | None, maximum: bool) -> UnmetGroove | None:
    """What the model of grooves cannot do without; None where nothing is missing.

    Without a point, what is missing whatever the torques.
    """
    if len(drive.belts) > 1:
        return UnmetGroove("belt", "are several; grooves are found for a drive of one belt")
    if drive.belt.wedge_angle is None:
        message = "is missing; grooves need groove = { angle, wedge_stiffness } of the belt"
        return UnmetGroove("belt.groove", message)
    if drive.belt.pitch is not None:
        return UnmetGroove("belt.pitch", "is of a toothed belt, which does not wedge")
    if not isinstance(drive.installation, TensionGiven | BeltGiven):
        message = "gives the belt by other means than tension or belt_length; give one of these"
        return UnmetGroove("installation", message)
    if getattr(drive.installation, "tension_of", "belt") == "string":
        message = "is that of a string, which does not sink in; leave tension_of out"
        return UnmetGroove("installation.tension_of", message)
    floating = drive.tensioners and all_held(drive.tensioners) is False
    if floating:
        message = "has no spring and is not locked; in grooves each tensioner has one"
        return UnmetGroove("tensioner", message)
    return _unmet_pulley(drive, point, maximum)


def _unmet_pulley(drive: Drive, point: OperatingPoint | None, maximum: bool) -> UnmetGroove | None:
    bare = None if point is None else without_friction(drive, point, maximum)
    wedged = [p.name for p in drive.pulleys if p.friction is None and _may_wedge(p)]
    if wedged or bare is not None:
        message = "is missing; give the coefficient of the groove's flanks, or of the smooth rim"
        return UnmetGroove(f"pulley.{wedged[0] if wedged else bare}.friction", message)
    for pulley in drive.pulleys:
        own = pulley.wedge_angle
        angle = concrete(drive.belt.wedge_angle if own is None else own)
        friction = concrete(pulley.friction)
        if angle is None or friction is None or not _may_wedge(pulley):
            continue
        if np.any(angle / 2 + np.arctan(friction) >= np.pi / 2):
            key = "belt.groove" if own is None else f"pulley.{pulley.name}.groove"
            message = "and friction leave no wedge: half the angle + atan(friction) is below 90 deg"
            return UnmetGroove(f"{key}.angle", message)
    return None


def _may_wedge(pulley: Pulley) -> bool:
    """Whether a pulley has a groove, or may have one where JAX traces its flags."""
    face, wedged = concrete(pulley.face), concrete(pulley.wedged)
    if face is None or wedged is None:
        return True
    return bool(np.any((face > 0) & (wedged > 0)))
