"""Files written in one move: complete or absent."""

import os
import tempfile
from pathlib import Path


def is_special(path: str | os.PathLike[str]) -> bool:
    """Whether there is something to be written to, not replaced: a pipe, a device."""
    return os.path.exists(path) and not os.path.isfile(path)


def write_whole(path: str | os.PathLike[str], content: bytes) -> None:
    """Put `content` at `path`; a pipe or a device there is written to, not replaced."""
    target = Path(path)
    if is_special(target):
        target.write_bytes(content)
        return
    try:
        handle, partial = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.resolve().parent)
    except OSError as error:
        error.filename = str(path)  # not the name that only this function knows
        raise
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(partial, 0o666 & ~mask)
        os.replace(partial, target)
    except BaseException:
        os.unlink(partial)
        raise
