"""Whether a drawn layout can be built: pulleys apart, tangents there, a belt that does not cross.

These are checks of concrete numbers, made once when a file is read. `clearances` is the
differentiable measure behind them, which design studies constrain.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from beltjax.compiling.kept_programs import run_kept
from beltjax.drive.canonical import canonical_drive
from beltjax.drive.components import SENSES, as_flags
from beltjax.drive.file_bodies import SINGLE, arm_direction
from beltjax.drive.installation import TensionGiven
from beltjax.drive.layout import Layout, crossings, layout
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.numerics.loops import Loops

_MOST_APART = 1e8  # largest length over smallest radius: gaps and wraps keep eight digits


class Clearances(NamedTuple):
    """Gaps [m], negative where things overlap. Belts run in planes of their own."""

    rims: Float[Array, " pairs"]  # between the rims of each pair of pulleys of one belt
    belt: Float[Array, " passes"]  # between each span and each pulley of its belt not touched


def pulley_pairs(sizes: Sequence[int]) -> np.ndarray:
    """Pairs (i, j), i < j, of pulleys of one belt: the order of `Clearances.rims`."""
    loops = [np.stack(np.triu_indices(size, 1), axis=-1) for size in sizes]
    return np.concatenate(
        [
            pairs + start
            for pairs, start in zip(loops, Loops(tuple(sizes)).starts.tolist(), strict=True)
        ]
    )


def passes(sizes: Sequence[int]) -> np.ndarray:
    """Pairs (span, pulley of its belt that it does not touch): the order of `Clearances.belt`."""
    found = [
        (start + i, start + (i + 2 + k) % size)
        for size, start in zip(sizes, Loops(tuple(sizes)).starts.tolist(), strict=True)
        for i in range(size)
        for k in range(size - 2)
    ]
    return np.array(found, int).reshape(-1, 2)


def rim_radii(drive: Drive) -> Float[Array, " pulleys"]:
    """Outer radii of the pulleys [m]: `rim_radius`, or the belt's inner face where not given."""
    half = _half_thickness(drive)
    rims = [
        pulley.radius - half[place] if pulley.rim_radius is None else pulley.rim_radius
        for place, pulley in enumerate(drive.pulleys)
    ]
    return jnp.stack(rims)


def _half_thickness(drive: Drive) -> Float[Array, " pulleys"]:
    """Half of the thickness of the belt on each pulley [m]."""
    none = jnp.zeros(())
    each = [none if belt.thickness is None else belt.thickness / 2 for belt in drive.belts]
    return jnp.stack(each)[drive.belt_of_span]


def clearances(drive: Drive, at: Layout) -> Clearances:
    """Gaps between rims, and between the belts' faces and the rims of pulleys they pass."""
    rims, sizes = rim_radii(drive), drive.loop_sizes
    first, second = pulley_pairs(sizes).T
    span, other = passes(sizes).T
    # All pairs as matrices, of which the wanted ones are taken at the end: to gather the centers
    # of each pair first takes three times as long, with derivatives.
    x, y = at.centers[:, 0], at.centers[:, 1]
    apart = _distance(x[:, None] - x, y[:, None] - y, first, second)
    along_x, along_y = at.directions[:, :1], at.directions[:, 1:]
    across, up = x - at.starts[:, :1], y - at.starts[:, 1:]
    along = jnp.clip(across * along_x + up * along_y, 0.0, at.span_lengths[:, None])
    from_belt = _distance(across - along * along_x, up - along * along_y, span, other)
    return Clearances(
        rims=(apart - rims[:, None] - rims)[first, second],
        belt=(from_belt - rims - _half_thickness(drive)[:, None])[span, other],
    )


def _distance(
    x: Float[Array, "n n"],
    y: Float[Array, "n n"],
    rows: Int[np.ndarray, " pairs"],
    columns: Int[np.ndarray, " pairs"],
) -> Float[Array, "n n"]:
    """Lengths of vectors, of which only those in these rows and columns are wanted."""
    wanted = np.zeros(x.shape, bool)
    wanted[rows, columns] = True
    # A pulley and itself, or two of a shaft, have no distance whose root has a derivative.
    return jnp.sqrt(jnp.where(wanted, x**2 + y**2, 1.0))


