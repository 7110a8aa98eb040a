"""Compiling for few calls, where the wait for the compiler is most of the work, and for many."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from beltjax.compiling.fusion import KEEP_BARRIERS, with_bounded_fusion

Numbers = TypeVar("Numbers")
Function = TypeVar("Function", bound=Callable)


class Form(NamedTuple):
    """The form in which an answer is put together from its arrays."""

    places: Any  # the answer, with the number of each array in its place
    rest: Any  # what is no array


class Flat(NamedTuple):
    """A call of a function as XLA sees it: arrays in, arrays out."""

    function: Callable[..., list[Array]]
    arrays: list[Array]
    forms: list[Form]  # empty until `function` is traced; the last one is that of its arrays


def flat_call(function: Callable, *args: Any, **kwargs: Any) -> Flat:
    """`function(*args, **kwargs)` for arguments of arrays and static parts."""
    given, static = eqx.partition((args, kwargs), eqx.is_array)
    arrays, structure = jax.tree.flatten(given)
    forms: list[Form] = []

    def flat(*arrays: Array) -> list[Array]:
        args, kwargs = eqx.combine(jax.tree.unflatten(structure, arrays), static)
        found, rest = eqx.partition(function(*args, **kwargs), eqx.is_array)
        numbers, shape = jax.tree.flatten(found)
        forms.append(Form(jax.tree.unflatten(shape, range(len(numbers))), rest))
        return numbers

    return Flat(flat, arrays, forms)


def in_form(numbers: list[Array], form: Form) -> Any:
    """The answer whose arrays are `numbers`."""
    return eqx.combine(jax.tree.map(lambda place: numbers[place], form.places), form.rest)


def usual_promotion(function: Function) -> Function:
    """`function` under JAX's usual rules for mixed ranks and types, whatever the caller's are.

    Who sets `jax_numpy_rank_promotion="raise"` or `jax_numpy_dtype_promotion="strict"` wants their
    own code checked, not this library's.
    """

    @functools.wraps(function)
    def usual(*args: Any, **kwargs: Any) -> Any:
        with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
            return function(*args, **kwargs)

    return usual  # pyright: ignore[reportReturnType]


def quick_jit(function: Function) -> Function:
    """`function`, jitted to be compiled in a quarter of the time and run at half the speed.

    That is right for one drive or a few hundred designs; large batches and long searches are served
    better by `thorough_jit`. Take derivatives and batches inside of it, not of it:
    `quick_jit(jax.grad(f))`. Numbers that are not arrays are static, as in `equinox.filter_jit`.

    On a CPU, options make XLA emit plain loops, not optimize, and not compute values again that
    it could keep. Elsewhere it is a plain jit.
    """
    return _bounded_jit(function, quick_options)


def thorough_jit(function: Function) -> Function:
    """`function`, jitted to run fast on a CPU, for large batches and long searches.

    Take derivatives and batches inside of it, not of it: `thorough_jit(jax.vmap(jax.grad(f)))`.
    Numbers that are not arrays are static, as in `equinox.filter_jit`.

    XLA alone computes the same things again in many kernels, which costs long formulas of a drive
    half of their speed and most of the time to compile them. Here it does not. Elsewhere than on a
    CPU it is a plain jit.
    """
    return _bounded_jit(function, thorough_options)


def _bounded_jit(function: Function, options: Callable[[], dict[str, Any] | None]) -> Function:
    jitted: Any = eqx.filter_jit  # whose overloads leave out what it passes on to jax.jit
    if jax.default_backend() != "cpu":
        return jitted(function)

    @functools.wraps(function)
    def bounded(*args: Any, **kwargs: Any) -> Any:
        call = flat_call(function, *args, **kwargs)
        return in_form(with_bounded_fusion(call.function)(*call.arrays), call.forms[-1])

    return jitted(bounded, compiler_options=options())


@functools.cache
def quickly_compiled(function: Function) -> Function:
    """`quick_jit` of a function of this library, made once."""
    return usual_promotion(quick_jit(function))


@functools.cache
def thoroughly_compiled(function: Function) -> Function:
    """`thorough_jit` of a function of this library, made once."""
    return usual_promotion(thorough_jit(function))


def boundary_jit(function: Function) -> Function:
    """`function`, jitted for the public boundary.

    Called with numbers it is compiled quickly, for one drive is soon computed; called while JAX
    traces, as a part of a larger program that the caller compiles.
    """
    return _at_boundary(function, quickly_compiled)


def long_boundary_jit(function: Function) -> Function:
    """`boundary_jit` of what takes long also for one drive: it is compiled to run fast."""
    return _at_boundary(function, thoroughly_compiled)


def _at_boundary(function: Function, compiled: Callable[[Function], Function]) -> Function:
    traced: Any = usual_promotion(eqx.filter_jit(function))

    @functools.wraps(function)
    def either(*args: Any, **kwargs: Any) -> Any:
        leaves = jax.tree.leaves((args, kwargs))
        inside = any(isinstance(leaf, Tracer) for leaf in leaves)
        return (traced if inside else compiled(function))(*args, **kwargs)

    return either  # pyright: ignore[reportReturnType]


# The options for XLA on a CPU, and why; measured with jax 0.10 on the seven-pulley steady state
# with all slopes. An option that this version of XLA does not know is left out, at that cost.
_THOROUGH: dict[str, Any] = {
    # Plain loops instead of emitted fusions: compiles in 6 s instead of 15 s.
    "xla_cpu_use_fusion_emitters": False,
}
_QUICK: dict[str, Any] = _THOROUGH | {
    # No optimization by LLVM: 6 s instead of 10 s, and runs at a third of the speed.
    "xla_backend_optimization_level": 0,
}
# Not by taking out XLA's fusion pass, which compiles as fast: without it XLA (jax 0.10) gives
# wrong products of batched matrices.


@functools.cache
def quick_options() -> dict[str, Any] | None:
    """The options with which `jax.jit` compiles quickly on this machine."""
    return known_options(_QUICK | KEEP_BARRIERS) if jax.default_backend() == "cpu" else None


@functools.cache
def thorough_options() -> dict[str, Any] | None:
    """The options with which a program of bounded fusion runs fast on this machine."""
    return known_options(_THOROUGH | KEEP_BARRIERS) if jax.default_backend() == "cpu" else None


def known_options(wanted: dict[str, Any]) -> dict[str, Any]:
    """The compiler's options among `wanted` that this version of XLA knows.

    They are XLA's own and come and go with its versions; an unknown one stops every compilation.
    """
    if _are_known(wanted):
        return wanted
    return {name: value for name, value in wanted.items() if _are_known({name: value})}


def _are_known(options: dict[str, Any]) -> bool:
    nothing = jax.jit(lambda x: x).lower(jax.ShapeDtypeStruct((), bool))
    try:
        nothing.compile(options)
    except jax.errors.JaxRuntimeError:
        return False
    return True


def in_chunks(
    run: Callable[[np.ndarray], Numbers],
    values: np.ndarray,
    size: int,
    advance: Callable[[int, int], None],
) -> Numbers:
    """`run(values)` on the host, `size` values at a time, so that one shape compiles.

    `run` takes [size] and returns a pytree with that axis first; the last chunk is filled up
    with its own last value. `advance(done, total)` is called before every chunk.
    """
    parts = []
    for start in range(0, len(values), size):
        advance(start, len(values))
        chunk = values[start : start + size]
        full = np.append(chunk, np.full(size - len(chunk), chunk[-1]))
        part = jax.device_get(run(full))
        parts.append(jax.tree.map(lambda x, chunk=chunk: x[: len(chunk)], part))
    advance(len(values), len(values))
    return jax.tree.map(lambda *x: np.concatenate(x), *parts)
