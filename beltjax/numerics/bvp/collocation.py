"""The collocation equations of a two-point problem on a given mesh, and their linear algebra.

Unknowns are the node values y_i, the stage derivatives K_ij and the parameters p:

    f(x_ij, y_i + h_i sum_l A_jl K_il, p) - K_ij = 0       stages
    y_{i+1} - y_i - h_i sum_j b_j K_ij = 0                 joints
    bc(y_0, y_N, p) = 0                                    conditions

Linearized, each interval's stages are eliminated on their own; what remains is a chain of nodes.
Arrays keep the intervals last: y [n, N+1], K [s, n, N].
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.numerics.bvp.chain import ChainEnds, ChainFactor, ChainLinks, factor_chain, solve_chain
from beltjax.numerics.bvp.gauss import Gauss, gauss
from beltjax.numerics.small_matrices import inverse, matmul, matvec, mix

Mesh = Float[Array, " N+1"]  # node positions as fractions of the interval, from 0 to 1


class Interval(NamedTuple):
    """[a, b]."""

    a: Float[Array, ""]
    b: Float[Array, ""]

    @property
    def length(self) -> Float[Array, ""]:
        """The difference of the ends."""
        return self.b - self.a


class Problem(eqx.Module):
    """y' = rhs(x, y, p, args) + S y/(x - a) on [a, b], with bc(y(a), y(b), p, args) = 0."""

    rhs: Callable
    bc: Callable
    interval: Interval
    args: Any
    singular: Float[Array, "n n"] | None

    def slope(
        self, x: Float[Array, ""], y: Float[Array, " n"], p: Float[Array, " k"]
    ) -> Float[Array, " n"]:
        """dy/dx at one point, which is never x = a itself."""
        dy = self.rhs(x, y, p, self.args)
        return dy if self.singular is None else dy + self.singular @ y / (x - self.interval.a)


class Unknowns(NamedTuple):
    """The unknowns of the equations, or a change of them."""

    y: Float[Array, "n N+1"]
    K: Float[Array, "s n N"]
    p: Float[Array, " k"]


class Residual(NamedTuple):
    """The residuals of the equations."""

    stages: Float[Array, "s n N"]
    joints: Float[Array, "n N"]
    conditions: Float[Array, " n+k"]


class Factor(NamedTuple):
    """A factored linearization; solving with it is one pass along the mesh."""

    inner: Float[Array, "sn sn N"]  # inverse of the stage equations
    response: Float[Array, "sn n+k N"]  # of the stages to (y_i, p)
    steps: Float[Array, " N"]
    chain: ChainFactor
    mean: Float[Array, "n n N"]  # h df/dy over each interval
    ends: ChainEnds


class Local(NamedTuple):
    """Values of `rhs` and `bc` at the unknowns, and their derivatives there."""

    slopes: Float[Array, "s n N"]
    jacobian: Float[Array, "s n n+k N"]  # of the slopes, by (y, p)
    conditions: Float[Array, " n+k"]
    ends: ChainEnds


def interval_lengths(interval: Interval, mesh: Mesh) -> Float[Array, " N"]:
    """h_i, in units of x."""
    return interval.length * jnp.diff(mesh)


def stage_points(interval: Interval, scheme: Gauss, mesh: Mesh) -> Float[Array, "s N"]:
    """x_ij."""
    fractions = mesh[:-1] + scheme.points[:, None] * jnp.diff(mesh)
    return interval.a + interval.length * fractions


def stage_values(interval: Interval, mesh: Mesh, z: Unknowns) -> Float[Array, "s n N"]:
    """Values y at the stages; linear in the unknowns."""
    scheme = gauss(z.K.shape[0])
    return z.y[:, :-1] + interval_lengths(interval, mesh) * mix(scheme.inner, z.K)


def _assembled(
    interval: Interval, mesh: Mesh, z: Unknowns, slopes: Array, conditions: Array
) -> Residual:
    h = interval_lengths(interval, mesh)
    joints = z.y[:, 1:] - z.y[:, :-1] - h * mix(gauss(z.K.shape[0]).weights, z.K)
    return Residual(slopes - z.K, joints, conditions)


def _at_stages(function: Callable, interval: Interval, mesh: Mesh, z: Unknowns) -> Any:
    points = stage_points(interval, gauss(z.K.shape[0]), mesh)
    lanes = jax.vmap(function, in_axes=(0, 1), out_axes=-1)
    return jax.vmap(lanes)(points, stage_values(interval, mesh, z))


def residual(problem: Problem, mesh: Mesh, z: Unknowns) -> Residual:
    """The residuals of the collocation equations."""
    slopes = _at_stages(lambda x, y: problem.slope(x, y, z.p), problem.interval, mesh, z)
    conditions = problem.bc(z.y[:, 0], z.y[:, -1], z.p, problem.args)
    return _assembled(problem.interval, mesh, z, slopes, conditions)


