"""Programs kept between runs of the command line, so that a second run traces and compiles nothing.

JAX's persistent cache saves compiling but not the tracing and lowering before it, which take
longer than all the rest of a short command. Here the compiled program is kept beside that cache,
under a name made of everything it depends on.
"""

import concurrent.futures
import functools
import hashlib
import os
import pickle
import platform
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jaxlib.version
from jax.experimental import serialize_executable

import beltjax
from beltjax.compiling.fusion import with_bounded_fusion
from beltjax.compiling.quick import (
    Form,
    flat_call,
    in_form,
    quick_options,
    quickly_compiled,
)
from beltjax.files.writing import made_private, write_whole

_KEPT = "jax_persistent_cache_min_compile_time_secs"


_keeping = [True]


def keep_no_programs() -> None:
    """Compile anew from now on: code has been added that a program's name does not depend on."""
    _keeping[0] = False


def only_own_code() -> bool:
    """Whether all code is that of this library: other processes have the same."""
    return _keeping[0]


def run_kept(function: Callable, *args: Any) -> Any:
    """`function(*args)` for arguments of arrays and static parts, its program kept for next time.

    Without a cache directory that is the user's own, and elsewhere than on a CPU, it is simply
    compiled and run.
    """
    return kept_call(function, *args)(*args)


def kept_call(function: Callable, *args: Any) -> Callable:
    """`function` for arguments like these, which differ in the values of their arrays alone.

    Who calls it often reads the kept program but once. Kept where `run_kept` keeps it.
    """
    folder = jax.config.values["jax_compilation_cache_dir"]
    # Reading a kept program runs what is written in it.
    kept_here = _keeping[0] and jax.default_backend() == "cpu"
    if folder is None or not kept_here or not made_private(folder):
        return quickly_compiled(function)
    call = flat_call(function, *args)
    path = Path(folder) / f"{_key(function, args)}.program"
    kept = _read(path, len(call.arrays))
    if kept is None:
        program = _compiled(with_bounded_fusion(call.function), call.arrays)
        kept = program, call.forms[-1]
        _write(path, *kept)
    program, form = kept
    return lambda *like: in_form(program(*flat_call(function, *like).arrays), form)


def _compiled(function: Callable, arrays: list[Any]) -> jax.stages.Compiled:
    """`function`, compiled and not written to JAX's own cache."""
    lowered, options = jax.jit(function).lower(*arrays), quick_options()
    before = jax.config.values[_KEPT]
    jax.config.update(_KEPT, float("inf"))
    try:
        return lowered.compile(options)
    finally:
        jax.config.update(_KEPT, before)


def _key(function: Callable, args: Any) -> str:
    """A name for the program: its code, what compiles it, and the arguments' structure."""
    digest = hashlib.sha256(_digest_of_code())
    arrays, static = eqx.partition(args, eqx.is_array)
    shapes = [(leaf.shape, str(leaf.dtype)) for leaf in jax.tree.leaves(arrays)]
    parts = (jax.__version__, jaxlib.version.__version__, os.environ.get("XLA_FLAGS"), _processor())
    parts += (function.__qualname__, shapes, jax.tree.structure(arrays), eqx.tree_pformat(static))
    digest.update(repr(parts).encode())
    return digest.hexdigest()[:40]


@functools.cache
def _digest_of_code() -> bytes:
    """A digest of this library's source."""
    digest = hashlib.sha256()
    for source in sorted(Path(beltjax.__file__).parent.rglob("*.py")):
        digest.update(source.read_bytes())
    return digest.digest()


@functools.cache
def _processor() -> str:
    """The processor and what it can do: compiled code of another one may not run."""
    try:
        lines = Path("/proc/cpuinfo").read_text().split("\n\n")[0].splitlines()
    except OSError:  # not Linux
        return f"{platform.machine()} {platform.processor()}"
    return "".join(line for line in lines if line.startswith(("model name", "flags", "Features")))


def _read(path: Path, count: int) -> tuple[jax.stages.Compiled, Form] | None:
    """The program of `count` arrays kept there; None where nothing is, or it cannot be read."""
    try:
        content, form = pickle.loads(zlib.decompress(path.read_bytes()))
        given = jax.tree.structure(((0,) * count, {}))
        found = jax.tree.structure([0] * len(jax.tree.leaves(form.places)))
        with concurrent.futures.ThreadPoolExecutor() as pool:
            program = pool.submit(serialize_executable.deserialize_and_load, content, given, found)
            _load_lapack()  # meanwhile
            return program.result(), form
    except Exception:  # whatever is wrong with an old file, the program can be made again
        return None


@functools.cache
def _load_lapack() -> None:
    """Have JAX load LAPACK: lowering does it, which a program that is read does without."""
    jax.jit(jax.numpy.linalg.cholesky).lower(jax.ShapeDtypeStruct((1, 1), float))


def _write(path: Path, program: jax.stages.Compiled, form: Form) -> None:
    content, _, _ = serialize_executable.serialize(program)
    try:
        write_whole(path, zlib.compress(pickle.dumps((content, form)), level=1))
    except OSError:
        return  # a full disk costs the next run its time, nothing else
