"""Declares `beltjax studio`; its work is in `beltjax/studio/`."""

import importlib.util
from typing import TYPE_CHECKING

import click

from beltjax.commands.registry import command
from beltjax.commands.running import prepare_jax

if TYPE_CHECKING:
    from beltjax.commands.reports.documents import Document

_NEEDED = "starlette", "uvicorn", "websockets"


def _document() -> type["Document"]:
    from beltjax.studio.page_file import StudioDocument

    return StudioDocument


@command(_document, prints=False)
@click.argument("file", metavar="DRIVE.toml|STUDY.toml|PAGE.json")
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    help="Serve on this port of this machine; a free one unless given.",
)
@click.option("--no-browser", is_flag=True, help="Open no browser.")
def studio(file: str, port: int, no_browser: bool) -> None:
    """A page to design on: drag pulleys and see everything move, with the way downhill."""
    if any(importlib.util.find_spec(name) is None for name in _NEEDED):
        raise click.ClickException(
            "studio: its server is not installed: pip install 'beltjax[studio]'"
        )
    prepare_jax()
    from beltjax.studio.conversation import Conversation
    from beltjax.studio.page_file import open_any
    from beltjax.studio.server import bound, serve

    opened = open_any(file)
    try:
        at = bound(port)
    except OSError as error:
        message = f"--port: {port} cannot be used ({error.strerror}); give another, or none"
        raise click.ClickException(message) from error
    serve(lambda: Conversation(opened, patient=False), at, not no_browser)
