"""A belt in grooves beside SciPy: its state, and the gradients of many.

Two equal pulleys with grooves of 40 degrees under 8 N m, belt length given, friction viscous below
1e-4 of the belt's speed. The peer solves each arc by SciPy's `solve_bvp` (tol 1e-6) down the same
levels of that speed, and the drive around it by `scipy.optimize.root` on tensions and turns.
Errors are those of the efficiency against a stored independent value (tests/data/grooves.json), of
slopes against central differences of the same function.

    python benchmarks/groove.py [--batch 256] [--elements 60] [--drives 500]
"""

import argparse
import json
import os
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from scipy.integrate import solve_bvp  # noqa: E402
from scipy.optimize import root  # noqa: E402
from timing import Row, best_time, compiled, show  # noqa: E402

import beltjax as bj  # noqa: E402
from beltjax.analysis.groove import groove_solution  # noqa: E402
from beltjax.analysis.groove_methods import groove_question  # noqa: E402
from beltjax.drive.canonical import canonical  # noqa: E402
from beltjax.results import successes  # noqa: E402

CASE = json.loads((Path(__file__).parents[1] / "tests/data/grooves.json").read_text())["cases"][
    "A3"
]
STORED, EPS = CASE["eps"]["1e-04"], 1e-4
R, D, BETA, MU, K, EA = 0.05, CASE["pulleys"][1]["c"][0], np.radians(20), 0.3, 6e6, CASE["EA"]
FEW = 60  # elements, with about the peer's error
LEVELS = 1e-2, 3e-3, 1e-3, 3e-4, EPS


def efficiency(stiffness, friction, moment):
    """Efficiency of the drive with these numbers, by beltjax."""
    return _state(stiffness, friction, moment, ELEMENTS).efficiency


def _state(stiffness, friction, moment, elements):
    belt = bj.Belt(EA, 0.0, 0.1, wedge_angle=2 * BETA, wedge_stiffness=stiffness)
    pulleys = [
        bj.Pulley("driver", (0.0, 0.0), R, friction=friction, driver=1.0),
        bj.Pulley("driven", (D, 0.0), R, friction=friction),
    ]
    drive = bj.Drive(belt, pulleys, bj.BeltGiven(belt_length=CASE["L0"]))
    point = bj.OperatingPoint(belt_speed=0.0, torque={"driven": moment})
    question = groove_question(bj.Groove(slip_velocity=EPS, elements=elements), None)
    return groove_solution(*canonical(drive, point), *question)


class Peer:
    """The drive by SciPy, which starts each arc where it found the last one."""

    def __init__(self):
        self.kept = {}
        self.given = 0.0  # efficiency

    def arc(self, place, P_in, P_out, turn):
        """Angles at both ends, speed and unstretched length of one arc."""
        levels = LEVELS if place not in self.kept else (EPS,)
        s = np.linspace(0, 1, 300)
        k = 2 * K * np.tan(BETA + np.arctan(MU)) * R**2
        P = P_in * (P_out / P_in) ** s
        rate = np.sqrt(k / P_in) * turn
        y = np.stack([P / k * -np.expm1(-rate * s) * -np.expm1(-rate * (1 - s)), 0 * s, P / P_in])
        y[1] = -np.gradient(y[0], s) / turn
        x, guess, p = s, y, np.array([turn + 0.2, (1 + P_in / EA) * (1 + P_in / k)])
        if place in self.kept:
            x, guess, p = self.kept[place]
        for eps in levels:

            def rates(s, y, p, eps=eps):
                xi, chi, P = y[0], y[1], y[2] * P_in
                stretch = 1 + P / EA
                vt = stretch * np.cos(chi) - p[1] * (1 - xi)
                vg = stretch * np.sin(chi) / np.cos(BETA)
                w = np.sqrt(vt**2 + vg**2 + eps**2)
                press = K * R * xi / stretch / (np.cos(BETA) + MU * vg / w * np.sin(BETA))
                N = 2 * press * (np.sin(BETA) - MU * vg / w * np.cos(BETA))
                f = -2 * press * MU * vt / w
                r = R * (1 - xi) / np.cos(chi)
                along = [
                    -(1 - xi) * np.tan(chi),
                    1 - (N * np.cos(chi) - f * np.sin(chi)) / P * r,
                    -(N * np.sin(chi) + f * np.cos(chi)) * r / P_in,
                ]
                return p[0] * np.stack(along)

            def ends(a, b, p):
                wrap = p[0] - turn - b[1] + a[1]
                return np.array([a[0], b[0], a[2] - 1, b[2] - P_out / P_in, wrap])

            found = solve_bvp(rates, ends, x, guess, p, tol=1e-6, max_nodes=20000)
            x, guess, p = found.x, found.y, found.p
        self.kept[place] = x, guess, p
        xi, chi, P = guess[0], guess[1], guess[2] * P_in
        inside = R * (1 - xi) / np.cos(chi) / (1 + P / EA)
        return chi[0], chi[-1], p[1], p[0] * np.trapezoid(inside, x)

    def efficiency(self, moment):
        """Efficiency by a root of tensions and turns about the arcs."""

        def unmet(u):
            P1, P2, turn = u[0], u[1], u[2]
            a = self.arc(0, P2, P1, turn)
            b = self.arc(1, P1, P2, 2 * np.pi - turn)
            up = np.arcsin(R * (np.cos(a[1]) - np.cos(b[0])) / D)
            down = np.arcsin(R * (np.cos(b[1]) - np.cos(a[0])) / D)
            free = [
                np.sqrt(D**2 - (D * np.sin(t)) ** 2) - R * np.sin(i) + R * np.sin(j)
                for t, i, j in ((up, a[1], b[0]), (down, b[1], a[0]))
            ]
            length = a[3] + b[3] + free[0] / (1 + P1 / EA) + free[1] / (1 + P2 / EA)
            M = [
                R * (out * np.cos(c[1]) - came * np.cos(c[0]))
                for c, came, out in ((a, P2, P1), (b, P1, P2))
            ]
            self.given = M[1] * b[2] / -(M[0] * a[2])
            turned = np.pi + up + down
            return [(M[1] - moment) / R, (length / CASE["L0"] - 1) * EA, (turn - turned) * 300]

        root(unmet, [220.0, 380.0, np.pi], tol=1e-8)
        return self.given


