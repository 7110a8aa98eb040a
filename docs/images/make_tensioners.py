"""Make the pictures of docs/several_tensioners.md: python docs/images/make_tensioners.py."""

from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import beltjax as bj  # noqa: E402
from beltjax.draw.layouts import before_and_after, picture_bytes  # noqa: E402

HERE = Path(__file__).parent
EXAMPLES = HERE.parents[1] / "examples"


def main() -> None:
    """Draw both studies before and after, beside this file."""
    for name in ("seven_pulley_two_arms_study", "starter_generator_study"):
        study = bj.optimize.load_study(EXAMPLES / f"{name}.toml")
        design = bj.optimize.minimize(study)
        picture = before_and_after(
            (study.drive, design.before.reference.layout),
            (design.drive, design.steady.reference.layout),
            f"{study.drive.name}: objective {design.initial:.4g} to {design.final:.4g}",
        )
        (HERE / f"{name}.png").write_bytes(picture_bytes(picture, "a.png"))


if __name__ == "__main__":
    main()
