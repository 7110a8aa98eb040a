"""Geometry of the belt's path for any number of pulleys on either face.

Everything is written with the directions of the spans and dot products, so that no formula
knows which pulley the arm carries or in which sense the pulleys are listed:
docs/theory/geometry.md, (G1) to (G6).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from beltjax.compiling.quick import boundary_jit
from beltjax.drive.canonical import canonical_drive
from beltjax.drive.components import Drive, as_real
from beltjax.drive.readable import Readable
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
)


class Layout(Readable):
    """Tangent points, spans and wraps of a drive, all [m] and [rad], in listed order.

    Span i runs from pulley i to the next in the list. `normals` point into the loop.
    """

    centers: Float[Array, "pulleys 2"]
    directions: Float[Array, "spans 2"]  # unit, from the span's first pulley to its second
    normals: Float[Array, "spans 2"]  # unit, to the inside of the loop
    starts: Float[Array, "spans 2"]  # tangent point on the span's first pulley
    ends: Float[Array, "spans 2"]  # tangent point on its second
    span_lengths: Float[Array, " spans"]
    wraps: Float[Array, " pulleys"]  # not positive: contact lost
    arc_lengths: Float[Array, " pulleys"]
    path_length: Float[Array, ""]
    arm_length: Float[Array, ""]  # r_t; 1 where there is no tensioner
    arm_angle: Float[Array, ""]  # alpha, direction of the arm from pivot to pulley
    arm_normal: Float[Array, " spans"]  # d(w_i(l_i) - w_i(0))/d(theta_t) over r_t
    arm_tangent: Float[Array, " spans"]  # the span's part of d(path)/d(theta_t), over r_t
    alignment: Float[Array, "2"]  # (beta_in, beta_out) in [0, 2 pi)
    result: RESULTS


def perpendicular(vector: Float[Array, "... 2"]) -> Float[Array, "... 2"]:
    """`vector` turned by +90 degrees."""
    return jnp.stack([-vector[..., 1], vector[..., 0]], axis=-1)


def turned(vector: Float[Array, "2"], angle: Float[Array, ""]) -> Float[Array, "2"]:
    """`vector` turned counterclockwise by `angle`."""
    return jnp.cos(angle) * vector + jnp.sin(angle) * perpendicular(vector)


class Outline(NamedTuple):
    """The numbers of a drive that its path depends on, stacked once."""

    x: Float[Array, " pulleys"]  # centers, as drawn
    y: Float[Array, " pulleys"]
    radii: Float[Array, " pulleys"]
    faces: Float[Array, " pulleys"]
    carried: Float[Array, " pulleys"]
    sense: Float[Array, ""]
    arm: Float[Array, "2"]  # from pivot to pulley, as drawn


class Path(NamedTuple):
    """What a layout is made of; the names they share mean the same."""

    x: Float[Array, " pulleys"]
    y: Float[Array, " pulleys"]
    along_x: Float[Array, " spans"]  # directions of the spans
    along_y: Float[Array, " spans"]
    span_lengths: Float[Array, " spans"]
    wraps: Float[Array, " pulleys"]
    arc_lengths: Float[Array, " pulleys"]
    exists: Bool[Array, " spans"]  # whether the span's pulleys have a tangent
    arm: Float[Array, "2"]
    arm_length: Float[Array, ""]
    arm_normal: Float[Array, " spans"]
    arm_tangent: Float[Array, " spans"]


def outline(drive: Drive) -> Outline:
    """The numbers that the path of `drive` depends on."""
    centers = drive.centers
    sense = jax.lax.stop_gradient(drive.sense)
    return Outline(
        centers[:, 0], centers[:, 1], drive.radii, drive.faces, drive.carried, sense, drive.arm
    )


def belt_path(of: Outline, turn: Float[Array, ""]) -> Path:
    """Path of the belt with the arm turned by `turn` from where it is drawn."""
    arm = turned(of.arm, turn)
    x = of.x + of.carried * (arm[0] - of.arm[0])
    y = of.y + of.carried * (arm[1] - of.arm[1])

    # Components stay apart until the results are put together: joining and splitting small
    # arrays is most of what XLA would otherwise have to compile.
    across, up = _following(x) - x, _following(y) - y
    foot = of.faces * of.radii
    rise = _following(foot) - foot  # of the center line along the normal
    distance2 = across**2 + up**2
    exists = distance2 > rise**2
    distance2 = jnp.where(exists, distance2, 1.0 + rise**2)
    lengths = jnp.sqrt(distance2 - rise**2)
    # Where there is no tangent, any unit vector does: nothing downstream may be NaN.
    along_x = jnp.where(exists, (lengths * across + of.sense * rise * up) / distance2, 1.0)
    along_y = jnp.where(exists, (lengths * up - of.sense * rise * across) / distance2, 0.0)

    wraps = _wraps(along_x, along_y, of.faces, of.sense)
    arm_length = jnp.sqrt(arm[0] ** 2 + arm[1] ** 2)
    side_x, side_y = -arm[1] / arm_length, arm[0] / arm_length
    # The difference of a span's two ends is all that it feels of the arm: + for the span that
    # ends there, - for the one that starts.
    moved = _following(of.carried) - of.carried
    return Path(
        x=x,
        y=y,
        along_x=along_x,
        along_y=along_y,
        span_lengths=lengths,
        wraps=wraps,
        arc_lengths=of.radii * wraps,
        exists=exists,
        arm=arm,
        arm_length=arm_length,
        arm_normal=moved * of.sense * (along_x * side_y - along_y * side_x),
        arm_tangent=moved * (along_x * side_x + along_y * side_y),
    )


def layout(
    drive: Drive, arm_rotation: Float[Array, ""] | float = 0.0, *, throw: bool = True
) -> Layout:
    """Path of the belt with the arm turned by `arm_rotation` [rad] from where it is drawn.

    Pulleys are inside the loop or on its back; the path is that of a perfectly flexible belt.

    Fails with `no_tangent`, `contact_lost` (a wrap that is not positive) or `path_not_simple`
    (not once round, or spans that cross). With `throw=False` read `.result`: values stay finite,
    and their derivatives zero, where a tangent does not exist.
    """
    found = _layout(canonical_drive(drive), as_real(arm_rotation))
    return raise_unless_successful(found, found.result, throw)


@boundary_jit
def _layout(drive: Drive, arm_rotation: Float[Array, ""]) -> Layout:
    of = outline(drive)
    path = belt_path(of, arm_rotation)
    centers = jnp.stack([path.x, path.y], axis=-1)
    directions = jnp.stack([path.along_x, path.along_y], axis=-1)
    normals = of.sense * perpendicular(directions)
    foot = of.faces * of.radii
    starts = centers - foot[:, None] * normals
    ends = jnp.roll(centers, -1, axis=0) - _following(foot)[:, None] * normals
    result = first_failure(
        (jnp.any(~path.exists), RESULTS.no_tangent),
        (jnp.abs(jnp.sum(of.faces * path.wraps) - 2 * jnp.pi) > 1.0, RESULTS.path_not_simple),
        (jnp.any(path.wraps <= 0), RESULTS.contact_lost),
        (jnp.any(crossings(starts, ends)), RESULTS.path_not_simple),
    )
    found = Layout(
        centers=centers,
        directions=directions,
        normals=normals,
        starts=starts,
        ends=ends,
        span_lengths=path.span_lengths,
        wraps=path.wraps,
        arc_lengths=path.arc_lengths,
        path_length=jnp.sum(path.span_lengths) + jnp.sum(path.arc_lengths),
        arm_length=path.arm_length,
        arm_angle=jnp.arctan2(path.arm[1], path.arm[0]),
        arm_normal=path.arm_normal,
        arm_tangent=path.arm_tangent,
        alignment=_alignment(drive, path.arm, directions),
        result=result,
    )
    return frozen_where_failed(found, result)


def crossings(
    starts: Float[Array | np.ndarray, "spans 2"], ends: Float[Array | np.ndarray, "spans 2"]
) -> Bool[Array | np.ndarray, "spans spans"]:
    """Which spans have a point in common; touching ends are not a crossing."""
    along = ends - starts

    def side(points):
        offset = points[None] - starts[:, None]
        return along[:, None, 0] * offset[..., 1] - along[:, None, 1] * offset[..., 0]

    apart = side(starts) * side(ends) < 0
    return apart & apart.T


def _following(values: Float[Array, " n"]) -> Float[Array, " n"]:
    """What belongs to the next pulley or span in the list."""
    return jnp.roll(values, -1)


def _wraps(along_x, along_y, faces, sense) -> Float[Array, " pulleys"]:
    """Angle by which each pulley turns the belt, positive where it touches it.

    In (-90, 270) degrees. Only a large pulley close to a small one takes more: then the belt would
    seem not to turn round at all.
    """
    before_x, before_y = jnp.roll(along_x, 1), jnp.roll(along_y, 1)
    cross = before_x * along_y - before_y * along_x
    turn = faces * sense * jnp.arctan2(cross, before_x * along_x + before_y * along_y)
    turn = jnp.where(turn < -jnp.pi / 2, turn + 2 * jnp.pi, turn)
    least = jnp.arange(len(turn)) == jnp.argmin(turn)
    unturned = jnp.abs(jnp.sum(faces * turn)) < 1.0
    misread = least & unturned & (turn < 0) & (faces > 0)
    return jnp.where(misread, turn + 2 * jnp.pi, turn)


def _alignment(drive: Drive, arm, directions) -> Float[Array, "2"]:
    """(beta_in, beta_out) of Figure 3.2; zero where there is no tensioner."""
    if drive.tensioner is None:
        return jnp.zeros(2)
    ends, starts = jnp.roll(drive.carried, -1) @ directions, drive.carried @ directions
    # Going counterclockwise, a clockwise list is met backwards.
    met = jnp.where(drive.sense > 0, jnp.stack([ends, starts]), -jnp.stack([starts, ends]))
    angle = jnp.arctan2(arm[1], arm[0]) - jnp.arctan2(met[:, 1], met[:, 0])
    return jnp.mod(angle, 2 * jnp.pi)
