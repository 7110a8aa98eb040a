"""The physical description of a drive in SI units: immutable pytrees whose leaves are numbers."""

from collections.abc import Mapping
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from beltjax.drive.readable import Readable
from beltjax.files.fields import number

SIDES = {"grooved": 1.0, "back": -1.0}
SENSES = {"counterclockwise": 1.0, "clockwise": -1.0}
TENSIONS_OF = ("belt", "string")
TRAVELS = {"listed": 1.0, "opposite": -1.0}
KINDS = {"rotary": 1.0, "linear": 0.0}
LAWS = {"spring": 0.0, "spring-clutch": 1.0, "decoupler": 2.0, "rigid-clutch": 3.0}
FRICTION_LAWS = {"stribeck": 0.0, "cubic": 1.0}
NO_STOPS = (-np.inf, np.inf)
# Units of a coordinate and of what goes with it, by the kind of tensioner.
COORDINATE = {"rotary": "rad", "linear": "m"}
STIFFNESS = {"rotary": "N m/rad", "linear": "N/m"}
DAMPING = {"rotary": "N m s/rad", "linear": "N s/m"}
BEARING = {"rotary": "m", "linear": ""}
INERTIA = {"rotary": "kg m^2", "linear": "kg"}
FORCE = {"rotary": "N m", "linear": "N"}
SPEED = {"rotary": "rad/s", "linear": "m/s"}
LARGEST_BARE_RADIUS = 5.0  # [m]; above it most bare numbers are millimeters


def as_real(value: Any) -> Array:
    """`value` as a strongly typed double; raises in single precision."""
    return _strongly_typed(value, np.dtype(np.float64))


def as_complex(value: Any) -> Array:
    """`value` as a strongly typed complex number of double precision."""
    return _strongly_typed(value, np.dtype(np.complex128))


def _strongly_typed(value: Any, dtype: np.dtype) -> Array:
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            "beltjax needs double precision: call jax.config.update('jax_enable_x64', True) "
            "before building a drive, or set JAX_ENABLE_X64=1."
        )
    # A bare jnp.asarray(0.03) is weakly typed and costs a second compilation. What JAX does not
    # trace is converted by NumPy, which compiles nothing.
    if isinstance(value, jax.Array) and value.dtype == dtype and not value.weak_type:
        return value
    if any(isinstance(number, Tracer) for number in jax.tree.leaves(value)):
        return jnp.asarray(value, dtype=dtype)
    return jnp.asarray(np.asarray(value, dtype=dtype))


def as_optional(value: Any) -> Array | None:
    """`as_real`, for a number that may be absent."""
    return None if value is None else as_real(value)


def as_sign(names: Mapping[str, float], value: Any) -> Array:
    """+1 or -1 from one of two words, or from the number itself."""
    if isinstance(value, str):
        if value not in names:
            raise ValueError(f"{value!r} is not one of {', '.join(map(repr, names))}.")
        value = names[value]
    return as_real(value)


def as_flags(value: Any) -> Array:
    """A sequence of numbers, or one number, as a vector."""
    flags = as_real(value)
    return flags if flags.ndim else flags[None]


def as_law(value: Any) -> Array:
    """The number of the law of a joint between rim and hub, as `physics.joints` has it."""
    return as_sign(LAWS, value)


def as_friction_law(value: Any) -> Array | None:
    """0 for friction by Stribeck's law, 1 for the cubic one; None where it is not given."""
    return None if value is None else as_sign(FRICTION_LAWS, value)


def as_kind(value: Any) -> Array:
    """1 for a tensioner that turns about a pivot, 0 for one that slides along a line."""
    return as_sign(KINDS, value)


def as_side(value: Any) -> Array:
    """+1 for a grooved pulley (inside the loop), -1 for one on the back of the belt."""
    return as_sign(SIDES, value)


def as_sense(value: Any) -> Array:
    """+1 for pulleys listed counterclockwise, -1 for clockwise."""
    return as_sign(SENSES, value)


def as_travel(value: Any) -> Array:
    """+1 for a belt that runs in the listed order, -1 for the opposite."""
    return as_sign(TRAVELS, value)


def concrete(value: Any) -> np.ndarray | None:
    """`value` as a NumPy array, or None while JAX traces it."""
    return None if isinstance(value, Tracer) else np.asarray(value)


