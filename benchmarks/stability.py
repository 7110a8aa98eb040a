"""Parametric instability of three pulleys: the growth of a disturbance without an eigensolver.

One claim: the growth of a disturbance, exact to 1e-6, is found without an eigensolver and compiled
in a few seconds. The drive of examples/three_pulley.toml in the tongue of its first mode, its crank turning by 0.12
degrees twice a rotation: 12 Legendre functions a span, 24 modes, 64 steps a period. The peer is
Hill's method in NumPy and SciPy: the same linear system integrated over a period by `solve_ivp`
(DOP853, rtol 1e-9), and the eigenvalues of its monodromy matrix. Errors of the growth are against that; of
slopes, by the arm's stiffness, against a central difference.

    python benchmarks/stability.py [--batch 64]
"""

import argparse
import os
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import equinox as eqx
import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import scipy.integrate  # noqa: E402
from timing import Row, best_time, show  # noqa: E402

import beltjax as bj  # noqa: E402
from beltjax.analysis.floquet import disturbed  # noqa: E402
from beltjax.analysis.orders import Forcing  # noqa: E402
from beltjax.physics.parametric import disturbance_of_response, modal_disturbance  # noqa: E402

SPEED, CRANK, DAMPING = 274.5192615056385, np.deg2rad(0.12), bj.Damping(modal=0.01)
DRIVE, POINT = bj.load_drive("examples/three_pulley.toml")
BASIS, MODES, STEPS = bj.Legendre(12), 24, 64


def linearized(stiffness):
    """The drive with an arm of that stiffness [N m/rad]."""
    drive = eqx.tree_at(lambda d: d.tensioner.stiffness, DRIVE, stiffness)
    steady = bj.steady_state(drive, bj.OperatingPoint(driver_speed=SPEED), throw=False)
    return bj.linearize(steady, BASIS, throw=False)


def growth(stiffness, crank):
    """Growth [1/s] under a crank motion of that amplitude [rad]."""
    return growth_of(linearized(stiffness), crank)


def growth_of(lin, crank):
    """The same of a drive that is linearized already."""
    found = bj.floquet(
        lin, 2 * SPEED, bj.Excitation(crank), damping=DAMPING, modes=MODES,
        steps=STEPS, critical=False, throw=False,
    )  # fmt: skip
    return found.growth


def peer(stiffness, crank):
    """The same by SciPy, and its seconds without those of the modes."""
    lin = linearized(stiffness)
    forcing = Forcing(jnp.array([0.0, crank + 0j]), jnp.zeros((2, 1), complex))
    of, _ = disturbed(lin, jnp.asarray(2 * SPEED), forcing, DAMPING, MODES, (1,))
    modal = modal_disturbance(of.model, of.basis, of.dissipation)
    matrix = jax.jit(
        lambda phase: disturbance_of_response(
            of.model, modal, of.response, of.excited.driver, phase
        )
    )
    size, period, w = 2 * MODES, float(of.period), float(of.excited.frequency)

    def rate(t, x):
        return (np.asarray(matrix(w * t)) @ x.reshape(size, size)).ravel()

    start = time.perf_counter()
    run = scipy.integrate.solve_ivp(
        rate, (0, period), np.eye(size).ravel(), method="DOP853", rtol=1e-9, atol=1e-12
    )
    largest = np.abs(np.linalg.eigvals(run.y[:, -1].reshape(size, size))).max()
    took = time.perf_counter() - start
    return np.log(largest) / period / float(lin.scales.time), took


def timed(function, *arguments):
    """A function compiled, its answer, seconds of compiling and of a run."""
    start = time.perf_counter()
    run = bj.quick_jit(function).lower(*arguments).compile()
    wait = time.perf_counter() - start
    return run(*arguments), wait, best_time(run, *arguments)


def main():
    parser = argparse.ArgumentParser(description="Parametric instability")
    parser.add_argument("--batch", type=int, default=64)
    given = parser.parse_args()
    assert DRIVE.tensioner is not None
    stiffness, crank = DRIVE.tensioner.stiffness, jnp.asarray(CRANK)
    exact, took = peer(stiffness, crank)

    def error(value):
        return abs(float(value) / exact - 1)

    rows = []
    value, wait, run = timed(growth_of, linearized(stiffness), crank)
    rows.append(Row("growth alone", 1, error(value), None, wait, run))
    value, wait, run = timed(growth, stiffness, crank)
    rows.append(Row("steady state and growth", 1, error(value), None, wait, run))
    (value, slope), wait, run = timed(jax.value_and_grad(growth), stiffness, crank)
    h = 1e-3 * stiffness
    ends = [growth(stiffness + part * h, crank) for part in (1, -1, 2, -2)]
    difference = (8 * (ends[0] - ends[1]) - (ends[2] - ends[3])) / (12 * h)
    rows.append(
        Row("growth and slope", 1, error(value), abs(float(slope / difference) - 1), wait, run)
    )
    cranks = jnp.asarray(CRANK * np.linspace(0.5, 1.0, given.batch))
    many, wait, run = timed(jax.vmap(growth, (None, 0)), stiffness, cranks)
    rows.append(
        Row("growth at many angles", given.batch, error(many[-1]), None, wait, run / given.batch)
    )
    rows.append(Row("SciPy's DOP853 and eigvals", 1, 0.0, None, None, took))
    show(f"Parametric instability, {MODES} modes, {STEPS} steps", "growth", rows)


if __name__ == "__main__":
    main()
