"""Geometry of the belts' paths for any number of pulleys on either face.

Everything is written with the directions of the spans and dot products, so that no formula
knows which pulleys a tensioner carries or in which sense the pulleys are listed:
docs/theory/geometry.md, (G1) to (G6), and docs/theory/bodies.md, (M3) and (M4).
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from beltjax.compiling.quick import boundary_jit
from beltjax.drive.bodies import bodies
from beltjax.drive.canonical import canonical_drive
from beltjax.drive.components import as_flags
from beltjax.drive.readable import Readable
from beltjax.drive.system import Drive
from beltjax.numerics.loops import Loops
from beltjax.numerics.rigid_bodies import Bodies, placed
from beltjax.results import (
    RESULTS,
    first_failure,
    frozen_where_failed,
    raise_unless_successful,
)


class Layout(Readable):
    """Tangent points, spans and wraps of a drive, all in [m] and [rad] and in listed order.

    Span i runs from pulley i to the next of its belt. `normals` point into the loop. Derivatives
    are those by the tensioners' coordinates [rad] or [m].
    """

    centers: Float[Array, "pulleys 2"]
    directions: Float[Array, "spans 2"]  # unit, from the span's first pulley to its second
    normals: Float[Array, "spans 2"]  # unit, to the inside of the loop
    starts: Float[Array, "spans 2"]  # tangent point on the span's first pulley
    ends: Float[Array, "spans 2"]  # tangent point on its second
    span_lengths: Float[Array, " spans"]
    wraps: Float[Array, " pulleys"]  # where it is not positive, contact is lost
    arc_lengths: Float[Array, " pulleys"]
    path_lengths: Float[Array, " belts"]
    coordinates: Float[Array, " coordinates"]  # of the tensioners in this layout
    arms: Float[Array, "coordinates 2"]  # from each pivot to the pulleys that its body carries
    span_pulls: Float[Array, "spans coordinates"]  # the span's part of d(path): S
    span_turns: Float[Array, "spans coordinates"]  # d(w_i(l_i) - w_i(0)), inwards: a l
    lifts: Float[Array, "spans coordinates"]  # d(w_i(0)), inwards: W0
    drifts: Float[Array, "spans coordinates"]  # d(motion of the span along itself), of its middle
    # Second derivatives of the distance along the span between the pulleys at its ends: H.
    curvatures: Float[Array, "spans coordinates coordinates"]
    result: RESULTS

    @property
    def path_length(self) -> Float[Array, ""]:
        """Length of the path [m], summed over all belts."""
        return jnp.sum(self.path_lengths)

    @property
    def arm_length(self) -> Float[Array, ""]:
        """Length of the first tensioner's arm, from pivot to pulley [m]."""
        return jnp.sqrt(jnp.sum(self.arms[..., 0, :] ** 2, axis=-1))

    @property
    def arm_angle(self) -> Float[Array, ""]:
        """Direction of the first tensioner's arm, from pivot to pulley [rad], in (-pi, pi]."""
        return jnp.arctan2(self.arms[..., 0, 1], self.arms[..., 0, 0])


def perpendicular(vector: Float[Array, "... 2"]) -> Float[Array, "... 2"]:
    """`vector` turned by +90 degrees."""
    return jnp.stack([-vector[..., 1], vector[..., 0]], axis=-1)


def turned(vector: Float[Array, "2"], angle: Float[Array, ""]) -> Float[Array, "2"]:
    """`vector` turned counterclockwise by `angle`."""
    return jnp.cos(angle) * vector + jnp.sin(angle) * perpendicular(vector)


class Outline(NamedTuple):
    """The numbers of a drive on which its path depends, as arrays."""

    x: Float[Array, " pulleys"]  # centers, as drawn
    y: Float[Array, " pulleys"]
    radii: Float[Array, " pulleys"]
    faces: Float[Array, " pulleys"]
    senses: Float[Array, " pulleys"]
    bodies: Bodies


class Path(NamedTuple):
    """The parts from which a `Layout` is made; fields of the same name mean the same."""

    x: Float[Array, " pulleys"]
    y: Float[Array, " pulleys"]
    along_x: Float[Array, " spans"]  # directions of the spans
    along_y: Float[Array, " spans"]
    span_lengths: Float[Array, " spans"]
    wraps: Float[Array, " pulleys"]
    arc_lengths: Float[Array, " pulleys"]
    exists: Bool[Array, " spans"]  # whether the span's pulleys have a tangent
    span_pulls: Float[Array, "spans coordinates"]
    span_turns: Float[Array, "spans coordinates"]
    lifts: Float[Array, "spans coordinates"]
    drifts: Float[Array, "spans coordinates"]
    curvatures: Float[Array, "spans coordinates coordinates"]
    pivots: Float[Array, "coordinates 2"]


