"""Forced response against time integration, reciprocity, energy, and the closed form."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drives import at_groups, example, vibrating
from vibration import linearized

import beltjax as bj
from beltjax.analysis.damping import damping_matrix

DAMPING = bj.Damping(modal=0.05, stiffness=2e-5)
NAMES = ("crankshaft", "tensioner", "accessory")


@pytest.mark.slow
def test_time_integration_after_the_transient():
    lin = linearized("three_pulley", 0.06, 0.5, bj.Legendre(3))
    omega = 2.2  # dimensionless, between the first two frequencies
    excitation = bj.Excitation(torques={"accessory": 1.0})
    found = bj.frequency_response(lin, omega / lin.scales.time, excitation, NAMES, damping=DAMPING)
    size = len(lin.mass)
    C = lin.gyroscopic + damping_matrix(lin, DAMPING)
    place = 3 * 3 + 1  # the accessory, second of the pulleys that turn
    moment = lin.scales.energy
    load = jnp.zeros(size).at[place].set(1.0 / moment)

    def slope(t, y, _):
        z, rate = y[:size], y[size:]
        force = load * jnp.cos(omega * t) - C @ rate - lin.stiffness @ z
        return jnp.concatenate([rate, jnp.linalg.solve(lin.mass, force)])

    period = 2 * np.pi / omega
    times = jnp.linspace(120, 121, 65)[:-1] * period
    solved = diffrax.diffeqsolve(
        diffrax.ODETerm(slope), diffrax.Kvaerno5(), 0.0, float(times[-1]), 0.01,
        jnp.zeros(2 * size), saveat=diffrax.SaveAt(ts=times), max_steps=200_000,
        stepsize_controller=diffrax.PIDController(rtol=1e-8, atol=1e-11),
    )  # fmt: skip
    amplitude = 2 * jnp.mean(solved.ys[:, :size] * jnp.exp(-1j * omega * times)[:, None], axis=0)
    expected = found.coordinates[0]
    np.testing.assert_allclose(amplitude, expected, atol=1e-5 * np.abs(expected).max())


def test_reciprocity():
    # With the belt's travel reversed the answer at a to a torque at b is that at b to one at a.
    frequencies = jnp.linspace(150.0, 900.0, 8)
    here = linearized("three_pulley", 0.03, 0.6, bj.Legendre(10))
    back = eqx.tree_at(lambda lin: lin.gyroscopic, here, -here.gyroscopic)

    def answer(lin, at, to):
        excitation = bj.Excitation(torques={NAMES[at]: 1.0})
        found = bj.frequency_response(lin, frequencies, excitation, NAMES, damping=DAMPING)
        return np.asarray(found.rotations[:, to])

    one, other = answer(here, 2, 1), answer(back, 1, 2)
    np.testing.assert_allclose(one, other, rtol=1e-10)
    assert np.abs(one - answer(here, 1, 2)).max() > 1e-2 * np.abs(one).max()


def test_power_taken_in_is_power_dissipated():
    lin = linearized("three_pulley", 0.03, 0.6, bj.Legendre(10))
    frequencies = jnp.linspace(150.0, 900.0, 8)
    excitation = bj.Excitation(torques={"accessory": 1.0 + 0.5j, "tensioner": -0.3})
    found = bj.frequency_response(lin, frequencies, excitation, NAMES, damping=DAMPING)
    torque = np.array([0.0, -0.3, 1.0 + 0.5j])
    omega = np.asarray(frequencies)
    taken_in = (np.conj(torque) * 1j * omega[:, None] * found.rotations).real.sum(1) / 2
    C, z = np.asarray(damping_matrix(lin, DAMPING)), np.asarray(found.coordinates)
    unit = float(lin.scales.energy * lin.scales.time)
    dissipated = omega**2 * np.einsum("fa,ab,fb->f", z.conj(), C, z).real / 2 * unit
    np.testing.assert_allclose(taken_in, dissipated, rtol=1e-9)


@pytest.mark.parametrize("name", ["three_pulley", "seven_pulley"])
def test_closed_form_equals_the_converged_basis(name):
    drive, point = example(name)
    lin = bj.linearize(bj.steady_state(drive, point), bj.Legendre(40))
    frequencies = jnp.linspace(90.0, 800.0, 6)
    excitation = bj.Excitation(crank=0.01, torques={drive.pulley_names[2]: 0.4})
    routes = [
        bj.frequency_response(lin, frequencies, excitation, drive.pulley_names, exact=exact)
        for exact in (False, True)
    ]
    for field in ("rotations", "arm_rotation", "tensions", "hub_loads"):
        by_basis, exact = (np.asarray(getattr(route, field)) for route in routes)
        np.testing.assert_allclose(by_basis, exact, atol=1e-8 * np.abs(exact).max())
    by_basis, exact = (np.asarray(route.span_peaks) for route in routes)
    np.testing.assert_allclose(by_basis, exact, rtol=1e-4)  # the closed form's is that of a grid


def test_slow_crank_turns_everything_rigidly():
    # r theta is the same all round when nothing has time to vibrate.
    drive, point = example("seven_pulley")
    lin = bj.linearize(bj.steady_state(drive, point), bj.Legendre(12))
    found = bj.frequency_response(lin, jnp.array([1e-2]), bj.Excitation(crank=0.01))
    rims = np.asarray(found.rotations[0] * drive.radii)
    np.testing.assert_allclose(rims, 0.01 * float(drive.radii[0]), rtol=1e-6)
    assert np.abs(found.tensions).max() < 1e-3


@pytest.mark.slow
def test_speed_response_is_the_response_at_each_speed():
    drive, point = example("three_pulley")
    speeds = jnp.array([60.0, 150.0, 5000.0])
    excitation = bj.Excitation(crank=0.005)
    found = bj.speed_response(
        drive, point, speeds, excitation, order=2.0, damping=DAMPING, throw=False
    )
    np.testing.assert_array_equal(
        found.result == bj.RESULTS.successful, np.array([True, True, False])
    )
    assert np.all(np.isfinite(found.span_peaks))
    steady = bj.steady_state(drive, bj.OperatingPoint(driver_speed=150.0))
    alone = bj.frequency_response(
        bj.linearize(steady, bj.Legendre(16)), jnp.array([300.0]), excitation, damping=DAMPING
    )
    np.testing.assert_allclose(found.span_peaks[1], alone.span_peaks[0], rtol=1e-10)
    np.testing.assert_allclose(found.stiffness_ratios[1], steady.stiffness_ratios, rtol=1e-12)
    np.testing.assert_allclose(alone.stiffness_ratios[0], steady.stiffness_ratios, rtol=1e-12)


@pytest.mark.slow
def test_derivative_of_the_peak_over_a_range():
    drive, point = at_groups(vibrating("three_pulley"), 0.04, 0.5)

    def peak(stiffness):
        changed = eqx.tree_at(lambda d: d.tensioner.stiffness, drive, stiffness)
        lin = bj.linearize(
            bj.steady_state(changed, point, throw=False), bj.Legendre(8), throw=False
        )
        return bj.peak_response(
            lin, lambda r: r.span_peaks[0, 1], 300.0, 700.0, bj.Excitation(crank=0.01),
            damping=DAMPING, points=200, throw=False,
        )[0]  # fmt: skip

    stiffness, h = drive.tensioner.stiffness, 1e-2
    solve = jax.jit(peak)
    slope = float(jax.jit(jax.grad(peak))(stiffness))
    forward = float(jax.jit(jax.jacfwd(peak))(stiffness))
    difference = float(solve(stiffness + h) - solve(stiffness - h)) / (2 * h)
    assert slope == pytest.approx(forward, rel=1e-9)
    assert slope == pytest.approx(difference, rel=1e-5)


def test_what_cannot_be_asked():
    lin = linearized("three_pulley", 0.04, 0.5, bj.Sine(2))
    crank = bj.Excitation(crank=0.01)
    with pytest.raises(ValueError, match="frequencies: found none"):
        bj.frequency_response(lin, jnp.zeros(0), crank)
    with pytest.raises(ValueError, match="frequencies: must be positive"):
        bj.frequency_response(lin, jnp.array([0.0, 1.0]), crank)
    with pytest.raises(ValueError, match="there is no pulley 'pump'"):
        bj.frequency_response(lin, 3.0, bj.Excitation(torques={"pump": 1.0}), NAMES)
    with pytest.raises(ValueError, match="exact: modal, stiffness and belt damping"):
        bj.frequency_response(lin, 3.0, crank, damping=DAMPING, exact=True)
    with pytest.raises(ValueError, match="stiffness must not be negative"):
        bj.Damping(stiffness=-1.0)
