import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drives import example
from groove_cases import CASES, STRING, ZONES, grooved_drive

import beltjax as bj

FEW = bj.Groove(slip_velocity=1e-4, elements=160)


def assert_as_stored(state, stored):
    level = np.mean(stored["P"])
    effective = np.asarray(state.solved.unknown.P * state.scales.tension)
    assert effective == pytest.approx(stored["P"], rel=1e-9)
    assert np.asarray(state.moments) == pytest.approx(stored["M"], abs=1e-10 * level)
    angles = np.asarray(state.contact_angles)
    assert angles[:, 0] == pytest.approx(stored["chi_in"], abs=1e-10)
    assert angles[:, 1] == pytest.approx(stored["chi_out"], abs=1e-10)
    assert np.asarray(state.slip) == pytest.approx(stored["slip"], abs=1e-11)
    assert np.asarray(state.span_lengths) == pytest.approx(stored["free"], rel=1e-10)
    grooved = np.asarray(state.penetrations) > 0
    wraps = np.asarray(state.wraps)
    assert wraps[grooved] == pytest.approx(np.array(stored["wrap"])[grooved], abs=1e-10)
    assert float(state.efficiency) == pytest.approx(stored["eff"], abs=1e-10)


def test_belt_of_given_length_is_that_of_an_independent_solver():
    drive, point = grooved_drive("A3")
    state = bj.groove_state(drive, point)
    assert_as_stored(state, CASES["A3"]["eps"]["1e-05"])


def test_slip_limit_is_that_of_an_independent_solver():
    drive, point = grooved_drive("A5")
    state = bj.maximum_moment(drive, point, limit=bj.SlipLimit(0.1))
    assert_as_stored(state, CASES["A5"]["eps"]["1e-05"])


@pytest.mark.slow
@pytest.mark.parametrize("eps", ["1e-04", "1e-05"])
@pytest.mark.parametrize("name", [name for name in CASES if name != "A5"])
def test_all_stored_states(name, eps):
    if eps not in CASES[name]["eps"]:
        pytest.skip("not stored")
    drive, point = grooved_drive(name)
    state = bj.groove_state(drive, point, bj.Groove(slip_velocity=float(eps)))
    assert_as_stored(state, CASES[name]["eps"][eps])


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in CASES if name != "A5"])
def test_tension_given_is_that_of_the_belt_turned_slowly(name):
    drive, point = grooved_drive(name, by="tension")
    state = bj.groove_state(drive, point)
    assert float(state.unstretched_length) == pytest.approx(CASES[name]["L0"], rel=1e-10)
    effective = np.asarray(state.solved.unknown.P * state.scales.tension)
    assert effective == pytest.approx(CASES[name]["eps"]["1e-05"]["P"], rel=1e-8)


@pytest.fixture(scope="module")
def loaded():
    drive, point = grooved_drive("A9", moment=2.0)
    return bj.groove_state(drive, point)


def test_energy_and_moments_balance(loaded):
    assert abs(loaded.energy_balance) < 1e-10 * loaded.power_in
    assert np.abs(loaded.moment_balance).max() < 1e-10 * loaded.driver_moment
    given = np.sum(np.asarray(loaded.moments * loaded.speeds))
    assert given + np.sum(np.asarray(loaded.loss)) == pytest.approx(0.0, abs=1e-9 * loaded.power_in)


def test_belt_slides_inwards_at_first_and_outwards_at_last(loaded):
    ends = np.array([0.0, 1.0])
    for pulley in (0, 1):
        depth = np.asarray(loaded.penetration(pulley, ends))
        angle = np.degrees(np.asarray(loaded.sliding_angle(pulley, ends)))
        assert depth == pytest.approx(0.0, abs=1e-12)
        assert abs(angle[0]) < 20
        assert abs(angle[1]) > 140
    with pytest.raises(IndexError, match="pulley 2 of 2"):
        loaded.penetration(2, ends)


def test_zones_fill_the_arc(loaded):
    assert np.sum(np.asarray(loaded.zones), axis=1) == pytest.approx(np.asarray(loaded.wraps))
    assert np.all(np.asarray(loaded.zones) >= 0)


