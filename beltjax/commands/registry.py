"""The registry of commands: each file of this folder declares one and registers it.

A new command is one more file here: a function with Click's options, under `command`. What is slow
to load is imported inside of the function, so that `beltjax --help` does not wait for JAX.
"""

import importlib
import pkgutil
import runpy
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import click

import beltjax
from beltjax.commands.running import keep_csv_path, keep_xlsx_path, prepare_jax

if TYPE_CHECKING:
    from rich.table import Table

    from beltjax.commands.reports.documents import Document

_SHARED = ("cli", "registry", "running")  # the files of this folder that declare no command


class RegisteredCommand(NamedTuple):
    """A command of the command line, and the keys of the JSON document that it writes."""

    command: click.Command
    document: Callable[[], type["Document"]]  # imports the class, which is slow to load


_REGISTERED: dict[str, RegisteredCommand] = {}


def _run_first(context: click.Context, parameter: click.Parameter, paths: tuple[str, ...]) -> None:
    """Run Python files, which register what they define."""
    for path in paths:
        from beltjax.compiling.kept_programs import keep_no_programs

        prepare_jax()
        keep_no_programs()
        try:
            runpy.run_path(path)
        except Exception as error:
            reason = f"{type(error).__name__}: {error}"
            raise click.ClickException(f"{path}: cannot be run ({reason})") from error


def _list_quantities(context: click.Context, parameter: click.Parameter, wanted: bool) -> None:
    if wanted:
        from beltjax.commands.reports.listings import quantity_listing

        _print_and_leave(context, quantity_listing())


def _list_optimizers(context: click.Context, parameter: click.Parameter, wanted: bool) -> None:
    if wanted:
        from beltjax.commands.reports.listings import optimizer_listing

        _print_and_leave(context, optimizer_listing())


def _print_and_leave(context: click.Context, table: "Table") -> None:
    from rich.console import Console

    Console(width=120).print(table)
    context.exit()


def _listing_option(
    name: str, callback: Callable[[click.Context, click.Parameter, bool], None], what: str
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    return click.option(
        name, is_flag=True, is_eager=True, expose_value=False, callback=callback,
        help=f"List all {what} and leave.",
    )  # fmt: skip


json_option = click.option(
    "--json", "json_path", metavar="FILE", help="Write one JSON object; '-' for standard output."
)
si_option = click.option("--si", is_flag=True, help="Show SI units, not those of the file.")
# What prints tables has these options without declaring them.
_csv_option = click.option(
    "--csv", metavar="FILE.csv", expose_value=False, callback=keep_csv_path,
    help="Write the tables that are printed.",
)  # fmt: skip
_xlsx_option = click.option(
    "--xlsx", metavar="FILE.xlsx", expose_value=False, callback=keep_xlsx_path,
    help="Write the tables that are printed as a workbook.",
)  # fmt: skip
figure_option = click.option("--figure", metavar="FILE.png", help="Write a picture.")
duty_option = click.option(
    "--duty", metavar="NAME", help="Take this duty of the drive file, not its [operation]."
)
crank_option = click.option(
    "--crank", metavar="AMPLITUDE", help="Turn the driver by this amplitude, zero to peak (rad)."
)
torque_option = click.option(
    "--torque",
    multiple=True,
    metavar="NAME=AMPLITUDE",
    help="Apply a torque of this amplitude to a pulley (N m).",
)
order_option = click.option(
    "--order",
    type=float,
    help="Excite so often per rotation of the driver; 2 unless the file says.",
)
orders_option = click.option(
    "--orders",
    metavar="ORDER=AMPLITUDE[@PHASE],..",
    help="Turn the driver at several orders, in place of --crank and --order.",
)
driver_option = click.option(
    "--driver",
    type=click.Choice(["prescribed", "free"]),
    help="Give the driver's rotation, or let it turn freely by its torque; as the file says.",
)
modal_damping_option = click.option(
    "--modal-damping", type=float, help="Damp every mode by this ratio; 0.02 unless given."
)
belt_damping_option = click.option(
    "--belt-damping",
    metavar="TIME",
    help='Damp the stretch of the belt by this time, as "0.2 ms", in place of the modes.',
)
report_option = click.option(
    "--report", "page", metavar="FILE.html", help="Write a report that opens in a browser."
)
quantity_option = click.option(
    "--quantity",
    multiple=True,
    metavar="NAME",
    help='Measure this quantity of a study; "coupling" unless given.',
)
seed_option = click.option(
    "--seed",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    help="Draw the sample of this seed.",
)
quantities_option = _listing_option("--quantities", _list_quantities, "quantities")
optimizers_option = _listing_option("--methods", _list_optimizers, "optimizers")


def functions_option(usual: int) -> Callable[[Callable], Callable]:
    """The option of how many functions describe a span, so many unless given."""
    return click.option(
        "--functions",
        type=click.IntRange(0, 32),
        default=usual,
        show_default=True,
        help="Describe the deflection of each span by so many functions.",
    )


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(beltjax.__version__)
@click.option(
    "--extend",
    multiple=True,
    metavar="FILE.py",
    is_eager=True,
    expose_value=False,
    callback=_run_first,
    help="Run a Python file first that registers quantities, optimizers, belt laws or commands.",
)
def group() -> None:
    """Analysis and design of serpentine belt drives."""


def command(
    document: Callable[[], type["Document"]], *, prints: bool = True
) -> Callable[[Callable[..., None]], click.Command]:
    """Register a function as the command of its name.

    `document` returns the class that describes the command's JSON document; the JSON Schemas and
    docs/documents.md are made from it. One that `prints` tables writes them to files, too.
    """

    def register(function: Callable[..., None]) -> click.Command:
        made = group.command()(_csv_option(_xlsx_option(function)) if prints else function)
        _REGISTERED[str(made.name)] = RegisteredCommand(made, document)
        return made

    return register


def registered() -> dict[str, RegisteredCommand]:
    """All commands by their names; imports the files of this folder that declare them."""
    package = importlib.import_module(__package__ or "")
    for module in pkgutil.iter_modules(package.__path__):
        if not module.ispkg and module.name not in _SHARED:
            importlib.import_module(f"{__package__}.{module.name}")
    return dict(sorted(_REGISTERED.items()))
