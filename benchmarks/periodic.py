"""Periodic motion of seven pulleys at finite amplitude: harmonic balance beside time integration.

The drive of examples/seven_pulley.toml at 900 rpm and speeds near it, its crank turning by 0.5
degrees twice a rotation: 119 coordinates, 16 functions a span, 10 harmonics. The peer is SciPy's
`solve_ivp` (Radau, rtol 1e-6, with the exact Jacobian), which integrates the same equations in NumPy
from the linear oscillation until a period changes the arm's travel by less than 1e-7. Errors are those of the arm's travel
against 20 harmonics; of slopes, by the arm's stiffness against a central difference.

    python benchmarks/periodic.py [--batch 64] [--functions 16] [--harmonics 10]
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
from modes import SEVEN  # noqa: E402
from timing import Row, best_time, show  # noqa: E402

import beltjax as bj  # noqa: E402

SPEED, CRANK, DAMPING = 900 * np.pi / 30, np.deg2rad(0.5), bj.Damping(modal=0.03)
DRIVE, POINT = bj.load_drive(SEVEN)


def motion(drive, speed, harmonics, functions, stability=False):
    """The motion at a speed of the driver [rad/s]."""
    point = bj.OperatingPoint(driver_speed=speed, torque=POINT.torque)
    orders = bj.Orders({2: bj.Excitation(crank=CRANK)})
    return bj.periodic_response(
        drive, point, orders, harmonics=harmonics, functions=functions, damping=DAMPING,
        stability=stability, throw=False,
    )  # fmt: skip


def travel(stiffness, speed, harmonics, functions):
    """Travel of the arm [rad]."""
    drive = eqx.tree_at(lambda d: d.tensioner.stiffness, DRIVE, stiffness)
    return motion(drive, speed, harmonics, functions).measures.travels[0]


class Equations:
    """The equations of motion of `found`, in NumPy."""

    def __init__(self, found):
        m = found.excited.model
        self.count, self.functions = len(m.work), m.functions
        self.mass, self.damping, self.stiffness = map(np.asarray, (m.mass, m.damping, m.stiffness))
        self.elongations, self.driving = np.asarray(m.elongations), np.asarray(m.driving)
        self.work, self.bodies = np.asarray(m.work), np.asarray(m.bodies)
        self.inverse = np.linalg.inv(self.mass)
        self.frequency = float(found.excited.frequency)
        self.driver, self.load = (np.asarray(x) for x in (found.excited.driver, found.excited.load))
        self.period = 2 * np.pi / self.frequency

    def _strained(self, t, z):
        """Strains and their slopes."""
        theta, load = self.driver[1] * np.cos(self.frequency * t), self.load[0].copy()
        angle = self.frequency * t
        theta += self.driver[2] * np.sin(angle)
        load += self.load[1] * np.cos(angle) + self.load[2] * np.sin(angle)
        fields = z[: self.count * self.functions].reshape(self.count, -1)
        bodies = z[len(z) - self.bodies.shape[1] :]
        pulled = self.bodies @ bodies
        N = (np.sum(fields**2, axis=1) + pulled @ bodies) / 2
        slopes = np.zeros((self.count, len(z)))
        for i in range(self.count):
            slopes[i, i * self.functions : (i + 1) * self.functions] = fields[i]
        slopes[:, len(z) - len(bodies) :] = pulled
        beyond = self.driving * theta + N
        return beyond, self.elongations @ z + beyond, slopes, load

    def rate(self, t, x):
        """Derivative of positions and velocities."""
        z, v = np.split(x, 2)
        beyond, strains, slopes, load = self._strained(t, z)
        force = (self.work * beyond) @ self.elongations + (self.work * strains) @ slopes - load
        return np.concatenate([v, -self.inverse @ (self.stiffness @ z + self.damping @ v + force)])

    def jacobian(self, t, x):
        """Its derivative by them."""
        z = x[: len(x) // 2]
        _, strains, slopes, _ = self._strained(t, z)
        d, work = self.elongations, self.work[:, None]
        tangent = self.stiffness + (d.T * self.work) @ slopes + slopes.T @ (work * (d + slopes))
        tension = self.work * strains
        diagonal = np.zeros(len(z))
        diagonal[: self.count * self.functions] = np.repeat(tension, self.functions)
        tangent = tangent + np.diag(diagonal)
        bodies = self.bodies.shape[1]
        tangent[len(z) - bodies :, len(z) - bodies :] += np.einsum(
            "i,iab->ab", tension, self.bodies
        )
        zero, unit = np.zeros_like(tangent), np.eye(len(z))
        return np.block([[zero, unit], [-self.inverse @ tangent, -self.inverse @ self.damping]])

    def linear(self):
        """State of the linear drive at time 0, from which a motion settles soonest."""
        w, theta, load = self.frequency, self.driver, self.load
        pencil = self.stiffness - w**2 * self.mass + 1j * w * self.damping
        pulled = (self.work * self.driving * (theta[1] - 1j * theta[2])) @ self.elongations
        z = np.linalg.solve(pencil, load[1] - 1j * load[2] - pulled)
        return np.concatenate([z.real, (1j * w * z).real])

    def settled(self, tol):
        """Travel of the arm [rad], and the periods that it took."""
        x, before = self.linear(), 0.0
        for periods in range(1, 400):
            run = scipy.integrate.solve_ivp(
                self.rate, (0, self.period), x, method="Radau", jac=self.jacobian,
                rtol=1e-6, atol=1e-9, dense_output=True,
            )  # fmt: skip
            x = run.y[:, -1]
            arm = run.sol(np.linspace(0, self.period, 400))[len(self.mass) - 1]
            swing = np.ptp(arm)
            if abs(swing - before) < tol * swing:
                return swing, periods
            before = swing
        raise RuntimeError("the motion does not settle")


def timed(function, *arguments):
    """A function compiled, its answer, seconds of compiling and of a run."""
    start = time.perf_counter()
    run = jax.jit(function).lower(*arguments).compile()
    wait = time.perf_counter() - start
    return run, run(*arguments), wait, best_time(run, *arguments)


def main():
    parser = argparse.ArgumentParser(description="Periodic motion")
    parser.add_argument("--batch", type=int, default=64)
    parser.add_argument("--functions", type=int, default=16)
    parser.add_argument("--harmonics", type=int, default=10)
    given = parser.parse_args()
    how = given.harmonics, given.functions
    assert DRIVE.tensioner is not None
    stiffness = DRIVE.tensioner.stiffness
    speeds = jnp.asarray(SPEED * np.linspace(1.0, 1.2, given.batch))
    fine = float(travel(stiffness, SPEED, 20, given.functions))

    def error(value):
        return abs(float(value) / fine - 1)

    rows = []
    speed = jnp.asarray(SPEED)
    _, one, wait, run = timed(lambda k, s: travel(k, s, *how), stiffness, speed)
    rows.append(Row("motion", 1, error(one), None, wait, run))
    _, full, wait, run = timed(lambda s: motion(DRIVE, s, *how, stability=True), speed)
    rows.append(Row("motion and multipliers", 1, error(full.measures.travels[0]), None, wait, run))
    slope = jax.value_and_grad(lambda k, s: travel(k, s, *how))
    _, (value, by), wait, run = timed(slope, stiffness, speed)
    h = 1e-4 * stiffness
    moved = [float(travel(stiffness + part * h, speed, *how)) for part in (1, -1, 2, -2)]
    difference = (8 * (moved[0] - moved[1]) - (moved[2] - moved[3])) / (12 * h)
    rows.append(Row("motion and slope", 1, error(value), abs(by / difference - 1), wait, run))
    batch = jax.vmap(lambda s: travel(stiffness, s, *how))
    _, many, wait, run = timed(batch, speeds)
    assert np.all(np.isfinite(many))
    alone = float(travel(stiffness, speeds[-1], *how))
    rows.append(
        Row("motions at many speeds", given.batch, abs(many[-1] / alone - 1), None, wait,
            run / given.batch)
    )  # fmt: skip
    equations = Equations(full)
    start = time.perf_counter()
    swing, periods = equations.settled(1e-7)
    took = time.perf_counter() - start
    rows.append(Row(f"SciPy's Radau, {periods} periods", 1, error(swing), None, None, took))
    size = len(equations.mass)
    show(f"Periodic motion, {size} coordinates, {given.harmonics} harmonics", "motion", rows)


if __name__ == "__main__":
    main()
