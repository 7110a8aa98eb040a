"""Modes of a sweep, matched one to one by shape from point to point, on the host."""

import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int

# Below this agreement of shapes a mode has left the window, or a new one has entered it.
LOST = 0.25
# Relative gap below which a frequency is repeated, so that its two shapes are not unique.
_REPEATED = 1e-7
# Shapes are compared where the gap of a veering has doubled: there two modes that exchange their
# shapes have turned by 60 deg of the whole 90.
_OPEN = 2.0
_EXCHANGED = 0.5


class ModeShapes(NamedTuple):
    """Modes at one point of a sweep, lowest frequency first, with the matrices of that point."""

    omega: Float[np.ndarray, " window"]  # dimensionless
    vectors: Complex[np.ndarray, "window size"]
    mass: Float[np.ndarray, "size size"]
    stiffness: Float[np.ndarray, "size size"]


class Links(NamedTuple):
    """Numbers that identify the modes of a sweep; -1 and nan at points that failed."""

    names: Int[np.ndarray, "points window"]  # of the mode at each place in the window
    mac: Float[np.ndarray, "points window"]  # with the last good point; 0 for a new mode
    weakest: Float[np.ndarray, " points-1"]  # least agreement of the lowest modes; nan: a failure


class Veering(NamedTuple):
    """Two modes whose frequencies come close, separate again, and that exchange their shapes."""

    value: float  # of the swept number, where they are closest
    modes: tuple[int, int]  # places in `Sweep.frequencies`, the lower one first
    gap: float  # smallest difference of their frequencies [rad/s]
    resolved: bool  # whether the grid follows the shapes there; else the gap is an upper bound


def overlaps(a: ModeShapes, b: ModeShapes) -> Complex[np.ndarray, "window window"]:
    """Products of the modes of two points in energy, each mode of energy 1.

    v_a* M v_b alone is not zero between two modes of one gyroscopic system, but their states
    (omega v, v) are orthogonal in M and K together, omega_a omega_b v_a* M v_b + v_a* K v_b. The
    matrices are the mean of those of both points, so that the square of a product never exceeds
    1.
    """
    M, K = (a.mass + b.mass) / 2, (a.stiffness + b.stiffness) / 2

    def product(left: ModeShapes, right: ModeShapes) -> np.ndarray:
        speeds = np.outer(left.omega, right.omega)
        moving = left.vectors.conj() @ M @ right.vectors.T
        return speeds * moving + left.vectors.conj() @ K @ right.vectors.T

    def size(one: ModeShapes) -> np.ndarray:
        v = one.vectors
        moving = np.einsum("ka,ka->k", v.conj(), v @ M).real
        return one.omega**2 * moving + np.einsum("ka,ka->k", v.conj(), v @ K).real

    return product(a, b) / np.sqrt(np.outer(size(a), size(b)))


def agreement(a: ModeShapes, b: ModeShapes) -> Float[np.ndarray, "window window"]:
    """Modal assurance criterion of every mode of `a` with every mode of `b`, 0 to 1."""
    return np.abs(overlaps(a, b)) ** 2


def aligned(before: ModeShapes, here: ModeShapes) -> ModeShapes:
    """`here`, with the shapes of a repeated frequency turned to those of `before`.

    Where frequencies cross exactly on a point, an eigensolver returns any mixture of their shapes.
    """
    starts = np.flatnonzero(np.diff(here.omega, prepend=-np.inf) > _REPEATED * here.omega)
    vectors = here.vectors.copy()
    for group in np.split(np.arange(len(here.omega)), starts[1:]):
        if len(group) > 1:
            products = overlaps(before, here)[:, group]
            rows = np.sort(np.argsort(-np.sum(np.abs(products) ** 2, axis=1))[: len(group)])
            # This unitary mixture is the nearest to the shapes of `before`.
            left, _, right = np.linalg.svd(products[rows])
            vectors[group] = (left @ right).conj() @ vectors[group]
    return here._replace(vectors=vectors)


