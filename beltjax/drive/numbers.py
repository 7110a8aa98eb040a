"""Every number of a drive and its operating point, by its key in the drive file.

The keys are found by walking the drive; what each number is stands on its field (`fields`). A key
reads "pulley.NAME.radius", "pulley.NAME.center.x", "operation.torque.NAME"; where there is one belt
or one tensioner, its name may be left out.
"""

import dataclasses
import difflib
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from beltjax.drive.canonical import canonical_drive
from beltjax.drive.components import FORCE, KINDS, ArmSpring, Belt, Tensioner, concrete
from beltjax.drive.installation import BeltGiven
from beltjax.drive.layout import turned
from beltjax.drive.loads import Load
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.files.fields import Number, numbers

TORQUE = "operation.torque."
LOAD = "operation.load."
OF_LOADS = ("power", "drag")  # numbers of a load that are single, and not of a table
SPEEDS = ("operation.belt_speed", "operation.driver_speed")
_ANGLE, _ARM_LENGTH = ".angle", ".arm_length"
# Numbers that describe an arm's pivot once more, as a designer changes it.
_OF_ARMS = {
    _ANGLE: Number("rad", "the tensioner turned as a whole about its pulleys' center, from 0"),
    _ARM_LENGTH: Number("m", "from the pivot to the pulleys' center", above=0),
}
# A spring by its preload, which its stiffness and its relaxed position determine.
_PRELOAD = ".preload"
_OF_SPRINGS = Number(FORCE, "moment or force of its spring in the drawn position")
_FEW = ("operation.belt_speed", "belt.bending_stiffness", "installation.tension")

Numbers = tuple[Drive, OperatingPoint]


class Place(NamedTuple):
    """Where a number, or an array of them, stands in a drive."""

    key: str
    fact: Number
    kind: str | None  # of the tensioner that the number belongs to, where it is known
    at: Callable[[Drive], Any]  # the array in the drive
    part: int | None = None  # which number of that array; None: all of it
    silent: bool = False  # the file need not give it: it has its default value

    def read(self, drive: Drive) -> Array:
        """The number or the array."""
        found = self.at(drive)
        return found if self.part is None else found[..., self.part]

    def put(self, drive: Drive, value: Any) -> Drive:
        """`drive` with another number there."""
        if self.part is not None:
            value = self.at(drive).at[..., self.part].set(value)
        return eqx.tree_at(self.at, drive, value)


def _places(drive: Drive) -> Iterator[Place]:
    """All numbers of a drive; vectors that have a direction as a whole."""
    single = len(drive.belts) == 1
    for i, belt in enumerate(drive.belts):
        yield from _of_part("belt" if single else f"belt.{belt.name}", belt, "belts", i)
    for i, pulley in enumerate(drive.pulleys):
        yield from _of_part(f"pulley.{pulley.name}", pulley, "pulleys", i)
    kinds = [kind_of(body) for body in drive.tensioners]
    for i, body in enumerate(drive.tensioners):
        yield from _of_part(tensioner_key(drive, i), body, "tensioners", i, kinds[i])
    for i, spring in enumerate(drive.arm_springs):
        kinds.append(_kind_between(spring, kinds))
        yield from _of_part(f"arm_spring.{spring.name}", spring, "arm_springs", i, kinds[-1])
    for i, part in enumerate(drive.isolators):
        yield from _of_part(f"isolator.{part.name}", part, "isolators", i)
    for i, part in enumerate(drive.dampers):
        yield from _of_part(f"damper.{part.name}", part, "dampers", i)
    yield from _of_installation(drive, kinds)
    if drive.gravity is not None:
        yield Place("gravity", numbers(Drive)["gravity"], None, lambda drive: drive.gravity)


def tensioner_key(drive: Drive, place: int) -> str:
    """The key of the table of a tensioner: "tensioner" for the one that [tensioner] describes."""
    name = drive.tensioners[place].name
    return (
        "tensioner" if len(drive.tensioners) == 1 and name == "tensioner" else f"tensioner.{name}"
    )


