"""Make the picture of docs/grooves.md: python docs/images/make_grooves.py."""

from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import beltjax as bj  # noqa: E402
from beltjax.draw.groove import groove_figure  # noqa: E402
from beltjax.draw.layouts import picture_bytes  # noqa: E402

HERE = Path(__file__).parent


def main() -> None:
    """Draw the picture beside this file."""
    drive, point = bj.load_drive(HERE.parents[1] / "examples" / "two_pulley_groove.toml")
    name = "grooves.png"
    state = bj.groove_state(drive, point)
    (HERE / name).write_bytes(picture_bytes(groove_figure(drive, state), name))


if __name__ == "__main__":
    main()
