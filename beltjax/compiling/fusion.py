"""Bounds for XLA's fusion, which otherwise computes the same thing again in every kernel.

Fusion copies the operations that lead to a value into each kernel that uses the value. For the
derivatives of long scalar formulas the program grows fivefold by that, and with it the time to
compile it and to load it. A barrier behind each value that is used more than once stops the
copying, unless there is little to copy.

On CPUs XLA (jax 0.10) removes barriers before it fuses: `KEEP_BARRIERS` must be among the options
of the compiler.
"""

import collections
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal, jaxpr_as_fun
from jaxtyping import Array

KEEP_BARRIERS = {"xla_disable_hlo_passes": "cse_barrier_expander"}

_LITTLE = 4  # operations that may be computed again rather than kept
_BODIES = {"while": "body_jaxpr", "scan": "jaxpr"}  # of loops, by name of the primitive
_SMALL_LOOP = 1000  # operations in the body of a loop, up to which it stays as it is


class _Value(NamedTuple):
    """A value of a program that is run again with barriers in it."""

    array: Any
    cost: int  # number of operations copied with it, and one for reading it; 0 for a constant


def with_bounded_fusion(function: Callable[..., list[Array]]) -> Callable[..., list[Array]]:
    """`function` of arrays with the same results, its fusion bounded. Not to be differentiated."""

    def bounded(*arrays: Array) -> list[Array]:
        program = jax.make_jaxpr(function)(*arrays)
        return [value.array for value in _run(program, [_Value(array, 1) for array in arrays])]

    return bounded


def _run(program: ClosedJaxpr, given: Sequence[_Value]) -> list[_Value]:
    """Results of a program, traced again."""
    inside = program.jaxpr
    uses = _uses(inside)
    constants = [_Value(array, 0) for array in program.consts]
    known = dict(zip([*inside.constvars, *inside.invars], [*constants, *given], strict=True))

    def read(atom: Any) -> _Value:
        return _Value(atom.val, 0) if isinstance(atom, Literal) else known[atom]

    for equation in inside.eqns:
        found = _results(equation, [read(atom) for atom in equation.invars])
        for name, value in zip(equation.outvars, found, strict=True):
            known[name] = _kept(value, uses[name])
    return [read(atom) for atom in inside.outvars]


def _uses(program: Jaxpr) -> collections.Counter:
    """Count how often each value of a program is used."""
    atoms = [atom for equation in program.eqns for atom in equation.invars] + program.outvars
    return collections.Counter(atom for atom in atoms if not isinstance(atom, Literal))


def _results(equation: Any, given: list[_Value]) -> list[_Value]:
    """Results of one equation; a jitted function becomes a part of its caller, as for XLA."""
    primitive = equation.primitive
    if primitive.name == "jit":
        return _run(equation.params["jaxpr"], given)
    parameters = primitive.get_bind_params(equation.params)
    body = _BODIES.get(primitive.name)
    # XLA makes one kernel of a small loop, in which no barrier may stand.
    if body is not None and _size(parameters[body]) > _SMALL_LOOP:
        parameters[body] = _bounded_program(parameters[body])
    found = primitive.bind(*(value.array for value in given), **parameters)
    cost = sum(value.cost for value in given)
    cost = cost + 1 if cost else 0
    return [_Value(array, cost) for array in (found if primitive.multiple_results else [found])]


def _size(program: ClosedJaxpr) -> int:
    """Count the operations of a program, those of the functions and loops in it included."""
    count = 0
    for equation in program.jaxpr.eqns:
        inside = [part for part in equation.params.values() if isinstance(part, ClosedJaxpr)]
        count += sum(map(_size, inside)) if inside else 1
    return count


def _bounded_program(program: ClosedJaxpr) -> ClosedJaxpr:
    """A program with the same results, its fusion bounded."""
    given = [jax.ShapeDtypeStruct(x.shape, x.dtype) for x in program.in_avals]
    return jax.make_jaxpr(with_bounded_fusion(jaxpr_as_fun(program)))(*given)


def _kept(value: _Value, uses: int) -> _Value:
    """`value`, behind a barrier where its copies would cost more than a little."""
    if value.cost * (uses - 1) < _LITTLE:
        return value
    return _Value(jax.lax.optimization_barrier(value.array), 1)
