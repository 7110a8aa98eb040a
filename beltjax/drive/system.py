"""A whole drive, with its belts, pulleys and bodies and the relations between them."""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from beltjax.drive.components import (
    SENSES,
    ArmSpring,
    Belt,
    Damper,
    Isolator,
    Model,
    Pulley,
    Tensioner,
    as_optional,
    as_sense,
    concrete,
    require_shape,
)
from beltjax.drive.contact_given import ContactGiven
from beltjax.drive.installation import BeltGiven, Installation, TensionGiven
from beltjax.drive.readable import Readable
from beltjax.drive.units_of_file import UnitsOfFile
from beltjax.files.fields import number
from beltjax.numerics.loops import Loops


def span_names(pulleys: Sequence[str]) -> tuple[str, ...]:
    """Names 'a-b' of the spans between pulleys of these names, in listed order."""
    following = (*pulleys[1:], *pulleys[:1])
    return tuple(f"{a}-{b}" for a, b in zip(pulleys, following, strict=True))


def repeated_name(names: Sequence[str]) -> str | None:
    """The first of `names` that occurs twice; None where all are different."""
    return next((name for name in names if names.count(name) > 1), None)


class Drive(Readable):
    """A belt drive: belts, pulleys, and the tensioners, springs and isolators that move them.

    Pulleys are listed belt after belt, those of a belt in the order in which they are met going
    round its loop. `belt` and `tensioner` take one object or a tuple of several. Every number is a
    leaf, so the gradient of anything with respect to a drive is a drive.

    Raises `ValueError` for what is wrong whatever the numbers: a belt with fewer than two pulleys,
    names that repeat, not exactly one driver, a tensioner on one that comes after it, belts and
    shafts that form a ring.
    """

    words: ClassVar = {"sense": SENSES}

    belts: tuple[Belt, ...]
    pulleys: tuple[Pulley, ...]
    installation: Installation
    tensioners: tuple[Tensioner, ...]
    arm_springs: tuple[ArmSpring, ...]
    isolators: tuple[Isolator, ...]
    dampers: tuple[Damper, ...]
    model: Model
    sense: Float[Array, "*belts"] = eqx.field(converter=as_sense)  # of several belts, each
    name: str = eqx.field(static=True)
    units: UnitsOfFile = eqx.field(static=True)  # in which the drive's file gives its numbers
    # How contact in grooves is computed where nothing else is said.
    contact: ContactGiven = eqx.field(static=True, default=ContactGiven())
    # The point of the site from which all coordinates are counted [m].
    origin: tuple[float, float] = eqx.field(static=True, default=(0.0, 0.0))
    gravity: Float[Array, "2"] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number(
            "m/s^2",
            "`[x, y]`, such as `[0, -9.81]`: pulls every tensioner that has a `mass`, at its "
            "`mass_center`",
            parts=("x", "y"),
        ),
    )

    def _repr_html_(self) -> str:
        """In a notebook the drawn layout above the table."""
        table = super()._repr_html_()
        if table.startswith("<pre>"):
            return table
        return f"{self.plot()._repr_svg_()}{table}"

    def __init__(
        self,
        belt: Belt | Sequence[Belt] | None = None,
        pulleys: Sequence[Pulley] = (),
        installation: Installation | None = None,
        tensioner: Tensioner | Sequence[Tensioner] | None = None,
        sense: Any = "counterclockwise",
        name: str = "drive",
        *,
        belts: Sequence[Belt] = (),
        tensioners: Sequence[Tensioner] = (),
        arm_springs: Sequence[ArmSpring] = (),
        isolators: Sequence[Isolator] = (),
        dampers: Sequence[Damper] = (),
        model: Model | None = None,
        units: UnitsOfFile | None = None,
        gravity: Any = None,
        origin: tuple[float, float] = (0.0, 0.0),
        contact: ContactGiven | None = None,
    ):
        if installation is None:
            raise ValueError("A drive needs an installation: TensionGiven, BeltGiven or another.")
        self.belts = _several(belt, Belt) or tuple(belts)
        tensioners = _several(tensioner, Tensioner) or tuple(tensioners)
        count = len(tensioners)
        self.pulleys = tuple(_on_bodies(pulley, count) for pulley in pulleys)
        self.tensioners = tuple(_on_bodies(body, count) for body in tensioners)
        if isinstance(installation, TensionGiven) and all_held(tensioners):
            installation = dataclasses.replace(installation, as_drawn=True)
        self.installation = installation
        self.arm_springs = tuple(arm_springs)
        self.isolators, self.dampers = (
            _named(isolators, "pulleys", self),
            _named(dampers, "pulley", self),
        )
        self.units = UnitsOfFile() if units is None else units
        self.model = Model() if model is None else model
        self.sense, self.name, self.gravity = sense, name, gravity
        self.origin = (float(origin[0]), float(origin[1]))
        self.contact = ContactGiven() if contact is None else contact

    def __check_init__(self):
        if not self.belts:
            raise ValueError("A drive needs a belt.")
        require_distinct("belts", [belt.name for belt in self.belts])
        require_distinct("tensioners", [body.name for body in self.tensioners])
        require_distinct("pulleys", self.pulley_names)
        require_distinct("isolators", [part.name for part in self.isolators if part.name])
        require_distinct("dampers", [part.name for part in self.dampers if part.name])
        self._check_loops()
        repeated = repeated_name(self.span_names)
        if repeated is not None:
            raise ValueError(f"Two spans would be called {repeated!r}: rename a pulley.")
        drivers = _flags([pulley.driver for pulley in self.pulleys])
        if drivers is not None and np.sum(drivers) != 1:
            found = f"{np.sum(drivers):g} are marked"
            raise ValueError(f"Pulley.driver: exactly one pulley drives, but {found}.")
        self._check_bodies()
        self._check_installation()

    def _check_loops(self) -> None:
        names = [belt.name for belt in self.belts]
        for pulley in self.pulleys:
            if pulley.belt not in (None, *names) or (pulley.belt is None and len(names) > 1):
                raise ValueError(
                    f"Pulley {pulley.name!r}: belt is {pulley.belt!r}; give one of "
                    f"{', '.join(names)}."
                )
            if pulley.shaft not in (None, *self.pulley_names):
                raise ValueError(
                    f"Pulley {pulley.name!r}: there is no pulley {pulley.shaft!r} to share a shaft."
                )
        places = _belt_places(self.belts, self.pulleys)
        if places != sorted(places):
            raise ValueError("Pulleys: list them belt after belt, in the order of the belts.")
        for name, size in zip(names, self.loop_sizes, strict=True):
            if size < 2:
                which = "A drive" if len(names) == 1 else f"Belt {name!r}"
                raise ValueError(f"{which} has at least two pulleys, not {size}.")
        if not _is_tree(places, self.shafts):
            raise ValueError(
                "Belts and shafts must form one tree: every belt shares a shaft with another, and "
                "none two with the same; otherwise the split of the load is not determined."
            )

    def _check_bodies(self) -> None:
        count = len(self.tensioners)
        for what, flags in (
            *((f"Pulley {p.name!r}", p.on) for p in self.pulleys),
            *((f"Tensioner {t.name!r}", t.on) for t in self.tensioners),
        ):
            if flags.ndim == 1:
                require_shape(what, flags, (count,), "on, a flag for each tensioner,")
            marked = _flags([flags])
            if marked is not None and np.sum(marked) > 1:
                found = f"{np.sum(marked):g} tensioners carry it"
                raise ValueError(f"{what}: {found}; give it to one at most.")
        for place, body in enumerate(self.tensioners):
            marked = _flags([body.on])
            if marked is not None and np.any(marked[0][place:]):
                raise ValueError(
                    f"Tensioner {body.name!r}: list it after the tensioner on which it sits."
                )
        for spring in self.arm_springs:
            if spring.between.ndim == 1:
                what = f"ArmSpring {spring.name!r}"
                require_shape(what, spring.between, (count,), "between, for each tensioner,")
        for flags in (*(i.pulleys for i in self.isolators), *(d.pulley for d in self.dampers)):
            if flags.ndim == 1:
                size = (len(self.pulleys),)
                require_shape("Isolator or Damper", flags, size, "a flag for each pulley")

    def _check_installation(self) -> None:
        rule, springs = self.installation, len(self.tensioners) + len(self.arm_springs)
        if isinstance(rule, BeltGiven):
            given = (rule.free is not None) + (rule.free_angle is not None)
            if given != bool(springs):
                raise ValueError(
                    "BeltGiven: give free_angle or free where there is a tensioner, and neither "
                    "where there is none."
                )
            if rule.free_angle is not None and len(self.tensioners) != 1:
                raise ValueError("BeltGiven: free_angle is that of one arm; give free for several.")
        if isinstance(rule, TensionGiven) and rule.span_tensions is not None:
            require_shape("TensionGiven", rule.span_tensions, (len(self.pulleys),), "span_tensions")
        if rule.free is not None and rule.free.ndim == 1:
            require_shape("installation", rule.free, (springs,), "free, for each spring,")

    @property
    def belt(self) -> Belt:
        """The belt, or the first of several."""
        return self.belts[0]

    @property
    def tensioner(self) -> Tensioner | None:
        """The tensioner, if there is exactly one."""
        return self.tensioners[0] if len(self.tensioners) == 1 else None

    @property
    def loop_sizes(self) -> tuple[int, ...]:
        """Number of pulleys, and of spans, of each belt."""
        places = _belt_places(self.belts, self.pulleys)
        return tuple(places.count(place) for place in range(len(self.belts)))

    @property
    def loops(self) -> Loops:
        """The pulleys and spans of each belt."""
        return Loops(self.loop_sizes)

    @property
    def belt_of_span(self) -> np.ndarray:
        """Place of the belt that each pulley and span belongs to."""
        return self.loops.loop_of

    @property
    def shafts(self) -> tuple[tuple[int, ...], ...]:
        """Places of the pulleys on each shaft, in the order of the shafts' first pulleys."""
        return joined_shafts([(p.name, p.shaft) for p in self.pulleys])

    @property
    def pulley_names(self) -> tuple[str, ...]:
        """Names of the pulleys, in listed order."""
        return tuple(pulley.name for pulley in self.pulleys)

    @property
    def span_names(self) -> tuple[str, ...]:
        """Names 'a-b' of the spans: span i runs from pulley i to the next of its belt."""
        names, of = self.pulley_names, self.loops
        loops = (names[s : s + size] for s, size in zip(of.starts, of.sizes, strict=True))
        return tuple(name for loop in loops for name in span_names(loop))

    def pulley(self, name: str) -> int:
        """Place of the pulley of that name in the list; raises `KeyError` if there is none."""
        if name not in self.pulley_names:
            raise KeyError(f"no pulley {name!r}; there are {', '.join(self.pulley_names)}")
        return self.pulley_names.index(name)

    def span(self, name: str) -> int:
        """Place of the span 'a-b' in the list; raises `KeyError` if there is none."""
        if name not in self.span_names:
            raise KeyError(f"no span {name!r}; there are {', '.join(self.span_names)}")
        return self.span_names.index(name)

    def body(self, name: str) -> int:
        """Place of the tensioner of that name in the list; raises `KeyError` if there is none."""
        names = [body.name for body in self.tensioners]
        if name not in names:
            raise KeyError(f"no tensioner {name!r}; there are {', '.join(names) or 'none'}")
        return names.index(name)

    @property
    def axial_stiffnesses(self) -> Float[Array, " belts"]:
        """EA of each belt [N]."""
        return jnp.stack([belt.axial_stiffness for belt in self.belts])

    @property
    def centers(self) -> Float[Array, "pulleys 2"]:
        """Centers of the pulleys in the drawn layout [m]."""
        return jnp.stack([pulley.center for pulley in self.pulleys])

    @property
    def radii(self) -> Float[Array, " pulleys"]:
        """Radii of the pulleys, to the belt's neutral axis [m]."""
        return jnp.stack([pulley.radius for pulley in self.pulleys])

    @property
    def faces(self) -> Float[Array, " pulleys"]:
        """+1 for a pulley inside the loop, -1 for one on the back of the belt."""
        return jax.lax.stop_gradient(jnp.stack([pulley.face for pulley in self.pulleys]))

    @property
    def senses(self) -> Float[Array, " pulleys"]:
        """For each pulley, +1 if its belt's pulleys are listed counterclockwise, -1 if not."""
        sense = jnp.broadcast_to(jax.lax.stop_gradient(self.sense), (len(self.belts),))
        return sense[self.belt_of_span]

    @property
    def drives(self) -> Float[Array, " pulleys"]:
        """1 for the driver, 0 for the others."""
        return jax.lax.stop_gradient(jnp.stack([pulley.driver for pulley in self.pulleys]))


