"""Drives whose belt rides on a cushion."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import beltjax as bj

THIN = bj.ThinCushion()
TABLE, POINT = bj.load_drive("examples/two_pulley_table_5_1.toml")
THREE, RUNNING = bj.load_drive("examples/three_pulley.toml")


def on_cushion(drive, k, bending=None):
    """`drive` with a cushion of stiffness k both ways."""
    belt = dataclasses.replace(drive.belt, cushion_radial=k, cushion_shear=k)
    if bending is not None:
        belt = dataclasses.replace(belt, bending_stiffness=bending)
    return dataclasses.replace(drive, belts=(belt,))


def loaded(torque):
    return dataclasses.replace(RUNNING, torque={"accessory": torque})


def test_a_hard_cushion_is_the_string_on_its_pulleys():
    # The string drive of Kong's Table 5.1: 71.16 N and 31.14 N, efficiency 0.9984.
    string = bj.contact_state(on_cushion(TABLE, 1.0, bending=0.0), POINT)
    hard = [bj.cushion_state(on_cushion(TABLE, k), POINT, THIN) for k in (1e12, 1e14, 1e16)]
    assert hard[2].tensions == pytest.approx(string.tensions[:, 1], abs=1e-5)
    assert float(hard[2].efficiency) == pytest.approx(float(string.efficiency), rel=1e-9)
    assert hard[2].slips == pytest.approx(string.slips, abs=1e-4)
    # What is left falls with the root of the stiffness.
    left = [float(jnp.max(jnp.abs(state.slips - string.slips))) for state in hard]
    assert left[0] / left[1] == pytest.approx(10, rel=0.02)
    assert left[1] / left[2] == pytest.approx(10, rel=0.02)


@pytest.mark.slow
def test_the_exact_state_closes_its_balances():
    drive, point = on_cushion(THREE, 3e7), loaded(4.0)
    state = bj.cushion_state(drive, point)
    assert state.result == bj.RESULTS.successful
    assert float(state.error) < 1e-8
    # Nothing slides where no friction is given: what is lost is the shear that is carried out.
    speed = float(state.unstretched_speed)
    shear = 3e7 * np.asarray(state.shears) ** 2 / 2 * speed
    assert np.asarray(state.losses) == pytest.approx(shear, rel=1e-5, abs=1e-9)
    power = np.asarray(state.moments * state.pulley_speeds)
    assert -power[0] == pytest.approx(power[2] + np.sum(shear), rel=1e-9)
    assert power[2] / -power[0] == pytest.approx(float(state.efficiency), rel=1e-12)
    assert state.moments[1:] == pytest.approx([0.0, 4.0], abs=1e-9)
    # The arm is held: moments of the belt's pull and of the spring about the pivot.
    arm = np.asarray(bj.layout(drive, state.coordinates).arms[0])
    pull = np.asarray(state.hub_loads[1])
    installed = bj.cushion_state(drive, dataclasses.replace(point, torque={}))
    still = dataclasses.replace(point, torque={}, belt_speed=1e-6)
    rest = bj.cushion_state(drive, still)
    arm_0, pull_0 = np.asarray(bj.layout(drive).arms[0]), np.asarray(rest.hub_loads[1])
    moved = 116.4 * float(state.coordinates[0])
    turning = arm[0] * pull[1] - arm[1] * pull[0]
    turning_0 = arm_0[0] * pull_0[1] - arm_0[1] * pull_0[0]
    assert turning - turning_0 == pytest.approx(moved, abs=2e-6)
    assert float(rest.coordinates[0]) == pytest.approx(0.0, abs=1e-9)
    assert float(jnp.mean(rest.tensions)) == pytest.approx(300.0, rel=1e-9)
    # A longer belt than that of the hard pulleys, and shorter spans.
    assert float(installed.unstretched_length) == pytest.approx(
        float(state.unstretched_length), rel=1e-12
    )
    # The profile ends in the reported numbers.
    s = jnp.linspace(0.0, 1.0, 201)
    depth, sheared = state.penetration(2, s), state.shear(2, s)
    assert float(jnp.max(depth)) == pytest.approx(float(state.penetrations[2]), rel=1e-3)
    assert [float(depth[0]), float(depth[-1])] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert float(sheared[-1]) == pytest.approx(float(state.shears[2]), rel=1e-9)
    thin = bj.cushion_state(drive, point, THIN)
    # Thin layers leave out P/(k R^2), which is 0.02 at the smallest pulley.
    assert thin.tensions == pytest.approx(state.tensions, rel=0.01)
    assert thin.contact_angles == pytest.approx(state.contact_angles, rel=0.1)


@pytest.mark.slow
def test_derivatives_three_ways():
    drive = on_cushion(TABLE, 2e7)

    def numbers(k, radius, tension, torque):
        changed = eqx.tree_at(
            lambda d: (
                d.belts[0].cushion_radial,
                d.pulleys[1].radius,
                d.installation.tension,
            ),
            drive,
            (k, radius, tension),
        )
        point = dataclasses.replace(POINT, torque={"driven": torque})
        state = bj.cushion_state(changed, point, THIN)
        return jnp.stack(
            [
                *state.tensions,
                state.efficiency,
                *state.slips,
                state.contact_angles[0, 1],
                *state.coupling,
                state.unstretched_length,
            ]
        )

    at = tuple(map(jnp.asarray, (2e7, 0.05, 50.0, 2.0)))
    compiled = jax.jit(numbers)
    forward = jnp.stack(jax.jit(jax.jacfwd(numbers, (0, 1, 2, 3)))(*at))
    reverse = jnp.stack(jax.jit(jax.jacrev(numbers, (0, 1, 2, 3)))(*at))
    np.testing.assert_allclose(forward, reverse, rtol=1e-8, atol=1e-12)
    for place in range(4):
        h = 1e-5 * at[place]
        up, down = (
            compiled(*(x + side * h * (k == place) for k, x in enumerate(at))) for side in (1, -1)
        )
        slope = (up - down) / (2 * h)
        np.testing.assert_allclose(forward[place], slope, rtol=2e-5, atol=1e-7 * abs(slope).max())


@pytest.mark.slow
def test_a_bad_lane_leaves_its_neighbors():
    drive = on_cushion(TABLE, 2e7)

    def solved(torque):
        point = dataclasses.replace(POINT, torque={"driven": torque})
        state = bj.cushion_state(drive, point, THIN, throw=False)
        return state.tensions, state.result == bj.RESULTS.successful

    torques = jnp.array([1.0, 60.0, 2.0, -1.0])
    tensions, good = jax.vmap(solved)(torques)
    assert good.tolist() == [True, False, True, True]
    assert bool(jnp.all(jnp.isfinite(tensions)))
    for lane in (0, 2, 3):
        alone = solved(torques[lane])[0]
        np.testing.assert_allclose(tensions[lane], alone, rtol=1e-9)
    slopes = jax.grad(lambda x: jnp.sum(jax.vmap(solved)(x)[0]))(torques)
    assert bool(jnp.all(jnp.isfinite(slopes)))
    assert float(slopes[1]) == 0.0


def test_a_pulley_without_cushion_is_met_on_its_rim():
    bare = [dataclasses.replace(pulley, cushion=0.0) for pulley in TABLE.pulleys]
    hard = dataclasses.replace(on_cushion(TABLE, 2e7), pulleys=tuple(bare))
    string = bj.contact_state(on_cushion(TABLE, 1.0, bending=0.0), POINT)
    state = bj.cushion_state(hard, POINT, THIN)
    assert state.tensions == pytest.approx(string.tensions[:, 1], rel=1e-8)
    assert float(state.efficiency) == pytest.approx(float(string.efficiency), rel=1e-10)
    assert float(jnp.max(state.penetrations)) == 0.0


@pytest.mark.slow
def test_soft_cushions_lower_rotational_modes():
    # About the state without torques: frequencies of the hard drive, and what a cushion does.
    string = on_cushion(THREE, 1.0, bending=0.0)
    string = dataclasses.replace(string, model=bj.Model(belt_inertia=True, stretching_arcs=True))
    steady = bj.steady_state(string, RUNNING)
    hard = bj.modes(bj.linearize(steady), 4).frequencies
    soft = [
        bj.modes(bj.linearize(bj.cushion_state(on_cushion(THREE, k), RUNNING)), 4).frequencies
        for k in (4e8, 1.6e9, 6.4e9)
    ]
    # Towards hard pulleys with the root of the stiffness. What remains is that the cords move
    # along the spans as waves, not as straight lines.
    limit = 2 * soft[2] - soft[1]
    assert limit == pytest.approx(hard, rel=1e-2)
    assert bool(jnp.all(soft[0][1:3] < soft[1][1:3]))
    ratio = (soft[1] - soft[0]) / (soft[2] - soft[1])
    assert ratio[1:3] == pytest.approx([2.0, 2.0], rel=0.1)


@pytest.mark.slow
def test_derivatives_of_frequencies_and_of_the_exact_state():
    def numbers(k, radius):
        drive = on_cushion(THREE, 2e7)
        changed = eqx.tree_at(
            lambda d: (d.belts[0].cushion_radial, d.pulleys[2].radius), drive, (k, radius)
        )
        state = bj.cushion_state(changed, loaded(2.0))
        frequencies = bj.modes(bj.linearize(state), 4).frequencies
        return jnp.stack([*frequencies, *state.tensions, *state.coupling, state.shears[2] * 1e6])

    at = jnp.asarray(2e7), jnp.asarray(0.02697)
    compiled = jax.jit(numbers)
    forward = jnp.stack(jax.jit(jax.jacfwd(numbers, (0, 1)))(*at))
    reverse = jnp.stack(jax.jit(jax.jacrev(numbers, (0, 1)))(*at))
    np.testing.assert_allclose(forward, reverse, rtol=1e-6, atol=1e-9)
    for place in range(2):
        h = 1e-5 * at[place]
        up, down = (
            compiled(*(x + side * h * (k == place) for k, x in enumerate(at))) for side in (1, -1)
        )
        slope = (up - down) / (2 * h)
        np.testing.assert_allclose(forward[place], slope, rtol=1e-4, atol=1e-6 * abs(slope).max())


def test_what_a_cushion_needs_is_said():
    with pytest.raises(ValueError, match=r"belt\.cushion is missing"):
        bj.cushion_state(THREE, RUNNING)
    with pytest.raises(ValueError, match="go together"):
        dataclasses.replace(THREE.belt, cushion_radial=1e7)
    soft = on_cushion(THREE, 2e5)
    with pytest.raises(bj.AnalysisError, match="sinks through its cushion"):
        bj.cushion_state(soft, RUNNING, THIN)
    with pytest.raises(ValueError, match="method: found 'thin'"):
        bj.cushion_state(soft, RUNNING, "thin")
    with pytest.raises(bj.AnalysisError, match="speed"):
        bj.cushion_state(on_cushion(TABLE, 2e7), dataclasses.replace(POINT, mass_flow=40.0), THIN)


@pytest.mark.slow
def test_friction_limits_the_shear_of_the_exact_state():
    # A hard cushion: both routes near the string of Table 5.1, which slips over 1.909 rad. What
    # each leaves out is of the order of its stated error.
    drive = on_cushion(TABLE, 1e8)
    exact, thin = bj.cushion_state(drive, POINT), bj.cushion_state(drive, POINT, THIN)
    assert float(exact.error) < 1e-3
    assert exact.slips == pytest.approx(thin.slips, abs=0.05)
    assert exact.tensions == pytest.approx(thin.tensions, rel=5e-3)  # sqrt(P/EA) is 0.05
    assert float(exact.efficiency) == pytest.approx(float(thin.efficiency), abs=2e-6)
    # More than friction holds: told by both.
    heavy = dataclasses.replace(POINT, torque={"driven": 12.0})
    for method in (THIN, bj.Cushion()):
        state = bj.cushion_state(drive, heavy, method, throw=False)
        assert state.result != bj.RESULTS.successful
