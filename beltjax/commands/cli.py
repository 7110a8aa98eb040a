"""The command line: `beltjax analyze DRIVE.toml`, `beltjax optimize STUDY.toml` and the like.

Exit status: 0; 1 for an invalid file or argument, with nothing written; 2 for a valid question
whose answer is a failure, with the JSON written and its `success` false.
"""

import atexit
import contextlib
import gc
import os
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import click

import beltjax
from beltjax.files.errors import FileError

INVALID, FAILED = 1, 2
PICTURES = (".png", ".pdf", ".svg")
METHODS = ("augmented-lagrangian", "slsqp", "trust-constr", "ipopt")

_json_option = click.option(
    "--json", "json_path", metavar="FILE", help="Write one JSON object; '-' for standard output."
)

_figure_option = click.option("--figure", metavar="FILE.png", help="Write a picture.")


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(beltjax.__version__)
def cli() -> None:
    """Analysis and design of serpentine belt drives."""


@cli.command()
@click.argument("drive_file", metavar="DRIVE.toml")
@_json_option
@_figure_option
def analyze(drive_file: str, json_path: str | None, figure: str | None) -> None:
    """Layout, tensions, belt-pulley coupling Gamma, modes, and what moves Gamma."""
    _check_outputs(drive_file, json_path, figure)
    _check_picture(figure)
    _prepare_jax()
    with _busy("analyzing; the first run on a machine compiles"):
        from beltjax.commands.jobs.analyze import analysis_job

        report = analysis_job(drive_file, figure)
    _finish(report, json_path)


@cli.command()
@click.argument("study_file", metavar="STUDY.toml")
@_json_option
@click.option("--figure", metavar="FILE.png", help="Picture of the layout before and after.")
@click.option("--out", "--save-drive", "drive", metavar="DRIVE.toml", help="Optimized drive.")
@click.option("--report", "page", metavar="FILE.html", help="Report that opens in a browser.")
@click.option("--method", type=click.Choice(METHODS), help="In place of the study's.")
@click.option("--time-limit", type=click.FloatRange(0, min_open=True), help="In seconds.")
@click.option("--checkpoint", metavar="FILE", help="Keep the search's state; go on from it.")
@click.option("--warm", metavar="FILE.json", help="Also start from the design of an earlier run.")
def optimize(study_file: str, json_path: str | None, figure: str | None, **given: Any) -> None:
    """The design that minimizes an objective under constraints."""
    outputs = (given[name] for name in ("drive", "page", "checkpoint"))
    _check_outputs(study_file, json_path, figure, *outputs)
    _check_picture(figure)
    _prepare_jax()
    with _progress() as advance:
        from beltjax.commands.jobs.optimize import StudyRequest, study_job

        report = study_job(study_file, StudyRequest(figure, **given), advance)
    _finish(report, json_path)


@cli.command()
@click.argument("study_file", metavar="STUDY.toml")
@click.option("--points", type=click.IntRange(2, 200), help="Limits along each objective.")
@_json_option
@_figure_option
def pareto(study_file: str, points: int | None, json_path: str | None, figure: str | None) -> None:
    """Designs of which none is better than another in all of a study's [pareto] objectives."""
    _check_outputs(study_file, json_path, figure)
    _check_picture(figure)
    _prepare_jax()
    with _progress() as advance:
        from beltjax.commands.jobs.pareto import front_job

        report = front_job(study_file, points, figure, advance)
    _finish(report, json_path)


@cli.command()
@click.argument("drive_file", metavar="DRIVE.toml")
@click.option("--over", required=True, metavar="NAME=FROM:TO:POINTS", help="Number and range.")
@click.option("--count", default=8, show_default=True, help="How many modes.")
@click.option("--orders", default="2,4", show_default=True, help="Lines over a speed.")
@_json_option
@click.option("--netcdf", metavar="FILE.nc", help="Write every row, with units.")
@_figure_option
def sweep(
    drive_file: str,
    over: str,
    count: int,
    orders: str,
    json_path: str | None,
    netcdf: str | None,
    figure: str | None,
) -> None:
    """Gamma and natural frequencies over any number of the drive file, each mode followed.

    For example --over "operation.driver_speed=600 rpm:6000 rpm:121"; bare numbers are SI.
    """
    _check_outputs(drive_file, json_path, netcdf, figure)
    _check_picture(figure)
    _prepare_jax()
    with _progress() as advance:
        from beltjax.commands.jobs.sweep import sweep_job

        report = sweep_job(drive_file, over, count, orders, netcdf, figure, advance)
    _finish(report, json_path)


