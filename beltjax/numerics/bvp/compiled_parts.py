"""Which parts of a solver are compiled together, and how long the compiled programs are kept.

Called with concrete numbers, a solver runs its loops on the host and compiles its parts apart.
Those that know nothing of the problem are then shared by all problems of equal sizes, and only
the evaluation of its equations is compiled for each. Called under a transformation, everything
becomes part of the caller's program.
"""

import functools
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from beltjax.compiling.quick import quick_options
from beltjax.numerics.bvp.collocation import Local, Mesh, Problem, Unknowns, evaluated

State = TypeVar("State")
Function = TypeVar("Function", bound=Callable)

# Linux gives 65,530 memory maps to a process by default. On CPUs a whole solver takes a thousand
# or two, the evaluation of a problem's equations some forty for each size of mesh.
SOLVERS_KEPT = 8
EVALUATIONS_KEPT = 16


def is_traced(*trees: Any) -> bool:
    """Whether any array in `trees` is known only as a symbol."""
    return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(trees))


def within_transformation(*given: Any) -> bool:
    """Whether a call with `given` is to become part of the caller's program.

    A jitted function may be given nothing but numbers: that shows in an array made here.
    """
    return is_traced(given, jnp.zeros(()) + 0.0)


def part(function: Function) -> Function:
    """`function` of arrays alone: compiled apart for concrete ones, inlined among traced ones."""

    def strongly_typed(*args: Any) -> Any:
        # A weakly typed result would be given to the next part, and compile that anew.
        return jax.tree.map(lambda x: jax.lax.convert_element_type(x, x.dtype), function(*args))

    @functools.cache
    def compiled() -> Callable:
        named = functools.wraps(function)(strongly_typed)
        return jax.jit(named, compiler_options=quick_options())

    @functools.wraps(function)
    def call(*args: Any) -> Any:
        return function(*args) if is_traced(args) else compiled()(*args)

    return call  # pyright: ignore[reportReturnType]


def repeat(going: Callable[[State], Any], body: Callable[[State], State], state: State) -> State:
    """`body` again and again while `going`: a loop on the host unless `state` is traced."""
    if is_traced(state):
        return jax.lax.while_loop(going, body, state)
    while going(state):
        state = body(state)
    return state


def _is_numbers(leaf: Any) -> bool:
    return isinstance(leaf, jax.Array | np.ndarray | np.generic)


def kept_for_few(function: Function, *, most: int = SOLVERS_KEPT, quick: bool = False) -> Function:
    """`function` jitted as by `eqx.filter_jit`; the programs of few static arguments are kept.

    What is no array among the arguments (as the functions that make up a problem) is static.
    Programs for the `most` that were used last are kept; the memory and memory maps of
    others are returned, where `jax.jit` would keep thousands. With `quick`, compiled as by
    `quickly_compiled`, which cannot be done inside of another jitted function.
    """

    @functools.lru_cache(maxsize=most)
    def compiled(structure: Any, static: tuple[Any, ...]) -> Callable:
        rest = jax.tree.unflatten(structure, static)

        def of_arrays(arrays: Any) -> Any:
            args, kwargs = eqx.combine(arrays, rest)
            return function(*args, **kwargs)

        return jax.jit(of_arrays, compiler_options=quick_options() if quick else None)

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        arrays, rest = eqx.partition((args, kwargs), _is_numbers)
        static, structure = jax.tree.flatten(rest)
        return compiled(structure, tuple(static))(arrays)

    return call  # pyright: ignore[reportReturnType]


_evaluated = kept_for_few(evaluated, most=EVALUATIONS_KEPT, quick=True)


def evaluated_apart(problem: Problem, mesh: Mesh, z: Unknowns) -> Local:
    """`evaluated`, compiled apart for concrete numbers: the one part that knows the problem."""
    return (evaluated if is_traced(problem, mesh, z) else _evaluated)(problem, mesh, z)
