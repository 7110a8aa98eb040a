"""Explorations of the seven-pulley drive: designs per second, and memory against their number.

Two claims: a hundred thousand designs take seconds, written and all; and memory does not grow with
the number of designs: "growth" is what the process gains between its first batch and its last.
(Above 200,000 designs the program is compiled for speed, and the compiler takes more memory.) Each
row is one process of its own, from start to the finished store; the error is that of a few designs
of the store against `steady_state` and `modes` of the design alone. The rate is that of the batches
after the first, which waits for the compiler. Workers are processes of their own, whose memory is
not in the table.

    python benchmarks/sweeps.py [--designs 100000] [--modes 512]
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich.console import Console
from rich.table import Table
from timing import resident_memory

import beltjax as bj
from beltjax.drive.numbers import with_numbers

DRIVE = Path(__file__).parents[1] / "examples" / "seven_pulley.toml"
RANGES = {
    "pulley.idler.center.x": (-0.06, 0.0),
    "tensioner.angle": (-0.7, 0.7),
    "installation.tension": (250.0, 450.0),
    "pulley.water pump.radius": (0.05, 0.07),
}
QUANTITIES = ("coupling", "tensioner_effectiveness", "hub_load:alternator", "clearance")
MODES = 4
CHECKED = 5  # designs looked at alone


def explored(store: str, count: int, modes: int, workers: int) -> dict[str, Any]:
    """One exploration in this process: rate, seconds, memory, error."""
    drive, point = bj.load_drive(DRIVE)
    designs, told, held = bj.optimize.Samples(RANGES, count), [], []

    def advance(stage, done, total):
        told.append((time.perf_counter(), done))
        held.append(resident_memory())

    began = time.perf_counter()
    data = bj.optimize.explore(
        drive,
        point,
        designs,
        QUANTITIES,
        store,
        modes=modes,
        workers=workers or None,
        advance=advance,
    )
    spent = time.perf_counter() - began
    # Two workers bring their first batches at about the same time.
    (first, before), (last, after) = told[1 + workers], told[-1]
    rate = (after - before) / (last - first) if last > first else float("nan")
    growth = held[-1] - held[1 + workers]
    wrong = error(data, modes)
    return {"rate": rate, "seconds": spent, "memory": held[-1], "growth": growth, "error": wrong}


def error(data: Any, modes: int) -> float:
    """Largest relative difference to the designs solved alone."""
    drive, point = bj.load_drive(DRIVE)
    worst = 0.0
    for k in np.flatnonzero(data.result.values == 0)[:CHECKED]:
        numbers = {name: data[name][k].item() for name in RANGES}
        one = with_numbers(drive, point, numbers)
        steady = bj.steady_state(*one)
        pairs = [(data.coupling[k].item(), float(steady.coupling.sum()))]
        if modes:
            alone = bj.modes(bj.linearize(steady, bj.Legendre(24)), modes).frequencies
            pairs += list(zip(data.frequency[k].values, alone.tolist(), strict=True))
        worst = max([worst, *(abs(a / b - 1) for a, b in pairs)])
    return worst


def in_its_own_process(count: int, modes: int, workers: int) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        words = [sys.executable, __file__, "--one", f"{folder}/store.zarr"]
        words += ["--designs", str(count), "--modes", str(modes), "--workers", str(workers)]
        found = subprocess.run(words, check=True, capture_output=True, text=True)
        size = sum(path.stat().st_size for path in Path(folder).rglob("*") if path.is_file())
    return json.loads(found.stdout.splitlines()[-1]) | {"size": size / 2**20}


def main() -> None:
    """Print one row per run."""
    parser = argparse.ArgumentParser(description="Rates and memory of explorations.")
    parser.add_argument("--designs", type=int, default=100_000)
    parser.add_argument("--modes", type=int, default=512, help="Designs of which modes are asked.")
    parser.add_argument("--workers", type=int, default=0, help=argparse.SUPPRESS)
    parser.add_argument("--one", help=argparse.SUPPRESS)  # the store of a run in its own process
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    if given.one:
        print(json.dumps(explored(given.one, given.designs, given.modes, given.workers)))
        return
    rows = [
        ("one process", given.designs // 10, 0, 0),
        ("one process", given.designs, 0, 0),
        ("one process", 10 * given.designs, 0, 0),
        ("two Dask workers", given.designs, 0, 2),
        (f"one process, {MODES} modes", given.modes, MODES, 0),
        (f"two Dask workers, {MODES} modes", given.modes, MODES, 2),
    ]
    table = Table(title=f"Explorations of seven pulleys, {jax.default_backend()}", box=None)
    columns = "way", "designs", "error", "designs/s", "all (s)", "memory (MiB)", "growth", "store"
    for column in columns:
        table.add_column(column, justify="left" if column == "way" else "right", no_wrap=True)
    for way, count, modes, workers in rows:
        found = in_its_own_process(count, modes, workers)
        numbers = (f"{found[key]:,.0f}" for key in ("rate", "seconds", "memory", "growth", "size"))
        table.add_row(way, f"{count:,}", f"{found['error']:.0e}", *numbers)
    console = Console()
    console.width = max(console.width, 100)
    console.print(table)


if __name__ == "__main__":
    main()
