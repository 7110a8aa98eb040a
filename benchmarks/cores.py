"""What two cores are worth: Gamma with all slopes, and modes, in one process and in several.

Two claims. XLA shares a batch of Gamma with slopes between the cores by itself. Eigenproblems it
solves one after the other on one core (LAPACK, a call a design); there processes gain, which is how
`beltjax explore --modes` runs many designs. Threads that call one
compiled program on parts of a batch did not return within a minute: two LAPACK calls at a time can
wait for each other in XLA's pool of two.

Each way is run in processes of its own, on parts of one batch:

  error          of the answers, relative, against the first design solved alone
  wall, CPU      a design, the best of three runs
  bound          processor time of all threads and processes over that of the busiest: by so much
                 the work can be faster than on one core. With other work on the machine the wall
                 time does not show it, and this does.

    python benchmarks/cores.py [--gamma 4096] [--modes 64] [--processes 2]
"""

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from coupling import total_coupling, varied  # noqa: E402
from modes import SEVEN, frequencies  # noqa: E402
from timing import print_table  # noqa: E402

import beltjax as bj  # noqa: E402

RUNS = 3
BASIS = bj.Legendre(24)
QUESTIONS = {
    "gamma": ("Gamma and slopes", jax.value_and_grad(total_coupling)),
    "modes": ("modes", lambda numbers: frequencies(numbers, BASIS)),
}


def thread_times() -> dict[str, float]:
    """Processor time of each thread of this process so far [s] (Linux)."""
    found = {}
    for thread in Path("/proc/self/task").iterdir():
        try:
            found[thread.name] = int((thread / "schedstat").read_text().split()[0]) / 1e9
        except OSError:
            continue  # it has ended
    return found


def part(what: str, batch: int, place: int, parts: int) -> None:
    """Run one part of a batch when told to, and print what it took."""
    _, question = QUESTIONS[what]
    designs = varied(bj.load_drive(SEVEN), batch, spread=0.01)
    size = batch // parts
    own = jax.tree.map(lambda x: x[place * size : (place + 1) * size], designs)
    run = bj.thorough_jit(jax.vmap(question))
    found = jax.block_until_ready(run(own))
    one = jax.tree.map(lambda x: x[0], own)
    alone = jax.tree.leaves(jax.jit(question)(one))
    error = max(
        float(jnp.max(jnp.abs(a - b[0])) / (jnp.max(jnp.abs(a)) or 1.0))
        for a, b in zip(alone, jax.tree.leaves(found), strict=True)
    )
    for _ in range(RUNS):
        print("ready", flush=True)
        sys.stdin.readline()
        before = thread_times()
        jax.block_until_ready(run(own))
        spent = [x - before.get(thread, 0.0) for thread, x in thread_times().items()]
        print(json.dumps([error, sum(spent), max(spent)]), flush=True)


def measured(what: str, batch: int, processes: int) -> list[str]:
    """One way: parts of a batch in so many processes, all at once."""
    words = [sys.executable, __file__, "--part", what, f"--{what}", str(batch)]
    words += ["--processes", str(processes)]
    running = [
        subprocess.Popen(
            [*words, "--place", str(k)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        for k in range(processes)
    ]
    walls, rows = [], []
    for _ in range(RUNS):
        _from_all(running)
        began = time.perf_counter()
        for process in running:
            assert process.stdin is not None
            print(file=process.stdin, flush=True)
        rows.append([json.loads(line) for line in _from_all(running)])
        walls.append(time.perf_counter() - began)
    for process in running:
        process.communicate()
    errors, work, busiest = np.array(rows).transpose(2, 0, 1)  # [runs, processes] each
    bound = np.median(work.sum(axis=1) / busiest.max(axis=1))
    numbers = 1e6 * min(walls) / batch, 1e6 * work.sum(axis=1).min() / batch
    return [f"{errors.max():.0e}", *(f"{x:,.1f}" for x in numbers), f"{bound:.2f}"]


def _from_all(running: list[subprocess.Popen]) -> list[str]:
    """One line of each process."""
    lines = [process.stdout.readline() for process in running if process.stdout is not None]
    if not all(lines):
        raise RuntimeError("a process ended early; its error is above")
    return lines


def main() -> None:
    """Print one row a way."""
    parser = argparse.ArgumentParser(description="What several cores are worth.")
    parser.add_argument("--gamma", type=int, default=4096, metavar="BATCH")
    parser.add_argument("--modes", type=int, default=64, metavar="BATCH")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--part", choices=QUESTIONS, help=argparse.SUPPRESS)
    parser.add_argument("--place", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.part:
        part(given.part, getattr(given, given.part), given.place, given.processes)
        return
    rows = []
    for what, (title, _) in QUESTIONS.items():
        for processes in (1, given.processes):
            batch = getattr(given, what)
            ways = "one process" if processes == 1 else f"{processes} processes"
            rows.append([f"{title}, {ways}", f"{batch:,}", *measured(what, batch, processes)])
            print("  ".join(rows[-1]), flush=True)
    columns = ("way", "batch", "error", "wall (us/design)", "CPU (us/design)", "bound")
    print_table(f"Seven pulleys, {len(os.sched_getaffinity(0))} cores", columns, rows)


if __name__ == "__main__":
    main()