class Fault(NamedTuple):
    """The reason why a layout is impossible, with the key of the file that is to blame."""

    key: str
    message: str


def require_possible_layout(drive: Drive, listed: Sequence[str | None], path: object) -> Drive:
    """`drive` with the sense in which the pulleys of each belt are listed, by what is possible.

    Raises `FileError` when a belt has no possible path, when the file says that it is `listed` in
    another sense, or when two are possible and the file must say which is meant. Two pulleys alone
    are listed counterclockwise, since both senses give the same path.
    """
    words = list(SENSES)
    likely = [word or _likely_sense(drive, belt) for belt, word in enumerate(listed)]
    other = [words[1 - words.index(word)] for word in likely]
    found = _in_senses(drive, likely)
    faults = _faults(found)
    settled = [
        fault is None and bool(word or size == 2)
        for fault, word, size in zip(faults, listed, drive.loop_sizes, strict=True)
    ]
    if all(settled):
        return found
    other_faults = _faults(_in_senses(drive, other))
    chosen = list(likely)
    for belt, (fault, other_fault) in enumerate(zip(faults, other_faults, strict=True)):
        if settled[belt] or (fault is None and other_fault is not None):
            continue
        key = "listed" if len(listed) == 1 else f"listed.{drive.belts[belt].name}"
        if fault is None:
            message = f"both senses give a path; say {likely[belt]!r} or {other[belt]!r}"
            raise FileError(path, key, message)
        if other_fault is not None:
            raise FileError(path, fault.key, fault.message)
        if listed[belt]:
            message = (
                f"found {listed[belt]!r}, in which {fault.message}; {other[belt]!r} gives a path"
            )
            raise FileError(path, key, message)
        chosen[belt] = other[belt]
    return _in_senses(drive, chosen)


def _in_senses(drive: Drive, words: Sequence[str]) -> Drive:
    senses = np.array([SENSES[word] for word in words])
    sense = jnp.asarray(senses if len(words) > 1 else senses[0])
    return eqx.tree_at(lambda d: d.sense, drive, sense)


def _likely_sense(drive: Drive, belt: int) -> str:
    """The sense in which the list goes round the polygon of a belt's centers.

    It is counterclockwise for a polygon without area.
    """
    pulleys = [p for p, of in zip(drive.pulleys, drive.belt_of_span, strict=True) if of == belt]
    centers = np.array([pulley.center for pulley in pulleys])
    after = np.roll(centers, -1, axis=0)
    area = np.sum(centers[:, 0] * after[:, 1] - centers[:, 1] * after[:, 0])
    return "clockwise" if area < 0 and len(centers) > 2 else "counterclockwise"


def drawn_arm_angle(drive: Drive) -> float:
    """Direction of the first tensioner's drawn arm, from pivot to pulley [rad]."""
    centers = [pulley.center for pulley in drive.pulleys if float(pulley.on[0])]
    return arm_direction(centers, drive.tensioners[0].pivot)


def _survey(drive: Drive, coordinates: Float[Array, " coordinates"]) -> tuple[Layout, Clearances]:
    at = layout(drive, coordinates, throw=False)
    return at, clearances(drive, at)


def layout_fault(
    drive: Drive, coordinates: Float[Array, " coordinates"] | float = 0.0
) -> Fault | None:
    """The reason why the layout is impossible; None if it is possible.

    The tensioners are at `coordinates`, from where they are drawn.
    """
    return next(filter(None, _faults(drive, coordinates)), None)


def _faults(
    drive: Drive, coordinates: Float[Array, " coordinates"] | float = 0.0
) -> list[Fault | None]:
    """The first fault of each belt's path, or None."""
    # Parts on which the path does not depend would compile anew where they differ.
    bare = dataclasses.replace(
        drive, installation=TensionGiven(1.0), arm_springs=(), isolators=(), dampers=()
    )
    survey = jax.device_get(run_kept(_survey, canonical_drive(bare), as_flags(coordinates)))
    return _faults_of(drive, *survey)


