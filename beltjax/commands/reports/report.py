"""The answer to one command: what is printed, what is written, and what failed."""

from typing import Any, NamedTuple

from rich.console import RenderableType


class Report(NamedTuple):
    """The answer to one command."""

    document: dict[str, Any]  # the JSON
    tables: RenderableType
    failure: str  # one line; empty where all went well
    files: tuple[tuple[str, bytes], ...] = ()  # paths and contents, to be written at the end
