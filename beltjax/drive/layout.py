"""Geometry of the belt's path (MODEL.md, section 0), for any number of pulleys on either face.

Everything is written with the directions of the spans and dot products, so that no formula
knows which pulley the arm carries or in which sense the pulleys are listed.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.drive.components import Drive
from beltjax.results import RESULTS, first_failure


class Layout(eqx.Module):
    """Tangent points, spans and wraps of a drive, all [m] and [rad], in listed order.

    Span i runs from pulley i to the next in the list. `normals` point into the loop.
    """

    centers: Float[Array, "pulleys 2"]
    directions: Float[Array, "spans 2"]  # unit, from the span's first pulley to its second
    normals: Float[Array, "spans 2"]  # unit, to the inside of the loop
    starts: Float[Array, "spans 2"]  # tangent point on the span's first pulley
    ends: Float[Array, "spans 2"]  # tangent point on its second
    span_lengths: Float[Array, " spans"]
    wraps: Float[Array, " pulleys"]  # in (-pi/2, 3 pi/2); not positive: contact lost
    arc_lengths: Float[Array, " pulleys"]
    path_length: Float[Array, ""]
    arm_length: Float[Array, ""]  # r_t; 1 where there is no tensioner
    arm_angle: Float[Array, ""]  # alpha, direction of the arm from pivot to pulley
    arm_normal: Float[Array, " spans"]  # speed of the span's moving end along its normal, over r_t,
    arm_tangent: Float[Array, " spans"]  # growth of the span's length, per radian and r_t
    alignment: Float[Array, "2"]  # (beta_in, beta_out) in [0, 2 pi)
    result: RESULTS


def perpendicular(vector: Float[Array, "... 2"]) -> Float[Array, "... 2"]:
    """`vector` turned by +90 degrees."""
    return jnp.stack([-vector[..., 1], vector[..., 0]], axis=-1)


def turned(vector: Float[Array, "2"], angle: Float[Array, ""]) -> Float[Array, "2"]:
    """`vector` turned counterclockwise by `angle`."""
    return jnp.cos(angle) * vector + jnp.sin(angle) * perpendicular(vector)


def layout(drive: Drive, arm_rotation: Float[Array, ""] | float = 0.0) -> Layout:
    """Path of the belt with the arm turned by `arm_rotation` [rad] from where it is drawn.

    Pulleys are inside the loop or on its back; the path is that of a perfectly flexible belt.
    Result: `no_tangent`, `contact_lost` (a wrap that is not positive) or `path_not_simple`.
    Values stay finite, and their derivatives zero, where a tangent does not exist.
    """
    faces, radii, sense = drive.faces, drive.radii, jax.lax.stop_gradient(drive.sense)
    arm = turned(drive.arm, jnp.asarray(arm_rotation))
    centers = drive.centers + drive.carried[:, None] * (arm - drive.arm)

    apart = jnp.roll(centers, -1, axis=0) - centers
    rise = jnp.roll(faces * radii, -1) - faces * radii  # of the center line along the normal
    distance2 = jnp.sum(apart**2, axis=-1)
    exists = distance2 > rise**2
    distance2 = jnp.where(exists, distance2, 1.0 + rise**2)
    lengths = jnp.sqrt(distance2 - rise**2)
    directions = (
        lengths[:, None] * apart - (sense * rise)[:, None] * perpendicular(apart)
    ) / distance2[:, None]
    # Where there is no tangent, any unit vector does: nothing downstream may be NaN.
    directions = jnp.where(exists[:, None], directions, jnp.array([1.0, 0.0]))
    normals = sense * perpendicular(directions)

    wraps = _wraps(directions, faces, sense)
    arcs = radii * wraps
    arm_normal, arm_tangent, alignment, arm_length = _arm(drive, arm, directions, normals)
    result = first_failure(
        (jnp.any(~exists), RESULTS.no_tangent),
        (jnp.abs(jnp.sum(faces * wraps) - 2 * jnp.pi) > 1.0, RESULTS.path_not_simple),
        (jnp.any(wraps <= 0), RESULTS.contact_lost),
    )
    return Layout(
        centers=centers,
        directions=directions,
        normals=normals,
        starts=centers - (faces * radii)[:, None] * normals,
        ends=jnp.roll(
            centers - (faces * radii)[:, None] * jnp.roll(normals, 1, axis=0), -1, axis=0
        ),
        span_lengths=lengths,
        wraps=wraps,
        arc_lengths=arcs,
        path_length=jnp.sum(lengths) + jnp.sum(arcs),
        arm_length=arm_length,
        arm_angle=jnp.arctan2(arm[1], arm[0]),
        arm_normal=arm_normal,
        arm_tangent=arm_tangent,
        alignment=alignment,
        result=result,
    )


def _wraps(directions, faces, sense) -> Float[Array, " pulleys"]:
    """Angle by which each pulley turns the belt, positive where it touches it."""
    before = jnp.roll(directions, 1, axis=0)
    cross = before[:, 0] * directions[:, 1] - before[:, 1] * directions[:, 0]
    turn = faces * sense * jnp.arctan2(cross, jnp.sum(before * directions, axis=-1))
    return jnp.where(turn < -jnp.pi / 2, turn + 2 * jnp.pi, turn)


def _arm(drive, arm, directions, normals):
    """How the spans follow the arm: rates along their normals and tangents, and (3.5)'s angles."""
    arm_length = jnp.sqrt(jnp.sum(arm**2))
    sideways = perpendicular(arm) / arm_length
    ends_on_arm = jnp.roll(drive.carried, -1)  # the span whose second pulley is carried
    starts_on_arm = drive.carried
    # cos(beta_in) for the span that ends on the arm, -cos(beta_out) for the one that starts:
    # the difference of the span's two ends, which is all that a span feels.
    arm_normal = (ends_on_arm - starts_on_arm) * (normals @ sideways)
    arm_tangent = (ends_on_arm - starts_on_arm) * (directions @ sideways)
    # Going counterclockwise, a clockwise list is met backwards.
    forward = jnp.stack([ends_on_arm @ directions, starts_on_arm @ directions])
    backward = -forward[::-1]
    met = jnp.where(drive.sense > 0, forward, backward)
    angle = jnp.arctan2(arm[1], arm[0]) - jnp.arctan2(met[:, 1], met[:, 0])
    if drive.tensioner is None:
        angle = jnp.zeros(2)
    return arm_normal, arm_tangent, jnp.mod(angle, 2 * jnp.pi), arm_length