def kind_of(body: Any) -> str | None:
    """The kind of a tensioner as a word; None while JAX traces or batches it."""
    sign = concrete(body.kind)
    if sign is None or sign.ndim:
        return None
    return next(kind for kind, value in KINDS.items() if value == sign)


def _kind_between(spring: ArmSpring, kinds: Sequence[str | None]) -> str | None:
    """The kind of the two tensioners that a spring joins; None while JAX traces it."""
    flags = concrete(spring.between)
    return None if flags is None or flags.ndim != 1 else kinds[int(np.argmax(flags != 0))]


def _of_part(
    prefix: str, part: Any, group: str, place: int, kind: str | None = None
) -> Iterator[Place]:
    for name, fact in numbers(type(part)).items():
        if getattr(part, name) is None or (kind and fact.kinds and kind not in fact.kinds):
            continue

        def at(drive: Drive, name: str = name) -> Any:
            return getattr(getattr(drive, group)[place], name)

        yield Place(f"{prefix}.{name}", fact, kind, at, silent=_silent(part, name))


def _silent(part: Any, name: str) -> bool:
    """Whether a number of a part has the value that it has where a file does not give it."""
    fact = numbers(type(part))[name]
    if fact.beside is not None:
        return _silent(part, fact.beside)
    field = next(field for field in dataclasses.fields(part) if field.name == name)
    value, default = concrete(getattr(part, name)), cast(Any, field.default)
    told = fact.required or fact.kinds or (fact.design and not fact.rare)
    if told or value is None or default is None:
        return False
    return np.array_equal(value, np.broadcast_to(default, value.shape))


def _of_installation(drive: Drive, kinds: Sequence[str | None]) -> Iterator[Place]:
    rule = drive.installation
    parts = {"free": [part.name for part in (*drive.tensioners, *drive.arm_springs)]}
    if len(drive.belts) > 1:
        belts = [belt.name for belt in drive.belts]
        parts |= {"tension": belts, "belt_length": belts}
    for name, fact in numbers(type(rule)).items():
        value = getattr(rule, name)
        if value is None:
            continue

        def at(drive: Drive, name: str = name) -> Any:
            return getattr(drive.installation, name)

        key = f"installation.{'until' if name == 'mark' else name}"
        if name not in parts:
            yield Place(key, fact, None, at)
            continue
        known = concrete(value)
        for i, part in enumerate(parts[name]):
            if known is None or known.ndim != 1 or not np.isnan(known[i]):
                kind = kinds[i] if name == "free" else None
                yield Place(f"{key}.{part}", fact, kind, at, i)


def _scalars(drive: Drive) -> Iterator[Place]:
    """All single numbers of a drive, the parts of vectors among them."""
    for place in _places(drive):
        for i, part in enumerate(place.fact.parts):
            yield place._replace(key=f"{place.key}.{part}", part=i)
        if place.part is not None or (place.fact.rank == 0 and not place.fact.parts):
            yield place


def _by_key(drive: Drive) -> dict[str, Place]:
    return {place.key: place for place in _scalars(drive)}


def _arms(drive: Drive) -> list[int]:
    """Places of the tensioners that turn and carry pulleys, or may while JAX traces them."""
    found = []
    for place, body in enumerate(drive.tensioners):
        flags = [concrete(pulley.on) for pulley in drive.pulleys]
        carries = any(flag is None or flag.ndim > 1 or flag[place] for flag in flags)
        if kind_of(body) in (None, "rotary") and carries:
            found.append(place)
    return found


def _arm_keys(drive: Drive) -> dict[str, int]:
    """Places of the tensioners that each key of a relative number belongs to."""
    return {tensioner_key(drive, place) + end: place for place in _arms(drive) for end in _OF_ARMS}


def _preload_keys(drive: Drive) -> dict[str, int]:
    """Places of the tensioners whose springs are given by where they are relaxed."""
    free, found = drive.installation.free, {}
    known = None if free is None else concrete(free)
    for place, body in enumerate(drive.tensioners if free is not None else ()):
        rate = concrete(body.stiffness)
        sprung = rate is None or bool(np.all(rate > 0))
        if sprung and (known is None or known.ndim != 1 or not np.isnan(known[place])):
            found[tensioner_key(drive, place) + _PRELOAD] = place
    return found