@cli.command()
@click.argument("drive_file", metavar="DRIVE.toml")
@click.option(
    "--over",
    required=True,
    multiple=True,
    metavar="NAME=FROM:TO:POINTS",
    help="A number and its range; NAME=FROM:TO with --samples. Give one for each number.",
)
@click.option("--samples", type=int, metavar="N", help="Quasi-random designs, not a grid.")
@click.option("--seed", default=0, show_default=True, help="Of the sample.")
@click.option("--out", "store", required=True, metavar="STORE.zarr", help="Written or resumed.")
@click.option(
    "--quantity", multiple=True, metavar="NAME", help='As in a study; "coupling" unless given.'
)
@click.option("--modes", default=0, show_default=True, help="Lowest frequencies to find.")
@click.option("--batch", type=int, metavar="N", help="Designs computed and written at once.")
@click.option("--workers", type=int, metavar="N", help="Processes on this machine, by Dask.")
@click.option("--scheduler", metavar="ADDRESS", help="Of a Dask cluster, tcp://HOST:PORT.")
@_json_option
def explore(
    drive_file: str, quantity: tuple[str, ...], json_path: str | None, store: str, **given: Any
) -> None:
    """Quantities and modes of many designs over any numbers of the drive file.

    Written batch by batch to a Zarr store. Killed or interrupted, the same command goes on.
    """
    _check_outputs(drive_file, json_path)
    _require_apart(drive_file, json_path, store)
    _prepare_jax()
    with _progress() as advance:
        from beltjax.commands.jobs.explore import Exploring, exploration_job

        asked = Exploring(quantities=quantity or ("coupling",), store=store, **given)
        report = exploration_job(drive_file, asked, advance)
    _finish(report, json_path)


@cli.command()
@click.argument("drive_file", metavar="DRIVE.toml")
@click.option(
    "--within", multiple=True, metavar="NAME=SIZE", help="Anywhere up to SIZE from nominal."
)
@click.option(
    "--deviation", multiple=True, metavar="NAME=SIZE", help="Normal, of that standard deviation."
)
@click.option(
    "--quantity", multiple=True, metavar="NAME", help='As in a study; "coupling" unless given.'
)
@click.option("--samples", default=4096, show_default=True, help="Drives looked at.")
@click.option("--seed", default=0, show_default=True, help="Of the sample.")
@click.option("--quantile", default=0.99, show_default=True, help="Of the worst values.")
@click.option("--indices", is_flag=True, help="Shares of the variance from a sample, by SALib.")
@_json_option
def robust(drive_file: str, quantity: tuple[str, ...], json_path: str | None, **given: Any) -> None:
    """What tolerances make of a drive: means, deviations, quantiles, and which one matters.

    For example --within "pulley.idler.center.x=0.5 mm" --deviation installation.tension=15.
    """
    _check_outputs(drive_file, json_path)
    _prepare_jax()
    with _busy("scattering the drive; the first run on a machine compiles"):
        from beltjax.commands.jobs.robust import Asked, robust_job

        report = robust_job(drive_file, Asked(quantities=quantity or ("coupling",), **given))
    _finish(report, json_path)


@cli.command()
@click.argument("drive_file", metavar="DRIVE.toml")
@click.option("--crank", metavar="AMPLITUDE", help="Driver's rotation, zero to peak (rad).")
@click.option("--torque", multiple=True, metavar="NAME=AMPLITUDE", help="On a pulley (N m).")
@click.option("--order", type=float, help="Per rotation of the driver; 2 unless the file says.")
@click.option("--speeds", default="600 rpm:6000 rpm:200", show_default=True, help="Of the driver.")
@click.option("--modal-damping", type=float, help="Ratio of every mode; 0.02 unless given.")
@_json_option
@_figure_option
def response(
    drive_file: str,
    crank: str | None,
    torque: tuple[str, ...],
    order: float | None,
    speeds: str,
    modal_damping: float | None,
    json_path: str | None,
    figure: str | None,
) -> None:
    """Forced vibration over the driver's speed, by crank motion or accessory torque."""
    _check_outputs(drive_file, json_path, figure)
    _check_picture(figure)
    _prepare_jax()
    with _progress() as advance:
        from beltjax.commands.jobs.response import Forcing, response_job

        given = Forcing(crank, torque, order, speeds, modal_damping)
        report = response_job(drive_file, given, figure, advance)
    _finish(report, json_path)


