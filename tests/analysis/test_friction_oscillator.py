"""One mass on a belt: closed forms, a second route by SciPy, derivatives, and each result."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import beltjax as bj
from beltjax.compiling.quick import quickly_compiled

CASES = json.loads((Path(__file__).parents[1] / "data" / "friction_vibration.json").read_text())
STRIBECK = bj.StribeckFriction(0.4, 0.25, 0.1)
CUBIC = bj.CubicFriction(0.4, 0.25, 0.5)
UNIT = 1.0, 0.1, 1.0, 1.0  # m, c, k, N


def numbers_of(text):
    return [float(part.split("=")[1]) for part in text.split(",")]


@pytest.mark.parametrize("case", CASES["coulomb_undamped"])
def test_undamped_coulomb_friction_in_closed_form(case):
    m, k, drop, V = numbers_of(case)
    found = bj.friction_oscillator(m, 0.0, k, 10.0, bj.CoulombFriction(0.1 + drop / 10, 0.1), V)
    closed, cycle = CASES["coulomb_undamped"][case], found.cycle
    for name in ("amplitude", "slip_time", "stick_time", "period"):
        assert float(getattr(cycle, name)) == pytest.approx(closed[name], rel=1e-11), name
    w, a = np.sqrt(k / m), drop / k
    assert float(cycle.amplitude) == pytest.approx(np.hypot(a, V / w), rel=1e-11)
    assert float(cycle.slip_time) == pytest.approx((np.pi + 2 * np.arctan(V / w / a)) / w)
    assert float(cycle.v_max) == pytest.approx(V + w * np.hypot(a, V / w), rel=1e-11)
    assert np.isinf(found.fold_speed)
    assert float(found.onset_speed) == 0


@pytest.mark.parametrize(("zeta", "V"), [(0.01, 0.1), (0.05, 0.1), (0.2, 0.04)])
def test_damped_coulomb_friction_by_its_transcendental_equation(zeta, V):
    """The slip is a damped oscillation, whose speed is again that of the belt at t_1."""
    c, drop, kinetic = 2 * zeta, 0.15, 0.25
    found = bj.friction_oscillator(1.0, c, 1.0, 1.0, bj.CoulombFriction(0.4, 0.25), V).cycle
    w, start = np.sqrt(1 - zeta**2), drop - c * V

    def speed(t):
        rate = (V + zeta * start) / w
        decay, cos, sin = np.exp(-zeta * t), np.cos(w * t), np.sin(w * t)
        return decay * ((rate * w - zeta * start) * cos - (start * w + zeta * rate) * sin)

    def place(t):
        rate = (V + zeta * start) / w
        return np.exp(-zeta * t) * (start * np.cos(w * t) + rate * np.sin(w * t)) + kinetic

    turn = brentq(speed, np.pi, 2 * np.pi)  # where it has swung farthest back
    t1 = brentq(lambda t: speed(t) - V, turn, turn + np.pi / 2 / w, xtol=1e-14)
    out = brentq(speed, 0.0, np.pi)
    assert float(found.slip_time) == pytest.approx(t1, rel=1e-11)
    assert float(found.capture) == pytest.approx(place(t1), rel=1e-10)
    assert float(found.release) == pytest.approx(start + kinetic, rel=1e-12)
    assert float(found.amplitude) == pytest.approx((place(out) - place(turn)) / 2, rel=1e-10)


@pytest.mark.parametrize("case", CASES["coulomb_fold"])
def test_fold_of_coulomb_friction(case):
    (zeta,) = numbers_of(case)
    found = bj.friction_oscillator(1.0, 2 * zeta, 1.0, 1.0, bj.CoulombFriction(0.4, 0.25), 0.05)
    assert float(found.fold_speed) == pytest.approx(CASES["coulomb_fold"][case], rel=1e-9)
    estimate = 0.15 / np.sqrt(4 * np.pi * zeta)
    assert estimate == pytest.approx(CASES["coulomb_fold_estimate"][case], rel=1e-12)


@pytest.mark.parametrize("case", CASES["stribeck"]["cycles"])
def test_stribeck_friction(case):
    known, (V,) = CASES["stribeck"]["cycles"][case], numbers_of(case)
    found = bj.friction_oscillator(*UNIT, STRIBECK, V)
    cycle = found.cycle
    for name, key in (
        ("period", "period"),
        ("stick_time", "stick_time"),
        ("amplitude", "amplitude"),
        ("release", "x_release"),
        ("capture", "x_capture"),
    ):
        assert float(getattr(cycle, name)) == pytest.approx(known[key], rel=1e-9), name
    growth, frequency = known["eig"]
    assert complex(found.eigenvalues[0]) == pytest.approx(complex(growth, frequency), rel=1e-9)
    assert float(found.onset_speed) == pytest.approx(0.1 * np.log(1.5 / 0.1), rel=1e-12)
    assert float(found.onset_speed) == pytest.approx(CASES["stribeck"]["onset"], rel=1e-9)
    assert float(found.fold_speed) == pytest.approx(CASES["stribeck"]["fold"], rel=1e-9)
    assert float(found.error) < 1e-10
    assert found.result == bj.RESULTS.successful


def test_falling_friction_coexists_with_steady_sliding_between_onset_and_fold():
    found = bj.friction_oscillator(*UNIT, STRIBECK, 0.3)
    assert float(found.criticality) < 0
    assert np.all(np.real(found.eigenvalues) < 0)
    assert bool(found.cycle.sticks)
    above = bj.friction_oscillator(*UNIT, STRIBECK, 0.4922)
    assert above.result == bj.RESULTS.no_stick_slip
    assert float(above.cycle.amplitude) == 0


def test_cubic_friction_begins_gently():
    """Thomsen's and Fidlin's friction: the cycle grows from nothing, and sticks further below."""
    known = CASES["cubic"]
    found = bj.friction_oscillator(*UNIT, CUBIC, 0.42)
    onset = 0.5 * np.sqrt(1 - 2 * 0.1 * 0.5 / (3 * 0.15))
    assert float(found.onset_speed) == pytest.approx(onset, rel=1e-12)
    assert float(found.fold_speed) == pytest.approx(known["fold"], abs=5e-7)
    assert float(found.criticality) > 0
    assert not bool(found.cycle.sticks)
    assert float(found.cycle.amplitude) == pytest.approx(known["amplitude_at_0.42"], abs=5e-7)
    averaged = 2 * np.sqrt(onset**2 - 0.42**2)
    assert averaged == pytest.approx(known["averaged_at_0.42"], abs=5e-6)
    # The averaged amplitude is the limit; the distance from it goes with the amplitude's square.
    square = onset**2 - np.array([0.42, 0.43, 0.44]) ** 2
    exact = [bj.friction_oscillator(*UNIT, CUBIC, V).cycle.amplitude for V in (0.42, 0.43, 0.44)]
    beyond = np.array(exact) / (2 * np.sqrt(square)) - 1
    assert beyond[0] / square[0] == pytest.approx(beyond[2] / square[2], rel=0.2)
    assert 0 < beyond[2] < beyond[1] < beyond[0]
    assert bool(bj.friction_oscillator(*UNIT, CUBIC, 0.39).cycle.sticks)


def integrated(m, c, k, load, rate, wrap, law, V):
    """A cycle by SciPy, from release to the event of sticking."""

    def friction(mu):
        return 2 / wrap * np.tanh(mu * wrap / 2) if wrap else mu

    def coefficient(v):
        return law.kinetic + (law.static - law.kinetic) * np.exp(-v / law.speed)

    held = float(friction(law.static))
    release = (load * held - c * V) / (k - rate * held)

    def rates(t, y):
        x, v = y
        pull = (load + rate * x) * float(friction(coefficient(max(v, 0.0))))
        return [V - v, -(pull - c * (V - v) - k * x) / m]

    def caught(t, y):
        return y[1] if t > 1e-3 * np.sqrt(m / k) else 1.0

    caught.terminal = True  # pyright: ignore[reportFunctionMemberAccess]
    caught.direction = -1  # pyright: ignore[reportFunctionMemberAccess]
    end = 20 * np.sqrt(m / k)
    run = solve_ivp(rates, (0, end), [release, 0.0], "DOP853", rtol=1e-12, atol=1e-15 * load,
                    events=caught, dense_output=True)  # fmt: skip
    fine = run.sol(np.linspace(0, run.t[-1], 20001))[0]
    stuck = (release - run.y[0, -1]) / V
    return run.t[-1], stuck, (fine.max() - fine.min()) / 2


@pytest.mark.parametrize(("rate", "wrap"), [(0.0, 0.0), (0.3, 0.0), (-0.2, 2.5), (0.1, 3.6)])
def test_cycle_by_a_second_route(rate, wrap):
    law = bj.StribeckFriction(0.6, 0.3, 0.15)
    numbers = 1.3, 0.08, 1.7, 0.9
    cycle = bj.friction_oscillator(*numbers, law, 0.2, load_rate=rate, wrap=wrap).cycle
    slip, stick, amplitude = integrated(*numbers, rate, wrap, law, 0.2)
    assert float(cycle.slip_time) == pytest.approx(slip, rel=1e-9)
    assert float(cycle.stick_time) == pytest.approx(stick, rel=1e-9)
    assert float(cycle.amplitude) == pytest.approx(amplitude, rel=2e-8)  # a maximum over points


def regularized(v0):
    """Amplitude with friction mu tanh(v/v0), after the first return to the belt."""

    def rates(t, y):
        v = 0.1 - y[1]
        mu = 0.25 + 0.15 * np.exp(-abs(v) / 0.1)
        return [y[1], mu * np.tanh(v / v0) - 0.1 * y[1] - y[0]]

    run = solve_ivp(rates, (0, 26), [0.0, 0.1], "LSODA", rtol=1e-9, atol=1e-11, dense_output=True)
    last = run.sol(np.linspace(26 - 7.8, 26, 40001))[0]
    return (last.max() - last.min()) / 2


def test_regularized_friction_is_of_first_order_in_its_speed():
    exact = float(bj.friction_oscillator(*UNIT, STRIBECK, 0.1).cycle.amplitude)
    found = {v0: regularized(v0) for v0 in (1e-2, 1e-3, 1e-4)}
    printed = CASES["regularized"]
    for v0, key in ((1e-2, "v0=1e-2"), (1e-3, "1e-3"), (1e-4, "1e-4")):
        assert found[v0] == pytest.approx(printed[key], rel=2e-5)
    errors = [exact - found[v0] for v0 in (1e-3, 1e-4)]
    assert 7 < errors[0] / errors[1] < 10
    extrapolated = found[1e-4] + (found[1e-4] - found[1e-3]) / 9
    assert extrapolated == pytest.approx(exact, rel=1e-3)
    assert abs(extrapolated - exact) < errors[1] / 4


class Either(bj.AbstractFrictionLaw):
    """A law by its numbers, so that one compiled function has both kinds."""

    static: jax.Array
    low: jax.Array
    speed: jax.Array
    cubic: jax.Array

    @property
    def curve(self):
        numbers = self.static, self.low, self.speed
        kinds = bj.CubicFriction(*numbers).curve, bj.StribeckFriction(*numbers).curve
        return jax.tree.map(lambda a, b: jnp.where(self.cubic > 0, a, b), *kinds)


def of_vector(x, cubic):
    m, c, k, N, V, rate, wrap = x[:7]
    law = Either(*x[7:], cubic)
    found = bj.friction_oscillator(m, c, k, N, law, V, load_rate=rate, wrap=wrap, throw=False)
    cycle = found.cycle
    return jnp.stack(
        [
            found.onset_speed, found.fold_speed, found.critical_damping, found.criticality,
            found.equilibrium, found.eigenvalues[0].real, found.eigenvalues[0].imag,
            cycle.period, cycle.stick_time, cycle.amplitude, cycle.v_max, cycle.capture,
        ]
    )  # fmt: skip


# One that sticks, one that slips all the time, the printed one, one without an oscillation, a bad
# one: in one batch.
LANES = {
    "sticks": [1.2, 0.1, 0.9, 1.1, 0.12, 0.05, 2.0, 0.4, 0.25, 0.1],
    "slips": [1.0, 0.1, 1.0, 1.0, 0.40, 0.02, 0.3, 0.4, 0.25, 0.5],
    "known": [1.0, 0.1, 1.0, 1.0, 0.1, 0.0, 0.0, 0.4, 0.25, 0.1],
    "silent": [1.0, 0.1, 1.0, 1.0, 0.6, 0.0, 0.0, 0.4, 0.25, 0.1],
    "bad": [-1.0, 0.1, 1.0, 1.0, 0.1, 0.0, 0.0, 0.4, 0.25, 0.1],
}
ALL_OF = quickly_compiled(jax.vmap(of_vector, (0, None)))
IS_CUBIC = jnp.array([float(name == "slips") for name in LANES])
ALONG = jnp.asarray(np.random.default_rng(0).normal(size=10))


def of_lane(x, cubic):
    value, slope = jax.jvp(lambda x: of_vector(x, cubic), (x,), (ALONG,))
    return value, slope, jax.jacrev(of_vector)(x, cubic)


@pytest.fixture(scope="module")
def lanes():
    """Values, slopes along a direction taken forward, and all slopes taken in reverse."""
    x = jnp.array(list(LANES.values()))
    found = quickly_compiled(jax.vmap(of_lane))(x, IS_CUBIC)
    return dict(zip(LANES, zip(*map(np.asarray, found), strict=True), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sticks", "slips"])
def test_derivatives_three_ways(lanes, name):
    x, cubic = np.array(LANES[name]), IS_CUBIC[list(LANES).index(name)]
    value, forward, reverse = lanes[name]
    assert (value[8] > 0) == (name == "sticks")
    np.testing.assert_allclose(forward, reverse @ ALONG, rtol=1e-9, atol=1e-9)
    h = 1e-4 * x
    steps = np.concatenate([c * np.diag(h) for c in (-2, -1, 1, 2)])
    values = ALL_OF(x + steps, cubic)
    m2, m1, p1, p2 = np.split(np.asarray(values), 4)
    differences = ((m2 - p2) + 8 * (p1 - m1)).T / (12 * h)
    size = np.max(np.abs(reverse) * h, axis=1, keepdims=True) / h
    assert np.max(np.abs(reverse - differences) / np.where(size > 0, size, 1.0)) < 2e-6


@pytest.mark.slow
def test_known_derivatives_of_the_amplitude():
    def amplitude(c, V):
        return bj.friction_oscillator(1.0, c, 1.0, 1.0, STRIBECK, V).cycle.amplitude

    at = jnp.array(0.1), jnp.array(0.1)
    slopes = quickly_compiled(jax.jacfwd(amplitude, (0, 1)))(*at)
    assert float(slopes[0]) == pytest.approx(CASES["stribeck"]["damplitude_dc_at_V0_1"], rel=1e-9)
    assert float(slopes[1]) == pytest.approx(CASES["stribeck"]["damplitude_dV_at_V0_1"], rel=1e-9)


@pytest.mark.slow
def test_a_bad_lane_leaves_its_neighbors_alone(lanes):
    assert lanes["known"][0][9] == pytest.approx(CASES["stribeck"]["cycles"]["V=0.1"]["amplitude"])
    for part in lanes["bad"]:
        np.testing.assert_array_equal(part, 0)
    # Where nothing sticks the limits of the speed still have their slopes.
    value, _, slopes = lanes["silent"]
    np.testing.assert_array_equal(value[7:], 0)
    np.testing.assert_array_equal(slopes[7:], 0)
    np.testing.assert_allclose(slopes[:4], lanes["known"][2][:4], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("law", "damping", "V", "result", "onset"),
    [
        (STRIBECK, 0.1, 0.6, "no_stick_slip", 0.2708),
        (STRIBECK, 2.0, 0.1, "onset_beyond_stick", 0.0),
        (bj.CoulombFriction(0.4, 0.4), 0.1, 0.1, "no_negative_slope", 0.0),
        (bj.StribeckFriction(0.3, 0.3, 0.1, 0.2), 0.1, 0.1, "no_negative_slope", 0.0),
        (bj.CoulombFriction(0.4, 0.25), 0.1, 0.3, "no_stick_slip", 0.0),
        (STRIBECK, 0.0, 0.1, "successful", np.inf),
        (bj.StribeckFriction(0.483, 0.081, 0.1453), 7e-4, 1.27, "slides_back", 1.2034),
    ],
)
def test_why_there_is_no_oscillation(law, damping, V, result, onset):
    found = bj.friction_oscillator(1.0, damping, 1.0, 1.0, law, V)
    assert found.result == getattr(bj.RESULTS, result)
    assert float(found.onset_speed) == pytest.approx(onset, abs=1e-4)
    assert (float(found.cycle.period) > 0) == (result == "successful")


@pytest.mark.parametrize(
    ("numbers", "law"),
    [
        ((0.128, 0.146, 0.169, 0.12), bj.StribeckFriction(0.807, 0.357, 0.0281)),
        ((5.75, 0.5, 0.24, 5.87), bj.StribeckFriction(0.696, 0.276, 0.029)),
        ((0.125, 0.283, 0.137, 3.84), bj.StribeckFriction(0.86, 0.114, 0.457)),
    ],
)
def test_fold_of_friction_that_falls_steeply(numbers, law):
    """A slip near the fold follows for long what repels it, and the fold is very sharp."""
    m, c, k, load = numbers
    found = float(bj.friction_oscillator(*numbers, law, 0.1).fold_speed)
    for factor, meets in ((0.999, True), (1.001, False)):
        V = factor * found
        release = (load * float(law.static) - c * V) / k

        def rates(t, y, V=V):
            pull = load * (
                float(law.kinetic)
                + float(law.static - law.kinetic) * np.exp(-max(y[1], 0.0) / float(law.speed))
            )
            return [V - y[1], -(pull - c * (V - y[1]) - k * y[0]) / m]

        def met(t, y):
            return y[1] + 1e-9 if t > 1e-3 else 1.0

        met.terminal = True  # pyright: ignore[reportFunctionMemberAccess]
        end = 12 * np.sqrt(m / k)
        run = solve_ivp(rates, (0, end), [release, 0.0], "DOP853", rtol=1e-10, events=met)
        assert (run.status == 1) == meets, factor


def test_critical_damping_is_where_the_onset_vanishes():
    critical = float(bj.friction_oscillator(*UNIT, STRIBECK, 0.1).critical_damping)
    assert critical == pytest.approx(0.15 / 0.1, rel=1e-12)
    below = bj.friction_oscillator(1.0, critical * (1 - 1e-6), 1.0, 1.0, STRIBECK, 0.1)
    assert 0 < float(below.onset_speed) < 1e-6
    assert (
        float(bj.friction_oscillator(1.0, critical * 1.001, 1, 1, STRIBECK, 0.1).onset_speed) == 0
    )


def test_strong_damping_is_warned_of():
    law = bj.StribeckFriction(0.4, 0.25, 0.01)
    for damping, warned in ((4.9, False), (5.1, True)):
        found = bj.friction_oscillator(1.0, damping, 1.0, 1.0, law, 0.01)
        assert bool(found.warning == bj.RESULTS.strongly_damped) == warned


def test_unusable_numbers_raise():
    with pytest.raises(bj.AnalysisError, match="not positive"):
        bj.friction_oscillator(1.0, 0.1, -1.0, 1.0, STRIBECK, 0.1)
    with pytest.raises(ValueError, match="kinetic <= static"):
        bj.StribeckFriction(0.2, 0.3, 0.1)
    with pytest.raises(ValueError, match="speed is positive"):
        bj.CubicFriction(0.3, 0.2, 0.0)
    with pytest.raises(ValueError, match="viscous is not negative"):
        bj.StribeckFriction(0.3, 0.2, 0.1, -1.0)


def test_it_prints_as_a_table():
    text = repr(bj.friction_oscillator(*UNIT, STRIBECK, 0.1))
    assert "onset_speed" in text
    assert "m/s" in text


@pytest.mark.slow
def test_random_laws_by_a_second_route():
    """Whether a slip meets the belt, how long it takes, and where the fold is."""
    rng = np.random.default_rng(5)
    low = [-1, -2.5, -1, -1, np.log10(0.2), -1, -2.0, -2.5]
    high = [1, 0.3, 1, 1, np.log10(0.9), np.log10(0.95), 0, 0.3]
    numbers = 10 ** rng.uniform(low, high, (40, 8))
    ratios = numbers[:, 1] / (2 * np.sqrt(numbers[:, 0] * numbers[:, 2]))
    numbers = numbers[ratios < 2.5]

    def found(x):
        m, c, k, load, static, share, speed, V = x
        law = bj.StribeckFriction(static, share * static, speed)
        return bj.friction_oscillator(m, c, k, load, law, V, throw=False)

    known = quickly_compiled(jax.vmap(found))(jnp.asarray(numbers))
    passes = np.asarray(known.result == bj.RESULTS.slides_back)

    def slip(i, V):
        m, c, k, load, static, share, speed, _ = numbers[i]
        kinetic = share * static

        def rates(t, y):
            mu = kinetic + (static - kinetic) * np.exp(-max(y[1], 0.0) / speed)
            return [V - y[1], -(load * mu - c * (V - y[1]) - k * y[0]) / m]

        def met(t, y):
            return y[1] if t > 1e-4 * np.sqrt(m / k) else 1.0

        met.terminal = True  # pyright: ignore[reportFunctionMemberAccess]
        met.direction = -1  # pyright: ignore[reportFunctionMemberAccess]
        start = [(load * static - c * V) / k, 0.0]
        end = 120 * np.sqrt(m / k)
        return solve_ivp(rates, (0, end), start, "DOP853", rtol=1e-11, atol=1e-13 * V, events=met)

    for i, fold in enumerate(np.asarray(known.fold_speed)):
        run = slip(i, numbers[i, 7])
        meets = bool(known.cycle.sticks[i]) or bool(passes[i])
        assert (run.status == 1) == meets, numbers[i]
        if bool(known.cycle.sticks[i]):
            assert float(known.cycle.slip_time[i]) == pytest.approx(run.t[-1], rel=1e-6)
        if 0 < fold < np.inf:
            assert slip(i, 0.99 * fold).status == 1, numbers[i]
            assert slip(i, 1.0001 * fold).status == 0, numbers[i]