def is_relative(name: str) -> bool:
    """Whether other numbers of a tensioner determine a number: angle and length of an arm, preload.

    They do not describe a drive beside those.
    """
    return name.startswith("tensioner.") and name.endswith((_ANGLE, _ARM_LENGTH, _PRELOAD))


def moved_with(name: str) -> set[str]:
    """Keys of the numbers that describe the arm or the spring that a relative number is of."""
    if name.endswith(_PRELOAD):
        own = name.removesuffix(_PRELOAD)
        return {name, f"installation.free.{own.removeprefix('tensioner.')}"}
    arm = name.removesuffix(_ANGLE).removesuffix(_ARM_LENGTH)
    return {arm + end for end in (_ANGLE, _ARM_LENGTH, ".pivot.x", ".pivot.y")}


def full_key(drive: Drive, name: str) -> str:
    """`name` as the drive's own key, in which the name of an only belt or tensioner may differ."""
    table, _, rest = name.partition(".")
    if table == "tensioner" and len(drive.tensioners) == 1:
        fields = {*numbers(Tensioner), *(end[1:] for end in (*_OF_ARMS, _PRELOAD))}
        return f"{tensioner_key(drive, 0)}.{_of_only(drive.tensioners[0].name, rest, fields)}"
    if table == "belt" and len(drive.belts) == 1:
        return f"belt.{_of_only(drive.belt.name, rest, {*numbers(Belt)})}"
    if rest.startswith(("tension.", "belt_length.")) and len(drive.belts) == 1:
        return name.removesuffix(f".{drive.belt.name}")
    return name


def _of_only(owner: str, rest: str, fields: set[str]) -> str:
    """The field in `rest`, which may begin with the name of its only owner."""
    field = rest.removeprefix(f"{owner}.")
    return field if field.partition(".")[0] in fields else rest


def variable_names(drive: Drive) -> list[str]:
    """Keys of all numbers of this drive that a study may choose.

    Args:
        drive: the drive.

    Returns:
        Keys of the drive file, such as "pulley.NAME.radius" and "tensioner.angle".
    """
    names = [place.key for place in _scalars(drive) if place.fact.design and not place.silent]
    return [*names, *_arm_keys(drive), *_preload_keys(drive)]


def number_names(drive: Drive) -> list[str]:
    """Keys of the numbers that this drive has, and of speeds and torques.

    Numbers that have their default values are left out, though they may be set. Either of the
    speeds may be set, whichever the file gives.
    """
    names = [place.key for place in _scalars(drive) if not place.silent]
    torques = [TORQUE + name for name in _takers(drive)]
    return [*names, *_arm_keys(drive), *_preload_keys(drive), *SPEEDS, *torques]


def _takers(drive: Drive) -> list[str]:
    """Names of the pulleys that are not on the driver's shaft, or may not be while JAX traces."""
    drives = [concrete(pulley.driver) for pulley in drive.pulleys]
    held = {k for shaft in drive.shafts if any(drives[k] for k in shaft) for k in shaft}
    return [name for place, name in enumerate(drive.pulley_names) if place not in held]


def require_number(drive: Drive, name: str) -> None:
    """Raise `ValueError`, with some of the existing keys, unless `name` is one of them."""
    require_numbers(drive, [name])


def require_numbers(drive: Drive, names: Sequence[str]) -> None:
    """Raise `ValueError` unless all `names` are numbers of this drive that may be set together."""
    own = number_names(drive)
    known, seen = {*own, *_by_key(drive), *_load_keys(_takers(drive))}, set()
    for name in names:
        key = full_key(drive, name)
        if key not in known:
            few = [key for key in _FEW if key in own] + [f"pulley.{drive.pulleys[0].name}.radius"]
            close = ", ".join(difflib.get_close_matches(name, own, n=3) or few)
            raise ValueError(f"there is no number {name!r} to vary; give for instance {close}")
        if key in seen:
            raise ValueError(f"{name!r} is given twice; remove one of them")
        seen.add(key)
    if set(SPEEDS) <= seen:
        raise ValueError(f"{SPEEDS[0]} and {SPEEDS[1]} are one speed; give one of them")


