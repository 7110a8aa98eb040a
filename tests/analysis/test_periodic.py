"""Periodic motions against the linear limit, stored cases, time integration and balances."""

import json
from pathlib import Path

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
from drives import example

import beltjax as bj
from beltjax.analysis.damping import damping_matrix
from beltjax.analysis.motion import Excited, load_series, motion_model, oscillator, span_paths
from beltjax.analysis.orbit_measures import Signals, measures
from beltjax.analysis.orbit_motion import HarmonicMotion
from beltjax.compiling.quick import quickly_compiled
from beltjax.numerics.periodic import periodic_orbit
from beltjax.physics.motion import stretching

CASES = json.loads((Path(__file__).parents[1] / "data" / "periodic.json").read_text())
RPM = 2 * np.pi / 60
MODAL = bj.Damping(modal=0.02)


def running(point, rpm):
    return bj.OperatingPoint(driver_speed=rpm * RPM, torque=point.torque)


def crank(degrees, order=2):
    return bj.Orders({order: bj.Excitation(crank=np.deg2rad(degrees))})


def complex_amplitudes(found, k):
    return np.asarray(found.coefficients[2 * k - 1] - 1j * found.coefficients[2 * k])


def test_small_amplitudes_are_those_of_the_linear_drive():
    drive, point = example("three_pulley")
    excitation = bj.Excitation(crank=1e-6, torques={"accessory": 1e-4j})
    found = bj.periodic_response(
        drive, running(point, 3000), bj.Orders({2: excitation}), harmonics=3, damping=MODAL,
        basis=bj.Legendre(16),
    )  # fmt: skip
    linear = bj.speed_response(drive, point, [3000 * RPM], excitation, damping=MODAL)
    _, rotations, motions = found.linearization.split(complex_amplitudes(found, 1))
    expected = np.asarray(linear.rotations[0])
    np.testing.assert_allclose(rotations[1:], expected[1:], atol=1e-8 * np.abs(expected).max())
    np.testing.assert_allclose(motions, linear.tensioner_motions[0], rtol=1e-8)
    found = found.measures
    np.testing.assert_allclose(found.rotation_amplitudes, np.abs(expected), rtol=1e-6)
    np.testing.assert_allclose(found.travels, 2 * np.abs(linear.arm_rotation), rtol=1e-6)
    swing = (found.tension_max - found.tension_min) / 2
    np.testing.assert_allclose(swing, np.abs(linear.tensions[0]), rtol=1e-6)
    np.testing.assert_allclose(found.span_peaks, linear.span_peaks[0], rtol=1e-3)


@pytest.mark.slow
def test_orders_add_up_where_the_drive_is_linear():
    drive, point = example("three_pulley")
    parts = {1.5: bj.Excitation(crank=1e-6 * np.exp(0.7j)), 2: bj.Excitation(crank=2e-6)}
    options = {"harmonics": 4, "damping": MODAL, "functions": 8}
    both = bj.periodic_response(drive, running(point, 2500), bj.Orders(parts), **options)
    assert both.period == pytest.approx(2 / (2500 / 60))  # of order 1/2
    for order, k in ((1.5, 3), (2, 4)):
        alone = bj.periodic_response(
            drive, running(point, 2500), bj.Orders({order: parts[order]}), **options
        )
        expected = complex_amplitudes(alone, 1)
        np.testing.assert_allclose(
            complex_amplitudes(both, k), expected, atol=2e-5 * np.abs(expected).max()
        )
        assert alone.frequency == pytest.approx(order * 2500 * RPM)


COMPARED = (
    ("rotation_amplitudes", "rotation_amplitude"),
    ("tension_min", "tension_min"),
    ("tension_max", "tension_max"),
    ("hub_load_max", "hub_load_max"),
    ("span_peaks", "span_peak"),
)


