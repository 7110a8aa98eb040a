"""Files written in one move, alone or together: complete or absent."""

import os
import stat
import tempfile
from collections.abc import Iterable
from pathlib import Path

Output = str | os.PathLike[str]


def is_special(path: Output) -> bool:
    """Return whether a path is to be written to and not replaced, like a pipe or a device."""
    return os.path.exists(path) and not os.path.isfile(path)


def is_same(one: Output, other: Output) -> bool:
    """Return whether two paths, of files that may not exist yet, are one file."""
    if os.path.exists(one) and os.path.exists(other):
        return os.path.samefile(one, other)  # hard links too
    return os.path.realpath(one) == os.path.realpath(other)


def refusal(path: Output) -> str:
    """Say why nothing may be written at `path`; empty where it may be."""
    target = Path(os.path.realpath(path))
    if target.is_dir() or target.is_symlink() or not target.parent.is_dir():  # a link to itself
        return "cannot be written there; give a file in a folder that exists"
    if is_special(target):
        return ""
    if not os.access(target.parent, os.W_OK):
        return "its folder may not be written; give another folder"
    # The superuser may write what is marked read-only, too; the mark is meant.
    if target.exists() and not target.stat().st_mode & 0o222:
        return "is read-only; give another file, or make it writable"
    return "" if not target.exists() or os.access(target, os.W_OK) else "may not be written"


def write_whole(path: Output, content: bytes) -> None:
    """Put `content` at `path`, as `write_together` does."""
    write_together([(path, content)])


def write_together(files: Iterable[tuple[Output, bytes]]) -> None:
    """Put each content at its path, in one move after all are on the disk.

    A symbolic link is kept and the file that it names is written; a file that exists keeps its
    mode. A pipe or a device is written to, not replaced. Raises `OSError`, whose `filename` is
    the path that was given; then none of the files is changed.
    """
    files = list(files)
    moves: list[tuple[str, str]] = []
    try:
        for path, content in files:
            if not is_special(path):
                moves.append(_prepared(path, content))
        for path, content in files:
            if is_special(path):
                Path(path).write_bytes(content)
        while moves:
            os.replace(*moves[0])
            _sync(os.path.dirname(moves.pop(0)[1]))
    finally:
        for partial, _ in moves:
            os.unlink(partial)


def _prepared(path: Output, content: bytes) -> tuple[str, str]:
    """A file beside the one that `path` means, whole and on the disk, and that one's name."""
    why = refusal(path)
    if why:
        raise PermissionError(0, why, str(path))
    target = os.path.realpath(path)
    folder, name = os.path.split(target)
    partial = None
    try:
        handle, partial = tempfile.mkstemp(prefix=f".{name[:50]}.", dir=folder)
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(partial, _mode(target))
    except BaseException as error:
        if partial is not None:
            os.unlink(partial)
        if isinstance(error, OSError):
            error.filename = str(path)  # not the name that only this function knows
        raise
    return partial, target


def _mode(target: str) -> int:
    """The mode of the file that is replaced, or that of a new one."""
    if os.path.exists(target):
        return stat.S_IMODE(os.stat(target).st_mode)
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def _sync(folder: str) -> None:
    """Have the disk keep a move within a folder; where folders cannot be opened, do nothing."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    except OSError:
        pass  # of a file system that knows no such thing: the file itself is on the disk
    finally:
        os.close(handle)


def made_private(folder: Output) -> bool:
    """Make a folder; return whether it is the user's own and no one else may write there.

    What is loaded from a cache is run: nobody else may have put it there.
    """
    try:
        os.makedirs(folder, mode=0o700, exist_ok=True)
        found = os.stat(folder)
    except OSError:
        return False
    if hasattr(os, "getuid") and (found.st_uid != os.getuid() or found.st_mode & 0o022):
        return False
    return os.access(folder, os.R_OK | os.W_OK | os.X_OK)
