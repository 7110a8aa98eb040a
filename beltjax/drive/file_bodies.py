"""The tensioners of a drive file, read and written: [tensioner], [[tensioner]], [[arm_spring]]."""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from beltjax.drive.components import KINDS, NO_STOPS, ArmSpring, Tensioner
from beltjax.drive.file_tables import (
    ArmTable,
    DriveTable,
    LinearTable,
    PulleyTable,
    RotaryTable,
    TwinArmTable,
)
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.files.fields import numbers
from beltjax.files.tables import checked, given_numbers

SINGLE = "tensioner"  # name of the one that [tensioner] describes
_MOST_BODIES = 12  # compiling grows with their number
# A twin arm is two tensioners, whose names end in .0 and .1.
_OF_TWIN = re.compile(r"(?P<twin>[^.:=]+)(\.[01])?")
_OF_MOVING_PIVOT = ("mass", "mass_center", "inertia_center")


class Body(NamedTuple):
    """One tensioner of a file: a coordinate, and what moves with it."""

    name: str
    key: str  # of its table, in messages
    kind: str  # "rotary" or "linear"
    carried: tuple[str, ...]  # names of pulleys
    on: str | None
    locked: bool
    numbers: dict[str, Any]  # of `Tensioner`


class Spring(NamedTuple):
    """A spring of a file between two tensioners."""

    name: str
    between: tuple[str, str]
    stiffness: float
    damping: float


class BodiesOfFile(NamedTuple):
    """The tensioners of a file, parents first, and the springs between them."""

    bodies: list[Body]
    springs: list[Spring]

    @property
    def rows(self) -> np.ndarray:
        """Elongation of each spring per unit of each coordinate, the tensioners' own springs first.

        The columns are in the order of `bodies`.
        """
        names = [body.name for body in self.bodies]
        rows = [*np.eye(len(names))]
        return np.array(rows + [between(spring, names) for spring in self.springs])

    @property
    def spring_names(self) -> list[str]:
        """Names of all springs, in the order of `rows`."""
        return [part.name for part in (*self.bodies, *self.springs)]

    @property
    def stiffness(self) -> np.ndarray:
        """Stiffness of each spring, in the order of `rows`."""
        own = [body.numbers["stiffness"] for body in self.bodies]
        return np.array([*own, *(spring.stiffness for spring in self.springs)])

    @property
    def kinds(self) -> list[str]:
        """Kind of the coordinate on which each spring acts, in the order of `rows`."""
        kind_of = {body.name: body.kind for body in self.bodies}
        return [*kind_of.values(), *(kind_of[spring.between[0]] for spring in self.springs)]


def between(spring: Spring, names: Sequence[str]) -> np.ndarray:
    """-1 at the place of the first of the two tensioners, 1 at the second's."""
    first, second = spring.between
    return np.array([float(name == second) - float(name == first) for name in names])


def arm_direction(centers: Any, pivot: Any) -> float:
    """Direction [rad] from a pivot to the middle of the pulleys with these centers."""
    x, y = np.mean(np.asarray(centers, float), axis=0) - np.asarray(pivot, float)
    return float(np.arctan2(y, x))


def read_bodies(file: DriveTable, shafts: Sequence[Sequence[str]], path: object) -> BodiesOfFile:
    """The tensioners of a file whose pulleys are on these shafts; raises `FileError`."""
    bodies, springs = _expanded(file, path)
    if len(bodies) > _MOST_BODIES:
        message = f"found {len(bodies)}; a drive file has {_MOST_BODIES} at most"
        raise FileError(path, "tensioner", message)
    _require_names([*((b.name, b.key) for b in bodies), *springs.keys()], path)
    bodies = _with_shafts(_require_carried(file, bodies, path), shafts, path)
    for body in bodies:
        _require_numbers(body, path)
    bodies = _parents_first(bodies, path)
    for body in bodies:
        if not body.carried and body.name not in [other.on for other in bodies]:
            message = "carries no pulley and no other tensioner; name the pulleys, or remove it"
            raise FileError(path, f"{body.key}.pulleys", message)
    kinds = {body.name: body.kind for body in bodies}
    made = [make(kinds) for make in springs.values()]
    return BodiesOfFile(bodies, made)


