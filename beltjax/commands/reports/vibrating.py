"""Helpers of the commands that need vibration: they refuse drives without it."""

import os
from collections.abc import Sequence

import numpy as np

from beltjax.analysis.linearization import has_inertias
from beltjax.commands.reports.arguments import Asked, read_drive
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError

MOST_VIBRATING = 40  # pulleys; the work for modes grows with the cube of their number


def require_inertias(drive: Drive, path: str | os.PathLike[str], what: str) -> None:
    """Raise `FileError`, which names the first inertia that is missing and `what` needs it."""
    if not has_inertias(drive):
        lacking = [f"pulley.{p.name}.inertia" for p in drive.pulleys if p.inertia is None]
        key = (lacking or ["tensioner.inertia"])[0]
        raise FileError(path, key, f"is missing; {what} the inertia of every pulley and of the arm")


def require_few_pulleys(drive: Drive, path: str | os.PathLike[str], what: str) -> None:
    """Raise `FileError` where a drive has more pulleys than `what` can be found for."""
    if len(drive.pulleys) > MOST_VIBRATING:
        message = f"found {len(drive.pulleys)}; {what} are found for {MOST_VIBRATING} at most"
        raise FileError(path, "pulley", message)


RPM = 60 / (2 * np.pi)  # of 1 rad/s


def vibrating(path: str | os.PathLike[str], duty: str | None = None) -> Asked:
    """`read_drive`; raises `FileError` where no vibration can be found for it."""
    asked = read_drive(path, duty)
    require_inertias(asked.drive, path, "vibration needs")
    require_few_pulleys(asked.drive, path, "modes and responses")
    return asked


def all_failed(path: str | os.PathLike[str], key: str, outcomes: Sequence[str]) -> str:
    """The failure of a command none of whose points succeeded; empty where one did."""
    return str(FileError(path, key, f"no point succeeded: {outcomes[0]}")) if all(outcomes) else ""
