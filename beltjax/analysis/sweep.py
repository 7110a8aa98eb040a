"""Steady states and modes over the values of one number, where each mode is followed."""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from beltjax.analysis.linearization import linearize
from beltjax.analysis.modes import mode_label, modes
from beltjax.analysis.steady import steady_state
from beltjax.analysis.tracking import ModeShapes, Veering, linked, tracks, veerings
from beltjax.compiling.quick import in_chunks, quickly_compiled, usual_promotion
from beltjax.drive.canonical import canonical
from beltjax.drive.numbers import canonical_key, require_number, unit_of, with_number
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.numerics.bases import AbstractBasis, Legendre
from beltjax.results import RESULTS, explanations, successes

if TYPE_CHECKING:
    import xarray

BASIS = Legendre(24)
CHUNK = 16  # points solved at once; every call has this many, so that one program serves all
_SPARE = 4  # modes computed beside those reported, so that one may leave without a false match


@dataclasses.dataclass(frozen=True, eq=False)
class Sweep:
    """Steady states and modes over the values of one number, all arrays NumPy's.

    A column of [points, modes] is one mode, recognized by its shape from point to point: first
    the `count` lowest at the first value, then those that come among the `count` lowest later. An
    entry is nan where its mode is not among those computed, and at points that failed.
    """

    name: str  # of the swept number, by its key in the drive file
    unit: str  # SI; empty for a pure number
    values: Float[np.ndarray, " points"]  # [SI], with those inserted where shapes change fast
    frequencies: Float[np.ndarray, "points modes"]  # [rad/s]
    dimensionless: Float[np.ndarray, "points modes"]
    coupling: Float[np.ndarray, "points spans"]  # Gamma_i
    stiffness_ratios: Float[np.ndarray, "points pulleys"]  # as `SteadyState` has
    mac: Float[np.ndarray, "points-1 modes"]  # agreement of shapes with the last good point, to 1
    labels: tuple[str, ...]  # what moves most in each mode, where it first appears
    veerings: tuple[Veering, ...]
    error: Float[np.ndarray, "points modes"]  # relative, of the frequencies, estimated
    span_names: tuple[str, ...]
    result: RESULTS  # of every point

    @property
    def good(self) -> np.ndarray:
        """Whether each point succeeded [points]."""
        return successes(self.result)

    @property
    def outcomes(self) -> tuple[str, ...]:
        """Why each point failed; empty where it did not."""
        return explanations(self.result)

    def to_xarray(self) -> "xarray.Dataset":
        """The sweep with named axes, units in the attributes; modes are counted from 1."""
        import xarray  # brings in pandas, which takes as long to load as JAX

        modes = np.arange(1, self.frequencies.shape[1] + 1)
        outcome = np.array([text or "found" for text in self.outcomes])
        pairs = np.array([veering.modes for veering in self.veerings], int).reshape(-1, 2) + 1
        at = np.array([veering.value for veering in self.veerings])
        gaps = np.array([veering.gap for veering in self.veerings])
        axes = ("value", "mode")
        named = {"long_name": self.name, "units": self.unit or "1"}
        return xarray.Dataset(
            {
                "frequency": (axes, self.frequencies, {"units": "rad/s"}),
                "dimensionless": (axes, self.dimensionless, {"units": "1"}),
                "error": (axes, self.error, {"units": "1", "long_name": "relative error"}),
                "mac": (("interval", "mode"), self.mac, {"units": "1"}),
                "coupling": (("value", "span"), self.coupling, {"units": "1"}),
                "outcome": ("value", outcome),
                "veering_value": ("veering", at, named),
                "veering_modes": (("veering", "pair"), pairs),
                "veering_gap": ("veering", gaps, {"units": "rad/s"}),
            },
            coords={
                "value": ("value", self.values, named),
                "mode": ("mode", modes),
                "span": ("span", list(self.span_names)),
                "label": ("mode", list(self.labels)),
            },
            attrs={"over": self.name},
        )