def fact_of(drive: Drive, name: str) -> tuple[Number, str | None]:
    """The facts on a number's field, and the kind of tensioner to which the number belongs.

    Raises `KeyError` for a number that the drive does not have.
    """
    key = full_key(drive, name)
    if key in _arm_keys(drive):
        return next(fact for end, fact in _OF_ARMS.items() if key.endswith(end)), None
    if key in _preload_keys(drive):
        return _OF_SPRINGS, kind_of(drive.tensioners[_preload_keys(drive)[key]])
    if key.startswith(LOAD):
        return numbers(Load)[key.rpartition(".")[2]], None
    if key.startswith("operation."):
        field = "torque" if key.startswith(TORQUE) else key.removeprefix("operation.")
        return numbers(OperatingPoint)[field], None
    place = _by_key(drive)[key]
    return place.fact, place.kind


def unit_of(drive: Drive, name: str) -> str:
    """SI unit of a number of this drive.

    Args:
        drive: the drive.
        name: the number's key in the drive file.

    Returns:
        The unit; empty for a pure number.

    Raises:
        KeyError: the drive has no such number.
    """
    fact, kind = fact_of(drive, name)
    return fact.unit_for(kind)


def shift_of(drive: Drive, name: str) -> float:
    """What a number is more in the drive's file than in the drive [SI], as `UnitsOfFile` says."""
    return drive.units.shifts.get(full_key(drive, name), 0.0)


def known_keys(drive: Drive) -> set[str]:
    """Keys of all numbers that may be set."""
    torques = [TORQUE + name for name in drive.pulley_names]
    loads = _load_keys(drive.pulley_names, tuple(numbers(Load)))
    derived = {*_arm_keys(drive), *_preload_keys(drive)}
    return {*_by_key(drive), *derived, *SPEEDS, *torques, *loads}


def _load_keys(pulleys: Sequence[str], fields: Sequence[str] = OF_LOADS) -> list[str]:
    return [f"{LOAD}{name}.{field}" for name in pulleys for field in fields]


def canonical_key(drive: Drive, name: str) -> str:
    """The key that a number of `drive` has in its canonical form."""
    key, there = full_key(drive, name), canonical_drive(drive)
    pairs = [*zip(_arm_keys(drive), _arm_keys(there), strict=True)]
    pairs += zip(_preload_keys(drive), _preload_keys(there), strict=True)
    pairs += zip(_by_key(drive), _by_key(there), strict=True)
    torques = [[TORQUE + pulley for pulley in d.pulley_names] for d in (drive, there)]
    loads = [_load_keys(d.pulley_names) for d in (drive, there)]
    pairs += [*zip(*torques, strict=True), *zip(*loads, strict=True)]
    return dict(pairs).get(key, key)


def with_number(drive: Drive, point: OperatingPoint, name: str, value: Float[Array, ""]) -> Numbers:
    """`with_numbers` for one number."""
    return with_numbers(drive, point, {name: value})


def with_numbers(
    drive: Drive, point: OperatingPoint, values: Mapping[str, Float[Array, ""]]
) -> Numbers:
    """The drive and its operating point with some numbers set [SI], as `with_values` sets them.

    A speed replaces the other one, and the power of a load its table.
    """
    values = {full_key(drive, name): value for name, value in values.items()}
    for name, value in values.items():
        if name.startswith(TORQUE):
            torque = point.torque | {name.removeprefix(TORQUE): value}
            point = dataclasses.replace(point, torque=torque)
        elif name.startswith(LOAD):
            pulley, field = _of_load(name)
            load = point.load | {pulley: _with_load(point.load.get(pulley), field, value)}
            point = dataclasses.replace(point, load=load)
        elif name in SPEEDS:
            chosen = {"belt_speed": None, "driver_speed": None, name.split(".")[1]: value}
            point = dataclasses.replace(point, **chosen)
    of_drive = {name: x for name, x in values.items() if not name.startswith("operation.")}
    return with_values(drive, of_drive), point


def _of_load(name: str) -> tuple[str, str]:
    """The pulley and the field of a key of a load."""
    pulley, _, field = name.removeprefix(LOAD).rpartition(".")
    return pulley, field


