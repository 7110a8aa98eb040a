"""`python -m beltjax.validation --out DIR`: every table and figure of the source."""

import os
import sys
import tempfile
from pathlib import Path

import click

INVALID, DIFFERENT = 1, 2


@click.command("validation", context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--out", required=True, metavar="DIR", help="Folder for pictures, data and table.")
def main(out: str) -> None:
    """Make every table and figure of Kong (2003) again, and compare what is printed.

    Writes figure_C_NN.svg, .png and .nc (NetCDF), table_C_N.csv, and all verdicts as verdicts.csv
    and .md. Exit status: 0; 1 for a folder that cannot be written, with nothing written; 2 where a
    printed number differs.
    """
    folder = Path(out)
    try:
        _require_writable(folder)
        # Before JAX and NumPy start: small eigenproblems, where a second thread only waits.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        import jax

        jax.config.update("jax_enable_x64", True)
        from beltjax.validation.everything import TABLE, write_everything
        from beltjax.validation.verdicts import DIFFERS, markdown_text, summary

        lines = write_everything(folder, lambda what: click.echo(what, err=True))
    except OSError as error:
        click.echo(f"validation: {out}: cannot be written ({error.strerror}); give a folder that "
                   "can", err=True)  # fmt: skip
        sys.exit(INVALID)
    click.echo(markdown_text(lines))
    click.echo(f"{summary(lines)}; {folder / TABLE}.md")
    sys.exit(DIFFERENT if any(line.verdict == DIFFERS for line in lines) else 0)


def _require_writable(folder: Path) -> None:
    """Make the folder, and a file in it that goes away again; raises `OSError`."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        pass


def run() -> None:
    """The command, which says in one line what is wrong with its arguments."""
    try:
        main(standalone_mode=False)
    except click.ClickException as error:
        click.echo(f"validation: {error.format_message()}", err=True)
        sys.exit(INVALID)


if __name__ == "__main__":
    run()
