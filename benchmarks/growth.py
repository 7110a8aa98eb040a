"""How the cost grows: with pulleys, with modes, with functions per span.

One claim: nothing grows faster than a dense eigenproblem, whose work is a cube. The first row is
LAPACK's on Hermitian matrices of the size that the modes have; its own exponent is above 3 where a
larger matrix no longer fits a cache, and is what the others are compared with. Round drives of 3 to 100
pulleys inside of the loop; the cost is processor time of one drive, compiled quickly and without
compiling, the least of several runs. The exponent is the slope of a straight line through the
logarithms of the larger half of the sizes, where what does not grow is the smaller part. The error is
the largest that the results themselves carry: residuals, or what a basis leaves out.

    python benchmarks/growth.py [--pulleys 3 6 12 25 50 100] [dense steady slopes ...]
"""

import argparse
import os
import time
from collections.abc import Callable
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax

jax.config.update("jax_enable_x64", True)

import equinox as eqx  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from timing import print_table  # noqa: E402

import beltjax as bj  # noqa: E402

LONGEST = 20.0  # [s]; a larger size is left out when the one before took as long
FUNCTIONS = 6


def round_drive(count: int) -> tuple[bj.Drive, bj.OperatingPoint]:
    """A drive of so many pulleys round a circle; accessories share the torque."""
    angle = 2 * np.pi * np.arange(count) / count
    distance = 0.08 * count / np.pi  # neighbors are 160 mm apart
    pulleys = [
        bj.Pulley(
            center=(distance * np.cos(a), distance * np.sin(a)), radius=0.04, inertia=1e-3,
            name=f"p{k}", friction=0.9, driver=1.0 if k == 0 else 0.0,
        )
        for k, a in enumerate(angle)
    ]  # fmt: skip
    belt = bj.Belt(bending_stiffness=0.02, axial_stiffness=1.5e5, mass_per_length=0.1)
    drive = bj.Drive(belt=belt, pulleys=tuple(pulleys), installation=bj.TensionGiven(400.0))
    torque = {f"p{k}": 4.0 / (count - 1) for k in range(1, count)}
    return drive, bj.OperatingPoint(belt_speed=10.0, torque=torque)


def steady(drive, point):
    found = bj.steady_state(drive, point, throw=False)
    return jnp.sum(found.coupling), found.error


def lowest(drive, point, functions: int = FUNCTIONS, count: int = 4):
    lin = bj.linearize(
        bj.steady_state(drive, point, throw=False), bj.Legendre(functions), throw=False
    )
    found = bj.modes(lin, count, route="hermitian", throw=False)
    return jnp.sum(found.frequencies), jnp.max(found.error)


def contact(drive, point):
    found = bj.contact_state(drive, point, throw=False)
    return found.efficiency, found.error


def cost(function: Callable, drive: bj.Drive, point: bj.OperatingPoint) -> tuple[float, float]:
    """Processor time of one call [s], and the error that its result carries."""
    run: Any = bj.quick_jit(function)
    found = jax.block_until_ready(run(drive, point))
    times: list[float] = []
    while not times or (len(times) < 5 and sum(times) < 2.0):
        began = time.process_time()
        jax.block_until_ready(run(drive, point))
        times.append(time.process_time() - began)
    error = found[0][1] if isinstance(found[0], tuple) else found[1]
    return min(times), abs(float(error))


def slopes(drive, point):
    return eqx.filter_value_and_grad(lambda d: steady(d, point), has_aux=True)(drive)


def dense(count: int) -> tuple[float, float]:
    """Processor time of the eigenvalues of one Hermitian matrix [s], and their error."""
    size = 2 * FUNCTIONS * count
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(size, size)) + 1j * rng.normal(size=(size, size))
    matrix = matrix + matrix.conj().T
    times: list[float] = []
    values = np.zeros(size)
    while not times or (len(times) < 5 and sum(times) < 2.0):
        began = time.process_time()
        values = np.linalg.eigvalsh(matrix)
        times.append(time.process_time() - began)
    trace = np.trace(matrix).real
    return min(times), abs(values.sum() - trace) / np.abs(values).sum()


OVER_PULLEYS = {"steady": steady, "slopes": slopes, "modes": lowest, "contact": contact}
OVER_OTHERS = {
    "functions": (8, 16, 32, 64, 128),  # a span, of three pulleys
    "count": (4, 8, 16, 32, 64),  # modes of those
}


def exponent(sizes: list[int], seconds: list[float]) -> float:
    """Slope of the logarithms over the larger half of the sizes."""
    half = min(len(sizes) // 2, len(sizes) - 2)
    return float(np.polyfit(np.log(sizes[half:]), np.log(seconds[half:]), 1)[0])


def grown(name: str, sizes: list[int]) -> tuple[str, str, str, float]:
    """Name, costs over sizes, the largest error, and the exponent."""
    done, seconds, worst = [], [], 0.0
    three = round_drive(3)
    for size in sizes:
        if name == "dense":
            spent, error = dense(size)
        elif name == "functions":
            spent, error = cost(lambda d, p, n=size: lowest(d, p, n), *three)
        elif name == "count":
            spent, error = cost(lambda d, p, n=size: lowest(d, p, 32, n), *three)
        else:
            spent, error = cost(OVER_PULLEYS[name], *round_drive(size))
        done, seconds, worst = [*done, size], [*seconds, spent], max(worst, error)
        print(f"{name} {size}: {1e3 * spent:.3g} ms, error {error:.0e}", flush=True)
        if spent > LONGEST:
            break
    costs = ", ".join(f"{n}: {1e3 * s:.3g}" for n, s in zip(done, seconds, strict=True))
    return name, costs, f"{worst:.0e}", exponent(done, seconds)


def main() -> None:
    """Print one row for each way in which a question grows."""
    sizes = dict.fromkeys(("dense", *OVER_PULLEYS), ()) | OVER_OTHERS
    parser = argparse.ArgumentParser(description="How costs grow.")
    parser.add_argument("ways", nargs="*", help=", ".join(sizes))
    parser.add_argument("--pulleys", type=int, nargs="+", default=(3, 6, 12, 25, 50, 100))
    given = parser.parse_args()
    ways = dict.fromkeys(("dense", *(given.ways or sizes)))
    found = [grown(name, [*(sizes[name] or given.pulleys)]) for name in ways]
    against = found[0][-1]
    rows = [[*texts, f"{power:.2f}", f"{power - against:+.2f}"] for *texts, power in found]
    columns = ("cost of one drive", "size: ms", "error", "exponent", "less dense's")
    print_table(f"Growth, {jax.default_backend()}", columns, rows)


if __name__ == "__main__":
    main()
