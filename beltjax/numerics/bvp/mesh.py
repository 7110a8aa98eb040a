"""Where the nodes go: equal shares of a smoothed high-derivative monitor, with a floor."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.numerics.bvp.collocation import Interval, Mesh, Unknowns, interval_lengths
from beltjax.numerics.bvp.gauss import gauss

# A node in five is spread evenly, whatever the layers need: what is not yet seen must have
# a chance to be, and smooth parts carry layers' errors away if they are too coarse.
FLOOR = 0.25
SMOOTHING = 3  # passes of (1/4, 1/2, 1/4) over the density of intervals of equal width


def scale_of(y: Float[Array, "n *at"]) -> Float[Array, "n 1"]:
    """1 + max |y_j|: what errors and steps of each component are measured in."""
    return 1.0 + jnp.max(jnp.abs(y), axis=tuple(range(1, y.ndim)))[:, None]


def monitor(interval: Interval, mesh: Mesh, z: Unknowns) -> Float[Array, " N"]:
    """Node density that makes the polynomials' errors equal: |u^(s+1)|^(1/(s+1)), an interval.

    u^(s) is constant on an interval; its jumps give u^(s+1) (de Boor, 1973).
    """
    h = interval_lengths(interval, mesh)
    s = z.K.shape[0]
    top = jnp.tensordot(jnp.asarray(gauss(s).top), z.K, 1) / h ** (s - 1)  # [n, N]
    jump = jnp.diff(top, axis=1) / (0.5 * (h[1:] + h[:-1]))
    jump = jnp.abs(jump) / scale_of(z.y)
    jump = jnp.concatenate([jump[:, :1], jump, jump[:, -1:]], axis=1)
    density = jnp.max(jnp.maximum(jump[:, 1:], jump[:, :-1]), axis=0) ** (1.0 / (s + 1))
    return jnp.where(jnp.isfinite(density), density, 0.0)


def smoothed(density: Float[Array, " N"], widths: Float[Array, " N"]) -> Float[Array, " N"]:
    """The density averaged over neighbors, over a floor that is a share of its mean.

    A neighbor's density reaches as far as the neighbor is wide: else a layer's density, averaged
    into the wide interval beside it, would draw the layer's own nodes out there.
    """

    def beside(x: Array) -> tuple[Array, Array]:
        padded = jnp.concatenate([x[:1], x, x[-1:]])
        return padded[:-2], padded[2:]

    shares = [0.25 * jnp.minimum(1.0, width / widths) for width in beside(widths)]
    for _ in range(SMOOTHING):
        pairs = zip(shares, beside(density), strict=True)
        density = density + sum(share * (other - density) for share, other in pairs)
    mean = jnp.sum(density * widths)
    floor = jnp.where(mean > 0, FLOOR * mean, 1.0)
    return density + floor


def equidistribute(mesh: Mesh, density: Float[Array, " N"]) -> Mesh:
    """Nodes between which the piecewise constant density has equal integrals."""
    shares = jnp.concatenate([jnp.zeros(1), jnp.cumsum(density * jnp.diff(mesh))])
    wanted = jnp.linspace(0.0, 1.0, mesh.shape[0]) * shares[-1]
    moved = jnp.interp(wanted, shares, mesh)
    return moved.at[0].set(0.0).at[-1].set(1.0)


def moved_mesh(interval: Interval, mesh: Mesh, z: Unknowns) -> Mesh:
    """The next mesh, of as many nodes."""
    density = smoothed(monitor(interval, mesh, z), jnp.diff(mesh))
    return equidistribute(mesh, density)
