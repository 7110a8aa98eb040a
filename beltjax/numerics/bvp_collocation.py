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

from beltjax.numerics.bvp_blocks import inverse, matmul, matvec, mix
from beltjax.numerics.bvp_chain import ChainFactor, Ends, Links, factor_chain, solve_chain
from beltjax.numerics.bvp_gauss import Gauss

Mesh = Float[Array, " N+1"]  # node positions as fractions of the interval, from 0 to 1


class Problem(eqx.Module):
    """y' = rhs(x, y, p, args) + S y/(x - a) on [a, b], with bc(y(a), y(b), p, args) = 0."""

    rhs: Callable
    bc: Callable
    a: Float[Array, ""]
    b: Float[Array, ""]
    args: Any
    singular: Float[Array, "n n"] | None

    def slope(self, x: Float[Array, ""], y: Float[Array, " n"], p: Float[Array, " k"]):
        """dy/dx at one point, which is never x = a itself."""
        dy = self.rhs(x, y, p, self.args)
        return dy if self.singular is None else dy + self.singular @ y / (x - self.a)


class Unknowns(NamedTuple):
    """What is solved for; also a change of it."""

    y: Float[Array, "n N+1"]
    K: Float[Array, "s n N"]
    p: Float[Array, " k"]


class Residual(NamedTuple):
    """What is left of the equations."""

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
    ends: Ends


def interval_lengths(problem: Problem, mesh: Mesh) -> Float[Array, " N"]:
    """h_i, in units of x."""
    return (problem.b - problem.a) * jnp.diff(mesh)


def stage_points(problem: Problem, scheme: Gauss, mesh: Mesh) -> Float[Array, "s N"]:
    """x_ij."""
    fractions = mesh[:-1] + scheme.points[:, None] * jnp.diff(mesh)
    return problem.a + (problem.b - problem.a) * fractions


def stage_values(problem: Problem, scheme: Gauss, mesh: Mesh, z: Unknowns) -> Float[Array, "s n N"]:
    """Values y at the stages; linear in the unknowns."""
    return z.y[:, :-1] + interval_lengths(problem, mesh) * mix(scheme.inner, z.K)


def _assemble(problem, scheme, mesh, z, slopes) -> Residual:
    h = interval_lengths(problem, mesh)
    joints = z.y[:, 1:] - z.y[:, :-1] - h * mix(scheme.weights, z.K)
    conditions = problem.bc(z.y[:, 0], z.y[:, -1], z.p, problem.args)
    return Residual(slopes - z.K, joints, conditions)


def residual(problem: Problem, scheme: Gauss, mesh: Mesh, z: Unknowns) -> Residual:
    """What is left of the collocation equations."""
    slopes = _everywhere(lambda x, y: problem.slope(x, y, z.p))(
        stage_points(problem, scheme, mesh), stage_values(problem, scheme, mesh, z)
    )
    return _assemble(problem, scheme, mesh, z, slopes)


def factored(problem: Problem, scheme: Gauss, mesh: Mesh, z: Unknowns) -> tuple[Residual, Factor]:
    """The residual and the factored linearization at `z`."""
    n, k = z.y.shape[0], z.p.shape[0]

    def both(x, y):
        def slope(yp):
            value = problem.slope(x, yp[:n], yp[n:])
            return value, value

        return jax.jacfwd(slope, has_aux=True)(jnp.concatenate([y, z.p]))

    J, slopes = _everywhere(both)(
        stage_points(problem, scheme, mesh), stage_values(problem, scheme, mesh, z)
    )  # J [s, n, n+k, N]
    h = interval_lengths(problem, mesh)
    s, N = scheme.stages, len(h)
    coupled = h * scheme.inner[:, None, :, None, None] * J[:, :, None, :n]
    unit = jnp.eye(s * n).reshape(s, n, s, n, 1)
    inner = inverse((unit - coupled).reshape(s * n, s * n, N))
    response = matmul(inner, J.reshape(s * n, n + k, N))
    carried = h * mix(scheme.weights, response.reshape(s, n, n + k, N))
    one = jnp.broadcast_to(jnp.eye(n)[..., None], (n, n, N))
    links = Links(-one - carried[:, :n], one, -carried[:, n:])
    ends = Ends(*jax.jacfwd(problem.bc, (0, 1, 2))(z.y[:, 0], z.y[:, -1], z.p, problem.args))
    mean = h * mix(scheme.weights, J[:, :, :n])
    factor = Factor(inner, response, h, factor_chain(links, ends), mean, ends)
    return _assemble(problem, scheme, mesh, z, slopes), factor


def solve_factored(factor: Factor, scheme: Gauss, right: Residual) -> Unknowns:
    """The change of the unknowns that changes the residual by `right`. Linear in `right`."""
    s, n, N = right.stages.shape
    forced = matvec(factor.inner, right.stages.reshape(s * n, N))
    g = right.joints - factor.steps * mix(scheme.weights, forced.reshape(s, n, N))
    y, p = solve_chain(factor.chain, g, right.conditions)
    both = jnp.concatenate([y[:, :-1], jnp.broadcast_to(p[:, None], (len(p), N))])
    K = matvec(factor.response, both) - forced
    return Unknowns(y, K.reshape(s, n, N), p)


def interpolate(
    length: Float[Array, ""], scheme: Gauss, mesh: Mesh, z: Unknowns, x: Float[Array, " m"]
) -> tuple[Float[Array, "n m"], Float[Array, "n m"]]:
    """The piecewise polynomial and its derivative, at fractions `x` of an interval of `length`."""
    N = mesh.shape[0] - 1
    i = jnp.clip(jnp.searchsorted(mesh, x, side="right") - 1, 0, N - 1)
    width = mesh[i + 1] - mesh[i]
    t = (x - mesh[i]) / width
    powers = t ** jnp.arange(scheme.stages)[:, None]  # [s, m]
    K = z.K[:, :, i]  # [s, n, m]
    lagrange = jnp.tensordot(jnp.asarray(scheme.slope), powers, 1)
    degree = jnp.arange(1, scheme.stages + 1)
    B = jnp.tensordot(jnp.asarray(scheme.slope) / degree, powers * t, 1)
    h = length * width
    return z.y[:, i] + h * jnp.sum(B[:, None] * K, axis=0), jnp.sum(lagrange[:, None] * K, axis=0)


def remesh(
    problem: Problem, scheme: Gauss, old: Mesh, z: Unknowns, new: Mesh, to: Gauss
) -> Unknowns:
    """The same function on another mesh, by its slopes at the points of the formula `to`."""
    y, _ = interpolate(problem.b - problem.a, scheme, old, z, new)
    fractions = new[:-1] + to.points[:, None] * jnp.diff(new)
    _, K = interpolate(problem.b - problem.a, scheme, old, z, fractions.reshape(-1))
    n, s = z.y.shape[0], to.stages
    return Unknowns(y, jnp.moveaxis(K.reshape(n, s, -1), 0, 1), z.p)


def _everywhere(function):
    lanes = jax.vmap(function, in_axes=(0, 1), out_axes=-1)
    return jax.vmap(lanes)
