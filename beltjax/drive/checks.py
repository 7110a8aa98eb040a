"""Whether a drawn layout can be built: pulleys apart, tangents there, a belt that does not cross.

These are checks of concrete numbers, made once when a file is read. `clearances` is the
differentiable measure behind them, which design studies constrain.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from beltjax.drive.canonical import canonical_drive
from beltjax.drive.components import Drive
from beltjax.drive.layout import Layout, crossings, layout
from beltjax.files.errors import FileError
from beltjax.results import RESULTS, succeeded

_MOST_APART = 1e8  # largest length over smallest radius: gaps and wraps keep eight digits


class Clearances(NamedTuple):
    """Gaps [m], negative where things overlap."""

    rims: Float[Array, " pairs"]  # between the rims of each pair of pulleys
    belt: Float[Array, "spans others"]  # between each span and each pulley it does not touch


def pulley_pairs(count: int) -> np.ndarray:
    """Pairs (i, j), i < j, of pulleys: the order of `Clearances.rims`."""
    return np.stack(np.triu_indices(count, 1), axis=-1)


def other_pulleys(count: int) -> np.ndarray:
    """Pulleys [spans, others] that each span does not touch: the order of `Clearances.belt`."""
    return np.array([[(i + 2 + k) % count for k in range(count - 2)] for i in range(count)])


def rim_radii(drive: Drive) -> Float[Array, " pulleys"]:
    """Outer radii of the pulleys [m]: `rim_radius`, or the belt's inner face where not given."""
    half = _half_thickness(drive)
    rims = [p.radius - half if p.rim_radius is None else p.rim_radius for p in drive.pulleys]
    return jnp.stack(rims)


def _half_thickness(drive: Drive) -> Float[Array, ""]:
    thickness = drive.belt.thickness
    return jnp.zeros(()) if thickness is None else thickness / 2


def clearances(drive: Drive, at: Layout) -> Clearances:
    """Gaps between rims, and between the belt's faces and the rims of pulleys it passes."""
    rims, count = rim_radii(drive), len(drive.pulleys)
    first, second = pulley_pairs(count).T
    apart = jnp.sqrt(jnp.sum((at.centers[first] - at.centers[second]) ** 2, axis=-1))
    others = other_pulleys(count)
    if count == 2:
        return Clearances(apart - rims[first] - rims[second], jnp.zeros((2, 0)))
    offset = at.centers[others] - at.starts[:, None, :]
    along = jnp.sum(offset * at.directions[:, None, :], axis=-1)
    along = jnp.clip(along, 0.0, at.span_lengths[:, None])
    nearest = offset - along[..., None] * at.directions[:, None, :]
    distance = jnp.sqrt(jnp.sum(nearest**2, axis=-1))
    return Clearances(
        rims=apart - rims[first] - rims[second],
        belt=distance - rims[others] - _half_thickness(drive),
    )


class Fault(NamedTuple):
    """What makes a layout impossible."""

    key: str
    message: str


def require_possible_layout(drives: dict[str, Drive], listed: str | None, path: object) -> Drive:
    """The one of `drives`, by the senses of their list and equal but for them, that is possible.

    Raises `FileError` when none is, when it is not the one that the file says is `listed`, or when
    two are and the file must say which is meant. Two pulleys alone are listed counterclockwise,
    since both senses give the same path.
    """
    sense = listed or _likely_sense(next(iter(drives.values())))
    (other,) = drives.keys() - {sense}
    fault = layout_fault(drives[sense])
    if fault is None and (listed or len(drives[sense].pulleys) == 2):
        return drives[sense]
    other_fault = layout_fault(drives[other])
    if fault is None and other_fault is None:
        raise FileError(path, "listed", f"both senses give a path; say {sense!r} or {other!r}")
    if fault is None:
        return drives[sense]
    if other_fault is not None:
        raise FileError(path, fault.key, fault.message)
    if listed:
        message = f"found {listed!r}, in which {fault.message}; {other!r} gives a path"
        raise FileError(path, "listed", message)
    return drives[other]


def _likely_sense(drive: Drive) -> str:
    """The sense in which the polygon of the centers is gone round; counterclockwise if in none."""
    centers = np.array([pulley.center for pulley in drive.pulleys])
    after = np.roll(centers, -1, axis=0)
    area = np.sum(centers[:, 0] * after[:, 1] - centers[:, 1] * after[:, 0])
    return "clockwise" if area < 0 and len(centers) > 2 else "counterclockwise"


def drawn_arm_angle(drive: Drive) -> float:
    """Direction of the drawn arm [rad], from pivot to pulley; compiles nothing."""
    assert drive.tensioner is not None
    carried = next(pulley.center for pulley in drive.pulleys if float(pulley.on_arm))
    x, y = np.asarray(carried) - np.asarray(drive.tensioner.pivot)
    return float(np.arctan2(y, x))


@jax.jit
def _survey(drive: Drive, arm_rotation) -> tuple[Layout, Clearances]:
    at = layout(drive, arm_rotation, throw=False)
    return at, clearances(drive, at)


def layout_fault(drive: Drive, arm_rotation: float = 0.0) -> Fault | None:
    """What makes the layout impossible, with the arm turned by so much; None if nothing does."""
    survey = jax.device_get(_survey(canonical_drive(drive), arm_rotation))
    return next(filter(None, (find(drive, *survey) for find in _CHECKS)), None)