def outline(drive: Drive) -> Outline:
    """The numbers on which the path of `drive` depends."""
    centers = drive.centers
    return Outline(
        centers[:, 0], centers[:, 1], drive.radii, drive.faces, drive.senses, bodies(drive)
    )


def belt_path(of: Outline, loops: Loops, at: Float[Array, " coordinates"]) -> Path:
    """Path of the belts with the tensioners' coordinates `at`, from where they are drawn."""
    there = placed(of.bodies, of.x, of.y, of.bodies.carried, at)
    x, y, following = there.x, there.y, loops.following

    # Components stay apart until the results are put together: joining and splitting small
    # arrays is most of what XLA would otherwise have to compile.
    across, up = following(x) - x, following(y) - y
    foot = of.faces * of.radii
    rise = following(foot) - foot  # of the center line along the normal
    distance2 = across**2 + up**2
    exists = distance2 > rise**2
    distance2 = jnp.where(exists, distance2, 1.0 + rise**2)
    lengths = jnp.sqrt(distance2 - rise**2)
    # Where there is no tangent, any unit vector does: nothing downstream may be NaN.
    along_x = jnp.where(exists, (lengths * across + of.senses * rise * up) / distance2, 1.0)
    along_y = jnp.where(exists, (lengths * up - of.senses * rise * across) / distance2, 0.0)

    wraps = _wraps(along_x, along_y, of, loops)
    # A body acts on a span only through the difference of the span's two ends.
    apart_x, apart_y = following(there.by_x) - there.by_x, following(there.by_y) - there.by_y
    bent_x = following(there.twice_x) - there.twice_x
    bent_y = following(there.twice_y) - there.twice_y
    t_x, t_y, left = along_x[:, None], along_y[:, None], of.senses[:, None]
    return Path(
        x=x,
        y=y,
        along_x=along_x,
        along_y=along_y,
        span_lengths=lengths,
        wraps=wraps,
        arc_lengths=of.radii * wraps,
        exists=exists,
        span_pulls=t_x * apart_x + t_y * apart_y,
        span_turns=left * (t_x * apart_y - t_y * apart_x),
        lifts=left * (t_x * there.by_y - t_y * there.by_x),
        drifts=t_x * (there.by_x + apart_x / 2) + t_y * (there.by_y + apart_y / 2),
        curvatures=t_x[:, None] * bent_x + t_y[:, None] * bent_y,
        pivots=there.pivots,
    )


def unstretched_lengths(
    EA: Float[Array, " belts"], at: Layout | Path, tensions: Float[Array, " spans"], loops: Loops
) -> Float[Array, " belts"]:
    """Unstretched length of the belts on this path at these tensions (R3).

    On a pulley's arc the tension is the mean of the adjacent spans', an assumption of (R3).
    """
    of_span = loops.spread(EA)
    arcs = (tensions + loops.preceding(tensions)) / 2
    spans = at.span_lengths / (1 + tensions / of_span)
    return loops.sums(spans + at.arc_lengths / (1 + arcs / of_span))


def layout(
    drive: Drive, coordinates: Float[Array, " coordinates"] | float = 0.0, *, throw: bool = True
) -> Layout:
    """Path of the belts with the tensioners moved by `coordinates` from where they are drawn.

    Pulleys are inside the loop or on its back; the path is that of a perfectly flexible belt.
    docs/theory/geometry.md, (G1) to (G6).

    The result is a failure with `no_tangent`, `contact_lost` (a wrap that is not positive) or
    `path_not_simple` (a path that does not go round once, or spans that cross; of two pulleys on
    different faces the belt is a crossed one, whose spans do). With `throw=False`
    read `.result`: the values of a failed layout are finite, and their derivatives are zero.

    Args:
        drive: the drive.
        coordinates: one number for each tensioner [rad] or [m], or one for all.
        throw: raise where the result is a failure.

    Returns:
        Tangent points, span lengths, wraps and their derivatives, in SI units.

    Raises:
        AnalysisError: the result is a failure, and `throw` is set.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> bj.layout(drive).span_lengths  # [m]
    """
    found = _layout(canonical_drive(drive), as_flags(coordinates))
    return raise_unless_successful(found, found.result, throw)


@boundary_jit
def _layout(drive: Drive, coordinates: Float[Array, " coordinates"]) -> Layout:
    at = jnp.broadcast_to(coordinates, (len(drive.tensioners),))
    return laid_out(outline(drive), drive.loops, at)


