"""The arguments of solve_bvp, checked and brought into shape."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from beltjax.numerics.bvp.collocation import Interval, Problem, Unknowns
from beltjax.numerics.bvp.compiled_parts import is_traced, part
from beltjax.numerics.bvp.fixed_nodes import Start
from beltjax.numerics.bvp.gauss import MOST_STAGES

FEWEST_NODES = 8


def as_double(value: Any) -> Array:
    """`value` as a strongly typed double; raises in single precision."""
    if not jax.config.jax_enable_x64:  # pyright: ignore
        raise RuntimeError(
            "solve_bvp needs double precision: call jax.config.update('jax_enable_x64', True) "
            "first, or set JAX_ENABLE_X64=1."
        )
    if jnp.iscomplexobj(value):
        raise ValueError("complex values: split the problem into real and imaginary parts.")
    if is_traced(value):
        return jnp.asarray(value, dtype=jnp.float64)
    return jnp.asarray(np.asarray(value, dtype=np.float64))  # by NumPy, which compiles nothing


def check_sizes(tol: Any, nodes: int | None, max_nodes: int, stages: int) -> None:
    """The numbers that steer the search."""
    if not is_traced(tol) and not tol > 0:
        raise ValueError(f"tol must be positive, not {tol}.")
    if max_nodes < FEWEST_NODES:
        raise ValueError(f"max_nodes must be at least {FEWEST_NODES}, not {max_nodes}.")
    if nodes is not None and nodes < FEWEST_NODES:
        raise ValueError(f"nodes must be at least {FEWEST_NODES}, not {nodes}.")
    if not 2 <= stages < MOST_STAGES:
        raise ValueError(f"stages must be from 2 to {MOST_STAGES - 1}, not {stages}.")


def checked_interval(interval: Any) -> Interval:
    """(a, b) with a < b."""
    try:
        a, b = interval
    except (TypeError, ValueError):
        raise ValueError(f"interval must be a pair (a, b), not {interval!r}.") from None
    a, b = as_double(a), as_double(b)
    if a.shape or b.shape:
        raise ValueError(f"interval must hold two numbers, not shapes {a.shape} and {b.shape}.")
    if not is_traced(a, b) and not (np.isfinite(a) and np.isfinite(b) and a < b):
        raise ValueError(f"interval must be finite and run upwards, not ({a}, {b}).")
    return Interval(a, b)


def checked_args(args: Any) -> Any:
    """`args` with arrays for numbers, strongly typed: another number must not compile anew.

    Truth values stay as they are, for choices that `rhs` makes in Python.
    """
    return jax.tree.map(_as_array, args)


def _as_array(leaf: Any) -> Any:
    if isinstance(leaf, bool) or not isinstance(
        leaf, int | float | np.generic | np.ndarray | Array
    ):
        return leaf
    return jnp.asarray(leaf, dtype=jnp.result_type(leaf))


def checked_guess(guess: Any, interval: Interval, points: int) -> tuple[Array, Array]:
    """(x [m] as fractions of the interval, y [n, m]); a callable is evaluated `points` times."""
    if callable(guess):
        x = jnp.linspace(0.0, 1.0, points)
        y = jax.vmap(lambda x: as_double(guess(x)))(interval.a + interval.length * x)
        if y.ndim != 2:
            raise ValueError(f"guess(x) must have shape [n], not {y.shape[1:]}.")
    else:
        try:
            x, y = guess
        except (TypeError, ValueError):
            raise ValueError("guess must be a pair (x [m], y [n, m]) or a callable.") from None
        x, y = as_double(x), as_double(y)
        if x.ndim != 1 or x.shape[0] < 2 or y.ndim != 2 or y.shape[1] != x.shape[0]:
            raise ValueError(
                "guess must be (x [m], y [n, m]) with m of 2 or more; found shapes "
                f"{x.shape} and {y.shape}."
            )
        if not is_traced(x) and not np.all(np.diff(x) > 0):
            raise ValueError("guess: x must increase.")
        x = (x - interval.a) / interval.length
    if not is_traced(x, y) and not (np.all(np.isfinite(x)) and np.all(np.isfinite(y))):
        raise ValueError("guess holds values that are not finite.")
    if not y.shape[0]:
        raise ValueError(f"guess: y must have at least one row, found shape {y.shape}.")
    return x, jnp.transpose(y) if callable(guess) else y


def checked_parameters(parameters: Any) -> Array:
    """The guess for p, [k]; empty for None."""
    p = as_double(jnp.zeros(0) if parameters is None else parameters)
    if p.ndim != 1:
        raise ValueError(f"parameters must have shape [k], not {p.shape}.")
    if not is_traced(p) and not np.all(np.isfinite(p)):
        raise ValueError("parameters holds values that are not finite.")
    return p


def checked_singular_term(singular_term: Any, n: int) -> Array | None:
    """S [n, n], or None."""
    if singular_term is None:
        return None
    S = as_double(singular_term)
    if S.shape != (n, n):
        raise ValueError(f"singular_term must have shape ({n}, {n}), not {S.shape}.")
    return S


def checked_problem(
    rhs: Callable, bc: Callable, interval: Interval, args: Any, S: Any, n: int, k: int
) -> Problem:
    """The problem, with whatever `rhs` and `bc` close over among its leaves."""
    x, y, p = interval.a, jnp.zeros(n), jnp.zeros(k)
    for name, function, given, wanted in (
        ("rhs", rhs, (x, y, p, args), n),
        ("bc", bc, (y, y, p, args), n + k),
    ):
        if not callable(function):
            raise ValueError(f"{name} must be callable, not {type(function).__name__}.")
        out = eqx.filter_eval_shape(function, *given)
        shape = getattr(out, "shape", None)
        if shape != (wanted,):
            found = f"shape {shape}" if shape is not None else f"a {type(out).__name__}"
            raise ValueError(
                f"{name} must return an array of shape ({wanted},) for y of shape ({n},) and "
                f"{k} parameters; it returned {found}."
            )
        if jnp.issubdtype(out.dtype, jnp.complexfloating):
            raise ValueError(f"{name} returned complex values; split them into real parts.")
    rhs = eqx.filter_closure_convert(rhs, x, y, p, args)
    bc = eqx.filter_closure_convert(bc, y, y, p, args)
    return Problem(rhs, bc, interval, args, checked_singular_term(S, n))


def first_start(interval: Interval, x: Array, y: Array, p: Array, nodes: int, stages: int) -> Start:
    """A start on `nodes` nodes, dense where the guess's points are."""
    # The sizes are those of arrays, because all that is compiled apart takes are arrays.
    return _spread(interval, x, y, p, jnp.zeros(nodes), jnp.zeros(stages))


@part
def _spread(interval: Interval, x: Array, y: Array, p: Array, nodes: Array, stages: Array) -> Start:
    # Numbers of the guess's intervals, each with a share: every interval has as many nodes.
    at = np.linspace(0.0, len(x) - 1.0, len(nodes))
    i = np.minimum(at.astype(int), len(x) - 2)
    share = at - i
    mesh = x[i] + share * (x[i + 1] - x[i])
    mesh = mesh.at[0].set(0.0).at[-1].set(1.0)
    values = y[:, i] + share * (y[:, i + 1] - y[:, i])
    slopes = jnp.diff(values, axis=1) / (interval.length * jnp.diff(mesh))
    K = jnp.broadcast_to(slopes, (len(stages), *slopes.shape))
    return Start(mesh, Unknowns(values, K, p))
