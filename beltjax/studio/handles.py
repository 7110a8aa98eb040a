"""What can be dragged on the page, and the numbers of the drive file that it changes."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from beltjax.drive.components import KINDS
from beltjax.drive.numbers import (
    SPEEDS,
    fact_of,
    full_key,
    is_relative,
    number_names,
    tensioner_key,
    unit_of,
    variable_names,
)
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive

_ANGLE = ".angle"


class Handle(NamedTuple):
    """A thing that is dragged.

    The `kind` says how: "center" and "pivot" move in the plane by `names` (x, y), each of which may
    be several keys that move together; "rim" changes a radius, "arm" turns a tensioner as a whole
    about the center of its pulleys.
    """

    kind: str
    label: str  # for people and screen readers
    place: int  # of the pulley, or of the tensioner
    names: tuple[tuple[str, ...], ...]

    @property
    def key(self) -> str:
        """The name by which the page speaks of it."""
        return f"{self.kind}:{self.place}"


def handles(drive: Drive) -> tuple[Handle, ...]:
    """Everything of a drive that can be dragged. Pulleys of one shaft move together."""
    shafts = {place: shaft for shaft in drive.shafts for place in shaft}
    found = []
    for place, name in enumerate(drive.pulley_names):
        together = [drive.pulley_names[k] for k in shafts.get(place, (place,))]
        ways = tuple(tuple(f"pulley.{one}.center.{way}" for one in together) for way in "xy")
        found.append(Handle("center", f"center of {name}", place, ways))
        found.append(Handle("rim", f"radius of {name}", place, ((f"pulley.{name}.radius",),)))
    variables = set(variable_names(drive))
    for place, body in enumerate(drive.tensioners):
        key = tensioner_key(drive, place)
        if float(body.kind) == KINDS["rotary"]:
            ways = tuple((f"{key}.pivot.{way}",) for way in "xy")
            found.append(Handle("pivot", f"pivot of {body.name}", place, ways))
        if key + _ANGLE in variables:
            found.append(Handle("arm", f"angle of {body.name}", place, ((key + _ANGLE,),)))
    return tuple(found)


def page_names(drive: Drive, point: OperatingPoint, wanted: Sequence[str] = ()) -> tuple[str, ...]:
    """Keys of the numbers by which everything on the page is differentiated.

    Those that are dragged, all that a study may choose, the `wanted` ones, torques and the speed
    that `point` gives. The length of an arm and a preload follow from others and are there where
    they are wanted.
    """
    dragged = [name for one in handles(drive) for way in one.names for name in way]
    chosen = [n for n in variable_names(drive) if not is_relative(n) or n.endswith(_ANGLE)]
    running = [n for n in number_names(drive) if n.startswith("operation.torque.")]
    speed = SPEEDS[0] if point.driver_speed is None else SPEEDS[1]
    named = [full_key(drive, n) for n in (*dragged, *chosen, *wanted, speed, *running)]
    return tuple(dict.fromkeys(named))


def turns(drive: Drive, first: Drive, of: Sequence[Handle]) -> dict[str, float]:
    """By how much each arm of `drive` is turned from where `first` has it [rad], by its key."""
    found = {}
    for one in of:
        if one.kind == "arm":
            now, then = (_arm(of, one.place) for of in (drive, first))
            cross, dot = then[0] * now[1] - then[1] * now[0], float(then @ now)
            found[one.names[0][0]] = float(np.arctan2(cross, dot))
    return found


def _arm(drive: Drive, body: int) -> np.ndarray:
    """From the pivot of a tensioner to the middle of its pulleys, as drawn [m]."""
    centers = [np.asarray(p.center) for p in drive.pulleys if np.asarray(p.on)[body]]
    return np.mean(centers, axis=0) - np.asarray(drive.tensioners[body].pivot)


def descriptions(drive: Drive, names: Sequence[str]) -> list[dict[str, Any]]:
    """Key, SI unit and what it is of each number, for the page's list of exact values."""
    return [{"name": n, "unit": unit_of(drive, n), "about": fact_of(drive, n)[0].doc}
            for n in names]  # fmt: skip
