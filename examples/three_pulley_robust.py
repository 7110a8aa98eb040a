"""A robust study: the design whose Gamma is least at mean plus three standard deviations.

    python examples/three_pulley_robust.py [FOLDER]

Chooses the accessory's radius and the tensioner's angle of the three-pulley drive under tolerances
on belt, centers and tension, once for the drive as drawn and once for its scatter, confirms both by
100,000 fresh drives each, and draws their distributions into FOLDER/three_pulley_robust.png.
"""

import sys
from pathlib import Path

import jax
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.optimize import minimize

jax.config.update("jax_enable_x64", True)

import beltjax as bj  # noqa: E402

TOLERANCES = {
    "belt.bending_stiffness": bj.optimize.Normal(1.5e-3),
    "pulley.accessory.center.y": bj.optimize.Normal(1e-3),
    "tensioner.angle": bj.optimize.Normal(np.radians(6)),
    "installation.tension": bj.optimize.Uniform(40.0),
}
LOWER, UPPER = np.array([0.022, np.radians(-70)]), np.array([0.045, np.radians(20)])
EFFECTIVE = 0.7  # least tensioner effectiveness, in three standard deviations or as drawn
FRESH = 100_000


def designed(drive, values):
    """The drive with an accessory radius [m] and a tensioner angle [rad]."""
    names = "pulley.accessory.radius", "tensioner.angle"
    return bj.optimize.with_values(drive, dict(zip(names, values, strict=True)))


def best(drive, point, factor):
    """The design of least Gamma, `factor` standard deviations counted against it."""

    def measured(u):
        changed = designed(drive, LOWER + u * (UPPER - LOWER))
        up, down = bj.optimize.MeanPlus(factor), bj.optimize.MeanPlus(-factor)
        more = {"tolerances": TOLERANCES, "samples": 128}
        gamma = bj.optimize.robust_value(changed, point, "coupling", measure=up, **more)
        eta = bj.optimize.robust_value(
            changed, point, "tensioner_effectiveness", measure=down, **more
        )
        return jax.numpy.stack([gamma.value, eta.value - EFFECTIVE])

    values, slopes = jax.jit(measured), jax.jit(jax.jacfwd(measured))
    found = minimize(
        lambda u: float(values(u)[0]),
        [0.6, 0.8],
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
    return LOWER + found.x * (UPPER - LOWER), float(values(found.x)[0])


def fresh(drive, point):
    """Gamma of drives that no optimizer has seen."""
    rng = np.random.default_rng(2026)
    sizes = np.array([t.deviation if isinstance(t, bj.optimize.Normal) else t.half_width
                      for t in TOLERANCES.values()])  # fmt: skip
    drawn = np.stack([
        rng.normal(size=FRESH) if isinstance(t, bj.optimize.Normal) else rng.uniform(-1, 1, FRESH)
        for t in TOLERANCES.values()
    ], axis=1) * sizes  # fmt: skip

    def gamma(change):
        moved = dict(zip(TOLERANCES, change, strict=True))
        own = {name: bj.optimize.value_of(drive, name) + moved[name] for name in moved}
        changed = bj.optimize.with_values(drive, own)
        return bj.steady_state(changed, point, throw=False).coupling.sum()

    run = jax.jit(jax.vmap(gamma))
    return np.concatenate([np.asarray(run(part)) for part in drawn.reshape(10, -1, len(sizes))])


def main(folder: Path) -> None:
    """Both designs, what they promise and what fresh drives do."""
    drive, point = bj.load_drive(Path(__file__).parent / "three_pulley.toml")
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for factor, name, color in ((0.0, "mean alone", "#D55E00"), (3.0, "mean + 3 std", "#0072B2")):
        values, promised = best(drive, point, factor)
        seen = fresh(designed(drive, values), point)
        reached = seen.mean() + factor * seen.std()
        above = (seen > seen.mean() + 3 * seen.std()).mean()
        print(
            f"{name:13s} radius {1e3 * values[0]:.2f} mm, angle {np.degrees(values[1]):6.2f} deg: "
            f"promised {promised:.4f}, {FRESH} fresh drives {reached:.4f}; mean {seen.mean():.4f}, "
            f"std {seen.std():.4f}, 99 % below {np.quantile(seen, 0.99):.4f}, "
            f"{100 * above:.2f} % beyond 3 std"
        )
        axes.hist(seen, bins=120, density=True, histtype="step", color=color, label=name)
        axes.axvline(seen.mean() + 3 * seen.std(), color=color, linestyle="--", linewidth=1)
    axes.set_xlabel("Gamma of drives within the tolerances (dashed: mean + 3 std)")
    axes.set_ylabel("probability density")
    axes.legend(frameon=False)
    figure.savefig(folder / "three_pulley_robust.png", dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path())
