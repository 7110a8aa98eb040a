"""Kinds of bodies are data: one program serves all, and stiff or far ones become others."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compilations import compilations
from drives import example

import beltjax as bj

IDLER, ALTERNATOR, TENSIONER = 3, 2, 1
NEAR = (-0.088, 0.239529869)  # pivot of the drive's own arm


def seven(bodies, on, **changes):
    """The seven-pulley drive with these two bodies; `on` says which pulley each carries."""
    drive, point = example("seven_pulley")
    pulleys = tuple(
        dataclasses.replace(pulley, on=[float(place in on[a]) for a in range(2)])
        for place, pulley in enumerate(drive.pulleys)
    )
    named = tuple(dataclasses.replace(b, name=f"t{a}") for a, b in enumerate(bodies))
    made = bj.Drive(
        belts=drive.belts,
        pulleys=pulleys,
        installation=drive.installation,
        tensioners=named,
        sense=drive.sense,
        model=bj.Model(arm_curvature=1.0),
    )
    return dataclasses.replace(made, **changes), point


def arm(pivot=NEAR, stiffness=30.0, **more):
    return bj.Tensioner(pivot, stiffness, 0.001165, on=[0.0, 0.0], **more)


BOLTED = arm((-0.11, 0.36), 0.0, locked=1.0)
SLIDE = bj.Tensioner((0, 0), 4000.0, 0.25, kind="linear", direction=(0.9848, 0.1736), on=[0.0, 0.0])
ON_FIRST = dict(on=[1.0, 0.0], mass=0.12, mass_center=(-0.05, 0.17), inertia_center=3e-5)
KINDS = {
    "one arm": ((arm(), BOLTED), ([TENSIONER], [IDLER])),
    "two arms": ((arm(), arm((-0.11, 0.36), 25.0)), ([TENSIONER], [IDLER])),
    "slide": ((SLIDE, BOLTED), ([TENSIONER], [IDLER])),
    "twin frame": ((arm((-0.1, 0.24), 60.0), BOLTED), ([TENSIONER, IDLER], [])),
    "chain": (
        (arm((-0.10, 0.24), 90.0), bj.Tensioner(NEAR, 30.0, 0.0, **ON_FIRST)),
        ([], [TENSIONER]),
    ),
    "locked": ((arm(locked=1.0), arm((-0.11, 0.36), 25.0)), ([TENSIONER], [IDLER])),
    "torque on the arm": ((arm(), arm((-0.27, 0.24), 200.0)), ([TENSIONER], [ALTERNATOR])),
    "stop": ((arm(stops=(-1.0, 0.05)), arm((-0.11, 0.36), 25.0)), ([TENSIONER], [IDLER])),
}


def total(drive, point):
    steady = bj.steady_state(drive, point, throw=False)
    return jnp.sum(steady.coupling), steady


def test_eight_kinds_of_bodies_in_one_batch_compile_once():
    drives = [seven(*KINDS[kind]) for kind in KINDS]
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), *drives)
    solve = bj.quick_jit(jax.vmap(jax.value_and_grad(total, has_aux=True)))
    (gammas, steady), slopes = solve(*batch)
    assert np.all(np.asarray(steady.result == bj.RESULTS.successful))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(slopes) if leaf.ndim == 1)
    # Each by itself is the same, by the one program of `steady_state`.
    alone = [bj.steady_state(*drives[0])]
    with compilations() as counted:
        alone += [bj.steady_state(*drive) for drive in drives[1:]]
    assert counted == [0]
    for k, one in enumerate(alone):
        np.testing.assert_allclose(gammas[k], one.coupling.sum(), rtol=1e-12)
        np.testing.assert_allclose(
            steady.coordinate_change[k], one.coordinate_change, rtol=1e-8, atol=1e-12
        )
    assert steady.at_stop[-1].tolist() == [1, 0]
    assert float(steady.stop_reactions[-1, 0]) < 0
    places = np.asarray(steady.reference.coordinates)
    assert places[0, 1] == places[5, 0] == 0
    assert np.abs(places[1]).min() > 0.05


def frequencies(drive, point, count=6):
    lin = bj.linearize(bj.steady_state(drive, point), bj.Legendre(10))
    return np.asarray(bj.modes(lin, count).frequencies)


@pytest.mark.slow
def test_a_stiff_second_arm_is_none():
    drive, point = seven((arm(), arm((-0.11, 0.36), 1e10)), ([TENSIONER], [IDLER]))
    one, _ = seven(*KINDS["one arm"])
    np.testing.assert_allclose(frequencies(drive, point), frequencies(one, point), rtol=1e-6)


@pytest.mark.slow
def test_a_far_arm_is_a_slide():
    """Pivot 1000 m away across the direction, k r^2 and J r^2: the rotation is the way over r."""
    r = 1e3
    along = np.array([np.cos(0.3), np.sin(0.3)])
    center = np.asarray(example("seven_pulley")[0].pulleys[TENSIONER].center)
    pivot = center + r * np.array([-along[1], along[0]])
    far = bj.Tensioner(pivot, 4000 * r**2, 0.25 * r**2, on=[0.0, 0.0])
    slide = bj.Tensioner((0, 0), 4000.0, 0.25, kind="linear", direction=along, on=[0.0, 0.0])
    (turning, point), (sliding, _) = (
        seven((body, BOLTED), ([TENSIONER], [IDLER])) for body in (far, slide)
    )
    a, b = (bj.steady_state(drive, point) for drive in (turning, sliding))
    np.testing.assert_allclose(a.coupling, b.coupling, rtol=1e-6)
    assert float(a.reference.coordinates[0]) * r == pytest.approx(
        float(b.reference.coordinates[0]), rel=1e-5
    )
    np.testing.assert_allclose(frequencies(turning, point), frequencies(sliding, point), rtol=1e-5)


@pytest.mark.slow
def test_a_stiff_twin_arm_is_a_rigid_frame():
    """Two arms of one pivot on a spring that does not give: one body with two pulleys."""
    pivot = (-0.1, 0.24)
    half = bj.Tensioner(pivot, 30.0, 0.0005825, on=[0.0, 0.0])
    pair, point = seven((half, half), ([TENSIONER], [IDLER]))
    spring = bj.ArmSpring([-1.0, 1.0], 1e9)
    rigid, _ = seven((bj.Tensioner(pivot, 60.0, 0.001165, on=[0.0, 0.0]), BOLTED), ([1, 3], []))
    rigid_state = bj.reference_state(rigid, point)
    # The springs share the frame's: each is wound as the frame's is.
    free = [float(rigid_state.free[0])] * 2 + [0.0]
    belt = bj.BeltGiven(rigid_state.unstretched_length, free=free)
    pair = dataclasses.replace(pair, arm_springs=(spring,), installation=belt)
    a, b = bj.steady_state(pair, point), bj.steady_state(rigid, point)
    np.testing.assert_allclose(a.coupling, b.coupling, rtol=1e-6)
    np.testing.assert_allclose(frequencies(pair, point), frequencies(rigid, point), rtol=1e-5)


@pytest.mark.slow
def test_belts_that_share_the_rigid_crank_alone_have_each_its_own_spectrum():
    drive, point = example("three_pulley")
    second = [
        dataclasses.replace(
            pulley,
            name=f"{pulley.name} 2",
            belt="second",
            shaft="crankshaft" if place == 0 else None,
            driver=0.0,
            on=[0.0, float(pulley.on[0])],
        )
        for place, pulley in enumerate(drive.pulleys)
    ]
    first = [dataclasses.replace(p, belt="first", on=[float(p.on[0]), 0.0]) for p in drive.pulleys]
    arms = [
        dataclasses.replace(drive.tensioner, name=name, on=[0.0, 0.0], stiffness=stiffness)
        for name, stiffness in (("a", 116.4), ("b", 90.0))
    ]
    belts = [dataclasses.replace(drive.belt, name=name) for name in ("first", "second")]
    both = bj.Drive(
        belts=belts,
        pulleys=[*first, *second],
        installation=bj.TensionGiven([300.0, 250.0]),
        tensioners=arms,
        sense=[float(drive.sense)] * 2,
    )
    alone = [
        eqx.tree_at(
            lambda d: (d.tensioner.stiffness, d.installation.tension),
            drive,
            (jnp.array(stiffness), jnp.array(tension)),
        )
        for stiffness, tension in ((116.4, 300.0), (90.0, 250.0))
    ]
    own = np.sort(np.concatenate([frequencies(one, point, 4) for one in alone]))
    # The crank that both share is held.
    np.testing.assert_allclose(frequencies(both, point, 5), own[:5], rtol=1e-9)


def test_a_tensioner_over_center_is_unstable():
    drive, point = example("three_pulley")
    soft = eqx.tree_at(lambda d: d.tensioner.stiffness, drive, jnp.array(1e-3))
    # A short arm: what the mechanism's own curvature takes outweighs what the belt holds.
    near = drive.pulleys[1].center + (drive.tensioner.pivot - drive.pulleys[1].center) / 4
    short = eqx.tree_at(lambda d: d.tensioner.pivot, soft, near)
    assert bj.steady_state(short, point, throw=False).result == bj.RESULTS.successful
    curved = eqx.tree_at(lambda d: d.model, short, bj.Model(arm_curvature=1.0))
    found = bj.steady_state(curved, point, throw=False)
    assert found.result == bj.RESULTS.tensioner_unstable
    # A belt of given length, which has to stretch, still holds it at rest.
    assert found.reference.result == bj.RESULTS.successful