def require_distinct(what: str, names: Sequence[str]) -> None:
    """Raise `ValueError` when two of `names` are the same."""
    if len(set(names)) < len(names):
        raise ValueError(f"Names of {what} repeat: {', '.join(names)}.")


def joined_shafts(pulleys: Sequence[tuple[str, str | None]]) -> tuple[tuple[int, ...], ...]:
    """Places of the pulleys on each shaft.

    `pulleys` has the name of each, and the name of another pulley on the same shaft or None.
    """
    names = [name for name, _ in pulleys]
    shaft_of = list(range(len(names)))
    for place, (_, other) in enumerate(pulleys):
        if other is not None:
            one, two = shaft_of[place], shaft_of[names.index(other)]
            shaft_of = [min(one, two) if k in (one, two) else k for k in shaft_of]
    return tuple(
        tuple(place for place, shaft in enumerate(shaft_of) if shaft == first)
        for first in dict.fromkeys(shaft_of)
    )


def _belt_places(belts: Sequence[Belt], pulleys: Sequence[Pulley]) -> list[int]:
    """Place of the belt of each pulley."""
    names = [belt.name for belt in belts]
    return [0 if pulley.belt is None else names.index(pulley.belt) for pulley in pulleys]


def _is_tree(belts: Sequence[int], shafts: Sequence[Sequence[int]]) -> bool:
    """Whether shafts join all belts, and in one way only.

    `belts` has the place of the belt of each pulley, `shafts` the places of the pulleys on each.
    """
    group = list(range(max(belts) + 1))
    for shaft in shafts:
        for one, two in itertools.pairwise(shaft):
            first, second = group[belts[one]], group[belts[two]]
            if first == second:
                return False
            group = [first if of == second else of for of in group]
    return len(set(group)) == 1


