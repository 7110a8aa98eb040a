"""Make the picture of docs/squeal.md: python docs/images/make_squeal.py."""

import dataclasses
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import beltjax as bj  # noqa: E402
from beltjax.draw.friction import friction_figure  # noqa: E402
from beltjax.draw.layouts import picture_bytes  # noqa: E402

HERE = Path(__file__).parent
EXAMPLES = HERE.parents[1] / "examples"


def main() -> None:
    """Draw the picture beside this file."""
    drive, point = bj.load_drive(EXAMPLES / "seven_pulley.toml")
    law = {"friction_static": 0.6, "friction": 0.3, "friction_speed": 0.3}
    grooved = "alternator", "power steering", "air conditioner"
    pulleys = tuple(
        dataclasses.replace(pulley, **law) if pulley.name in grooved else pulley
        for pulley in drive.pulleys
    )
    drive = dataclasses.replace(drive, pulleys=pulleys)
    found = bj.slip_stability(drive, point, damping=50.0)
    name = "squeal_seven_pulley.png"
    (HERE / name).write_bytes(picture_bytes(friction_figure(drive, found), name))


if __name__ == "__main__":
    main()