def fault_of(drive: Drive, at: Layout, gaps: Clearances) -> Fault | None:
    """The reason why a layout that is computed already, with its gaps, is impossible; or None."""
    return next(filter(None, _faults_of(drive, at, gaps)), None)


def _faults_of(drive: Drive, at: Layout, gaps: Clearances) -> list[Fault | None]:
    """The first fault of each belt's path, or None."""
    return [
        _arm_fault(drive) or next(filter(None, (find(loop) for find in _CHECKS)), None)
        for loop in _loops(drive, at, gaps)
    ]


class _Loop(NamedTuple):
    """The numbers of the path of one belt that are checked, in listed order."""

    names: tuple[str, ...]
    spans: tuple[str, ...]
    sense: float
    crossed: bool  # between two pulleys that turn opposite ways
    centers: np.ndarray
    radii: np.ndarray
    faces: np.ndarray
    starts: np.ndarray
    ends: np.ndarray
    wraps: np.ndarray
    path_length: float
    rims: np.ndarray  # gaps of `pulley_pairs`
    belt: np.ndarray  # gaps of `passes`

    @property
    def feet(self) -> np.ndarray:
        """Radii, negative on the back of the belt."""
        return self.faces * self.radii

    @property
    def closes(self) -> bool:
        """Whether the belt turns once round, or not at all where it is crossed."""
        once = 0.0 if self.crossed else 2 * np.pi
        return bool(abs(np.sum(self.faces * self.wraps) - once) <= 1.0)


def _loops(drive: Drive, at: Layout, gaps: Clearances) -> list[_Loop]:
    sizes, found = drive.loop_sizes, []
    senses = np.broadcast_to(np.asarray(drive.sense), (len(sizes),))
    faces, radii = (
        np.array([getattr(p, name) for p in drive.pulleys]) for name in ("face", "radius")
    )
    crossed = np.asarray(Loops(tuple(sizes)).crossed(drive.faces))
    rims_end = belt_end = 0
    for belt, (size, start) in enumerate(
        zip(sizes, Loops(tuple(sizes)).starts.tolist(), strict=True)
    ):
        here = slice(start, start + size)
        rims_start, belt_start = rims_end, belt_end
        rims_end, belt_end = rims_end + size * (size - 1) // 2, belt_end + size * (size - 2)
        found.append(
            _Loop(
                names=drive.pulley_names[here],
                spans=drive.span_names[here],
                sense=float(senses[belt]),
                crossed=bool(crossed[belt]),
                centers=np.asarray(at.centers)[here],
                radii=radii[here],
                faces=faces[here],
                starts=np.asarray(at.starts)[here],
                ends=np.asarray(at.ends)[here],
                wraps=np.asarray(at.wraps)[here],
                path_length=float(at.path_lengths[belt]),
                rims=np.asarray(gaps.rims)[rims_start:rims_end],
                belt=np.asarray(gaps.belt)[belt_start:belt_end],
            )
        )
    return found


def _arm_fault(drive: Drive) -> Fault | None:
    """An arm without a length, which would not move its pulleys."""
    for place, body in enumerate(drive.tensioners):
        centers = [np.asarray(p.center) for p in drive.pulleys if float(p.on[place])]
        bears = any(float(other.on[place]) for other in drive.tensioners)
        if not float(body.kind) or bears or not centers:
            continue
        if all(np.array_equal(center, np.asarray(body.pivot)) for center in centers):
            one = len(drive.tensioners) == 1 and body.name == SINGLE
            key = f"{SINGLE}.pivot" if one else f"{SINGLE}.{body.name}.pivot"
            return Fault(key, "lies at its pulley's center; an arm has a length")
    return None


