"""`python -m beltjax` is the command line."""

from beltjax.cli import main

main()