@pytest.mark.slow
@pytest.mark.parametrize("moment", ["2", "8", "20"])
def test_zones_are_those_of_an_independent_solver(moment):
    drive, point = grooved_drive("A3", moment=float(moment))
    state = bj.groove_state(drive, point, bj.Groove(slip_velocity=1e-4))
    fine = bj.groove_state(drive, point, bj.Groove(slip_velocity=1e-4, elements=1200))
    zones, finer = (np.degrees(np.asarray(one.zones)) for one in (state, fine))
    assert zones == pytest.approx(finer, abs=0.1)
    for found, stored in zip(zones, ZONES[moment], strict=True):
        assert found[0] == pytest.approx(stored["seating"], abs=0.02)
        assert found[3] == pytest.approx(stored["unseating"], abs=0.02)
        # Those of the stored mesh end at its nodes, which are some degrees apart there.
        assert found[1] == pytest.approx(stored["adhesion"], abs=2.5)
    depth = np.asarray(state.penetrations) / 0.05
    # The stored ones are the largest of their nodes.
    assert depth == pytest.approx([stored["x_max"] for stored in ZONES[moment]], abs=2e-7)


def numbers_of(state):
    along = jnp.array([0.1, 0.5, 0.9])
    return jnp.concatenate(
        [
            state.slip[1:],
            state.loss,
            state.moments[:1],
            state.tensions,
            state.contact_angles.ravel(),
            state.zones[:, ::3].ravel(),
            state.penetration(1, along),
            state.efficiency[None],
        ]
    )


def moved(drive, by):
    """The drive with its wedge stiffness, first friction, second radius and tension or length."""
    stiffness, friction, radius, rule = by
    belt = dataclasses.replace(drive.belt, wedge_stiffness=drive.belt.wedge_stiffness * stiffness)
    first, second, *rest = drive.pulleys
    first = dataclasses.replace(first, friction=first.friction * friction)
    second = dataclasses.replace(second, radius=second.radius * radius)
    given = drive.installation
    given = dataclasses.replace(given, belt_length=given.belt_length * rule)
    return dataclasses.replace(
        drive, belts=(belt,), pulleys=(first, second, *rest), installation=given
    )


AT, WAY = jnp.ones(4), jnp.array([0.3, -0.2, 0.01, 0.002])


def numbers_at(by):
    drive, point = grooved_drive("A9")
    return numbers_of(bj.groove_state(moved(drive, by), point, FEW, throw=False))


@pytest.fixture(scope="module")
def forward():
    return bj.quick_jit(lambda at: jax.jvp(numbers_at, (at,), (WAY,)))


@pytest.mark.slow
def test_derivatives_are_those_of_differences(forward):
    _, slopes = forward(AT)
    above, below = (forward(AT + h * WAY)[0] for h in (1e-5, -1e-5))
    difference = np.asarray(above - below) / 2e-5
    slopes, zones = np.array(slopes), slice(10, 14)
    # Zones end between nodes, where the polynomials are less accurate.
    assert slopes[zones] == pytest.approx(difference[zones], rel=3e-3)
    slopes[zones] = difference[zones]
    assert slopes == pytest.approx(difference, rel=2e-6, abs=1e-6)


@pytest.mark.slow
def test_reverse_derivatives_are_forward_ones(forward):
    _, slopes = forward(AT)
    weights = jnp.linspace(1.0, 2.0, len(slopes))
    reverse = bj.quick_jit(jax.grad(lambda at: numbers_at(at) @ weights))(AT)
    assert float(reverse @ WAY) == pytest.approx(float(slopes @ weights), rel=1e-9)


THIN = bj.ThinGroove()


def drive_with_arm():
    """The three pulleys with their arm, a belt that wedges and a torque."""
    drive, point = example("three_pulley")
    belt = dataclasses.replace(
        drive.belt, bending_stiffness=0.0, wedge_angle=0.7, wedge_stiffness=2e7
    )
    pulleys = tuple(dataclasses.replace(pulley, friction=0.35) for pulley in drive.pulleys)
    drive = dataclasses.replace(drive, belts=(belt,), pulleys=pulleys)
    return drive, dataclasses.replace(point, torque={"accessory": 4.0})


