"""One belt of a drive with several, as a drive of its own."""

import dataclasses

import numpy as np

from beltjax.drive.bodies import bodies
from beltjax.drive.installation import BeltGiven, Preloaded, TensionGiven
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.shafts import transmission
from beltjax.drive.system import Drive


def one_belt(drive: Drive, point: OperatingPoint, name: str) -> tuple[Drive, OperatingPoint]:
    """A drive of the belt `name` alone, with the pulleys and tensioners on it, and how it runs.

    The pulley nearest to the driver drives the belt. The others take what their shafts need, those
    that lead to further belts included. Isolators and dampers, which affect vibration alone, are
    left out. A drive with a single belt is returned as it is. The function cannot be traced by JAX.

    Args:
        drive: a drive of one belt or several.
        point: speeds and torques.
        name: name of the belt.

    Returns:
        The drive of that belt, and its operating point.

    Raises:
        KeyError: there is no belt of that name.
        ValueError: a tensioner moves the belt together with another, or the installation adjusts
            a tensioner.
    """
    names = [belt.name for belt in drive.belts]
    if name not in names:
        raise KeyError(f"no belt {name!r}; there are {', '.join(names)}")
    if len(names) == 1:
        return drive, point
    which = names.index(name)
    places = np.flatnonzero(drive.belt_of_span == which)
    driven, moved = transmission(drive, point), np.asarray(bodies(drive).carried) > 0
    own = np.flatnonzero(moved[places].any(axis=0))
    others = np.delete(moved, places, axis=0)
    if others[:, own].any():
        raise ValueError(f"Belt {name!r}: a tensioner moves another belt, too; keep both together.")
    pulleys = tuple(
        dataclasses.replace(
            drive.pulleys[p],
            on=np.asarray(drive.pulleys[p].on)[own],
            belt=None,
            shaft=None,
            driver=float(driven.gives[p]),
        )
        for p in places
    )
    springs = [spring for spring in drive.arm_springs if np.any(np.asarray(spring.between)[own])]
    kept = [
        *own,
        *(len(drive.tensioners) + drive.arm_springs.index(spring) for spring in springs),
    ]
    rule = drive.installation
    if not isinstance(rule, TensionGiven | BeltGiven | Preloaded):
        raise ValueError(f"Belt {name!r}: its installation adjusts a tensioner; give its length.")
    changes = {} if rule.free is None else {"free": np.asarray(rule.free)[kept]}
    if isinstance(rule, TensionGiven):
        rule = dataclasses.replace(rule, tension=rule.tension[which], **changes)
    elif isinstance(rule, Preloaded):
        rule = dataclasses.replace(rule, **changes)
    else:
        free = changes.get("free") if kept else None
        rule = dataclasses.replace(rule, belt_length=rule.belt_length[which], free=free)
    sense = np.broadcast_to(np.asarray(drive.sense), len(names))[which]
    alone = Drive(
        belts=(drive.belts[which],),
        pulleys=pulleys,
        installation=rule,
        tensioners=tuple(
            dataclasses.replace(drive.tensioners[a], on=np.asarray(drive.tensioners[a].on)[own])
            for a in own
        ),
        arm_springs=tuple(
            dataclasses.replace(spring, between=np.asarray(spring.between)[own])
            for spring in springs
        ),
        model=drive.model,
        sense=sense,
        gravity=drive.gravity,
        name=f"{drive.name}, {name}",
    )
    torque = {
        drive.pulley_names[p]: driven.torques[p] for p in places if not float(driven.gives[p])
    }
    return alone, OperatingPoint(
        belt_speed=driven.speeds[places[0]],
        torque=torque,
        travel=float(driven.travel[places[0]]) or 1.0,
    )