def _arm_fault(drive: Drive, at: Layout, gaps: Clearances) -> Fault | None:
    if drive.tensioner is not None and not float(at.arm_length) > 0:
        return Fault("tensioner.pivot", "lies at its pulley's center; an arm has a length")
    return None


def _out_of_proportion(drive: Drive, at: Layout, gaps: Clearances) -> Fault | None:
    """What double precision cannot tell apart."""
    radii = np.array([pulley.radius for pulley in drive.pulleys])
    for key, sizes in (("center", np.max(np.abs(at.centers), axis=1)), ("radius", radii)):
        i = int(np.argmax(sizes))
        if not sizes[i] < _MOST_APART * np.min(radii):
            return Fault(
                f"pulley.{drive.pulley_names[i]}.{key}",
                f"is out of all proportion, {sizes[i]:g} m beside a radius of {np.min(radii):g} m, "
                "which double precision does not resolve; a bare number is in meters",
            )
    if not np.isfinite(at.path_length):
        return Fault("pulley", "a center or radius is out of all proportion; give meters")
    return None


def _overlap(drive: Drive, at: Layout, gaps: Clearances) -> Fault | None:
    names = drive.pulley_names
    for (i, j), gap in zip(pulley_pairs(len(names)), gaps.rims, strict=True):
        if gap <= 0:
            return Fault(
                f"pulley.{names[j]}.center",
                f"overlaps pulley {names[i]!r} by {-1e3 * gap:.3g} mm; move them apart",
            )
    return None


def _missing_tangent(drive: Drive, at: Layout, gaps: Clearances) -> Fault | None:
    if at.result != RESULTS.no_tangent:
        return None
    centers, signed = at.centers, np.asarray(drive.faces * drive.radii)
    for i, name in enumerate(drive.span_names):
        j = (i + 1) % len(signed)
        apart, needed = np.linalg.norm(centers[j] - centers[i]), abs(signed[j] - signed[i])
        if apart <= needed:
            return Fault(
                f"pulley.{drive.pulley_names[j]}.center",
                f"span {name} has no tangent: centers are {1e3 * apart:.4g} mm apart and must be "
                f"more than {1e3 * needed:.4g} mm; move them apart",
            )
    return None


def _lost_contact(drive: Drive, at: Layout, gaps: Clearances) -> Fault | None:
    if at.result != RESULTS.contact_lost:
        return None
    i = int(np.argmin(at.wraps))
    wrap = f"wrap {np.degrees(float(at.wraps[i])):.1f} deg"
    missed = _missed_by(drive, at, i)
    by = f"it misses it by {1e3 * missed:.3g} mm, {wrap}" if missed > 0 else wrap
    return Fault(
        f"pulley.{drive.pulley_names[i]}.center",
        f"the belt does not touch this pulley ({by}); move it into the belt or change its face",
    )


def _missed_by(drive: Drive, at: Layout, i: int) -> float:
    """Gap [m] between a pulley and the belt that would run past it; 0 where there is no such belt.

    As the path itself is found, from the pulley before to the one after.
    """
    sense = float(drive.sense)
    foot = np.array([float(pulley.face * pulley.radius) for pulley in drive.pulleys])
    before, after = i - 1, (i + 1) % len(foot)
    (across, up), rise = at.centers[after] - at.centers[before], foot[after] - foot[before]
    square = across**2 + up**2
    if not square > rise**2:
        return 0.0
    length = np.sqrt(square - rise**2)
    along = np.array([length * across + sense * rise * up, length * up - sense * rise * across])
    inward = sense * np.array([-along[1], along[0]]) / square
    height = (at.centers[i] - at.centers[before]) @ inward + foot[before]
    return float(np.sign(foot[i]) * (height - foot[i]))


def _path_fault(drive: Drive, at: Layout, gaps: Clearances) -> Fault | None:
    if succeeded(at.result):
        return None
    return Fault(
        "pulley",
        "the belt path crosses itself or does not close; check the pulleys' order, 'listed' "
        "and the faces",
    )


def _obstruction(drive: Drive, at: Layout, gaps: Clearances) -> Fault | None:
    belt = gaps.belt
    if belt.size and belt.min() <= 0:
        i, k = np.unravel_index(np.argmin(belt), belt.shape)
        name = drive.pulley_names[other_pulleys(len(belt))[i, k]]
        return Fault(
            f"pulley.{name}.center",
            f"span {drive.span_names[i]} runs through this pulley by {-1e3 * belt[i, k]:.3g} mm; "
            "move it out of the belt",
        )
    return None


def _crossing(drive: Drive, at: Layout, gaps: Clearances) -> Fault | None:
    pairs = np.argwhere(np.triu(crossings(np.asarray(at.starts), np.asarray(at.ends))))
    if not len(pairs):
        return None
    first, second = (drive.span_names[k] for k in pairs[0])
    return Fault(
        "pulley",
        f"the belt path crosses itself: spans {first} and {second}; check the pulleys' order, "
        "'listed' and the faces",
    )


_CHECKS = (
    _arm_fault,
    _out_of_proportion,
    _overlap,
    _missing_tangent,
    _lost_contact,
    _crossing,
    _path_fault,
    _obstruction,
)
