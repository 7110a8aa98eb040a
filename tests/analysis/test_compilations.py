"""A new number, of whatever type, or a new name compiles nothing."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compilations import TYPES, compilations, renamed, variants
from drives import example
from squealing import with_laws

import beltjax as bj

BASIS = bj.Legendre(6)
STEADY = {
    "layout": lambda d, p: bj.layout(d),
    "turned layout": lambda d, p: bj.layout(d, 0.01 * float(p.belt_speed)),
    "reference_state": bj.reference_state,
    "steady_state": bj.steady_state,
    "perturbation": lambda d, p: bj.steady_state(d, p, bj.Perturbation()),
    "collocation": lambda d, p: bj.steady_state(
        d, p, bj.Collocation(intervals=8, tol=1e-3 + 1e-5 * float(p.belt_speed))
    ),
    "span_frequencies": lambda d, p: bj.span_frequencies(d, p, count=2),
}


def shaken(drive, point):
    """All that vibrates, from the file's numbers to a peak."""
    names = drive.pulley_names
    lin = bj.linearize(bj.steady_state(drive, point), BASIS)
    bj.linearize(bj.steady_state(drive, point), BASIS, fixed_bending=0.001 * speed_of(point))
    bj.modes(lin, 3, damping=bj.Damping(modal=0.001 * speed_of(point)))
    excitation = bj.Excitation(0.01 * speed_of(point), {names[-1]: 0.1 * speed_of(point)})
    speeds = [20.0 + speed_of(point)]
    bj.frequency_response(lin, speeds, excitation, names)
    bj.speed_response(drive, point, speeds, excitation, order=speed_of(point), basis=BASIS)
    bj.peak_response(lin, arm, 10.0 + speed_of(point), 90.0, excitation, names, points=8)


def swung(drive, point):
    """A periodic motion, of which another drive, speed, amplitude or order compiles nothing."""
    excitation = bj.Excitation(1e-4 * speed_of(point), {drive.pulley_names[-1]: 0.1})
    bj.periodic_response(
        drive, point, bj.Orders({speed_of(point): excitation}), harmonics=2, functions=2,
        damping=bj.Damping(modal=0.001 * speed_of(point)), throw=False,
    )  # fmt: skip


def run_up(drive, point):
    """A transient, of which another drive, profile, excitation or signal compiles nothing."""
    speed = 10 * speed_of(point)
    excitation = bj.Excitation(1e-4 * speed_of(point), {drive.pulley_names[-1]: 0.1})
    times = np.linspace(0.0, 0.01, 8)
    bj.transient(
        drive, point, profile=[(0.0, speed), (0.01, 1.2 * speed)], functions=2,
        orders=bj.Orders({speed_of(point): excitation}), saves=np.linspace(0.0, 0.01, 17),
        crank=bj.CrankSignal(times, angles=1e-4 * speed * times), throw=False,
    )  # fmt: skip


def resonant(drive, point):
    """Parametric resonance, of which another drive, speed or amplitude compiles nothing."""
    names, speed = drive.pulley_names, speed_of(point)
    lin = bj.linearize(bj.steady_state(drive, point), BASIS)
    crank = bj.Excitation(1e-4 * speed, {names[-1]: 0.01 * speed})
    damping = bj.Damping(modal=0.001 * speed)
    bj.parametric_pairs(lin, 400.0 + speed, crank, names, damping=damping, count=2)
    bj.floquet(lin, 400.0 + speed, crank, names, damping=damping, modes=4, steps=8, critical=False)


def speed_of(point):
    return float(point.belt_speed)


def arm(response):
    return jnp.abs(response.arm_rotation)


def changes_of(function, drive, point):
    """What each variant compiles after the first call."""
    function(drive, point)
    counts = {}
    for name, other, at in variants(drive, point):
        with compilations() as count:
            jax.block_until_ready(jax.tree.leaves(function(other, at)))
        counts[name] = count[0]
    return counts


@pytest.mark.parametrize("name", STEADY)
def test_states(name):
    drive, point = example("three_pulley")
    assert changes_of(STEADY[name], drive, point) == dict.fromkeys(TYPES, 0)


def test_what_a_belt_is_sold_as_and_where_the_site_is():
    drive, point = example("three_pulley")
    bj.steady_state(drive, point)
    belt = dataclasses.replace(drive.belt, pitch=0.005, standard_lengths=(1.5, 1.6))
    other = dataclasses.replace(drive, belts=(belt,), origin=(4e5, 5e6))
    with compilations() as count:
        bj.steady_state(other, point)
    assert count == [0]


def test_another_weight():
    drive, point = example("conveyor")
    bj.reference_state(drive, point)
    heavier = eqx.tree_at(lambda d: d.tensioners[0].force, drive, jnp.asarray(3e4))
    with compilations() as count:
        bj.reference_state(heavier, point)
    assert count == [0]


