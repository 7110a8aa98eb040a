"""Whether a drawn layout can be built: pulleys apart, tangents there, a belt that does not cross.

These are checks of concrete numbers, made once when a file is read. `clearances` is the
differentiable measure behind them, which design studies constrain.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from beltjax.drive.components import Drive
from beltjax.drive.layout import Layout, crossings, layout
from beltjax.errors import FileError
from beltjax.results import RESULTS, succeeded

_LARGEST = {"radius": 5.0, "center": 50.0}  # [m]


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
    passed: int = 0  # checks before the one that found it


def require_possible_layout(drives: list[Drive], path: object) -> Drive:
    """The one of `drives`, equal but for the sense of their list, whose layout is possible.

    Raises `FileError` when none is, or when two are and the file must say which is meant.
    Two pulleys alone are listed counterclockwise, since both senses give the same path.
    """
    faults = [layout_fault(drive) for drive in drives]
    possible = [drive for drive, fault in zip(drives, faults, strict=True) if fault is None]
    if not possible:
        # Where the sense is left open, the reading that comes closest tells most.
        closest = max(filter(None, faults), key=lambda fault: fault.passed)
        raise FileError(path, closest.key, closest.message)
    if len(possible) > 1 and len(drives[0].pulleys) > 2:
        raise FileError(
            path, "listed", "both senses give a path; say 'counterclockwise' or 'clockwise'"
        )
    return possible[0]


@jax.jit
def _survey(drive: Drive, arm_rotation) -> tuple[Layout, Clearances]:
    at = layout(drive, arm_rotation, throw=False)
    return at, clearances(drive, at)


def layout_fault(drive: Drive, arm_rotation: float = 0.0) -> Fault | None:
    """What makes the layout impossible, with the arm turned by so much; None if nothing does."""
    survey = jax.device_get(_survey(drive, arm_rotation))
    for passed, find in enumerate(_CHECKS):
        fault = find(drive, *survey)
        if fault:
            return fault._replace(passed=passed)
    return None


def _arm_fault(drive: Drive, at: Layout, gaps: Clearances) -> Fault | None:
    if drive.tensioner is not None and not float(at.arm_length) > 0:
        return Fault("tensioner.pivot", "lies at its pulley's center; an arm has a length")
    return None


def _out_of_proportion(drive: Drive, at: Layout, gaps: Clearances) -> Fault | None:
    """Millimeters that were given as meters, mostly."""
    for pulley, center in zip(drive.pulleys, at.centers, strict=True):
        for key, size in (("radius", float(pulley.radius)), ("center", np.max(np.abs(center)))):
            if not size < _LARGEST[key]:
                return Fault(
                    f"pulley.{pulley.name}.{key}",
                    f"is out of all proportion ({size:g} m); a bare number is in meters, "
                    f'millimeters are written "{size:g} mm"',
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
    return Fault(
        f"pulley.{drive.pulley_names[i]}.center",
        f"the belt does not touch this pulley (wrap {np.degrees(float(at.wraps[i])):.1f} deg); "
        "move it into the belt or change its face",
    )


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