def _out_of_proportion(of: _Loop) -> Fault | None:
    """A size that double precision does not resolve beside the others."""
    for key, sizes in (("center", np.max(np.abs(of.centers), axis=1)), ("radius", of.radii)):
        i = int(np.argmax(sizes))
        if not sizes[i] < _MOST_APART * np.min(of.radii):
            return Fault(
                f"pulley.{of.names[i]}.{key}",
                f"is out of all proportion, {sizes[i]:g} m beside a radius of "
                f"{np.min(of.radii):g} m, which double precision does not resolve; a bare number "
                "is in meters",
            )
    if not np.isfinite(of.path_length):
        return Fault("pulley", "a center or radius is out of all proportion; give meters")
    return None


def _overlap(of: _Loop) -> Fault | None:
    for (i, j), gap in zip(pulley_pairs([len(of.names)]), of.rims, strict=True):
        if gap <= 0:
            return Fault(
                f"pulley.{of.names[j]}.center",
                f"overlaps pulley {of.names[i]!r} by {-1e3 * gap:.3g} mm; move them apart",
            )
    return None


def _missing_tangent(of: _Loop) -> Fault | None:
    for i, name in enumerate(of.spans):
        j = (i + 1) % len(of.spans)
        apart = np.linalg.norm(of.centers[j] - of.centers[i])
        needed = abs(of.feet[j] - of.feet[i])
        if apart <= needed:
            return Fault(
                f"pulley.{of.names[j]}.center",
                f"span {name} has no tangent: centers are {1e3 * apart:.4g} mm apart and must be "
                f"more than {1e3 * needed:.4g} mm; move them apart",
            )
    return None


def _lost_contact(of: _Loop) -> Fault | None:
    i = int(np.argmin(of.wraps))
    if of.wraps[i] > 0 or not of.closes:
        return None
    wrap = f"wrap {np.degrees(of.wraps[i]):.1f} deg"
    missed = _missed_by(of, i)
    by = f"it misses it by {1e3 * missed:.3g} mm, {wrap}" if missed > 0 else wrap
    return Fault(
        f"pulley.{of.names[i]}.center",
        f"the belt does not touch this pulley ({by}); move it into the belt or change its face",
    )


def _missed_by(of: _Loop, i: int) -> float:
    """Gap [m] between a pulley and the belt that would run past it; 0 where there is no such belt.

    That belt runs from the pulley before to the one after; it is found as the path itself is.
    """
    before, after = i - 1, (i + 1) % len(of.feet)
    (across, up), rise = of.centers[after] - of.centers[before], of.feet[after] - of.feet[before]
    square = across**2 + up**2
    if not square > rise**2:
        return 0.0
    length = np.sqrt(square - rise**2)
    along = np.array(
        [length * across + of.sense * rise * up, length * up - of.sense * rise * across]
    )
    inward = of.sense * np.array([-along[1], along[0]]) / square
    height = (of.centers[i] - of.centers[before]) @ inward + of.feet[before]
    return float(np.sign(of.feet[i]) * (height - of.feet[i]))


def _path_fault(of: _Loop) -> Fault | None:
    if of.closes:
        return None
    return Fault(
        "pulley",
        "the belt path crosses itself or does not close; check the pulleys' order, 'listed' "
        "and the faces",
    )


def _obstruction(of: _Loop) -> Fault | None:
    if not of.belt.size or of.belt.min() > 0:
        return None
    k = int(np.argmin(of.belt))
    span, pulley = passes([len(of.names)])[k]
    return Fault(
        f"pulley.{of.names[pulley]}.center",
        f"span {of.spans[span]} runs through this pulley by {-1e3 * of.belt[k]:.3g} mm; "
        "move it out of the belt",
    )


def _crossing(of: _Loop) -> Fault | None:
    pairs = np.argwhere(np.triu(crossings(of.starts, of.ends)))
    if not len(pairs) or of.crossed:
        return None
    first, second = (of.spans[k] for k in pairs[0])
    return Fault(
        "pulley",
        f"the belt path crosses itself: spans {first} and {second}; check the pulleys' order, "
        "'listed' and the faces",
    )


_CHECKS = (
    _out_of_proportion,
    _overlap,
    _missing_tangent,
    _lost_contact,
    _crossing,
    _path_fault,
    _obstruction,
)