class Sample(NamedTuple):
    """Results that a sweep keeps of one point, or of many along a leading axis."""

    frequencies: Float[Array, "*points window"]  # [rad/s]
    dimensionless: Float[Array, "*points window"]
    coordinates: Complex[Array, "*points window size"]
    mass: Float[Array, "*points size size"]
    stiffness: Float[Array, "*points size size"]
    coupling: Float[Array, "*points spans"]
    stiffness_ratios: Float[Array, "*points pulleys"]
    span_shares: Float[Array, "*points window spans"]
    rigid_shares: Float[Array, "*points window"]
    error: Float[Array, "*points window"]
    result: RESULTS


@usual_promotion
def sweep(
    drive: Drive,
    point: OperatingPoint,
    name: str,
    values: Sequence[float] | Array | np.ndarray,
    *,
    count: int = 8,
    basis: AbstractBasis | None = None,
    limit: float = 0.9,
    depth: int = 8,
    advance: Callable[[str, int, int | None], None] | None = None,
) -> Sweep:
    """Steady state and the `count` lowest modes over increasing `values` [SI] of one number.

    Between neighboring values modes are matched one to one by shape. Where a match falls below
    `limit` values are inserted halfway, up to `depth` times, so that the modes are followed through
    a veering. It cannot be traced by JAX, since the grid depends on the results. A point that fails
    raises nothing: read `.result`, one per point. A layout is checked for its path, but not for
    pulleys that overlap. docs/vibration.md.

    Args:
        drive: the drive.
        point: speeds and torques.
        name: the number's key in the drive file: "operation.belt_speed",
            "pulley.NAME.center.x", "operation.torque.NAME"; "tensioner.angle" turns the tensioner
            about its pulley's center, from 0 as drawn.
        values: at least two increasing values [SI].
        count: number of modes that are followed.
        basis: functions for the deflections of each span, `Legendre(24)` unless given.
        limit: agreement of shapes, between 0 and 1, below which a value is inserted.
        depth: how often values are inserted at most.
        advance: function that is called as `advance(stage, done, total)` before each chunk of
            points and at the end.

    Returns:
        NumPy arrays with the values, those inserted too, along the first axis.

    Raises:
        ValueError: there is no number of that name, values are fewer than two, not finite or not
            increasing, `count` is above the number of modes, an inertia is missing, or `limit` or
            `depth` is out of range.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> swept = bj.sweep(drive, point, "operation.belt_speed", [0.0, 20.0, 40.0], count=4)
        >>> swept.frequencies  # [points, modes] [rad/s]
    """
    require_number(drive, name)
    grid = _required_grid(values)
    basis = BASIS if basis is None else basis
    window = min(count + _SPARE, require_count(drive, count, basis))
    if not 0 < limit < 1 or depth < 0:
        raise ValueError(f"limit, depth: found {limit}, {depth}; give 0 < limit < 1, depth >= 0.")
    advance = advance or (lambda stage, done, total: None)
    evaluate = _Evaluation(drive, point, name, window, basis, advance)
    found = evaluate("sweeping", grid)
    links, shapes = linked(_shapes(found), count)
    for level in range(depth):
        jumps = np.flatnonzero(links.weakest < limit)
        if not len(jumps):
            break
        middles = (grid[jumps] + grid[jumps + 1]) / 2
        added = evaluate(f"following veerings, step {level + 1}", middles)
        order = np.argsort(np.concatenate([grid, middles]), kind="stable")
        grid = np.concatenate([grid, middles])[order]
        found = jax.tree.map(lambda a, b, order=order: np.concatenate([a, b])[order], found, added)
        links, shapes = linked(_shapes(found), count)
    places = tracks(links, count)
    frequencies = _picked(found.frequencies, places)
    return Sweep(
        name=name,
        unit=unit_of(drive, name),
        values=grid,
        frequencies=frequencies,
        dimensionless=_picked(found.dimensionless, places),
        coupling=np.where(_good(found)[:, None], found.coupling, np.nan),
        stiffness_ratios=np.where(_good(found)[:, None], found.stiffness_ratios, np.nan),
        mac=_picked(links.mac, places)[1:],
        labels=_labels(found, places),
        veerings=veerings(grid, frequencies, places, shapes, ~(links.weakest < limit)),
        error=_picked(found.error, places),
        span_names=drive.span_names,
        result=found.result,
    )