def _expanded(file: DriveTable, path: object) -> tuple[list[Body], dict[tuple[str, str], Any]]:
    """One body per coordinate; and for each spring a function that makes it.

    The functions go by the springs' names and keys, and take the kinds of all bodies by name.
    """
    if file.tensioner is None:
        bodies, springs = [], {}
    elif isinstance(file.tensioner, ArmTable):
        bodies, springs = [_single(file.tensioner, file.pulley, path)], {}
    else:
        bodies, springs = [], {}
        for place, table in enumerate(file.tensioner):
            name, key = table.name or SINGLE, f"tensioner.{table.name}"
            if table.name is None:
                key = f"tensioner[{place}]"
                if len(file.tensioner) > 1:
                    raise FileError(path, f"{key}.name", "is missing; name each of several")
            if isinstance(table, TwinArmTable):
                arms, spring = _twin(table, name, key, path)
                bodies += arms
                springs[name, key] = lambda kinds, spring=spring: spring
            else:
                bodies.append(_one(table, name, key, path))
    for table in file.arm_spring:
        springs[table.name, f"arm_spring.{table.name}"] = _spring_maker(table, path)
    if len(springs) < len(file.arm_spring):
        raise FileError(path, "arm_spring", "two have the same name; rename one of them")
    return bodies, springs


def require_one_arm(content: dict[str, Any], path: object) -> None:
    """Raise `FileError` for a key of [[tensioner]] in [tensioner], whose stops differ."""
    table = content.get("tensioner")
    known = {*RotaryTable.model_fields, *LinearTable.model_fields, *TwinArmTable.model_fields}
    for key in table if isinstance(table, dict) else ():
        if key in known - set(ArmTable.model_fields):
            message = (
                "belongs to [[tensioner]]; write that heading, under which stops are counted from "
                "the drawn position, or remove this"
            )
            raise FileError(path, f"{SINGLE}.{key}", message)


def _single(table: ArmTable, pulleys: list[PulleyTable], path: object) -> Body:
    """The arm of [tensioner]; its stops, which are directions, become turns from the drawn one."""
    given = given_numbers(table, Tensioner)
    if not given["stiffness"] > 0:
        message = "found 0; must be greater than 0; an arm without a spring is a [[tensioner]]"
        raise FileError(path, f"{SINGLE}.stiffness", message)
    centers = [pulley.number("center") for pulley in pulleys if pulley.name == table.pulley]
    if "stops" in given and centers:
        given["stops"] = relative_stops(given["stops"], arm_direction(centers, given["pivot"]))
    return Body(SINGLE, SINGLE, "rotary", (table.pulley,), None, False, given)


def relative_stops(stops: Sequence[float], drawn: float) -> list[float]:
    """Stops given by their directions as angles from the `drawn` one, on the nearest branch."""
    bounds = [stop for stop in stops if np.isfinite(stop)]
    middle = float(np.mean(bounds)) if bounds else drawn
    turns = float(2 * np.pi * np.round((middle - drawn) / (2 * np.pi)))
    return [stop - turns - drawn for stop in stops]


def _one(table: RotaryTable | LinearTable, name: str, key: str, path: object) -> Body:
    given = {"stiffness": 0.0} | given_numbers(table, Tensioner)
    if isinstance(table, LinearTable):
        given["direction"] = table.direction
    carried = _carried(table.pulley, table.pulleys, key, path)
    heavy = [field for field in _OF_MOVING_PIVOT if field in given]
    if table.on is not None and "inertia" in given:
        message = "is about a pivot that moves; give mass, mass_center and inertia_center instead"
        raise FileError(path, f"{key}.inertia", message)
    if heavy and "mass" not in given:
        raise FileError(path, f"{key}.mass", f"is missing; {heavy[0]} goes with it")
    if heavy and "mass_center" not in given and (table.on or table.kind == "rotary"):
        raise FileError(path, f"{key}.mass_center", "is missing; mass goes with it")
    # A body with a mass, or a bolted one, needs no inertia: with 0 the structures are equal.
    if heavy or table.locked:
        given = {"inertia": 0.0} | given
    return Body(name, key, table.kind, carried, table.on, table.locked, given)


