"""Random drives with movable bodies of every kind, as batches of arrays.

A `Shape` says what compiles; all else is data: which pulleys a body carries and on which other body
it sits, whether it turns or slides, its spring, bolts and stops, housings, faces, the sense of the
list and the direction of travel, and whether the curvature of the mechanism is counted.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from drives import random_drives

import beltjax as bj
from beltjax.validation.peers.bodies import Statics

Arrays = dict[str, Any]


class Shape(NamedTuple):
    """What is fixed for a batch."""

    loops: tuple[int, ...]  # pulleys of each belt
    bodies: int
    springs: int  # between two bodies
    rule: str  # tension, belt, to tension or to mark
    arcs: bool  # whether the belt on the pulleys stretches
    isolators: int = 0
    shaft: int = 0  # the first belt's pulley whose shaft carries the second belt's first pulley


def random_bodies(shape: Shape, count: int, seed: int) -> Arrays:
    """`count` drives of a shape whose drawn layouts are possible."""
    rng = np.random.default_rng([seed, *shape.loops, shape.bodies])
    loops = [
        jax.tree.map(np.asarray, random_drives(n, count, seed + place))
        for place, n in enumerate(shape.loops)
    ]
    drives = [_one(rng, shape, [jax.tree.map(lambda x, i=i: x[i], loop) for loop in loops])
              for i in range(count)]  # fmt: skip
    return {key: np.stack([np.asarray(one[key], float) for one in drives]) for key in drives[0]}


def _one(rng, shape: Shape, loops) -> Arrays:
    centers, radii, faces, _, _, _, tensions, _, rests = zip(*loops, strict=True)
    centers = [part.copy() for part in centers]
    if len(loops) > 1:
        centers[1] += centers[0][shape.shaft] - centers[1][0]
    centers, radii, faces = map(np.concatenate, (centers, radii, faces))
    n, belts = len(radii), len(loops)
    on_shaft = {0, shape.shaft, *np.cumsum([0, *shape.loops])[1:-1]}
    free = rng.permutation([i for i in range(n) if i not in on_shaft])
    made = {
        "centers": centers,
        "radii": radii,
        "faces": faces,
        "EA": [rest["EA"] for rest in rests],
        "EI": [rest["EI"] for rest in rests],
        "mass": rng.uniform(0.05, 0.15, belts),
        "speed": rests[0]["speed"],
        "sense": np.ones(belts),
        "travel": rng.choice([1.0, -1.0]),
        "curvature": rng.choice([0.0, 1.0]),
        "tension": list(tensions),
        "isolated": np.eye(n)[rng.integers(0, n, shape.isolators)],
        **_bodies(rng, shape, centers, free),
    }
    share = rng.dirichlet(np.ones(n)) * (rng.uniform(size=n) < 0.7)
    share[list(on_shaft)] = 0.0
    share[0] = 0.0
    made["torques"] = share * radii * rng.uniform(0, 0.4) * min(tensions)
    made["housed"] = np.where(rng.uniform(size=n) < 0.3, 1.0, 0.0)
    made["housed"][list(on_shaft)] = 0.0
    made = made | _given(rng, shape, made)
    return _mirrored(made) if rng.uniform() < 0.5 else made


def _bodies(rng, shape: Shape, centers, free) -> Arrays:
    k, s, n = shape.bodies, shape.springs, len(centers)
    seat, carries = np.zeros((k, k)), np.zeros((n, k))
    pivots, directions = np.zeros((k, 2)), np.zeros((k, 2))
    kind, stiffness, locked = np.ones(k), np.zeros(k), np.zeros(k)
    stops = np.tile([-np.inf, np.inf], (k, 1))
    adjusted = shape.rule.startswith("to ")
    for a in range(1, k):
        if rng.uniform() < 0.4:
            seat[a, rng.integers(0, a)] = 1.0
    spare = len(free) - k
    for a in range(k):
        twin = spare > 0 and rng.uniform() < 0.3
        held, free = free[: 1 + twin], free[1 + twin :]
        spare -= twin
        bare = seat[:, a].any() and rng.uniform() < 0.5 and not (adjusted and a == 0)
        if not bare:
            carries[held, a] = 1.0
        middle = centers[held].mean(axis=0)
        angle, sort = rng.uniform(0, 2 * np.pi), rng.choice(["arm", "eccentric", "slide"])
        along = np.array([np.cos(angle), np.sin(angle)])
        directions[a], kind[a] = along, float(sort != "slide")
        arm = rng.uniform(0.006, 0.02) if sort == "eccentric" else rng.uniform(0.06, 0.12)
        pivots[a] = middle - arm * along
        unit = 0.1 if sort == "slide" else 1.0
        stiffness[a] = rng.uniform(30, 150) / unit**2 * (arm / 0.1 if sort == "eccentric" else 1)
        if rng.uniform() < 0.15:
            stiffness[a] = 0.0
        locked[a] = float(rng.uniform() < 0.12)
        if rng.uniform() < 0.4:
            reach = rng.uniform(0.0, 0.08, 2) * unit
            stops[a] = np.where(rng.uniform(size=2) < 0.7, [-reach[0], reach[1]], stops[a])
    if adjusted:
        locked[0], locked[1:2] = 1.0, 0.0
        stiffness[1:2] = np.where(stiffness[1:2] > 0, stiffness[1:2], 80.0)
    between, rates = np.zeros((s, k)), np.zeros(s)
    for spring in range(s):
        one, two = np.sort(rng.permutation(k)[:2])
        between[spring, [one, two]] = -1.0, 1.0
        if kind[one] == kind[two]:
            rates[spring] = rng.uniform(30, 150) * (1.0 if kind[one] else 100.0)
    return {
        "on": carries,
        "seat": seat,
        "pivots": pivots,
        "directions": directions,
        "kind": kind,
        "stiffness": stiffness,
        "locked": locked,
        "stops": stops,
        "between": between,
        "rates": rates,
    }


def _given(rng, shape: Shape, made: Arrays) -> Arrays:
    """Lengths and free positions for which the drawn layout is nearly at rest."""
    k, s = shape.bodies, shape.springs
    length, relaxed = Statics(made, shape.loops, shape.shaft).held_as_drawn()
    near = {"belt": 5e-4, "to tension": 2e-3, "to mark": 5e-4}.get(shape.rule, 0.0)
    unit = np.where(made["kind"] > 0, 1.0, 0.1)
    own, free = made["stiffness"], relaxed
    free[:k] += rng.normal(0, 0.01, k) * unit
    if shape.rule in ("tension", "to tension"):
        # A spring between bodies that have springs of their own may be relaxed where it is given.
        free[:k] = np.nan
        spare = [np.all((own > 0) | (row == 0) | (made["locked"] > 0)) for row in made["between"]]
        free[k:] = np.where(np.array(spare, bool) & (rng.uniform(size=s) < 0.5), 0.0, np.nan)
    flags = np.eye(max(k, 2))
    return {
        "length": length * (1 + rng.normal(0, near, len(length))),
        "free": free,
        "adjusted": flags[0][:k],
        "marked": flags[1][:k],
        "mark": rng.normal(0, 0.01) * (unit[1] if k > 1 else 1.0),
    }


def _mirrored(made: Arrays) -> Arrays:
    """The same drive seen from behind: listed clockwise, with all angles reversed."""
    flip = np.array([-1.0, 1.0])
    turned = np.where(made["kind"] > 0, -1.0, 1.0)
    rows = np.concatenate([np.eye(len(turned)), made["between"]])
    # A spring joins two bodies of one kind.
    sign = np.array([turned[np.flatnonzero(row)[0]] for row in rows])
    stops = np.where(turned[:, None] < 0, -made["stops"][:, ::-1], made["stops"])
    return made | {
        "centers": made["centers"] * flip,
        "pivots": made["pivots"] * flip,
        "directions": made["directions"] * flip,
        "sense": -np.asarray(made["sense"]),
        "stops": stops,
        "free": made["free"] * sign,
        "mark": made["mark"] * (turned[1] if len(turned) > 1 else 1.0),
    }


def build(arrays: Arrays, shape: Shape) -> tuple[bj.Drive, bj.OperatingPoint]:
    """The drive and its operating point."""
    a, names = arrays, [f"b{place}" for place in range(len(shape.loops))]
    belt_of = np.repeat(np.arange(len(names)), shape.loops)
    several = len(names) > 1
    pulleys = [
        bj.Pulley(
            name=f"p{i}",
            center=a["centers"][i],
            radius=a["radii"][i],
            face=a["faces"][i],
            driver=float(i == 0),
            on=a["on"][i],
            housed=a["housed"][i],
            belt=names[belt],
            shaft=f"p{shape.shaft}" if several and i == shape.loops[0] else None,
        )
        for i, belt in enumerate(belt_of)
    ]
    bodies = [
        bj.Tensioner(
            pivot=a["pivots"][b],
            direction=a["directions"][b],
            kind=a["kind"][b],
            stiffness=a["stiffness"][b],
            locked=a["locked"][b],
            stops=a["stops"][b],
            on=a["seat"][b],
            name=f"t{b}",
        )
        for b in range(shape.bodies)
    ]
    drive = bj.Drive(
        belts=[
            bj.Belt(a["EA"][b], a["EI"][b], a["mass"][b], name=name) for b, name in enumerate(names)
        ],
        pulleys=pulleys,
        installation=_rule(a, shape),
        tensioners=bodies,
        arm_springs=[
            bj.ArmSpring(a["between"][s], a["rates"][s], name=f"s{s}") for s in range(shape.springs)
        ],
        isolators=[
            bj.Isolator(a["isolated"][i], 500.0, name=f"i{i}") for i in range(shape.isolators)
        ],
        model=bj.Model(a["curvature"], shape.arcs),
        sense=a["sense"] if several else a["sense"][0],
    )
    torque = {f"p{i}": a["torques"][i] for i in range(1, len(belt_of))}
    return drive, bj.OperatingPoint(belt_speed=a["speed"], torque=torque, travel=a["travel"])


def _rule(a: Arrays, shape: Shape):
    several = len(shape.loops) > 1
    tension, length = (x if several else x[0] for x in (a["tension"], a["length"]))
    free = a["free"] if shape.bodies else None
    if shape.rule == "tension":
        return bj.TensionGiven(tension, free=free)
    if shape.rule == "belt":
        return bj.BeltGiven(length, free=free)
    if shape.rule == "to tension":
        return bj.AdjustedToTension(length, tension, jnp.asarray(a["adjusted"]), free=free)
    return bj.AdjustedToMark(length, free, a["adjusted"], a["marked"], a["mark"])
