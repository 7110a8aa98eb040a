"""The [installation] of a drive file, read and written."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from beltjax.drive.components import ArmSpring, Tensioner
from beltjax.drive.file_bodies import SINGLE, BodiesOfFile
from beltjax.drive.file_tables import DriveTable, RuleTable
from beltjax.drive.installation import (
    AdjustedToMark,
    AdjustedToTension,
    BeltGiven,
    Installation,
    Preloaded,
    TensionGiven,
)
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.files.fields import Number, numbers
from beltjax.files.tables import checked
from beltjax.files.units import shown

_KEY = "installation"


def read_installation(file: DriveTable, of: BodiesOfFile, path: object) -> Installation:
    """The installation rule of a file; raises `FileError`."""
    rule, belts = file.installation, [belt.name for belt in file.belts]
    _require_keys(rule, of, len(belts), _loaded(file, of), path)
    free_angle = rule.number("free_angle")
    if rule.free and not of.bodies:
        raise FileError(path, f"{_KEY}.free", "there is no tensioner; remove it")
    if rule.span_tensions is not None and len(rule.span_tensions) != len(file.pulley):
        found = f"found {len(rule.span_tensions)} tensions for {len(file.pulley)} spans"
        raise FileError(path, f"{_KEY}.span_tensions", f"{found}; give one for each span")
    tension = _by_belt(rule.tension, numbers(TensionGiven)["tension"], "tension", belts, path)
    length = _by_belt(
        rule.belt_length, numbers(BeltGiven)["belt_length"], "belt_length", belts, path
    )
    if tension is None and length is None:
        return Preloaded(_free(rule, of, path))
    if length is None:
        free = _free(rule, of, path)
        _require_settled(of, free, path)
        return TensionGiven(tension, rule.span_tensions, rule.tension_of, free)
    if rule.adjust is None:
        free = None
        if of.bodies and free_angle is None:
            free = _every_free(rule, of, path)
        return BeltGiven(length, free_angle, free)
    adjusted = _adjusted(rule.adjust, of, path)
    if tension is not None:
        free = _free(rule, of, path)
        _require_settled(of, free, path)
        return AdjustedToTension(length, tension, adjusted, free)
    marked, mark = _mark(rule.until or {}, of, path)
    return AdjustedToMark(length, _every_free(rule, of, path), adjusted, marked, mark)


def belt_lengths(rule: dict[str, Any], belts: Sequence[str], path: object) -> dict[str, float]:
    """Lengths of the belts along the neutral axis [m] that [installation] gives, by their names.

    Raises `FileError`.
    """
    fact = numbers(BeltGiven)["belt_length"]
    given = _by_belt(rule.get("belt_length"), fact, "belt_length", belts, path)
    return {} if given is None else dict(zip(belts, np.atleast_1d(given).tolist(), strict=True))


def _loaded(file: DriveTable, of: BodiesOfFile) -> bool:
    """Whether springs, forces or weights may give the tension."""
    heavy = file.number("gravity") is not None
    return bool(file.installation.free) or any(
        body.numbers.get("force") or (heavy and body.numbers.get("mass")) for body in of.bodies
    )


def _require_keys(
    rule: RuleTable, of: BodiesOfFile, belts: int, loaded: bool, path: object
) -> None:
    """Raise `FileError` for keys that are missing, or that do not go together."""
    tension, length = rule.tension is not None, rule.belt_length is not None
    adjust, until = rule.adjust is not None, rule.until is not None
    free_angle = rule.number("free_angle") is not None
    one = "give exactly one of them"
    faults = {
        "": {
            f"found neither tension nor belt_length; {one}": not (tension or length or loaded),
            f"found both tension and belt_length; {one}, or adjust beside both": (
                tension and length and not adjust
            ),
        },
        ".adjust": {
            "goes with belt_length; give it, or remove this": adjust and not length,
            f"found both tension and until beside it; {one}": adjust and tension and until,
            f"found neither tension nor until beside it; {one}": adjust and not (tension or until),
            f"adjusts one belt, and there are {belts}; give tension or belt_length alone": (
                adjust and belts > 1
            ),
        },
        ".until": {"goes with adjust; remove it": until and not adjust},
        ".free_angle": {
            "goes with belt_length; remove it": free_angle and not length,
            "does not go with adjust; give free = {...}": free_angle and adjust,
        },
        ".tension_of": {"goes with tension; remove it": length and rule.tension_of != "belt"},
        ".span_tensions": {
            "goes with tension; remove it": length and rule.span_tensions is not None
        },
    }
    for key, messages in faults.items():
        for message, found in messages.items():
            if found:
                raise FileError(path, _KEY + key, message)
    if free_angle:
        _require_one_arm(rule, of, path)


def _require_one_arm(rule: RuleTable, of: BodiesOfFile, path: object) -> None:
    """Raise `FileError` unless there is the one arm whose free angle is given."""
    key = f"{_KEY}.free_angle"
    if not of.bodies:
        raise FileError(path, key, "there is no tensioner; remove it")
    if rule.free is not None:
        raise FileError(path, f"{_KEY}.free", "stands beside free_angle; remove one of them")
    if len(of.bodies) > 1 or of.bodies[0].kind != "rotary" or not of.bodies[0].carried:
        example = f"free = {{{_toml_key(of.spring_names[0])} = ...}}"
        raise FileError(path, key, f"is that of a single arm with a pulley; give {example} instead")


def _by_belt(
    value: Any, fact: Number, field: str, belts: Sequence[str], path: object
) -> float | list[float] | None:
    """A number for the only belt, or one for each of several."""
    key = f"{_KEY}.{field}"
    if value is None:
        return None
    if not isinstance(value, dict):
        found = _checked(value, fact, None, key, path)
        if len(belts) > 1:
            example = ", ".join(f"{_toml_key(name)} = {found:g}" for name in belts)
            message = f"found one number for {len(belts)} belts; give {field} = {{{example}}}"
            raise FileError(path, key, message)
        return found
    for name in value:
        if name not in belts:
            message = f"there is no belt {name!r}; give one of {', '.join(belts)}"
            raise FileError(path, f"{key}.{name}", message)
    for name in belts:
        if name not in value:
            raise FileError(path, f"{key}.{name}", "is missing; give one number for each belt")
    found = [_checked(value[name], fact, None, f"{key}.{name}", path) for name in belts]
    return found if len(belts) > 1 else found[0]


def _checked(value: Any, fact: Number, kind: str | None, key: str, path: object) -> float:
    try:
        return checked(value, fact, kind)
    except ValueError as error:
        raise FileError(path, key, str(error)) from error


def _free(rule: RuleTable, of: BodiesOfFile, path: object) -> np.ndarray | None:
    """Relaxed position of each spring, NaN where it is not given; None where none is given."""
    if rule.free is None:
        return None
    found, names = np.full(len(of.spring_names), np.nan), of.spring_names
    fact = numbers(TensionGiven)["free"]
    for name, value in rule.free.items():
        key = f"{_KEY}.free.{name}"
        if name not in names:
            known = f"give one of {', '.join(names)}" if names else "there is no tensioner"
            raise FileError(path, key, f"there is no spring {name!r}; {known}")
        place = names.index(name)
        found[place] = _checked(value, fact, of.kinds[place], key, path)
    return found


def _every_free(rule: RuleTable, of: BodiesOfFile, path: object) -> np.ndarray:
    """Relaxed position of each spring; 0 for one without effect that is not given."""
    found = _free(rule, of, path)
    missing = [
        name
        for place, name in enumerate(of.spring_names)
        if _pulls(of)[place] and (found is None or np.isnan(found[place]))
    ]
    if missing:
        one = len(of.bodies) == 1 and of.bodies[0].name == SINGLE and of.bodies[0].kind == "rotary"
        if one and found is None:
            raise FileError(path, f"{_KEY}.free_angle", "is missing; belt_length needs it too")
        message = (
            f"{missing[0]!r} is missing; belt_length needs where each spring is relaxed, by name"
        )
        raise FileError(path, f"{_KEY}.free", message)
    return np.zeros(len(of.spring_names)) if found is None else np.nan_to_num(found)


def _unlocked(of: BodiesOfFile) -> np.ndarray:
    return np.array([not body.locked for body in of.bodies], bool)


def _pulls(of: BodiesOfFile) -> np.ndarray:
    """Which springs act on a tensioner that can move."""
    moves = np.any(of.rows[:, _unlocked(of)] != 0, axis=1)
    return moves & (of.stiffness > 0)


def _require_settled(of: BodiesOfFile, free: np.ndarray | None, path: object) -> None:
    """Raise `FileError` unless the tension determines exactly the springs that are not given.

    The tension gives one force for each direction in which springs act.
    """
    if not of.bodies:
        return
    rows, pulls = of.rows[:, _unlocked(of)], _pulls(of)
    given = np.zeros(len(pulls), bool) if free is None else ~np.isnan(free)
    settled: list[np.ndarray] = []
    for place in np.flatnonzero(pulls & ~given):
        if np.linalg.matrix_rank(np.array([*settled, rows[place]])) == len(settled):
            name = of.spring_names[place]
            message = (
                f"there are more springs than the tension settles; give {_KEY}.free = "
                f"{{{_toml_key(name)} = ...}}, where this one is relaxed"
            )
            raise FileError(path, f"{_KEY}.free.{name}", message)
        settled.append(rows[place])
    for place in np.flatnonzero(pulls & given):
        if np.linalg.matrix_rank(np.array([*settled, rows[place]])) > len(settled):
            message = "follows from the tension; remove it, or give belt_length in place of tension"
            raise FileError(path, f"{_KEY}.free.{of.spring_names[place]}", message)


def _place(name: str, of: BodiesOfFile, key: str, path: object) -> int:
    names = [body.name for body in of.bodies]
    if name not in names:
        message = f"there is no tensioner {name!r}; there are: {', '.join(names) or 'none'}"
        raise FileError(path, key, message)
    return names.index(name)


def _adjusted(name: str, of: BodiesOfFile, path: object) -> np.ndarray:
    key = f"{_KEY}.adjust"
    place = _place(name, of, key, path)
    if not of.bodies[place].locked:
        message = f"tensioner {name!r} is not locked; give it locked = true, or remove this"
        raise FileError(path, key, message)
    return np.eye(len(of.bodies))[place]


def _mark(until: dict[str, Any], of: BodiesOfFile, path: object) -> tuple[np.ndarray, float]:
    key = f"{_KEY}.until"
    if len(until) != 1:
        raise FileError(path, key, f"found {shown(until)}; give one tensioner and its mark")
    ((name, value),) = until.items()
    place = _place(name, of, f"{key}.{name}", path)
    if of.bodies[place].locked:
        message = "this tensioner is locked; give the sprung one that shows the mark"
        raise FileError(path, f"{key}.{name}", message)
    fact = numbers(AdjustedToMark)["mark"]
    mark = _checked(value, fact, of.bodies[place].kind, f"{key}.{name}", path)
    return np.eye(len(of.bodies))[place], mark


def _toml_key(name: str) -> str:
    bare = name.replace("-", "").replace("_", "")
    return name if bare.isascii() and bare.isalnum() else f'"{name}"'


def installation_content(drive: Drive) -> dict[str, Any]:
    """The key `installation` of the file of a drive."""
    rule = drive.installation
    fields = {
        "tension": _belts_content(drive, getattr(rule, "tension", None)),
        "span_tensions": _listed(getattr(rule, "span_tensions", None)),
        "belt_length": _belts_content(drive, getattr(rule, "belt_length", None)),
        "free_angle": _listed(getattr(rule, "free_angle", None)),
        "free": _free_content(drive),
    }
    if isinstance(rule, TensionGiven) and rule.tension_of != "belt":
        fields["tension_of"] = rule.tension_of
    if isinstance(rule, AdjustedToTension | AdjustedToMark):
        fields["adjust"] = _named(drive, rule.adjusted)
    if isinstance(rule, AdjustedToMark):
        fields["until"] = {_named(drive, rule.marked): _listed(rule.mark)}
    return {key: value for key, value in fields.items() if value is not None}


def _listed(value: Any) -> Any:
    return None if value is None else np.asarray(value).tolist()


def _belts_content(drive: Drive, value: Any) -> Any:
    if len(drive.belts) == 1 or value is None:
        return _listed(value)
    every = np.broadcast_to(np.asarray(value), (len(drive.belts),)).tolist()
    return {belt.name: part for belt, part in zip(drive.belts, every, strict=True)}


def _free_content(drive: Drive) -> dict[str, float] | None:
    rule = drive.installation
    if rule.free is None:
        return None
    parts: list[Tensioner | ArmSpring] = [*drive.tensioners, *drive.arm_springs]
    given = {
        part.name: value
        for part, value in zip(parts, np.asarray(rule.free).tolist(), strict=True)
        if not np.isnan(value)
    }
    if isinstance(rule, TensionGiven | AdjustedToTension | Preloaded):
        return given
    # Where all must be given, a file may leave out those that have no effect.
    idle = [part.name for part in parts if not float(part.stiffness)]
    return {name: x for name, x in given.items() if x or name not in idle} or None


def _named(drive: Drive, flags: Any) -> str:
    return drive.tensioners[int(np.argmax(np.asarray(flags)))].name
