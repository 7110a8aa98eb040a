"""Stick-slip of a mass on a belt, and the speed above which nothing sticks, beside SciPy.

Stribeck's friction 0.4 to 0.25 over 0.1 m/s, damping 0.1, mass, stiffness and load 1. The peers are
SciPy's `solve_ivp` from release to the event of sticking (DOP853, rtol 1e-10), the same
equation with friction mu tanh(v/v0) until it repeats (Radau), and Brent's method on the least
sliding speed of such a slip for the fold. Errors are relative, against DOP853 at rtol 1e-13; of
slopes against differences of that.

    python benchmarks/squeal.py [--batch 1024]
"""

import argparse
import os
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from scipy.integrate import solve_ivp  # noqa: E402
from scipy.optimize import brentq  # noqa: E402
from timing import Row, best_time, compiled, show  # noqa: E402

import beltjax as bj  # noqa: E402

V, C = 0.1, 0.1


def oscillator(c, speed):
    """The oscillator at a damping and a belt speed."""
    law = bj.StribeckFriction(0.4, 0.25, 0.1)
    return bj.friction_oscillator(1.0, c, 1.0, 1.0, law, speed, throw=False)


def amplitude(c, speed):
    """Amplitude of stick-slip."""
    return oscillator(c, speed).cycle.amplitude


def fold(c):
    """The belt speed above which nothing sticks."""
    return oscillator(c, V).fold_speed


def slip(c, speed, rtol, past=False):
    """One slip by SciPy: the run, which ends where the mass sticks or, `past` that, turns."""

    def rates(t, y):
        x, v = y
        mu = 0.25 + 0.15 * np.exp(-max(v, 0.0) / 0.1)
        return [speed - v, -(mu - c * (speed - v) - x)]

    def caught(t, y):
        return y[1] if t > 1e-3 else 1.0

    def turned(t, y):
        return rates(t, y)[1] if t > 3.0 else -1.0

    for event, direction in ((caught, -1), (turned, 1)):
        event.terminal = True  # pyright: ignore[reportFunctionMemberAccess]
        event.direction = direction  # pyright: ignore[reportFunctionMemberAccess]
    event = turned if past else caught
    start = [0.4 - c * speed, 0.0]
    return solve_ivp(
        rates, (0, 30), start, "DOP853", rtol=rtol, atol=1e-14, events=event, dense_output=True
    )


def amplitude_by_events(c, speed, rtol):
    """Amplitude by SciPy: where the displacement is extreme the sliding speed is the belt's."""
    run = slip(c, speed, rtol)
    times = np.linspace(0, run.t[-1], 400)
    away = run.sol(times)[1] - speed
    places = np.flatnonzero(away[:-1] * away[1:] < 0)[[0, -1]]
    ends = [
        run.sol(brentq(lambda t: run.sol(t)[1] - speed, times[k], times[k + 1], xtol=1e-13))[0]
        for k in places
    ]
    return (ends[0] - ends[1]) / 2


def amplitude_regularized(c, speed, v0):
    """Amplitude by friction without sticking, integrated until it repeats."""

    def rates(t, y):
        v = speed - y[1]
        return [y[1], (0.25 + 0.15 * np.exp(-abs(v) / 0.1)) * np.tanh(v / v0) - c * y[1] - y[0]]

    run = solve_ivp(rates, (0, 26), [0.0, speed], "Radau", rtol=1e-8, atol=1e-10, dense_output=True)
    last = run.sol(np.linspace(18, 26, 4001))[0]
    return np.ptp(last) / 2


def fold_by_brent(c, rtol):
    """The fold by SciPy: the least sliding speed of a slip vanishes there."""
    found = brentq(lambda speed: slip(c, speed, rtol, past=True).y[1, -1], 0.48, 0.6, xtol=1e-12)
    assert isinstance(found, float)
    return found


def timed(function):
    """The answer of a function that takes long, and seconds."""
    start = time.perf_counter()
    answer = function()
    return answer, time.perf_counter() - start


def cycles(batch):
    """Rows of the cycle."""
    exact = amplitude_by_events(C, V, 1e-13)
    h = 1e-3
    ends = [amplitude_by_events(C + part * h, V, 1e-13) for part in (1, -1, 2, -2)]
    slope = (8 * (ends[0] - ends[1]) - (ends[2] - ends[3])) / (12 * h)
    at = jnp.asarray(C), jnp.asarray(V)
    rows = []
    run, wait = compiled(amplitude, *at)
    rows.append(Row("cycle", 1, abs(run(*at) / exact - 1), None, wait, best_time(run, *at)))
    run, wait = compiled(jax.value_and_grad(amplitude), *at)
    value, by = run(*at)
    errors = abs(value / exact - 1), abs(by / slope - 1)
    rows.append(Row("cycle and slopes", 1, *errors, wait, best_time(run, *at)))
    many = jnp.full(batch, C), jnp.linspace(V, 0.3, batch)
    run, wait = compiled(jax.vmap(jax.value_and_grad(amplitude)), *many)
    last = amplitude_by_events(C, 0.3, 1e-13)
    error = abs(run(*many)[0][-1] / last - 1)
    took = best_time(run, *many) / batch
    rows.append(Row("cycles and slopes", batch, error, None, wait, took))
    for v0 in (1e-3, 1e-4):
        value, took = timed(lambda v0=v0: amplitude_regularized(C, V, v0))
        rows.append(Row(f"regularized, v0 = {v0:g}", 1, abs(value / exact - 1), None, None, took))
    value, took = timed(lambda: amplitude_by_events(C, V, 1e-10))
    rows.append(Row("SciPy with events", 1, abs(value / exact - 1), None, None, took))
    return rows


def folds(batch):
    """Rows of the fold."""
    exact = fold_by_brent(C, 1e-13)
    h = 1e-3
    ends = [fold_by_brent(C + part * h, 1e-13) for part in (1, -1, 2, -2)]
    slope = (8 * (ends[0] - ends[1]) - (ends[2] - ends[3])) / (12 * h)
    at, rows = jnp.asarray(C), []
    run, wait = compiled(jax.value_and_grad(fold), at)
    value, by = run(at)
    errors = abs(value / exact - 1), abs(by / slope - 1)
    rows.append(Row("fold and slope", 1, *errors, wait, best_time(run, at)))
    many = jnp.linspace(C, 0.12, batch)
    run, wait = compiled(jax.vmap(jax.value_and_grad(fold)), many)
    error = abs(run(many)[0][0] / exact - 1)
    rows.append(Row("folds and slopes", batch, error, None, wait, best_time(run, many) / batch))
    value, took = timed(lambda: fold_by_brent(C, 1e-10))
    rows.append(Row("SciPy's Brent", 1, abs(value / exact - 1), None, None, took))
    return rows


def main():
    parser = argparse.ArgumentParser(description="Stick-slip")
    parser.add_argument("--batch", type=int, default=1024)
    batch = parser.parse_args().batch
    show("Stick-slip cycle", "cycle", cycles(batch))
    show("Fold of stick-slip", "fold", folds(batch))


if __name__ == "__main__":
    main()