def _with_load(load: Load | None, field: str, value: Any) -> Load:
    drag = None if load is None else load.drag
    if field == "power":
        return Load(power=value, drag=drag)
    return Load(drag=value) if load is None else dataclasses.replace(load, drag=value)


def with_values(drive: Drive, values: Mapping[str, Float[Array, ""]]) -> Drive:
    """The drive with some of its own numbers set [SI], in any order.

    A pulley's rim keeps its distance from the neutral axis unless it is set. "tensioner.angle"
    turns a tensioner as a whole, with the free angle of its spring, about the center of its
    pulleys, from 0 as drawn and with the pivot that it was given; "tensioner.arm_length" moves the
    pivot along the arm; "tensioner.preload" is what its spring has in the drawn position, whose
    relaxed position follows by its stiffness.

    Args:
        drive: the drive.
        values: values [SI] by the numbers' keys in the drive file.

    Returns:
        The changed drive.

    Raises:
        KeyError: the drive has no such number; speeds and torques are not among them.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> radius = {"pulley.accessory.radius": jnp.asarray(0.03)}
        >>> wider = bj.optimize.with_values(drive, radius)
        >>> bj.optimize.value_of(wider, "pulley.accessory.radius")
    """
    drawn = drive
    values = {full_key(drive, name): value for name, value in values.items()}
    places, arms, preloads = _by_key(drive), _arm_keys(drive), _preload_keys(drive)
    own = values.keys() - arms.keys() - preloads.keys()
    for name in sorted(own, key=lambda name: (_is_rim(name), name)):
        drive = _with_rim(drive, name, values[name])
        drive = places[name].put(drive, values[name])
    turn = jnp.zeros(())
    for name in sorted(values.keys() & arms.keys()):  # angles before lengths
        if name.endswith(_ANGLE):
            turn = values[name]
            drive = _with_tensioner_turned(drive, arms[name], turn)
        else:
            arm, body = _arm(drive, arms[name]), arms[name]
            longer = arm * values[name] / jnp.sqrt(jnp.sum(arm**2))
            drive = _with_pivot(drive, body, drive.tensioners[body].pivot + arm - longer)
    for name in values.keys() & preloads.keys():  # after their stiffnesses
        drive = _with_preload(drive, preloads[name], values[name])
    return _wound_alike(drive, drawn, turn)


def value_of(drive: Drive, name: str) -> Float[Array, ""]:
    """Value of a number of `drive` [SI].

    Args:
        drive: the drive.
        name: the number's key in the drive file.

    Returns:
        The value; 0 for the angle of a tensioner, which is relative to the drawn one.

    Raises:
        KeyError: the drive has no such number.
    """
    key, arms = full_key(drive, name), _arm_keys(drive)
    if key in _preload_keys(drive):
        place = _preload_keys(drive)[key]
        return drive.tensioners[place].stiffness * _free(drive)[..., place]
    if key in arms:
        if key.endswith(_ANGLE):
            return jnp.zeros(())
        return jnp.sqrt(jnp.sum(_arm(drive, arms[key]) ** 2))
    return _by_key(drive)[key].read(drive)


def number_value(drive: Drive, point: OperatingPoint, name: str) -> Float[Array, ""]:
    """The value of a number [SI], with which `with_number` changes nothing."""
    if name.startswith(TORQUE):
        return point.torque.get(name.removeprefix(TORQUE), jnp.zeros(()))
    if name.startswith(LOAD):
        pulley, field = _of_load(name)
        value = getattr(point.load.get(pulley), field, None)
        return jnp.zeros(()) if value is None or value.ndim else value
    if name in SPEEDS:
        speed = point.speed(drive)
        return speed if name == SPEEDS[0] else speed / (drive.drives @ drive.radii)
    return value_of(drive, name)


