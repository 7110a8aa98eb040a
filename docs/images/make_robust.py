"""Draws docs/images/robust.png: the tensioner's effectiveness and its scatter over its angle."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

jax.config.update("jax_enable_x64", True)

import beltjax as bj  # noqa: E402

HERE = Path(__file__).parent
TOLERANCES = {
    "tensioner.angle": bj.optimize.Normal(np.radians(8)),
    "pulley.accessory.center.y": bj.optimize.Normal(0.002),
}


def main() -> None:
    """Nominal value, mean, and three standard deviations below it, each with its best angle."""
    drive, point = bj.load_drive(HERE.parents[1] / "examples" / "three_pulley.toml")

    @jax.jit
    @jax.vmap
    def scatter(angle):
        turned = bj.optimize.with_values(drive, {"tensioner.angle": angle})
        exact = bj.steady_state(turned, point, throw=False).effectiveness
        below = bj.optimize.MeanPlus(-3.0)
        return exact, bj.optimize.robust_value(
            turned, point, "tensioner_effectiveness", TOLERANCES, below, samples=256
        )

    degrees = np.linspace(-30, 70, 401)
    exact, found = scatter(jnp.radians(degrees))
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    mean, spread = np.asarray(found.mean), 3 * np.asarray(found.deviation)
    axes.fill_between(degrees, mean - spread, mean + spread, color="#cfe3f5", label="mean ± 3 std")
    for values, color, label in (
        (np.asarray(exact), "#d62728", "as drawn"),
        (np.asarray(found.value), "#1f77b4", "mean − 3 std"),
    ):
        best = values.argmax()
        axes.plot(degrees, values, color=color, label=f"{label}: best at {degrees[best]:.0f}°")
        axes.plot(degrees[best], values[best], "o", color=color)
    axes.set_xlabel("angle of the tensioner about its pulley (deg)")
    axes.set_ylabel("tensioner effectiveness")
    axes.set_ylim(0.5, 0.9)
    axes.grid(linewidth=0.3)
    axes.legend(frameon=False, loc="lower center")
    figure.savefig(HERE / "robust.png", dpi=110)


if __name__ == "__main__":
    main()
