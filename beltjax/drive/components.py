"""The physical description of a drive in SI units: immutable pytrees whose leaves are numbers."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from beltjax.drive.readable import Readable

SIDES = {"grooved": 1.0, "back": -1.0}
SENSES = {"counterclockwise": 1.0, "clockwise": -1.0}
TENSIONS_OF = ("belt", "string")
TRAVELS = {"listed": 1.0, "opposite": -1.0}


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
    """The belt: a uniform, extensible beam."""

    axial_stiffness: Float[Array, ""] = eqx.field(converter=as_real)  # EA [N]
    bending_stiffness: Float[Array, ""] = eqx.field(converter=as_real)  # EI [N m^2]
    mass_per_length: Float[Array, ""] = eqx.field(converter=as_real)  # unstretched [kg/m]
    thickness: Float[Array, ""] | None = eqx.field(converter=as_optional, default=None)  # [m]


class Pulley(Readable):
    """One pulley, in the plane of the drive."""

    words: ClassVar = {"face": SIDES}

    name: str = eqx.field(static=True)
    center: Float[Array, "2"] = eqx.field(converter=as_real)  # [m], in the drawn layout
    radius: Float[Array, ""] = eqx.field(converter=as_real)  # [m], to the neutral axis
    face: Float[Array, ""] = eqx.field(converter=as_side, default=1.0)  # +1 grooved, -1 back
    inertia: Float[Array, ""] | None = eqx.field(converter=as_optional, default=None)  # [kg m^2]
    friction: Float[Array, ""] | None = eqx.field(converter=as_optional, default=None)
    rim_radius: Float[Array, ""] | None = eqx.field(converter=as_optional, default=None)  # [m]
    # Which pulley drives and which one the arm carries are data, not structure: drives that
    # differ only there share one compiled function and may share a batch.
    driver: Float[Array, ""] = eqx.field(converter=as_real, default=0.0)  # 1: its motion is given
    on_arm: Float[Array, ""] = eqx.field(converter=as_real, default=0.0)  # 1: carried by the arm

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


class Tensioner(Readable):
    """The spring-loaded arm that carries the pulley whose `on_arm` is set."""

    pivot: Float[Array, "2"] = eqx.field(converter=as_real)  # [m]
    stiffness: Float[Array, ""] = eqx.field(converter=as_real)  # k_r [N m/rad]
    inertia: Float[Array, ""] | None = eqx.field(converter=as_optional, default=None)
    # inertia [kg m^2] is about the pivot and includes the mass of the pulley, not its spin
    damping: Float[Array, ""] | None = eqx.field(converter=as_optional, default=None)  # [N m s/rad]
    stops: Float[Array, "2"] | None = eqx.field(converter=as_optional, default=None)
    # stops [rad] are the least and the greatest direction of the arm, from pivot to pulley

    def __check_init__(self):
        require_shape("Tensioner", self.pivot, (2,), "pivot (x, y)")
        if self.stops is not None:
            require_shape("Tensioner", self.stops, (2,), "stops (least, greatest)")


class TensionGiven(Readable):
    """The drawn layout is the torque-free state and `tension` its tension at rest.

    That is the tension in the middle of the free spans. `steady_state` takes the belt for a string
    there, which for a belt that is stiff for its pulleys it is not: `contact_state` finds the
    belt whose real tension this is, or with `tension_of="string"` the belt that would have this
    tension if it were a string, the one that `steady_state` is about.

    They fix the unstretched length of the belt and the free angle of the arm; torques then
    move the arm and the tensions. `span_tensions`, for comparison with print, names the
    tension of every span instead: the drawn layout is kept and torques are not used.
    """

    tension: Float[Array, ""] = eqx.field(converter=as_real)  # P0 [N]
    span_tensions: Float[Array, " spans"] | None = eqx.field(converter=as_optional, default=None)
    tension_of: str = eqx.field(static=True, default="belt")

    def __check_init__(self):
        if self.tension_of not in TENSIONS_OF:
            known = ", ".join(map(repr, TENSIONS_OF))
            raise ValueError(f"TensionGiven: tension_of {self.tension_of!r} is not one of {known}.")


class BeltGiven(Readable):
    """The belt and the free angle of the arm are held; arm angle and tensions follow."""

    belt_length: Float[Array, ""] = eqx.field(converter=as_real)  # unstretched [m]
    free_angle: Float[Array, ""] | None = eqx.field(converter=as_optional, default=None)
    # free_angle [rad] is the direction of the arm, from pivot to pulley, with its spring relaxed:
    # as many turns from the drawn direction, which is in (-pi, pi], as the spring is wound.


def span_names(pulleys: Sequence[str]) -> tuple[str, ...]:
    """Names 'a-b' of the spans between pulleys of these names, in listed order."""
    following = (*pulleys[1:], *pulleys[:1])
    return tuple(f"{a}-{b}" for a, b in zip(pulleys, following, strict=True))


def repeated_span(pulleys: Sequence[str]) -> str | None:
    """A name that two spans between these pulleys would share: hyphens are part of both."""
    names = span_names(pulleys)
    return next((name for name in names if names.count(name) > 1), None)


class Drive(Readable):
    """A belt drive. Pulleys are listed in the order in which they are met going round the loop.

    Every number is a leaf, so the gradient of anything with respect to a drive is a drive.
    Raises `ValueError` for what is wrong whatever the numbers: fewer than two pulleys, names
    that repeat, not exactly one driver, a tensioner without its pulley.
    """

    words: ClassVar = {"sense": SENSES}

    belt: Belt
    pulleys: tuple[Pulley, ...] = eqx.field(converter=tuple)
    installation: TensionGiven | BeltGiven
    tensioner: Tensioner | None = None
    sense: Float[Array, ""] = eqx.field(converter=as_sense, default="counterclockwise")
    name: str = eqx.field(static=True, default="drive")

    def __check_init__(self):
        if len(self.pulleys) < 2:
            raise ValueError(f"A drive has at least two pulleys, not {len(self.pulleys)}.")
        names = self.pulley_names
        if len(set(names)) < len(names):
            raise ValueError(f"Names of pulleys repeat: {', '.join(names)}.")
        repeated = repeated_span(names)
        if repeated is not None:
            raise ValueError(f"Two spans would be called {repeated!r}: rename a pulley.")
        self._check_flags("driver", 1, "exactly one pulley drives")
        carried = 0 if self.tensioner is None else 1
        self._check_flags("on_arm", carried, f"the tensioner carries {carried} pulley(s)")
        self._check_installation()

    def _check_flags(self, which: str, count: int, rule: str) -> None:
        flags = [concrete(getattr(pulley, which)) for pulley in self.pulleys]
        if any(flag is None or flag.ndim for flag in flags):
            return  # traced or batched: only numbers can be counted
        found = sum(float(flag) for flag in flags if flag is not None)
        if found != count:
            raise ValueError(f"Pulley.{which}: {rule}, but {found:g} are marked.")

    def _check_installation(self) -> None:
        rule = self.installation
        if isinstance(rule, BeltGiven) and (rule.free_angle is None) != (self.tensioner is None):
            raise ValueError("BeltGiven: free_angle is given exactly when there is a tensioner.")
        if isinstance(rule, TensionGiven) and rule.span_tensions is not None:
            require_shape("TensionGiven", rule.span_tensions, (len(self.pulleys),), "span_tensions")

    @property
    def pulley_names(self) -> tuple[str, ...]:
        """Names of the pulleys, in listed order."""
        return tuple(pulley.name for pulley in self.pulleys)

    @property
    def span_names(self) -> tuple[str, ...]:
        """Names 'a-b' of the spans: span i runs from pulley i to the next in the list."""
        return span_names(self.pulley_names)

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
    def drives(self) -> Float[Array, " pulleys"]:
        """1 for the driver, 0 for the others."""
        return jax.lax.stop_gradient(jnp.stack([pulley.driver for pulley in self.pulleys]))

    @property
    def carried(self) -> Float[Array, " pulleys"]:
        """1 for the pulley on the tensioner's arm, 0 for the others."""
        return jax.lax.stop_gradient(jnp.stack([pulley.on_arm for pulley in self.pulleys]))

    @property
    def arm(self) -> Float[Array, "2"]:
        """Vector from the tensioner's pivot to the pulley it carries, as drawn [m].

        A drive with locked centers gets a unit arm that carries nothing.
        """
        if self.tensioner is None:
            return jnp.array([1.0, 0.0])
        return self.carried @ self.centers - self.tensioner.pivot