def all_held(tensioners: Sequence[Tensioner]) -> bool | None:
    """Whether each tensioner has a spring of its own or is bolted; None while JAX traces them."""
    held = True
    for body in tensioners:
        stiffness, locked = concrete(body.stiffness), concrete(body.locked)
        if stiffness is None or locked is None:
            return None
        held = held and bool(np.all((stiffness > 0) | (locked > 0)))
    return held


def _several(given: Any, kind: type) -> tuple[Any, ...]:
    return (given,) if isinstance(given, kind) else tuple(given or ())


def _on_bodies(part: Any, count: int) -> Any:
    """`part`, whose flags `on` are zeros for `count` tensioners where none are given."""
    flags = part.on
    if count == 0 or (flags.ndim == 1 and len(flags)):
        return part
    return dataclasses.replace(part, on=np.zeros((*flags.shape[:-1], count)))


def _named(parts: Sequence[Any], field: str, drive: Drive) -> tuple[Any, ...]:
    """`parts`, where each without a name gets that of the first pulley that its flags mark."""
    named, names = [], drive.pulley_names
    for part in parts:
        flags = _flags([getattr(part, field)])
        if not part.name and flags is not None and np.any(flags):
            name = free_name(names[int(np.argmax(flags))], [other.name for other in named])
            part = dataclasses.replace(part, name=name)
        named.append(part)
    return tuple(named)


def free_name(name: str, used: Sequence[str]) -> str:
    """`name`, with a number behind it where it is used already."""
    numbered = (f"{name} {place}" for place in range(2, len(used) + 3))
    return next(word for word in (name, *numbered) if word not in used)


def _flags(flags: Sequence[Any]) -> np.ndarray | None:
    """Flags as numbers, unless JAX traces or batches them."""
    found = [concrete(flag) for flag in flags]
    if any(flag is None or flag.ndim > 1 for flag in found):
        return None
    if len({flag.shape for flag in found if flag is not None}) != 1:
        return None
    return np.stack([flag for flag in found if flag is not None])
