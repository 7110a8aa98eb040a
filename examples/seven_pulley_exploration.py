"""A hundred thousand designs of the seven-pulley drive, and what they trade against what.

    python examples/seven_pulley_exploration.py [--designs 100000] [--workers 2]

Writes `seven_pulley.zarr` and `seven_pulley_exploration.png` into the current folder. Killed
or interrupted, the same command goes on where it stopped.
"""

import argparse
from pathlib import Path

import jax
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

jax.config.update("jax_enable_x64", True)

import beltjax as bj  # noqa: E402

DRIVE = Path(__file__).parent / "seven_pulley.toml"
RANGES = {
    "tensioner.angle": (np.radians(-120), np.radians(120)),
    "installation.tension": (150.0, 450.0),
    "pulley.idler.center.x": (-0.10, 0.04),
    "pulley.idler.center.y": (0.28, 0.38),
    "pulley.water pump.radius": (0.050, 0.070),
}
LOAD, MARGIN = "hub_load:alternator", "slip_margin:alternator"
QUANTITIES = ("coupling", "tensioner_effectiveness", LOAD, MARGIN, "clearance")


def told(stage: str, done: int, total: int | None) -> None:
    """One line on the terminal, written over."""
    print(f"\r{stage}: {done:,} of {total:,} designs", end="", flush=True)


def front(load: np.ndarray, gamma: np.ndarray) -> np.ndarray:
    """Places of the designs that none beats in both, by rising load."""
    order = np.lexsort((gamma, load))
    best = np.minimum.accumulate(gamma[order])
    return order[np.flatnonzero(np.diff(best, prepend=np.inf) < 0)]


def picture(data, path: str) -> None:
    """Gamma against the load on the alternator's hub, and the designs that are best in both."""
    load, gamma, effectiveness = (data[QUANTITIES[i]].values for i in (2, 0, 1))
    runs = data.result.values == 0
    allowed = runs & (effectiveness >= 0.9) & (data[MARGIN].values >= 0.3)
    allowed &= data.clearance.values.min(axis=1) >= 0.008
    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    dots = {"s": 1.5, "linewidths": 0, "rasterized": True}
    left = runs & ~allowed
    axes.scatter(load[left], gamma[left], color="#c8c8c8", label="misses a limit", **dots)
    shown = axes.scatter(load[allowed], gamma[allowed], c=effectiveness[allowed], **dots)
    figure.colorbar(shown, ax=axes, label="tensioner effectiveness")
    best = np.flatnonzero(allowed)[front(load[allowed], gamma[allowed])]
    axes.plot(load[best], gamma[best], color="black", linewidth=1.4, label="best in both")
    axes.set_xlabel("load on the alternator's hub (N)")
    axes.set_ylabel("coupling Gamma")
    counts = f"{len(runs):,} designs, {runs.sum():,} run, {allowed.sum():,} within all limits"
    axes.set_title(counts, fontsize=10)
    axes.legend(frameon=False, markerscale=6)
    figure.savefig(path, dpi=100)


def main() -> None:
    """Explore and draw."""
    parser = argparse.ArgumentParser(description="A hundred thousand designs of a drive.")
    parser.add_argument("--designs", type=int, default=100_000)
    parser.add_argument("--workers", type=int, default=0, help="processes, by Dask")
    given = parser.parse_args()
    drive, point = bj.load_drive(DRIVE)
    data = bj.optimize.explore(
        drive,
        point,
        bj.optimize.Samples(RANGES, given.designs),
        QUANTITIES,
        "seven_pulley.zarr",
        workers=given.workers,
        advance=told,
    )
    print()
    picture(data, "seven_pulley_exploration.png")


if __name__ == "__main__":
    main()
