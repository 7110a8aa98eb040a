"""Steps in time from event to event, against the exact motion of a rubbed oscillator."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from beltjax.compiling.quick import quickly_compiled
from beltjax.numerics.hybrid import BELOW, ENGAGED, Elements, mechanical_system
from beltjax.numerics.time_integration import How, integrated_through_events


def rubbed(friction):
    """x'' + x + T sgn(x') = 0, which rests where |x| <= T."""
    one = jnp.ones(1)
    elements = Elements(
        jnp.eye(1), lambda t: jnp.zeros(1) + 0 * t,
        lambda z, rate, t: (-friction * one, friction * one), jnp.array([True]),
        jnp.zeros(1), jnp.zeros(1), jnp.zeros_like, 0,
    )  # fmt: skip
    return mechanical_system(jnp.eye(1), lambda z, rate, t: z, elements)


TIMES = np.linspace(0.0, 12.0, 49)


def moved(friction, derivatives="reverse", events=8):
    start = jnp.array([1.7, 0.0])
    mode = rubbed(friction).started(start, jnp.zeros(()))
    how = How(jnp.asarray(1e-9), jnp.asarray(1e-11), 4000, events, "explicit", derivatives)
    return integrated_through_events(
        rubbed, friction, (start, mode), jnp.asarray(TIMES), jnp.zeros(0), how
    )


def exact(friction):
    """Half swings about friction on either side, each 2 T shorter than the last, until it rests."""
    swings = np.ceil((1.7 - friction) / (2 * friction))
    swing = np.minimum(TIMES // np.pi, swings)
    amplitude = 1.7 - 2 * friction * swing
    moving = friction + (amplitude - friction) * np.cos(TIMES - np.pi * swing)
    return (-1.0) ** swing * np.where(swing < swings, moving, amplitude)


def test_dry_friction_stops_an_oscillator_after_its_half_swings():
    found = quickly_compiled(moved)(jnp.asarray(0.3))
    np.testing.assert_allclose(found.states[:, 0], exact(0.3), atol=1e-7)
    assert int(found.events) == 3
    assert not bool(found.crowded)
    assert [int(found.modes[k, 0]) for k in (1, -1)] == [BELOW, ENGAGED]
    # In a batch every lane has its own events.
    values = jnp.array([0.3, 0.29, 0.5])
    rest = quickly_compiled(jax.vmap(lambda friction: moved(friction).states[:, 0]))(values)
    np.testing.assert_allclose(rest, [exact(float(value)) for value in values], atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["forward", "reverse"])
def test_events_move_with_what_a_motion_depends_on(mode):
    of = {"reverse": jax.jacrev, "forward": jax.jacfwd}[mode]
    slopes = quickly_compiled(of(lambda friction: moved(friction, mode).states[:, 0]))
    step = 1e-6
    expected = (exact(0.3 + step) - exact(0.3 - step)) / (2 * step)
    np.testing.assert_allclose(slopes(jnp.asarray(0.3)), expected, atol=1e-6)


def test_too_many_events_are_said():
    found = quickly_compiled(lambda friction: moved(friction, events=2))(jnp.asarray(0.1))
    assert bool(found.crowded)