def evaluated(problem: Problem, mesh: Mesh, z: Unknowns) -> Local:
    """All that a step of Newton's method needs to know of `problem`."""
    n = z.y.shape[0]

    def both(x: Array, y: Array) -> Any:
        def slope(yp: Array) -> tuple[Array, Array]:
            value = problem.slope(x, yp[:n], yp[n:])
            return value, value

        return jax.jacfwd(slope, has_aux=True)(jnp.concatenate([y, z.p]))

    def conditions(ya: Array, yb: Array, p: Array) -> tuple[Array, Array]:
        value = problem.bc(ya, yb, p, problem.args)
        return value, value

    jacobian, slopes = _at_stages(both, problem.interval, mesh, z)
    ends, value = jax.jacfwd(conditions, (0, 1, 2), has_aux=True)(z.y[:, 0], z.y[:, -1], z.p)
    return Local(slopes, jacobian, value, ChainEnds(*ends))


def factored(interval: Interval, mesh: Mesh, z: Unknowns, local: Local) -> tuple[Residual, Factor]:
    """The residual and the factored linearization at `z`, where `local` was evaluated."""
    s, n, N = z.K.shape
    scheme, k, J = gauss(s), z.p.shape[0], local.jacobian
    h = interval_lengths(interval, mesh)
    coupled = h * scheme.inner[:, None, :, None, None] * J[:, :, None, :n]
    unit = jnp.eye(s * n).reshape(s, n, s, n, 1)
    inner = inverse((unit - coupled).reshape(s * n, s * n, N))
    response = matmul(inner, J.reshape(s * n, n + k, N))
    carried = h * mix(scheme.weights, response.reshape(s, n, n + k, N))
    one = jnp.broadcast_to(jnp.eye(n)[..., None], (n, n, N))
    links = ChainLinks(-one - carried[:, :n], one, -carried[:, n:])
    mean = h * mix(scheme.weights, J[:, :, :n])
    chain = factor_chain(links, local.ends)
    left = _assembled(interval, mesh, z, local.slopes, local.conditions)
    return left, Factor(inner, response, h, chain, mean, local.ends)


def solve_factored(factor: Factor, right: Residual) -> Unknowns:
    """The change of the unknowns that changes the residual by `right`. Linear in `right`."""
    s, n, N = right.stages.shape
    weights = gauss(s).weights
    forced = matvec(factor.inner, right.stages.reshape(s * n, N))
    g = right.joints - factor.steps * mix(weights, forced.reshape(s, n, N))
    y, p = solve_chain(factor.chain, g, right.conditions)
    both = jnp.concatenate([y[:, :-1], jnp.broadcast_to(p[:, None], (len(p), N))])
    K = matvec(factor.response, both) - forced
    return Unknowns(y, K.reshape(s, n, N), p)


def interpolate(
    interval: Interval, mesh: Mesh, z: Unknowns, x: Float[Array, " m"]
) -> tuple[Float[Array, "n m"], Float[Array, "n m"]]:
    """The piecewise polynomial and its derivative, at fractions `x` of the interval."""
    N, scheme = mesh.shape[0] - 1, gauss(z.K.shape[0])
    i = jnp.clip(jnp.searchsorted(mesh, x, side="right") - 1, 0, N - 1)
    width = mesh[i + 1] - mesh[i]
    t = (x - mesh[i]) / width
    powers = t ** jnp.arange(scheme.stages)[:, None]  # [s, m]
    K = z.K[:, :, i]  # [s, n, m]
    lagrange = jnp.tensordot(jnp.asarray(scheme.slope), powers, 1)
    degree = jnp.arange(1, scheme.stages + 1)
    B = jnp.tensordot(jnp.asarray(scheme.slope) / degree, powers * t, 1)
    h = interval.length * width
    return z.y[:, i] + h * jnp.sum(B[:, None] * K, axis=0), jnp.sum(lagrange[:, None] * K, axis=0)


def remesh(interval: Interval, old: Mesh, z: Unknowns, new: Mesh, to: Gauss) -> Unknowns:
    """The same function on another mesh, by its slopes at the points of the formula `to`."""
    n, s, N = z.y.shape[0], to.stages, new.shape[0] - 1
    fractions = new[:-1] + to.points[:, None] * jnp.diff(new)
    # Both at once: what finds a point's interval is compiled once.
    y, slopes = interpolate(interval, old, z, jnp.concatenate([new, fractions.reshape(-1)]))
    K = slopes[:, N + 1 :].reshape(n, s, N)
    return Unknowns(y[:, : N + 1], jnp.moveaxis(K, 0, 1), z.p)
