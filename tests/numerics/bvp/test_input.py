"""Bad input names the argument and the shapes found."""

import jax.numpy as jnp
import numpy as np
import pytest

from beltjax.numerics.bvp.continuation import continue_bvp, follow_branch
from beltjax.numerics.bvp.solve import solve_bvp

FLAT = (jnp.array([0.0, 1.0]), jnp.zeros((2, 2)))


def rhs(x, y, p, args):
    return jnp.stack([y[1], -y[0]])


def bc(ya, yb, p, args):
    return jnp.stack([ya[0], yb[0] - 1.0])


BAD = [
    ({"interval": (1.0, 0.0)}, r"interval must be finite and run upwards"),
    ({"interval": (0.0, 0.0)}, r"interval must be finite and run upwards"),
    ({"interval": (0.0, np.inf)}, r"interval must be finite"),
    ({"interval": 3.0}, r"interval must be a pair"),
    ({"guess": (jnp.zeros(3), jnp.zeros((2, 3)))}, r"guess: x must increase"),
    ({"guess": (jnp.arange(3.0), jnp.zeros((2, 4)))}, r"guess .* shapes \(3,\) and \(2, 4\)"),
    ({"guess": (jnp.arange(2.0), jnp.full((2, 2), jnp.nan))}, r"guess holds values"),
    ({"guess": lambda x: jnp.zeros((2, 2))}, r"guess\(x\) must have shape \[n\], not \(2, 2\)"),
    ({"guess": 1.0}, r"guess must be a pair"),
    ({"rhs": lambda x, y, p, a: y[:1]}, r"rhs must return .* \(2,\) .* returned shape \(1,\)"),
    ({"rhs": lambda x, y, p, a: (y[0], y[1])}, r"rhs must return .* returned a tuple"),
    ({"rhs": lambda x, y, p, a: 1j * y}, r"rhs returned complex"),
    ({"bc": lambda ya, yb, p, a: ya[:1]}, r"bc must return .* \(2,\) .* returned shape \(1,\)"),
    ({"parameters": jnp.ones(1)}, r"bc must return an array of shape \(3,\) .* 1 parameters"),
    ({"parameters": 1.0}, r"parameters must have shape \[k\], not \(\)"),
    ({"singular_term": jnp.eye(3)}, r"singular_term must have shape \(2, 2\), not \(3, 3\)"),
    ({"max_nodes": 4}, r"max_nodes must be at least 8, not 4"),
    ({"nodes": 3}, r"nodes must be at least 8, not 3"),
    ({"tol": 0.0}, r"tol must be positive"),
    ({"stages": 1}, r"stages must be from 2 to 7, not 1"),
]


@pytest.mark.parametrize(("change", "message"), BAD, ids=[m for _, m in BAD])
def test_bad_input_is_refused(change, message):
    given = {"rhs": rhs, "bc": bc, "interval": (0.0, 1.0), "guess": FLAT} | change
    with pytest.raises(ValueError, match=message):
        solve_bvp(**given)


def test_path_must_have_one_length():
    path = (jnp.zeros(3), jnp.zeros(4))
    with pytest.raises(ValueError, match="path: its leaves must share one leading axis"):
        continue_bvp(rhs, bc, (0.0, 1.0), FLAT, path=path)


def test_branch_needs_a_parameter():
    with pytest.raises(ValueError, match="parameters must hold the parameter to vary"):
        follow_branch(rhs, bc, (0.0, 1.0), FLAT, jnp.zeros(0), step=0.1, points=3)
