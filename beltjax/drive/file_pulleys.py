"""The belts, pulleys, shafts, isolators and dampers of a drive file, read and written."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from beltjax.drive.components import (
    FRICTION_LAWS,
    LARGEST_BARE_RADIUS,
    LAWS,
    SENSES,
    SIDES,
    Belt,
    Damper,
    Isolator,
    Pulley,
)
from beltjax.drive.file_bodies import BodiesOfFile
from beltjax.drive.file_tables import DriveTable, PulleyTable
from beltjax.drive.system import Drive, free_name, joined_shafts, repeated_name, span_names
from beltjax.files.errors import FileError
from beltjax.files.fields import numbers
from beltjax.files.tables import given_numbers
from beltjax.files.units import shown

_MOST_PULLEYS = 200  # compiling grows with their number: 100 take some 12 s, 300 some 40 s


class Wheels:
    """The pulleys of a file, sorted belt after belt, and the shafts that they are on."""

    def __init__(self, file: DriveTable, path: object):
        belts = [belt.name for belt in file.belts]
        _require_belts(file, belts, path)
        _require_names([pulley.name for pulley in file.pulley], path)
        self.belts = belts
        self.pulleys = sorted(file.pulley, key=lambda p: belts.index(p.belt) if p.belt else 0)
        self.names = [pulley.name for pulley in self.pulleys]
        self.driver = _driver(self.pulleys, path)
        self._require_spans(path)
        self.turned_back = self._turned_back(file, path)
        self.partners = [self._partner(pulley, path) for pulley in self.pulleys]
        places = joined_shafts(list(zip(self.names, self.partners, strict=True)))
        self.shafts = [[self.names[place] for place in shaft] for shaft in places]
        self._require_one_center(path)
        self._require_tree(path)

    def shaft(self, name: str) -> list[str]:
        """Names of the pulleys on the shaft of the one of this name."""
        return next(shaft for shaft in self.shafts if name in shaft)

    def require_known(self, name: str, key: str, path: object) -> None:
        """Raise `FileError` unless there is a pulley of this name."""
        if name not in self.names:
            message = f"there is no pulley {name!r}; give one of {', '.join(self.names)}"
            raise FileError(path, key, message)

    def _require_spans(self, path: object) -> None:
        spans: list[str] = []
        for belt in self.belts:
            on = [p.name for p in self.pulleys if p.belt in (None, belt)]
            if len(on) < 2:
                which = "a drive" if len(self.belts) == 1 else f"belt {belt!r}"
                message = f"found {len(on)}; {which} has at least two pulleys"
                raise FileError(path, "pulley", message)
            spans += span_names(on)
        repeated = repeated_name(spans)
        if repeated is not None:
            message = f"two spans would be called {repeated!r}; rename a pulley"
            raise FileError(path, "pulley", message)

    def _turned_back(self, file: DriveTable, path: object) -> set[str]:
        """Names of the second pulleys of crossed belts, which turn against the first."""
        found = set()
        for belt in file.belts:
            on = [p for p in self.pulleys if p.belt in (None, belt.name)]
            alike = len({pulley.face for pulley in on}) == 1
            label = "belt" if len(self.belts) == 1 else f"belt.{belt.name}"
            if belt.crossed and (len(on) != 2 or on[0].face != "grooved" or not alike):
                message = "belongs to a belt on two pulleys, both with face = 'grooved'; remove it"
                raise FileError(path, f"{label}.crossed", message)
            if not belt.crossed and len(on) == 2 and not alike:
                message = (
                    "the belt of two pulleys on different faces crosses itself; give both "
                    f"'grooved', and {label}.crossed = true if it shall"
                )
                raise FileError(path, f"pulley.{on[1].name}.face", message)
            found |= {on[1].name} if belt.crossed else set()
        return found

    def _partner(self, pulley: PulleyTable, path: object) -> str | None:
        """A pulley on the same shaft: the one that is named, or the first with the same word."""
        if pulley.shaft in (None, pulley.name):
            return None
        if pulley.shaft in self.names:
            return pulley.shaft
        alike = [other.name for other in self.pulleys if other.shaft == pulley.shaft]
        if len(alike) > 1:
            return None if alike[0] == pulley.name else alike[0]
        message = f"there is no pulley {pulley.shaft!r}; give one of {', '.join(self.names)}"
        raise FileError(path, f"pulley.{pulley.name}.shaft", message)

    def _require_one_center(self, path: object) -> None:
        centers = {pulley.name: pulley.number("center") for pulley in self.pulleys}
        for first, *others in self.shafts:
            for name in others:
                if centers[name] != centers[first]:
                    message = (
                        f"found {_pair(centers[name])}, and {_pair(centers[first])} for {first!r} "
                        "on the same shaft; give them one center"
                    )
                    raise FileError(path, f"pulley.{name}.center", message)

    def _require_tree(self, path: object) -> None:
        """Raise `FileError` unless shafts join all belts, and in one way only."""
        group = {belt: belt for belt in self.belts}
        reached: dict[tuple[str, ...], str] = {}
        for pulley in self.pulleys:
            shaft, belt = tuple(self.shaft(pulley.name)), pulley.belt or self.belts[0]
            if len(shaft) == 1:
                continue
            before = reached.setdefault(shaft, "")
            if before and group[before] == group[belt]:
                found = f"belts {before!r} and {belt!r} share this shaft and are joined already"
                if before == belt:
                    found = f"belt {belt!r} has two pulleys on this shaft"
                message = (
                    f"{found}, so that the split of the load is not determined; take one of the "
                    "pulleys off the shaft"
                )
                raise FileError(path, f"pulley.{pulley.name}.shaft", message)
            if before:
                old, new = group[belt], group[before]
                group = {name: new if of == old else of for name, of in group.items()}
            reached[shaft] = belt
        for belt in self.belts[1:]:
            if group[belt] != group[self.belts[0]]:
                message = (
                    "shares no shaft with the others; give one of its pulleys shaft = the name of "
                    "a pulley on another belt, or describe it in a file of its own"
                )
                raise FileError(path, f"belt.{belt}", message)


def _pair(center: Sequence[float]) -> str:
    return f"({center[0]:g}, {center[1]:g})"


def _require_belts(file: DriveTable, belts: list[str], path: object) -> None:
    if not belts:
        raise FileError(path, "belt", "found none; a drive has a belt")
    for place, name in enumerate(belts):
        _require_word(name, f"belt[{place}].name", path)
        if name in belts[:place]:
            raise FileError(path, f"belt.{name}", "this name is used twice; rename one of them")
    for place, pulley in enumerate(file.pulley):
        known = pulley.belt in belts
        if not known and (pulley.belt is not None or len(belts) > 1):
            found = "is missing" if pulley.belt is None else f"there is no belt {pulley.belt!r}"
            key = f"pulley.{pulley.name}.belt" if pulley.name.strip() else f"pulley[{place}].belt"
            raise FileError(path, key, f"{found}; give one of {', '.join(belts)}")


def _require_word(name: str, key: str, path: object) -> None:
    if not name.strip() or any(mark in name for mark in ".:=") or not name.isprintable():
        message = f"found {name!r}; a name prints, is not empty, and is without . : ="
        raise FileError(path, key, message)


def _require_names(names: list[str], path: object) -> None:
    if len(names) < 2:
        raise FileError(path, "pulley", f"found {len(names)}; a drive has at least two pulleys")
    if len(names) > _MOST_PULLEYS:
        message = f"found {len(names)}; a drive file has {_MOST_PULLEYS} at most, since more take"
        raise FileError(path, "pulley", f"{message} too long to compile; leave out or merge some")
    for place, name in enumerate(names):
        _require_word(name, f"pulley[{place}].name", path)
        if name in names[:place]:
            raise FileError(path, f"pulley.{name}", "this name is used twice; rename one of them")


def _driver(pulleys: list[PulleyTable], path: object) -> str:
    drivers = [pulley.name for pulley in pulleys if pulley.driver]
    if len(drivers) != 1:
        found = ", ".join(drivers) or "none"
        message = f"found {found}; mark exactly one pulley with driver = true"
        raise FileError(path, "pulley.driver", message)
    return drivers[0]


def read_listed(file: DriveTable, path: object) -> list[str | None]:
    """The sense in which the pulleys of each belt are listed; None where the file does not say."""
    belts, listed = [belt.name for belt in file.belts], file.listed
    words = listed if isinstance(listed, dict) else dict.fromkeys(belts, listed)
    for name, word in words.items():
        key = f"listed.{name}" if isinstance(listed, dict) else "listed"
        if name not in belts:
            message = f"there is no belt {name!r}; give one of {', '.join(belts)}"
            raise FileError(path, key, message)
        if word is not None and (not isinstance(word, str) or word not in SENSES):
            message = f"found {shown(word)}; give {' or '.join(map(repr, SENSES))}"
            raise FileError(path, key, message)
    return [words.get(name) for name in belts]


def pulleys_of(wheels: Wheels, of: BodiesOfFile, path: object) -> list[Pulley]:
    """The pulleys of a file, on the tensioners that carry them."""
    made = []
    for pulley, partner in zip(wheels.pulleys, wheels.partners, strict=True):
        on = [float(pulley.name in body.carried) for body in of.bodies]
        if pulley.housing == "arm" and not any(on):
            message = "found 'arm', but no tensioner carries this pulley; give 'ground'"
            raise FileError(path, f"pulley.{pulley.name}.housing", message)
        _require_friction(pulley, path)
        made.append(
            Pulley(
                name=pulley.name,
                face="back" if pulley.name in wheels.turned_back else pulley.face,
                driver=pulley.driver,
                on=on,
                housed=pulley.housing == "arm",
                friction_law=pulley.friction_law,
                wedged=pulley.wedged,
                cushion=pulley.cushion,
                belt=pulley.belt,
                shaft=partner,
                **given_numbers(pulley, Pulley),
            )
        )
    return made


def _require_friction(pulley: PulleyTable, path: object) -> None:
    """Raise `FileError` for a law of friction with a number missing or out of order."""
    given = given_numbers(pulley, Pulley)
    static, key = given.get("friction_static"), f"pulley.{pulley.name}"
    for name, found in (
        ("friction_speed", given.get("friction_speed")),
        ("friction_law", pulley.friction_law),
    ):
        if static is None and found is not None:
            message = "belongs beside friction_static, which is missing; add it, or remove this"
            raise FileError(path, f"{key}.{name}", message)
    if static is None:
        return
    for name in ("friction", "friction_speed"):
        if name not in given:
            message = "is missing; friction_static needs friction and friction_speed beside it"
            raise FileError(path, f"{key}.{name}", message)
    if static < given["friction"]:
        message = f"found {static:g}, below friction, {given['friction']:g}; exchange them"
        raise FileError(path, f"{key}.friction_static", message)


def isolators_of(file: DriveTable, wheels: Wheels, path: object) -> list[Isolator]:
    """The isolators of a file."""
    made, used = [], {}
    for place, table in enumerate(file.isolator):
        key = f"isolator[{place}]"
        if (table.pulley is None) == (table.pulleys is None):
            found = "neither" if table.pulley is None else "both"
            raise FileError(path, key, f"found {found} of pulley and pulleys; give one of them")
        names = [table.pulley] if table.pulley is not None else table.pulleys or []
        for name in names:
            wheels.require_known(name, f"{key}.pulleys" if table.pulleys else f"{key}.pulley", path)
            if name in used:
                message = f"pulley {name!r} has an isolator already; it takes one"
                raise FileError(
                    path, f"{key}.pulleys" if table.pulleys else f"{key}.pulley", message
                )
            used[name] = place
            if name not in wheels.shaft(names[0]):
                message = f"{names[0]!r} and {name!r} are on two shafts; one rim is on one shaft"
                raise FileError(path, f"{key}.pulleys", message)
        for word, unfit, remedy in (
            ("law", table.law not in LAWS, " or ".join(f'law = "{word}"' for word in LAWS)),
            ("one_way", table.one_way, "one_way = false"),
        ):
            if unfit:
                message = (
                    f"found {shown(getattr(table, word))}, which is not modeled yet; give {remedy}"
                )
                raise FileError(path, f"{key}.{word}", message)
        if LAWS[table.law] and wheels.driver in wheels.shaft(names[0]):
            message = "is on the driver's shaft, which turns the rim; a clutch lets a hub overrun"
            raise FileError(path, f"{key}.law", message)
        flags = [float(name in names) for name in wheels.names]
        name = _own_name(table.name, names[0], [part.name for part in made], key, path)
        numbers = given_numbers(table, Isolator)
        _require_stops(numbers, table.law, key, path)
        made.append(Isolator(flags, name=name, law=table.law, **numbers))
    return made


def _require_stops(numbers: dict[str, Any], law: str, key: str, path: object) -> None:
    """Raise `FileError` for stops not in order, half given, or of a joint that does not wind up."""
    stops = numbers.get("stops")
    if ("stop_stiffness" in numbers) != (stops is not None):
        missing = "stop_stiffness" if stops is not None else "stops"
        raise FileError(
            path, f"{key}.{missing}", "is missing; stops and stop_stiffness go together"
        )
    if stops is None:
        return
    if law == "rigid-clutch":
        message = "belong to a joint that winds up, and a rigid clutch does not; remove them"
        raise FileError(path, f"{key}.stops", message)
    if not stops[0] < stops[1]:
        shown = [float(f"{stop:.6g}") for stop in stops]
        raise FileError(path, f"{key}.stops", f"found {shown}; give [least, greatest]")


def dampers_of(file: DriveTable, wheels: Wheels, path: object) -> list[Damper]:
    """The dampers of a file."""
    made = []
    for place, table in enumerate(file.damper):
        key = f"damper[{place}]"
        wheels.require_known(table.pulley, f"{key}.pulley", path)
        name = _own_name(table.name, table.pulley, [part.name for part in made], key, path)
        flags = [float(name == table.pulley) for name in wheels.names]
        on_rim = table.at == "rim"
        made.append(Damper(flags, on_rim=on_rim, name=name, **given_numbers(table, Damper)))
    return made


def _own_name(given: str | None, pulley: str, used: list[str], key: str, path: object) -> str:
    """The name of an isolator or damper: the one that is given, or one from its pulley."""
    if given is None:
        return free_name(pulley, used)
    _require_word(given, f"{key}.name", path)
    if given in used:
        raise FileError(path, f"{key}.name", f"the name {given!r} is used already; give another")
    return given


def pulleys_content(drive: Drive) -> dict[str, Any]:
    """The keys of belts, pulleys, isolators and dampers of the file of a drive."""
    names = drive.pulley_names
    crossed = [float(flag) > 0 for flag in drive.loops.crossed(drive.faces)]
    belts = [
        _belt_content(belt) | ({"crossed": True} if flag else {})
        for belt, flag in zip(drive.belts, crossed, strict=True)
    ]
    sides = zip(drive.pulleys, drive.belt_of_span, strict=True)
    isolators, dampers = [], []
    for part in drive.isolators:
        on = [name for name, flag in zip(names, part.pulleys.tolist(), strict=True) if flag]
        where = {"pulley": on[0]} if len(on) == 1 else {"pulleys": on}
        law = {"law": word(LAWS, part.law)} if float(part.law) else {}
        numbers = numbers_content(part)
        if not numbers["stop_stiffness"]:
            del numbers["stops"], numbers["stop_stiffness"]
        isolators.append(_name_content(part.name, on[0]) | where | law | numbers)
    for part in drive.dampers:
        at = {"at": "rim"} if float(part.on_rim) else {}
        pulley = names[int(np.argmax(part.pulley))]
        name = _name_content(part.name, pulley)
        dampers.append(name | {"pulley": pulley} | at | numbers_content(part))
    content = {
        "belt": belts[0] if len(belts) == 1 and "name" not in belts[0] else belts,
        "pulley": [_pulley_content(pulley, crossed[belt]) for pulley, belt in sides],
        "isolator": isolators,
        "damper": dampers,
    }
    return {key: value for key, value in content.items() if value}


def _name_content(name: str, pulley: str) -> dict[str, str]:
    return {} if name == pulley else {"name": name}


def _pulley_content(pulley: Pulley, crossed: bool) -> dict[str, Any]:
    content: dict[str, Any] = {"name": pulley.name} | numbers_content(pulley)
    for key in ("radius", "rim_radius"):
        if content.get(key, 0.0) > LARGEST_BARE_RADIUS:
            content[key] = f"{content[key]!r} m"
    content["face"] = "grooved" if crossed else word(SIDES, pulley.face)
    law = pulley.friction_law
    content |= {"friction_law": None if law is None else word(FRICTION_LAWS, law)}
    content |= {"belt": pulley.belt, "shaft": pulley.shaft}
    content |= {"driver": True if float(pulley.driver) else None}
    content |= {"cushion": None if float(pulley.cushion) else False}
    content |= {"housing": "arm" if float(pulley.housed) else None}
    content |= {"wedged": None if float(pulley.wedged) else False}
    return {key: value for key, value in content.items() if value is not None}


def numbers_content(part: Any) -> dict[str, Any]:
    """The numbers of a part as plain ones or lists of them; absent ones are left out."""
    fields = {name: getattr(part, name) for name in numbers(type(part))}
    return {key: np.asarray(x).tolist() for key, x in fields.items() if x is not None}


def word(words: dict[str, float], sign: Any) -> str:
    """The word for which a sign stands."""
    return next(word for word, value in words.items() if value == float(sign))


def listed_content(drive: Drive) -> str | dict[str, str]:
    """The key `listed` of the file of a drive."""
    senses = np.broadcast_to(np.asarray(drive.sense), (len(drive.belts),))
    words = {b.name: word(SENSES, sense) for b, sense in zip(drive.belts, senses, strict=True)}
    return words if len(drive.belts) > 1 else next(iter(words.values()))


def belts_of(file: DriveTable, path: object) -> list[Belt]:
    """The belts of a file."""
    for belt in file.belts:
        given = [belt.number(f"cushion_{part}") is not None for part in ("radial", "shear")]
        label = "belt" if len(file.belts) == 1 else f"belt.{belt.name}"
        if any(given) and not all(given):
            message = "found one of radial and shear; give cushion = { radial = .., shear = .. }"
            raise FileError(path, f"{label}.cushion", message)
        if any(given) and belt.number("wedge_angle") is not None:
            message = "is given beside groove, and no model has both; remove one of them"
            raise FileError(path, f"{label}.cushion", message)
    return [
        Belt(
            name=belt.name,
            pitch=belt.pitch,
            standard_lengths=tuple(sorted(belt.standard_lengths or ())),
            **given_numbers(belt, Belt),
        )
        for belt in file.belts
    ]


def _belt_content(belt: Belt) -> dict[str, Any]:
    content: dict[str, Any] = {} if belt.name == "belt" else {"name": belt.name}
    content |= numbers_content(belt)
    content |= {} if belt.pitch is None else {"pitch": belt.pitch}
    lengths = list(belt.standard_lengths)
    return content | ({"standard_lengths": lengths} if lengths else {})
