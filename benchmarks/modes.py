"""Eight natural frequencies of the three-pulley drive and their derivatives by every number.

One claim: a design with its exact gradients costs about a millisecond, without discretization
error or with an error of 0.1 %. In one run, each with its true error against Legendre(48):

  basis          Galerkin with few functions per span, values and values with all slopes
  exact          the characteristic function, from eight sine terms per span
  SciPy          `scipy.linalg.eig` of the companion matrix with the same few functions, slopes by
                 central differences, one design at a time

    python benchmarks/modes.py [--batch 1000]
"""

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # XLA shares the batch between the cores

import jax

jax.config.update("jax_enable_x64", True)

import time  # noqa: E402

import equinox as eqx  # noqa: E402
import numpy as np  # noqa: E402
import scipy.linalg  # noqa: E402
from coupling import DRIVE, varied  # noqa: E402
from timing import Row, best_time, compiled, show  # noqa: E402

import beltjax as bj  # noqa: E402
from beltjax.drive.numbers import named_numbers  # noqa: E402

COUNT = 8
FEW = bj.Legendre(12)  # 0.1 % at the bending stiffness of the example
PEERS = 3  # designs that SciPy solves
SEVEN = DRIVE.with_name("seven_pulley.toml")


def linearization(numbers, basis):
    """Steady state and matrices of one design."""
    return bj.linearize(bj.steady_state(*numbers, throw=False), basis, throw=False)


def frequencies(numbers, basis, exact=False):
    """Eight frequencies [rad/s] of one design."""
    lin = linearization(numbers, basis)
    return bj.modes(lin, COUNT, exact=exact, route="hermitian", throw=False).frequencies


def companion(lin):
    """Frequencies [rad/s] of one linearization by SciPy."""
    M, G, K = (np.asarray(m) for m in (lin.mass, lin.gyroscopic, lin.stiffness))
    size = len(M)
    lower = -np.linalg.solve(M, np.hstack([K, G]))
    A = np.vstack([np.hstack([np.zeros((size, size)), np.eye(size)]), lower])
    values = np.imag(scipy.linalg.eigvals(A))
    return np.sort(values[values > 1e-9])[:COUNT] / float(lin.scales.time)


def peer(designs, slopes):
    """Seconds a design for SciPy with slopes by differences, and its errors."""
    assemble = jax.jit(lambda n: linearization(n, FEW))
    spent, found, wrong = 0.0, [], 0.0
    for k in range(PEERS):
        numbers = jax.tree.map(lambda x, k=k: x[k], designs)
        jax.block_until_ready(assemble(numbers))
        start = time.perf_counter()
        found.append(companion(assemble(numbers)))
        table = named_numbers(*numbers)
        for name, value in table.items():
            for place in np.ndindex(value.shape):
                h = 1e-5 * max(abs(float(value[place])), 0.05)
                sides = [
                    companion(assemble(_moved(numbers, name, value.at[place].add(by))))
                    for by in (h, -h)
                ]
                difference = (sides[0] - sides[1]) / (2 * h)
                exact = slopes[name][(k, slice(None), *place)]
                size = np.abs(exact).max() or 1.0
                wrong = max(wrong, np.abs(difference - exact).max() / size)
        spent += time.perf_counter() - start
    return spent / PEERS, np.array(found), wrong


def _moved(numbers, name, value):
    return eqx.tree_at(lambda n: named_numbers(*n, of=numbers)[name], numbers, value)


def growth(batch):
    """Milliseconds per design against functions per span, and against pulleys."""
    rows = []
    for path, basis in (
        (DRIVE, bj.Legendre(6)),
        (DRIVE, FEW),
        (DRIVE, bj.Legendre(24)),
        (SEVEN, FEW),
    ):
        numbers = bj.load_drive(path)
        designs = varied(numbers, batch, spread=0.01)
        run, _ = compiled(jax.vmap(lambda n, b=basis: frequencies(n, b)), designs)
        pulleys = len(numbers[0].pulleys)
        rows.append((pulleys, basis.size, 1e3 * best_time(run, designs) / batch))
    return rows


def main() -> None:
    """Print one row a way, then the growth of the cost."""
    parser = argparse.ArgumentParser(description="Frequencies and their slopes, against SciPy.")
    parser.add_argument("--batch", type=int, default=1000)
    batch = parser.parse_args().batch
    numbers = bj.load_drive(DRIVE)
    designs = varied(numbers, batch)
    few = jax.tree.map(lambda x: x[:PEERS], designs)
    fine = jax.jit(jax.vmap(lambda n: frequencies(n, bj.Legendre(48))))(few)

    ways = {
        "basis, Legendre(12)": lambda n: frequencies(n, FEW),
        "exact, from Sine(8)": lambda n: frequencies(n, bj.Sine(8), True),
    }
    rows, slopes = [], None
    for name, way in ways.items():
        for kind, function in (("", way), (" and slopes", jax.jacrev(way))):
            run, wait = compiled(jax.vmap(function), designs)
            wrong = np.max(np.abs(np.asarray(jax.vmap(way)(few)) / fine - 1)) if not kind else None
            cost = best_time(run, designs) / batch
            rows.append(Row(name + kind, batch, wrong, None, wait, cost))
            if kind and slopes is None:
                slopes = {
                    key: np.asarray(x)
                    for key, x in named_numbers(*run(designs), of=designs).items()
                }
    seconds, found, slope_error = peer(few, slopes)
    scipy_error = np.max(np.abs(found / fine - 1))
    rows.append(Row("SciPy eig, differences", 1, scipy_error, slope_error, None, seconds))
    show(f"{COUNT} frequencies", "design", rows)
    print("\npulleys  functions per span  us/design")
    for pulleys, size, cost in growth(batch // 5):
        print(f"{pulleys:7d}  {size:16d}  {1e3 * cost:9.1f}")


if __name__ == "__main__":
    main()
