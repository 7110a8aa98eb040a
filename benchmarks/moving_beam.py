"""Frequencies of a hundred thousand moving beams, with derivatives, beside SciPy's root finder.

One claim: a sweep over bending and speed costs microseconds a frequency, misses no root, and has
exact slopes. In one run, for the lowest four frequencies of beams with random (eps, v), eps from
1e-4 to 0.2 and v from 0 to 0.95:

  exact         the determinant of the boundary conditions by a phase that counts, under `vmap`
  slopes        the same, with d omega/d eps and d omega/d v of every frequency
  perturbation  docs/theory/moving_beam.md, (B10) and (B11): its error says where it will do
  SciPy         `brentq` on the determinant, waves by `numpy.roots`, one beam at a time; it is
                handed a bracket for each root, halfway between the exact ones

The true error is against Legendre polynomials (a Galerkin method without waves).

    python benchmarks/moving_beam.py [--batch 100000] [--ends simple fixed]
"""

import argparse
import itertools
import sys
import time
from pathlib import Path

import jax
import numpy as np
from scipy.optimize import brentq

jax.config.update("jax_enable_x64", True)
sys.path.append(str(Path(__file__).parents[1] / "tests"))

import legendre_beam  # noqa: E402
from timing import Row, best_time, compiled, show  # noqa: E402

import beltjax as bj  # noqa: E402

COUNT = 4
REFERENCES = 40  # beams that Legendre and SciPy solve


def determinant(omega, eps, v, ends):
    """The 4x4 determinant of the boundary conditions, each column scaled to its larger end."""
    r = np.roots([eps**2, 0.0, 1 - v**2, 2 * v * omega, -(omega**2)]).astype(complex)
    r = r[np.lexsort((np.real(r), np.round(np.imag(r), 6)))]
    far = np.where(np.imag(r) < 0, 1.0, 0.0)
    rows = []
    for x, end in zip((0.0, 1.0), ends, strict=True):
        wave = np.exp(1j * r * (x - far))
        rows += [wave, r**2 * wave if end == "simple" else r * wave]
    # Divided by what coinciding waves put into it, it is real, or imaginary for unlike supports.
    coincidences = np.prod([r[j] - r[i] for i in range(4) for j in range(i + 1, 4)])
    value = np.linalg.det(np.array(rows)) * np.exp(1j * np.sum(np.real(r) * far)) / coincidences
    return float(value.real if ends[0] == ends[1] else value.imag)


def by_scipy(eps, v, ends, exact):
    """The frequencies by `brentq` between midpoints of their neighbors."""
    spaced = np.concatenate([[0.5 * exact[0]], 0.5 * (exact[1:] + exact[:-1]), [1.1 * exact[-1]]])
    return [
        brentq(determinant, low, high, args=(eps, v, ends), xtol=1e-14, rtol=np.float64(1e-14))
        for low, high in itertools.pairwise(spaced)
    ]


def slope_error(values, slopes, eps, v):
    """Largest relative difference of slopes to five-point differences of `values`."""
    worst = 0.0
    for k, at in enumerate((eps, v)):
        h = 1e-4 * np.maximum(at, 1e-2 if k else 1e-5)

        def moved(m, k=k, h=h):
            return np.asarray(values(eps + m * h * (k == 0), v + m * h * (k == 1)))

        difference = (moved(-2) - moved(2) + 8 * (moved(1) - moved(-1))) / (12 * h[:, None])
        size = np.maximum(np.abs(slopes[k]), 1.0)
        worst = max(worst, float(np.max(np.abs(difference - slopes[k]) / size)))
    return worst


def main() -> None:
    """Print one row a way."""
    parser = argparse.ArgumentParser(description="Frequencies of moving beams: beltjax and SciPy.")
    parser.add_argument("--batch", type=int, default=100_000)
    parser.add_argument("--ends", nargs=2, default=["simple", "fixed"], choices=["simple", "fixed"])
    options = parser.parse_args()
    batch, ends = options.batch, tuple(options.ends)
    rng = np.random.default_rng(0)
    eps = 10 ** rng.uniform(-4, np.log10(0.2), batch)
    v = rng.uniform(0, 0.95, batch)

    def way(method):
        def frequencies(eps, v):
            return bj.moving_beam_modes(eps, v, ends, COUNT, method, throw=False).frequencies

        return frequencies

    def both(eps, v):
        found = way("exact")(eps, v)
        return found, jax.jacfwd(way("exact"), argnums=(0, 1))(eps, v)

    exact, exact_compile = compiled(jax.vmap(way("exact")), eps, v)
    slopes, slopes_compile = compiled(jax.vmap(both), eps, v)
    leading, leading_compile = compiled(jax.vmap(way("perturbation")), eps, v)

    few = slice(0, REFERENCES)
    omega = np.asarray(exact(eps, v))
    truth = np.array(
        [
            legendre_beam.frequencies(e, s, ends, COUNT, 320 if e < 1e-3 else 100)
            for e, s in zip(eps[few], v[few], strict=True)
        ]
    )
    start = time.perf_counter()
    peer = [by_scipy(e, s, ends, w) for e, s, w in zip(eps[few], v[few], omega[few], strict=True)]
    scipy_time = (time.perf_counter() - start) / REFERENCES

    def error(values):
        return float(np.max(np.abs(np.asarray(values)[few] / truth - 1)))

    found, derivatives = slopes(eps, v)
    wrong = slope_error(exact, [np.asarray(d) for d in derivatives], eps, v)
    show(
        f"{COUNT} frequencies a beam, {'-'.join(ends)}",
        "beam",
        [
            Row("exact", batch, error(omega), None, exact_compile, best_time(exact, eps, v) / batch),
            Row("exact, and all slopes", batch, error(found), wrong, slopes_compile, best_time(slopes, eps, v) / batch),
            Row("perturbation", batch, error(leading(eps, v)), None, leading_compile, best_time(leading, eps, v) / batch),
            Row("SciPy brentq, given brackets", 1, error(peer), None, None, scipy_time),
        ],
    )  # fmt: skip


if __name__ == "__main__":
    main()