class ExcitationGiven(Readable):
    """What shakes the drive, by the drive file: the default of `beltjax response`.

    Amplitudes are zero to peak, at `order` times the driver's speed.
    """

    crank: Float[Array, ""] | None = eqx.field(converter=as_optional, default=None)  # [rad]
    order: Float[Array, ""] | None = eqx.field(converter=as_optional, default=None)
    torque: dict[str, Float[Array, ""]] = eqx.field(
        converter=lambda torque: {name: as_real(value) for name, value in torque.items()},
        default_factory=dict,
    )  # [N m], by name of pulley, in the direction of belt travel


class OperatingPoint(Readable):
    """How the drive runs: its speed, and the torque each accessory takes from the belt.

    Give `belt_speed`, or `driver_speed` from which it follows. `mass_flow` replaces the
    belt's mass per length in contact mechanics. The driver balances the torques; one given for
    it counts for nothing, so that batches may mix which pulley drives (a drive file refuses it).
    `excitation` concerns forced vibration alone.
    """

    words: ClassVar = {"travel": TRAVELS}

    belt_speed: Float[Array, ""] | None = eqx.field(converter=as_optional, default=None)  # [m/s]
    driver_speed: Float[Array, ""] | None = eqx.field(
        converter=as_optional, default=None
    )  # [rad/s]
    mass_flow: Float[Array, ""] | None = eqx.field(converter=as_optional, default=None)  # [kg/s]
    torque: dict[str, Float[Array, ""]] = eqx.field(
        converter=lambda torque: {name: as_real(value) for name, value in torque.items()},
        default_factory=dict,
    )  # [N m], by name of pulley
    travel: Float[Array, ""] = eqx.field(converter=as_travel, default="listed")
    excitation: ExcitationGiven | None = None

    def __check_init__(self):
        if (self.belt_speed is None) == (self.driver_speed is None):
            raise ValueError("OperatingPoint: give either belt_speed or driver_speed.")

    def speed(self, drive: Drive) -> Float[Array, ""]:
        """Speed of the belt [m/s]."""
        if self.belt_speed is not None:
            return self.belt_speed
        assert self.driver_speed is not None  # as __check_init__ holds
        return self.driver_speed * (drive.drives @ drive.radii)

    def torques(self, drive: Drive) -> Float[Array, " pulleys"]:
        """Torque taken from the belt by each pulley [N m]; the driver's balances the rest.

        Raises `KeyError` for a torque on a pulley that the drive does not have.
        """
        for name in self.torque:
            drive.pulley(name)
        taken = jnp.stack([self.torque.get(name, jnp.zeros(())) for name in drive.pulley_names])
        taken = taken * (1 - drive.drives)
        balance = -(drive.drives @ drive.radii) * jnp.sum(taken / drive.radii)
        return taken + drive.drives * balance
