"""The steady state by collocation against the closed form, which shares no formula with it."""

import dataclasses
import functools
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import beltjax as bj

EXAMPLES = Path(__file__).parents[2] / "examples"
BENDING = [0.001, 0.005, 0.02, 0.1, 0.3]


@functools.cache
def drive(name):
    return bj.load_drive(EXAMPLES / f"{name}.toml")


@functools.cache
def bending_scale(name):
    return float(bj.steady_state(*drive(name)).groups.bending)


def with_bending(name, eps):
    given, point = drive(name)
    stiffness = given.belt.bending_stiffness * (eps / bending_scale(name)) ** 2
    return eqx.tree_at(lambda d: d.belt.bending_stiffness, given, stiffness), point


def numbers(steady):
    """T, theta_t and every Gamma_i."""
    return jnp.concatenate(
        [jnp.stack([steady.tension_change, steady.arm_rotation]), steady.coupling]
    )


METHODS = {"collocation": bj.Collocation(), "exact": bj.Exact()}


def by_arrays(given, point, method):
    """The numbers as a function of the drive's arrays, and those arrays."""
    arrays, static = eqx.partition(given, eqx.is_inexact_array)
    method = METHODS[method]
    return lambda a: numbers(bj.steady_state(eqx.combine(a, static), point, method)), arrays


@functools.cache
def value_and_slopes(method):
    """Value and derivatives along four directions in the space of drives, compiled once."""

    def evaluate(given, point, directions):
        value, push = jax.linearize(*by_arrays(given, point, method))
        return value, jax.vmap(push)(directions)

    return eqx.filter_jit(evaluate)


@functools.cache
def gradient(method):
    """Gradient of the sum of all numbers, compiled once."""

    def evaluate(given, point):
        value, pull = jax.vjp(*by_arrays(given, point, method))
        return pull(jnp.ones_like(value))[0]

    return eqx.filter_jit(evaluate)


def directions(given):
    """Each number of the drive in turn would compile as one: here, seeded mixtures of all."""
    arrays = eqx.filter(given, eqx.is_inexact_array)
    leaves, tree = jax.tree.flatten(arrays)
    rng = np.random.default_rng(0)
    return jax.tree.unflatten(
        tree, [0.01 * rng.normal(size=(4, *leaf.shape)) * np.asarray(leaf) for leaf in leaves]
    )


# Thin layers at every run, the others by `pytest -m slow`.
USUAL = {("three_pulley", 0.005)}
CASES = [
    pytest.param(name, eps, marks=() if (name, eps) in USUAL else pytest.mark.slow)
    for name in ("three_pulley", "seven_pulley")
    for eps in BENDING
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "eps"), CASES)
def test_equals_the_closed_form_with_its_slopes(name, eps):
    given, point = with_bending(name, eps)
    along = directions(given)
    value, slopes = value_and_slopes("collocation")(given, point, along)
    exact, exact_slopes = value_and_slopes("exact")(given, point, along)
    np.testing.assert_allclose(value, exact, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(slopes, exact_slopes, rtol=1e-7, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("eps", BENDING)
@pytest.mark.parametrize("name", ["three_pulley", "seven_pulley"])
def test_gradient_is_that_of_the_closed_form(name, eps):
    given, point = with_bending(name, eps)
    both = (gradient(method)(given, point) for method in METHODS)
    for found, wanted in zip(*map(jax.tree.leaves, both), strict=True):
        scale = max(1e-6, float(np.max(np.abs(wanted))))
        assert np.max(np.abs(found - wanted)) < 1e-7 * scale


@pytest.mark.slow  # compiles the whole solution of every span
def test_deflection_is_the_closed_form():
    given, point = with_bending("three_pulley", 0.1)
    x = jnp.linspace(0.0, 1.0, 57)
    found = bj.steady_state(given, point, bj.Collocation(intervals=48))
    exact = bj.steady_state(given, point)
    for span in range(3):
        difference = found.deflection(span, x) - exact.deflection(span, x)
        assert np.max(np.abs(difference)) < 1e-9


def test_too_few_intervals_for_the_layers_are_reported_and_not_returned():
    given, point = with_bending("three_pulley", 0.1)
    coarse = bj.Collocation(intervals=4, stages=2)
    steady = bj.steady_state(given, point, coarse, throw=False)
    assert steady.result == bj.RESULTS.mesh_exhausted
    exact = bj.steady_state(given, point)
    error = abs(float(steady.error))
    assert error > coarse.tol
    assert np.isfinite(np.asarray(numbers(steady))).all()
    assert float(exact.tension_change) > 0


def locked():
    given, _ = drive("three_pulley")
    pulleys = tuple(eqx.tree_at(lambda p: p.on, p, jnp.zeros(0)) for p in given.pulleys)
    belt = dataclasses.replace(given.belt, axial_stiffness=600.0)
    return dataclasses.replace(given, pulleys=pulleys, belts=(belt,), tensioners=())


@pytest.mark.slow
def test_slack_lane_leaves_its_neighbors_alone():
    """Locked centers and an elastic belt: at s = 5.6 its stretch outgrows what slopes take up."""
    given = locked()
    speeds = jnp.array([10.0, 20.0, 300.0, 30.0, np.nan])

    def total(speed, method):
        at = bj.OperatingPoint(belt_speed=speed)
        steady = bj.steady_state(given, at, method, throw=False)
        return steady.coupling.sum() + steady.tension_change, steady.result == bj.RESULTS.span_slack

    def evaluate(method):
        run = jax.vmap(jax.value_and_grad(functools.partial(total, method=method), has_aux=True))
        return jax.jit(run)(speeds)

    (value, slack), slope = evaluate(bj.Collocation())
    (exact, exact_slack), exact_slope = evaluate(bj.Exact())
    assert slack.tolist() == exact_slack.tolist() == [False, False, True, False, False]
    assert slope[np.array([2, 4])].tolist() == [0.0, 0.0]
    np.testing.assert_allclose(value, exact, rtol=1e-9)
    np.testing.assert_allclose(slope, exact_slope, rtol=1e-7)


@pytest.mark.slow
def test_a_string_has_no_layers_to_resolve():
    given, point = with_bending("three_pulley", 0.0)
    steady = bj.steady_state(given, point, bj.Collocation(), throw=False)
    assert steady.result == bj.RESULTS.mesh_exhausted
    assert np.isfinite(np.asarray(numbers(steady))).all()


def test_settings_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="intervals must be at least 4, not 2"):
        bj.Collocation(intervals=2)
    with pytest.raises(ValueError, match="stages must be from 2 to 7, not 9"):
        bj.Collocation(stages=9)