def _required_grid(values: Any) -> Float[np.ndarray, " points"]:
    grid = np.asarray(values, dtype=float)
    if grid.ndim != 1 or len(grid) < 2:
        raise ValueError(f"values: found shape {grid.shape}; give a list of at least 2.")
    if not np.all(np.isfinite(grid)) or not np.all(np.diff(grid) > 0):
        raise ValueError("values: must be finite and increasing.")
    return grid


def require_count(drive: Drive, count: int, basis: AbstractBasis = BASIS) -> int:
    """Number of modes of the drive; raises `ValueError` unless `count` is from 1 to that number."""
    turning = len(drive.shafts) - 1 + len(drive.isolators) + len(drive.dampers)
    size = len(drive.pulleys) * basis.size + turning + len(drive.tensioners)
    if not 1 <= count <= size:
        raise ValueError(f"count: found {count}; give 1 to {size}, or a larger basis.")
    return size


class _Evaluation(NamedTuple):
    """Solves the points of one sweep, chunk by chunk."""

    drive: Drive
    point: OperatingPoint
    name: str
    window: int
    basis: AbstractBasis
    advance: Callable[[str, int, int | None], None]

    def __call__(self, stage: str, values: np.ndarray) -> Sample:
        def run(chunk: np.ndarray) -> Sample:
            drive, point = canonical(self.drive, self.point)
            numbers = drive, point, canonical_key(self.drive, self.name), jnp.asarray(chunk)
            return quickly_compiled(samples)(*numbers, self.window, self.basis)

        return in_chunks(run, values, CHUNK, functools.partial(self.advance, stage))


def samples(
    drive: Drive,
    point: OperatingPoint,
    name: str,
    values: Float[Array, " points"],
    window: int,
    basis: AbstractBasis,
) -> Sample:
    """What a sweep keeps of the points where the number of that canonical key has these values."""

    def at(value: Float[Array, ""]) -> Sample:
        steady = steady_state(*with_number(drive, point, name, value), throw=False)
        lin = linearize(steady, basis, throw=False)
        found = modes(lin, window, route="hermitian", throw=False)
        return Sample(
            frequencies=found.frequencies,
            dimensionless=found.dimensionless,
            coordinates=found.coordinates,
            mass=lin.mass,
            stiffness=lin.stiffness,
            coupling=steady.coupling,
            stiffness_ratios=steady.stiffness_ratios,
            span_shares=found.span_shares,
            rigid_shares=jnp.sum(found.rotor_shares, axis=1) + found.tensioner_shares,
            error=found.error,
            result=found.result,
        )

    return eqx.filter_vmap(at)(values)


def _good(found: Sample) -> np.ndarray:
    return successes(found.result)


def _shapes(found: Sample) -> list[ModeShapes | None]:
    parts = (found.dimensionless, found.coordinates, found.mass, found.stiffness)
    rows = zip(*(np.asarray(part) for part in parts), strict=True)
    return [
        ModeShapes(*row) if good else None for good, row in zip(_good(found), rows, strict=True)
    ]


def _picked(table: Any, places: np.ndarray) -> np.ndarray:
    """Columns of a table [points, window] by mode; nan where a mode is absent."""
    picked = np.take_along_axis(np.asarray(table), np.maximum(places, 0), axis=1)
    return np.where(places >= 0, picked, np.nan)


def _labels(found: Sample, places: np.ndarray) -> tuple[str, ...]:
    labels = []
    for mode, column in enumerate(places.T):
        first = int(np.argmax(column >= 0))
        place = places[first, mode]
        rigid = float(found.rigid_shares[first, place])
        labels.append(mode_label(rigid, np.asarray(found.span_shares)[first, place].tolist()))
    return tuple(labels)