def require_shape(what: str, value: Array, shape: tuple[int, ...], meaning: str) -> None:
    """Raise `ValueError` when `value` has another shape than `shape`."""
    if value.shape != shape:
        raise ValueError(f"{what}: {meaning} has shape {shape}, not {value.shape}.")


class Belt(Readable):
    """A belt: a uniform, extensible beam."""

    axial_stiffness: Float[Array, ""] = eqx.field(
        converter=as_real,
        metadata=number(
            "N", "EA, of the whole width", above=0, design=True, quantity="stretch stiffness"
        ),
    )
    bending_stiffness: Float[Array, ""] = eqx.field(
        converter=as_real,
        metadata=number("N m^2", "EI, of the whole width; 0 is a string", at_least=0, design=True),
    )
    mass_per_length: Float[Array, ""] = eqx.field(
        converter=as_real,
        metadata=number(
            "kg/m", "of the unstretched belt, of the whole width", above=0, design=True
        ),
    )
    thickness: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number("m", "clearance is then measured from the belt's faces", at_least=0),
    )
    allowable_tension: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number(
            "N",
            "the maker's limit, of the whole width: `analyze` warns above it, and studies have the "
            "quantity `tension_reserve`",
            above=0,
        ),
    )
    longitudinal_damping: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number(
            "N s/m",
            "of the belt's motion along a pulley on which it slides, for squeal",
            at_least=0,
        ),
    )
    wedge_angle: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number(
            "rad", "between the flanks of its grooves", above=0, design=True, rare=True
        ),
    )
    wedge_stiffness: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number(
            "N/m^2", "side force per depth and length", above=0, design=True, rare=True
        ),
    )
    cushion_radial: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number(
            "N/m^2",
            "of a soft layer between cords and pulleys: force per unstretched length and give "
            "towards the axis, for `bj.cushion_state`. In a file `cushion = { radial, shear }`",
            above=0,
            design=True,
            quantity="stiffness of a cushion",
        ),
    )
    cushion_shear: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number(
            "N/m^2",
            "of that layer: force per unstretched length and shear along the belt",
            above=0,
            design=True,
            quantity="stiffness of a cushion",
        ),
    )
    name: str = eqx.field(static=True, default="belt")
    # Those of a standard, between which nothing lies, so that nothing is differentiated by them.
    pitch: float | None = eqx.field(static=True, default=None)  # of the teeth [m]; None: no teeth
    # Lengths along the neutral axis [m] in which the belt is sold.
    standard_lengths: tuple[float, ...] = eqx.field(static=True, default=())

    def __check_init__(self):
        if (self.wedge_angle is None) != (self.wedge_stiffness is None):
            raise ValueError(
                f"Belt {self.name!r}: wedge_angle and wedge_stiffness go together: give both."
            )
        if (self.cushion_radial is None) != (self.cushion_shear is None):
            raise ValueError(
                f"Belt {self.name!r}: cushion_radial and cushion_shear go together; give both."
            )


