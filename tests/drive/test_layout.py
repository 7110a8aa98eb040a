"""Geometry against the source's tables, exact layouts, and its own conservation laws."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drives import build, example, random_drives
from published import Value, assert_matches_print

import beltjax as bj


def test_prototype_agrees_with_tables_3_2_and_4_1():
    at = bj.layout(example("three_pulley")[0])
    twice = "0.34489550 was rounded twice: the coordinates give 0.3448954966"
    printed = (Value("0.154799"), Value("0.344896", twice), Value("0.551826"))
    for computed, value in zip(at.span_lengths, printed, strict=True):
        assert_matches_print(computed, value)
    angles = bj.alignment_angles(example("three_pulley")[0], at)[0]
    for computed, text in zip(jnp.degrees(angles), ("135.782", "178.735"), strict=True):
        assert_matches_print(computed, Value(text))
    for computed, text in zip(jnp.degrees(at.wraps), ("221.13", "42.95", "181.83"), strict=True):
        assert_matches_print(computed, Value(text))
    assert_matches_print(at.path_length, Value("1.514092"))
    assert_matches_print(at.arm_length, Value("0.097108"))
    assert_matches_print(
        at.arm_length, Value("0.0970", "the pivot's coordinates give 0.0971 m, not 0.097")
    )


def test_two_equal_pulleys_have_an_exact_path():
    at = bj.layout(example("two_pulley_table_5_1")[0])
    assert float(at.path_length) == pytest.approx(2 * np.pi * 0.05 + 2 * np.pi * 0.05, rel=1e-15)
    np.testing.assert_allclose(at.wraps, np.pi, rtol=1e-15)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_large_pulley_beside_a_small_one_is_wrapped_by_more_than_three_quarters(sense):
    drive, _ = example("two_pulley_table_5_3")
    drive = eqx.tree_at(lambda d: d.pulleys[1].center, drive, jnp.array([0.0565, 0.0]))
    # R = 10 and 50 mm on centers 56.5 mm apart: sin(phi) = 40/56.5.
    at = bj.layout(eqx.tree_at(lambda d: d.sense, drive, jnp.asarray(sense)), throw=False)
    phi = np.arcsin(40 / 56.5)
    np.testing.assert_allclose(at.wraps, [np.pi - 2 * phi, np.pi + 2 * phi], rtol=1e-14)
    assert at.result == bj.RESULTS.successful
    assert np.degrees(at.wraps[1]) > 270


def mirrored(drive):
    """The drive seen from behind: listed in the other sense."""
    flip = jnp.array([-1.0, 1.0])
    pulleys = [eqx.tree_at(lambda p: p.center, p, flip * p.center) for p in drive.pulleys]
    drive = eqx.tree_at(lambda d: d.pulleys, drive, tuple(pulleys))
    drive = eqx.tree_at(lambda d: d.tensioners[0].pivot, drive, flip * drive.tensioner.pivot)
    return eqx.tree_at(lambda d: d.sense, drive, -drive.sense)


@pytest.mark.parametrize("name", ["three_pulley", "seven_pulley"])
def test_a_mirrored_drive_is_the_same_drive(name):
    drive, point = example(name)
    both = drive, mirrored(drive)
    here, there = (bj.steady_state(d, point) for d in both)
    np.testing.assert_allclose(here.coupling, there.coupling, rtol=1e-12)
    assert float(here.arm_rotation) == pytest.approx(-float(there.arm_rotation), rel=1e-10)
    # Counterclockwise again, spans in and out of the tensioner change places.
    layouts = (here.reference.layout, there.reference.layout)
    angles = [
        np.asarray(bj.alignment_angles(d, at)[0]) for d, at in zip(both, layouts, strict=True)
    ]
    np.testing.assert_allclose(angles[0], np.mod(np.pi - angles[1][::-1], 2 * np.pi), rtol=1e-12)


def test_listing_backwards_is_the_same_drive():
    drive, point = example("three_pulley")
    back = eqx.tree_at(lambda d: d.pulleys, drive, drive.pulleys[::-1])
    back = eqx.tree_at(lambda d: d.sense, back, -drive.sense)
    here, there = bj.layout(drive), bj.layout(back)
    angles = [bj.alignment_angles(d, at) for d, at in ((drive, here), (back, there))]
    np.testing.assert_allclose(*angles, rtol=1e-13)
    assert float(here.path_length) == pytest.approx(float(there.path_length), rel=1e-15)
    turn = float(bj.steady_state(drive, point).arm_rotation)
    assert turn == pytest.approx(float(bj.steady_state(back, point).arm_rotation), rel=1e-10)


@pytest.mark.parametrize("n", [3, 5])
def test_path_closes_and_follows_the_arm(n):
    arrays = random_drives(n, 64)

    @jax.jit
    @jax.vmap
    def look(arrays):
        drive, _ = build(*arrays)
        _, slope = jax.jvp(lambda t: bj.layout(drive, t, throw=False).path_length, (0.0,), (1.0,))
        at = bj.layout(drive, throw=False)
        return at, at.starts + at.span_lengths[:, None] * at.directions - at.ends, slope

    at, gaps, slope = look(arrays)
    faces = np.asarray(arrays[2])
    np.testing.assert_allclose(np.sum(faces * np.asarray(at.wraps), axis=1), 2 * np.pi, rtol=1e-13)
    np.testing.assert_allclose(gaps, 0.0, atol=1e-14)
    # d(path)/d(alpha) = -r_t D, from the directions of the spans alone.
    take_up = np.asarray(at.span_pulls)[..., 0]
    np.testing.assert_allclose(slope, take_up.sum(axis=1), rtol=1e-9, atol=1e-13)


def test_spans_that_cross_are_reported_and_harmless():
    # A presser goes through the lower span of two pulleys; the turn of the belt is still one.
    one = jnp.ones(1)
    numbers = {"EA": 1e5 * one[0], "EI": 0.01 * one[0], "speed": one[0]}
    radii, faces = jnp.array([0.05, 0.05, 0.02]), jnp.array([1.0, 1.0, -1.0])

    def path(y):
        centers = jnp.stack([jnp.array([0.0, 0.0]), jnp.array([0.4, 0.0]), jnp.stack([0.2, y])])
        pivot = jnp.array([0.1, 0.3])
        drive, _ = build(
            centers, radii, faces, jnp.array([0.0, 0, 1]), pivot, 50.0, 300.0, 0 * radii, numbers
        )
        at = bj.layout(drive, throw=False)
        return at.path_length, (at.result, at.wraps)

    look = jax.jit(jax.vmap(jax.value_and_grad(path, has_aux=True)))
    (_, (result, wraps)), slopes = look(jnp.array([0.05, -0.029, -0.075]))
    np.testing.assert_allclose(wraps @ faces, 2 * np.pi, rtol=1e-12)
    crossed = result == bj.RESULTS.path_not_simple
    assert crossed.tolist() == [False, False, True]
    assert (slopes[:2] < 0).all()
    assert slopes[2] == 0.0


def test_pulleys_without_tangent_are_reported_and_harmless():
    drive, _ = example("three_pulley")

    def path(x):
        moved = eqx.tree_at(lambda d: d.pulleys[1].center, drive, jnp.stack([x, 0.0556]))
        at = bj.layout(moved, throw=False)
        return at.path_length, at.result

    look = jax.jit(jax.vmap(jax.value_and_grad(path, has_aux=True)))
    (lengths, result), slopes = look(jnp.array([0.3477, 0.5525]))
    assert (result == bj.RESULTS.no_tangent).tolist() == [False, True]
    assert np.all(np.isfinite(lengths))
    assert np.all(np.isfinite(slopes))
