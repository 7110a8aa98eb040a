"""Orbits by shooting against J. P. Den Hartog's solution (1931), and what ends a search."""

import jax.numpy as jnp
import numpy as np
import pytest

from beltjax.compiling.quick import quickly_compiled
from beltjax.numerics.hybrid import Elements, HybridSystem, mechanical_system
from beltjax.numerics.shooting import Periodic, shot_multipliers, shot_orbit

NONE = jnp.zeros((2, 0))


def rubbed(args, load):
    """x'' + x + F sgn(x') = cos(b t)."""
    ratio, friction = args
    elements = Elements(
        rows=jnp.eye(1),
        driven=lambda t: jnp.zeros(1) * t,
        bounds=lambda z, rate, t: (-friction[None], friction[None]),
        present=jnp.array([True]),
        stiffness=jnp.zeros(1),
        damping=jnp.zeros(1),
        beyond=jnp.zeros_like,
        springs=0,
    )
    system = mechanical_system(
        jnp.eye(1), lambda z, rate, t: z - load * jnp.cos(ratio * t), elements
    )
    return Periodic(system, 2 * jnp.pi / ratio, NONE)


@pytest.mark.parametrize(("ratio", "friction"), [(0.7, 0.3), (1.4, 0.2)])
def test_amplitude_of_a_rubbing_oscillator(ratio, friction):
    orbit = quickly_compiled(shot_orbit)(rubbed, (jnp.asarray(ratio), jnp.asarray(friction)), 160)
    assert orbit.converged
    states, _ = orbit.trajectory.stages
    steps = orbit.trajectory.steps
    turned = np.asarray(steps.states)[:, 0][np.abs(np.asarray(steps.states)[:, 1]) < 1e-12]
    # Den Hartog: without stops, V and U are of the undamped response and of the damping.
    V = 1 / (1 - ratio**2)
    U = np.sin(np.pi / ratio) / (ratio * (1 + np.cos(np.pi / ratio)))
    amplitude = np.sqrt(V**2 - (friction * U) ** 2)
    assert orbit.events == 2
    np.testing.assert_allclose(np.abs(turned), amplitude, rtol=1e-8)
    assert np.abs(states[:, 0]).max() <= amplitude * (1 + 1e-9)
    assert abs(shot_multipliers(orbit)[0]) < 1


def marked(part, load):
    """x'' + x'/10 + x/100 = cos(t), and a mark that x' passes at a part of its least value."""
    mark = part / jnp.hypot(0.99, 0.1)

    def rate(x, t, mode):
        return jnp.stack([x[1], load * jnp.cos(t) - x[1] / 10 - x[0] / 100])

    system = HybridSystem(
        rate=rate,
        guards=lambda x, t, mode: (x[1] + mark) * (1.0 - 2.0 * mode),
        switched=lambda x, t, mode, which: (x, 1 - mode),
        started=lambda x, t: jnp.where(x[1:] + mark > 0, 0, 1),
        resumed=lambda x, t, mode: (x, jnp.where(x[1:] + mark > 0, 0, 1)),
        positions=1,
    )
    return Periodic(system, jnp.asarray(2 * np.pi), NONE)


def test_an_event_that_only_touches_is_seen():
    for part in (0.5, 0.999):
        orbit = quickly_compiled(shot_orbit)(marked, jnp.asarray(part), 160)
        assert orbit.converged
        assert orbit.events == 2
        # A cosine falls through a part p of its least value at the rate sqrt(1 - p^2).
        assert orbit.least == pytest.approx(np.sqrt(1 - part**2), rel=1e-4)


def crowded(args, load):
    """A mode that changes a hundred times in a period."""
    smooth = marked(jnp.asarray(5.0), load)
    system = smooth.system._replace(
        guards=lambda x, t, mode: jnp.cos(100 * t)[None],
        switched=lambda x, t, mode, which: (x, mode),
    )
    return smooth._replace(system=system)


@pytest.mark.slow
def test_too_many_events_end_the_search():
    orbit = quickly_compiled(shot_orbit)(crowded, jnp.zeros(()), 160)
    assert orbit.crowded
    assert not orbit.converged
    assert not np.any(orbit.trajectory.steps.states)
