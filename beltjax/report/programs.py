"""Programs kept between runs of the command line, so that a second run traces nothing.

JAX's persistent cache saves compiling but not the tracing before it, which takes longer than all
the rest of a short command. Here the traced program is kept beside that cache, as `jax.export`
writes it, under a name made of everything it depends on.
"""

import hashlib
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
from jax import export

import beltjax
from beltjax.numerics.compilation import quick_options, quickly_compiled
from beltjax.writing import write_whole


def run_kept(function: Callable, *args: Any) -> Any:
    """`function(*args)` for arguments of arrays and static parts, its program kept for next time.

    Without a cache directory it is simply compiled and run; one that cannot be written costs
    only time.
    """
    folder = jax.config.values["jax_compilation_cache_dir"]
    if folder is None:
        return quickly_compiled(function)(*args)
    arrays, static = eqx.partition(args, eqx.is_array)
    leaves, structure = jax.tree.flatten(arrays)
    path = Path(folder) / f"{_key(function, arrays, static)}.program"
    kept = _read(path)
    if kept is None:
        skeletons: list[Any] = []

        def flat(*leaves):
            whole = eqx.combine(jax.tree.unflatten(structure, leaves), static)
            found, rest = eqx.partition(function(*whole), eqx.is_array)
            numbers, shape = jax.tree.flatten(found)
            skeletons.append((jax.tree.unflatten(shape, range(len(numbers))), rest))
            return numbers

        program = export.export(jax.jit(flat))(*leaves)
        kept = program, skeletons[-1]
        _write(path, *kept)
    program, (places, rest) = kept
    numbers = jax.jit(program.call, compiler_options=quick_options())(*leaves)
    return eqx.combine(jax.tree.map(lambda place: numbers[place], places), rest)


def _key(function: Callable, arrays: Any, static: Any) -> str:
    """A name for the program: its code, the versions under it, and the arguments' structure."""
    digest = hashlib.sha256()
    root = Path(beltjax.__file__).parent
    for source in sorted(root.rglob("*.py")):
        digest.update(source.read_bytes())
    shapes = [(leaf.shape, str(leaf.dtype)) for leaf in jax.tree.leaves(arrays)]
    parts = (jax.__version__, jax.default_backend(), function.__qualname__, shapes)
    digest.update(repr((*parts, jax.tree.structure(arrays), static)).encode())
    return digest.hexdigest()[:40]


def _read(path: Path) -> tuple[export.Exported, Any] | None:
    """What was kept there; None where nothing is, or it cannot be read."""
    try:
        content, skeleton = pickle.loads(path.read_bytes())
        return export.deserialize(bytearray(content)), skeleton
    except Exception:  # whatever is wrong with an old file, the program can be traced again
        return None


def _write(path: Path, program: export.Exported, skeleton: Any) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, pickle.dumps((bytes(program.serialize()), skeleton)))
    except OSError:
        return  # a full or read-only disk costs the next run its time, nothing else