class Pulley(Readable):
    """One pulley, in the plane of the drive."""

    words: ClassVar = {"face": SIDES, "friction_law": FRICTION_LAWS}

    name: str = eqx.field(static=True)
    center: Float[Array, "2"] = eqx.field(
        converter=as_real,
        metadata=number("m", "`[x, y]`, in the drawn layout", design=True, parts=("x", "y")),
    )
    radius: Float[Array, ""] = eqx.field(
        converter=as_real,
        metadata=number(
            "m",
            "to the neutral axis of the belt. Above 5 m its unit must be written, since most such "
            "numbers are millimeters",
            above=0,
            largest_bare=LARGEST_BARE_RADIUS,
            design=True,
        ),
    )
    face: Float[Array, ""] = eqx.field(converter=as_side, default=1.0)  # +1 grooved, -1 back
    inertia: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number("kg m^2", "for vibration; behind an isolator that of the hub", at_least=0),
    )
    friction: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number("", "coefficient, for contact and slip", at_least=0),
    )
    friction_static: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number(
            "",
            "coefficient before the belt slides, for squeal; `friction` is then that of fast "
            "sliding, or of a cubic law the least",
            at_least=0,
        ),
    )
    friction_speed: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number(
            "m/s",
            "beside it: sliding speed over which friction falls, or of a cubic law at which it is "
            "least",
            above=0,
        ),
    )
    offset: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number("m", "of the plane of its groove, for the angle at which the belt enters"),
    )
    rim_radius: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number("m", "for clearance", above=0, largest_bare=LARGEST_BARE_RADIUS),
    )
    wedge_angle: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number("rad", "of its own groove", above=0, design=True, rare=True),
    )
    # Which pulley drives and which tensioner carries it are data, not structure: drives that
    # differ only there share one compiled function and may share a batch.
    driver: Float[Array, ""] = eqx.field(converter=as_real, default=0.0)  # 1: its motion is given
    # 1 for the tensioner that carries the pulley; without entries it is carried by none.
    on: Float[Array, " coordinates"] = eqx.field(converter=as_flags, default=())
    # 1: the accessory is bolted to the body that carries its pulley, 0: to the ground.
    housed: Float[Array, ""] = eqx.field(converter=as_real, default=0.0)
    # 1: a belt that wedges does so here, 0: the rim is smooth; of a pulley on its back 0 anyway.
    wedged: Float[Array, ""] = eqx.field(converter=as_real, default=1.0)
    # 0: the cords lie on this pulley itself, though the belt has a cushion.
    cushion: Float[Array, ""] = eqx.field(converter=as_real, default=1.0)
    # How friction falls from `friction_static`: data, too.
    friction_law: Float[Array, ""] | None = eqx.field(converter=as_friction_law, default=None)
    belt: str | None = eqx.field(static=True, default=None)  # name of its belt; None: the only one
    shaft: str | None = eqx.field(static=True, default=None)  # name of a pulley on the same shaft

    def __check_init__(self):
        require_shape(f"Pulley {self.name!r}", self.center, (2,), "center (x, y)")
        if any(mark in self.name for mark in ".:=") or not self.name.strip():
            raise ValueError(
                f"Pulley {self.name!r}: a name holds no '.', ':' or '=' and is not empty."
            )
        face = concrete(self.face)
        if face is not None and not np.all(np.abs(face) == 1):
            raise ValueError(
                f"Pulley {self.name!r}: face is +1 (grooved) or -1 (back), not {face}."
            )
        beside = self.friction, self.friction_speed
        if self.friction_static is not None and any(number is None for number in beside):
            raise ValueError(
                f"Pulley {self.name!r}: friction_static needs friction and friction_speed, too."
            )

    @property
    def holding(self) -> Float[Array, ""] | None:
        """Coefficient of friction up to which the belt does not slide; None where none is given."""
        return self.friction if self.friction_static is None else self.friction_static


