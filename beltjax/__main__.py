"""The command line, `beltjax` or `python -m beltjax`: nothing is imported outside of the guard."""

import sys
from typing import NoReturn

INTERRUPTED = 130


def main() -> NoReturn:
    """Run the command line; an interrupt, even during the imports, ends it in one line."""
    try:
        from beltjax.commands.cli import run

        status = run()
    except KeyboardInterrupt:
        sys.stderr.write("beltjax: interrupted; nothing more was written\n")
        status = INTERRUPTED
    sys.exit(status)


if __name__ == "__main__":
    main()
