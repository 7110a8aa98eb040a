"""The command line: `beltjax analyze DRIVE.toml`, `beltjax optimize STUDY.toml` and the like.

Exit status: 0; 1 for an invalid file or argument, with nothing written; 2 for a valid question
whose answer is a failure, with the JSON written and its `success` false.
"""

import atexit
import gc
import os
import sys
import warnings

import click

from beltjax.commands.registry import group, registered
from beltjax.commands.running import FAILED, INVALID, leave
from beltjax.files.errors import FileError


def run() -> int:
    """Run the command line: the exit status; every error is one line."""
    _spare_collector()
    # Small eigenproblems: a second thread of OpenBLAS only waits, for seconds on a busy machine.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    warnings.simplefilter("ignore")  # of libraries: about fonts, caches, platforms
    registered()
    try:
        with group.make_context("beltjax", sys.argv[1:]) as context:
            group.invoke(context)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.ctx.get_help())
        return INVALID
    except click.exceptions.Exit as end:
        return int(end.exit_code)
    except click.ClickException as error:
        leave(error.format_message(), INVALID)
    except FileError as error:
        leave(str(error), INVALID)
    except BrokenPipeError:
        # The reader of the output has closed it; nothing can be printed any more.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except OSError as error:
        leave(f"{error.filename}: cannot be written ({error.strerror})", INVALID)
    return 0


def _spare_collector() -> None:
    """Search seldom for cycles of objects, and not once more when all ends.

    A command makes many objects and few cycles: the searches are a third of a short one's time.
    """
    gc.set_threshold(200_000, 10, 10)
    atexit.register(gc.freeze)
