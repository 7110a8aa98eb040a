"""One model of a drive whose belt speed varies: it holds the steady states of all other speeds."""

import dataclasses
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from bodies_cases import TWO_BELTS, load
from drives import example

import beltjax as bj
from beltjax.analysis.motion import belt_speeds, motion_model
from beltjax.compiling.quick import quickly_compiled
from beltjax.physics.motion import strains, stretching
from beltjax.physics.vibration import acceleration

CASES = json.loads((Path(__file__).parents[1] / "data" / "periodic.json").read_text())
NONE = bj.Damping(arm=False)


@pytest.fixture(scope="module")
def at_20():
    """The three-pulley drive at 20 m/s, in motion."""
    drive, point = example("three_pulley")
    point = bj.OperatingPoint(belt_speed=20.0, torque=point.torque)
    lin = bj.linearize(bj.steady_state(drive, point), bj.Legendre(32))
    return lin, motion_model(lin, NONE, speed=belt_speeds(drive, point, lin))


def at_rest(model, omega):
    """The coordinates at which a drive of constant speed stays, by Newton's method."""

    def force(z):
        return model.stiffness @ z + stretching(model, z, 0.0, model.speed.relief(omega))

    z = jnp.zeros(len(model.mass))
    for _ in range(6):
        z = z - jnp.linalg.solve(jax.jacfwd(force)(z), force(z))
    return z, jax.jacfwd(force)(z), force(z)


@pytest.mark.parametrize("speed", [0, 30])
def test_other_speeds_from_one_model(at_20, speed):
    # Of another program, which built models at either speed.
    lin, model = at_20
    case = CASES["speed_from_one_model"][f"at_{speed}"]
    omega = speed / 20 * model.speed.omega0
    z, K, left = quickly_compiled(at_rest)(model, omega)
    assert np.abs(left).max() < 1e-10
    G = np.asarray(model.damping + (omega - model.speed.omega0) * model.speed.gyroscopic)
    M, none, unit = np.asarray(model.mass), np.zeros(model.mass.shape), np.eye(len(model.mass))
    first = np.block([[none, unit], [-K, -G]])
    found = scipy.linalg.eigvals(first, scipy.linalg.block_diag(unit, M))
    hertz = np.sort(found.imag[found.imag > 0])[:4] / (2 * np.pi * float(lin.scales.time))
    np.testing.assert_allclose(hertz, case["hertz"], rtol=1e-9)
    assert lin.steady.arm_rotation + z[-1] == pytest.approx(case["arm"], rel=1e-9)
    tensions = lin.scales.tension * lin.model.gam * strains(model, z) + lin.steady.running_tensions
    np.testing.assert_allclose(tensions, case["tension"], rtol=1e-10)


@pytest.mark.slow
def test_other_speeds_of_a_drive_of_two_belts(tmp_path):
    drive, point = load(tmp_path, TWO_BELTS)
    slow, fast = (
        dataclasses.replace(point, belt_speed=None, driver_speed=w) for w in (150.0, 450.0)
    )
    lin = bj.linearize(bj.steady_state(drive, slow), bj.Legendre(16))
    model = motion_model(lin, NONE, speed=belt_speeds(drive, slow, lin))
    there = bj.steady_state(drive, fast)
    z, _, _ = quickly_compiled(at_rest)(model, 3 * model.speed.omega0)
    moved = (there.coordinate_change - lin.steady.coordinate_change) / lin.units
    # The steady state is of first order in the arms' motions beside their paths.
    np.testing.assert_allclose(z[-len(moved) :], moved, rtol=5e-5)
    tensions = lin.scales.tension * lin.model.gam * strains(model, z) + lin.steady.running_tensions
    np.testing.assert_allclose(tensions, there.running_tensions, rtol=1e-5)


def test_force_of_acceleration_is_that_of_the_tension_along_the_span(at_20):
    # A span of an accelerating belt feels the gradient of its tension alone: -(x - 1/2) w_xx.
    lin, _ = at_20
    basis, m = bj.Legendre(12), lin.model
    rates = jnp.array([0.3, 0.5, 0.7])
    z = jnp.asarray(np.random.default_rng(4).normal(size=3 * 12 + len(lin.rotors) + 1))
    d = jnp.zeros((3, len(z)))  # a straight span
    found = acceleration(m._replace(drop=0 * m.drop), basis, d, lin.rotors, rates)
    x, weight = np.polynomial.legendre.leggauss(40)
    x, weight = jnp.asarray((x + 1) / 2), weight / 2
    values, bends = basis.values(x), basis.values(x, 2)
    fields = z[:36].reshape(3, 12)
    load = -(weight * (x - 0.5) * (fields @ bends.T)) @ values
    drag = m.tau * rates * m.mu * m.lam**2
    expected = (drag[:, None] * load).ravel()
    np.testing.assert_allclose((found.matrix @ z)[:36], expected, atol=1e-12)
    # The lift of the arm's span meets slopes by transport and by the gradient.
    slopes = fields @ basis.values(x, 1).T + (m.a @ z[-1:])[:, None]
    lift = m.W0 + m.a * x
    by_arm = jnp.sum(drag * jnp.sum(weight * (lift + m.a * (x - 0.5)) * slopes, axis=1))
    assert (found.matrix @ z)[-1] == pytest.approx(float(by_arm), rel=1e-11)