def _twin(table: TwinArmTable, name: str, key: str, path: object) -> tuple[list[Body], Spring]:
    carried = _carried(table.pulley, table.pulleys, key, path)
    if len(carried) != 2:
        message = f"found {len(carried)}; a twin arm carries two, one on each arm"
        raise FileError(path, f"{key}.pulleys", message)
    bodies = []
    for arm, pulley in enumerate(carried):
        parts = {
            "stiffness": (table.ground_stiffness or [0.0, 0.0])[arm],
            "pivot": table.number("pivot"),
            "damping": (table.ground_damping or [0.0, 0.0])[arm],
            "inertia": None if table.inertia is None else table.inertia[arm],
            "stops": None if table.stops is None else table.stops[arm],
        }
        given = {field: value for field, value in parts.items() if value is not None}
        bodies.append(Body(f"{name}.{arm}", key, "rotary", (pulley,), None, False, given))
    ends = (bodies[0].name, bodies[1].name)
    return bodies, Spring(name, ends, table.number("stiffness"), table.number("damping") or 0.0)


def _carried(one: str | None, several: list[str] | None, key: str, path: object) -> tuple[str, ...]:
    if one is not None and several is not None:
        raise FileError(path, f"{key}.pulleys", "stands beside pulley; give one of them")
    if one is None and several is None:
        message = "is missing; name the pulley that it carries, or give pulleys = [] for none"
        raise FileError(path, f"{key}.pulley", message)
    return tuple(several if several is not None else [one or ""])


def _spring_maker(table: Any, path: object) -> Any:
    key = f"arm_spring.{table.name}"

    def made(kinds: Mapping[str, str]) -> Spring:
        first, second = table.between
        for name in table.between:
            if name not in kinds:
                known = ", ".join(kinds) or "none"
                message = f"there is no tensioner {name!r}; there are: {known}"
                raise FileError(path, f"{key}.between", message)
        if first == second:
            raise FileError(path, f"{key}.between", f"found {first!r} twice; name two tensioners")
        if kinds[first] != kinds[second]:
            message = f"{first!r} is {kinds[first]}, {second!r} {kinds[second]}; give two of a kind"
            raise FileError(path, f"{key}.between", message)
        values = {}
        for field in ("stiffness", "damping"):
            try:
                fact = numbers(ArmSpring)[field]
                values[field] = checked(getattr(table, field), fact, kinds[first])
            except ValueError as error:
                raise FileError(path, f"{key}.{field}", str(error)) from error
        return Spring(table.name, (first, second), **values)

    return made


def _require_names(named: Iterable[tuple[str, str]], path: object) -> None:
    seen: list[str] = []
    for name, key in named:
        if not name.strip() or not _OF_TWIN.fullmatch(name) or not name.isprintable():
            message = f"found {name!r}; a name prints, is not empty, and is without . : ="
            raise FileError(path, f"{key.split('.')[0]}.name", message)
        if name in seen:
            message = f"the name {name!r} of a tensioner or arm spring is used twice; rename one"
            raise FileError(path, key, message)
        seen.append(name)


def _require_carried(file: DriveTable, bodies: list[Body], path: object) -> list[Body]:
    known = [pulley.name for pulley in file.pulley]
    drivers = [pulley.name for pulley in file.pulley if pulley.driver]
    owner: dict[str, Body] = {}
    for body in bodies:
        key = f"{body.key}.pulley" if len(body.carried) == 1 else f"{body.key}.pulleys"
        for name in body.carried:
            if name not in known:
                message = f"there is no pulley {name!r}; give one of {', '.join(known)}"
                raise FileError(path, key, message)
            if name in drivers:
                message = (
                    f"found the driver {name!r}; name an idler, or, where a motor swings, mark the "
                    "driven machine as driver, and give the motor its torque, which is negative"
                )
                raise FileError(path, key, message)
            if name in owner:
                other = owner[name].name
                message = f"pulley {name!r} is on tensioner {other!r} already; one may carry it"
                raise FileError(path, key, message)
            owner[name] = body
    return bodies


def _with_shafts(bodies: list[Body], shafts: Sequence[Sequence[str]], path: object) -> list[Body]:
    """Bodies that carry all pulleys of a shaft of which they carry one."""
    owner = {name: body.name for body in bodies for name in body.carried}
    grown = []
    for body in bodies:
        carried = list(body.carried)
        for shaft in shafts:
            if not set(shaft) & set(body.carried):
                continue
            for name in shaft:
                if owner.get(name, body.name) != body.name:
                    mate = next(iter(set(shaft) & set(body.carried)))
                    message = (
                        f"pulley {mate!r} is on the shaft of {name!r}, which tensioner "
                        f"{owner[name]!r} carries; one tensioner may carry a shaft"
                    )
                    raise FileError(path, f"{body.key}.pulley", message)
                carried += [] if name in carried else [name]
        grown.append(body._replace(carried=tuple(carried)))
    return grown