@pytest.mark.parametrize(
    ("name", "file", "rpm", "degrees", "modal", "options"),
    [
        ("3p_2000_0.1", "three_pulley", 2000, 0.1, 0.02, {"functions": 20}),
        pytest.param(
            "3p_2000_0.2", "three_pulley", 2000, 0.2, 0.02, {"functions": 20, "harmonics": 20},
            marks=pytest.mark.slow,
        ),
        pytest.param(
            *("7p_900_0.5", "seven_pulley", 900, 0.5, 0.03, {"functions": 12, "harmonics": 7}),
            marks=pytest.mark.slow,
        ),
    ],
)  # fmt: skip
def test_stored_cases(name, file, rpm, degrees, modal, options):
    # Legendre functions and shooting, of another program; `relative_change` is between two of its
    # own resolutions.
    drive, point = example(file)
    case, damping = CASES[name], bj.Damping(modal=modal)
    found = bj.periodic_response(
        drive, running(point, rpm), crank(degrees), damping=damping, **options
    )
    near = case["relative_change"]
    for ours, theirs in COMPARED:
        names = drive.span_names if "tension" in ours or "span" in ours else drive.pulley_names
        expected = np.array([case["measures"][theirs][key] for key in named(names, case, theirs)])
        values = np.asarray(getattr(found.measures, ours))
        np.testing.assert_allclose(values, expected, rtol=0, atol=near * np.abs(expected).max())
    arm = case["measures"]["arm_peak_to_peak"]
    assert found.measures.travels[0] == pytest.approx(arm, rel=case["arm_pp_change"])
    assert abs(found.multipliers[0]) == pytest.approx(case["multiplier"], abs=near)
    assert bool(found.stable)
    for place, use in enumerate(found.friction_use):
        stored = case["measures"]["friction_use_max"].get(drive.pulley_names[place])
        assert use == (0 if stored is None else pytest.approx(stored, abs=near))
    slips = float(np.max(found.friction_use)) > 1
    expected = bj.RESULTS.belt_slips_in_motion if slips else bj.RESULTS.successful
    assert found.warning == expected


def named(names, case, key):
    """The stored names of parts, whose spans may be named from either end."""
    stored = case["measures"][key]
    for name in names:
        yield name if name in stored else "-".join(reversed(name.split("-")))


@pytest.mark.slow
def test_stored_case_of_a_belt_that_follows_the_crank():
    # "uniform speed with s'": of another program, with the same functions.
    drive, point = example("three_pulley")
    case = CASES["varying_belt_speed"]
    found = bj.periodic_response(
        drive, running(point, 2000), crank(0.1), damping=MODAL, harmonics=8, samples=80,
        belt_speed="varying",
    ).measures  # fmt: skip
    values = [
        np.rad2deg(found.rotation_amplitudes[2]), np.rad2deg(found.travels[0]),
        found.tension_min.min(),
    ]  # fmt: skip
    np.testing.assert_allclose(values, case["uniform_speed_with_sdot"], rtol=case["accuracy"])


def test_another_belt_speed_is_refused():
    drive, point = example("three_pulley")
    with pytest.raises(ValueError, match="belt_speed: found 'fast'; give constant or varying"):
        bj.periodic_response(drive, running(point, 2000), crank(0.1), belt_speed="fast")


@pytest.mark.slow
@pytest.mark.parametrize(("degrees", "multiplier"), [(0.12, -1.09241), (0.1, -0.97425)])
def test_period_doubling(degrees, multiplier):
    drive, point = example("three_pulley")
    found = bj.periodic_response(
        drive, running(point, 2390), crank(degrees), damping=MODAL, functions=16, harmonics=8
    )
    assert found.multipliers[0] == pytest.approx(multiplier, abs=3e-5)
    assert bool(found.stable) == (multiplier > -1)
    assert (found.warning == bj.RESULTS.orbit_unstable) == (multiplier < -1)


@pytest.fixture(scope="module")
def strong():
    """A motion far from linear, in a small basis."""
    drive, point = example("three_pulley")
    return bj.periodic_response(
        drive, running(point, 2000), crank(0.2), damping=MODAL, basis=bj.Legendre(4), harmonics=28
    )


def equations(found):
    """z'' [1/s^2] from z, z' [1/s] and the time [s], written anew from M, C, K and the strain."""
    lin = found.linearization
    M, C, K, d = (
        np.asarray(m)
        for m in (
            lin.mass,
            lin.gyroscopic + damping_matrix(lin, MODAL),
            lin.stiffness,
            lin.elongations,
        )
    )
    work = np.asarray(lin.model.lam * lin.model.gam)
    a, n = np.asarray(lin.model.a), lin.basis.size
    unit, w = float(lin.scales.time), float(found.frequency)
    driving, amplitude = np.asarray(lin.driving), 2 * np.deg2rad(0.1)
    inverse = np.linalg.inv(M)

    def acceleration(t, z, v):
        lift, fields = a @ z[-1:], z[: 3 * n].reshape(3, n)
        second = ((fields**2).sum(1) + lift**2) / 2
        gained = driving * amplitude * np.cos(w * t) + second
        tension = work * (d @ z + gained)
        force = K @ z + (work * gained) @ d
        force[: 3 * n] += (tension[:, None] * fields).ravel()
        force[-1] += tension @ (lift * a[:, 0])
        return -inverse @ (force + C @ v * unit) / unit**2

    return acceleration