@pytest.mark.slow
@pytest.mark.parametrize(
    "method", [THIN, pytest.param(bj.Groove(elements=200), marks=pytest.mark.slow)]
)
def test_arm_stands_where_belt_and_spring_balance(method):
    drive, point = drive_with_arm()
    state = bj.groove_state(drive, point, method)
    k, turned = drive.pulley("tensioner"), float(state.coordinates[0])
    assert 0.01 < abs(turned) < 0.1
    spans = state.solved.loop.spans
    along = np.stack([spans.along_x, spans.along_y], axis=-1)[np.asarray(state.order.spans)]
    momentum = np.asarray(state.mass_flow * state.span_speeds)
    pulls = (np.asarray(state.tensions) - momentum)[:, None] * along
    at = bj.layout(drive, turned)
    arm = np.asarray(at.centers[k] - drive.tensioners[0].pivot)
    force = pulls[k] - pulls[k - 1]
    of_belt = arm[0] * force[1] - arm[1] * force[0]
    relaxed = float(state.solved.held.relaxed[0] * state.scales.energy)
    spring = float(drive.tensioners[0].stiffness) * turned - relaxed
    assert of_belt == pytest.approx(spring, rel=1e-9)
    # The belt and spring that were installed by tension give the same state.
    free = float(bj.layout(drive).arm_angle) + relaxed / float(drive.tensioners[0].stiffness)
    given = bj.BeltGiven(belt_length=state.unstretched_length, free_angle=free)
    again = bj.groove_state(dataclasses.replace(drive, installation=given), point, method)
    assert np.asarray(again.tensions) == pytest.approx(np.asarray(state.tensions), rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("method", [THIN, pytest.param(FEW, marks=pytest.mark.slow)])
def test_bad_lane_of_a_batch_leaves_its_neighbors_alone(method):
    drive, point = grooved_drive("A9")

    def found(stiffness):
        belt = dataclasses.replace(drive.belt, wedge_stiffness=stiffness)
        state = bj.groove_state(
            dataclasses.replace(drive, belts=(belt,)), point, method, throw=False
        )
        return state.efficiency, state.result

    batch = bj.quick_jit(jax.vmap(lambda k: (found(k), jax.grad(lambda x: found(x)[0])(k))))
    (efficiency, result), slopes = batch(jnp.array([6e6, jnp.nan, 8e6, -1.0]))
    assert list(np.asarray(result == bj.RESULTS.successful)) == [True, False, True, False]
    assert list(np.asarray(result == bj.RESULTS.numbers_unusable)) == [False, True, False, True]
    assert np.all(np.isfinite(np.asarray(efficiency)))
    assert list(np.asarray(slopes)[[1, 3]]) == [0.0, 0.0]
    (good, _), right = batch(jnp.array([6e6, 7e6, 8e6, 9e6]))
    assert np.asarray(efficiency)[::2] == pytest.approx(np.asarray(good)[::2], rel=1e-12)
    assert np.asarray(slopes)[::2] == pytest.approx(np.asarray(right)[::2], rel=1e-9)


def test_torque_beyond_friction_is_reported():
    beyond = grooved_drive("A3", moment=40.0)
    state = bj.groove_state(*beyond, throw=False)
    assert state.result == bj.RESULTS.groove_not_found
    assert np.isfinite(float(state.efficiency))
    with pytest.raises(bj.AnalysisError, match="more than friction"):
        bj.groove_state(*beyond)


@pytest.mark.slow
def test_random_drives_are_solved_or_reported():
    random = np.random.default_rng(4)
    solved = 0
    for _ in range(20):
        drive, point = grooved_drive("A3", by="tension", moment=random.uniform(0.0, 12.0))
        numbers = {"wedge_stiffness": 10 ** random.uniform(6.3, 8.5)}
        belt = dataclasses.replace(drive.belt, **numbers)
        friction = random.uniform(0.12, 0.45)
        pulleys = tuple(dataclasses.replace(one, friction=friction) for one in drive.pulleys)
        drive = dataclasses.replace(drive, belts=(belt,), pulleys=pulleys)
        state = bj.groove_state(drive, point, bj.Groove(elements=300), throw=False)
        if state.feasible:
            solved += 1
            level = 300 * 0.05
            assert np.abs(np.asarray(state.moment_balance)).max() < 1e-7 * level
        else:
            reported = bj.RESULTS.groove_not_found, bj.RESULTS.groove_unresolved
            assert any(bool(state.result == one) for one in reported)
    assert solved >= 15


def test_formulas_approach_the_full_model_as_the_wedge_stiffens():
    errors = []
    for name in ("A3", "A7"):  # of which the second has a wedge five times as stiff
        drive, point = grooved_drive(name)
        thin, full = bj.groove_state(drive, point, THIN), CASES[name]["eps"]["1e-05"]
        errors.append(abs(float(thin.slip[1]) - full["slip"][1]))
        assert float(thin.slip[1]) == pytest.approx(full["slip"][1], rel=0.02)
        assert float(thin.efficiency) == pytest.approx(full["eff"], abs=2e-3)
        assert abs(thin.energy_balance) <= 1e-9
        assert np.asarray(thin.penetration(1, 1.0)) == pytest.approx(float(thin.penetrations[1]))
    # Of the order (x/R)^2, a twenty-fifth.
    assert errors[1] < errors[0] / 25


def test_formulas_end_where_adhesion_does():
    drive, point = grooved_drive("A3")
    edge = bj.maximum_moment(drive, point, limit=bj.AdhesionLimit(), method=THIN)
    turn = np.asarray(edge.solved.unknown.turn - edge.solved.arcs.sliding)
    assert turn.min() == pytest.approx(0.0, abs=1e-9)
    moment = float(edge.moments[1])
    beyond = grooved_drive("A3", moment=1.05 * moment)
    assert bj.groove_state(*beyond, THIN, throw=False).result == bj.RESULTS.thin_groove_slides
    within = grooved_drive("A3", moment=0.95 * moment)
    assert bj.groove_state(*within, THIN, throw=False).feasible


@pytest.mark.slow
def test_formulas_have_derivatives_both_ways():
    def found(by):
        drive, point = grooved_drive("A9")
        state = bj.groove_state(moved(drive, by), point, THIN, throw=False)
        return jnp.stack([state.efficiency, state.slip[1], state.loss[0], state.zones[1, 2]])

    value, slopes = bj.quick_jit(lambda at: jax.jvp(found, (at,), (WAY,)))(AT)
    run = bj.quick_jit(found)
    difference = np.asarray(run(AT + 1e-5 * WAY) - run(AT - 1e-5 * WAY)) / 2e-5
    assert np.asarray(slopes) == pytest.approx(difference, rel=1e-6, abs=1e-9)
    reverse = bj.quick_jit(jax.grad(lambda at: jnp.sum(found(at))))(AT)
    assert float(reverse @ WAY) == pytest.approx(float(jnp.sum(slopes)), rel=1e-9)
    assert np.asarray(value) == pytest.approx(np.asarray(run(AT)))


def without_grooves(drive):
    smooth = tuple(dataclasses.replace(pulley, wedged=0.0) for pulley in drive.pulleys)
    return dataclasses.replace(drive, pulleys=smooth)


def test_smooth_pulleys_give_the_contact_of_a_string():
    drive, point = grooved_drive("A3")
    smooth = without_grooves(drive)
    flat = dataclasses.replace(drive.belt, wedge_angle=None, wedge_stiffness=None)
    contact = bj.contact_state(dataclasses.replace(drive, belts=(flat,)), point)
    state = bj.groove_state(smooth, point)
    assert np.asarray(state.tensions) == pytest.approx(np.asarray(contact.tensions[:, 1]), rel=1e-9)
    assert float(state.efficiency) == pytest.approx(float(contact.efficiency), rel=1e-10)
    assert np.asarray(state.zones[:, 2]) == pytest.approx(np.asarray(contact.slips), rel=1e-9)


@pytest.mark.slow
def test_string_of_table_5_1():
    drive, point = example("two_pulley_table_5_1")
    belt = dataclasses.replace(
        drive.belt, bending_stiffness=0.0, wedge_angle=0.7, wedge_stiffness=1e6
    )
    state = bj.groove_state(without_grooves(dataclasses.replace(drive, belts=(belt,))), point)
    found = sorted(np.asarray(state.tensions))
    assert found == pytest.approx(sorted([STRING["T1"], STRING["T2"]]), rel=1e-9)
    assert float(state.efficiency) == pytest.approx(STRING["efficiency"], rel=1e-10)
