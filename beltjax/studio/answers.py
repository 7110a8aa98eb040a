"""Answers as the page takes them: plain numbers, names and words, from the compiled programs."""

import base64
import math
from collections.abc import Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from beltjax import optimize
from beltjax.commands.reports.documents import plain
from beltjax.commands.reports.warnings import steady_warnings
from beltjax.drive.buildable import fault_of
from beltjax.drive.components import KINDS
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.results import explanation, succeeded
from beltjax.studio.handles import Handle
from beltjax.studio.programs import Answered, JudgedStudy, Readout

_LARGEST = 12  # numbers listed as those that move the objective most
_STEPS = {"m": 1e-3, "rad": math.pi / 180}  # changes that a person means by "a little" [SI]
_NEAR = 0.05  # of a limit's size: closer than this counts as near
_ON_IT = 1e-9  # likewise: an optimum stands on its limits to rounding, on either side


def fields(drive: Drive, flat: np.ndarray, modes: int) -> dict[str, tuple[int, int]]:
    """Where each field of `Readout` begins in the flat answer, and how many numbers it has."""
    n, bodies, belts = len(drive.pulleys), len(drive.tensioners), len(drive.belts)
    sizes = dict.fromkeys(Readout._fields, n)
    sizes |= {"centers": 2 * n, "starts": 2 * n, "ends": 2 * n, "hub_loads": 2 * n}
    sizes |= {"pivots": 2 * bodies, "coupling_total": 1, "effectiveness": belts, "gap": 1}
    sizes["frequencies"] = len(flat) - sum(sizes.values()) + n if modes else 0
    ends = np.cumsum(list(sizes.values())).tolist()
    return {name: (end - size, size) for (name, size), end in zip(sizes.items(), ends, strict=True)}


def packed(numbers: np.ndarray) -> str:
    """Numbers as the bytes of doubles, which a page reads faster than digits."""
    return base64.b64encode(np.ascontiguousarray(numbers, "<f8").tobytes()).decode()


def fault(drive: Drive, found: Answered) -> dict[str, Any] | None:
    """Why a layout is impossible, and the pulley that is to blame; None where it can be built."""
    drawn = fault_of(drive, found.drawn, found.gaps)
    if drawn is None and bool(succeeded(found.steady.result)):
        drawn = fault_of(drive, found.steady.reference.layout, found.rest_gaps)
    if drawn is not None:
        place = _pulley_in(drive, drawn.key)
        name = "" if place is None else f"{drive.pulley_names[place]}: "
        return {"pulley": place, "key": drawn.key, "text": f"{name}{drawn.message}"}
    if bool(succeeded(found.steady.result)):
        return None
    return {"pulley": None, "key": "", "text": explanation(found.steady.result)}


def _pulley_in(drive: Drive, key: str) -> int | None:
    """Place of the pulley that a key of the drive file is of."""
    names = [name for name in drive.pulley_names if key.startswith(f"pulley.{name}.")]
    return drive.pulley(max(names, key=len)) if names else None


def lights(study: optimize.Study, own: int, found: JudgedStudy) -> list[dict[str, Any]]:
    """Each limit: the part of its quantity that is closest to it, and how far that is.

    `row` holds that part's derivatives by the page's numbers.
    """
    shown, limits = [], study.constraints
    values, slopes = found.values, found.slopes
    # Entries of JAX's arrays are taken by programs of their own, which is slow.
    bounds = zip(*(np.asarray(side).tolist() for side in (limits.lower, limits.upper)), strict=True)
    for i, (name, (low, high)) in enumerate(zip(limits.names, bounds, strict=True)):
        least, greatest = np.asarray(values.least[i]), np.asarray(values.greatest[i])
        k, m = int(np.argmin(least)), int(np.argmax(greatest))
        lower_is_near = least[k] - low <= high - greatest[m]
        value = least[k] if lower_is_near else greatest[m]
        distance = min(least[k] - low, high - greatest[m])
        row = np.asarray(slopes.least[i])[k] if lower_is_near else np.asarray(slopes.greatest[i])[m]
        size = max(abs(low if lower_is_near else high), 1e-12)
        good = bool(values.found)
        state = "unknown"
        if good:
            state = "near" if distance < _NEAR * size else "met"
            state = "missed" if distance < -_ON_IT * size else state
        shown.append(
            {
                "quantity": name,
                "unit": optimize.find_quantity(
                    optimize.study.split_name(name)[0], study.drive
                ).unit,
                "value": plain(value) if good else None,
                "lower": plain(low),
                "upper": plain(high),
                "side": "lower" if lower_is_near else "upper",
                "distance": plain(distance) if good else None,
                "state": state,
                "size": size,
                "implied": i >= own,
                "row": np.asarray(row),
            }
        )
    return shown


