"""Batches on an accelerator, in double precision, against the same on the CPU.

One claim: batches of thousands gain from a GPU where they are of formulas and small systems, less
where they are of eigenproblems. For Gamma, modes, contact, each with its slopes by every number of
the drive, and for searches by `bj.optimize.sqp`, over batches of growing size:

  error          largest relative difference of values and slopes to the same designs on the CPU, of
                 the first few; of searches that of the objective
  compile        seconds, once per size
  run            a design, the best of three runs

What cannot run on the device is caught, and its error named in the row. A size is left out, and said
to be, where the last one suggests that it would take longer than is left of --seconds. Without
an accelerator all runs on the CPU, which tests the script.

    python benchmarks/accelerator.py [--batches 1000 10000 100000 1000000] [--seconds 420] [gamma ...]
"""

import argparse
import os
import time
from collections.abc import Callable
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from coupling import DRIVE, total_coupling, varied  # noqa: E402
from modes import FEW, SEVEN, frequencies  # noqa: E402
from timing import print_table  # noqa: E402

import beltjax as bj  # noqa: E402

CHECKED = 8  # designs that the CPU computes as well
RUNS = 3
# `bj.quick_jit` compiles quickly on the default device alone, which is not the CPU here.
QUICK = {"xla_backend_optimization_level": 0, "xla_cpu_use_fusion_emitters": False}


def efficiency(numbers):
    """Efficiency of a drive in contact."""
    return bj.contact_state(*numbers, throw=False).efficiency


def total_frequency(numbers):
    """Sum of eight frequencies, of which one reverse pass gives all slopes."""
    return jnp.sum(frequencies(numbers, FEW))


def searched(start):
    """A minimum in a ball of six dimensions: a search whose work is linear algebra alone."""
    weights = jnp.arange(1.0, 7.0)
    found = bj.optimize.sqp(
        lambda x: jnp.sum(weights * (x - 1) ** 2) + jnp.sum(x) ** 3 / 10,
        lambda x: jnp.sum(x**2)[None] - 1.0,
        start,
    )
    return found.objective


def designs_of(path: Any, batch: int):
    """Designs of a drive file, every number varied."""
    return varied(bj.load_drive(path), batch, spread=0.01)


def starts(_: Any, batch: int):
    """Points in the box from which to search."""
    return jnp.asarray(np.random.default_rng(0).uniform(-1, 1, (batch, 6)))


QUESTIONS: dict[str, tuple[str, Callable, Callable, Any]] = {
    "gamma": ("Gamma and slopes", jax.value_and_grad(total_coupling), designs_of, DRIVE),
    "modes": ("modes and slopes", jax.value_and_grad(total_frequency), designs_of, DRIVE),
    "contact": ("contact and slopes", jax.value_and_grad(efficiency), designs_of, SEVEN),
    "sqp": ("SQP, 6 variables", searched, starts, None),
}


def on_cpu(run: Callable, numbers: Any) -> list[np.ndarray]:
    """Answers of a few designs on the CPU, by a function jitted once."""
    first = jax.device_put(jax.tree.map(lambda x: x[:CHECKED], numbers), jax.devices("cpu")[0])
    with jax.default_device(jax.devices("cpu")[0]):
        return [np.asarray(x) for x in jax.tree.leaves(run(first))]


class Measured(NamedTuple):
    """One question at one size."""

    error: float
    first: float  # [s] of the first call, which compiles
    run: float  # [s] of a later one


def measured(function: Callable, numbers: Any, true: list[np.ndarray]) -> Measured:
    """Error and times of a batch."""
    run: Any = bj.thorough_jit(jax.vmap(function))
    began = time.perf_counter()
    found = jax.block_until_ready(run(numbers))
    first = time.perf_counter() - began
    error = _difference([np.asarray(x)[:CHECKED] for x in jax.tree.leaves(found)], true)
    times = []
    for _ in range(RUNS):
        began = time.perf_counter()
        jax.block_until_ready(run(numbers))
        times.append(time.perf_counter() - began)
    return Measured(error, first, min(times))


def _difference(found: list[np.ndarray], true: list[np.ndarray]) -> float:
    """Largest difference, relative to the largest of each array."""
    sizes = [float(np.max(np.abs(x), initial=0.0)) for x in true]
    # Slopes that are zero are rounding, of which there is no relative error.
    least = 1e-12 * max(sizes)
    return max(
        float(np.max(np.abs(a - b), initial=0.0)) / max(size, least)
        for a, b, size in zip(found, true, sizes, strict=True)
    )


def of_question(name: str, batches: list[int], until: float) -> list[list[str]]:
    """The rows of one question over all sizes, as far as time goes."""
    title, function, make, source = QUESTIONS[name]
    rows: list[list[str]] = []
    reference = jax.jit(jax.vmap(function), compiler_options=QUICK)
    last = Measured(0.0, 0.0, 0.0), 1
    for batch in batches:
        row = [title, f"{batch:,}"]
        # A larger batch takes as long to compile, and as much longer to run as it is larger.
        longer = (RUNS + 1) * last[0].run * (batch / last[1] - 1)
        if time.monotonic() + last[0].first + longer > until:
            rows.append([*row, "left out", "-", "-"])
        else:
            try:
                numbers = make(source, batch)
                last = measured(function, numbers, on_cpu(reference, numbers)), batch
                error, first, run = last[0]
                each = f"{1e6 * run / batch:.4g}"
                rows.append([*row, f"{error:.0e}", f"{max(first - run, 0):.1f}", each])
            except Exception as error:  # what a device cannot do is its own affair
                first = str(error).splitlines()[0] if str(error) else ""
                rows.append([*row, f"{type(error).__name__}: {first}"[:60], "-", "-"])
        print("  ".join(rows[-1]), flush=True)
    return rows


def main() -> None:
    """Print one row for each question and size."""
    parser = argparse.ArgumentParser(description="Batches on an accelerator.")
    parser.add_argument("questions", nargs="*", help=", ".join(QUESTIONS))
    large = jax.default_backend() != "cpu"
    sizes = (1000, 10_000, 100_000, 1_000_000) if large else (64, 256)
    parser.add_argument("--batches", type=int, nargs="+", default=sizes)
    parser.add_argument("--seconds", type=float, default=420.0, help="Start nothing beyond these.")
    given = parser.parse_args()
    names = given.questions or list(QUESTIONS)
    began, rows = time.monotonic(), []
    for k, name in enumerate(names):
        # Each question may use its share of what is left.
        left = began + given.seconds - time.monotonic()
        rows += of_question(name, given.batches, time.monotonic() + left / (len(names) - k))
    device = jax.devices()[0].device_kind
    columns = ("question", "batch", "error", "compile (s)", "run (us/design)")
    print_table(f"{jax.default_backend()}, {device}", columns, rows)


if __name__ == "__main__":
    main()
