"""Memory of long runs: a process that goes on asking does not grow.

One claim: new numbers cost no memory. Each row is one process of its own that asks again and again,
with new numbers each time, and reports its resident memory after a tenth of the calls and after all
of them; "growth" is the difference, in all and for one call. The error is that of the last answer
against the same question asked first in a process: it is the same to the bit, since nothing is left
over from call to call.

  analyses       `steady_state` and `modes` of another drive each time
  problems       `solve_bvp` of another right-hand side each time, a new Python function
  designs        `explore` of so many designs, Gamma and hub load, into a store

    python benchmarks/memory.py [--analyses 1000] [--problems 300] [--designs 100000]
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from timing import print_table, resident_memory  # noqa: E402

import beltjax as bj  # noqa: E402
from beltjax.drive.numbers import with_numbers  # noqa: E402

DRIVE = Path(__file__).parents[1] / "examples" / "three_pulley.toml"


class Found(NamedTuple):
    """What a process held [MiB], and how far off its last answer is."""

    early: float
    late: float
    error: float


def analyses(count: int) -> Found:
    """States and modes of one drive after the other."""
    drive, point = bj.load_drive(DRIVE)
    assert drive.tensioner is not None
    nominal = drive.tensioner.stiffness

    def ask(k: int) -> np.ndarray:
        stiffness = nominal * (1 + 1e-4 * k)
        other = eqx.tree_at(lambda d: d.tensioner.stiffness, drive, stiffness)
        lin = bj.linearize(bj.steady_state(other, point), bj.Legendre(12))
        return np.asarray(bj.modes(lin, 4).frequencies)

    return held(ask, count)


def problems(count: int) -> Found:
    """Bratu's problem with a right-hand side of its own each time."""
    guess = (np.array([0.0, 1.0]), np.zeros((2, 2)))

    def ask(k: int) -> np.ndarray:
        factor = 1 + 1e-3 * k

        def rhs(x, y, p, args):
            return jnp.stack([y[1], -factor * jnp.exp(y[0])])

        def bc(ya, yb, p, args):
            return jnp.stack([ya[0], yb[0]])

        return np.asarray(bj.solve_bvp(rhs, bc, (0.0, 1.0), guess).y)

    return held(ask, count)


def held(ask: Callable[[int], np.ndarray], count: int) -> Found:
    """Memory over `count` calls; the last question is that of the first call, too."""
    first = last = ask(count - 1)
    early = 0.0
    for k in range(count):
        last = ask(k)
        if k == count // 10:
            early = resident_memory()
    error = float(np.max(np.abs(first - last)))
    return Found(early, resident_memory(), error)


def designs(count: int) -> Found:
    """One exploration; memory after a tenth of its batches and after all."""
    drive, point = bj.load_drive(DRIVE)
    names = {"installation.tension": (250.0, 450.0), "tensioner.angle": (-0.5, 0.5)}
    told: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        data = bj.optimize.explore(
            drive, point, bj.optimize.Samples(names, count), ["coupling", "hub_load:tensioner"],
            f"{folder}/store.zarr", advance=lambda *_: told.append(resident_memory()),
        )  # fmt: skip
        late = told[-1]  # before the store is read for the error
        k = int(np.flatnonzero(data.result.values == 0)[-1])
        changed = {name: data[name][k].item() for name in names}
        kept = data.coupling[k].item()
    alone = bj.steady_state(*with_numbers(drive, point, changed))
    error = abs(kept / float(alone.coupling.sum()) - 1)
    return Found(told[max(len(told) // 10, 2)], late, error)


ROWS = {"analyses": analyses, "problems": problems, "designs": designs}


def main() -> None:
    """Print one row a kind of work."""
    parser = argparse.ArgumentParser(description="Memory of long runs.")
    parser.add_argument("--analyses", type=int, default=1000)
    parser.add_argument("--problems", type=int, default=300)
    parser.add_argument("--designs", type=int, default=100_000)
    parser.add_argument("--one", choices=ROWS, help=argparse.SUPPRESS)  # in its own process
    given = parser.parse_args()
    if given.one:
        print(json.dumps(ROWS[given.one](getattr(given, given.one))))
        return
    rows = []
    for name in ROWS:
        count = getattr(given, name)
        if not count:
            continue
        words = [sys.executable, __file__, "--one", name, f"--{name}", str(count)]
        printed = subprocess.run(words, check=True, capture_output=True, text=True).stdout
        found = Found(*json.loads(printed.splitlines()[-1]))
        growth = found.late - found.early
        each = f"{2**20 * growth / (0.9 * count):.0f}"
        numbers = (f"{x:.1f}" for x in (found.early, found.late, growth))
        rows.append([name, f"{count:,}", f"{found.error:.0e}", *numbers, each])
        print("  ".join(rows[-1]), flush=True)
    columns = ("work", "calls", "error", "after a tenth (MiB)", "after all", "growth", "B/call")
    print_table(f"Memory, {jax.default_backend()}", columns, rows)


if __name__ == "__main__":
    main()