class Tensioner(Readable):
    """A movable body with one coordinate, which carries the pulleys whose `on` names it.

    It turns about `pivot`, counted counterclockwise from the drawn position [rad], or slides along
    `direction`, counted from there [m]. It may sit on another tensioner: `on` then has a 1 at
    that one's place, which comes before its own. Stiffness 0 leaves it to be held by the belt,
    by an `ArmSpring`, by a constant `force`, or by the weight of its `mass` under the drive's
    gravity.
    """

    words: ClassVar = {"kind": KINDS}

    pivot: Float[Array, "2"] = eqx.field(
        converter=as_real,
        default=(0.0, 0.0),
        metadata=number("m", "`[x, y]`, as drawn", parts=("x", "y"), kinds=("rotary",)),
    )
    stiffness: Float[Array, ""] = eqx.field(
        converter=as_real,
        default=0.0,
        metadata=number(
            STIFFNESS,
            "of its spring; 0: held by the belt or an arm spring",
            at_least=0,
            design=True,
        ),
    )
    inertia: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number(
            INERTIA,
            "about a fixed pivot, or its mass, with the mass of its pulleys but not their spin",
            at_least=0,
        ),
    )
    damping: Float[Array, ""] = eqx.field(
        converter=as_real,
        default=0.0,
        metadata=number(DAMPING, "for the forced response", at_least=0),
    )
    stops: Float[Array, "2"] = eqx.field(
        converter=as_real,
        default=NO_STOPS,
        metadata=number(COORDINATE, "`[least, greatest]`, from the drawn position", unbounded=True),
    )
    kind: Float[Array, ""] = eqx.field(converter=as_kind, default="rotary")
    direction: Float[Array, "2"] = eqx.field(
        converter=as_real,
        default=(1.0, 0.0),
        metadata=number(
            "",
            "in which it slides: `[dx, dy]` or an angle",
            parts=("x", "y"),
            kinds=("linear",),
        ),
    )
    # Mass and inertia of a body whose pivot moves; `inertia` is added to them.
    mass: Float[Array, ""] = eqx.field(
        converter=as_real,
        default=0.0,
        metadata=number(
            "kg",
            "of a tensioner that sits on another, or that `gravity` pulls; with its pulleys",
            at_least=0,
        ),
    )
    mass_center: Float[Array, "2"] = eqx.field(
        converter=as_real,
        default=(0.0, 0.0),
        metadata=number("m", "`[x, y]` of that mass, as drawn", parts=("x", "y"), beside="mass"),
    )
    inertia_center: Float[Array, ""] = eqx.field(
        converter=as_real,
        default=0.0,
        metadata=number("kg m^2", "about that center", at_least=0),
    )
    force: Float[Array, ""] = eqx.field(
        converter=as_real,
        default=0.0,
        metadata=number(
            FORCE,
            "constant, besides its spring, of a weight on a rope or of a cylinder; positive "
            "counterclockwise, or along `direction`",
            design=True,
            rare=True,
            quantity="force of a spring",
        ),
    )
    friction_torque: Float[Array, ""] = eqx.field(
        converter=as_real,
        default=0.0,
        metadata=number(
            FORCE,
            "of dry friction against its motion, for periodic motion; of a linear one a force. In "
            "a file also a table `{ coulomb, hub, spring, unwinding }` of this and the next three",
            at_least=0,
            design=True,
            rare=True,
        ),
    )
    friction_hub: Float[Array, ""] = eqx.field(
        converter=as_real,
        default=0.0,
        metadata=number(
            BEARING,
            "dry friction per load on its bearing by the belt: coefficient times the bearing's "
            "radius, of a linear one the coefficient",
            at_least=0,
            rare=True,
        ),
    )
    friction_spring: Float[Array, ""] = eqx.field(
        converter=as_real,
        default=0.0,
        metadata=number("", "dry friction per pull of its spring", at_least=0, rare=True),
    )
    friction_unwinding: Float[Array, ""] = eqx.field(
        converter=as_real,
        default=1.0,
        metadata=number(
            "",
            "factor of its dry friction while its spring unwinds; 1 unless given",
            at_least=0,
            rare=True,
            beside="friction_torque",
        ),
    )
    friction_speed: Float[Array, ""] = eqx.field(
        converter=as_real,
        default=0.02,
        metadata=number(
            SPEED,
            "at which that friction turns round, as tanh(speed/friction_speed): a fiftieth of the "
            "largest speed for 1 %; 0.02 unless given. With 0 it holds what stands still",
            at_least=0,
            rare=True,
            beside="friction_torque",
        ),
    )
    locked: Float[Array, ""] = eqx.field(converter=as_real, default=0.0)  # 1: bolted
    on: Float[Array, " coordinates"] = eqx.field(converter=as_flags, default=())
    name: str = eqx.field(static=True, default="tensioner")

    def __check_init__(self):
        for field, meaning in (
            ("pivot", "pivot (x, y)"),
            ("direction", "direction (x, y)"),
            ("mass_center", "mass_center (x, y)"),
            ("stops", "stops (least, greatest)"),
        ):
            require_shape(f"Tensioner {self.name!r}", getattr(self, field), (2,), meaning)


class ArmSpring(Readable):
    """A spring between two tensioners: `between` is -1 at the first one's place, 1 at the second's.

    It is linear in their coordinates, as a torsion spring between two arms of one pivot is.
    """

    between: Float[Array, " coordinates"] = eqx.field(converter=as_flags)
    stiffness: Float[Array, ""] = eqx.field(
        converter=as_real,
        metadata=number(STIFFNESS, "of the spring between the two", at_least=0, design=True),
    )
    damping: Float[Array, ""] = eqx.field(
        converter=as_real,
        default=0.0,
        metadata=number(DAMPING, "for the forced response", at_least=0),
    )
    name: str = eqx.field(static=True, default="spring")


