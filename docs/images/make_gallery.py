"""Make the pictures of docs/gallery.md: python docs/images/make_gallery.py."""

import re
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import beltjax as bj  # noqa: E402
from beltjax.draw.layouts import layout_figure, picture_bytes  # noqa: E402

HERE = Path(__file__).parent
EXAMPLES = HERE.parents[1] / "examples"


def main() -> None:
    """Draw each drive of the gallery, beside this file."""
    page = (HERE.parent / "gallery.md").read_text()
    for name in re.findall(r"examples/(\w+)\.toml", page):
        drive, _ = bj.load_drive(EXAMPLES / f"{name}.toml")
        picture = layout_figure(drive, bj.layout(drive))
        (HERE / f"gallery_{name}.svg").write_bytes(picture_bytes(picture, "a.svg"))


if __name__ == "__main__":
    main()
