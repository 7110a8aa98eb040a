"""The folder in which compiled programs are kept between runs."""

import os
import warnings
from pathlib import Path

import jax
from jax.experimental.compilation_cache import compilation_cache

from beltjax.files.writing import made_private


def use_cache(folder: str | os.PathLike[str] | None = None) -> Path | None:
    """Keep what JAX compiles from now on in a folder, where later processes find it.

    A later process traces a function anew but does not compile it: what waited minutes then waits
    seconds. It concerns all that JAX compiles in this process. Importing the library does not call
    it; the command line does. What is loaded from the cache is run, so that a folder that is given
    must be the user's own, with no right for others to write there. Where that is not so, or
    nothing can be written, everything is compiled as without a cache. The files may be deleted at
    any time.

    Args:
        folder: where to keep it, made where it is missing. Unless given that of the environment
            variable JAX_COMPILATION_CACHE_DIR, or the folder of the command line: `beltjax` among
            the user's caches, on Linux ~/.cache/beltjax.

    Returns:
        The folder, or None with a `UserWarning` where it cannot be used.

    Examples:
        >>> import beltjax as bj
        >>> kept = bj.use_cache()  # before the first call that compiles, or later
    """
    named = os.environ.get("JAX_COMPILATION_CACHE_DIR") if folder is None else None
    path = Path(os.path.abspath(os.path.expanduser(named or folder or _own_folder())))
    # JAX uses the folder of the environment whatever is done here: who names it answers for it.
    if not named and not made_private(path):
        why = "cannot be written, or others may write there; give a folder of your own"
        warnings.warn(f"use_cache: {path}: {why}. Nothing is kept.", UserWarning, stacklevel=2)
        return None
    jax.config.update("jax_compilation_cache_dir", str(path))
    # The library compiles many programs of little work: each would be compiled anew otherwise.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)
    # JAX looks but once whether there is a cache, at the first program that it compiles.
    compilation_cache.reset_cache()
    return path


def _own_folder() -> str:
    from platformdirs import user_cache_dir  # where no folder is named

    return user_cache_dir("beltjax")