def linked(shapes: list[ModeShapes | None], count: int) -> tuple[Links, list[ModeShapes | None]]:
    """Names for the modes along a sweep, by one-to-one assignment between neighbors.

    `shapes` holds None for points that failed; a match bridges them. The second part returned is
    the shapes as they were matched. The name of a mode is its place at the first good point, and
    for modes that come later the next free number.
    """
    from scipy.optimize import linear_sum_assignment  # takes 1/3 s; only sweeps need it

    shapes = list(shapes)
    window = max((len(one.omega) for one in shapes if one is not None), default=0)
    names = np.full((len(shapes), window), -1)
    mac = np.full((len(shapes), window), np.nan)
    weakest = np.full(max(len(shapes) - 1, 0), np.nan)
    last, free = None, 0
    for p, here in enumerate(shapes):
        if here is None:
            continue
        if last is None:
            names[p], free = np.arange(window), window
        else:
            before = shapes[last]
            assert before is not None
            shapes[p] = here = aligned(before, here)
            matrix = agreement(before, here)
            rows, columns = linear_sum_assignment(-matrix)
            match = matrix[rows, columns]
            kept = match >= LOST
            mac[p] = 0.0
            mac[p, columns[kept]] = match[kept]
            names[p, columns[kept]] = names[last, rows[kept]]
            new = names[p] < 0
            names[p, new] = free + np.arange(new.sum())
            free += int(new.sum())
            if last == p - 1:
                low = (rows < count) | (columns < count)
                weakest[last] = np.min(np.where(kept, match, 0.0)[low])
        last = p
    return Links(names, mac, weakest), shapes


def tracks(links: Links, count: int) -> Int[np.ndarray, "points modes"]:
    """Place in the window of each mode that is among the `count` lowest at some point; -1: absent.

    The columns are in the order of the modes' names.
    """
    low = links.names[:, :count]
    wanted = np.unique(low[low >= 0])
    if not len(wanted):  # no point succeeded
        return np.zeros((len(low), 0), int)
    found = links.names[:, None, :] == wanted[None, :, None]
    return np.where(found.any(axis=2), found.argmax(axis=2), -1)


def veerings(
    values: np.ndarray,
    frequencies: Float[np.ndarray, "points modes"],
    places: Int[np.ndarray, "points modes"],
    shapes: list[ModeShapes | None],
    trusted: np.ndarray,
) -> tuple[Veering, ...]:
    """Veerings between neighboring modes, in the order of the swept number.

    `trusted` [points - 1] says between which points the shapes could be followed. Modes that
    cross there do not veer; modes that cross elsewhere veer too sharply for the grid.
    """
    found = []
    for p in range(len(values) - 1):
        present = np.flatnonzero(places[p] >= 0)
        order = present[np.argsort(places[p, present])]
        for low, high in itertools.pairwise(order):
            if places[p, high] != places[p, low] + 1:
                continue  # another mode of the window, which is not reported, lies between
            difference = frequencies[:, high] - frequencies[:, low]
            if difference[p + 1] < 0 and not trusted[p]:
                place = p if difference[p] < -difference[p + 1] else p + 1
                gap = float(np.abs(difference[place]))
                found.append(Veering(float(values[place]), (int(low), int(high)), gap, False))
            elif p and _exchange(difference, places[:, [low, high]], shapes, p):
                value, gap = _closest(values[p - 1 : p + 2], difference[p - 1 : p + 2])
                resolved = bool(trusted[p - 1] and trusted[p])
                found.append(Veering(value, (int(low), int(high)), gap, resolved))
    return tuple(found)


def _exchange(
    difference: Float[np.ndarray, " points"],
    places: Int[np.ndarray, "points 2"],
    shapes: list[ModeShapes | None],
    p: int,
) -> bool:
    """Whether a gap is smallest at point p, and two modes exchange their shapes around it."""
    near = difference[p - 1 : p + 2]
    if not (np.all(near > 0) and near[0] >= near[1] < near[2]):
        return False
    left, right = (_opened(difference, p, step) for step in (-1, 1))
    a, b = shapes[left], shapes[right]
    assert a is not None  # both have finite frequencies
    assert b is not None
    products = agreement(a, b)
    (low, high), (low_after, high_after) = places[left], places[right]
    return bool(min(products[low, high_after], products[high, low_after]) >= _EXCHANGED)


def _opened(difference: Float[np.ndarray, " points"], p: int, step: int) -> int:
    """The first point to one side of p where a gap has doubled, or where it stops growing."""
    at = p
    while (
        0 <= at + step < len(difference)
        and difference[at + step] > difference[at]  # False for nan, too
        and difference[at] < _OPEN * difference[p]
    ):
        at += step
    return at


def _closest(x: np.ndarray, gaps: np.ndarray) -> tuple[float, float]:
    """Place and size of the smallest gap, whose square is a parabola for two isolated modes."""
    middle = x[1]
    a, b, c = np.polyfit(x - middle, gaps**2, 2)
    place = np.clip(-b / (2 * a), x[0] - middle, x[2] - middle)
    return float(middle + place), float(np.sqrt(max(a * place**2 + b * place + c, 0.0)))
