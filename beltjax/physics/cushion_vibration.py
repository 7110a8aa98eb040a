"""Vibration of a string that rides on cushions, about a steady state without torque.

The loop is cut into arcs and free spans, on which the cords move by U along the travel and by y to
its left; rotations theta count along the travel, coordinates q move pulleys by d. With ' = d/ds,
E = EA - m c^2 and the cords' own curvature kappa, the Lagrangian of second order is

    m/2 (U_t^2 + y_t^2) + m c [U_t (U' - 2 kappa y) + y_t y'] - E/2 (U' - kappa y)^2 - P/2 y'^2
    - k_r/2 (y - d_n)^2 - k_s/2 (U - R theta - d_t)^2 + P/2 kappa^2 d_t^2

Galerkin's functions are polynomials on elements that are graded into the layers, continuous round
the loop. docs/theory/cushion.md, (U9) to (U12).
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.polynomial import legendre

from beltjax.numerics.gyroscopic import Forms
from beltjax.physics.vibration import Matrices

Scalar = Float[Array, ""]
Pulleys = Float[Array, " n"]
Size = Float[Array, "size size"]

BOLTED = 1e8  # stiffness beside unit mass of a coordinate that does not move
STIFF = 1e12  # k R^2/P of cords that lie on their pulley itself
_LAYERS = 3.0  # thicknesses of an end layer that its element covers at least


class Vibrating(NamedTuple):
    """The drive in one steady state; pulley i is followed by span i."""

    P: Scalar
    m: Scalar
    c: Scalar
    EA: Scalar
    k_r: Pulleys
    k_s: Pulleys
    R: Pulleys
    side: Pulleys  # +1 where the pulley turns the belt left
    arcs: Pulleys  # lengths of the cords in contact
    spans: Pulleys  # lengths of the free spans
    lam: Pulleys  # 1/lam is the radial layers' thickness
    start: Pulleys  # direction of the belt where it meets the pulley
    soft: Pulleys  # 1 with a cushion
    J: Pulleys  # inertia of the pulleys
    turning: Pulleys  # 0 where the rotation is held
    by_x: Float[Array, "n coordinates"]  # motion of the pulleys by the coordinates
    by_y: Float[Array, "n coordinates"]
    M_q: Float[Array, "coordinates coordinates"]
    K_q: Float[Array, "coordinates coordinates"]
    movable: Float[Array, " coordinates"]


class Mesh(NamedTuple):
    """Sizes of a discretization; static."""

    elements: int  # on each arc
    degree: int  # on these elements
    span_degree: int  # on each free span


class _Parts(NamedTuple):
    """Matrices of elements, and the places of their unknowns."""

    mass: Float[Array, "elements k k"]
    transport: Float[Array, "elements k k"]
    stiffness: Float[Array, "elements k k"]
    places: Int[np.ndarray, "elements k"]


@functools.cache
def _functions(degree: int, points: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points, weights, values and slopes on [-1, 1]: both hats, then integrated Legendre."""
    x, w = legendre.leggauss(points)
    rows, slopes = [(1 - x) / 2, (1 + x) / 2], [-0.5 + 0 * x, 0.5 + 0 * x]
    for k in range(2, degree + 1):
        high, low = np.eye(k + 1)[k], np.eye(k + 1)[k - 2]
        scale = 1 / np.sqrt(4 * k - 2)
        rows.append(scale * legendre.legval(x, high - low))
        slopes.append(scale * legendre.legval(x, legendre.legder(high - low)))
    return x, w, np.array(rows).T, np.array(slopes).T


@functools.cache
def numbering(n: int, coordinates: int, mesh: Mesh) -> tuple[np.ndarray, np.ndarray, int]:
    """Places of the unknowns of arcs' and spans' elements, and how many there are."""
    nodes, inner, whole = mesh.elements + 1, mesh.degree - 1, mesh.span_degree - 1
    field = n * (nodes + mesh.elements * inner + whole)
    rigid = 2 * field
    arcs = np.zeros((n, mesh.elements, 2 * (mesh.degree + 1) + 1 + coordinates), int)
    spans = np.zeros((n, 2 * (mesh.span_degree + 1)), int)
    bubbles = n * nodes
    for i in range(n):
        for e in range(mesh.elements):
            first = bubbles + (i * mesh.elements + e) * inner
            own = [i * nodes + e, i * nodes + e + 1, *range(first, first + inner)]
            moved = [rigid + i, *range(rigid + n, rigid + n + coordinates)]
            arcs[i, e] = [*own, *(field + place for place in own), *moved]
        first = bubbles + n * mesh.elements * inner + i * whole
        own = [i * nodes + nodes - 1, (i + 1) % n * nodes, *range(first, first + whole)]
        spans[i] = [*own, *(field + place for place in own)]
    return arcs, spans, rigid + n + coordinates


