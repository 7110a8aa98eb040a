"""What is wrong with a file, said in one line: file, key, what was found, what to do."""


class FileError(ValueError):
    """A drive or study file that cannot be used; its text is one line for the user."""

    def __init__(self, path: object, key: str, message: str):
        self.key = key
        where = f"{path}: {key}" if key else f"{path}"
        super().__init__(" ".join(f"{where}: {message}".split()))