def spread(count):
    """Numbers of that many drives, about those of the stored one."""
    random = np.random.default_rng(0)
    factors = random.uniform(0.8, 1.25, (3, count))
    return jnp.asarray(factors * np.array([[K], [MU], [8.0]]))


def main() -> None:
    """Print the table, and how many random drives are solved."""
    options = argparse.ArgumentParser()
    options.add_argument("--batch", type=int, default=256)
    options.add_argument("--elements", type=int, default=FEW)
    options.add_argument("--drives", type=int, default=0)
    given = options.parse_args()
    global ELEMENTS
    rows, at = [], (jnp.array(K), jnp.array(MU), jnp.array(8.0))
    ELEMENTS = 400
    run, wait = compiled(efficiency, *at)
    error = abs(float(run(*at)) - STORED["eff"])
    rows.append(Row("one, 400 elements", 1, error, None, wait, best_time(run, *at)))
    ELEMENTS = FEW
    run, wait = compiled(efficiency, *at)
    error = abs(float(run(*at)) - STORED["eff"])
    rows.append(Row(f"one, {FEW} elements", 1, error, None, wait, best_time(run, *at)))
    ELEMENTS = given.elements
    slopes = jax.value_and_grad(efficiency, (0, 1, 2))
    run, wait = compiled(jax.vmap(slopes), *spread(given.batch))
    values = run(*spread(given.batch))
    one, _ = compiled(efficiency, *at)
    first = spread(given.batch)[:, 0]
    step = 1e-5 * first
    wrong = 0.0
    for i in range(3):
        moved = np.eye(3)[i] * step[i]
        difference = (one(*(first + moved)) - one(*(first - moved))) / (2 * step[i])
        wrong = max(wrong, abs(float(values[1][i][0] / difference - 1)))
    error = abs(float(one(*at)) - STORED["eff"])
    start = time.perf_counter()
    jax.block_until_ready(run(*spread(given.batch)))
    each = (time.perf_counter() - start) / given.batch
    name = f"many with gradients, {given.elements} elements"
    rows.append(Row(name, given.batch, error, wrong, wait, each))
    start = time.perf_counter()
    error = abs(Peer().efficiency(8.0) - STORED["eff"])
    rows.append(Row("SciPy, solve_bvp and root", 1, error, None, None, time.perf_counter() - start))
    start = time.perf_counter()
    for _ in range(1 + 2 * len(at)):  # central differences; from another solution it is slower
        Peer().efficiency(8.0)
    name = "SciPy, gradients by differences"
    rows.insert(3, Row(name, 1, error, None, None, time.perf_counter() - start))
    show("a belt in two grooves", "drive", rows)
    if given.drives:
        solve, _ = compiled(
            jax.vmap(lambda k, mu, M: _state(k, mu, M, 400).result), *at_random(given.drives)
        )
        found = successes(solve(*at_random(given.drives)))
        print(f"random drives: {np.sum(found)} of {given.drives} solved, the others reported")


def at_random(count):
    """Numbers of drives far apart: wedges, friction up to self-locking, and moments."""
    random = np.random.default_rng(1)
    stiffness = 10 ** random.uniform(6.3, 8.5, count)
    friction, moment = random.uniform(0.12, 0.5, count), random.uniform(0.0, 12.0, count)
    return jnp.asarray(stiffness), jnp.asarray(friction), jnp.asarray(moment)


if __name__ == "__main__":
    main()
