"""A bad design in a batch: its own result, finite numbers, zero derivatives, no influence."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from drives import example

import beltjax as bj

BAD = {
    "numbers_unusable": [
        (lambda d: d.pulleys[2].radius, 0.0),
        (lambda d: d.pulleys[2].radius, -0.03),
        (lambda d: d.pulleys[2].radius, np.nan),
        (lambda d: d.pulleys[2].center, [np.inf, 0.0]),
        (lambda d: d.tensioner.pivot, [0.3477, 0.05715]),
        (lambda d: d.tensioner.stiffness, 0.0),
        (lambda d: d.belt.axial_stiffness, 0.0),
        (lambda d: d.belt.bending_stiffness, -0.01),
        (lambda d: d.belt.mass_per_length, 0.0),
        (lambda d: d.installation.tension, -100.0),
    ],
    "no_tangent": [
        (lambda d: d.pulleys[1].center, [0.0, 0.0]),
        (lambda d: d.pulleys[1].radius, 0.3),
    ],
    "contact_lost": [(lambda d: d.pulleys[1].center, [0.3477, 0.2])],
    "span_slack": [(lambda d: d.installation.tension, 5.0)],
    "belt_overstretched": [(lambda d: d.belt.bending_stiffness, 1e6)],
}


def answers(drive, point):
    steady = bj.steady_state(drive, point, throw=False)
    at = steady.reference
    scalars = [steady.tension_change, steady.arm_rotation, steady.effectiveness]
    scalars += [at.unstretched_length, at.layout.path_length]
    return jnp.concatenate([steady.coupling, steady.running_tensions, jnp.stack(scalars)]), steady


def test_bad_lanes_are_reported_and_harmless():
    drive, point = example("three_pulley")
    point = eqx.tree_at(lambda p: p.torque["accessory"], point, jnp.array(5.0))
    expected, lanes = ["successful"], [drive]
    for result, changes in BAD.items():
        for where, value in changes:
            lanes.append(eqx.tree_at(where, drive, jnp.asarray(value, dtype=float)))
            expected.append(result)
    lanes.append(drive)
    expected.append("successful")
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), *lanes)

    @jax.jit
    @jax.vmap
    def look(drive):
        values, steady = answers(drive, point)
        return values, steady, jax.jacrev(lambda d: answers(d, point)[0])(drive)

    values, steady, slopes = look(batch)
    for i, name in enumerate(expected):
        result = jax.tree.map(lambda x, i=i: x[i], steady.result)
        assert result == getattr(bj.RESULTS, name), f"lane {i}: {bj.RESULTS[result]}"
    for leaf in jax.tree.leaves(eqx.filter((values, steady, slopes), eqx.is_inexact_array)):
        assert np.all(np.isfinite(leaf))
    for leaf in map(np.asarray, jax.tree.leaves(slopes)):
        assert np.all(leaf[1:-1] == 0.0)
        np.testing.assert_array_equal(leaf[0], leaf[-1])