@pytest.mark.slow
def test_integration_in_time_stays_on_the_orbit(strong):
    acceleration, size = equations(strong), strong.coefficients.shape[1]
    period = float(strong.period)
    times = np.linspace(0, period, 9)
    start = np.asarray(strong.at(0.0))
    rate = np.asarray(jax.jvp(strong.at, (0.0,), (1.0,))[1])

    def slope(t, x):
        return np.concatenate([x[size:], acceleration(t, x[:size], x[size:])])

    run = scipy.integrate.solve_ivp(
        slope, (0, period), np.concatenate([start, rate]), "DOP853", times, rtol=1e-10, atol=1e-12
    )
    orbit = np.asarray(strong.at(times)).T
    np.testing.assert_allclose(run.y[:size], orbit, atol=1e-7 * np.abs(orbit).max())
    np.testing.assert_allclose(run.y[size:, -1], rate, atol=1e-6 * np.abs(rate).max())


def test_work_of_the_crank_is_what_dampers_take(strong):
    lin = strong.linearization
    times = np.arange(400) * float(strong.period) / 400
    z = strong.at(times)
    rates = np.asarray(jax.jvp(strong.at, (times,), (np.ones(400),))[1]) * float(lin.scales.time)
    C = np.asarray(damping_matrix(lin, MODAL))
    taken = np.mean(np.einsum("ta,ab,tb->t", rates, C, rates)) / float(lin.scales.time)
    # The crank's moment is the tensions' by their arms.
    gained = (strong.tensions(times) - lin.steady.running_tensions) / lin.scales.tension
    moment = np.asarray(gained * lin.model.lam) @ np.asarray(lin.driving)
    amplitude, w = np.deg2rad(0.2), float(strong.frequency)
    given = np.mean(moment * -w * amplitude * np.sin(w * times))
    assert given == pytest.approx(taken, rel=1e-9)
    assert z.shape == (400, lin.mass.shape[0])


@pytest.mark.slow
def test_two_hundred_periods_from_rest_end_on_the_orbit():
    drive, point = example("three_pulley")
    found = bj.periodic_response(
        drive, running(point, 2000), crank(0.2), damping=MODAL, basis=bj.Legendre(2), harmonics=16
    )
    lin = found.linearization
    size, period = len(lin.mass), float(found.period)
    whole = motion_model(lin, MODAL)
    unit, w = lin.scales.time, found.frequency

    def slope(t, x, _):
        z, v = x[:size], x[size:]
        theta = np.deg2rad(0.2) * jnp.cos(w * unit * t)
        force = whole.damping @ v + whole.stiffness @ z + stretching(whole, z, theta)
        return jnp.concatenate([v, -jnp.linalg.solve(whole.mass, force)])

    times = (200 + np.linspace(0, 1, 17)) * period / float(unit)
    run = diffrax.diffeqsolve(
        diffrax.ODETerm(slope), diffrax.Kvaerno5(), 0.0, times[-1], 0.01, jnp.zeros(2 * size),
        saveat=diffrax.SaveAt(ts=jnp.asarray(times)), max_steps=1_000_000,
        stepsize_controller=diffrax.PIDController(rtol=1e-8, atol=1e-10),
    )  # fmt: skip
    orbit = np.asarray(found.at(times * float(unit)))
    np.testing.assert_allclose(run.ys[:, :size], orbit, atol=1e-5 * np.abs(orbit).max())


THREE = example("three_pulley")  # read outside of what JAX traces


def numbers_of(drive):
    parts = drive.tensioner, drive.belt, drive.pulleys[2]
    return [
        parts[0].stiffness, parts[1].axial_stiffness, parts[1].bending_stiffness,
        parts[2].inertia, parts[2].radius, drive.installation.tension,
    ]  # fmt: skip


def answers(values, functions, harmonics):
    """Travel of the arm [deg] and least tension [N], by the numbers of the drive."""
    drive, point = THREE
    changed = eqx.tree_at(numbers_of, drive, list(values))
    found = bj.periodic_response(
        changed, running(point, 2000), crank(0.1), damping=MODAL, functions=functions,
        harmonics=harmonics, throw=False,
    ).measures  # fmt: skip
    return jnp.stack([jnp.rad2deg(found.travels[0]), jnp.min(found.tension_min)])


