"""Motion of a drive at finite amplitude about its steady state, dimensionless.

    z      coordinates: the functions of span 1, .., of span n, rotations, the bodies' coordinates
    theta  rotation of the driver, which is given
    eta    strain that a span gains: d.z + driving theta + N(z)
    N      its part of second order in z

Spans stretch quasi-statically, so that all that is nonlinear in a drive is one number a span: the
functions have unit slopes, and N is half the sum of their squares and a quadratic form of the
bodies' coordinates. M, G and K are those of `vibration`; docs/theory/motion.md, (O1) to (O3).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.physics.vibration import VibrationModel

Scalar = Float[Array, ""]
Spans = Float[Array, " spans"]
State = Float[Array, " size"]


class MotionModel(eqx.Module):
    """The numbers of a drive in one steady state: M z'' + C z' + force = 0 without excitation."""

    mass: Float[Array, "size size"]
    damping: Float[Array, "size size"]  # C: gyroscopic and dissipative
    stiffness: Float[Array, "size size"]  # K, the stretch of the spans included
    elongations: Float[Array, "spans size"]  # d
    driving: Spans
    work: Spans  # lam gamma
    bodies: Float[Array, "spans coordinates coordinates"]  # N of the bodies is q.bodies q/2
    functions: int = eqx.field(static=True)  # of each span

    def parts(self, z: State) -> tuple[Float[Array, "spans n"], Float[Array, " coordinates"]]:
        """The spans' functions and the bodies' coordinates."""
        spans, count = self.bodies.shape[:2]
        fields = z[: spans * self.functions].reshape(spans, self.functions)
        return fields, z[len(z) - count :]


def quadratic_strains(model: VibrationModel) -> Float[Array, "spans coordinates coordinates"]:
    """Second derivatives of each span's strain by the bodies' coordinates, by lift and geometry."""
    moving = model.movable[:, None] * model.movable
    turned = model.a[:, :, None] * model.a[:, None, :]
    return moving * (turned + model.H / model.lam[:, None, None])


def projected(model: MotionModel, shapes: Float[Array, "spans n fewer"]) -> MotionModel:
    """The model with fewer functions on each span, combinations of its own.

    Columns of `shapes` are orthonormal, so that the slopes of the new functions are, too.
    """
    m, (spans, n, fewer) = model, shapes.shape

    def rows(matrix: Float[Array, "size *columns"]) -> Float[Array, "less *columns"]:
        belt = matrix[: spans * n].reshape(spans, n, -1)
        belt = jnp.einsum("inf,inc->ifc", shapes, belt).reshape(spans * fewer, -1)
        return jnp.concatenate([belt, matrix[spans * n :]])

    def square(matrix: Float[Array, "size size"]) -> Float[Array, "less less"]:
        return rows(rows(matrix).T).T

    return MotionModel(
        mass=square(m.mass),
        damping=square(m.damping),
        stiffness=square(m.stiffness),
        elongations=rows(m.elongations.T).T,
        driving=m.driving,
        work=m.work,
        bodies=m.bodies,
        functions=fewer,
    )


def second_order(model: MotionModel, z: State) -> Spans:
    """N of each span (O1)."""
    fields, q = model.parts(z)
    return (jnp.sum(fields**2, axis=1) + jnp.einsum("a,iab,b->i", q, model.bodies, q)) / 2


def strains(model: MotionModel, z: State, theta: Scalar | float = 0.0) -> Spans:
    """Strain that each span gains (O1)."""
    return model.elongations @ z + model.driving * theta + second_order(model, z)


def stretching(model: MotionModel, z: State, theta: Scalar | float = 0.0) -> State:
    """The force of the spans' stretch without its part K z, which is linear in z (O2)."""
    m = model
    N, back = jax.vjp(lambda z: second_order(m, z), z)
    beyond = m.driving * theta + N
    (bent,) = back(m.work * (m.elongations @ z + beyond))
    return (m.work * beyond) @ m.elongations + bent


def force(model: MotionModel, z: State, theta: Scalar | float = 0.0) -> State:
    """Elastic force on each coordinate (O2)."""
    return model.stiffness @ z + stretching(model, z, theta)


def energy(model: MotionModel, z: State, rate: State) -> Scalar:
    """Energy of a motion about the steady state, with the driver at rest (O3).

    Without damping it stays what it is; gyroscopic forces do no work.
    """
    m, N = model, second_order(model, z)
    stretch = jnp.sum(m.work * N * (m.elongations @ z + N / 2))
    return (rate @ m.mass @ rate + z @ m.stiffness @ z) / 2 + stretch
