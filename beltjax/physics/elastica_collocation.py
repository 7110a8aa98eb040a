"""A bending-stiff span between two pulleys by collocation, in the letters of chapter 5.

The free-boundary problem (5.16)-(5.21) in standard form, contact points and length unknown:

    C    P + EI kappa^2/2, constant along the span; P = T - G V       s  arc length over L
    rho  signed radius, positive for a pulley that turns the belt left  d  distance of the centers

The belt leaves a pulley at (0, 0) and reaches one at (d, 0), with curvature 1/rho and the point
rho (sin theta, -cos theta) from the center at either contact. In sizes of order one

    p = P/C,   k = kappa/kappa_m,   q = kappa'/(lambda kappa_m),   x, y over d
    lambda = sqrt(C/EI),   kappa_m = 1/min |rho|,   e = EI kappa_m^2/C

    p' = -L lambda e k q,   k' = L lambda q,   q' = L lambda p k,   theta' = L kappa_m k
    x' = (L/d) cos theta,   y' = (L/d) sin theta,   and L is an unknown parameter

(5.21) is used as a vector equation: as printed, a circle and a tangency in x, it admits a mirror
root. No closed form of the elastica enters, so that this is an independent check of
`physics.elastica`.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.numerics.bvp.solve import solve_bvp
from beltjax.physics.steady_collocation import layer_mesh
from beltjax.results import RESULTS

Scalar = Float[Array, ""]
State = Float[Array, "6"]  # p, k, q, theta, x/d, y/d

_STAGES = 6  # of a collocation interval: order 7 inside it, 12 at its ends
_POINTS = 64  # intervals of a guess
_STEEPEST = 0.7  # sine of half the angle by which a guess lets a layer turn the belt, at most


class Contact(NamedTuple):
    """The length and the end inclinations that fix where a span touches its pulleys."""

    length: Scalar
    theta_start: Scalar
    theta_end: Scalar


class CollocatedSpan(NamedTuple):
    """A span with an estimate of its error."""

    length: Scalar
    theta_start: Scalar  # inclination where it leaves the first pulley, from center to center
    theta_end: Scalar
    P_mid: Scalar  # at half the arc length
    error: Scalar  # estimated, as `BVPSolution.error`
    result: RESULTS


def tangent_contact(
    C: Scalar, EI: Scalar, rho_start: Scalar, rho_end: Scalar, d: Scalar
) -> Contact:
    """A guess of the contact: the string's tangent, bent at either end as a long span would be."""
    phi = -jnp.arcsin((rho_end - rho_start) / d)
    half = [jnp.sqrt(EI / C) / (2.0 * jnp.abs(rho)) for rho in (rho_start, rho_end)]
    turn_start, turn_end = (2.0 * jnp.arcsin(jnp.minimum(h, _STEEPEST)) for h in half)
    bulge = jnp.abs(rho_start) * jnp.sin(turn_start) + jnp.abs(rho_end) * jnp.sin(turn_end)
    return Contact(
        d * jnp.cos(phi) + bulge,
        phi - jnp.sign(rho_start) * turn_start,
        phi + jnp.sign(rho_end) * turn_end,
    )


def span_by_collocation(
    C: Scalar,
    EI: Scalar,
    rho_start: Scalar,
    rho_end: Scalar,
    d: Scalar,
    guess: Contact | None = None,
    *,
    tol: float = 1e-10,
    nodes: int = 48,
) -> CollocatedSpan:
    """The span for a given C from a pulley at (0, 0) to one at (d, 0).

    Each pulley may turn the belt left or right. The search starts from `guess`, or from the
    string's tangent with its layers. It fails with the results of `solve_bvp`: `mesh_exhausted`
    where `nodes` do not resolve the layers, `newton_failed` far from a solution. A failed span
    holds finite placeholders.
    """
    numbers = tuple(jnp.asarray(x, float) for x in (C, EI, rho_start, rho_end, d))
    C, EI, rho_start, rho_end, d = numbers
    guess = tangent_contact(*numbers) if guess is None else Contact(*map(jnp.asarray, guess))
    kappa_m = 1.0 / jnp.minimum(jnp.abs(rho_start), jnp.abs(rho_end))
    rate, bent = jnp.sqrt(C / EI), EI * kappa_m**2 / C
    ends = jnp.stack([rho_start, rho_end])

    def rhs(_: Scalar, y: State, L: Float[Array, "1"], args: None) -> State:
        p, k, q, theta = y[0], y[1], y[2], y[3]
        layers = L[0] * d * rate
        turned = jnp.stack([kappa_m * d * k, jnp.cos(theta), jnp.sin(theta)])
        bending = jnp.stack([-bent * k * q, q, p * k])
        return jnp.concatenate([layers * bending, L[0] * turned])

    def bc(start: State, end: State, L: Float[Array, "1"], args: None) -> Float[Array, "7"]:
        k = 1.0 / (kappa_m * ends)
        offset_start, offset_end = (
            y[4:6] - rho / d * jnp.stack([jnp.sin(y[3]), -jnp.cos(y[3])])
            for y, rho in ((start, rho_start), (end, rho_end))
        )
        tension = start[0] - 1.0 + bent * k[0] ** 2 / 2.0
        bending = jnp.stack([tension, start[1] - k[0], end[1] - k[1]])
        return jnp.concatenate([bending, offset_start, offset_end - jnp.array([1.0, 0.0])])

    shape = _shape(guess, rate, ends, d)
    found = solve_bvp(
        rhs, bc, (0.0, 1.0), shape, parameters=guess.length[None] / d, tol=tol, nodes=nodes,
        stages=_STAGES, throw=False,
    )  # fmt: skip
    first, last = found.y[3, 0], found.y[3, -1]
    return CollocatedSpan(
        d * found.parameters[0], first, last, C * found(0.5)[0], found.error, found.result
    )


def _shape(
    guess: Contact, rate: Scalar, ends: Float[Array, "2"], d: Scalar
) -> tuple[Float[Array, " points"], Float[Array, "6 points"]]:
    """Points and states of a straight span with a layer at either end; layers have most points."""
    width = rate * guess.length
    x = layer_mesh(jnp.clip(1.0 / width, 1e-7, 10.0)[None], _POINTS, 4)[0]
    x = jax.lax.stop_gradient(x)
    near, far = _layer(1.0 - x, width), _layer(x, width)
    kappa_m = 1.0 / jnp.min(jnp.abs(ends))
    k = (near / ends[0] + far / ends[1]) / kappa_m
    q = (far / ends[1] - near / ends[0]) / kappa_m
    p = 1.0 - (k * kappa_m / rate) ** 2 / 2.0

    phi = -jnp.arcsin((ends[1] - ends[0]) / d)
    theta = phi + (guess.theta_start - phi) * near + (guess.theta_end - phi) * far
    points = [
        rho / d * jnp.stack([jnp.sin(angle), -jnp.cos(angle)])
        for rho, angle in ((ends[0], guess.theta_start), (ends[1], guess.theta_end))
    ]
    points[1] = points[1] + jnp.array([1.0, 0.0])
    chord = points[0][:, None] + (points[1] - points[0])[:, None] * x
    return x, jnp.concatenate([jnp.stack([p, k, q, theta]), chord])


def _layer(x: Float[Array, " points"], width: Scalar) -> Float[Array, " points"]:
    """sinh(width x)/sinh(width), without growing exponentials."""
    decay = jnp.exp(-width * (1.0 - x))
    return decay * jnp.expm1(-2.0 * width * x) / jnp.expm1(-2.0 * width)
