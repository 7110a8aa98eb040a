"""A robust study: the tensioner that is effective in three standard deviations, not only as drawn.

    python examples/three_pulley_robust.py [FOLDER]

Chooses the accessory's radius and the tensioner's angle of the three-pulley drive for the largest
effectiveness, Gamma limited, once for the drive as drawn and once for its scatter under tolerances;
confirms both by 100,000 fresh drives each, and draws their distributions into
FOLDER/three_pulley_robust.png. The two differ by a degree: this optimum bears its tolerances, which
is what such a study is to tell.
"""

import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.optimize import minimize

jax.config.update("jax_enable_x64", True)

import beltjax as bj  # noqa: E402

DEVIATIONS = {"tensioner.angle": np.radians(8), "pulley.accessory.center.y": 2e-3}  # standard
TOLERANCES = {name: bj.optimize.Normal(size) for name, size in DEVIATIONS.items()}
LOWER, UPPER = np.array([0.022, np.radians(-30)]), np.array([0.045, np.radians(70)])
LARGEST_GAMMA = 4.0
FRESH = 100_000


def designed(drive, values):
    """The drive with an accessory radius [m] and a tensioner angle [rad]."""
    names = "pulley.accessory.radius", "tensioner.angle"
    return bj.optimize.with_values(drive, dict(zip(names, values, strict=True)))


def expected(drive, point, name, factor):
    """A quantity's mean and `factor` standard deviations; as drawn where `factor` is 0."""
    if factor:
        measure = bj.optimize.MeanPlus(factor)
        return bj.optimize.robust_value(
            drive, point, name, TOLERANCES, measure, samples=256
        ).value  # fmt: skip
    steady = bj.steady_state(drive, point, throw=False)
    return steady.coupling.sum() if name == "coupling" else steady.effectiveness


def best(drive, point, factor):
    """The design of largest effectiveness, `factor` standard deviations counted against it."""

    def measured(u):
        changed = designed(drive, LOWER + u * (UPPER - LOWER))
        eta = expected(changed, point, "tensioner_effectiveness", -factor)
        return jnp.stack([-eta, LARGEST_GAMMA - expected(changed, point, "coupling", factor)])

    values, slopes = jax.jit(measured), jax.jit(jax.jacfwd(measured))
    found = minimize(
        lambda u: float(values(u)[0]),
        [0.6, 0.5],
        jac=lambda u: np.asarray(slopes(u)[0]),
        bounds=[(0, 1), (0, 1)],
        constraints={
            "type": "ineq",
            "fun": lambda u: float(values(u)[1]),
            "jac": lambda u: np.asarray(slopes(u)[1]),
        },
        method="SLSQP",
        options={"ftol": 1e-10},
    )
    return LOWER + found.x * (UPPER - LOWER), -float(values(found.x)[0])


def fresh(drive, point):
    """Effectiveness of drives that no optimizer has seen."""
    sizes = np.array(list(DEVIATIONS.values()))
    drawn = np.random.default_rng(2026).normal(size=(10, FRESH // 10, len(sizes))) * sizes

    @jax.jit
    @jax.vmap
    def effectiveness(change):
        moved = {
            name: bj.optimize.value_of(drive, name) + part
            for name, part in zip(DEVIATIONS, change, strict=True)
        }
        changed = bj.optimize.with_values(drive, moved)
        return bj.steady_state(changed, point, throw=False).effectiveness

    return np.concatenate([np.asarray(effectiveness(part)) for part in drawn])


def main(folder: Path) -> None:
    """Both designs, what they promise and what fresh drives do."""
    drive, point = bj.load_drive(Path(__file__).parent / "three_pulley.toml")
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for factor, name, color in ((0.0, "as drawn", "#D55E00"), (3.0, "mean - 3 std", "#0072B2")):
        values, promised = best(drive, point, factor)
        seen = fresh(designed(drive, values), point)
        least = seen.mean() - 3 * seen.std()
        print(
            f"best {name:13s} radius {1e3 * values[0]:.2f} mm, angle {np.degrees(values[1]):6.2f} "
            f"deg, promised {promised:.4f}; {FRESH} fresh drives: mean {seen.mean():.4f}, mean - "
            f"3 std {least:.4f}, 1 % below {np.quantile(seen, 0.01):.4f}"
        )
        axes.hist(seen, bins=160, density=True, histtype="step", color=color, label=f"best {name}")
        axes.axvline(least, color=color, linestyle="--", linewidth=1)
    axes.set_xlabel("tensioner effectiveness within the tolerances (dashed: mean - 3 std)")
    axes.set_ylabel("probability density")
    axes.legend(frameon=False)
    figure.savefig(folder / "three_pulley_robust.png", dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path())