def _require_numbers(body: Body, path: object) -> None:
    stops = body.numbers.get("stops")
    if stops is not None and not stops[0] < stops[1]:
        shown = [float(f"{stop:.6g}") for stop in stops]
        raise FileError(path, f"{body.key}.stops", f"found {shown}; give [least, greatest]")


def _parents_first(bodies: list[Body], path: object) -> list[Body]:
    """`bodies`, each after the one that it sits on; otherwise in the order of the file."""
    names = [body.name for body in bodies]
    for body in bodies:
        if body.on is not None and body.on not in names:
            message = f"there is no tensioner {body.on!r}; give one of {', '.join(names)}"
            raise FileError(path, f"{body.key}.on", message)
    left, placed = list(bodies), []
    while left:
        ready = next((b for b in left if b.on is None or b.on in [p.name for p in placed]), None)
        if ready is None:
            chain = ", ".join(f"{body.name!r} on {body.on!r}" for body in left)
            message = f"tensioners sit on each other in a circle ({chain}); take one off"
            raise FileError(path, f"{left[0].key}.on", message)
        placed.append(ready)
        left.remove(ready)
    return placed


def bodies_content(drive: Drive) -> dict[str, Any]:
    """The keys `tensioner` and `arm_spring` of the file of a drive; absent where it has none.

    One arm is written as [tensioner] where its numbers come back from that exactly. Numbers that
    have no effect are left out: the direction of an arm, the pivot of a slide.
    """
    single = _single_content(drive)
    if single is not None:
        return {"tensioner": single}
    twins = _twins(drive)
    tables, springs = [], []
    for place, body in enumerate(drive.tensioners):
        if place in twins:
            tables.append(_twin_content(drive, place))
        elif place - 1 not in twins:
            tables.append(_body_content(drive, place, body))
    for spring in drive.arm_springs[len(twins) :]:
        first, second = (int(np.argmax(sign * np.asarray(spring.between))) for sign in (-1, 1))
        names = [drive.tensioners[first].name, drive.tensioners[second].name]
        table = {"name": spring.name, "between": names, "stiffness": float(spring.stiffness)}
        springs.append(table | ({"damping": float(spring.damping)} if spring.damping else {}))
    content = {"tensioner": tables, "arm_spring": springs}
    return {key: value for key, value in content.items() if value}


def _carried_by(drive: Drive, place: int) -> list[str]:
    return [pulley.name for pulley in drive.pulleys if float(pulley.on[place])]


def _is_plain_arm(body: Tensioner) -> bool:
    """Whether a tensioner is a free arm about a fixed pivot, without a mass of its own."""
    heavy = any(np.any(np.asarray(getattr(body, field))) for field in _OF_MOVING_PIVOT)
    bound = float(body.locked) or np.any(np.asarray(body.on)) or float(body.force)
    return float(body.kind) == KINDS["rotary"] and not heavy and not bound


def _listed(value: Any) -> Any:
    return np.asarray(value).tolist()


def _single_content(drive: Drive) -> dict[str, Any] | None:
    """The [tensioner] that describes the drive's only tensioner, if one does exactly."""
    body = drive.tensioner
    if body is None or body.name != SINGLE or not _is_plain_arm(body) or drive.arm_springs:
        return None
    carried = _carried_by(drive, 0)
    if len(carried) != 1 or not float(body.stiffness) > 0:
        return None
    content = _numbers_content(body, ("pivot", "stiffness", "inertia", "damping", "stops"))
    content |= _numbers_content(body, _FRICTION)
    if "stops" in content:
        center = np.asarray(drive.pulleys[drive.pulley(carried[0])].center)
        drawn, stops = arm_direction([center], body.pivot), content["stops"]
        content["stops"] = [stop + drawn for stop in stops]
        if relative_stops(content["stops"], drawn) != stops:
            return None
    return {"pulley": carried[0]} | content


