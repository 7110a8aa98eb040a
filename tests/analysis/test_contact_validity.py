"""Contact never calls a success what `layout` calls no belt path; failures carry no derivative."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compilations import TYPES, compilations, renamed
from contact_drives import equal
from drives import example

import beltjax as bj


@functools.cache
def with_friction():
    drive, point = example("three_pulley")
    held = [jnp.asarray(0.8)] * len(drive.pulleys)
    drive = eqx.tree_at(
        lambda d: [p.friction for p in d.pulleys], drive, held, is_leaf=lambda x: x is None
    )
    return drive, point


@jax.jit
@functools.partial(jax.vmap, in_axes=(0, None))
def contact_and_slopes(drive, point):
    def answers(drive):
        found = bj.contact_state(drive, point, throw=False)
        return found.tensions.sum() + found.wraps.sum() + found.efficiency, found

    (_, found), slopes = jax.value_and_grad(answers, has_aux=True)(drive)
    return found.result, found.wraps, slopes


NAMES = ["successful", "path_not_simple", "contact_lost", "belt_too_stiff"]


@functools.cache
def lanes():
    """Drives in contact by the name of their result, the first a success."""
    drive, _ = with_friction()
    stiff = eqx.tree_at(
        lambda d: (d.belt.bending_stiffness, d.installation.tension),
        drive,
        (jnp.asarray(388.0), jnp.asarray(2604.0)),
    )
    lost = eqx.tree_at(lambda d: d.pulleys[1].center, drive, jnp.array([0.3477, 0.2]))
    return {
        "successful": drive,
        "path_not_simple": eqx.tree_at(lambda d: d.sense, drive, -drive.sense),
        "contact_lost": lost,
        "belt_too_stiff": stiff,
    }


@pytest.mark.parametrize(
    "name", ["successful", "path_not_simple", "contact_lost", "belt_too_stiff"]
)
def test_a_failure_of_the_layout_is_one_of_contact(name):
    drive = lanes()[name]
    found = bj.contact_state(drive, with_friction()[1], throw=False)
    assert found.result == getattr(bj.RESULTS, name), bj.RESULTS[found.result]
    assert np.all(np.isfinite(found.wraps))
    if name in ("path_not_simple", "contact_lost"):
        assert found.result == bj.layout(drive, throw=False).result


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_failures_have_no_slopes():
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), *lanes().values())
    results, _, slopes = contact_and_slopes(batch, with_friction()[1])
    for k, name in enumerate(lanes()):
        assert jax.tree.map(lambda x, k=k: x[k], results) == getattr(bj.RESULTS, name)
    for leaf in map(np.asarray, jax.tree.leaves(slopes)):
        assert np.all(np.isfinite(leaf))
        assert np.all(leaf[1:] == 0.0)
    assert np.abs(slopes.belt.bending_stiffness[0]) > 0


def test_new_numbers_and_names_compile_nothing():
    def asked(drive, point):
        state = bj.contact_state(drive, point, throw=False)
        bj.belt_pieces(bj.maximum_moment(drive, point, throw=False), points=20)
        return state

    asked(*equal(M2=2.0))
    for k, typed in enumerate(TYPES.values()):
        drive, point = renamed(*equal(M2=2.0), f" {k}")
        stiffer = eqx.tree_at(lambda d: d.belt.axial_stiffness, drive, typed(30_000 + k))
        with compilations() as count:
            asked(stiffer, point)
        assert count == [0]


@pytest.mark.slow
def test_second_derivatives_are_nan_where_they_would_be_wrong():
    drive, point = equal(M2=2.0)

    def efficiency(stiffness):
        changed = eqx.tree_at(lambda d: d.belt.bending_stiffness, drive, stiffness)
        return bj.contact_state(changed, point, throw=False).efficiency

    assert np.isnan(jax.jit(jax.hessian(efficiency))(jnp.asarray(0.015)))


@pytest.mark.slow
def test_a_tension_is_of_the_belt_or_of_the_string():
    """Two small pulleys and a stiff belt: 10 N as a string are 15.65 N by the exact elastica."""
    belt = bj.Belt(6000.0, 1e-4, 0.01)
    pulleys = [
        bj.Pulley("driver", (0.0, 0.0), 5.093e-3, friction=0.5, driver=1.0),
        bj.Pulley("driven", (0.1, 0.0), 5.093e-3, friction=0.5),
    ]
    point = bj.OperatingPoint(belt_speed=0.0)

    def middle(installation):
        drive = bj.Drive(belt, pulleys, installation)
        found = bj.contact_state(drive, point)
        return float(found.tensions[0, 1]), float(found.unstretched_length)

    assert middle(bj.BeltGiven(0.231614))[0] == pytest.approx(15.65, abs=5e-3)
    tension, length = middle(bj.TensionGiven(10.0, tension_of="string"))
    assert tension == pytest.approx(15.65, abs=1e-2)
    # A string of tension P on this path: path/(1 + P/EA).
    assert length == pytest.approx((0.2 + 2 * np.pi * 5.093e-3) / (1 + 10 / 6000), rel=1e-12)
    assert middle(bj.TensionGiven(10.0))[0] == pytest.approx(10.0, rel=1e-9)
    with pytest.raises(ValueError, match="tension_of 'rope' is not one of 'belt', 'string'"):
        bj.TensionGiven(10.0, tension_of="rope")
