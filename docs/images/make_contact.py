"""Make the pictures of docs/contact.md: python docs/images/make_contact.py."""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp

jax.config.update("jax_enable_x64", True)

import beltjax as bj  # noqa: E402
from beltjax.draw.contact import contact_figure, two_models_figure  # noqa: E402
from beltjax.draw.layouts import picture_bytes  # noqa: E402

HERE = Path(__file__).parent
EXAMPLES = HERE.parents[1] / "examples"


def main() -> None:
    """Draw both pictures beside this file."""
    drive, point = bj.load_drive(EXAMPLES / "seven_pulley.toml")
    _write("contact_maximum.png", contact_figure(drive, bj.maximum_moment(drive, point)))
    drive, point = bj.load_drive(EXAMPLES / "two_pulley_table_5_1.toml")
    states = []
    for stiffness in (0.0015, 0.015, 0.05):
        belt = jnp.asarray(stiffness)
        stiff = eqx.tree_at(lambda d: d.belt.bending_stiffness, drive, belt)
        answers = bj.contact_state(stiff, point), bj.steady_state(stiff, point)
        states.append((f"EI = {stiffness} N m²", *answers))
    _write("contact_models.png", two_models_figure(drive, states))


def _write(name: str, picture) -> None:
    (HERE / name).write_bytes(picture_bytes(picture, name))


if __name__ == "__main__":
    main()
