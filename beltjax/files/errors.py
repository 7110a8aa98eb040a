"""Errors of files, which say in one line the file, the key, what was found and what to do."""


class FileError(ValueError):
    """A drive or study file that cannot be used; its text is one line for the user."""

    def __init__(self, path: object, key: str, message: str):
        self.key = printable(key)
        where = f"{path}: {key}" if key else f"{path}"
        super().__init__(printable(f"{where}: {message}"))


def printable(text: str) -> str:
    """`text` in one line; what does not print, or would turn the line about, as its escape."""
    line = " ".join(text.split())
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)
