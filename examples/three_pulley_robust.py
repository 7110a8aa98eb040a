"""A robust study: the least Gamma whose tensioner stays effective under production's tolerances.

    python examples/three_pulley_robust.py [FOLDER]

Solves three_pulley_robust_study.toml as drawn and with its tolerances, confirms both designs by
100,000 fresh drives each, and draws how their effectiveness scatters into
FOLDER/three_pulley_robust.png. `beltjax optimize examples/three_pulley_robust_study.toml` does the
middle part alone.
"""

import dataclasses
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

jax.config.update("jax_enable_x64", True)

import beltjax as bj  # noqa: E402

FRESH = 100_000
LIMITED = {"tensioner_effectiveness": 0.854, "speed_ratio:accessory": 2.5}


def fresh(study, drive):
    """Gamma and the limited quantities of drives that no optimizer has seen [drives, 3]."""
    scatter, rng = study.scatter, np.random.default_rng(2026)
    points = rng.uniform(size=(10, FRESH // 10, len(scatter.names)))
    nominal = np.array([bj.optimize.value_of(drive, name) for name in scatter.names])

    @jax.jit
    @jax.vmap
    def look(points):
        moved = [kind.at(p) for kind, p in zip(scatter.tolerances, points, strict=True)]
        values = dict(zip(scatter.names, nominal + jnp.stack(moved), strict=True))
        changed = bj.optimize.with_values(drive, values)
        of = bj.optimize.DriveAnalyses(
            changed, study.point, bj.steady_state(changed, study.point, throw=False)
        )
        names = "coupling", *LIMITED
        return jnp.concatenate([bj.optimize.find_quantity(n, changed).measure(of) for n in names])

    return np.concatenate([np.asarray(look(part)) for part in points])


def main(folder: Path) -> None:
    """Both designs, what they promise and what fresh drives do."""
    robust = bj.optimize.load_study(Path(__file__).parent / "three_pulley_robust_study.toml")
    studies = {
        "as drawn": (dataclasses.replace(robust, scatter=None), "#D55E00"),
        "robust": (robust, "#0072B2"),
    }
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for name, (study, color) in studies.items():
        design = bj.optimize.minimize(study)
        gamma, eta, ratio = fresh(robust, design.drive).T
        above = gamma.mean() + 3 * gamma.std()
        missed = [np.mean(x < low) for x, low in zip((eta, ratio), LIMITED.values(), strict=True)]
        values = ", ".join(f"{key} {value:.5g}" for key, value in design.values.items())
        print(
            f"{name}: {values}\n  promised Gamma {design.final:.4f}; {FRESH} fresh drives: mean "
            f"{gamma.mean():.4f}, mean + 3 std {above:.4f}; effectiveness missed by "
            f"{missed[0]:.2%}, speed ratio by {missed[1]:.2%}"
        )
        axes.hist(eta, bins=160, density=True, histtype="step", color=color, label=name)
    axes.axvline(LIMITED["tensioner_effectiveness"], color="black", linestyle="--", linewidth=1)
    axes.set_xlabel("tensioner effectiveness within the tolerances (dashed: its limit)")
    axes.set_ylabel("probability density")
    axes.legend(frameon=False)
    figure.savefig(folder / "three_pulley_robust.png", dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path())