@pytest.mark.slow
def test_vibration():
    drive, point = example("three_pulley")
    assert changes_of(shaken, drive, point) == dict.fromkeys(TYPES, 0)


@pytest.mark.slow
def test_periodic_motion():
    drive, point = example("three_pulley")
    assert changes_of(lambda d, p: jnp.asarray(swung(d, p) or 0.0), drive, point) == dict.fromkeys(
        TYPES, 0
    )


def test_parametric_resonance():
    drive, point = example("three_pulley")
    found = changes_of(lambda d, p: jnp.asarray(resonant(d, p) or 0.0), drive, point)
    assert found == dict.fromkeys(TYPES, 0)


@pytest.mark.slow
def test_transient():
    drive, point = example("three_pulley")
    found = changes_of(lambda d, p: jnp.asarray(run_up(d, p) or 0.0), drive, point)
    assert found == dict.fromkeys(TYPES, 0)


@pytest.mark.slow
def test_motion_with_events():
    drive, point = example("three_pulley")
    joint = bj.Isolator((0.0, 0.0, 1.0), 200.0, rim_inertia=1e-4, law="decoupler")
    dry = eqx.tree_at(
        lambda d: (d.isolators, d.tensioner.friction_torque, d.tensioner.friction_speed), drive,
        ((joint,), jnp.asarray(0.5), jnp.asarray(0.0)),
    )  # fmt: skip
    swung(dry, point)
    other = eqx.tree_at(
        lambda d: (d.isolators[0].law, d.tensioner.friction_torque), dry,
        (jnp.asarray(3.0), jnp.asarray(0.2)),
    )  # fmt: skip
    with compilations() as count:
        swung(other, point)
    assert count == [0]


@pytest.mark.slow
def test_friction_induced_vibration():
    def dragged(static, V, **more):
        for law in (bj.StribeckFriction, bj.CubicFriction):
            bj.friction_oscillator(1, 0.1, V, np.float32(1), law(static, 0.25, 0.1), V, **more)
        bj.friction_oscillator(1.0, 0.1, 1.0, 1.0, bj.CoulombFriction(static, 0.2), V)

    dragged(0.4, 0.1)
    with compilations() as count:
        dragged(0.5, 1, load_rate=0.1, wrap=2)
    assert count == [0]


@pytest.mark.slow
def test_squeal():
    drive, point = example("three_pulley")
    drive = with_laws(drive)

    def slipped(drive, point):
        name = drive.pulley_names[2]
        bj.slip_margin(drive, point, bj.Excitation(0.01 * speed_of(point)), basis=BASIS)
        return bj.slip_stability(drive, point, name, 0.1 + speed_of(point), damping=30.0).growth

    assert changes_of(slipped, drive, point) == dict.fromkeys(TYPES, 0)
    with compilations() as count:
        bj.slip_stability(drive, point, drive.pulley_names[0], 0.2, damping=20)
    assert count == [0]


def test_moving_beam():
    bj.moving_beam_modes(0.02, 0.5)
    for name, typed in TYPES.items():
        with compilations() as count:
            bj.moving_beam_modes(0.03, typed(0), count=4)
        assert count == [0], name


def test_sweep():
    drive, point = example("three_pulley")
    other = renamed(drive, point, " other")

    def swept(drive, point, values):
        name = f"pulley.{drive.pulley_names[2]}.radius"
        return bj.sweep(drive, point, name, values, count=2, basis=BASIS, depth=0)

    swept(drive, point, [0.027, 0.028])
    with compilations() as count:
        swept(*other, np.array([0.027, 0.029, 0.031]))
    assert count == [0]


def test_gradients_keep_the_names():
    drive, point = renamed(*example("three_pulley"), " renamed")

    def total(drive, point):
        return bj.steady_state(drive, point).coupling.sum()

    of_drive, of_point = jax.grad(total, (0, 1))(drive, point)
    assert of_drive.pulley_names == drive.pulley_names
    assert of_drive.name == drive.name
    assert jax.tree.structure(of_point) == jax.tree.structure(point)


def test_users_may_forbid_promotion_in_their_own_code():
    drive, point = example("three_pulley")
    with jax.numpy_rank_promotion("raise"), jax.numpy_dtype_promotion("strict"):
        for function in STEADY.values():
            function(drive, point)
        shaken(drive, point)
        steady = bj.steady_state(drive, point)
        steady.deflection(0, 0.5)
        damping = bj.Damping(modal=0.01)
        bj.modes(bj.linearize(steady, BASIS), 3, damping=damping).deflection(0, 0, 0.5)
        shapes = bj.moving_beam_modes(0.02, 0.5).shapes([0.1, 0.9])
    assert np.all(np.isfinite(shapes))