def laid_out(of: Outline, loops: Loops, at: Float[Array, " coordinates"]) -> Layout:
    """`layout` from the numbers on which it depends; failures are in its result alone."""
    path = belt_path(of, loops, at)
    centers = jnp.stack([path.x, path.y], axis=-1)
    directions = jnp.stack([path.along_x, path.along_y], axis=-1)
    normals = of.senses[:, None] * perpendicular(directions)
    foot = of.faces * of.radii
    starts = centers - foot[:, None] * normals
    ends = loops.following(centers) - loops.following(foot)[:, None] * normals
    crossed = loops.crossed(of.faces)
    turned_round, once = loops.sums(of.faces * path.wraps), 2 * jnp.pi * (1 - crossed)
    plain = loops.spread(1 - crossed)[:, None] * (loops.members.T @ loops.members)
    result = first_failure(
        (jnp.any(~path.exists), RESULTS.no_tangent),
        (jnp.any(jnp.abs(turned_round - once) > 1.0), RESULTS.path_not_simple),
        (jnp.any(path.wraps <= 0), RESULTS.contact_lost),
        # Two belts run in planes of their own, and so do the two spans of a crossed one.
        (jnp.any(crossings(starts, ends) & (plain > 0)), RESULTS.path_not_simple),
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
        path_lengths=loops.sums(path.span_lengths + path.arc_lengths),
        coordinates=at,
        arms=_arms(of.bodies, centers, path.pivots),
        span_pulls=path.span_pulls,
        span_turns=path.span_turns,
        lifts=path.lifts,
        drifts=path.drifts,
        curvatures=path.curvatures,
        result=result,
    )
    return frozen_where_failed(found, result)


def _arms(
    of: Bodies, centers: Float[Array, "pulleys 2"], pivots: Float[Array, "coordinates 2"]
) -> Float[Array, "coordinates 2"]:
    """Vectors from each pivot to the middle of the pulleys that its body carries."""
    if not len(pivots):
        return pivots
    share = of.carries.T / jnp.maximum(jnp.sum(of.carries, axis=0), 1.0)[:, None]
    return share @ centers - pivots


def alignment_angles(drive: Drive, at: Layout) -> Float[Array, "coordinates 2"]:
    """(beta_in, beta_out) of Figure 3.2 in Kong (2003) for each tensioner, in [0, 2 pi) [rad].

    They are the arm's direction less that of the span which ends on the tensioner's pulley going
    counterclockwise, and less that of the span which starts there. docs/theory/geometry.md.

    Args:
        drive: the drive.
        at: its layout, as `layout` or a reference state gives it.

    Returns:
        One row per tensioner.
    """
    on, loops = bodies(drive).carries.T, drive.loops
    met_in, met_out = on @ loops.preceding(at.directions), on @ at.directions
    # Going counterclockwise, a clockwise list is met backwards.
    forward = (on @ drive.senses > 0)[:, None]
    first = jnp.where(forward, met_in, -met_out)
    second = jnp.where(forward, met_out, -met_in)
    angles = [
        jnp.arctan2(at.arms[:, 1], at.arms[:, 0]) - jnp.arctan2(met[:, 1], met[:, 0])
        for met in (first, second)
    ]
    return jnp.mod(jnp.stack(angles, axis=-1), 2 * jnp.pi)


def crossings(
    starts: Float[Array | np.ndarray, "spans 2"], ends: Float[Array | np.ndarray, "spans 2"]
) -> Bool[Array | np.ndarray, "spans spans"]:
    """Which spans have a point in common; touching ends are not a crossing."""
    along = ends - starts

    def side(
        points: Float[Array | np.ndarray, "spans 2"],
    ) -> Float[Array | np.ndarray, "spans spans"]:
        offset = points[None] - starts[:, None]
        return along[:, None, 0] * offset[..., 1] - along[:, None, 1] * offset[..., 0]

    apart = side(starts) * side(ends) < 0
    return apart & apart.T


def _wraps(
    along_x: Float[Array, " spans"], along_y: Float[Array, " spans"], of: Outline, loops: Loops
) -> Float[Array, " pulleys"]:
    """Angle by which each pulley turns the belt, positive where it touches it.

    It is taken in (-90, 270) degrees, of a crossed belt in (0, 360). Only a large pulley close to a
    small one has a larger wrap; it is recognized because the belt would otherwise not turn round at
    all.
    """
    before_x, before_y = loops.preceding(along_x), loops.preceding(along_y)
    cross = before_x * along_y - before_y * along_x
    turn = of.faces * of.senses * jnp.arctan2(cross, before_x * along_x + before_y * along_y)
    # A crossed belt turns by more than half round on both of its pulleys.
    least_turn = loops.spread(loops.crossed(of.faces) - 1) * jnp.pi / 2
    turn = jnp.where(turn < least_turn, turn + 2 * jnp.pi, turn)
    unturned = jnp.abs(loops.spread(loops.sums(of.faces * turn))) < 1.0
    misread = (loops.at_smallest(turn) > 0) & unturned & (turn < 0) & (of.faces > 0)
    return jnp.where(misread, turn + 2 * jnp.pi, turn)