@pytest.mark.slow
def test_derivatives_three_ways():
    values = jnp.stack(numbers_of(example("three_pulley")[0]))
    reverse = quickly_compiled(jax.jacrev(answers))
    by = eqx.filter_jit(lambda v: answers(v, 8, 4))
    forward = np.asarray(quickly_compiled(jax.jacfwd(answers))(values, 8, 4))
    slopes = np.asarray(reverse(values, 8, 4))
    np.testing.assert_allclose(slopes, forward, rtol=1e-8)
    for k, value in enumerate(values):
        unit = jnp.zeros(len(values)).at[k].set(1e-4 * value)
        near, far = (
            by(values + unit) - by(values - unit),
            by(values + 2 * unit) - by(values - 2 * unit),
        )
        difference = (8 * near - far) / (12e-4 * value)
        np.testing.assert_allclose(slopes[:, k], difference, rtol=1e-6)


@pytest.mark.slow
def test_stability_margin_and_its_derivatives_three_ways():
    drive, point = THREE

    def margin(values):
        changed = eqx.tree_at(numbers_of, drive, list(values))
        found = bj.periodic_response(
            changed, running(point, 2390), crank(0.12), damping=MODAL, functions=4, harmonics=4,
        )  # fmt: skip
        return bj.stability_margin(found), found.multipliers

    values = jnp.stack(numbers_of(drive))
    by = quickly_compiled(margin)
    at, floquet = by(values)
    assert abs(at - (1 - abs(floquet[0]))) < 1e-12
    slopes = quickly_compiled(jax.jacrev(lambda v: margin(v)[0]))(values)
    forward = quickly_compiled(jax.jacfwd(lambda v: margin(v)[0]))(values)
    np.testing.assert_allclose(slopes, forward, rtol=1e-7)
    for k, value in enumerate(values):
        unit = jnp.zeros(len(values)).at[k].set(1e-4 * value)
        near = by(values + unit)[0] - by(values - unit)[0]
        far = by(values + 2 * unit)[0] - by(values - 2 * unit)[0]
        np.testing.assert_allclose(slopes[k], (8 * near - far) / (12e-4 * value), rtol=1e-6)


@pytest.mark.slow
def test_derivatives_of_the_stored_case():
    # "IFT against re-solved differences; against plain Legendre 24: 1e-5 .. 4e-4."
    case = CASES["derivatives"]
    values = jnp.stack(numbers_of(example("three_pulley")[0]))
    found = quickly_compiled(answers)(values, 16, 8)
    np.testing.assert_allclose(found, list(case["value"].values()), rtol=1e-7)
    slopes = np.asarray(quickly_compiled(jax.jacrev(answers))(values, 16, 8))
    stored = [list(case[key].values()) for key in ("d_arm_pp_deg", "d_tension_min")]
    np.testing.assert_allclose(slopes, stored, rtol=4e-4)


@pytest.mark.slow
def test_too_much_is_said():
    drive, point = example("three_pulley")
    found = bj.periodic_response(
        drive, running(point, 2000), crank(30.0), damping=MODAL, functions=2, harmonics=4,
        throw=False,
    )  # fmt: skip
    assert found.result == bj.RESULTS.orbit_not_found
    assert not np.any(found.coefficients)
    with pytest.raises(bj.AnalysisError, match="Lower the amplitude"):
        bj.periodic_response(
            drive, running(point, 2000), crank(30.0), damping=MODAL, functions=2, harmonics=4
        )


@pytest.mark.slow
def test_a_bad_lane_disturbs_none():
    drive, point = example("three_pulley")

    def at(rpm):
        found = bj.periodic_response(
            drive, running(point, rpm), crank(0.1), damping=MODAL, functions=2, harmonics=4,
            throw=False,
        )  # fmt: skip
        return found.measures.travels[0], found.result

    speeds = jnp.array([2000.0, 1e6, 2200.0])
    both = jax.vmap(jax.value_and_grad(at, has_aux=True))
    (travels, results), slopes = quickly_compiled(both)(speeds)
    assert slopes[1] == 0
    assert np.all(np.isfinite(slopes))
    np.testing.assert_array_equal(results == bj.RESULTS.successful, [True, False, True])
    assert np.all(np.isfinite(travels))
    alone = bj.periodic_response(
        drive, running(point, 2200.0), crank(0.1), damping=MODAL, functions=2, harmonics=4
    )
    assert travels[2] == pytest.approx(float(alone.measures.travels[0]), rel=1e-9)