@cli.command()
@click.argument("drive_file", metavar="DRIVE.toml")
@click.option("--maximum", is_flag=True, help="Raise all torques until a pulley slips fully.")
@click.option(
    "--law",
    type=click.Choice(["kong", "hyperelastic"]),
    default="kong",
    show_default=True,
    help="T = EA e, or the law that conserves energy.",
)
@_json_option
@_figure_option
@click.option("--compare", metavar="FILE.png", help="Spans beside those of fixed contact points.")
def contact(
    drive_file: str,
    maximum: bool,
    law: Any,
    json_path: str | None,
    figure: str | None,
    compare: str | None,
) -> None:
    """Where the belt touches, adheres and slips; tensions, speeds, efficiency."""
    _check_outputs(drive_file, json_path, figure, compare)
    _check_picture(figure)
    _check_picture(compare)
    _prepare_jax()
    with _busy("solving contact; the first run on a machine compiles"):
        from beltjax.commands.jobs.contact import contact_job

        report = contact_job(drive_file, maximum, law, figure, compare)
    _finish(report, json_path)


def run() -> int:
    """Run the command line: the exit status; every error is one line."""
    _spare_collector()
    # Small eigenproblems: a second thread of OpenBLAS only waits, for seconds on a busy machine.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    warnings.simplefilter("ignore")  # of libraries: about fonts, caches, platforms
    try:
        with cli.make_context("beltjax", sys.argv[1:]) as context:
            cli.invoke(context)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.ctx.get_help())
        return INVALID
    except click.exceptions.Exit as end:
        return int(end.exit_code)
    except click.ClickException as error:
        _quit(error.format_message(), INVALID)
    except FileError as error:
        _quit(str(error), INVALID)
    except BrokenPipeError:
        # Whoever read the output has seen enough; nothing can be told any more.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except OSError as error:
        _quit(f"{error.filename}: cannot be written ({error.strerror})", INVALID)
    return 0


def _spare_collector() -> None:
    """Search seldom for cycles of objects, and not once more when all ends.

    A command makes many objects and few cycles: the searches are a third of a short one's time.
    """
    gc.set_threshold(200_000, 10, 10)
    atexit.register(gc.freeze)


def _quit(message: str, status: int) -> NoReturn:
    click.echo(f"beltjax: {' '.join(message.split())}", err=True)
    sys.exit(status)


def _check_outputs(source: str, *paths: str | None) -> None:
    """Refuse outputs that cannot or must not be written before the work, not after it."""
    from beltjax.files.writing import refusal

    _require_apart(source, *paths)
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
    if path is not None and Path(path).suffix.lower() not in PICTURES:
        raise click.ClickException(f"{path}: is no picture; end its name in {', '.join(PICTURES)}")


def _prepare_jax() -> None:
    """Double precision, and compiled code kept in the user's cache for the next run."""
    import jax
    from platformdirs import user_cache_dir

    from beltjax.files.writing import made_private

    jax.config.update("jax_enable_x64", True)
    cache = user_cache_dir("beltjax")
    if not os.environ.get("JAX_COMPILATION_CACHE_DIR") and made_private(cache):
        jax.config.update("jax_compilation_cache_dir", cache)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)


@contextlib.contextmanager
def _busy(what: str) -> Iterator[None]:
    """A moving sign on a terminal while one long thing is done."""
    from rich.console import Console

    with Console(stderr=True).status(what):
        yield


@contextlib.contextmanager
def _progress() -> Iterator[Any]:
    """A progress bar on a terminal; hands out a function of (stage, done, total)."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("reading", total=None)

        def advance(stage: str, done: int, total: int | None) -> None:
            bar.update(task, description=stage, completed=done, total=total)

        yield advance


def _finish(report: Any, json_path: str | None) -> None:
    """Write the files, print the tables or the JSON, and leave with the right status."""
    from rich.console import Console

    from beltjax.commands.documents import complete, json_bytes, json_text
    from beltjax.files.writing import write_together

    document = complete(report.document)
    files, failed = list(report.files), None
    if json_path and json_path != "-":
        files.append((json_path, json_bytes(document)))
    try:
        write_together(files)
    except OSError as error:
        failed = error  # the answer is shown all the same
    if json_path == "-":
        click.echo(json_text(document))
    else:
        console = Console()
        # Piped into a file there is no width to fit; names must not be cut there.
        console.width = console.width if console.is_terminal else 120
        console.print(report.tables)
        if files and not failed:
            click.echo(f"wrote {', '.join(path for path, _ in files)}")
    if failed:
        raise failed
    if report.failure:
        _quit(report.failure, FAILED)
