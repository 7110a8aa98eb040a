"""The designs of an exploration: every combination of values, or a quasi-random sample."""

import dataclasses
import math
import warnings
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.stats import qmc

# A Sobol sequence of SciPy's default 30 bits ends there. Grids end there, too: their answers to one
# quantity take 8 GB.
MOST_DESIGNS = 2**30

Span = tuple[int, int]  # of designs, the end excluded


@dataclasses.dataclass(frozen=True, eq=False)
class Grid:
    """Every combination of the values of some numbers, by their keys in the drive file [SI].

    The last number varies fastest. Raises `ValueError` for an axis that is empty or not finite,
    and for more than 2^30 designs.
    """

    values: Mapping[str, Any]  # [points] for each number

    def __post_init__(self):
        axes = {name: np.asarray(axis, dtype=float) for name, axis in self.values.items()}
        _require_any(axes)
        for name, axis in axes.items():
            if axis.ndim != 1 or not axis.size or not np.all(np.isfinite(axis)):
                raise ValueError(f"{name}: give a list of at least one finite value.")
        object.__setattr__(self, "values", axes)
        if self.total > MOST_DESIGNS:
            shape = " x ".join(map(str, self.shape))
            message = f"grid: found {shape} = {self.total:.4g} designs, {_size(self)} of numbers"
            raise ValueError(f"{message}; give at most 2^30, by fewer points or as a sample.")

    @property
    def names(self) -> tuple[str, ...]:
        """Keys of the numbers."""
        return tuple(self.values)

    @property
    def shape(self) -> tuple[int, ...]:
        """Points on each axis."""
        return tuple(len(axis) for axis in self.values.values())

    @property
    def total(self) -> int:
        """Number of designs."""
        return math.prod(self.shape)

    def record(self) -> dict[str, Any]:
        """The designs described by plain data."""
        return {"grid": {name: axis.tolist() for name, axis in self.values.items()}}

    def walk(self, spans: Iterable[Span]) -> Iterator[Float[np.ndarray, "designs numbers"]]:
        """The designs of each span."""
        for span in spans:
            places = np.unravel_index(np.arange(*span), self.shape)
            columns = zip(self.values.values(), places, strict=True)
            yield np.stack([axis[place] for axis, place in columns], axis=1)


@dataclasses.dataclass(frozen=True, eq=False)
class Samples:
    """A quasi-random sample, scrambled Sobol, of a box of numbers [SI].

    Raises `ValueError` for a range that is not finite or does not end above where it begins, for
    fewer than one or more than 2^30 designs, and for a seed below 0.
    """

    ranges: Mapping[str, tuple[float, float]]  # lower and upper end for each number
    count: int
    seed: int = 0

    def __post_init__(self):
        _require_any(self.ranges)
        for name, (low, high) in self.ranges.items():
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise ValueError(f"{name}: found {low:g} to {high:g}; give lower, then upper end.")
        if not 1 <= self.count <= MOST_DESIGNS:
            size = f", {_size(self)} of numbers" if self.count > 1 else ""
            raise ValueError(f"samples: found {self.count}{size}; give 1 to 2^30.")
        require_seed(self.seed)

    @property
    def names(self) -> tuple[str, ...]:
        """Keys of the numbers."""
        return tuple(self.ranges)

    @property
    def total(self) -> int:
        """Number of designs."""
        return self.count

    def record(self) -> dict[str, Any]:
        """The designs described by plain data."""
        ranges = {name: [float(end) for end in ends] for name, ends in self.ranges.items()}
        return {"sobol": ranges, "samples": int(self.count), "seed": int(self.seed)}

    def walk(self, spans: Iterable[Span]) -> Iterator[Float[np.ndarray, "designs numbers"]]:
        """The designs of each span; spans must increase."""
        lower, upper = np.array(list(self.ranges.values()), dtype=float).T
        for points in sobol(len(lower), self.seed, spans):
            yield lower + points * (upper - lower)


def sobol(
    dimensions: int, seed: int, spans: Iterable[Span]
) -> Iterator[Float[np.ndarray, "points dimensions"]]:
    """Points of a scrambled Sobol sequence in the unit cube, for each of increasing spans."""
    sampler, reached = qmc.Sobol(dimensions, rng=seed), 0
    for start, stop in spans:
        if start > reached:  # SciPy cannot go forward by nothing
            sampler.fast_forward(start - reached)
        with warnings.catch_warnings():  # that a part of a sequence is balanced less than all of it
            warnings.simplefilter("ignore", UserWarning)
            yield sampler.random(stop - start)
        reached = stop


Designs = Grid | Samples


def require_seed(seed: int) -> None:
    """Raise `ValueError` for a seed that random numbers cannot begin with."""
    if seed < 0:
        raise ValueError(f"seed: found {seed}; give 0 or more.")


def _size(designs: Designs) -> str:
    return f"{8e-9 * designs.total * len(designs.names):.4g} GB"


def _require_any(numbers: Mapping[str, Any]) -> None:
    if not numbers:
        raise ValueError("designs: vary at least one number.")