_FRICTION = (
    "friction_torque",
    "friction_hub",
    "friction_spring",
    "friction_unwinding",
    "friction_speed",
)
# Of numbers that a file need not give.
_SILENT = {
    "damping": 0.0,
    "force": 0.0,
    "stops": list(NO_STOPS),
    "friction_torque": 0.0,
    "friction_hub": 0.0,
    "friction_spring": 0.0,
    "friction_unwinding": 1.0,
    "friction_speed": 0.02,
}


def _numbers_content(body: Tensioner, fields: Iterable[str]) -> dict[str, Any]:
    """Numbers of a tensioner, without those that a file need not give."""
    content = {}
    for field in fields:
        value = getattr(body, field)
        silent = _SILENT.get(field)
        if value is not None and _listed(value) != silent:
            content[field] = _listed(value)
    return content


def _body_content(drive: Drive, place: int, body: Tensioner) -> dict[str, Any]:
    linear = float(body.kind) == KINDS["linear"]
    mounted, carried = np.asarray(body.on), _carried_by(drive, place)
    content: dict[str, Any] = {"name": body.name} | ({"kind": "linear"} if linear else {})
    content |= {"pulley": carried[0]} if len(carried) == 1 else {"pulleys": carried}
    content |= _numbers_content(body, ("direction" if linear else "pivot", "stiffness"))
    heavy = any(np.any(np.asarray(getattr(body, field))) for field in _OF_MOVING_PIVOT)
    if np.any(mounted):
        content["on"] = drive.tensioners[int(np.argmax(mounted))].name
        if body.inertia is not None and float(body.inertia):
            raise ValueError(
                f"Tensioner {body.name!r}: inertia about a pivot that moves cannot be saved; give "
                "mass, mass_center and inertia_center instead."
            )
        heavy = heavy or (body.inertia is not None and not float(body.locked))
    if heavy:
        content |= _numbers_content(body, _OF_MOVING_PIVOT)
    if not (heavy or "on" in content) or (body.inertia is not None and float(body.inertia)):
        content |= _numbers_content(body, ("inertia",))
    content |= _numbers_content(body, ("damping", "stops", "force", *_FRICTION))
    return content | ({"locked": True} if float(body.locked) else {})


def _twins(drive: Drive) -> list[int]:
    """Places of the first arms of those twins that one table of a file can describe.

    Their springs come first among the arm springs, in the order of the twins.
    """
    found = []
    for place, (one, two) in enumerate(zip(drive.tensioners, drive.tensioners[1:], strict=False)):
        name = one.name.removesuffix(".0")
        if (
            one.name != f"{name}.0"
            or two.name != f"{name}.1"
            or len(drive.arm_springs) <= len(found)
        ):
            continue
        spring = drive.arm_springs[len(found)]
        ends = [float(i == place + 1) - float(i == place) for i in range(len(drive.tensioners))]
        alike = np.array_equal(one.pivot, two.pivot) and (one.inertia is None) == (
            two.inertia is None
        )
        smooth = not any(_numbers_content(arm, _FRICTION) for arm in (one, two))
        plain = _is_plain_arm(one) and _is_plain_arm(two) and alike and smooth
        single = all(len(_carried_by(drive, k)) == 1 for k in (place, place + 1))
        if spring.name == name and _listed(spring.between) == ends and plain and single:
            found.append(place)
    return found


def _twin_content(drive: Drive, place: int) -> dict[str, Any]:
    arms = drive.tensioners[place : place + 2]
    name = arms[0].name.removesuffix(".0")
    spring = next(spring for spring in drive.arm_springs if spring.name == name)
    content: dict[str, Any] = {
        "name": name,
        "kind": "twin-arm",
        "pulleys": [_carried_by(drive, place + k)[0] for k in range(2)],
        "pivot": _listed(arms[0].pivot),
        "stiffness": float(spring.stiffness),
    }
    if spring.damping:
        content["damping"] = float(spring.damping)
    for key, field in (
        ("ground_stiffness", "stiffness"),
        ("ground_damping", "damping"),
        ("inertia", "inertia"),
        ("stops", "stops"),
    ):
        values = [getattr(arm, field) for arm in arms]
        silent = {"inertia": [None, None], "stops": [list(NO_STOPS)] * 2}.get(field, [0.0, 0.0])
        listed = [None if value is None else _listed(value) for value in values]
        if listed != silent:
            content[key] = listed
    return content
