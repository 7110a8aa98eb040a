"""Belt laws: how much a belt stretches under tension and bending (docs/theory/contact.md, (C3)).

A law gives the strain as a function of T/EA and EI kappa^2/(2 EA). The quantities that contact
mechanics needs follow from it: the stretch at a given P = T - G V, the unstretched lengths of spans
and arcs, and the speed of the unstretched belt. A law that is linear in both arguments has them in
closed form; any other law has them by Gauss's rule and Newton's method.
"""

import abc
import inspect
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from beltjax.physics.elastica import Span, SpanData, curvature_along, layer

Scalar = Float[Array, ""]

_NEWTON_STEPS = 5  # strains are small: each step doubles the digits, from two or more
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(10)
# Ends of the panels along half a span, in lengths of its bent ends: those fade like e^{-s/ell}.
_PANELS = np.array([0.0, 0.5, 1.0, 2.0, 3.0, 4.5, 6.0, 8.0, 11.0, 15.0, 20.0])


class AbstractBeltLaw(eqx.Module):
    """How a belt stretches; a law overrides one method, `strain`.

    The numbers of a law are its fields, by which JAX differentiates.

    Examples:
        >>> @bj.belt_law("hardening")
        ... class Hardening(bj.AbstractBeltLaw):
        ...     "A belt that hardens as it is stretched."
        ...
        ...     def strain(self, tension, bending):
        ...         return tension - 2.0 * tension**2
    """

    @abc.abstractmethod
    def strain(self, tension: Array, bending: Array) -> Array:
        """Strain of the belt's neutral axis, element by element.

        Args:
            tension: T/EA, of any shape.
            bending: EI kappa^2/(2 EA), of the same shape.

        Returns:
            The strain, of the same shape, which is zero where both are zero and increases with the
            tension.
        """

    def stretch(self, P: Array, bent: Array, g: Array, EA: Array) -> Array:
        """Ratio 1 + e of the stretched to the unstretched belt, where P = T - g (1 + e).

        `bent` is EI kappa^2/2, and g the momentum flux of the unstretched belt.
        """

        def unmet(ratio: Array) -> Array:
            return ratio - 1 - self.strain((P + g * ratio) / EA, bent / EA)

        return _root(unmet, jnp.ones_like(P + bent))

    def span_length(self, span: Span, of: SpanData, g: Scalar) -> Scalar:
        """Unstretched length of a free span: the integral of ds/(1 + e)."""
        half, ell = span.L / 2, layer(of)
        ends = jnp.minimum(jnp.where(ell > 0, ell, half) * _PANELS, half).at[-1].set(half)
        middle, width = (ends[1:] + ends[:-1]) / 2, (ends[1:] - ends[:-1]) / 2
        s = (middle[:, None] + width[:, None] * _NODES).ravel()
        weights = (width[:, None] * _WEIGHTS).ravel()
        s = jnp.concatenate([s, span.L - s])
        bent = of.EI * curvature_along(span, of, s) ** 2 / 2
        ratios = self.stretch(of.C - bent, bent, g, of.EA)
        return jnp.sum(jnp.concatenate([weights, weights]) / ratios)

    def slip_length(
        self, low: Array, high: Array, mu: Array, bent: Array, g: Array, EA: Array
    ) -> Array:
        """Unstretched length over the radius of arcs of slip, along which P goes from low to high.

        On such an arc P grows by e^{mu angle} (Euler and Eytelwein).
        """
        rise = jnp.log(high / low)
        P = low[..., None] * jnp.exp(rise[..., None] * (1 + _NODES) / 2)
        ratios = self.stretch(P, bent[..., None], g[..., None], EA[..., None])
        return rise / mu * jnp.sum(_WEIGHTS / 2 / ratios, axis=-1)

    def reference_speed(
        self, v: Array, flux: tuple[Array, Array], P: Array, bent: Array, EA: Array
    ) -> Array:
        """Speed V of the unstretched belt where it runs with v; g = flux[0] V^2 + flux[1] V."""
        square, linear = flux

        def unmet(speed: Array) -> Array:
            g = (square * speed + linear) * speed
            return speed * self.stretch(P, bent, g, EA) - v

        return _root(unmet, v / self.stretch(P, bent, jnp.zeros_like(v), EA))


