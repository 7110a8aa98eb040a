"""Derivatives three ways, for every number of the three- and the seven-pulley drive."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drives import example, flat_numbers, held_by_belt, three_ways

import beltjax as bj
from beltjax.compiling.quick import quickly_compiled


def answers(drive, point):
    """T, theta_t, eta and Gamma_i."""
    steady = bj.steady_state(drive, point, throw=False)
    scalars = jnp.stack([steady.tension_change, steady.arm_rotation, steady.effectiveness])
    return jnp.concatenate([scalars, steady.coupling])


# One pair at every run, the others by `pytest -m slow`.
PAIRS = [
    pytest.param("three_pulley", "belt", marks=pytest.mark.slow),
    pytest.param("seven_pulley", "tension", marks=pytest.mark.slow),
    ("three_pulley", "tension"),
    pytest.param("seven_pulley", "belt", marks=pytest.mark.slow),
]


@pytest.mark.parametrize(("name", "rule"), PAIRS)
def test_forward_reverse_and_differences_agree(name, rule):
    drive, point = example(name)
    if rule == "belt":
        drive = held_by_belt(drive, point)
    names, values, put = flat_numbers(drive, point)

    def at(numbers):
        return answers(*put(numbers))

    # Relative to each answer's largest slope, in the steps that were taken.
    forward, reverse, differences, size = three_ways(at, values, 5e-5)
    assert np.all(np.isfinite(forward))
    assert np.max(np.abs(forward - reverse) / np.maximum(np.abs(forward), 1e-6 * size)) < 1e-9
    worst = np.abs(forward - differences) / np.maximum(np.abs(forward), 1e-3 * size)
    where = np.unravel_index(np.argmax(worst), worst.shape)
    assert worst.max() < 1e-6, f"d answer[{where[0]}]/d {names[where[1]]}"


def test_gradient_of_a_drive_is_a_drive():
    drive, point = example("three_pulley")
    gradient = jax.grad(lambda d: bj.steady_state(d, point).coupling.sum())(drive)
    assert isinstance(gradient, bj.Drive)
    assert jax.tree.structure(gradient) == jax.tree.structure(drive)
    assert gradient.pulleys[2].radius < -100.0
    # Choices that are kept as numbers for the compiler's sake are no numbers of the drive.
    assert float(gradient.pulleys[0].driver) == float(gradient.sense) == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(("rule", "slope"), [("tension", -11.9), ("belt", -1096.0)])
def test_slope_with_the_driver_radius_depends_on_the_installation(rule, slope):
    # docs/theory/reference_state.md, below (R5): at eps = 0.04, s = 0.3.
    drive, _ = example("three_pulley")
    at = bj.layout(drive)
    stiffness = 0.04**2 * 300 * jnp.mean(at.span_lengths) ** 2
    drive = eqx.tree_at(lambda d: d.belt.bending_stiffness, drive, stiffness)
    point = bj.OperatingPoint(belt_speed=0.3 * np.sqrt(300 / 0.1029))
    if rule == "belt":
        drive = held_by_belt(drive, point)

    def total(radius):
        changed = eqx.tree_at(lambda d: d.pulleys[0].radius, drive, radius)
        return bj.steady_state(changed, point, throw=False).coupling.sum()

    assert float(jax.grad(total)(drive.pulleys[0].radius)) == pytest.approx(slope, rel=5e-3)


@pytest.mark.slow
def test_second_derivatives_nest():
    drive, point = example("three_pulley")

    def total(k):
        changed = eqx.tree_at(lambda d: d.pulleys[2].radius, drive, k)
        return bj.steady_state(changed, point, throw=False).coupling.sum()

    radius = drive.pulleys[2].radius
    slope = quickly_compiled(jax.grad(total))
    curvature = quickly_compiled(jax.jacfwd(jax.grad(total)))(radius)
    h = 1e-5
    differences = (slope(radius + h) - slope(radius - h)) / (2 * h)
    assert float(curvature) == pytest.approx(float(differences), rel=1e-6)
