"""The run of a command: it checks outputs first, shows progress, then writes files and tables.

Nothing that is slow to load is imported before the arguments are checked.
"""

import contextlib
import importlib.util
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click

if TYPE_CHECKING:
    from beltjax.commands.reports.report import Report

INVALID, FAILED = 1, 2  # exit statuses
_CSV, _XLSX = "beltjax.csv", "beltjax.xlsx"  # in a command's context
PICTURES = (".png", ".pdf", ".svg")

Advance = Callable[[str, int, int | None], None]  # is called with stage, done and total


def answer(
    work: Callable[[Advance], "Report"],
    *,
    read: str,
    json: str | None,
    written: tuple[str | None, ...] = (),
    pictures: tuple[str | None, ...] = (),
    resumed: str | None = None,
    busy: str = "",
) -> None:
    """Check a command's files, do its work and write what it reports.

    `read` is the file that the command reads; `json`, `written` and `pictures` are files that it
    writes, None where they are not wanted, and so are those that --csv and --xlsx name;
    `resumed` is a path that may hold an earlier run. With `busy`, a text, a moving sign is shown in
    place of a bar of progress.
    """
    meta = click.get_current_context().meta
    csv, xlsx = meta.get(_CSV), meta.get(_XLSX)
    if xlsx is not None and importlib.util.find_spec("openpyxl") is None:
        message = "openpyxl is not installed: pip install 'beltjax[xlsx]', or give --csv"
        raise click.ClickException(f"--xlsx: {message}")
    _check_outputs(read, json, csv, xlsx, *written, *pictures, resumed=resumed)
    for path in pictures:
        _check_picture(path)
    prepare_jax()
    with _sign(f"{busy}; the first run on a machine compiles") if busy else _bar() as advance:
        report = work(advance)
    _finish(report, json, csv, xlsx)


def keep_csv_path(context: click.Context, parameter: click.Parameter, path: str | None) -> None:
    """Keep the path of the option --csv, which all commands have, for `answer`."""
    context.meta[_CSV] = path


def keep_xlsx_path(context: click.Context, parameter: click.Parameter, path: str | None) -> None:
    """Likewise of the option --xlsx."""
    context.meta[_XLSX] = path


def leave(message: str, status: int) -> NoReturn:
    """End the process with a status, and one line on standard error."""
    click.echo(f"beltjax: {' '.join(message.split())}", err=True)
    sys.exit(status)


def _check_outputs(source: str, *paths: str | None, resumed: str | None) -> None:
    """Refuse outputs that cannot or must not be written before the work, not after it."""
    from beltjax.files.writing import refusal

    _require_apart(source, *paths, resumed)
    for path in filter(None, paths):
        why = "" if path == "-" else refusal(path)
        if why:
            raise click.ClickException(f"{path}: {why}")


def _require_apart(source: str, *paths: str | None) -> None:
    """Refuse outputs that are the file that is read, a study's drive file, or one another."""
    from beltjax.files.writing import is_same, is_special

    read = [source, *_drive_file_of(source)]
    written: list[str] = []
    for path in filter(None, paths):
        if path == "-" or is_special(path):
            continue
        if any(is_same(path, other) for other in read):
            raise click.ClickException(
                f"{path}: is a file that is read; give another to be written"
            )
        twice = [other for other in written if is_same(path, other)]
        if twice:
            also = "" if path == twice[0] else f", also as {twice[0]}"
            raise click.ClickException(f"{path}: is given for two outputs{also}; give two files")
        written.append(path)


def _drive_file_of(source: str) -> list[str]:
    """The drive file that a study names; none where it is no study.

    Raises `FileError` for what cannot be read at all, before anything slow is loaded.
    """
    from beltjax.files.reading import read_toml

    named = read_toml(source).get("drive")
    return [os.path.join(os.path.dirname(source), named)] if isinstance(named, str) else []


def _check_picture(path: str | None) -> None:
    """Refuse a name from which no kind of picture follows."""
    if path is not None and Path(path).suffix.lower() not in PICTURES:
        raise click.ClickException(f"{path}: is no picture; end its name in {', '.join(PICTURES)}")


def prepare_jax() -> None:
    """Double precision, and compiled code kept in the user's cache for the next run."""
    import jax

    from beltjax.compiling.cache import use_cache

    jax.config.update("jax_enable_x64", True)
    use_cache()


@contextlib.contextmanager
def _sign(what: str) -> Iterator[Advance]:
    """A moving sign on a terminal while one long thing is done."""
    from rich.console import Console

    with Console(stderr=True).status(what):
        yield lambda stage, done, total: None


@contextlib.contextmanager
def _bar() -> Iterator[Advance]:
    """A progress bar on a terminal."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("reading", total=None)

        def advance(stage: str, done: int, total: int | None) -> None:
            bar.update(task, description=stage, completed=done, total=total)

        yield advance


def _finish(
    report: "Report", json_path: str | None, csv_path: str | None, xlsx_path: str | None
) -> None:
    """Write the files, print the tables or the JSON, and leave with the right status."""
    from rich.console import Console

    from beltjax.commands.reports.documents import complete, json_bytes, json_text
    from beltjax.commands.reports.tables import csv_bytes, width_of, xlsx_bytes
    from beltjax.files.writing import write_together

    document = complete(report.document)
    files, failed = list(report.files), None
    if json_path and json_path != "-":
        files.append((json_path, json_bytes(document)))
    if csv_path:
        files.append((csv_path, csv_bytes(report.tables)))
    if xlsx_path:
        files.append((xlsx_path, xlsx_bytes(report.tables)))
    try:
        write_together(files)
    except OSError as error:
        failed = error  # the answer is shown all the same
    if json_path == "-":
        click.echo(json_text(document))
    else:
        console = Console()
        # Piped into a file there is no width to fit; names must not be cut there.
        console.width = console.width if console.is_terminal else width_of(report.tables)
        console.print(report.tables)
        if files and not failed:
            click.echo(f"wrote {', '.join(path for path, _ in files)}")
    if failed:
        raise failed
    if report.failure:
        leave(report.failure, FAILED)
