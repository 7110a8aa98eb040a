"""How far a solution of the collocation equations may be from one of the differential equation.

Both the error and the condition are found on the solution's mesh with every interval cut in two.
Where an interval resolves the fastest modes they are its halves. Where it does not, one piece is
short enough that it does. On the whole interval a Gauss formula neither amplifies nor damps such
a mode; the short pieces together amplify it beyond all bounds, as the equation does. So a mesh
that misses a layer is seen to be ill conditioned if the problem is, however well conditioned and
however consistent its own equations are.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from beltjax.numerics.bvp.chain import ChainEnds
from beltjax.numerics.bvp.collocation import (
    Interval,
    Local,
    Mesh,
    Residual,
    Unknowns,
    factored,
    remesh,
    solve_factored,
    stage_values,
)
from beltjax.numerics.bvp.gauss import gauss
from beltjax.numerics.bvp.mesh import scale_of
from beltjax.numerics.small_matrices import matmul

ROUNDING = 2.0**-53  # relative, of one operation
SINGULAR = 1e12  # condition beyond which rounding leaves nothing to judge by, for any tolerance
RESOLVED = 6.0  # |h lambda| that a formula of three stages or more follows closely
SHORTEST = 1e-8  # piece of an interval: a shorter one would coincide with its end
PROBES = 2
SQUARINGS = 4


class Estimate(NamedTuple):
    """An estimate of a solution's distance from the truth."""

    error: Float[Array, ""]
    defect: Float[Array, ""]
    condition: Float[Array, ""]


def fastest(mean: Float[Array, "n n N"]) -> Float[Array, " N"]:
    """About the largest |eigenvalue| of each block, from its 16th power; units do not matter."""
    log = jnp.zeros(mean.shape[2])
    power = mean
    for doubling in range(SQUARINGS + 1):
        norm = jnp.max(jnp.sum(jnp.abs(power), axis=1), axis=0)
        norm = jnp.where(norm > 0, norm, 1.0)
        log = log + jnp.log(norm) / 2**doubling
        power = matmul(power / norm, power / norm)
    return jnp.exp(log)


def cut_mesh(mesh: Mesh, mean: Float[Array, "n n N"]) -> Mesh:
    """Every interval in two: halves, or a first piece that resolves its fastest modes."""
    share = RESOLVED / jnp.maximum(fastest(mean), RESOLVED)
    share = jnp.where(jnp.isfinite(share), jnp.clip(share, SHORTEST, 0.5), 0.5)
    between = mesh[:-1] + share * jnp.diff(mesh)
    pairs = jnp.stack([mesh[:-1], between], axis=1).reshape(-1)
    return jnp.concatenate([pairs, mesh[-1:]])


def finer(
    interval: Interval, mesh: Mesh, z: Unknowns, mean: Float[Array, "n n N"]
) -> tuple[Mesh, Unknowns]:
    """`z` on the cut mesh, with a stage more: where `estimate` wants the equations evaluated."""
    cut = cut_mesh(mesh, mean)
    return cut, remesh(interval, mesh, z, cut, gauss(z.K.shape[0] + 1))


def estimate(interval: Interval, z: Unknowns, cut: Mesh, moved: Unknowns, local: Local) -> Estimate:
    """Error, defect and condition of a solution `z`, which is `moved` on the finer mesh `cut`.

    The error is the distance from the solution with a stage more on the cut mesh, by one Newton
    step, at nodes and collocation points: relative to 1 + max |y_j| and to 1 + |p_j|, and never
    below what rounding makes of the condition. Where the mesh resolves the solution this is the
    error itself; where it does not the two formulas differ widely, because their responses to
    what they do not resolve have opposite signs.

    The condition is the largest response to jumps of y at every node and changes of the
    conditions, each as large as its terms and of random sign: what rounding does, over
    `ROUNDING`. It is the constant of Ascher, Mattheij and Russell (1995), section 3.2, a bound
    of Green's function, up to the choice of norm.
    """
    left, factor = factored(interval, cut, moved, local)
    size, size_p = scale_of(z.y), 1.0 + jnp.abs(z.p)

    def response(right: Residual) -> Array:
        d = solve_factored(factor, right)
        inside = jnp.max(jnp.abs(stage_values(interval, cut, d)) / size)
        parts = [inside, jnp.max(jnp.abs(d.y) / size)]
        parts.append(jnp.max(jnp.abs(d.p) / size_p, initial=0.0))
        largest = jnp.max(jnp.stack(parts))
        return jnp.where(jnp.isfinite(largest), largest, jnp.inf)

    rights = jax.tree.map(
        lambda a, b: jnp.concatenate([a[None], b]), left, _probes(left, factor.ends, size, size_p)
    )
    error, *found = jax.lax.map(response, rights)
    cond = jnp.max(jnp.stack(found))
    defect = jnp.max(jnp.abs(left.stages) / (1.0 + jnp.abs(moved.K)))
    return Estimate(jnp.maximum(error, ROUNDING * cond), defect, cond)


def _probes(left: Residual, ends: ChainEnds, size: Array, size_p: Array) -> Residual:
    """Changes of the equations, along a leading axis of `PROBES`."""
    random = np.random.default_rng(0)

    def signs(like: Array) -> Array:
        return jnp.asarray(random.choice([-1.0, 1.0], (PROBES, *like.shape)))

    terms = (jnp.abs(ends.A) + jnp.abs(ends.B)) @ size[:, 0] + jnp.abs(ends.P) @ size_p
    none = jnp.zeros((PROBES, *left.stages.shape))
    return Residual(none, size * signs(left.joints), terms * signs(left.conditions))