@pytest.mark.slow
def test_slopes_of_a_batch_with_layers_are_those_of_each():
    """Slopes of such batches used to hang: solves at the same time waited for XLA's threads."""
    drive, point = example("three_pulley")
    speeds, springs = jnp.array([1500.0, 2000.0, 2400.0, 3000.0]), jnp.array([90.0, 120.0])

    def at(spring, rpm):
        changed = eqx.tree_at(lambda d: d.tensioner.stiffness, drive, spring)
        found = bj.periodic_response(
            changed, running(point, rpm), crank(0.05), damping=MODAL, functions=12, harmonics=4,
            stability=False,
        )  # fmt: skip
        return found.measures.travels[0]

    slope = jax.grad(at)
    alone = quickly_compiled(slope)
    batch = quickly_compiled(jax.vmap(jax.vmap(slope, (None, 0)), (0, None)))
    expected = [[float(alone(spring, rpm)) for rpm in speeds] for spring in springs]
    np.testing.assert_allclose(batch(springs, speeds), expected, rtol=1e-7)


@pytest.mark.parametrize(
    ("orders", "options", "words"),
    [
        (lambda: bj.Orders({}), {}, "give at least one"),
        (lambda: bj.Orders({np.pi: bj.Excitation(1e-3)}), {}, "positive fraction"),
        (lambda: bj.Orders({-1: bj.Excitation(1e-3)}), {}, "positive fraction"),
        (lambda: bj.Orders({2: bj.Excitation(1e-3)}, 0), {}, "subharmonic"),
        (
            lambda: bj.Orders({0.5: bj.Excitation(1e-3), 3: bj.Excitation(1e-3)}),
            {"harmonics": 4},
            "give at least 6",
        ),
        (lambda: bj.Orders({2: bj.Excitation(1e-3)}), {"harmonics": 0}, "give at least 1"),
        (lambda: bj.Orders({2: bj.Excitation(1e-3)}), {"samples": 20}, "give at least 26"),
        (lambda: bj.Orders({2: bj.Excitation(1e-3)}), {"functions": 99}, "0 to 32"),
        (lambda: bj.Orders({2: bj.Excitation(0.0, {"fan": 1.0})}), {}, "no pulley 'fan'"),
    ],
)  # fmt: skip
def test_what_is_wrong_whatever_the_numbers(orders, options, words):
    drive, point = example("three_pulley")
    with pytest.raises(ValueError, match=words):
        bj.periodic_response(drive, point, orders(), **options)


@pytest.mark.slow
def test_stored_case_of_an_arm_at_large_angles():
    # It adds the exact path of the arm to the drive of a linear arm, damped as that is, whose
    # steady state is not one of the exact arm: the mean moves there.
    drive, point = example("three_pulley")
    steady = bj.steady_state(drive, running(point, 2000))
    lin = bj.linearize(steady, bj.Legendre(24))
    paths = span_paths(drive, steady)
    model, length = lin.model, lin.model.lam[:, None]
    paths = eqx.tree_at(
        lambda p: (p.first, p.second, p.counted),
        paths,
        (
            (model.pull + model.a * model.drop[:, None]) * length,
            model.a[:, :, None] * model.a[:, None, :] * length[:, :, None],
            jnp.ones(()),
        ),
    )
    forcing = crank(0.1).forcing(drive.pulley_names, 8)
    frequency = 2 * 2000 * RPM * lin.scales.time

    def move(lin, paths):
        driver, load = load_series(lin, forcing, frequency, MODAL)
        whole = motion_model(lin, MODAL, paths)
        excited = Excited(whole, frequency, driver, load)
        orbit = periodic_orbit(oscillator, excited, 8, 64)
        motion = HarmonicMotion(orbit.coefficients, driver, frequency)
        return orbit, measures(Signals(lin, whole, motion), 64)

    orbit, found = quickly_compiled(move)(lin, paths)
    assert orbit.converged
    case = CASES["3p_exact_arm"]
    arm, mean = (case["measures"][key] for key in ("arm_peak_to_peak", "arm_mean"))
    assert found.travels[0] == pytest.approx(arm, rel=case["arm_pp_change"])
    assert found.mean_motions[0] == pytest.approx(mean, rel=case["relative_change"])
    for ours, theirs in COMPARED:
        expected = np.array(list(case["measures"][theirs].values()))
        values = np.asarray(getattr(found, ours))
        size = case["relative_change"] * np.abs(expected).max()
        np.testing.assert_allclose(values, expected, rtol=0, atol=size)
