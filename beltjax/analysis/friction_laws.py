"""Laws of friction over the sliding speed, in SI."""

import abc

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from beltjax.drive.components import as_real, concrete
from beltjax.physics.friction_laws import FrictionCurve


class AbstractFrictionLaw(eqx.Module):
    """How the coefficient of friction depends on the sliding speed."""

    @property
    @abc.abstractmethod
    def curve(self) -> FrictionCurve:
        """The law in the form that all of them have, in SI."""

    def coefficient(self, speed: Array | np.ndarray | float) -> Array:
        """Coefficient of friction while sliding.

        Args:
            speed: sliding speeds >= 0, of any shape [m/s].

        Returns:
            The coefficients, of the same shape; at 0 that of sliding that has just begun.
        """
        return self.curve.coefficient(jnp.asarray(speed, float))


class StribeckFriction(AbstractFrictionLaw):
    """Friction that falls from `static` to `kinetic` within some sliding speeds `speed`.

    mu = kinetic + (static - kinetic) e^{-v/speed} + viscous v, docs/theory/friction_vibration.md,
    (F1): rubber on steel, dry or wet. Raises `ValueError` for numbers that no such law has.

    Examples:
        >>> law = bj.StribeckFriction(static=0.6, kinetic=0.3, speed=0.3)
        >>> law.coefficient(0.5)
    """

    static: Float[Array, ""] = eqx.field(converter=as_real)
    kinetic: Float[Array, ""] = eqx.field(converter=as_real)
    speed: Float[Array, ""] = eqx.field(converter=as_real)  # [m/s]
    viscous: Float[Array, ""] = eqx.field(converter=as_real, default=0.0)  # [s/m]

    def __check_init__(self):
        _require_order("StribeckFriction", "kinetic", self.static, self.kinetic)
        _require_positive("StribeckFriction", self.speed)
        viscous = concrete(self.viscous)
        if viscous is not None and not (viscous >= 0).all():
            raise ValueError(f"StribeckFriction: viscous is not negative; found {viscous}.")

    @property
    def curve(self) -> FrictionCurve:
        """The law in the form that all of them have, in SI."""
        none, drop = jnp.zeros_like(self.static), self.static - self.kinetic
        return FrictionCurve(self.static, self.kinetic, drop, self.speed, self.viscous, none)


class CubicFriction(AbstractFrictionLaw):
    """Friction that falls from `static` to its least value at the sliding speed `speed`, and rises.

    mu = static - k1 v + k3 v^3, docs/theory/friction_vibration.md, (F2): Panovko and Gubanova;
    Thomsen and Fidlin (2003). Beyond some twice `speed` it is no friction that has been measured.
    Raises `ValueError` for numbers that no such law has.
    """

    static: Float[Array, ""] = eqx.field(converter=as_real)
    least: Float[Array, ""] = eqx.field(converter=as_real)
    speed: Float[Array, ""] = eqx.field(converter=as_real)  # of the least friction [m/s]

    def __check_init__(self):
        _require_order("CubicFriction", "least", self.static, self.least)
        _require_positive("CubicFriction", self.speed)

    @property
    def curve(self) -> FrictionCurve:
        """The law in the form that all of them have, in SI."""
        none, drop = jnp.zeros_like(self.static), self.static - self.least
        linear, cubic = -1.5 * drop / self.speed, 0.5 * drop / self.speed**3
        return FrictionCurve(self.static, self.static, none, self.speed, linear, cubic)


class CoulombFriction(AbstractFrictionLaw):
    """Friction `kinetic` while sliding, and up to `static` at rest.

    docs/theory/friction_vibration.md, (F3): Fig. 6.3 b of Kong (2003). Steady sliding is stable at
    any speed, and stick-slip beside it. Raises `ValueError` for numbers that no such law has.
    """

    static: Float[Array, ""] = eqx.field(converter=as_real)
    kinetic: Float[Array, ""] = eqx.field(converter=as_real)

    def __check_init__(self):
        _require_order("CoulombFriction", "kinetic", self.static, self.kinetic)

    @property
    def curve(self) -> FrictionCurve:
        """The law in the form that all of them have, in SI."""
        none = jnp.zeros_like(self.static)
        return FrictionCurve(self.static, self.kinetic, none, none + 1.0, none, none)


def _require_order(what: str, name: str, static: Array, other: Array) -> None:
    high, low = concrete(static), concrete(other)
    if high is None or low is None:
        return
    if not ((low >= 0) & (high >= low) & np.isfinite(high)).all():
        raise ValueError(f"{what}: give 0 <= {name} <= static; found {low} and {high}.")


def _require_positive(what: str, speed: Array) -> None:
    value = concrete(speed)
    if value is not None and not ((value > 0) & np.isfinite(value)).all():
        raise ValueError(f"{what}: speed is positive; found {value}.")
