"""Roots by their number, where rounding spoils the function or its slope just at the root."""

import jax.numpy as jnp
import pytest

from beltjax.compiling.quick import quickly_compiled
from beltjax.numerics.counted_roots import counted_root

ROOT = 1.5  # exact in binary
FEW_STEPS = 20  # bisection alone takes 33 from the first bracket


def plain(x):
    return x**2 - ROOT**2, jnp.where(x > ROOT, 1, 0)


def counted_late(x):
    return x**2 - ROOT**2, jnp.where(x > ROOT * (1 + 2e-11), 1, 0)


def counted_early(x):
    return x**2 - ROOT**2, jnp.where(x > ROOT * (1 - 2e-11), 1, 0)


def slopeless(x):
    """As the product of pivots was, one of which is replaced where it is 0."""
    value = x**2 - ROOT**2
    return jnp.where(value == 0, 1e-300, value), jnp.where(x > ROOT, 1, 0)


@pytest.mark.parametrize("guess", [1.5, 1.485, 1.53, 1.5 + 1e-7])
@pytest.mark.parametrize("value", [plain, counted_late, counted_early, slopeless])
def test_few_steps_suffice(value, guess):
    search = quickly_compiled(lambda x: counted_root(value, jnp.array(1), x))
    found = search(jnp.array(guess))
    assert found.converged
    assert found.steps <= FEW_STEPS
    assert found.root == pytest.approx(ROOT, rel=3e-11)
    assert value(found.lower)[1] == 0
    assert value(found.upper)[1] == 1