def movers(
    units: Mapping[str, str], numbers: Mapping[str, float], slope: np.ndarray
) -> list[dict[str, Any]]:
    """What moves the objective most, by a millimeter, a degree or a percent of each number.

    `units` are those of the numbers, in the order of `slope`.
    """
    found = []
    for (name, unit), one in zip(units.items(), slope, strict=True):
        step = _STEPS.get(unit, abs(numbers[name]) / 100)
        per = {"m": "1 mm", "rad": "1 deg"}.get(unit, "1 %")
        found.append({"name": name, "change": float(one * step), "per": per})
    found.sort(key=lambda row: -abs(row["change"]))
    return [row for row in found if row["change"]][:_LARGEST]


def arrows(
    drive: Drive,
    draggable: Sequence[Handle],
    names: Sequence[str],
    slope: np.ndarray,
    shown: dict[str, np.ndarray],
) -> dict[str, dict[str, float]]:
    """For each handle the direction in which the objective falls fastest, and what a meter gains.

    Directions are unit vectors in the plane of the drive; of a rim "x" is +1 outwards and -1
    inwards, of an arm +1 counterclockwise, and the gain is that of a meter of its pivot's way.
    """
    at, found = dict(zip(names, slope, strict=True)), {}
    for one in draggable:
        g = np.array([sum(at.get(name, 0.0) for name in way) for way in one.names])
        size = float(np.linalg.norm(g))
        if not size or not math.isfinite(size):
            continue
        way = -g / size
        if one.kind == "arm":
            size /= lever(drive, one.place, shown)
        found[one.key] = {
            "x": float(way[0]),
            "y": float(way[1]) if len(way) > 1 else 0.0,
            "gain": size,
        }
    return found


def lever(drive: Drive, body: int, shown: dict[str, np.ndarray]) -> float:
    """From the pivot of a tensioner to the middle of its pulleys, where it rests [m]."""
    carried = [k for k, p in enumerate(drive.pulleys) if np.asarray(p.on)[body]]
    middle = shown["centers"].reshape(-1, 2)[carried].mean(axis=0)
    return float(np.linalg.norm(middle - shown["pivots"].reshape(-1, 2)[body]))


def stops(
    drive: Drive, shown: dict[str, np.ndarray], coordinates: np.ndarray
) -> list[dict[str, Any]]:
    """Each tensioner: what it carries, where it stands and its stops, from where it rests."""
    found = []
    for place, body in enumerate(drive.tensioners):
        rotary = float(body.kind) == KINDS["rotary"]
        least, greatest = (np.asarray(body.stops) - coordinates[place]).tolist()
        direction = np.asarray(body.direction)
        found.append(
            {
                "name": body.name,
                "rotary": rotary,
                "carries": [k for k, p in enumerate(drive.pulleys) if np.asarray(p.on)[place]],
                "at": float(coordinates[place]),
                "to_least": plain(least),
                "to_greatest": plain(greatest),
                "direction": plain(direction / np.linalg.norm(direction)),
                "locked": bool(float(body.locked)),
            }
        )
    return found


def worded_warnings(drive: Drive, point: OperatingPoint, found: Answered) -> list[str]:
    """What limits the trust in the numbers shown, in words."""
    texts = [one["text"] for one in steady_warnings(drive, point, found.steady, found.read)]
    if not bool(jnp.asarray(found.modes_found)):
        texts.append("the natural frequencies were not found: the drive is not stable there")
    return texts