def _root(unmet: Callable[[Array], Array], start: Array) -> Array:
    """The root of each element of `unmet`, by Newton's method.

    Only the last step is differentiated, which at the root gives the implicit derivative.
    """

    def step(x: Array) -> Array:
        left, slope = jax.jvp(unmet, (x,), (jnp.ones_like(x),))
        return x - left / slope

    x = start
    for _ in range(_NEWTON_STEPS):
        x = step(x)
    return step(jax.lax.stop_gradient(x))


class LinearLaw(AbstractBeltLaw):
    """EA e = T + share * EI kappa^2/2, in closed form.

    A share of 0 is the source's T = EA e (Kong 2003, chapter 5). With a share of 1 tension and
    moment derive from a stored energy, so that power in equals power out and friction.
    """

    share: Scalar

    def strain(self, tension: Array, bending: Array) -> Array:  # noqa: D102
        return tension + self.share * bending

    def stretch(self, P: Array, bent: Array, g: Array, EA: Array) -> Array:  # noqa: D102
        return (EA + P + self.share * bent) / (EA - g)

    def span_length(self, span: Span, of: SpanData, g: Scalar) -> Scalar:  # noqa: D102
        # With a share of 1 the stretch is the same all along.
        J = span.J + self.share * (span.L / (of.EA + of.C) - span.J)
        return (of.EA - g) * J

    def slip_length(  # noqa: D102
        self, low: Array, high: Array, mu: Array, bent: Array, g: Array, EA: Array
    ) -> Array:
        stiff = EA + self.share * bent  # (5.26)
        return (EA - g) * jnp.log(high / low * (stiff + low) / (stiff + high)) / (mu * stiff)

    def reference_speed(  # noqa: D102
        self, v: Array, flux: tuple[Array, Array], P: Array, bent: Array, EA: Array
    ) -> Array:
        square, linear = flux
        stiff = EA + P + self.share * bent + linear * v  # (EA - square V^2) v/V
        return 2 * v * EA / (stiff + jnp.sqrt(stiff**2 + 4 * square * v**2 * EA))


class RegisteredLaw(NamedTuple):
    """A belt law that has a name."""

    name: str
    meaning: str  # one line
    make: Callable[[], AbstractBeltLaw]


LawFactory = TypeVar("LawFactory", bound=Callable[[], AbstractBeltLaw])
_LAWS: dict[str, RegisteredLaw] = {}


def belt_law(name: str) -> Callable[[LawFactory], LawFactory]:
    """Register a class of belt laws, or a function that makes one, under a name.

    The class or function is called without arguments. The first line of its docstring describes the
    law in messages. docs/contact.md.

    Args:
        name: the name by which `contact_state(law=...)` and `--law` take the law.

    Returns:
        A decorator that registers the class or function and returns it unchanged.

    Raises:
        ValueError: there is a law of that name already.
    """
    if name in _LAWS:
        raise ValueError(f"belt_law: there is a law {name!r} already; choose another name.")

    def register(make: LawFactory) -> LawFactory:
        _LAWS[name] = RegisteredLaw(name, (inspect.getdoc(make) or "").split("\n")[0], make)
        return make

    return register


def belt_laws() -> tuple[RegisteredLaw, ...]:
    """All registered laws, in the order of their registration."""
    return tuple(_LAWS.values())


def find_belt_law(law: str | AbstractBeltLaw) -> AbstractBeltLaw:
    """The law, or the registered law of a name, with its numbers as arrays.

    Raises `ValueError`, with a text that lists all laws, for a name that is not registered.
    """
    if isinstance(law, str):
        if law not in _LAWS:
            known = ", ".join(map(repr, _LAWS))
            raise ValueError(f"law {law!r} is not one of {known}.")
        law = _LAWS[law].make()
    return jax.tree.map(lambda number: jnp.asarray(number, float), law)


@belt_law("kong")
def kong() -> LinearLaw:
    """T = EA e, whatever the curvature (Kong 2003)."""
    return LinearLaw(jnp.zeros(()))


@belt_law("hyperelastic")
def hyperelastic() -> LinearLaw:
    """EA e = T + EI kappa^2/2, which conserves energy."""
    return LinearLaw(jnp.ones(()))