class Isolator(Readable):
    """A torsion spring between the rim of a pulley, on which the belt runs, and its hub.

    Torque and `Pulley.inertia` belong to the hub. `pulleys` is 1 at the places of the pulleys whose
    rim it carries; several share one rim. A "spring-clutch" lets the hub overrun the rim: it pulls
    only while it is wound up, and remembers the angle of overrun (Zhu and Parker, 2005). A
    "decoupler" is a spring with a one-way clutch, which takes hold again as soon as the rim is no
    slower than the hub, and a "rigid-clutch" that clutch alone. Small motion leaves all of them
    engaged, so that each is a spring but for `periodic_response`; that of a rigid clutch is the
    shaft's. Raises `ValueError` for stops of a rigid clutch, and for stops that are not in order.
    """

    words: ClassVar = {"law": LAWS}

    pulleys: Float[Array, " pulleys"] = eqx.field(converter=as_flags)
    stiffness: Float[Array, ""] = eqx.field(
        converter=as_real,
        metadata=number("N m/rad", "of the spring between rim and hub", above=0, design=True),
    )
    rim_inertia: Float[Array, ""] | None = eqx.field(
        converter=as_optional,
        default=None,
        metadata=number("kg m^2", "of the rim, for vibration", at_least=0),
    )
    damping: Float[Array, ""] = eqx.field(
        converter=as_real,
        default=0.0,
        metadata=number("N m s/rad", "for the forced response", at_least=0),
    )
    law: Float[Array, ""] = eqx.field(converter=as_law, default="spring")  # its place in LAWS
    stops: Float[Array, "2"] = eqx.field(
        converter=as_real,
        default=NO_STOPS,
        metadata=number(
            "rad",
            "`[least, greatest]` wind-up of rim against hub beyond which it meets stiff springs, "
            "in periodic motion",
            unbounded=True,
            rare=True,
        ),
    )
    stop_stiffness: Float[Array, ""] = eqx.field(
        converter=as_real,
        default=0.0,
        metadata=number("N m/rad", "of those springs", at_least=0, rare=True),
    )
    name: str = eqx.field(static=True, default="")  # that of its first pulley unless given

    def __check_init__(self):
        require_shape(f"Isolator {self.name!r}", self.stops, (2,), "stops (least, greatest)")
        stops, law = concrete(self.stops), concrete(self.law)
        if stops is None:
            return
        if not np.all(stops[..., 0] < stops[..., 1]):
            raise ValueError(
                f"Isolator {self.name!r}: stops are (least, greatest), not {tuple(stops)}."
            )
        if law is not None and np.any(law == LAWS["rigid-clutch"]) and np.isfinite(stops).any():
            raise ValueError(f"Isolator {self.name!r}: a rigid clutch does not wind up; no stops.")


class Damper(Readable):
    """An inertia ring on a torsion spring, on the hub or on the rim of a pulley."""

    pulley: Float[Array, " pulleys"] = eqx.field(converter=as_flags)  # 1 at the pulley's place
    stiffness: Float[Array, ""] = eqx.field(
        converter=as_real,
        metadata=number("N m/rad", "of the ring's spring", above=0, design=True),
    )
    inertia: Float[Array, ""] = eqx.field(
        converter=as_real, metadata=number("kg m^2", "of the ring", above=0, design=True)
    )
    damping: Float[Array, ""] = eqx.field(
        converter=as_real,
        default=0.0,
        metadata=number("N m s/rad", "for the forced response", at_least=0),
    )
    on_rim: Float[Array, ""] = eqx.field(converter=as_real, default=0.0)  # 1: on the rim, 0: hub
    name: str = eqx.field(static=True, default="")  # that of its pulley unless given


class Model(Readable):
    """Terms that Kong (2003) leaves out, each counted (1) or not (0): docs/model.md.

    Without them the published numbers are reproduced. `arm_curvature` counts the second derivative
    of the path by the tensioners' coordinates. `stretching_arcs` counts the stretch of the belt on
    the pulleys, and with it the exact statics of the running string, about which bending is then
    small; it adds equations, and is static. `belt_inertia` counts the belt's own motion along its
    path.
    """

    arm_curvature: Float[Array, ""] = eqx.field(converter=as_real, default=0.0)
    stretching_arcs: bool = eqx.field(static=True, converter=bool, default=False)
    belt_inertia: Float[Array, ""] = eqx.field(converter=as_real, default=0.0)
    schema: int = eqx.field(static=True, default=1)  # of the drive file it came with