def own_curvature(s: Array, of: Vibrating) -> Array:
    """Curvature of the cords at s [n, ...] of the arcs (U11)."""
    shape = (-1, *(1,) * (s.ndim - 1))
    R, lam, S, side, soft = (
        jnp.reshape(x, shape) for x in (of.R, of.lam, of.arcs, of.side, of.soft)
    )
    give = soft / (R * lam) ** 2
    layers = (jnp.exp(-lam * s) + jnp.exp(-lam * (S - s))) / (1 + jnp.exp(-lam * S))
    return side / (R * (1 - give)) * (1 - soft * layers)


def _own_turn(s: Array, of: Vibrating) -> Array:
    """Integral of `own_curvature` from 0 to s."""
    shape = (-1, *(1,) * (s.ndim - 1))
    R, lam, S, side, soft = (
        jnp.reshape(x, shape) for x in (of.R, of.lam, of.arcs, of.side, of.soft)
    )
    give = soft / (R * lam) ** 2
    whole = 1 + jnp.exp(-lam * S)
    first = -jnp.expm1(-lam * s) + jnp.exp(-lam * (S - s)) - jnp.exp(-lam * S)
    return side / (R * (1 - give)) * (s - soft * first / (lam * whole))


def _edges(of: Vibrating, elements: int) -> Float[Array, "n elements+1"]:
    """Where the arcs' elements end: small ones cover the layers at both ends."""
    shear = jnp.sqrt((of.EA - of.m * of.c**2) / of.k_s)
    layer = jax.lax.stop_gradient(jnp.minimum(1 / of.lam, shear) / of.arcs)
    outer = jnp.clip(jnp.where(of.soft > 0, _LAYERS * layer, 1.0), 1e-4, 1 / elements)
    # A power of the distance from the nearer end, of which the first element leaves `outer`.
    power = (jnp.log(2 * outer) / np.log(2 / elements))[:, None]
    t = jnp.linspace(-1.0, 1.0, elements + 1)
    near = 0.5 * (1 - jnp.abs(t)) ** power
    return jnp.where(t < 0, near, 1 - near) * of.arcs[:, None]


def _on_arcs(of: Vibrating, mesh: Mesh) -> _Parts:
    """Matrices of the arcs' elements, for U, y, the pulley's rotation and the coordinates."""
    n, m = of.by_x.shape
    x, w, N, D = _functions(mesh.degree, mesh.degree + 4)
    edges = _edges(of, mesh.elements)
    h = jnp.diff(edges, axis=1)[..., None]  # [n, elements, 1]
    s = edges[:, :-1, None] + h * (1 + x) / 2
    weights = w * h / 2
    kappa = own_curvature(s, of)
    phi = of.start[:, None, None] + _own_turn(s, of)
    size = mesh.degree + 1
    full = (*s.shape, 2 * size + 1 + m)

    def row(start: int, values: Array) -> Array:
        """Factors of unknowns at every point; those from `start` on have these values."""
        return jnp.zeros(full).at[..., start : start + values.shape[-1]].set(values)

    slope = jnp.asarray(D) * (2 / h)[..., None]
    here = jnp.broadcast_to(N, (*s.shape, size))
    along, across = row(0, here), row(size, here)
    along_slope, across_slope = row(0, slope), row(size, slope)
    turning = row(
        2 * size, jnp.broadcast_to((of.R * of.turning)[:, None, None, None], (*s.shape, 1))
    )
    cos, sin = jnp.cos(phi)[..., None], jnp.sin(phi)[..., None]
    x_by, y_by = (part[:, None, None] * of.movable for part in (of.by_x, of.by_y))
    tangential = row(2 * size + 1, cos * x_by + sin * y_by)
    normal = row(2 * size + 1, cos * y_by - sin * x_by)
    stretch = along_slope - kappa[..., None] * across
    sheared = along - turning - tangential

    def form(weight: Array, a: Array, b: Array) -> Array:
        return jnp.einsum("neg,nega,negb->neab", weight, a, b)

    E, drag = of.EA - of.m * of.c**2, of.m * of.c
    k_r, k_s = (jnp.where(of.soft > 0, k, STIFF * of.P / of.R**2) for k in (of.k_r, of.k_s))
    stiffness = (
        form(E * weights, stretch, stretch)
        + form(of.P * weights, across_slope, across_slope)
        + form(k_r[:, None, None] * weights, across - normal, across - normal)
        + form(k_s[:, None, None] * weights, sheared, sheared)
        - form(of.P * kappa**2 * weights, tangential, tangential)
    )
    bent = along_slope - 2 * kappa[..., None] * across
    transport = form(drag * weights, along, bent) + form(drag * weights, across, across_slope)
    mass = form(of.m * weights, along, along) + form(of.m * weights, across, across)
    places = numbering(n, m, mesh)[0]
    k = places.shape[-1]
    mass, transport, stiffness = (x.reshape(-1, k, k) for x in (mass, transport, stiffness))
    return _Parts(mass, transport, stiffness, places.reshape(-1, k))