def named_numbers(
    drive: Drive, point: OperatingPoint, of: Numbers | None = None
) -> dict[str, Array]:
    """Every number of a drive and its operating point, by its key in the drive file.

    Vectors are whole: "pulley.NAME.center". A gradient by a drive is a drive, so that this names
    the parts of a gradient, too; `of` is then the drive and point of the gradient.
    """
    keyed, running = (drive, point) if of is None else of
    found = {place.key: place.read(drive) for place in _places(keyed) if not place.silent}
    for name in numbers(OperatingPoint):
        if name != "torque" and getattr(running, name) is not None:
            found[f"operation.{name}"] = getattr(point, name)
    for name, load in running.load.items():
        for field in numbers(Load):
            if getattr(load, field) is not None:
                found[f"{LOAD}{name}.{field}"] = getattr(point.load[name], field)
    return found | {TORQUE + name: point.torque[name] for name in running.torque}


def _free(drive: Drive) -> Float[Array, "*batch springs"]:
    """Relaxed positions of the springs, which the installation has."""
    free = drive.installation.free
    assert free is not None  # as `_preload_keys` found
    return free


def _with_preload(drive: Drive, place: int, preload: Float[Array, ""]) -> Drive:
    relaxed = preload / drive.tensioners[place].stiffness
    free = _free(drive).at[..., place].set(relaxed)
    return eqx.tree_at(lambda d: d.installation.free, drive, free)


def _is_rim(name: str) -> bool:
    return name.endswith(".rim_radius")


def _with_rim(drive: Drive, name: str, radius: Float[Array, ""]) -> Drive:
    """`drive`, where the rim of a pulley keeps its distance from the neutral axis at `radius`."""
    if not (name.startswith("pulley.") and name.endswith(".radius")):
        return drive
    i = drive.pulley(name.removeprefix("pulley.").removesuffix(".radius"))
    pulley = drive.pulleys[i]
    if pulley.rim_radius is None:
        return drive
    rim = pulley.rim_radius + radius - pulley.radius
    return eqx.tree_at(lambda d: d.pulleys[i].rim_radius, drive, rim)


def _center(drive: Drive, body: int) -> Float[Array, "2"]:
    """Middle of the pulleys that a tensioner carries, as drawn."""
    carries = jax.lax.stop_gradient(jnp.stack([pulley.on[body] for pulley in drive.pulleys]))
    return carries @ drive.centers / jnp.maximum(jnp.sum(carries), 1.0)


def _arm(drive: Drive, body: int) -> Float[Array, "2"]:
    """Vector from the pivot of a tensioner to the middle of its pulleys, as drawn."""
    return _center(drive, body) - drive.tensioners[body].pivot


def _with_pivot(drive: Drive, body: int, pivot: Float[Array, "2"]) -> Drive:
    return eqx.tree_at(lambda d: d.tensioners[body].pivot, drive, pivot)


def _with_tensioner_turned(drive: Drive, body: int, angle: Float[Array, ""]) -> Drive:
    center, part = _center(drive, body), drive.tensioners[body]
    drive = _with_pivot(drive, body, center - turned(center - part.pivot, angle))
    heavy = jax.lax.stop_gradient(part.mass) > 0
    around = jnp.where(heavy, center - turned(center - part.mass_center, angle), part.mass_center)
    drive = eqx.tree_at(lambda d: d.tensioners[body].mass_center, drive, around)
    rule = drive.installation
    if isinstance(rule, BeltGiven) and rule.free_angle is not None:
        free = rule.free_angle + angle
        drive = eqx.tree_at(lambda d: d.installation.free_angle, drive, free)
    return drive


def _wound_alike(drive: Drive, before: Drive, turned: Float[Array, ""]) -> Drive:
    """`drive`, with a free angle that follows a jump of its drawn arm's direction since `before`.

    That direction is between -180 and 180 degrees. A move across this cut, apart from the angle by
    which the tensioner was `turned`, must not wind the spring by a whole turn.
    """
    rule = drive.installation
    if not isinstance(rule, BeltGiven) or rule.free_angle is None:
        return drive
    arms = (_arm(drive, 0), _arm(before, 0))
    now, then = (jnp.arctan2(arm[1], arm[0]) for arm in arms)
    turns = jnp.round((now - then - turned) / (2 * jnp.pi))
    free = rule.free_angle + 2 * jnp.pi * jax.lax.stop_gradient(turns)
    return eqx.tree_at(lambda d: d.installation.free_angle, drive, free)
