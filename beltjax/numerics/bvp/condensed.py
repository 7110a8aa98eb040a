"""Newton's step for three-stage Gauss collocation whose conditions have several right sides.

The same equations as `collocation.factored` and `solve_factored`, in about a third of the time: a
step and the responses to changes of the conditions need no inverse of the stages' equations, which
are eliminated stage by stage. There is no search for pivots within an interval; where one is small
the step loses digits, and the next step makes up for them.

With u_i = sum_j A_ij K_j the stages' equations are

    sum_j (A^-1)_ij u_j - h J_i u_i = J_i y + E_i p + r_i

so that only the diagonal blocks differ between intervals.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from beltjax.numerics.bvp.chain import ChainLinks, factor_chain, solve_chain
from beltjax.numerics.bvp.collocation import (
    Interval,
    Local,
    Mesh,
    Residual,
    Unknowns,
    interval_lengths,
)
from beltjax.numerics.bvp.gauss import gauss
from beltjax.numerics.small_matrices import Blocks, matmul, mix

STAGES = 3


def inverse_of_three(a: Blocks) -> Blocks:
    """The inverse of 3 by 3 blocks, by cofactors."""
    rows = [jnp.cross(a[(i + 1) % 3], a[(i + 2) % 3], axis=0) for i in range(3)]
    determinant = jnp.sum(a[0] * rows[0], axis=0)
    return jnp.stack(rows, axis=1) / determinant


def stage_solutions(
    J: Float[Array, "3 3 3 N"], right: Float[Array, "3 3 m N"], h: Float[Array, " N"]
) -> Float[Array, "3 3 m N"]:
    """The K that solve K_i - h J_i sum_j A_ij K_j = `right`_i, column by column."""
    b = np.linalg.inv(gauss(STAGES).inner)
    unit = jnp.eye(3)[:, :, None]
    first, second, third = (b[i, i] * unit - h * J[i] for i in range(3))
    x1 = inverse_of_three(first)
    second = second - (b[1, 0] * b[0, 1]) * x1
    third = third - (b[2, 0] * b[0, 2]) * x1
    beside = b[1, 2] * unit - (b[1, 0] * b[0, 2]) * x1
    below = b[2, 1] * unit - (b[2, 0] * b[0, 1]) * x1
    x2 = inverse_of_three(second)
    lower = matmul(below, x2)
    x3 = inverse_of_three(third - matmul(lower, beside))
    r1 = matmul(x1, right[0])
    r2 = right[1] - b[1, 0] * r1
    u3 = matmul(x3, right[2] - b[2, 0] * r1 - matmul(lower, r2))
    u2 = matmul(x2, r2 - matmul(beside, u3))
    u1 = r1 - matmul(x1, b[0, 1] * u2 + b[0, 2] * u3)
    return mix(b, jnp.stack([u1, u2, u3]))


def step_and_responses(
    interval: Interval,
    mesh: Mesh,
    z: Unknowns,
    local: Local,
    left: Residual,
    conditions: Float[Array, "c m"],
) -> tuple[Unknowns, Unknowns]:
    """The change that changes the residual by `left`, and those for changes of the conditions.

    The second has a leading axis, one change for each row of `conditions`. Of three unknowns.
    """
    n, k = z.y.shape[0], z.p.shape[0]
    h, weights = interval_lengths(interval, mesh), gauss(STAGES).weights
    # Minus the residual of the stages goes along as one more column.
    right = jnp.concatenate([local.jacobian, -left.stages[:, :, None]], axis=2)
    response = stage_solutions(local.jacobian[:, :, :n], right, h)
    carried = h * mix(weights, response)
    one = jnp.broadcast_to(jnp.eye(n)[..., None], (n, n, len(h)))
    links = ChainLinks(-one - carried[:, :n], one, -carried[:, n : n + k])
    chain = factor_chain(links, local.ends)

    def solved(g: Array, right: Array, forced: Array) -> Unknowns:
        y, p = solve_chain(chain, g, right)
        both = jnp.concatenate([y[:, :-1], jnp.broadcast_to(p[:, None], (k, len(h)))])
        return Unknowns(y, jnp.sum(response[:, :, : n + k] * both, axis=2) + forced, p)

    own, of_step = response[:, :, n + k], left.joints + carried[:, n + k]
    none, nothing = jnp.zeros_like(of_step), jnp.zeros_like(own)
    count = len(conditions)
    sources = jnp.concatenate([of_step[None], jnp.broadcast_to(none, (count, *none.shape))])
    rows = jnp.concatenate([left.conditions[None], conditions])
    forced = jnp.concatenate([own[None], jnp.broadcast_to(nothing, (count, *nothing.shape))])
    every = jax.vmap(solved)(sources, rows, forced)
    step, others = (jax.tree.map(lambda x, of=of: x[of], every) for of in (0, slice(1, None)))
    return step, others