def _on_spans(of: Vibrating, mesh: Mesh) -> _Parts:
    """Matrices of the free spans, for U and y."""
    n, m = of.by_x.shape
    _, w, N, D = _functions(mesh.span_degree, mesh.span_degree + 2)
    values, mixed, slopes = ((a.T * w) @ b for a, b in ((N, N), (N, D), (D, D)))
    half = of.spans[:, None, None] / 2
    zero = jnp.zeros((n, *values.shape))

    def both(along: Array, across: Array) -> Array:
        return jnp.block([[along, zero], [zero, across]])

    inertia = of.m * half * values
    drag = jnp.broadcast_to(of.m * of.c * mixed, zero.shape)
    E = of.EA - of.m * of.c**2
    stiffness = both(E * slopes / half, of.P * slopes / half)
    places = numbering(n, m, mesh)[1]
    return _Parts(both(inertia, inertia), both(drag, drag), stiffness, places)


def _rigid(of: Vibrating) -> tuple[Array, Array]:
    """Inertia and stiffness of rotations and coordinates; those that are held stand apart."""
    n, m = of.by_x.shape
    free = of.movable[:, None] * of.movable
    held = jnp.diag(1 - of.movable)
    unit = of.P * jnp.mean(of.R)
    mass = jnp.zeros((n + m, n + m)).at[:n, :n].set(jnp.diag(of.J * of.turning + 1 - of.turning))
    mass = mass.at[n:, n:].set(free * of.M_q + held)
    stiff = jnp.zeros_like(mass).at[:n, :n].set(BOLTED * unit * jnp.diag(1 - of.turning))
    return mass, stiff.at[n:, n:].set(free * of.K_q + BOLTED * unit * held)


def assembled(of: Vibrating, mesh: Mesh) -> Matrices:
    """Mass, gyroscopic and stiffness matrices."""
    n, m = of.by_x.shape
    size = numbering(n, m, mesh)[2]
    parts = [_on_arcs(of, mesh), _on_spans(of, mesh)]

    def gathered(kind: str) -> Size:
        whole = jnp.zeros((size, size))
        for part in parts:
            rows, columns = part.places[:, :, None], part.places[:, None, :]
            whole = whole.at[rows, columns].add(getattr(part, kind))
        return whole

    transport = gathered("transport")
    first = size - n - m
    mass, stiff = _rigid(of)
    return Matrices(
        gathered("mass").at[first:, first:].add(mass),
        transport - transport.T,
        gathered("stiffness").at[first:, first:].add(stiff),
    )


def forms_of(of: Vibrating, mesh: Mesh, vectors: Array) -> Forms:
    """Forms v* M v, v* G v and v* K v of vectors [count, size], element by element."""
    n, m = of.by_x.shape
    parts = [_on_arcs(of, mesh), _on_spans(of, mesh)]

    def summed(kind: str, skew: bool = False) -> Array:
        total = jnp.zeros(len(vectors), complex)
        for part in parts:
            v, matrix = vectors[:, part.places], getattr(part, kind)
            matrix = matrix - jnp.swapaxes(matrix, 1, 2) if skew else matrix
            total = total + jnp.einsum("cea,eab,ceb->c", jnp.conj(v), matrix, v)
        return total

    rigid = vectors[:, numbering(n, m, mesh)[2] - n - m :]
    mass, stiff = (jnp.einsum("ca,ab,cb->c", jnp.conj(rigid), x, rigid) for x in _rigid(of))
    return Forms(summed("mass") + mass, summed("transport", True), summed("stiffness") + stiff)
