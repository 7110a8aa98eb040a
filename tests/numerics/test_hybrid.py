"""Set-valued elements against exact motions of simple oscillators."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate

from beltjax.numerics.hybrid import ABOVE, BELOW, ENGAGED, Elements, mechanical_system


def followed(system, x, end):
    """States at events and at the end, and the modes, by SciPy's integrator with its events."""
    rate, guards, switched = (jax.jit(f) for f in (system.rate, system.guards, system.switched))
    t, mode = 0.0, system.started(x, jnp.zeros(()))
    path = [(t, np.asarray(x), np.asarray(mode))]
    while t < end:
        count = len(guards(x, t, mode))
        falls = [lambda s, y, k=k, mode=mode: float(guards(y, s, mode)[k]) for k in range(count)]
        for fall in falls:
            vars(fall).update(terminal=True, direction=-1)
        run = scipy.integrate.solve_ivp(
            lambda s, y, mode=mode: rate(y, s, mode), (t, end), x, events=falls, rtol=1e-11,
            atol=1e-13,
        )  # fmt: skip
        t, x = run.t[-1], jnp.asarray(run.y[:, -1])
        if run.status == 1:
            which = next(k for k, times in enumerate(run.t_events) if len(times))
            x, mode = switched(x, t, mode, jnp.array(which))
        path.append((t, np.asarray(x), np.asarray(mode)))
    return path


def elements(rows, low, high, stiffness, damping):
    count, springs = len(rows), sum(k > 0 for k in stiffness)
    return Elements(
        jnp.asarray(rows), lambda t: jnp.zeros(count) + 0 * t,
        lambda z, rate, t: (jnp.asarray(low), jnp.asarray(high)), jnp.full(count, True),
        jnp.asarray(stiffness), jnp.asarray(damping), jnp.zeros_like, springs,
    )  # fmt: skip


def test_dry_friction_stops_an_oscillator_after_its_half_swings():
    # x'' + x + T sgn(x') = 0 loses 2 T of amplitude in each half swing, and rests where |x| < T.
    system = mechanical_system(
        jnp.eye(1), lambda z, rate, t: z, elements([[1.0]], [-0.3], [0.3], [0.0], [0.0])
    )
    path = followed(system, jnp.array([1.7, 0.0]), 12.0)
    stops = [(t, x[0]) for t, x, _ in path[1:-1]]
    expected = [(np.pi, -1.1), (2 * np.pi, 0.5), (3 * np.pi, 0.1)]
    np.testing.assert_allclose(stops, expected, atol=1e-8)
    assert path[-1][1] == pytest.approx([0.1, 0.0], abs=1e-8)
    modes = [int(mode[0]) for _, _, mode in path]
    assert modes == [BELOW, ABOVE, BELOW, ENGAGED, ENGAGED]


def test_two_blocks_go_on_as_their_reactions_allow():
    # Two masses with friction, one pulled by more than it holds through a spring.
    stiff = jnp.array([[1.0, -1.0], [-1.0, 1.0]])
    system = mechanical_system(
        jnp.eye(2), lambda z, rate, t: stiff @ z - jnp.array([t, 0.0]),
        elements(np.eye(2), [-1.0, -0.5], [1.0, 0.5], [0.0, 0.0], [0.0, 0.0]),
    )  # fmt: skip
    path = followed(system, jnp.zeros(4), 4.0)
    first, second = path[1], path[2]
    assert first[0] == pytest.approx(1.0)  # the pull reaches the friction
    assert first[2].tolist() == [ABOVE, ENGAGED]
    # z1 = (t - 1) - sin(t - 1) until the spring's pull is 1/2.
    assert second[1][0] == pytest.approx(0.5, abs=1e-8)
    assert second[0] - 1 - np.sin(second[0] - 1) == pytest.approx(0.5, abs=1e-8)
    assert second[2].tolist() == [ABOVE, ABOVE]


@pytest.mark.parametrize("stiffness", [0.0, 4.0])
def test_a_hub_overruns_and_is_caught_when_speeds_agree(stiffness):
    # Rim and hub of inertia 1; the rim is braked by t < 2 and driven after that.
    def force(z, rate, t):
        return jnp.array([jnp.where(t < 2.0, 1.0, -1.0), 0.0])

    one_way = elements([[1.0, -1.0]], [0.0], [np.inf], [stiffness], [0.0])
    system = mechanical_system(jnp.eye(2), force, one_way)
    start = jnp.zeros(4 if stiffness == 0 else 5)
    path = followed(system, start, 2.0)
    path += followed_on(system, path[-1], 6.0)
    # It opens at once; the rim's speed is -2 at t = 2 and that of the resting hub at t = 4.
    caught = next(point for point in path if point[0] == pytest.approx(4.0, abs=1e-7))
    assert caught[2][0] == ENGAGED
    assert caught[1][:4] == pytest.approx([-4.0, 0.0, 0.0, 0.0], abs=1e-7)
    if stiffness == 0:
        # Both turn as one: half of the acceleration each.
        assert path[-1][1][2:] == pytest.approx([1.0, 1.0], abs=1e-7)
    else:
        # The spring's swing: half the pull is the mean of its torque.
        swing = np.sqrt(2 * stiffness) * 2.0
        assert path[-1][1][4] == pytest.approx((1 - np.cos(swing)) / (2 * stiffness), abs=1e-7)


def followed_on(system, point, end):
    """`followed` from a point of a path whose force has jumped there."""
    t, x, mode = point
    moved = system._replace(
        rate=lambda x, s, mode: system.rate(x, s + t, mode),
        guards=lambda x, s, mode: system.guards(x, s + t, mode),
        switched=lambda x, s, mode, which: system.switched(x, s + t, mode, which),
        started=lambda x, s: jnp.asarray(mode),
    )
    return [(s + t, y, new) for s, y, new in followed(moved, jnp.asarray(x), end - t)]
