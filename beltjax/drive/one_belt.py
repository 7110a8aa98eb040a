"""One belt of a drive with several, as a drive of its own."""

import dataclasses

import numpy as np

from beltjax.drive.bodies import bodies
from beltjax.drive.installation import BeltGiven, TensionGiven
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.shafts import transmission
from beltjax.drive.system import Drive


def one_belt(drive: Drive, point: OperatingPoint, name: str) -> tuple[Drive, OperatingPoint]:
    """The belt of that name, the pulleys and tensioners on it, and how it runs.

    The pulley nearest to the driver drives it; the others take what their shafts need, those on
    the way to further belts included. Isolators and dampers, which vibration alone feels, are
    left out. Not for tracing. Of a drive with one belt, the drive itself.

    Raises `KeyError` for a belt that is not there, `ValueError` for one that a tensioner moves
    together with another, and for a belt whose tensioner is adjusted.
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
        raise ValueError(f"Belt {name!r}: a tensioner moves another belt, too; take both together.")
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
    if not isinstance(rule, TensionGiven | BeltGiven):
        raise ValueError(f"Belt {name!r}: its installation adjusts a tensioner; give its length.")
    changes = {} if rule.free is None else {"free": np.asarray(rule.free)[kept]}
    if isinstance(rule, TensionGiven):
        rule = dataclasses.replace(rule, tension=rule.tension[which], **changes)
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
